"""The simulated control as a job: its operations, its accidents, and lines on which nobody is there."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import os
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.engine import Outcome
from tapewire.errors import LineError, UsageError
from tapewire.transfer.api import run_control, send
from tapewire.transfer.control import ControlTask, Operation
from tapewire.transfer.files import StoredFile
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Progress, Report, Result
from tests.transfer.peer import DC1, DC2, DC4, NAK, SYN, Job, working

TEXT: Final = b"%\n" + b"G01X1.Y2.Z3.\n" * 1000 + b"M30\n%"
HOW: Final[dict[str, Any]] = {"protocol": "fanuc-b", "baud": 230400}


@pytest.fixture(autouse=True)
def short_linger(monkeypatch: pytest.MonkeyPatch) -> None:
    """The peers of these tests keep the line open; nobody needs to wait for them."""
    monkeypatch.setattr("tapewire.transfer.control.LINGER_S", 0.05)


def controlling(task: ControlTask, **how: Any) -> Any:
    how = {"line": "listen://127.0.0.1:0", **HOW, **how}
    return working(lambda observe, stop: run_control(task, observer=observe, stop=stop, **how))


def blocks_executed(job: Job) -> int:
    return int(job.named(Progress)[-1].blocks)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


async def feed(job: Job, text: bytes) -> Result:
    """Play a host that gives all at once, to a control that takes it as it comes."""
    await job.peer.read(1)
    assert job.peer.got == DC1
    job.peer.say(text)
    return await job.result()


@pytest.mark.parametrize("operation", [Operation.DNC, Operation.READ])
async def test_it_takes_a_program_up_to_its_eor(tmp_path: Path, operation: Operation) -> None:
    task = ControlTask(operation=operation, save=tmp_path / "saved.nc")
    async with controlling(task) as job:
        result = await feed(job, TEXT + b"this is not read any more")
        assert result.outcome is Outcome.COMPLETE, result.reason
        assert (result.bytes, result.bytes_handed) == (len(TEXT), len(TEXT))
        assert result.sha256 == hashlib.sha256(TEXT).hexdigest()
        assert (await job.peer.read_to_end())[-1:] == b"\x93"
        assert blocks_executed(job) == TEXT.count(b"\n")
    assert (tmp_path / "saved.nc").read_bytes() == TEXT


@pytest.mark.parametrize(
    ("accident", "outcome", "code"),
    [("reset_after", Outcome.CANCELLED, SYN), ("alarm_after", Outcome.FAILED, NAK)],
)
@pytest.mark.parametrize("operation", [Operation.DNC, Operation.READ])
async def test_a_reset_or_an_alarm_in_mid_program(
    tmp_path: Path, operation: Operation, accident: str, outcome: Outcome, code: bytes
) -> None:
    when: dict[str, Any] = {accident: 1000}
    task = ControlTask(operation=operation, save=tmp_path / "saved.nc", **when)
    async with controlling(task) as job:
        result = await feed(job, TEXT)
        assert result.outcome is outcome
        assert 1000 <= result.bytes <= result.bytes_handed <= len(TEXT)
        assert (await job.peer.read_to_end())[-1:] == code
    saved = (tmp_path / "saved.nc").read_bytes()
    assert saved == TEXT[: len(saved)]
    assert len(saved) == result.bytes


@pytest.mark.parametrize(
    ("accident", "outcome", "code"),
    [("reset_after", Outcome.CANCELLED, SYN), ("alarm_after", Outcome.FAILED, NAK)],
)
async def test_a_reset_or_an_alarm_in_mid_punch_out(
    tmp_path: Path, accident: str, outcome: Outcome, code: bytes
) -> None:
    (tmp_path / "in.nc").write_bytes(TEXT)
    program = Program.from_file(tmp_path / "in.nc")
    when: dict[str, Any] = {accident: 60}
    async with controlling(ControlTask(operation=Operation.PUNCH, punch=program, **when)) as job:
        result = await job.result()
        said = await job.peer.read_to_end()
    program.close()
    assert result.outcome is outcome
    assert said[:1] == DC2
    assert said[-2:] == DC4 + code
    punched = said[1:-2]
    assert punched == TEXT[: len(punched)]
    assert result.bytes <= len(punched) <= result.bytes_handed


async def test_both_ends_agree_on_what_an_accident_left(tmp_path: Path) -> None:
    """Whatever the control has taken lies between the two counts of the host."""
    (tmp_path / "in.nc").write_bytes(TEXT)

    async def one(number: int, task: ControlTask, posting: str) -> None:
        line = f"{tmp_path}/line{number}"
        how = {**HOW, "protocol": "fanuc-b-expansion", "settings": {"posting": posting}}
        made = asyncio.Event()

        def observe(report: Report, now: int) -> None:
            made.set()

        cnc = asyncio.ensure_future(run_control(task, line=f"pty:{line}", observer=observe, **how))
        await made.wait()
        sent, taken = await asyncio.gather(send(tmp_path / "in.nc", line=line, **how), cnc)
        assert sent.outcome is not Outcome.COMPLETE, (task, posting)
        assert taken.outcome is not Outcome.COMPLETE
        assert taken.bytes <= taken.bytes_handed
        assert sent.bytes <= taken.bytes_handed <= sent.bytes_handed, (task, posting)

    tasks = [task for at in (1, 600, 5000) for task in (ControlTask(reset_after=at), ControlTask(alarm_after=at))]
    # Without posting a later reset looks like a stop, and what was sent after it is lost unseen: that risk is told.
    cases = [(task, "on") for task in tasks] + [(task, "off") for task in tasks[:4]]
    await asyncio.gather(*(one(number, *case) for number, case in enumerate(cases)))


async def test_it_executes_block_by_block(tmp_path: Path) -> None:
    """An hour of blocks: it is held by its own speed, not by the line, until somebody ends it."""
    text = b"%\n" + b"G01X1.\n" * 200 + b"M30\n%"
    async with controlling(ControlTask(blocks_per_second=0.005), timeout_s=0.5) as job:
        result = await feed(job, text)
        assert result.outcome is Outcome.FAILED
        assert blocks_executed(job) == 0
    async with controlling(ControlTask(blocks_per_second=10_000)) as job:
        assert (await feed(job, text)).outcome is Outcome.COMPLETE
        assert blocks_executed(job) >= 1


async def test_a_pseudo_terminal_that_nobody_opens(tmp_path: Path) -> None:
    """What the control would say at its end can never leave; it ends all the same."""
    (tmp_path / "in.nc").write_bytes(TEXT)
    program = Program.from_file(tmp_path / "in.nc")
    stop = asyncio.Event()
    asyncio.get_running_loop().call_later(0.2, stop.set)

    async def one(name: str, task: ControlTask, outcome: Outcome, **how: Any) -> None:
        result = await asyncio.wait_for(run_control(task, line=f"pty:{tmp_path}/{name}", **HOW, **how), 30)
        assert result.outcome is outcome
        assert (result.bytes, result.bytes_handed) == (0, 0)

    punch = ControlTask(operation=Operation.PUNCH, punch=program)
    await asyncio.gather(
        one("stopped", ControlTask(), Outcome.CANCELLED, stop=stop),
        one("late", ControlTask(), Outcome.FAILED, timeout_s=0.2),
        one("punch stopped", punch, Outcome.CANCELLED, stop=stop),
        one("punch late", punch, Outcome.FAILED, timeout_s=0.2),
    )
    program.close()
    assert names(tmp_path) == ["in.nc"]


async def test_a_full_disk_ends_the_operation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: StoredFile, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(StoredFile, "write", full)
    async with controlling(ControlTask(save=tmp_path / "saved.nc")) as job:
        result = await feed(job, TEXT)
        assert (await job.peer.read_to_end())[-1:] == SYN, "the host hears that its program was not taken"
    assert result.outcome is Outcome.FAILED
    assert f"{tmp_path}/saved.nc: cannot be stored (No space left on device)" in result.reason


async def test_what_is_to_be_replaced_stays_until_the_line_is_open(tmp_path: Path) -> None:
    saved = tmp_path / "saved.nc"
    with pytest.raises(LineError):
        await run_control(ControlTask(save=saved), line="/dev/tapewire-is-not-there", **HOW)
    assert not saved.exists()
    saved.write_bytes(b"precious" * 5000)
    with pytest.raises(LineError):
        await run_control(ControlTask(save=saved), line="/dev/tapewire-is-not-there", **HOW)
    assert saved.read_bytes() == b"precious" * 5000
    async with controlling(ControlTask(save=saved)) as job:
        await feed(job, TEXT)
    assert saved.read_bytes() == TEXT


@pytest.mark.parametrize("save", ["no/folder/saved.nc", ".", "x" * 300, "nul\0"])
async def test_a_place_where_nothing_can_be_saved(tmp_path: Path, save: str) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        await run_control(ControlTask(save=tmp_path / save), line="/dev/tapewire-is-not-there", **HOW)


def test_a_task_that_makes_no_sense(tmp_path: Path) -> None:
    (tmp_path / "in.nc").write_bytes(TEXT)
    program = Program.from_file(tmp_path / "in.nc")
    with pytest.raises(UsageError, match="needs the program"):
        ControlTask(operation=Operation.PUNCH)
    with pytest.raises(UsageError, match="needs the program"):
        ControlTask(punch=program)
    with pytest.raises(UsageError, match="takes nothing"):
        ControlTask(operation=Operation.PUNCH, punch=program, save=tmp_path / "saved.nc")
    program.close()
