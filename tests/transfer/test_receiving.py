"""Taking a punch-out from a control that the test plays, into files and onto disks that may fail."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import os
import threading
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.engine import Outcome
from tapewire.errors import LineError, UsageError
from tapewire.transfer.api import receive
from tapewire.transfer.files import StoredFile
from tapewire.transfer.receiving import GIVE_UP_AT_BYTES, PAUSE_AT_BYTES
from tapewire.transfer.reports import Result
from tests.transfer.peer import DC1, DC2, DC3, DC4, NAK, SYN, receiving
from tests.transfer.tapes import on_the_line

TEXT: Final = b"%\nO3563(356)\nG01X3.5Y-6.563\nM30\n%"


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def stored(result: Result, outcome: Outcome, file: Path, content: bytes) -> None:
    """What the result says is what lies on the disk, and nothing else lies there."""
    assert result.outcome is outcome, result.reason
    assert file.read_bytes() == content
    assert (result.bytes, result.bytes_handed) == (len(content), len(content))
    assert result.sha256 == hashlib.sha256(content).hexdigest()
    assert files(file.parent) == {file.name}


@pytest.mark.parametrize(
    ("data", "raw", "punched", "content"),
    [
        ("ascii", False, TEXT, TEXT),
        ("ascii", False, bytes(50) + TEXT.replace(b"\n", b"\r\n") + bytes(50), TEXT),
        ("iso", False, b"\x00\xff" + on_the_line(TEXT, "iso").replace(b"\n", b"\n\x8d\x8d"), TEXT),
        ("eia", False, bytes(50) + on_the_line(TEXT, "eia") + bytes(50), TEXT),
        ("eia", True, bytes(5) + on_the_line(TEXT, "eia"), bytes(5) + on_the_line(TEXT, "eia")),
        ("ascii", True, b"\x00\r\n\x0a" + TEXT + b"\r\r", b"\x00\r\n\x0a" + TEXT + b"\r\r"),
        ("binary", True, bytes(range(0x20)).replace(DC4, b"") + bytes(range(0x80, 0x100)), None),
        ("ascii", False, b"", b""),
    ],
)
async def test_what_was_punched_is_what_is_stored(
    tmp_path: Path, data: str, raw: bool, punched: bytes, content: bytes | None
) -> None:
    got = tmp_path / "got.nc"
    async with receiving(got, raw=raw, settings={"data": data}) as job:
        job.peer.say(DC2 + punched + DC4)
        result = await job.result()
        assert await job.peer.read_to_end() == b"", "a host that keeps up has nothing to say"
    stored(result, Outcome.COMPLETE, got, punched if content is None else content)


@pytest.mark.parametrize(
    ("said", "outcome", "reason"),
    [
        (DC4 + SYN, Outcome.CANCELLED, "SYN"),
        (DC4 + b"\x16", Outcome.CANCELLED, "SYN"),
        (DC4 + NAK, Outcome.FAILED, "NAK"),
        (SYN, Outcome.CANCELLED, "SYN"),
        (NAK, Outcome.FAILED, "NAK"),
    ],
)
async def test_a_punch_out_that_was_cut_short_keeps_another_name(
    tmp_path: Path, said: bytes, outcome: Outcome, reason: str
) -> None:
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT[:20])
        await asyncio.sleep(0.1)
        job.peer.say(said)
        result = await job.result()
    assert reason in result.reason
    assert "got.nc.part" in result.reason
    stored(result, outcome, tmp_path / "got.nc.part", TEXT[:20])


@pytest.mark.parametrize("how", ["hang up", "vanish", "stop", "time"])
async def test_an_end_from_outside_keeps_what_came(tmp_path: Path, how: str) -> None:
    async with receiving(tmp_path / "got.nc", timeout_s=0.8 if how == "time" else None) as job:
        job.peer.say(DC2 + TEXT[:20])
        await asyncio.sleep(0.2)
        match how:
            case "hang up":
                job.peer.hang_up()
            case "vanish":
                await job.peer.vanish()
            case "stop":
                job.stop.set()
            case _:
                pass
        result = await job.result()
    outcome = Outcome.CANCELLED if how == "stop" else Outcome.FAILED
    stored(result, outcome, tmp_path / "got.nc.part", TEXT[:20])


async def test_nothing_came_and_nothing_is_left(tmp_path: Path) -> None:
    async with receiving(tmp_path / "got.nc", timeout_s=0.2) as job:
        result = await job.result()
    assert (result.outcome, result.bytes) == (Outcome.FAILED, 0)
    assert files(tmp_path) == set()


async def test_what_an_earlier_job_left_stays_until_something_comes(tmp_path: Path) -> None:
    part = tmp_path / "got.nc.part"
    part.write_bytes(b"precious" * 20)
    async with receiving(tmp_path / "got.nc", timeout_s=0.2) as job:
        await job.result()
    assert part.read_bytes() == b"precious" * 20
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT + DC4)
        stored(await job.result(), Outcome.COMPLETE, tmp_path / "got.nc", TEXT)


@pytest.mark.parametrize("there", ["file", "folder", "dangling link"])
async def test_a_name_that_is_taken_is_refused_before_the_line_is_opened(tmp_path: Path, there: str) -> None:
    got = tmp_path / "got.nc"
    match there:
        case "file":
            got.write_bytes(b"precious")
        case "folder":
            got.mkdir()
        case _:
            got.symlink_to("nowhere")
    with pytest.raises(UsageError, match=r"got\.nc"):
        await receive(got, line="/dev/tapewire-is-not-there", protocol="fanuc-b")
    assert files(tmp_path) == {"got.nc"}


async def test_a_line_that_cannot_be_opened_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(LineError):
        await receive(tmp_path / "got.nc", line="/dev/tapewire-is-not-there", protocol="fanuc-b")
    assert files(tmp_path) == set()


def no_links(*paths: object, **how: object) -> None:
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))


@pytest.mark.parametrize("has_links", [True, False])
async def test_a_name_that_was_taken_meanwhile_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    if not has_links:
        monkeypatch.setattr(os, "link", no_links)
    got = tmp_path / "got.nc"
    async with receiving(got) as job:
        job.peer.say(DC2 + TEXT)
        await asyncio.sleep(0.1)
        got.write_bytes(b"precious")
        job.peer.say(DC4)
        result = await job.result()
    assert result.outcome is Outcome.FAILED
    assert "got.nc.part" in result.reason
    assert got.read_bytes() == b"precious"
    assert (tmp_path / "got.nc.part").read_bytes() == TEXT


async def test_a_disk_without_links_gives_the_name_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "link", no_links)
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT + DC4)
        stored(await job.result(), Outcome.COMPLETE, tmp_path / "got.nc", TEXT)


class SlowDisk:
    """A disk that takes nothing until it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.moves = threading.Event()
        write = StoredFile.write

        def slowly(file: StoredFile, data: bytes) -> None:
            assert self.moves.wait(60)
            write(file, data)

        monkeypatch.setattr(StoredFile, "write", slowly)


BLOCK: Final = b"G01X123.456Y-123.45\n"


@pytest.mark.parametrize(
    ("settings", "pause", "resume"),
    [({}, DC3, DC1), ({"posting": "off", "code": "ascii"}, b"\x13", DC2), ({"resume": "dc2"}, DC3, DC2)],
)
async def test_a_slow_disk_pauses_the_punch_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, str], pause: bytes, resume: bytes
) -> None:
    disk = SlowDisk(monkeypatch)
    half = BLOCK * (PAUSE_AT_BYTES // len(BLOCK) + 1)
    async with receiving(tmp_path / "got.nc", settings=settings) as job:
        job.peer.say(DC2 + half[: PAUSE_AT_BYTES - 100])
        assert await job.peer.quiet() == 0, "less than 64 KB wait"
        job.peer.say(half[PAUSE_AT_BYTES - 100 :])
        await job.peer.read(1)
        job.peer.say(BLOCK * 50)  # the control's overrun
        assert await job.peer.quiet() == 1
        assert job.peer.got == pause
        disk.moves.set()
        await job.peer.read(2)
        job.peer.say(BLOCK + DC4)
        stored(await job.result(), Outcome.COMPLETE, tmp_path / "got.nc", half + BLOCK * 51)
        assert job.peer.got == pause + resume


async def test_a_control_that_does_not_pause_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + BLOCK * (2 * GIVE_UP_AT_BYTES // len(BLOCK)))
        await job.peer.read(1)
        asyncio.get_running_loop().call_later(1.0, disk.moves.set)
        result = await job.result()
    assert result.outcome is Outcome.FAILED
    assert "did not heed the pause" in result.reason
    part = (tmp_path / "got.nc.part").read_bytes()
    assert GIVE_UP_AT_BYTES <= result.bytes == len(part) < 2 * GIVE_UP_AT_BYTES


@pytest.mark.parametrize("fails_at", ["write", "sync"])
async def test_a_full_disk_ends_the_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails_at: str) -> None:
    write = StoredFile.write

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fill(file: StoredFile, data: bytes) -> None:
        write(file, data[: max(0, 100 - file.byte_count)])
        if file.byte_count >= 100:
            full()

    monkeypatch.setattr(StoredFile, fails_at, fill if fails_at == "write" else full)
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + BLOCK * 10 + DC4)
        result = await job.result()
    assert f"{tmp_path}/got.nc" in result.reason
    assert "No space left on device" in result.reason
    content = BLOCK * 10 if fails_at == "sync" else (BLOCK * 10)[:100]
    stored(result, Outcome.FAILED, tmp_path / "got.nc.part", content)


async def test_a_damaged_punch_out_is_not_complete(tmp_path: Path) -> None:
    """ISO has even parity: G with its parity bit flipped is no G any more."""
    punched = on_the_line(TEXT, "iso").replace(b"G", b"\xc7")
    async with receiving(tmp_path / "got.nc", settings={"data": "iso"}) as job:
        job.peer.say(DC2 + punched + DC4)
        result = await job.result()
    assert "parity" in result.reason
    stored(result, Outcome.FAILED, tmp_path / "got.nc.part", TEXT)
