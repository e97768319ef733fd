"""Sixteen lines in real time: pulled out and plugged in, servers restarted, characters damaged. What leaks, what lies.

`python -m benchmarks.soak --minutes 60` writes its result into docs/reliability.md. All jobs of all lines run in one
process, by the calls that the commands use; its memory and its descriptors are what is watched. Whatever a control
stored is compared with what was sent to it. Needs Debian's ser2net.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import os
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

from benchmarks.report import PAGE, table, write_section
from benchmarks.soak_ends import Far, MarkedPort
from benchmarks.soak_far import descriptors, memory_bytes
from benchmarks.soak_lines import (
    CommandLine,
    Line,
    MarkedLine,
    PluggedLine,
    Rfc2217CommandLine,
    Rfc2217ServerLine,
    ServerLine,
    Tally,
)
from tapewire.line import open as opening
from tapewire.line.descriptor import LineSettings
from tapewire.line.ports.serial_port import TtyLine, open_tty

RELIABILITY: Final = PAGE.parent / "reliability.md"
LOOK_S: Final = 1.0
WINDOW: Final = 30
"""Looks at memory and descriptors that make one figure: jobs come and go meanwhile."""

SETTLED_S: Final = 300.0
"""From when on memory is expected to stay as it is."""

LAST_JOBS_S: Final = 200.0
"""The jobs under way at the end get so long to end by themselves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """The process at one moment."""

    at_s: float
    memory: int
    descriptors: int
    blocks: int
    """What Python itself has allocated and not given back: a leak shows here first, and fragments of memory do not."""


def lines_of(folder: Path, tally: Tally, far: Far) -> list[Line]:
    """The sixteen."""
    made: list[Line] = []
    marked, plugged, raw, by_2217 = MarkedLine, PluggedLine, ServerLine, Rfc2217ServerLine
    wanted = (
        (marked, "fanuc-b", 9600), (marked, "fanuc-b-expansion", 19200), (marked, "fanuc-a", 9600),
        (marked, "bridgeport", 9600), (plugged, "fanuc-b", 19200), (plugged, "fanuc-b-expansion", 9600),
        (plugged, "fanuc-a-expansion", 19200), (plugged, "bridgeport", 9600), (raw, "fanuc-b", 19200),
        (raw, "fanuc-a", 9600), (raw, "bridgeport", 9600), (by_2217, "fanuc-b", 9600), (by_2217, "fanuc-a", 19200),
        (by_2217, "fanuc-b-expansion", 9600),
    )  # fmt: skip
    for kind, name, baud in wanted:
        made.append(kind(len(made) + 1, folder, name, baud, tally, far))
    made.append(CommandLine(len(made) + 1, folder, "fanuc-a", 19200, tally))
    made.append(Rfc2217CommandLine(len(made) + 1, folder, "fanuc-b", 9600, tally))
    return made


def playing(ports: set[str]) -> Any:
    """Open these paths as if they were serial ports with a driver."""

    def open_as(path: str, settings: LineSettings, **how: Any) -> TtyLine:
        return open_tty(path, settings, kernel=MarkedPort() if path in ports else None, **how)

    return patch.object(opening, "open_tty", open_as)


async def watch(looks: list[Look], began: float) -> None:
    while True:
        now = time.monotonic() - began
        size = {"memory": memory_bytes(), "descriptors": descriptors(), "blocks": sys.getallocatedblocks()}
        looks.append(Look(at_s=now, **size))
        await asyncio.sleep(LOOK_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Soak:
    """What one run left behind."""

    seconds: float
    tally: Tally
    looks: list[Look]
    descriptors_before: int
    descriptors_after: int
    far: dict[str, tuple[int, int]]
    """Memory and descriptors of the controls' process, after five minutes and at the end."""
    cpu_s: float


async def soak(seconds: float, folder: Path) -> Soak:
    """Run all lines for so long."""
    tally, looks, far_looks = Tally(), list[Look](), dict[str, tuple[int, int]]()
    far = await Far.start()
    lines = lines_of(folder, tally, far)
    before, began = descriptors(), time.monotonic()
    watching = asyncio.create_task(watch(looks, began))
    telling = asyncio.create_task(tell(tally, looks, far, far_looks))
    ports = {str(line.device) for line in lines if isinstance(line, MarkedLine)}
    try:
        with playing(ports):
            await asyncio.gather(*(line.open() for line in lines))
            try:
                async with asyncio.timeout(seconds + LAST_JOBS_S), asyncio.TaskGroup() as group:
                    for line in lines:
                        group.create_task(line.run(lambda: time.monotonic() - began >= seconds))
            finally:
                await asyncio.gather(*(line.close() for line in lines))
        await asyncio.sleep(1.0)
        gc.collect()
        after = descriptors()
        far_looks["end"] = await far_size(far)
    finally:
        for task in (watching, telling):
            task.cancel()
        await asyncio.wait([watching, telling])
        await far.close()
    return Soak(
        seconds=seconds,
        tally=tally,
        looks=looks,
        descriptors_before=before,
        descriptors_after=after,
        far=far_looks,
        cpu_s=time.process_time(),
    )


async def far_size(far: Far) -> tuple[int, int]:
    size = await far.ask(do="size", job="size")
    return int(size["memory"]), int(size["descriptors"])


async def tell(tally: Tally, looks: list[Look], far: Far, far_looks: dict[str, tuple[int, int]]) -> None:
    """A line a minute for whoever watches; what is wrong at once."""
    told = 0
    while True:
        await asyncio.sleep(10.0)
        now, jobs, complete = looks[-1], tally.jobs.total(), tally.complete.total()
        if now.at_s >= SETTLED_S and "settled" not in far_looks:
            far_looks["settled"] = await far_size(far)
        bad = [*tally.wrong, *tally.trouble]
        for what in bad[told:]:
            print("LOOK:", what, flush=True)
        told = len(bad)
        print(
            f"{now.at_s:5.0f} s: {jobs} jobs, {complete} complete, {len(tally.wrong)} wrong,"
            f" {now.memory / 1e6:.1f} MB, {now.descriptors} descriptors, {now.blocks:,} blocks",
            flush=True,
        )


def around(looks: list[Look], at_s: float) -> list[Look]:
    """The looks of half a minute from then on, or the last ones."""
    return [look for look in looks if look.at_s >= at_s][:WINDOW] or looks[-WINDOW:]


def report(run: Soak) -> str:
    """The section of the page."""
    tally, minutes = run.tally, run.seconds / 60
    jobs, complete = tally.jobs.total(), tally.complete.total()
    kinds = [[kind, str(count), str(tally.complete[kind])] for kind, count in sorted(tally.jobs.items())]
    ended = [[reason.replace("|", "/"), str(count)] for reason, count in tally.reasons.most_common()]
    settled = min(SETTLED_S, run.seconds / 2)
    early, late = around(run.looks, settled), around(run.looks, run.seconds - WINDOW)
    sizes = [
        [name, f"{min(look.memory for look in looks) / 1e6:.1f} to {max(look.memory for look in looks) / 1e6:.1f}",
         f"{min(look.descriptors for look in looks)} to {max(look.descriptors for look in looks)}",
         f"{min(look.blocks for look in looks):,} to {max(look.blocks for look in looks):,}"]
        for name, looks in ((f"from {settled / 60:.0f} min", early), (f"from {minutes:.0f} min", late))
    ]  # fmt: skip
    far = "; ".join(
        f"{'after five minutes' if name == 'settled' else 'at the end'} {memory / 1e6:.1f} MB and {count} descriptors"
        for name, (memory, count) in run.far.items()
    )
    return "\n".join(
        [
            f"`python -m benchmarks.soak --minutes {minutes:g}`: sixteen lines in real time, {jobs:,} jobs one after"
            f" another in one process at 9600 and 19200 baud, sent and punched out, {tally.bytes:,} bytes stored and"
            f" compared. **{complete:,} jobs complete, {jobs - complete:,} not complete and told so with the reason,"
            f" {len(tally.wrong)} wrong.** Wrong is: called complete by either end and not byte-identical; stored by a"
            " control and no prefix of what was sent; more stored than the host says may have been; or no reason.",
            "",
            *(f"- Wrong: {what}" for what in tally.wrong),
            *(f"- Trouble of the soak itself, job not judged: {what}" for what in tally.trouble),
            "",
            table(["line", "jobs", "complete"], kinds),
            "",
            f"Ports pulled out and controls killed in mid job: {tally.unplugs}, each plugged in or started again."
            f" Serial servers (ser2net) killed in mid job and started again: {tally.restarts}. Parity errors made on"
            f" the way to a control: {tally.to_control}, told by it: {tally.to_control_seen} (a Bridgeport"
            f" control only asks for the record again); on the way to the host:"
            f" {tally.to_host}, seen: {tally.to_host_seen}. Other faults of `tapewire cnc --faults`:"
            f" {tally.other_faults}.",
            "",
            table(["reason", "jobs"], ended),
            "",
            "The process with all sixteen lines, looked at once a second for half a minute:",
            "",
            table(["when", "resident memory, MB", "descriptors", "blocks of Python's own"], sizes),
            "",
            f"Descriptors before the first line was opened: {run.descriptors_before}; after the last was closed:"
            f" {run.descriptors_after}. Processor time: {run.cpu_s:.0f} s. The process with the simulated controls:"
            f" {far}.",
            "",
            "The serial ports are pseudo terminals whose other side marks damage as a driver does; no real UART is in"
            " this. A host stops the job when a line goes and never continues it: the next job is a new one.",
        ]
    )


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--minutes", type=float, default=60.0)
    arguments.add_argument("--print", action="store_true", help="do not write the page")
    asked = arguments.parse_args()
    if shutil.which("ser2net") is None:
        raise SystemExit("the soak needs ser2net (Debian: apt install ser2net)")
    with suppress(OSError):
        os.nice(10)
    with tempfile.TemporaryDirectory() as folder:
        run = asyncio.run(soak(asked.minutes * 60, Path(folder)))
    text = report(run)
    if asked.print:
        print(text)
    else:
        write_section("soak", "Sixteen lines for an hour", text, RELIABILITY)
    raise SystemExit(1 if run.tally.wrong or run.descriptors_after > run.descriptors_before else 0)


if __name__ == "__main__":
    main()
