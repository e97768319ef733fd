"""A capture asked for by a program that uses the library."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tapewire.engine import Notice, Outcome
from tapewire.errors import UsageError
from tapewire.line.captures.reader import Packet, read_capture
from tapewire.line.captures.records import Happening
from tapewire.transfer.api import run_control, send
from tapewire.transfer.reports import Ready, Report
from tests.transfer.captured import tape


async def test_both_ends_write_what_the_library_is_asked_to(tmp_path: Path) -> None:
    source, line = tmp_path / "a.nc", tmp_path / "line"
    source.write_bytes(tape(20))
    ready = asyncio.Event()

    def observe(report: Report, now: int) -> None:
        if isinstance(report, Ready):
            ready.set()

    how = {"protocol": "fanuc-b", "baud": 115200}
    control = asyncio.ensure_future(
        run_control(line=f"pty:{line}", observer=observe, capture=tmp_path / "cnc.pcapng", **how)  # type: ignore[arg-type]
    )
    await ready.wait()
    sent = await send(source, line=str(line), capture=str(tmp_path / "host.pcapng"), **how)  # type: ignore[arg-type]
    assert (sent.outcome, (await control).outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    for name, what in (("host", Happening.SENT), ("cnc", Happening.RECEIVED)):
        with (tmp_path / f"{name}.pcapng").open("rb") as stream:
            items = [item for item in read_capture(stream) if isinstance(item, Packet)]
        assert b"".join(item.record.data for item in items if item.record.what is what) == tape(20)
        assert items[0].origin.line.endswith("115200 baud 8E1, fanuc-b")


async def test_a_place_for_no_capture_is_refused_before_the_line_is_opened(tmp_path: Path) -> None:
    told: list[Report] = []
    with pytest.raises(UsageError, match="no capture can be written there"):
        await run_control(
            line=f"pty:{tmp_path}/line",
            protocol="fanuc-b",
            capture=tmp_path,
            observer=lambda report, now: told.append(report),
        )
    assert [report for report in told if not isinstance(report, Notice)] == []
    assert not (tmp_path / "line").exists()
