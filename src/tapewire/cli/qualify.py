"""`tapewire qualify`"""

from __future__ import annotations

import asyncio
from contextlib import closing, nullcontext
from pathlib import Path

import click

from tapewire.cli.common import Number, capture_of, line_options, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.errors import UsageError
from tapewire.protocols.settings import End
from tapewire.transfer.program import Program
from tapewire.transfer.qualifying import Plan, qualify_line
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["qualify"]


@click.command()
@line_options
@click.option("--loop-back", is_flag=True, help="There is a loop-back plug on the line: send a pattern, and stop it.")
@click.option(
    "--listen",
    type=Number(min=0, min_open=True),
    metavar="SECONDS",
    help="The control talks: try rates and framings, so long each, and say which one makes sense.",
)
@click.option(
    "--send", type=click.Path(readable=False), metavar="FILE", help="Give this program as a job, and judge it."
)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the findings to FILE as JSON, and beside it as a page to print.",
)
@click.option("--force", is_flag=True, help="Replace a report that exists.")
def qualify(
    line: str,
    protocol: str,
    baud: int | None,
    stopbits: int | None,
    words: tuple[str, ...],
    timeout: float | None,
    profile: Path | None,
    capture: Path | None,
    capture_size: int,
    as_json: bool,
    loop_back: bool,
    listen: float | None,
    send: str | None,
    report: Path | None,
    force: bool,
) -> int:
    """Judge LINE before the first cut: cable, stop distance, damage, rate. Complete means: nothing speaks against it.

    Nothing is sent without --loop-back or --send. The control lines are switched off and on: no control may be
    executing a program.
    """
    job = settings_for(
        End.HOST,
        line,
        protocol,
        baud=baud,
        stopbits=stopbits,
        settings=settings_of(words, profile, protocol, End.HOST),
        timeout_s=timeout,
        capture=capture_of(capture, capture_size),
    )
    _check_report(report, force)
    program = None if send is None else _program(send, job)
    plan = Plan(loop_back=loop_back, program=program, listen_s=listen or 0.0, report=report)

    async def work(output: Output, stop: asyncio.Event) -> Result:
        return await qualify_line(job.observed_by(output.observe, stop), plan)

    with closing(program) if program is not None else nullcontext():
        return run_job(f"qualify {line}", "of program taken by the control", as_json, work)


def _check_report(report: Path | None, force: bool) -> None:
    if report is None:
        return
    if report.suffix != ".json":
        raise UsageError(f"--report {report}: a name that ends in .json is expected; the page gets the same with .html")
    there = [path for path in (report, report.with_suffix(".html")) if path.exists()]
    if there and not force:
        raise UsageError(f"--report: {there[0]} exists; give another name, or --force")


def _program(file: str, job: JobSettings) -> Program:
    return Program.from_file(file, job.protocol.text(job.params))
