"""What becomes of the file when disks hang, threads fail, names are taken, and two jobs want the same one."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from tapewire.engine import Outcome
from tapewire.errors import UsageError
from tapewire.transfer import receiving as receiving_module
from tapewire.transfer.api import receive, run_control
from tapewire.transfer.control import ControlTask
from tapewire.transfer.files import StoredFile
from tests.transfer.peer import DC2, DC4, HOW, receiving, working

TEXT = b"%\nO3563(356)\nG01X3.5Y-6.563\nM30\n%"
NOWHERE = "/dev/tapewire-is-not-there"


@pytest.mark.parametrize("fails_at", ["write", "sync"])
async def test_no_failure_of_the_storing_thread_is_taken_for_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails_at: str
) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(StoredFile, fails_at, fail)
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT + DC4)
        result = await job.result()
    assert result.outcome is Outcome.FAILED
    assert result.reason.startswith(f"{tmp_path}/got.nc: cannot be stored (out of memory)")
    assert not (tmp_path / "got.nc").exists()


@pytest.mark.parametrize("hangs_at", ["write", "sync"])
async def test_a_disk_that_hangs_does_not_hold_the_job_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hangs_at: str
) -> None:
    moves = threading.Event()
    act = getattr(StoredFile, hangs_at)

    def hang(file: StoredFile, *what: bytes) -> None:
        assert moves.wait(60)
        act(file, *what)

    monkeypatch.setattr(StoredFile, hangs_at, hang)
    monkeypatch.setattr(receiving_module, "DISK_LIMIT_S", 0.3)
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT + DC4)
        result = await job.result()
    moves.set()
    for thread in threading.enumerate():
        if thread.name == "tapewire-store":
            thread.join(30)
    assert result.outcome is Outcome.FAILED
    assert "got.nc.part: the disk was not done after 0.3 s" in result.reason
    assert result.bytes == (len(TEXT) if hangs_at == "sync" else 0)
    assert ("bytes that came are not stored" in result.reason) == (hangs_at == "write")
    assert not (tmp_path / "got.nc").exists()


@pytest.mark.parametrize("there", ["fifo", "link"])
async def test_a_part_that_is_no_file_is_refused(tmp_path: Path, there: str) -> None:
    part, target = tmp_path / "got.nc.part", tmp_path / "precious"
    target.write_bytes(b"precious")
    os.mkfifo(part) if there == "fifo" else part.symlink_to(target)
    with pytest.raises(UsageError, match=r"got\.nc\.part: is no regular file"):
        await receive(tmp_path / "got.nc", line=NOWHERE, protocol="fanuc-b")
    assert target.read_bytes() == b"precious"


async def test_a_fifo_is_no_place_to_save_in(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "saved.nc")
    with pytest.raises(UsageError, match=r"saved\.nc: is no regular file"):
        await run_control(ControlTask(save=tmp_path / "saved.nc"), line=NOWHERE, protocol="fanuc-b")


async def test_two_receptions_do_not_share_a_part(tmp_path: Path) -> None:
    async with receiving(tmp_path / "got.nc") as job:
        job.peer.say(DC2 + TEXT[:20])
        with pytest.raises(UsageError, match=r"got\.nc\.part: another job is writing this file"):
            await receive(tmp_path / "got.nc", line=NOWHERE, protocol="fanuc-b")
        job.peer.say(TEXT[20:] + DC4)
        result = await job.result()
    assert result.outcome is Outcome.COMPLETE, result.reason
    assert (tmp_path / "got.nc").read_bytes() == TEXT
    with pytest.raises(UsageError, match="exists"):
        await receive(tmp_path / "got.nc", line=NOWHERE, protocol="fanuc-b")


async def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=f"there is no folder {tmp_path}/no$"):
        await receive(tmp_path / "no" / "got.nc", line=NOWHERE, protocol="fanuc-b")


@pytest.mark.parametrize("exists", [True, False])
async def test_a_control_that_takes_nothing_leaves_its_file_alone(tmp_path: Path, exists: bool) -> None:
    saved = tmp_path / "saved.nc"
    if exists:
        saved.write_bytes(b"precious")
    task = ControlTask(save=saved)
    async with working(lambda observe, stop: run_control(task, observer=observe, stop=stop, **HOW)) as job:
        await job.peer.read(1)  # it asks, and gets nothing
        job.stop.set()
        result = await job.result()
    assert (result.outcome, result.bytes) == (Outcome.CANCELLED, 0)
    assert set(os.listdir(tmp_path)) == ({"saved.nc"} if exists else set())
    assert not exists or saved.read_bytes() == b"precious"
