"""Tapewire as an integrator uses it: `import tapewire` and nothing else."""

from __future__ import annotations

import asyncio
import hashlib
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Final

import pytest

import tapewire

TEXT: Final = b"%\nO0001\n" + b"G01X1.5Y2.5\n" * 1200 + b"M30\n%"
HOW: Final[dict[str, Any]] = {"protocol": "fanuc-b-expansion", "baud": 230400}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "in.nc"
    file.write_bytes(TEXT)
    return file


def descriptors() -> dict[str, str]:
    """What this process holds open, but for the folder that is being listed."""
    return {
        name: os.readlink(path)
        for name in os.listdir("/proc/self/fd")
        if os.path.islink(path := f"/proc/self/fd/{name}")
    }


class Reports(list[tapewire.Report]):
    """An observer that keeps what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self._moved = asyncio.Event()
        self.ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def __call__(self, report: tapewire.Report, now: int) -> None:
        self.append(report)
        if isinstance(report, tapewire.Ready) and not self.ready.done():
            self.ready.set_result(report.line.replace("listen:", "socket:").removeprefix("pty:"))
        if isinstance(report, tapewire.Progress) and report.bytes > 500:
            self._moved.set()

    async def moved(self) -> None:
        """Until bytes move."""
        await asyncio.wait_for(self._moved.wait(), 30)


async def test_a_program_goes_from_one_end_to_the_other(file: Path) -> None:
    reports = Reports()
    control = asyncio.ensure_future(tapewire.run_control(line="listen://127.0.0.1:0", observer=reports, **HOW))
    sent = await tapewire.send(file, line=await reports.ready, **HOW)
    taken = await control
    assert sent.outcome is taken.outcome is tapewire.Outcome.COMPLETE
    assert sent.sha256 == taken.sha256 == hashlib.sha256(TEXT).hexdigest()
    assert sent.bytes == taken.bytes == len(TEXT)


async def test_a_punch_out_comes_back(file: Path, tmp_path: Path) -> None:
    reports = Reports()
    small = tmp_path / "small.nc"
    small.write_bytes(TEXT[:20] + b"\n%")
    program = tapewire.Program.from_file(small)
    task = tapewire.ControlTask(operation=tapewire.Operation.PUNCH, punch=program)
    control = asyncio.ensure_future(tapewire.run_control(task, line=f"pty:{tmp_path}/line", observer=reports, **HOW))
    received = await tapewire.receive(tmp_path / "got.nc", line=await reports.ready, **HOW)
    assert (await control).outcome is received.outcome is tapewire.Outcome.COMPLETE
    assert (tmp_path / "got.nc").read_bytes() == small.read_bytes()
    program.close()


def test_a_shop_in_simulated_time() -> None:
    from io import BytesIO

    world = tapewire.World()
    pair = world.pair("fanuc-b", blocks_per_second=50)
    pair.cnc.cycle_start(world.now)
    pair.host.start(BytesIO(TEXT), world.now)
    world.run_until(lambda: pair.host_end and pair.cnc_end)
    assert pair.host_end is not None
    assert pair.host_end.outcome is tapewire.Outcome.COMPLETE
    assert pair.program.getvalue() == TEXT
    assert "DC3" in str(pair.transcript)


def test_the_public_names_are_all_there() -> None:
    for name in tapewire.__all__:
        assert getattr(tapewire, name) is not None
    assert dir(tapewire) == sorted(tapewire.__all__)
    with pytest.raises(AttributeError, match="no attribute 'sned'"):
        tapewire.sned  # noqa: B018 - the point


def test_importing_it_costs_nothing() -> None:
    """A name is imported when it is used: a shop script that only wants Program needs no asyncio."""
    code = "import sys, tapewire; assert 'asyncio' not in sys.modules; tapewire.Program; print(len(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


async def test_what_is_wrong_is_raised_before_anything_is_opened(file: Path, tmp_path: Path) -> None:
    before = descriptors()
    nowhere: dict[str, Any] = {"line": "/dev/tapewire-is-not-there"}
    wrongs: list[dict[str, Any]] = [
        {"protocol": "fanuc-z"},
        {"line": "nowhere"},
        {"settings": {"posting": "perhaps"}},
        {"baud": 3},
        {"stopbits": 7},
    ]
    for wrong in wrongs:
        with pytest.raises(tapewire.UsageError):
            await tapewire.send(file, **{**nowhere, **HOW, **wrong})
    (tmp_path / "empty.nc").write_bytes(b"")
    with pytest.raises(tapewire.ProgramError, match="empty"):
        await tapewire.send(tmp_path / "empty.nc", **nowhere, **HOW)
    with pytest.raises(tapewire.UsageError, match="cannot be read"):
        await tapewire.send(tmp_path / "nul\0.nc", **nowhere, **HOW)
    with pytest.raises(tapewire.LineNotFound):
        await tapewire.send(file, **nowhere, **HOW)
    assert descriptors() == before


async def test_the_errors_are_those_of_python_too(file: Path) -> None:
    with pytest.raises(ValueError, match="fanuc-z"):
        await tapewire.send(file, line="/dev/null", protocol="fanuc-z")
    with pytest.raises(OSError, match="not a serial port"):
        await tapewire.send(file, line="/dev/null", protocol="fanuc-b")


async def test_stop_ends_a_job_in_an_orderly_way(file: Path) -> None:
    reports, stop = Reports(), asyncio.Event()
    task = tapewire.ControlTask(blocks_per_second=100)
    control = asyncio.ensure_future(tapewire.run_control(task, line="listen://127.0.0.1:0", observer=reports, **HOW))
    sending = asyncio.ensure_future(tapewire.send(file, line=await reports.ready, stop=stop, **HOW))
    await reports.moved()
    stop.set()
    sent, taken = await sending, await control
    assert sent.outcome is tapewire.Outcome.CANCELLED
    assert sent.bytes <= taken.bytes_handed <= sent.bytes_handed


def leftovers() -> tuple[dict[str, str], list[threading.Thread], set[asyncio.Task[Any]]]:
    """But for the threads in which asyncio itself asks for the addresses of hosts."""
    threads = [thread for thread in threading.enumerate() if not thread.name.startswith("asyncio_")]
    return descriptors(), threads, asyncio.all_tasks()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("line", ["listen://127.0.0.1:0", "pty:{folder}/line"])
async def test_a_cancelled_job_leaves_nothing(file: Path, tmp_path: Path, line: str) -> None:
    line = line.format(folder=tmp_path)
    before = leftovers()
    reports = Reports()
    sending = asyncio.ensure_future(tapewire.send(file, line=line, observer=reports, **HOW))
    control = asyncio.ensure_future(tapewire.run_control(line=await reports.ready, **HOW))
    await reports.moved()
    sending.cancel()
    with pytest.raises(asyncio.CancelledError):
        await sending
    taken = await control
    assert taken.outcome is tapewire.Outcome.FAILED
    assert taken.bytes < len(TEXT)
    await asyncio.sleep(0)
    assert leftovers() == before
    assert names(tmp_path) == ["in.nc"]


async def test_a_cancelled_reception_leaves_only_what_came(tmp_path: Path) -> None:
    before = leftovers()
    reports = Reports()
    receiving = asyncio.ensure_future(
        tapewire.receive(tmp_path / "got.nc", line="listen://127.0.0.1:0", observer=reports, **HOW)
    )
    port = (await reports.ready).rpartition(":")[2]
    _, writer = await asyncio.open_connection("127.0.0.1", int(port))
    writer.write(b"\x12" + TEXT[:1000])
    await reports.moved()
    receiving.cancel()
    with pytest.raises(asyncio.CancelledError):
        await receiving
    writer.close()
    await writer.wait_closed()
    assert leftovers() == before
    assert (tmp_path / "got.nc.part").read_bytes() == TEXT[:1000]


@pytest.mark.parametrize("line", ["listen://127.0.0.1:0", "socket://127.0.0.1:1", "pty:{folder}/line"])
@pytest.mark.parametrize("job", ["send", "receive", "run_control"])
async def test_a_job_cancelled_before_anybody_is_there(file: Path, tmp_path: Path, job: str, line: str) -> None:
    before = leftovers()
    how = {**HOW, "line": line.format(folder=tmp_path)}
    working: asyncio.Future[tapewire.Result]
    match job:
        case "send":
            working = asyncio.ensure_future(tapewire.send(file, **how))
        case "receive":
            working = asyncio.ensure_future(tapewire.receive(tmp_path / "got.nc", **how))
        case _:
            working = asyncio.ensure_future(tapewire.run_control(**how))
    await asyncio.sleep(0.15)
    assert not working.done()
    working.cancel()
    with pytest.raises(asyncio.CancelledError):
        await working
    await asyncio.sleep(0)
    assert leftovers() == before
    assert names(tmp_path) == ["in.nc"]


async def test_many_jobs_run_in_one_loop(file: Path, tmp_path: Path) -> None:
    """A shop of six machines in one process; nothing of one job shows in another."""
    before = leftovers()

    async def one(number: int) -> None:
        text = TEXT.replace(b"O0001", b"O%04d" % number)[: -5 - number * 24] + b"\nM30\n%"
        program = tmp_path / f"{number}.nc"
        program.write_bytes(text)
        reports = Reports()
        control = asyncio.ensure_future(tapewire.run_control(line="listen://127.0.0.1:0", observer=reports, **HOW))
        sent = await tapewire.send(program, line=await reports.ready, **HOW)
        assert sent.outcome is tapewire.Outcome.COMPLETE
        assert sent.sha256 == (await control).sha256 == hashlib.sha256(text).hexdigest()

    await asyncio.gather(*(one(number) for number in range(1, 7)))
    assert leftovers() == before
