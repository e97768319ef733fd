"""What a DC1 means to the host of protocol B at each moment, and what one job must not leave to the next (6.1.1)."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import MILLISECOND, SECOND, LineFault, Outcome
from tests.protocols.fanuc_b.host_rig import DC1, DC3, PROGRAM, SYN, Rig

SMALL = b"%\nO1\nM30\n%"


@pytest.mark.parametrize("posting", ["on", "off"])
def test_a_dc1_behind_the_last_byte_with_no_stop_before_it_is_another_start(posting: str) -> None:
    """Its power went, and it was started again: it has nothing of the program."""
    rig = Rig(SMALL, posting=posting)
    rig.hear(DC1)
    rig.take(100)
    rig.wait(10 * SECOND)
    rig.hear(DC1)
    rig.wait(5 * SECOND)
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


def test_with_er_on_a_dc1_behind_the_last_byte_changes_nothing() -> None:
    rig = Rig(SMALL)
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.wait(10 * SECOND)
    rig.hear(DC1)
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_a_dc1_behind_a_stop_that_came_damaged_takes_the_doubt_away() -> None:
    rig = Rig(PROGRAM[:8000])
    rig.hear(DC1)
    rig.take(8000)
    rig.wait(10 * MILLISECOND)
    rig.host.receive_line_fault(LineFault.PARITY, 0x12, rig.now)
    rig.wait(20 * SECOND)
    rig.hear(DC1)
    rig.wait(60 * SECOND)
    rig.hear(DC3)
    rig.wait(6 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 8000)


def test_the_doubt_of_a_doubled_dc3_ends_with_dc1() -> None:
    rig = Rig(PROGRAM[:12000])
    rig.hear(DC1)
    rig.take(8000)
    rig.wait(10 * MILLISECOND)
    rig.hear(DC3 + DC3)
    rig.wait(SECOND)
    rig.hear(DC1)
    rig.take(4000)
    rig.wait(5 * SECOND)
    rig.host.receive_line_fault(LineFault.PARITY, 0x12, rig.now)
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(6 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_what_leaves_behind_dc1_fills_the_buffer_too() -> None:
    """A hundred characters stood still by RS OFF, and came behind the DC1."""
    rig = Rig()
    rig.hear(DC1)
    rig.take(7700)
    rig.wait(SECOND)
    rig.hand_over(100)
    rig.hear(DC3)
    rig.see(dsr=False, cts=False)
    rig.wait(5 * SECOND)
    rig.see(dsr=False)
    rig.hear(DC1)
    rig.leave()
    rig.take(3500)
    rig.hear(DC3)
    rig.wait(60 * SECOND)
    assert rig.end is None, "3600 characters have come since DC1: a stop"


def test_er_on_right_behind_the_first_resume_is_not_the_late_one_of_the_start() -> None:
    rig = Rig()
    rig.see(dsr=False)
    rig.hear(DC1)
    rig.take(8000)
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(30 * SECOND)
    rig.hear(DC1)
    rig.wait(5 * MILLISECOND)
    rig.see()
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


def test_nothing_counts_as_certain_by_the_job_before() -> None:
    rig = Rig(SMALL)
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    rig.events.clear()
    rig.host.start(BytesIO(SMALL), rig.now)
    rig.hear(DC1)
    rig.take(100)
    rig.wait(10 * MILLISECOND)
    rig.host.receive_line_fault(LineFault.PARITY, 0x12, rig.now)
    rig.hear(DC3)
    rig.wait(10 * MILLISECOND)
    rig.hear(SYN)
    assert rig.end is not None
    assert rig.end.bytes_low == 0


def test_no_program_goes_out_behind_characters_of_the_last_one() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(1000)
    rig.hand_over(200)
    rig.host.abort(rig.now)
    rig.recall(150)
    rig.wait(SECOND)
    assert rig.end is not None
    rig.events.clear()
    rig.host.start(BytesIO(SMALL), rig.now)
    rig.hear(DC1)
    assert not rig.hand_over(100)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "still on the line" in rig.end.reason


@pytest.mark.parametrize("data", ["ascii", "iso", "eia"])
@pytest.mark.parametrize(
    ("behind", "outcome"),
    [
        (b"", Outcome.COMPLETE),
        (b"\x00\x00", Outcome.COMPLETE),
        (b"Y2.\n%\x14", Outcome.FAILED),
        (b"\x14", Outcome.FAILED),
        (b"\x12Y2.\n%\x14", Outcome.COMPLETE),
    ],
)
def test_a_dc4_with_more_behind_it_is_no_end(data: str, behind: bytes, outcome: Outcome) -> None:
    """One bit makes 14h of 4 or T; behind a DC2 it is another punch-out, for which nobody listens."""
    rig, sink = Rig(b"", data=data), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(b"\x12G01X1\x14" + behind)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is outcome
    assert sink.getvalue() == b"G01X1"


def test_a_pause_that_is_asked_for_again_behind_dc4_stays_one() -> None:
    rig = Rig(b"", data="binary")
    rig.host.receive(BytesIO(), 0)
    rig.hear(b"\x12abc")
    rig.host.hold_reception(rig.now)
    assert rig.take(1)
    rig.hear(b"def\x14")
    rig.host.hold_reception(rig.now)
    assert not rig.take(1)
