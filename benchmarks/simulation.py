"""How fast simulated time goes by: seconds of line for a second of computer, transfers a second, and what bounds them.

    python -m benchmarks.compiled build/compiled
    python -m benchmarks.simulation build/compiled

measures the source as it is, and compiled; without a folder, the source alone.

Processor time is counted, not time on the wall: a machine that does other work beside says the same.
"""

from __future__ import annotations

import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from benchmarks.report import table, write_section
from tapewire.codes import DataCode
from tapewire.engine import SECOND
from tapewire.protocols import PROTOCOLS
from tapewire.sim.campaign import Totals, cases, run_case
from tapewire.sim.programs import program
from tapewire.sim.world import Pair, World

GOAL_SATURATED, GOAL_EXECUTING = 1_000, 20_000
SATURATED_BYTES = 600 * 1024
EXECUTED_BYTES = 200 * 1024
SEEDS = 2

ABOUT = """\
A line of expansion protocol B at 86400 baud, saturated, by what its receiver tells at once (a FIFO of 16, of 128, a
control that looks every 2000 characters), then with a control that executes 5 blocks a second. Seconds of simulated
time for a second of processor time, no transcript kept.

"""

BOUNDS = """\
What bounds the saturated line: one step of the host for each piece it hands over, a quarter of its window, and one of
the control for each piece that its FIFO tells. A step of either is some thirty calls, of which none stands out, so
that the figure follows from the size of the pieces. What bounds the executing control: one step for each block.

"""


@dataclass(frozen=True, slots=True)
class Kind:
    """A line to measure, with what it was to reach."""

    name: str
    size: int
    goal: int
    machine: dict[str, object]


KINDS = (
    Kind("saturated, FIFO of 16", SATURATED_BYTES, GOAL_SATURATED, {"grain": 16}),
    Kind("saturated, FIFO of 128", SATURATED_BYTES, GOAL_SATURATED, {"grain": 128}),
    Kind("saturated, looked at every 2000", SATURATED_BYTES, GOAL_SATURATED, {"grain": 2000, "window": 1200}),
    Kind("5 blocks a second, FIFO of 128", EXECUTED_BYTES, GOAL_EXECUTING, {"grain": 128, "blocks_per_second": 5.0}),
)


def line(size: int, **machine: object) -> tuple[World, Pair, Callable[[], None]]:
    world = World(kept_lines=0)
    pair = world.pair("fanuc-b-expansion", baud=86400, binary=None, **machine)  # type: ignore[arg-type]
    part = program(64 * 1024, 0, DataCode.ASCII)
    head, body = part[:2], part[2:-1]
    text = head + body * -(-size // len(body)) + b"%"

    def run() -> None:
        pair.host.start(BytesIO(text), world.now)
        pair.control.cycle_start(world.now)
        world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
        assert pair.program.getvalue() == text

    return world, pair, run


def simulated_seconds(size: int, **machine: object) -> float:
    """For one second of processor time."""
    world, _, run = line(size, **machine)
    began = time.process_time()
    run()
    return world.now / SECOND / (time.process_time() - began)


def transfers(protocol: str) -> tuple[float, float]:
    """Transfers of a campaign, and simulated hours, for one second of one processor."""
    totals = Totals()
    began = time.process_time()
    for case in cases(protocol, "all", 1, SEEDS):
        totals.add(run_case(case))
    seconds = time.process_time() - began
    return totals.transfers / seconds, totals.simulated / SECOND / 3600 / seconds


def profile() -> list[list[str]]:
    """The share of the functions that take the most, of the saturated line."""
    _, _, run = line(SATURATED_BYTES // 4, grain=128, window=216)
    profiler = cProfile.Profile()
    profiler.runcall(run)
    stats = pstats.Stats(profiler)
    total = stats.total_tt  # type: ignore[attr-defined]
    entries = sorted(stats.stats.items(), key=lambda entry: -entry[1][2])[:8]  # type: ignore[attr-defined]
    return [[f"`{name[2]}` ({name[0].rsplit('/', 1)[-1]})", f"{own[2] / total:.0%}"] for name, own in entries]


def measured() -> dict[str, list[float]]:
    """Of each line its speed, of each protocol its transfers and hours."""
    speeds = {kind.name: [simulated_seconds(kind.size, **kind.machine)] for kind in KINDS}
    return speeds | {name: list(transfers(name)) for name in PROTOCOLS}


def compiled(folder: Path) -> dict[str, list[float]]:
    """The same by another process, with the modules of `folder`."""
    paths = os.pathsep.join([str(folder.resolve()), *sys.path])
    command = [sys.executable, "-c", "import benchmarks.simulation as it, json; print(json.dumps(it.measured()))"]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, check=True, stdout=subprocess.PIPE)
    figures: dict[str, list[float]] = json.loads(done.stdout)
    return figures


def main() -> None:
    runs = {"as it is": measured()}
    if sys.argv[1:]:
        runs["compiled"] = compiled(Path(sys.argv[1]))
    lines = [[kind.name, *(f"{run[kind.name][0]:,.0f}" for run in runs.values()), f"{kind.goal:,}"] for kind in KINDS]
    rates = [[name, *(f"{figure:.1f}" for run in runs.values() for figure in run[name])] for name in PROTOCOLS]
    text = (
        ABOUT
        + table(["line", *(f"simulated seconds a second, {run}" for run in runs), "goal"], lines)
        + "\n\nTransfers of a campaign (all presets, sizes as drawn) for one processor:\n\n"
        + table(["protocol", *(f"{unit}, {run}" for run in runs for unit in ("transfers a second", "hours"))], rates)
        + f"\n\n{BOUNDS}"
        + table(["function", "own share of the time"], profile())
    )
    write_section("simulation", "Speed of the simulated world", text)


if __name__ == "__main__":
    main()
