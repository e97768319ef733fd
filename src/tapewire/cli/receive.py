"""`tapewire receive`"""

from __future__ import annotations

import asyncio
from pathlib import Path

import click

from tapewire.cli.common import line_options, parse_words, run_job
from tapewire.cli.output import Output
from tapewire.protocols.settings import End
from tapewire.transfer.receiving import receive_program
from tapewire.transfer.reports import Result
from tapewire.transfer.session import settings_for

__all__ = ["receive"]


@click.command()
@click.argument("file", type=click.Path(readable=False, path_type=Path))
@line_options
@click.option("--raw", is_flag=True, help="Store the bytes as they came.")
@click.option("--force", is_flag=True, help="Replace FILE if it exists.")
def receive(
    file: Path,
    line: str,
    protocol: str,
    baud: int | None,
    stopbits: str,
    words: tuple[str, ...],
    timeout: float | None,
    as_json: bool,
    raw: bool,
    force: bool,
) -> int:
    """Take the next program one control punches out, store it in FILE, and exit."""
    settings = parse_words(words)
    job = settings_for(
        End.HOST, line, protocol, baud=baud, stopbits=int(stopbits), settings=settings, timeout_s=timeout
    )

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        return await receive_program(file, job.observed_by(output.observe, stop), raw=raw, force=force)

    return run_job(file.name, "stored", as_json, transfer)
