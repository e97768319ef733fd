"""`tapewire simulate`"""

from __future__ import annotations

import json
import multiprocessing
import re
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, Final

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tapewire.cli.common import COMPLETE, INTERRUPTED, NOT_COMPLETE
from tapewire.errors import UsageError
from tapewire.line.faults.presets import PRESETS, preset
from tapewire.protocols import PROTOCOLS, protocol
from tapewire.sim.campaign import Case, Report, Totals, cases, names_of, run_case

__all__ = ["simulate"]

NS_PER_HOUR: Final = 3600 * 10**9

AT_ONCE: Final = 8
"""Transfers a worker takes at a time: enough that asking for more costs nothing."""

_SEEDS: Final = re.compile(r"([0-9]{1,18})(?:\.\.([0-9]{1,18}))?")


@click.command()
@click.option("--protocol", "protocols", default="all", show_default=True, metavar="NAME", help="A protocol, or all.")
@click.option("--faults", "presets", default="all", show_default=True, metavar="PRESET", help="A preset, or all.")
@click.option("--seeds", default="1..20", show_default=True, metavar="A..B", help="From seed A to seed B.")
@click.option("--jobs", type=click.IntRange(1, 256), default=1, show_default=True, help="Processors at work.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout.")
@click.option("--transcript", is_flag=True, help="Print what was said, of every transfer.")
def simulate(protocols: str, presets: str, seeds: str, jobs: int, as_json: bool, transcript: bool) -> int:
    """Play faults against both ends of a protocol, in simulated time, and judge every transfer.

    Each seed draws a program, a line, the parameters of both ends and what their operators do. The same seed gives the
    same transfer to the byte. Ctrl-C ends it with what there is so far.
    """
    for name in names_of(protocols, list(PROTOCOLS)):
        protocol(name)
    for name in names_of(presets, list(PRESETS)):
        preset(name)
    first, last = _parse_seeds(seeds)
    count = (last - first + 1) * len(names_of(protocols, list(PROTOCOLS))) * len(names_of(presets, list(PRESETS)))
    totals, began = Totals(), time.monotonic()
    interrupted = False
    try:
        with _bar(count) as advance:
            for report in _reports(cases(protocols, presets, first, last), jobs, transcript):
                totals.add(report)
                _tell(report, as_json)
                advance(totals)
    except KeyboardInterrupt:
        interrupted = True
    outcome = "cancelled" if interrupted else "failed" if totals.failed else "complete"
    seconds = time.monotonic() - began
    _sum_up(totals, seconds, outcome, as_json)
    return INTERRUPTED if interrupted else NOT_COMPLETE if totals.failed else COMPLETE


def _parse_seeds(text: str) -> tuple[int, int]:
    found = _SEEDS.fullmatch(text)
    if found is None:
        raise UsageError(f"--seeds {text}: A..B is expected, two numbers, as in --seeds 1..1000")
    first = int(found[1])
    last = first if found[2] is None else int(found[2])
    if last < first:
        raise UsageError(f"--seeds {text}: the first seed comes first, as in --seeds {last}..{first}")
    return first, last


def _reports(wanted: Iterator[Case], jobs: int, transcript: bool) -> Iterator[Report]:
    """One report a case; with several processors in the order in which they come."""
    if jobs == 1:
        for case in wanted:
            yield run_case(case, transcript=transcript)
        return
    with multiprocessing.get_context("spawn").Pool(jobs, initializer=_leave_ctrl_c) as pool:
        # A pool reads all it is to do at once: a campaign of a million is handed over in portions.
        while portion := list(islice(wanted, jobs * AT_ONCE * 16)):
            yield from pool.imap_unordered(_worker, [(case, transcript) for case in portion], chunksize=AT_ONCE)


def _worker(task: tuple[Case, bool]) -> Report:
    return run_case(task[0], transcript=task[1])


def _leave_ctrl_c() -> None:
    """Ctrl-C is for the one who gathers; a worker that heard it too would leave a trace of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _tell(report: Report, as_json: bool) -> None:
    violations = report.violations
    if as_json:
        if violations:
            _line("failure", **_failure(report))
        elif report.transcript:
            _line("transcript", command=report.case.command, transcript=report.transcript)
        return
    if report.transcript:
        click.echo(report.transcript)
        for finding in report.findings:
            verdict = f"undetectable: {finding.undetectable}" if finding.undetectable else "VIOLATION"
            click.echo(f"{verdict}: {finding.rule}: {finding.what}")
    elif violations:
        click.echo(f"FAILED {report.case.command}", err=True)
        for finding in violations:
            click.echo(f"       {finding.rule}: {finding.what.splitlines()[0]}", err=True)


def _failure(report: Report) -> dict[str, Any]:
    rules = [{"rule": finding.rule, "what": finding.what} for finding in report.violations]
    return {"command": report.case.command, "violations": rules, "transcript": report.transcript}


def _sum_up(totals: Totals, seconds: float, outcome: str, as_json: bool) -> None:
    hours = totals.simulated / NS_PER_HOUR
    if as_json:
        _line(
            "end",
            outcome=outcome,
            transfers=totals.transfers,
            failed=totals.failed,
            program_bytes=totals.program_bytes,
            simulated_hours=round(hours, 3),
            seconds=round(seconds, 3),
            outcomes=dict(totals.outcomes),
            faults=dict(totals.faults),
            undetectable={f"{name}: {what}": count for (name, what), count in sorted(totals.undetectable.items())},
            violations=dict(totals.violations),
        )
        return
    rate = totals.transfers / seconds if seconds else 0.0
    say = click.echo
    say(f"{totals.transfers:,} transfers of {totals.program_bytes:,} program bytes, {hours:,.1f} simulated hours")
    say(f"in {seconds:,.1f} s: {rate:,.1f} transfers and {hours / max(seconds, 1e-9):.2f} simulated hours a second")
    _counted("Outcomes", totals.outcomes.items())
    _counted("Faults and acts", totals.faults.items())
    _counted(
        "Undetectable by the protocol's own rules", ((f"{a}: {b}", n) for (a, b), n in totals.undetectable.items())
    )
    _counted("Violations", totals.violations.items())
    for report in totals.failures:
        say(report.case.command)
    say(f"{totals.failed} of {totals.transfers:,} transfers broke a rule" if totals.failed else "No violation.")


def _counted(title: str, counts: Iterable[tuple[str, int]]) -> None:
    rows = sorted(counts, key=lambda row: (-row[1], row[0]))
    if rows:
        click.echo(f"\n{title}")
        for name, count in rows:
            click.echo(f"  {count:>9,}  {name}")


def _line(event: str, **fields: object) -> None:
    click.echo(json.dumps({"event": event, "time_ns": time.time_ns(), **fields}))


@contextmanager
def _bar(count: int) -> Iterator[Any]:
    """A bar on a terminal; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda totals: None
        return
    columns = (
        TextColumn("{task.fields[state]}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), redirect_stdout=False) as progress:
        task = progress.add_task("", total=count, state="no violation")

        def advance(totals: Totals) -> None:
            state = f"[red]{totals.failed} broke a rule[/]" if totals.failed else "[green]no violation[/]"
            progress.update(task, completed=totals.transfers, state=state)

        yield advance
