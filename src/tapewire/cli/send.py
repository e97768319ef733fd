"""`tapewire send`"""

from __future__ import annotations

import asyncio
from contextlib import closing
from pathlib import Path
from typing import Final

import click

from tapewire.cli.common import capture_of, caution, line_options, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.errors import UsageError
from tapewire.protocols.settings import End
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.numbered import numbered_host
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result
from tapewire.transfer.sending import send_by_number, send_program
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["send"]

COUNTED: Final = "received by the control, not necessarily executed"


@click.command()
@click.argument("file", type=click.Path(readable=False), required=False)
@line_options
@click.option(
    "--program-dir",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="bridgeport, instead of FILE: send the program whose number is asked for; O1234.nc is 1234.",
)
@click.option("--raw", is_flag=True, help="Send the file's bytes untouched.")
def send(
    file: str | None,
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
    raw: bool,
) -> int:
    """Give the program in FILE to one control, when it asks for it, and exit when the control has it."""
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
    if program_dir is not None:
        return _by_number(file, program_dir, job, profile, as_json, raw)
    if file is None:
        raise UsageError("name the FILE to send, or for bridgeport the --program-dir to choose from by number")
    program = Program.from_file(file, job.protocol.text(job.params), raw=raw)

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        caution(output, job, profile)
        return await send_program(program, job.observed_by(output.observe, stop))

    with closing(program):
        return run_job(program.name, COUNTED, as_json, transfer)


def _by_number(
    file: str | None, program_dir: Path, job: JobSettings, profile: Path | None, as_json: bool, raw: bool
) -> int:
    if file is not None:
        raise UsageError(f"{file} and --program-dir: name one program, or the folder to choose from")
    numbered_host(job)
    folder = ProgramFolder(program_dir)

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        caution(output, job, profile)
        return await send_by_number(folder, job.observed_by(output.observe, stop), raw=raw)

    return run_job(str(program_dir), COUNTED, as_json, transfer)
