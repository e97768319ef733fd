"""`tapewire receive`"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import click

from tapewire.cli.common import capture_of, caution, line_options, run_job, settings_of, when_lost_option
from tapewire.cli.output import Output
from tapewire.errors import UsageError
from tapewire.protocols.settings import End
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.numbered import numbered_host
from tapewire.transfer.receiving import receive_by_number, receive_program
from tapewire.transfer.reopening import WhenLost
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["receive"]


@click.command()
@click.argument("file", type=click.Path(readable=False, path_type=Path), required=False)
@line_options
@click.option(
    "--program-dir",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="bridgeport, instead of FILE: store it here by the number the control sends it under.",
)
@when_lost_option
@click.option("--raw", is_flag=True, help="Store the bytes as they came.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def receive(
    file: Path | None,
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
    program_dir: Path | None,
    when_lost: str,
    raw: bool,
    force: bool,
) -> int:
    """Take the next program one control punches out, store it in FILE, and exit."""
    settings = settings_of(words, profile, protocol, End.HOST)
    job = settings_for(
        End.HOST,
        line,
        protocol,
        baud=baud,
        stopbits=stopbits,
        settings=settings,
        timeout_s=timeout,
        capture=capture_of(capture, capture_size),
    )
    job = replace(job, when_lost=WhenLost(when_lost))
    if program_dir is not None:
        return _by_number(file, program_dir, job, profile, as_json, raw, force)
    if file is None:
        raise UsageError("name the FILE to store in, or for bridgeport the --program-dir to store in by number")

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        caution(output, job, profile)
        return await receive_program(file, job.observed_by(output.observe, stop), raw=raw, force=force)

    return run_job(file.name, "stored", as_json, transfer)


def _by_number(
    file: Path | None, program_dir: Path, job: JobSettings, profile: Path | None, as_json: bool, raw: bool, force: bool
) -> int:
    if file is not None:
        raise UsageError(f"{file} and --program-dir: name one file, or the folder to store in")
    numbered_host(job)
    folder = ProgramFolder(program_dir)

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        caution(output, job, profile)
        return await receive_by_number(folder, job.observed_by(output.observe, stop), raw=raw, force=force)

    return run_job(str(program_dir), "stored", as_json, transfer)
