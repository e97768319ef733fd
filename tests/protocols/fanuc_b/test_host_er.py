"""The host of protocol B where ER and posting decide what a DC3 and a DC1 mean (6.1.1, 6.4)."""

from __future__ import annotations

import pytest

from tapewire.engine import (
    SECOND,
    Held,
    Notice,
    Outcome,
    Requested,
    Started,
)
from tests.protocols.fanuc_b.host_rig import DC1, DC3, PROGRAM, Rig


def test_6_4_1_without_posting_a_falling_er_ends_the_job() -> None:
    rig = Rig(posting="off")
    rig.see(dsr=False)
    rig.see()
    rig.hear(DC1)
    rig.take(8000)
    rig.hear(DC3)
    rig.wait(SECOND)
    rig.see(dsr=False)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.FAILED, 8000)


def test_6_1_1_7_er_falling_after_the_last_byte_is_the_end() -> None:
    rig = Rig(posting="off")
    rig.see()
    rig.hear(DC1)
    rig.take(len(PROGRAM))
    rig.see(dsr=False)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_an_er_that_was_never_on_or_is_said_to_be_hidden_says_nothing() -> None:
    rig = Rig(posting="off")
    rig.see(dsr=False)
    rig.hear(DC1)
    rig.take(100)
    rig.see(dsr=False, cts=False)
    assert rig.end is None
    hidden = Rig(posting="off", er="hidden")
    hidden.see()
    hidden.hear(DC1)
    hidden.see(dsr=False)
    assert hidden.end is None


@pytest.mark.parametrize(("expansion", "first"), [(False, 7680), (True, 5632)])
def test_blind_a_dc3_before_the_buffer_can_have_filled_ends_the_job(expansion: bool, first: int) -> None:
    """Without posting and ER it may be a reset, and the next DC1 a start: it must not get the middle."""
    early = Rig(expansion=expansion, posting="off")
    early.hear(DC1)
    early.take(first - 1)
    early.hear(DC3)
    assert early.end is not None
    assert early.end.outcome is Outcome.FAILED
    assert "RESET the control and send again" in early.end.reason
    early.hear(DC1)
    assert early.take(10) == b""
    full = Rig(expansion=expansion, posting="off")
    full.hear(DC1)
    full.take(first)
    full.hear(DC3 + DC1)
    assert full.take(10) == PROGRAM[first : first + 10]


@pytest.mark.parametrize(("expansion", "refill"), [(False, 3584), (True, 1536)])
def test_blind_the_same_after_a_dc1(expansion: bool, refill: int) -> None:
    for count, ends in ((refill - 1, True), (refill, False)):
        rig = Rig(expansion=expansion, posting="off")
        rig.hear(DC1)
        rig.take(8000)
        rig.hear(DC3 + DC1)
        rig.take(count)
        rig.hear(DC3)
        assert (rig.end is not None) is ends


def test_blind_a_second_dc3_with_no_dc1_between_ends_the_job() -> None:
    rig = Rig(posting="off")
    rig.hear(DC1)
    rig.take(8000)
    rig.hear(DC3 + DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


def test_blind_the_risk_is_said_before_the_first_byte() -> None:
    rig = Rig(posting="off")
    rig.hear(DC1)
    assert [type(event) for event in rig.events] == [Requested, Notice, Started]
    seeing = Rig(posting="off")
    seeing.see()
    seeing.hear(DC1)
    assert not seeing.of(Notice)


def test_with_posting_an_early_dc3_is_a_stop_if_dc1_follows_soon() -> None:
    rig = Rig(early_stop="2")
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3)
    assert rig.of(Held) == [Held(why="DC3")]
    assert rig.of(Notice) == [Notice(text="DC3 before the buffer can have filled")]
    rig.wait(2 * SECOND - 1)
    rig.hear(DC1)
    assert rig.take(10) == PROGRAM[100:110]
    rig.wait(3600 * SECOND)
    assert rig.end is None


@pytest.mark.parametrize(("count", "codes"), [(100, DC3), (8000, DC3 + DC3)])
def test_with_posting_but_no_er_an_early_or_second_dc3_and_no_dc1_soon_fails(count: int, codes: bytes) -> None:
    """The control may not post at all; then this was a reset, and the next DC1 would be a start."""
    rig = Rig(early_stop="2")
    rig.hear(DC1)
    rig.take(count)
    rig.hear(codes)
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    rig.hear(DC1)
    assert rig.take(10) == b""


def test_with_er_visible_an_early_dc3_may_last() -> None:
    rig = Rig(early_stop="2")
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3)
    rig.wait(3600 * SECOND)
    rig.hear(DC1)
    assert rig.take(10) == PROGRAM[100:110]
