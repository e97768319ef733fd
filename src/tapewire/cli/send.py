"""`tapewire send`"""

from __future__ import annotations

import asyncio
from contextlib import closing

import click

from tapewire.cli.common import line_options, parse_words, run_job
from tapewire.cli.output import Output
from tapewire.protocols.settings import End
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result
from tapewire.transfer.sending import send_program
from tapewire.transfer.session import settings_for

__all__ = ["send"]


@click.command()
@click.argument("file", type=click.Path(readable=False))
@line_options
@click.option("--raw", is_flag=True, help="Send the file's bytes untouched.")
def send(
    file: str,
    line: str,
    protocol: str,
    baud: int | None,
    stopbits: str,
    words: tuple[str, ...],
    timeout: float | None,
    as_json: bool,
    raw: bool,
) -> int:
    """Give the program in FILE to one control, when it asks for it, and exit when the control has it."""
    settings = parse_words(words)
    job = settings_for(
        End.HOST, line, protocol, baud=baud, stopbits=int(stopbits), settings=settings, timeout_s=timeout
    )
    program = Program.from_file(file, job.protocol.data_code(job.params), raw=raw)

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        return await send_program(program, job.observed_by(output.observe, stop))

    with closing(program):
        return run_job(program.name, "received by the control, not necessarily executed", as_json, transfer)
