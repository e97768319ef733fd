"""`tapewire bridgeport`"""

from __future__ import annotations

import asyncio
from pathlib import Path

import click

from tapewire.cli.common import capture_of, line_options_of_one_protocol, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.protocols.settings import End
from tapewire.transfer.learning import ProfileFile, learn_profile
from tapewire.transfer.reports import Result
from tapewire.transfer.session import settings_for

__all__ = ["bridgeport"]


@click.group()
def bridgeport() -> None:
    """What only Bridgeport REMOTE LOAD and DNC LINK need."""


@bridgeport.command()
@click.argument("file", type=click.Path(path_type=Path))
@line_options_of_one_protocol
@click.option("--control", default="a control without a name", help="The control's name, for the title of the profile.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def learn(
    file: Path,
    line: str,
    baud: int | None,
    stopbits: int | None,
    words: tuple[str, ...],
    timeout: float | None,
    profile: Path | None,
    capture: Path | None,
    capture_size: int,
    as_json: bool,
    control: str,
    force: bool,
) -> int:
    """Find out at a real control what it says, step by step with a person there, and store it in FILE as a profile.

    Drives off or axes locked. It sends programs that move nothing. Each step waits five minutes for the control. The
    profile needs no other --set.
    """
    settings = settings_of(words, profile, "bridgeport", End.HOST)
    job = settings_for(
        End.HOST,
        line,
        "bridgeport",
        baud=baud,
        stopbits=stopbits,
        settings=settings,
        timeout_s=timeout,
        capture=capture_of(capture, capture_size),
    )
    place = ProfileFile(file, f"Seen at {control}", force=force)

    async def transfer(output: Output, stop: asyncio.Event) -> Result:
        return await learn_profile(place, job.observed_by(output.observe, stop), settings)

    return run_job(file.name, "of the profile stored", as_json, transfer)
