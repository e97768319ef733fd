"""The judge of the soak: what it must find wrong, and a played port that says what a driver says.

`python -m benchmarks.soak` runs for an hour; here is what its verdict rests on.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from benchmarks.soak_ends import MarkedPort
from benchmarks.soak_far import Cable
from benchmarks.soak_lines import Case, Line, Tally, program_text, without_figures
from tapewire.engine import LineFault, Nanos, Outcome
from tapewire.line.descriptor import LineSettings
from tapewire.line.driver import LineDriver
from tapewire.line.link import Link
from tapewire.line.ports.serial_port import open_tty
from tapewire.line.transport import Closed
from tapewire.transfer.reports import Result
from tests.line.helpers import ListeningEngine

SENT = b"%\nO0001(A)\nM30\n%"
CONTROL: dict[str, Any] = {"made": 0, "seen": 0, "damaged": 0}


def judged(
    folder: Path,
    stored: bytes | None,
    *,
    host: Outcome = Outcome.FAILED,
    control: str = "failed",
    reason: str = "the line is gone",
    handed: int = len(SENT),
    punch: bool = False,
) -> Tally:
    """What becomes of one job that ended so."""
    tally = Tally()
    line = Line(1, folder, "fanuc-b", 9600, tally)
    case = Case(name="1-1", program=line.folder / "program.nc", punch=punch, seconds=1, disturb_after_s=None)
    case.program.write_bytes(SENT)
    saved = line.folder / "saved.nc"
    if stored is not None:
        saved.write_bytes(stored)
    result = Result(
        outcome=host, reason=reason, bytes=0, bytes_handed=handed, sha256="", seconds=1, stops=0, utilisation=None
    )
    line._judge(case, saved, result, host, reason, {**CONTROL, "outcome": control})
    return tally


@pytest.mark.parametrize("stored", [None, b"", SENT[:7], SENT])
def test_a_prefix_with_a_reason_is_right(tmp_path: Path, stored: bytes | None) -> None:
    tally = judged(tmp_path, stored)
    assert not tally.wrong
    assert tally.reasons.total() == 1


def test_all_of_it_called_complete_is_right(tmp_path: Path) -> None:
    tally = judged(tmp_path, SENT, host=Outcome.COMPLETE, control="complete")
    assert not tally.wrong
    assert tally.complete.total() == 1


@pytest.mark.parametrize(
    ("stored", "how", "said"),
    [
        (SENT[:-1], {"host": Outcome.COMPLETE}, "said to be complete"),
        (None, {"host": Outcome.COMPLETE}, "said to be complete"),
        (SENT[:-1], {"control": "complete"}, "said to be complete"),
        (SENT[:5] + SENT[6:], {}, "not a prefix"),
        (SENT + SENT, {}, "not a prefix"),
        (SENT[:9], {"handed": 8}, "more than the 8 told"),
        (SENT[:9], {"reason": ""}, "no reason"),
        (SENT[:5] + b"?" + SENT[6:], {"host": Outcome.COMPLETE, "punch": True}, "said to be complete"),
    ],
)
def test_what_is_wrong_is_found(tmp_path: Path, stored: bytes | None, how: dict[str, Any], said: str) -> None:
    (wrong,) = judged(tmp_path, stored, **how).wrong
    assert said in wrong
    assert "line 1" in wrong


def test_no_two_jobs_have_one_program(tmp_path: Path) -> None:
    line = Line(3, tmp_path, "fanuc-b", 9600, Tally())
    first, second = (line._case(f"3-{number}").program.read_bytes() for number in (1, 2))
    assert not first.startswith(second[:40])
    assert program_text(line.chance, "a", 500, framed=False).endswith(b"M30\n")


def test_reasons_are_counted_without_their_figures() -> None:
    reasons = {
        without_figures(reason)
        for reason in (
            "/tmp/x1/port was lost: 3 of 4,000.5",
            "/tmp/y/z/port was lost: 12 of 7",
            "LINE was lost: 1 of 2",
        )
    }
    assert reasons == {"LINE was lost: N of N"}


async def test_a_cable_marks_damage_and_takes_the_port_with_it_when_it_is_pulled(tmp_path: Path) -> None:
    path, ends, parted = tmp_path / "port", list[Closed](), asyncio.Event()

    async def control(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"\x11\xff\x12")
        await reader.read()
        writer.close()
        await writer.wait_closed()
        parted.set()

    listener = await asyncio.start_server(control, "127.0.0.1", 0)
    cable = Cable(path, marks=True)
    cable.plug()
    watching = asyncio.create_task(cable.watch())
    cable.join(listener.sockets[0].getsockname()[1], damage=[3])
    how = LineSettings(baud=19200, stopbits=1, window=48)
    line = open_tty(str(path), how, kernel=MarkedPort())
    engine = ListeningEngine()

    def note(item: object, now: Nanos) -> None:
        ends.extend([item] if isinstance(item, Closed) else [])

    driver = LineDriver(Link(engine, line, on_item=note))
    async with asyncio.timeout(20):
        await driver.run(lambda: bool(engine.faults))
        assert engine.received == b"\x11\xff"
        assert engine.faults == [(LineFault.PARITY, 0x12 ^ 0x04)]
        cable.unplug()
        await driver.run(lambda: bool(ends))
        await parted.wait()
    assert "was lost" in ends[0].reason
    assert not path.exists()
    line.close(0)
    watching.cancel()
    listener.close()
    await listener.wait_closed()
