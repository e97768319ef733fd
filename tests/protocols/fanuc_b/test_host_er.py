"""The host of protocol B where ER and posting decide what a DC3 and a DC1 mean (6.1.1, 6.4)."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Held,
    LineFault,
    Notice,
    Outcome,
    Requested,
    Started,
    Violation,
)
from tapewire.protocols.fanuc_b.host_law import DC4_LATE, SOURCE_POLL
from tests.protocols.fanuc_b.host_rig import DC1, DC3, DC3_ISO, PROGRAM, Rig


def test_6_4_1_without_posting_a_falling_er_ends_the_job() -> None:
    rig = Rig(posting="off")
    rig.see(dsr=False)
    rig.see()
    rig.hear(DC1)
    rig.take(8000)
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(SECOND)
    rig.see(dsr=False)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.FAILED, 8000)


@pytest.mark.parametrize("seen", ["ER first", "DC3 first"])
def test_6_1_1_7_er_falling_with_the_last_dc3_is_the_end(seen: str) -> None:
    rig = Rig(posting="off")
    rig.see()
    rig.hear(DC1)
    rig.take(len(PROGRAM))
    if seen == "DC3 first":
        rig.hear(DC3)
    rig.see(dsr=False)
    if seen == "ER first":
        rig.wait(SECOND // 20)
        assert rig.end is None
        rig.hear(DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("then", ["nothing", "ER comes back", "a damaged character"])
def test_an_er_that_falls_behind_the_last_byte_and_no_dc3_is_a_loss_of_power(then: str) -> None:
    """What left last may not have come any more."""
    rig = Rig(posting="off")
    rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(len(PROGRAM) - 10)
    rig.take(10)
    rig.see(dsr=False)
    if then == "ER comes back":
        rig.see()
    elif then == "a damaged character":
        rig.host.receive_line_fault(LineFault.PARITY, None, rig.now)
    rig.wait(SECOND // 10)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.FAILED, len(PROGRAM) - 10)


class LateEnd:
    """A source that says some times that it has nothing yet, and then what comes."""

    def __init__(self, *answers: bytes | None) -> None:
        self._answers = list(answers)

    def read(self, limit: int) -> bytes | None:
        return self._answers.pop(0) if self._answers else b""


@pytest.mark.parametrize("first", ["ER", "DC3"])
@pytest.mark.parametrize("pauses", [1, 2, 3, 5])
@pytest.mark.parametrize(("rest", "outcome"), [(b"", Outcome.COMPLETE), (b"M30\n%", Outcome.FAILED)])
def test_an_er_that_falls_while_the_source_is_late_asks_it_first(
    first: str, pauses: int, rest: bytes, outcome: Outcome
) -> None:
    rig = Rig(b"", posting="off")
    rig.host.start(LateEnd(b"%\nG01 X1.\n%", *[None] * pauses, rest), 0)
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    if first == "DC3":
        rig.hear(DC3)
    rig.see(dsr=False)
    if first == "ER":
        rig.hear(DC3)
    for _ in range(pauses):
        assert not rig.take(100)
        rig.wait(SOURCE_POLL)
    assert rig.end is not None
    assert rig.end.outcome is outcome
    assert not rig.take(100)


@pytest.mark.parametrize("first", ["ER", "DC3"])
def test_er_falls_with_the_last_dc3_behind_a_stop_that_met_the_last_bytes(first: str) -> None:
    rig = Rig(PROGRAM[:8010], posting="off")
    rig.see()
    rig.hear(DC1)
    rig.take(8000)
    rig.hand_over(10)
    rig.hear(DC3)
    rig.leave()
    rig.wait(60 * SECOND)
    if first == "ER":
        rig.see(dsr=False)
        rig.wait(MILLISECOND)
    rig.hear(DC3)
    if first == "DC3":
        rig.see(dsr=False)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("posting", ["on", "off"])
def test_er_that_falls_long_behind_a_dc3_that_may_be_a_stop_is_no_end(posting: str) -> None:
    """Its power went while it was stopped: the rest of its buffer is not read."""
    rig = Rig(PROGRAM[:8000], posting=posting)
    rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(7990)
    rig.take(10)
    rig.hear(DC3)
    rig.wait(2 * SECOND)
    rig.see(dsr=False)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.FAILED, 7990)


def test_dc1_between_er_off_and_the_dc3_that_does_not_come_draws_nothing() -> None:
    rig = Rig(b"", posting="off")
    rig.host.start(LateEnd(b"%\nG01 X1.\n", None, None, b"M30\n%"), 0)
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3)
    rig.see(dsr=False)
    rig.hear(DC1)
    assert not rig.take(100)
    rig.wait(SOURCE_POLL)
    rig.wait(SOURCE_POLL)
    assert not rig.take(100)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


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


@pytest.mark.parametrize(
    ("late_ms", "outcome"), [(5, Outcome.COMPLETE), (2000, Outcome.COMPLETE), (3100, Outcome.FAILED)]
)
def test_an_er_that_falls_with_the_dc4_waits_for_it(late_ms: int, outcome: Outcome) -> None:
    """6.1.1 2), 6.4 (1): a control line is seen at once, and the DC4 may still be in a FIFO, at 50 baud for seconds."""
    rig = Rig(b"", posting="off")
    rig.see()
    rig.host.receive(BytesIO(), 0)
    rig.hear(b"\x12%\nO1\n%")
    rig.see(dsr=False)
    rig.wait(late_ms * MILLISECOND)
    rig.hear(b"\x14")
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is outcome


@pytest.mark.parametrize("off_ms", [1, 50, 2000])
def test_an_er_that_comes_back_in_a_punch_out_begins_another(off_ms: int) -> None:
    """What follows would stand behind the cut program."""
    rig, sink = Rig(b"", data="binary", posting="off"), BytesIO()
    rig.see()
    rig.host.receive(sink, 0)
    rig.hear(b"\x12AAAA")
    rig.host.hold_reception(rig.now)
    rig.take(1)
    rig.wait(SECOND)
    rig.host.release(rig.now)
    rig.take(1)
    rig.hear(b"BB\x93")
    rig.see(dsr=False)
    rig.wait(off_ms * MILLISECOND)
    rig.see()
    rig.hear(b"\x12CCCC\x14")
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert sink.getvalue() == b"AAAABB"


def test_an_er_that_comes_on_in_the_middle_belongs_to_nobody_who_asked() -> None:
    """A control line may be told a little late at the start; seconds later it is another start of the control."""
    rig = Rig()
    rig.see(dsr=False)
    rig.hear(DC1)
    rig.wait(SECOND // 20)
    rig.see()
    assert rig.end is None
    late = Rig()
    late.see(dsr=False)
    late.hear(DC1)
    late.take(100)
    late.wait(SECOND)
    late.see()
    assert late.end is not None
    assert late.end.outcome is Outcome.FAILED
    assert not late.take(100)


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
    posting = Rig()
    posting.hear(DC1)
    assert [type(event) for event in posting.events] == [Requested, Notice, Started]
    seeing = Rig(posting="off")
    seeing.see()
    seeing.hear(DC1)
    assert not seeing.of(Notice)


@pytest.mark.parametrize("posting", ["on", "off"])
def test_a_dc3_while_the_last_bytes_are_on_their_way_is_no_end(posting: str) -> None:
    """Found by a reset at byte 150 of 190, which was reported as complete: EOR had not even arrived."""
    rig = Rig(b"%\nO1\nM30\n%", posting=posting)
    rig.see()
    rig.hear(DC1)
    rig.hand_over(100)
    rig.hear(DC3)
    rig.leave()
    rig.wait(60 * SECOND)
    assert rig.end is None
    rig.see(dsr=False)
    rig.wait(SECOND // 10)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


def test_with_posting_er_falls_at_power_off_only_so_without_the_last_dc3_it_is_no_end() -> None:
    rig = Rig(b"%\nO1\nM30\n%")
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.see(dsr=False)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


def test_a_dc1_while_sending_is_a_new_start_and_gets_nothing_unless_er_is_on() -> None:
    """A control that lost power, or does not post its reset, asks anew: it must not get the middle."""
    rig = Rig()
    rig.hear(DC1 + DC1)
    assert rig.of(Violation), "nothing had been sent: a doubled DC1"
    rig.take(100)
    rig.hear(DC1)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.take(10) == b""
    seeing = Rig()
    seeing.see()
    seeing.hear(DC1)
    seeing.take(100)
    seeing.hear(DC1)
    assert seeing.take(10) == PROGRAM[100:110]


def test_3_2_rs_off_from_the_start_is_told() -> None:
    rig = Rig()
    rig.see(cts=False)
    rig.hear(DC1)
    assert rig.take(10) == b""
    assert rig.of(Held) == [Held(why="the control's RS is OFF")]
    rig.see(cts=True)
    assert rig.take(10) == PROGRAM[:10]


def test_a_clean_dc3_after_a_damaged_character_is_an_ordinary_stop() -> None:
    rig = Rig(posting="off")
    rig.hear(DC1)
    rig.take(8000)
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    rig.hear(DC3)
    rig.wait(3600 * SECOND)
    assert rig.end is None
    rig.hear(DC1)
    assert rig.take(10) == PROGRAM[8000:8010]


@pytest.mark.parametrize("code", [b"\x93", b"\x95", b"\x96"])
def test_6_2_in_an_eia_punch_out_the_iso_codes_are_codes(code: bytes) -> None:
    """An even number of holes: no EIA character. Without posting a reset says DC3 (6.4 (1))."""
    rig = Rig(b"", data="eia", posting="off")
    sink = BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(b"\x12\x61\x62\x13\x15\x16" + code)
    assert rig.end is not None
    assert rig.end.outcome is not Outcome.COMPLETE
    assert sink.getvalue() == b"\x61\x62\x13\x15\x16"


@pytest.mark.parametrize(
    ("data", "punched", "stored"),
    [
        ("eia", b"\x61\x13", b"\x61"),
        ("eia", b"\x61\x13\x13", b"\x61\x13"),
        ("eia", b"\x61\x13\x62", b"\x61\x13\x62"),
        ("binary", b"a\x93", b"a"),
        ("binary", b"a\x13\x93b", b"a\x13\x93b"),
    ],
)
@pytest.mark.parametrize("end", ["cut", "whole"])
def test_6_4_1_a_last_character_that_may_be_dc3_is_stored_when_another_follows(
    data: str, punched: bytes, stored: bytes, end: str
) -> None:
    """Where ER falls behind it, it was the DC3 of a control that was reset."""
    for cut in range(1, len(punched) + 1):
        rig = Rig(b"", data=data, posting="off")
        sink = BytesIO()
        rig.see()
        rig.host.receive(sink, 0)
        rig.hear(b"\x12" + punched[:cut])
        rig.hear(punched[cut:] + (b"\x14" if end == "whole" else b""))
        rig.see(dsr=False)
        rig.wait(DC4_LATE)
        assert rig.end is not None
        assert rig.end.outcome is (Outcome.COMPLETE if end == "whole" else Outcome.FAILED)
        assert sink.getvalue() == (punched if end == "whole" else stored)
        assert rig.end.bytes_low == len(sink.getvalue())


def test_a_binary_punch_out_is_not_cut_where_our_own_pause_falls_on_a_14h() -> None:
    """The character behind it, which shows that it was data, comes only after our resume."""
    rig = Rig(b"", data="binary")
    sink = BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(b"\x12abc")
    rig.host.hold_reception(rig.now)
    assert rig.take(1) == DC3_ISO
    rig.hear(b"def\x14")
    rig.wait(3600 * SECOND)
    assert rig.end is None
    rig.host.release(rig.now)
    assert rig.take(1) == DC1
    rig.hear(b"ghi\x14")
    rig.wait(SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, sink.getvalue()) == (Outcome.COMPLETE, b"abcdef\x14ghi")


def test_with_posting_an_early_dc3_is_a_stop_if_dc1_follows_soon() -> None:
    rig = Rig(early_stop="2")
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3)
    assert rig.of(Held) == [Held(why="DC3")]
    assert rig.of(Notice)[-1] == Notice(text="DC3 before the buffer can have filled")
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


@pytest.mark.parametrize("er", ["auto", "hidden"])
def test_a_strapped_er_that_is_said_to_be_hidden_lets_no_dc1_pass_while_sending(er: str) -> None:
    """It is ON whatever the control does: the control that asks anew must not get the middle."""
    rig = Rig(er=er)
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC1)
    assert (rig.take(10) == b"") is (er == "hidden")
