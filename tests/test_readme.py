"""The examples of the README run as they stand there, and its figures are those of this program."""

from __future__ import annotations

import asyncio
import json
import re
import sys
from pathlib import Path

import pytest

from tapewire.engine import Nanos
from tapewire.transfer.api import run_control
from tapewire.transfer.control import ControlTask, Operation
from tapewire.transfer.example import example_program
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report, Result
from tests.house.markdown import fenced_blocks

README = (Path(__file__).parents[1] / "README.md").read_text()
TEXT = b"%\nO0001\nG91 G01 X1. F500\nM30\n%"
ABOUT_TEN_LINES = 12


def examples() -> list[str]:
    return [body for language, body in fenced_blocks(README) if language == "python"]


def test_both_examples_are_about_ten_lines() -> None:
    lines = [[line for line in example.splitlines() if line.strip()] for example in examples()]
    assert len(lines) == 2
    assert all(len(body) <= ABOUT_TEN_LINES for body in lines)


async def test_send_and_receive_over_a_line(tmp_path: Path) -> None:
    """The example is the host; the simulated control listens on a port of its own choice, twice."""
    (tmp_path / "O0001.nc").write_bytes(TEXT)
    punched = Program.from_file(tmp_path / "O0001.nc")
    line: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def observe(report: Report, now: Nanos) -> None:
        if isinstance(report, Ready) and not line.done():
            line.set_result(report.line)

    async def control() -> Result:
        taken = await run_control(line="listen://127.0.0.1:0", protocol="fanuc-b", observer=observe)
        task = ControlTask(operation=Operation.PUNCH, punch=punched)
        await run_control(task, line=await line, protocol="fanuc-b")
        return taken

    controlling = asyncio.create_task(control())
    port = (await line).rpartition(":")[2]
    printed = await run_example(examples()[0].replace("4001", port), tmp_path)
    taken = await controlling
    punched.close()
    assert printed == [
        f"complete {len(TEXT)} {taken.sha256}",
        f"complete {len(TEXT)} the control has punched out everything",
    ]
    assert (tmp_path / "O0002.nc").read_bytes() == TEXT


async def run_example(example: str, folder: Path) -> list[str]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", example, cwd=folder, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    printed, complaints = await process.communicate()
    assert (process.returncode, complaints.decode()) == (0, "")
    return printed.decode().splitlines()


def test_simulate_both_ends(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(examples()[1], "README.md", "exec"), {"__name__": "__main__"})
    transcript = capsys.readouterr().out
    assert "cnc   DC3" in transcript
    assert "host  -- complete, 15013 bytes" in transcript


def test_the_demo_ends_with_the_hash_that_stands_there() -> None:
    program = Program.from_file(example_program())
    digests = set(re.findall(r"\b[0-9a-f]{64}\b", README))
    assert digests == {program.sha256()}
    assert f"complete: {program.byte_count:,} bytes" in README
    program.close()


def test_the_line_of_json_has_the_fields_of_a_result() -> None:
    (line,) = (json.loads(body) for language, body in fenced_blocks(README) if language == "json")
    assert line.keys() - {"event", "time_ns"} == set(Result.__dataclass_fields__)
