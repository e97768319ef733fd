"""What still comes after DC3, path by path: a simulated UART, and a computer that wakes as late as was measured.

`python -m benchmarks.stop_distance` writes its table into docs/lines.md. Everything in it is simulated time, so that it
comes out the same on every computer.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.report import PAGE, table, write_section
from benchmarks.strict_line import BITS, Run, program_of, run_link
from tapewire.line.paths import PATHS, PathKind, TransmitterEmpty

LINES = PAGE.parent / "lines.md"
BAUDS = (300, 600, 1200, 2400, 4800, 9600)
SIZE = 12_300
"""Bytes of program: more than the 12,000 that DNC LINK begins at (2.2.1)."""

SEEDS = (1, 2, 3)
SLOW = -2.0
"""Percent: a clock that no check of a rate would refuse."""

ABOUT = """\
Bridgeport by DNC LINK, 7E1, {size:,} bytes, a control that executes at six tenths of the line, so that it says DC3
again and again; at most three characters may come then (3.2). **A simulated UART**, not a real one: what comes after
the control's DC3 has left it is counted by the control. The host's computer wakes late as asyncio's own timers were
measured to (half of the wake-ups 0.57 ms, one of a hundred 1.12 ms, at most 1.9 ms), begins to ask 1.2 ms early, and
asks every 50 µs. {runs} runs each, the most of all. *Stated* is the stop distance that the line gives before a job. The
share of the line is that within records, the wait for ACK not counted.

Where a path cannot be asked its figure holds while the line is as fast as its rate says; two percent slow, arrears
gather in the adapter up to what it holds, and the figure stated is passed. That is what *not guaranteed* means.

"""

HEAD = (
    "path",
    "paced by",
    *(f"{baud} baud" for baud in BAUDS),
    "stated at 9600",
    "at 9600, line 2 % slow",
    "share of the line at 300",
    "at 9600",
)


def ways() -> Iterator[tuple[PathKind, bool]]:
    """Each path, in a closed loop first where it can be."""
    for path in PATHS.values():
        if path.transmitter_empty is TransmitterEmpty.ASKED:
            yield path, True
        yield path, False


def runs_of(path: PathKind, baud: int, closed_loop: bool, clock_percent: float = 0.0) -> list[Run]:
    program, speed = program_of(SIZE), baud / BITS / 22 * 0.6
    runs = [
        run_link(
            program,
            baud,
            path,
            blocks_per_second=speed,
            closed_loop=closed_loop,
            clock_percent=clock_percent,
            seed=seed,
        )
        for seed in SEEDS
    ]
    assert all(run.whole for run in runs), f"{path.name} at {baud} baud: not whole"
    return runs


def most_after(runs: list[Run]) -> str:
    return str(max(max(run.after_stop) for run in runs))


def row(path: PathKind, closed_loop: bool) -> list[str]:
    runs = {baud: runs_of(path, baud, closed_loop) for baud in BAUDS}
    stated = runs[9600][0].stated
    shares = [min(run.in_records for run in runs[baud]) for baud in (300, 9600)]
    # Over a poll or a network, handing over does not show when the wire is busy.
    known = not (path.poll or path.latency)
    return [
        f"`{path.name}`",
        "closed loop" if closed_loop else "window",
        *(most_after(runs[baud]) for baud in BAUDS),
        f"{stated.characters}, {'guaranteed' if stated.guaranteed else 'not guaranteed'}",
        most_after(runs_of(path, 9600, closed_loop, SLOW)),
        *(f"{share:.1%}" if known else "" for share in shares),
    ]


def main() -> None:
    rows = []
    for path, closed_loop in ways():
        rows.append(row(path, closed_loop))
        print(rows[-1], flush=True)
    text = ABOUT.format(size=SIZE, runs=len(SEEDS)) + table(HEAD, rows)
    write_section("stop-distance", "Stop distance by path", text, LINES)


if __name__ == "__main__":
    main()
