"""Many lines saturated at once in one process: how full they are, and what that costs.

Bound: the wires. The far ends are written in C (`many_lines_peer.c`): they read at exactly the rate of a line, compare
every byte and note the longest gap. Only the feeding process is counted. Beside it the same work by pyserial with a
thread a port, and by one `cat` a port, which leaves everything to the kernel.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

from benchmarks.report import spread, table, write_section

BAUD: Final = 86400
BITS: Final = 11
SECONDS: Final = 8.0
RUNS: Final = 3
MOST_RUNS: Final = 6
QUIET: Final = 0.01
"""What is stolen from a virtual machine stops all lines at once for up to a tenth of a second: with more than this a
run says nothing of the program that ran, and another is made."""

PEER: Final = Path(__file__).with_name("many_lines_peer.c")
CASES: Final = (
    ("tapewire", 256),
    ("tapewire", 200),
    ("pyserial", 200),
    ("cat", 200),
    ("cat", 256),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of one way."""

    share: float
    """Bytes times character time over the time from the first character to the last, the worst line of all."""
    share_of_all: float
    """The same of all lines together."""
    gap_ms: float
    """The longest time without a character on any line."""
    cpu_s_per_mb: float
    cores: float
    """Processor seconds for each second of the longest line."""
    memory: float
    """Bytes a line, beyond what the process needs for none."""
    stolen: float
    """Share of the processors that went to other guests of the computer this one is a guest of."""


def compiled(folder: Path) -> Path:
    peer = folder / "peer"
    subprocess.run(["cc", "-O2", "-Wall", "-o", str(peer), str(PEER), "-lutil"], check=True)
    return peer


def program_of(folder: Path, seconds: float) -> Path:
    """Blocks that fill a line for so long, as they go out: no two lines of it are alike."""
    size = int(seconds * BAUD / BITS)
    blocks = "".join(f"N{number}G01X{number % 977}.{number % 10}Y-{number % 89}.25\n" for number in range(size // 20))
    path = folder / "program.nc"
    path.write_text("%\nO0001(MANY LINES)\n" + blocks[: blocks.rfind("\n", 0, size) + 1] + "M30\n%")
    return path


@contextmanager
def peers(peer: Path, lines: int, program: Path, talks: bool) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    process = subprocess.Popen(
        [str(peer), str(lines), str(BAUD), str(program), str(int(talks))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        yield process, [name.strip() for name in iter(process.stdout.readline, "ready\n")]
    finally:
        process.kill()
        process.wait()


def feed_by_worker(way: str, names: list[str], program: Path, far: subprocess.Popen[str]) -> dict[str, Any]:
    words = [sys.executable, "-m", "benchmarks.many_lines_worker", way, str(program), str(BAUD)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        worker.stdin.write("".join(f"{name}\n" for name in names) + "\n")
        worker.stdin.flush()
        assert worker.stdout.readline() == "ready\n"
        begin(far)
        told: dict[str, Any] = json.loads(worker.stdout.readline())
    assert told["outcomes"] == {"complete": len(names)}, told
    return told


def feed_by_cat(names: list[str], program: Path, far: subprocess.Popen[str]) -> dict[str, Any]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin(far)
    cats = []
    for name in names:
        port = os.open(name, os.O_WRONLY | os.O_NOCTTY)
        cats.append(subprocess.Popen(["cat", str(program)], stdout=port))
        os.close(port)
    for cat in cats:
        cat.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu_s": used, "memory": 0.0}


def begin(far: subprocess.Popen[str]) -> None:
    assert far.stdin is not None
    far.stdin.write("\n")
    far.stdin.flush()


def stolen_s() -> float:
    """Processor seconds that the hypervisor gave to others, since the start of this system."""
    return int(Path("/proc/stat").read_text().split("\n", 1)[0].split()[8]) / os.sysconf("SC_CLK_TCK")


def run(way: str, lines: int, peer: Path, program: Path) -> Run:
    stolen, began = stolen_s(), time.monotonic()
    with peers(peer, lines, program, way != "cat") as (far, names):
        used = feed_by_cat(names, program, far) if way == "cat" else feed_by_worker(way, names, program, far)
        assert far.stdout is not None
        rows = [[int(word) for word in line.split()] for line in far.stdout]
    size = program.stat().st_size
    assert [row[:2] for row in rows] == [[size, 0]] * lines, "not every byte arrived as it was sent"
    return Run(
        share=min(busy / took for _, _, _, busy, took in rows),
        share_of_all=sum(row[3] for row in rows) / sum(row[4] for row in rows),
        gap_ms=max(row[2] for row in rows) / 1e6,
        cpu_s_per_mb=used["cpu_s"] / (size * lines / 1e6),
        cores=used["cpu_s"] / (max(row[4] for row in rows) / 1e9),
        memory=used["memory"],
        stolen=(stolen_s() - stolen) / (time.monotonic() - began) / (os.cpu_count() or 1),
    )


def quiet_runs(way: str, lines: int, peer: Path, program: Path, wanted: int) -> tuple[list[Run], int]:
    """So many runs from which little was stolen, or those with the least; and how many were made."""
    runs: list[Run] = []
    while len(runs) < MOST_RUNS and sum(run.stolen <= QUIET for run in runs) < wanted:
        runs.append(run(way, lines, peer, program))
        print(way, lines, runs[-1], flush=True)
    return sorted(runs, key=lambda run: run.stolen)[:wanted], len(runs)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--only", help="one way, as in tapewire:256; nothing is written")
    arguments.add_argument("--seconds", type=float, default=SECONDS)
    arguments.add_argument("--runs", type=int, default=RUNS)
    asked = arguments.parse_args()
    cases = [(asked.only.split(":")[0], int(asked.only.split(":")[1]))] if asked.only else CASES
    found: dict[tuple[str, int], list[Run]] = {}
    made = 0
    with tempfile.TemporaryDirectory() as folder:
        peer, program = compiled(Path(folder)), program_of(Path(folder), asked.seconds)
        for way, lines in cases:
            found[way, lines], count = quiet_runs(way, lines, peer, program, asked.runs)
            made += count
    if not asked.only:
        first = os.sched_getscheduler(0) != os.SCHED_OTHER
        priority = "with real-time priority (`chrt -f 10`)" if first else "without real-time priority"
        write_section("many-lines", "Many lines at once", text_of(found, made, asked.seconds, priority))


ABOUT: Final = """\
Every line at {baud} baud for {seconds:g} s at once, from one process, protocol expansion B: each with its own job,
engine, driver and line, as `tapewire send` has them. The far ends are pseudo terminals of a program in C that reads
each at exactly the rate of a line, asks with DC1, compares every byte, notes the longest time without a character, and
says DC3 at the end; its buffers never fill, so that nothing but the feeding leaves a wire idle. It looks once a
millisecond, and a gap is that exact. Only the feeding process is counted (getrusage), from the first DC1 to the end of
all jobs. Median (minimum to maximum) of {runs} runs {priority}, beside other work on
the same two cores; every run byte-identical on every line. This computer is a guest on another, which at times takes
it off its processors for a tenth of a second or more, and so leaves all wires idle at once: of {made} runs those are
shown from which least was stolen, {stolen} of the time.

pyserial: a thread a port, the same window, what came in looked at before each quarter of a window is written; above
204 ports, five descriptors each, its `select()` fails. `cat`: a process a port, everything left to the kernel, which
takes some thousand characters at once: it could not stop for a control, and is here as the floor.

"""


def text_of(found: dict[tuple[str, int], list[Run]], made: int, seconds: float, priority: str) -> str:
    rows = [
        [
            f"{way}, {lines} lines",
            spread([run.share_of_all * 100 for run in runs], ".2f"),
            spread([run.share * 100 for run in runs], ".2f"),
            spread([run.gap_ms for run in runs], ".1f"),
            spread([run.cpu_s_per_mb for run in runs], ".3f"),
            spread([run.cores for run in runs], ".2f"),
            f"{median(run.memory for run in runs) / 1000:.0f}" if way != "cat" else "a process",
        ]
        for (way, lines), runs in found.items()
    ]
    head = ["who feeds", "all lines, %", "worst line, %", "longest gap, ms", "CPU s per MB", "cores", "kB a line"]
    ours, theirs = (median(run.cpu_s_per_mb for run in found[way, 200]) for way in ("tapewire", "pyserial"))
    goals = (
        f"At 200 lines that is {ours / theirs:.2f} of pyserial's processor time for the same bytes (goal: at most a"
        f" third). 256 lines use {median(run.cores for run in found['tapewire', 256]):.2f} cores (goal: 99 % of every"
        " line within two). Every figure is of pseudo terminals: a real port costs two questions to its driver more at"
        " each refill, and has its own interrupts."
    )
    runs = len(found["tapewire", 256])
    stolen = spread([run.stolen * 100 for each in found.values() for run in each], ".1f") + " %"
    about = ABOUT.format(baud=BAUD, seconds=seconds, runs=runs, priority=priority, made=made, stolen=stolen)
    return about + table(head, rows) + "\n\n" + goals


if __name__ == "__main__":
    main()
