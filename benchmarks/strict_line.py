"""DNC LINK on a simulated path whose computer wakes late: what stop distances and the closed loop are measured by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO

from tapewire.engine import SECOND, AfterStop, Ended, Event, Nanos, Outcome
from tapewire.line.faults.chance import derive
from tapewire.line.lateness import LateLink, Lateness
from tapewire.line.link import Link
from tapewire.line.pacing import Pacing, character_time, default_window, pacing_for
from tapewire.line.paths import PathKind, TransmitterEmpty
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable
from tapewire.line.transport import StopDistance
from tapewire.protocols import protocol
from tapewire.protocols.settings import End
from tapewire.sim.machine import Control

__all__ = ["Run", "program_of", "run_link"]

BITS = 10
"""7E1, as the text has it."""

ETB = 0x17
LIMIT: Nanos = 24 * 3600 * SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What came of one DNC LINK."""

    whole: bool
    """It arrived to the byte, and both ends say complete."""
    after_stop: tuple[int, ...]
    """Characters after each DC3, as the control counts them from the moment its DC3 has left."""
    in_records: float
    """Share of the line used from the first character of each record to its last, DC3 not counted."""
    wakes: int
    """Steps of the host's computer."""
    seconds: float
    """Simulated time."""
    stated: StopDistance


def program_of(size: int) -> bytes:
    """Blocks of about 20 characters, whole ones, `size` bytes at most."""
    return b"".join(b"N%05d G01 X1.5 Y2.5\r\n" % number for number in range(size // 22))


class _Watch:
    """How full the wire was within records, from what was handed over when."""

    def __init__(self, character: Nanos) -> None:
        self._character = character
        self._free: Nanos = 0
        self._before = bytes((ETB, 0))
        self.busy: Nanos = 0
        self.gaps: Nanos = 0
        self.stopped = False

    def wrote(self, data: bytes, now: Nanos) -> None:
        starts_record = self._before[0] == ETB
        if not starts_record and not self.stopped:
            self.gaps += max(0, now - self._free)
        self.stopped = False
        self.busy += len(data) * self._character
        self._free = max(now, self._free) + len(data) * self._character
        self._before = (self._before + data)[-2:]


class _Bench:
    def __init__(self, near: CableEnd, character: Nanos) -> None:
        self.ends: dict[str, Ended] = {}
        self.after: list[int] = []
        self.watch = _Watch(character)
        write = near.write

        def watched(data: bytes, now: Nanos) -> None:
            write(data, now)
            self.watch.wrote(data, now)

        near.write = watched  # type: ignore[method-assign]

    def on_cnc(self, event: Event, now: Nanos) -> None:
        if isinstance(event, AfterStop):
            self.after.append(event.count)
            self.watch.stopped = True
        elif isinstance(event, Ended):
            self.ends["cnc"] = event

    def on_host(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Ended):
            self.ends["host"] = event

    def run(self, host: LateLink, cnc: Link) -> Nanos:
        now: Nanos = 0
        while len(self.ends) < 2:
            host.step(now)
            cnc.step(now)
            moments = [moment for moment in (host.next_deadline(), cnc.next_deadline()) if moment is not None]
            assert moments or len(self.ends) == 2, "everything is quiet"
            now = max(now, min(moments, default=now))
            assert now < LIMIT, "no end"
        return now


def settings_of(baud: int, needs: int, path: PathKind | None, clock_percent: float, closed_loop: bool) -> EndSettings:
    transmitter = TransmitterEmpty.ASKED if path is None else path.transmitter_empty
    window = default_window(baud, needs)
    return EndSettings(
        window=window,
        path=path,
        pacing=pacing_for(window, transmitter) if closed_loop else Pacing.WINDOW,
        clock_percent=clock_percent,
    )


def run_link(
    program: bytes,
    baud: int,
    path: PathKind | None,
    *,
    blocks_per_second: float | None = None,
    clock_percent: float = 0.0,
    closed_loop: bool = True,
    seed: int = 1,
    cnc: Mapping[str, str] | None = None,
) -> Run:
    """Send `program` by DNC LINK; `closed_loop` where the path can."""
    entry = protocol("bridgeport")
    host = entry.host(entry.params({"lrc": "xor7_etb"}, End.HOST))
    words = {"mode": "D", "hold": "xoff", "program": "1234", "buffer": "600", **(cnc or {})}
    control = entry.cnc(entry.params(words, End.CONTROL))
    settings = settings_of(baud, host.needs_stop_distance, path, clock_percent, closed_loop)
    near, far = simulated_cable(baud, settings, EndSettings(window=2, fifo=2), bits=BITS)
    stated = near.stop_distance
    bench = _Bench(near, round(character_time(baud, BITS) / (1 + clock_percent / 100)))
    taken = BytesIO()
    operator = Control(control, taken, eob=b"\r\n", blocks_per_second=blocks_per_second)
    host_link = LateLink(Link(host, near, on_event=bench.on_host), Lateness(derive(seed, "host")))
    host.start(BytesIO(program), 0)
    control.cycle_start(0)
    now = bench.run(host_link, Link(control, far, application=operator, on_event=bench.on_cnc))
    complete = all(end.outcome is Outcome.COMPLETE for end in bench.ends.values())
    return Run(
        whole=complete and taken.getvalue() == program,
        after_stop=tuple(bench.after),
        in_records=bench.watch.busy / (bench.watch.busy + bench.watch.gaps),
        wakes=host_link.steps,
        seconds=now / SECOND,
        stated=stated,
    )
