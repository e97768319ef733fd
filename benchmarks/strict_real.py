"""Lines for controls that tolerate three characters, in real time: how full they are and what that costs.

Bound: the wire. With at most two characters in flight the next must follow within a character time of 1.1 ms, so the
computer's own lateness is what is measured. Real-time priority (chrt) where this user may have it, and said which.
"""

from __future__ import annotations

import asyncio
import os
import resource
import tempfile
from pathlib import Path
from statistics import median
from typing import Final

from benchmarks.ends import LINES, control_line, first_event, other_line, program_of, tapewire
from benchmarks.report import spread, table, write_section
from tapewire.engine import SECOND
from tapewire.line.descriptor import LineSettings
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.link import Link
from tests.line.fake_uart import bench
from tests.line.helpers import Clock, ListeningEngine

RUNS: Final = 5
SIZE: Final = 3000
HOW: Final = LineSettings(baud=9600, stopbits=2, window=2)
WORDS: Final = ("--protocol", "bridgeport", "--baud", "9600")


class RealClock(Clock):
    """The moment it is."""

    @property
    def now(self) -> int:
        return monotonic()

    @now.setter
    def now(self, value: int) -> None:
        del value


def send_by_link(kind: str, operation: str) -> float:
    """Share of the line that one program used, the waiting for the control not counted."""
    with control_line(kind) as (line, path), tempfile.TemporaryDirectory() as folder:
        program = program_of(SIZE, folder)
        program.write_bytes(program.read_bytes().replace(b"%", b"").strip() + b"\n")
        cnc = tapewire("cnc", "--line", line, *WORDS, "--program", "1234", "--operation", operation)
        ready = first_event(cnc, "ready")
        host = tapewire("send", str(program), "--line", other_line(kind, ready, path), *WORDS)
        end = first_event(host, "end")
        host.wait()
        cnc.wait()
    assert end["outcome"] == "complete", end
    return float(end["utilisation"])


def closed_loop() -> tuple[float, float, float]:
    """(share of the line, share of one processor, median gap in µs) of a played UART at exactly its rate."""
    with bench(Path("/nonexistent"), HOW.character) as port:
        port.uart.clock = RealClock()
        port.uart.lines = 0x20
        line = port.open(HOW)
        write = line.write

        def written(data: bytes, now: int) -> None:
            write(data, now)
            port.uart.run()

        line.write = written  # type: ignore[method-assign]
        engine = ListeningEngine(bytes(SIZE))
        began, used = monotonic(), resource.getrusage(resource.RUSAGE_SELF)
        asyncio.run(LineDriver(Link(engine, line)).run(lambda: engine.left >= SIZE))
        took, after = monotonic() - began, resource.getrusage(resource.RUSAGE_SELF)
        line.close(0)
    cpu = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    ends = [at for at, _ in port.uart.left]
    gaps = [(second - first - HOW.character) / 1000 for first, second in zip(ends[1::2], ends[2::2], strict=False)]
    return SIZE * HOW.character / took, cpu * SECOND / took, median(gaps)


def with_priority() -> bool:
    """This process and its children run before all others from now on, if that may be."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except OSError:
        return False
    return True


def main() -> None:
    first = with_priority()
    rows = []
    for kind in LINES:
        for name, operation in (("DNC LINK", "dnc"), ("REMOTE LOAD", "read")):
            shares = [send_by_link(kind, operation) * 100 for _ in range(RUNS)]
            rows.append([name, kind, spread(shares, ".1f"), "", ""])
            print(rows[-1], flush=True)
    runs = [closed_loop() for _ in range(RUNS)]
    shares, cpu, gaps = ([run[at] for run in runs] for at in range(3))
    rows.append(
        [
            "closed loop",
            "played UART",
            spread([share * 100 for share in shares], ".1f"),
            spread([share * 100 for share in cpu], ".0f"),
            spread(gaps, ".0f"),
        ]
    )
    priority = "with real-time priority" if first else "without real-time priority"
    text = (
        f"9600 baud, two characters in flight at most, {SIZE:,} bytes, median (minimum to maximum) of {RUNS} runs"
        f" {priority}. DNC LINK and REMOTE LOAD: two processes. The closed loop asks a UART that a test plays, so the"
        " cost of the questions is that of the loop and not of a driver.\n\n"
    )
    head = ["what", "line", "share of the line, %", "share of one processor, %", "median gap between chunks, µs"]
    write_section("strict-lines", "Strict lines in real time", text + table(head, rows))


if __name__ == "__main__":
    main()
