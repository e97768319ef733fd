"""Every protocol, line, role, code set, posting and data code: the same bytes at both ends. Many run at once."""

from __future__ import annotations

import asyncio
import hashlib
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.codes import DataCode
from tapewire.engine import Nanos, Outcome
from tapewire.transfer.api import receive, run_control, send
from tapewire.transfer.control import ControlTask, Operation
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report, Result
from tests.transfer.tapes import on_the_line

TEXT: Final = b"%\nO3563(DIGITS 0123456789)\nG01X-1.5Y2.25Z3.\nM30\n%"


@dataclass
class Case:
    """One job on a line that one end makes and the other finds."""

    folder: Path
    protocol: str
    kind: str
    maker: str
    code: str
    posting: str
    data: str
    made: asyncio.Future[str] = field(default_factory=lambda: asyncio.get_running_loop().create_future())

    def observe(self, report: Report, now: Nanos) -> None:
        if isinstance(report, Ready) and not self.made.done():
            self.made.set_result(report.line.replace("listen:", "socket:").removeprefix("pty:"))

    async def how(self, end: str) -> dict[str, Any]:
        """The arguments that both ends of every job have in common."""
        here = "listen://127.0.0.1:0" if self.kind == "tcp" else f"pty:{self.folder}/line"
        return {
            "line": here if end == self.maker else await self.made,
            "protocol": self.protocol,
            "settings": {"code": self.code, "posting": self.posting, "data": self.data},
            "observer": self.observe,
            "timeout_s": 60.0,
        }

    async def feed(self) -> None:
        async def host() -> Result:
            return await send(self.folder.parent / "in.nc", **await self.how("host"))

        async def cnc() -> Result:
            return await run_control(ControlTask(save=self.folder / "saved.nc"), **await self.how("cnc"))

        expected = on_the_line(TEXT, self.data)
        for result in await asyncio.gather(host(), cnc()):
            assert (result.outcome, result.bytes) == (Outcome.COMPLETE, len(expected)), (self, result)
            assert result.sha256 == hashlib.sha256(expected).hexdigest()
        assert (self.folder / "saved.nc").read_bytes() == expected

    async def punch(self) -> None:
        async def host() -> Result:
            return await receive(self.folder / "got.nc", **await self.how("host"))

        async def cnc() -> Result:
            program = Program.from_file(self.folder.parent / "in.nc", DataCode(self.data))
            try:
                task = ControlTask(operation=Operation.PUNCH, punch=program)
                return await run_control(task, **await self.how("cnc"))
            finally:
                program.close()

        received, punched = await asyncio.gather(host(), cnc())
        for result in (received, punched):
            assert result.outcome is Outcome.COMPLETE, (self, result)
        assert punched.sha256 == hashlib.sha256(on_the_line(TEXT, self.data)).hexdigest()
        assert received.sha256 == hashlib.sha256(TEXT).hexdigest()
        assert [path.name for path in self.folder.iterdir()] == ["got.nc"]
        assert (self.folder / "got.nc").read_bytes() == TEXT


@pytest.mark.parametrize("job", ["feed", "punch"])
@pytest.mark.parametrize("protocol", ["fanuc-b", "fanuc-b-expansion"])
async def test_the_same_bytes_at_both_ends(tmp_path: Path, protocol: str, job: str) -> None:
    (tmp_path / "in.nc").write_bytes(TEXT)
    jobs = []
    choices = product(("tcp", "pty"), ("host", "cnc"), ("iso", "ascii"), ("on", "off"), ("ascii", "iso", "eia"))
    for number, choice in enumerate(choices):
        folder = tmp_path / str(number)
        folder.mkdir()
        case = Case(folder, protocol, *choice)
        jobs.append(case.feed() if job == "feed" else case.punch())
    assert len(jobs) == 48
    await asyncio.gather(*jobs)
