"""What the documentation promises an operator to read is what a command prints."""

from __future__ import annotations

import fcntl
import os
import re
import sys
from collections.abc import Awaitable, Callable
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.cli import output
from tapewire.cli.bar import Bar
from tapewire.cli.output import PeopleLines
from tapewire.engine import Held, LineFault, Requested, Resumed
from tapewire.protocols.settings import End
from tapewire.transfer.reports import Progress, Report, Result
from tapewire.transfer.session import settings_for
from tests.cli.helpers import invoke, program
from tests.transfer.peer import DC1, DC3, NAK, SYN, Job, feeding, receiving

QUICKSTART: Final = Path(__file__).parent.parent.parent / "docs" / "quickstart.md"
TEXT: Final = program(400)


def printed(monkeypatch: pytest.MonkeyPatch, *shown: Report | Result) -> str:
    """What people read of these reports, without a terminal."""
    told = StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    monkeypatch.setattr(output, "PLAIN_PROGRESS_S", 0.0)
    lines = PeopleLines("in.nc", "taken")
    for one in shown:
        lines.show(one, 0)
    lines.close()
    monkeypatch.undo()
    return told.getvalue()


async def _fed(folder: Path, said: bytes, **how: Any) -> list[Report | Result]:
    """A transfer in which the control says `said` when it has read a thousand bytes."""
    async with feeding(folder, TEXT, **how) as job:
        job.peer.say(DC1)
        await job.peer.read(1000)
        job.peer.say(said)
        return await _ended(job)


async def _ended(job: Job) -> list[Report | Result]:
    return [*job.reports, await job.result()]


async def _held(folder: Path) -> list[Report | Result]:
    async with feeding(folder, TEXT) as job:
        job.peer.say(DC1)
        await job.peer.read(1000)
        job.peer.say(DC3)
        while not any(report.held for report in job.named(Progress)):
            await job.peer.quiet()
        job.stop.set()
        return await _ended(job)


async def _asked_for_nothing(folder: Path) -> list[Report | Result]:
    async with receiving(folder / "got.nc") as job:
        job.peer.say(DC1)
        while not job.named(Requested):
            await job.peer.quiet()
        job.stop.set()
        return await _ended(job)


async def _damaged(folder: Path) -> list[Report | Result]:
    job = settings_for(End.HOST, "/dev/ttyS0", "fanuc-b", settings={})
    host = job.protocol.host(job.params)
    host.start(BytesIO(TEXT), 0)
    host.receive_data(DC1, 0)
    host.data_sent(len(host.data_to_send(100)), 0)
    host.receive_line_fault(LineFault.PARITY, 0x13, 0)
    events: list[Report | Result] = []
    while (event := host.next_event()) is not None:
        events.append(event)
    return events


SAID: Final[dict[str, Callable[[Path], Awaitable[list[Report | Result]]]]] = {
    "held: DC3": _held,
    "cancelled: the control was reset (SYN)": lambda folder: _fed(folder, SYN),
    "failed: the control has an alarm (NAK)": lambda folder: _fed(folder, NAK),
    "DC3 before the buffer can have filled": lambda folder: _fed(folder, DC3, settings={"posting": "off"}),
    "asked for a program, but none is armed": _asked_for_nothing,
    "it may have been DC3": _damaged,
}

REFUSED: Final = ("is held by another program", "no permission to open")


def test_every_phrase_of_the_quickstart_is_one_of_these() -> None:
    table = QUICKSTART.read_text().partition("## What to do when it says")[2]
    phrases = re.findall(r"^\| `([^`]+)`", table, re.MULTILINE)
    assert sorted(phrases) == sorted([*SAID, *REFUSED])


@pytest.mark.parametrize("phrase", SAID)
async def test_a_phrase_of_the_quickstart_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phrase: str
) -> None:
    assert phrase in printed(monkeypatch, *await SAID[phrase](tmp_path))


@pytest.mark.parametrize("phrase", REFUSED)
def test_a_refusal_of_the_quickstart_is_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phrase: str) -> None:
    (tmp_path / "in.nc").write_bytes(TEXT)
    controller, terminal = os.openpty()
    path, really_open = os.ttyname(terminal), os.open

    def refuse(name: Any, *how: Any, **more: Any) -> int:
        if name == path:
            raise PermissionError(13, "Permission denied")
        return really_open(name, *how, **more)

    if phrase == REFUSED[0]:
        fcntl.flock(terminal, fcntl.LOCK_EX)
    else:
        monkeypatch.setattr(os, "open", refuse)
    try:
        assert phrase in invoke("send", tmp_path / "in.nc", "--line", path, "--protocol", "fanuc-b").stderr
    finally:
        os.close(controller)
        os.close(terminal)


def test_everyday_stops_are_not_told_and_others_are(monkeypatch: pytest.MonkeyPatch) -> None:
    everyday: list[Report | Result] = [Held(why="DC3"), Resumed(why="DC1")] * 3
    assert printed(monkeypatch, *everyday) == ""
    told = printed(
        monkeypatch, *everyday, Held(why="the control's RS is OFF"), Resumed(why="RS is ON again"), *everyday
    )
    assert told == "held: the control's RS is OFF\nresumed: RS is ON again\n"
    told = printed(monkeypatch, Held(why="parity error: it may have been DC3"), Resumed(why="DC1"), *everyday)
    assert told == "held: parity error: it may have been DC3\nresumed: DC1\n"


def test_a_terminal_shows_why_it_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = StringIO()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    bar = Bar("in.nc")
    progress = Progress(bytes=1000, total=5000, held=True, rate=100.0, share=0.5, left_s=40.0)
    bar.show(progress, "the control's RS is OFF")
    bar.show(progress, "[parity] at 13h: it may have been DC3")
    bar.close()
    assert "held: the control's RS is OFF" in shown.getvalue()
    assert "held: [parity] at 13h: it may…" in shown.getvalue()
