"""How many seconds of a saturated line the simulated cable carries in a second of processor time, by itself.

No engines: one end hands over whatever there is room for, the other reads, each at its deadlines. What a world adds to
it (two engines, a control, checkers) is measured there.
"""

from __future__ import annotations

import time

from benchmarks.report import spread, table, write_section
from tapewire.engine import SECOND, SignalsOut
from tapewire.line.faults.chance import derive
from tapewire.line.faults.injector import Injectors, injectors
from tapewire.line.faults.plan import Extent
from tapewire.line.faults.presets import preset
from tapewire.line.pacing import character_time, default_window
from tapewire.line.paths import PATHS
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable

BAUD = 86400
TOLERATED = 1280
SPAN_S = 30
RUNS = 5
GRAIN = 54
"""Characters that the receiving UART reports at once: a quarter of the window, as the other end hands over."""

CASES: tuple[tuple[str | None, str | None], ...] = (
    (None, None),
    (None, "worn-connector"),
    (None, "late-xoff"),
    ("uart-16550", None),
    ("usb-1ms", None),
    ("usb-16ms", None),
    ("serial-server", None),
)

ABOUT = """\
{baud} baud, window {window}, {span} s of line, one direction, no engines; median (minimum to maximum) of {runs} runs,
in processor time, so that other work on the computer counts little. A step is a wake-up of either end or of both;
handed over is in pieces of {grain} characters. What bounds it is the interpreter: read, room, write and two deadlines a
step, each a few calls deep.

"""


def faults_of(plan: str | None) -> Injectors | None:
    if plan is None:
        return None
    extent = Extent(characters=SPAN_S * BAUD // 11, span=SPAN_S * SECOND)
    return injectors(preset(plan), lambda name: derive(1, name), extent=extent, character=character_time(BAUD))


def carry(near: CableEnd, far: CableEnd) -> tuple[int, int]:
    """(characters that arrived, steps)."""
    data = bytes(range(256))
    now = arrived = steps = 0
    while now < SPAN_S * SECOND:
        near.read(now)
        if room := near.room(now):
            near.write(data[:room], now)
        arrived += sum(len(item) for item in far.read(now) if isinstance(item, bytes))
        one, other = near.next_deadline(), far.next_deadline()
        assert one is not None
        now = one if other is None or one < other else other
        steps += 1
    return arrived, steps


def measured(path: str | None, plan: str | None) -> tuple[list[float], list[float]]:
    """Line seconds a second, and microseconds a step, run by run."""
    rates, costs = [], []
    for _ in range(RUNS):
        kind = None if path is None else PATHS[path]
        sender = EndSettings(window=default_window(BAUD, TOLERATED), path=kind)
        near, far = simulated_cable(BAUD, sender, EndSettings(window=64, grain=GRAIN), faults=faults_of(plan))
        for end in (near, far):
            end.set_signals(SignalsOut(), 0)
            end.read(0)
        began = time.process_time()
        arrived, steps = carry(near, far)
        took = time.process_time() - began
        rates.append(arrived * character_time(BAUD) / SECOND / took)
        costs.append(took / steps * 1e6)
    return rates, costs


def main() -> None:
    rows = []
    for path, plan in CASES:
        rates, costs = measured(path, plan)
        rows.append([path or "bare UART", plan or "none", spread(rates, ",.0f"), spread(costs, ".1f")])
        print(rows[-1], flush=True)
    text = ABOUT.format(baud=BAUD, window=default_window(BAUD, TOLERATED), span=SPAN_S, runs=RUNS, grain=GRAIN)
    head = ["path of the sender", "faults", "line seconds a second", "µs a step"]
    write_section("simulated-cable", "The simulated cable by itself", text + table(head, rows))


if __name__ == "__main__":
    main()
