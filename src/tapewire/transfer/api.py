"""Feeding, receiving and simulating in one call each: the library's front door.

All three take the line as LINE (a tty path, socket://HOST:PORT, listen://HOST:PORT, pty:PATH), the protocol by its
name, and the protocol's settings as the words of `--set`. They return a Result however the job ends, and raise
UsageError before anything is opened, LineError when the line cannot be. Set `stop` to give a job up in an orderly way.
All that is said on the line goes on record in `capture`, where one is named.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tapewire.line.captures.file import CaptureSettings
from tapewire.protocols.settings import End
from tapewire.transfer import control, receiving, sending
from tapewire.transfer.control import ControlTask
from tapewire.transfer.program import Program
from tapewire.transfer.reopening import WhenLost
from tapewire.transfer.reports import Observer, Result, nothing
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["receive", "run_control", "send"]


async def send(
    file: str | Path,
    *,
    line: str,
    protocol: str,
    baud: int | None = None,
    stopbits: int | None = None,
    settings: Mapping[str, str] | None = None,
    raw: bool = False,
    timeout_s: float | None = None,
    capture: str | Path | None = None,
    observer: Observer = nothing,
    stop: asyncio.Event | None = None,
) -> Result:
    """Give the program in `file` to one control when it asks for it; `raw` sends its bytes untouched."""
    job = _job(End.HOST, line, protocol, baud, stopbits, settings, timeout_s, capture, observer, stop)
    program = Program.from_file(file, job.protocol.text(job.params), raw=raw)
    try:
        return await sending.send_program(program, job)
    finally:
        program.close()


async def receive(
    file: str | Path,
    *,
    line: str,
    protocol: str,
    baud: int | None = None,
    stopbits: int | None = None,
    settings: Mapping[str, str] | None = None,
    raw: bool = False,
    force: bool = False,
    timeout_s: float | None = None,
    capture: str | Path | None = None,
    observer: Observer = nothing,
    stop: asyncio.Event | None = None,
    when_lost: WhenLost = WhenLost.END,
) -> Result:
    """Store what one control punches out next in `file`; `force` replaces an existing one.

    With WAIT a line that is lost before the punch-out begins is opened again when it is back.
    """
    job = _job(End.HOST, line, protocol, baud, stopbits, settings, timeout_s, capture, observer, stop)
    return await receiving.receive_program(Path(file), replace(job, when_lost=when_lost), raw=raw, force=force)


async def run_control(
    task: ControlTask | None = None,
    *,
    line: str,
    protocol: str,
    baud: int | None = None,
    stopbits: int | None = None,
    settings: Mapping[str, str] | None = None,
    timeout_s: float | None = None,
    capture: str | Path | None = None,
    observer: Observer = nothing,
    stop: asyncio.Event | None = None,
) -> Result:
    """Be a simulated control for one operation; without a `task` it executes a program as it comes in."""
    job = _job(End.CONTROL, line, protocol, baud, stopbits, settings, timeout_s, capture, observer, stop)
    return await control.run_control(task or ControlTask(), job)


def _job(
    end: End,
    line: str,
    protocol: str,
    baud: int | None,
    stopbits: int | None,
    settings: Mapping[str, str] | None,
    timeout_s: float | None,
    capture: str | Path | None,
    observer: Observer,
    stop: asyncio.Event | None,
) -> JobSettings:
    job = settings_for(
        end,
        line,
        protocol,
        baud=baud,
        stopbits=stopbits,
        settings=settings or {},
        timeout_s=timeout_s,
        capture=None if capture is None else CaptureSettings(path=Path(capture)),
    )
    return job.observed_by(observer, stop or asyncio.Event())
