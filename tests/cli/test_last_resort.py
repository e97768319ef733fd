"""Outputs that take nothing, disks that hang, and people who have waited long enough."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tapewire.cli import demo as demo_module
from tapewire.cli.common import parse_words
from tapewire.engine import SECOND, Outcome
from tapewire.errors import LineError, ProgramError, UsageError
from tapewire.protocols.settings import End
from tapewire.transfer import program as program_module
from tapewire.transfer.program import Program
from tapewire.transfer.sending import send_program
from tapewire.transfer.session import settings_for
from tests.cli.helpers import DEADLINE_S, Shop, program

FAST_DEMO = ("demo", "--baud", "921600", "--blocks-per-second", "100000")


def run(*words: str, stdout: int) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tapewire", *words]
    try:
        return subprocess.run(
            command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False, timeout=DEADLINE_S
        )
    finally:
        os.close(stdout)


@pytest.mark.parametrize("words", [("--help",), ("--version",), ("send", "--help")])
def test_a_full_disk_behind_a_help_text(words: tuple[str, ...]) -> None:
    finished = run(*words, stdout=os.open("/dev/full", os.O_WRONLY))
    assert finished.returncode == 1
    assert finished.stderr == "tapewire: the system refuses: [Errno 28] No space left on device\n"


@pytest.mark.parametrize("words", [("--help",), ("--version",)])
def test_nobody_reads_a_help_text(words: tuple[str, ...]) -> None:
    read, write = os.pipe()
    os.close(read)
    assert run(*words, stdout=write).stderr == ""


@pytest.mark.parametrize("there", ["full disk", "no reader"])
def test_a_demo_that_cannot_be_shown_runs_to_its_end(there: str) -> None:
    """Its status still tells how it ended."""
    if there == "full disk":
        stdout = os.open("/dev/full", os.O_WRONLY)
    else:
        read, stdout = os.pipe()
        os.close(read)
    finished = run(*FAST_DEMO, stdout=stdout)
    assert (finished.returncode, finished.stderr) == (0, "")


HANGING_DISK = """
import sys, time
from tapewire.transfer.files import StoredFile
StoredFile.sync = lambda file: time.sleep(600)
from tapewire.cli import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_third_signal_kills(shop: Shop, number: signal.Signals) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        words = ["receive", str(shop.folder / "got.nc"), "--protocol", "fanuc-b"]
        line = f"socket://127.0.0.1:{server.getsockname()[1]}"
        process = subprocess.Popen([sys.executable, "-c", HANGING_DISK, *words, "--line", line])
        try:
            control, _ = server.accept()
            with control:
                control.sendall(b"\x12%\nO1\nM30\n%\x14")
                while control.recv(100):  # until the job is over and only the disk is waited for
                    pass
                for _ in range(3):
                    assert process.poll() is None
                    process.send_signal(number)
                    time.sleep(0.7)
            assert process.wait(DEADLINE_S) == -number
        finally:
            process.kill()
            process.wait()


def test_a_fifo_in_place_of_the_part_is_refused(shop: Shop) -> None:
    os.mkfifo(shop.folder / "got.nc.part")
    finished = shop.run("receive", shop.folder / "got.nc", "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b")
    assert finished.status == 2
    assert "got.nc.part: is no regular file" in finished.stderr


def test_a_setting_that_is_given_twice_is_refused() -> None:
    assert parse_words(("posting=on", "code=iso")) == {"posting": "on", "code": "iso"}
    with pytest.raises(UsageError, match="posting is given twice, as on and as off"):
        parse_words(("posting=on", "posting=off"))


@pytest.mark.parametrize("raw", [True, False])
def test_a_temporary_folder_without_room_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raw: bool) -> None:
    file = tmp_path / "in.nc"
    file.write_bytes(program(1000))
    monkeypatch.setattr(program_module, "IN_MEMORY_BYTES", 100)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    with pytest.raises(UsageError, match=rf"^{tmp_path}/temporary: .*TMPDIR") as refused:
        Program.from_file(file, raw=raw)
    assert not isinstance(refused.value, ProgramError)


async def test_the_time_counts_from_the_start_of_the_command(tmp_path: Path) -> None:
    """What has passed before the line is opened has passed: reading a long program from a slow disk, say."""
    file = tmp_path / "in.nc"
    file.write_bytes(program(10))
    job = settings_for(End.HOST, "listen://127.0.0.1:0", "fanuc-b", settings={}, timeout_s=3600.0)
    late = replace(job, began=job.began - 3600 * SECOND)
    text = Program.from_file(file)
    result = await asyncio.wait_for(send_program(text, late), DEADLINE_S)
    text.close()
    assert (result.outcome, result.reason) == (Outcome.FAILED, "not complete within 3600 s")


def test_a_demo_whose_control_does_not_come_up_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    """And leaves no task behind, which would be a warning, and so an error here."""

    async def fail(*_: object) -> None:
        raise LineError("no pseudo terminal is left")

    monkeypatch.setattr(demo_module, "run_control", fail)
    command = demo_module.demo
    with pytest.raises(LineError, match="no pseudo terminal is left"):
        command(["--baud", "921600"], standalone_mode=False)
