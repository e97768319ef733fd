"""The host of protocol B when the last bytes, the last DC3 and the end of the source come close together (6.1.1)."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Outcome, Resumed
from tapewire.protocols.fanuc_b.host_law import SOURCE_POLL
from tests.protocols.fanuc_b.host_rig import DC1, DC3, NAK, PROGRAM, SYN, Rig


class _EndsLate(BytesIO):
    """Says so many times that it has nothing yet, before it says that there is no more."""

    def __init__(self, data: bytes, pauses: int) -> None:
        super().__init__(data)
        self.pauses = pauses

    def read(self, size: int | None = -1) -> Any:
        data = super().read(size)
        if not data and self.pauses:
            self.pauses -= 1
            return None
        return data


def ends_late(program: bytes, pauses: int, *, posting: str = "on", er: str = "shown") -> Rig:
    """A host at a source that ends `pauses` polls late. It has heard DC1 and sent everything."""
    rig = Rig(b"", posting=posting)
    if er == "shown":
        rig.see()
    rig.host.start(_EndsLate(program, pauses), 0)
    rig.hear(DC1)
    rig.take(len(program))
    return rig


def pass_polls(rig: Rig, count: int) -> None:
    for _ in range(count):
        rig.wait(SOURCE_POLL)


def held_with_its_last_bytes(*, posting: str, er: str, rest: int = 0, late: bool = False) -> Rig:
    """The first DC3 met ten bytes on their way, which have left since. `rest`: bytes still to be sent. `late`: the
    source says only later that there is no more.
    """
    rig = Rig(b"" if late else PROGRAM[: 8010 + rest], posting=posting)
    if late:
        rig.host.start(_EndsLate(PROGRAM[:8010], 3), 0)
    if er == "shown":
        rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(8000)
    rig.hand_over(10)
    rig.hear(DC3)
    rig.leave()
    return rig


@pytest.mark.parametrize(("posting", "seconds"), [("on", 0.5), ("off", 0)])
def test_6_1_1_7_a_second_dc3_behind_the_last_bytes_is_the_end(posting: str, seconds: float) -> None:
    """They were on their way when the first one came, and the control has read EOR with no DC1 between."""
    rig = held_with_its_last_bytes(posting=posting, er="shown")
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(round(seconds * SECOND))
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 8010)


def test_6_1_2_a_second_dc3_behind_the_last_bytes_and_syn_is_a_reset() -> None:
    rig = Rig(PROGRAM[:8010])
    rig.see()
    rig.hear(DC1)
    rig.hand_over(8010)
    rig.hear(DC3)
    rig.leave()
    rig.wait(SECOND)
    rig.hear(DC3 + SYN)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED


@pytest.mark.parametrize("then", ["nothing", "DC3", "NAK", "given up"])
@pytest.mark.parametrize("size", [8010, 8020])
def test_what_is_heard_behind_a_damaged_character_proves_no_more(then: str, size: int) -> None:
    """It may have been the DC3 of an alarm, which the ten bytes just before did not reach any more."""
    rig = Rig(PROGRAM[:size])
    rig.hear(DC1)
    rig.take_in_two_seconds(8000)
    rig.take(10)
    rig.host.receive_line_fault(LineFault.FRAMING, None, rig.now)
    rig.wait(8 * SECOND)
    if then == "given up":
        rig.host.abort(rig.now)
    else:
        rig.hear({"nothing": b"", "DC3": DC3, "NAK": DC3 + NAK}[then])
    rig.wait(60 * SECOND)
    if rig.end is None:
        assert (then, size) in [("nothing", 8010), ("DC3", 8020)], "it waits for the end, or is stopped"
        rig.host.abort(rig.now)
    assert rig.end is not None
    assert rig.end.outcome is not Outcome.COMPLETE
    assert rig.end.bytes_low == 8000


def test_a_dc1_behind_a_damaged_character_shows_that_the_control_goes_on() -> None:
    rig = Rig(PROGRAM[:8020])
    rig.hear(DC1)
    rig.take_in_two_seconds(8000)
    rig.take(10)
    rig.host.receive_line_fault(LineFault.FRAMING, None, rig.now)
    rig.wait(SECOND)
    rig.hear(DC1)
    rig.wait(SECOND)
    rig.host.abort(rig.now)
    assert rig.end is not None
    assert rig.end.bytes_low == 8010


def test_a_second_dc3_is_no_end_while_the_program_goes_on() -> None:
    rig = held_with_its_last_bytes(rest=10, posting="off", er="shown")
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.wait(60 * SECOND)
    assert rig.end is None
    rig.see(dsr=False)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


@pytest.mark.parametrize(("posting", "er"), [("off", "shown"), ("on", "not shown"), ("off", "not shown")])
@pytest.mark.parametrize("codes", [DC3, DC3 + DC3])
@pytest.mark.parametrize("late", [False, True])
def test_a_second_dc3_that_a_reset_may_have_sent_before_the_last_bytes_came_is_no_end(
    posting: str, er: str, codes: bytes, late: bool
) -> None:
    """Without posting a reset says DC3 too, and ER may be strapped: not complete, and no wait without end."""
    rig = held_with_its_last_bytes(posting=posting, er=er, late=late)
    rig.wait(SECOND // 1000)
    rig.hear(codes[:1])
    rig.wait(SECOND)
    rig.hear(codes[1:])
    for _ in range(5):
        rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.bytes_low <= 8000


@pytest.mark.parametrize(
    ("then", "outcome"),
    [("nothing", Outcome.COMPLETE), ("ER falls", Outcome.FAILED), ("the line closes", Outcome.FAILED)],
)
def test_with_posting_and_er_a_second_dc3_is_the_end_at_once_unless_the_control_hangs_up(
    then: str, outcome: Outcome
) -> None:
    """ER is ON until power-off where the control posts (6.1.2): where it falls, it was a reset of 6.4 (1)."""
    rig = held_with_its_last_bytes(posting="on", er="shown")
    rig.wait(SECOND // 1000)
    rig.hear(DC3)
    rig.wait(SECOND // 5)
    rig.see(dsr=then != "ER falls")
    if then == "the line closes":
        rig.host.receive_closed(Closure.ORDERLY, "test", rig.now)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is outcome
    assert outcome is Outcome.COMPLETE or rig.end.bytes_low <= 8000


def test_blind_the_source_is_asked_before_a_dc3_is_taken_for_a_reset() -> None:
    rig = ends_late(b"%\nM30\n%", 1, posting="off", er="not shown")
    rig.hear(DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("codes", [DC3, DC3 + DC3])
def test_6_1_1_7_the_last_dc3_comes_before_the_source_says_that_there_is_no_more(codes: bytes) -> None:
    rig = ends_late(b"%\nM30\n%", 3)
    rig.hear(codes)
    pass_polls(rig, 100)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 7)


@pytest.mark.parametrize("posting", ["on", "off"])
@pytest.mark.parametrize("polls", [50, 200])
def test_6_1_1_a_stop_that_was_heard_stays_one_however_late_the_source_ends(posting: str, polls: int) -> None:
    """Else the DC1 that follows it starts the next program, and the next stop leaves that one in the middle."""
    rig = ends_late(PROGRAM[:8000], polls, posting=posting)
    rig.wait(5 * MILLISECOND)
    rig.hear(DC3)
    pass_polls(rig, polls + 400)
    assert rig.end is None, "closing_time is 5 s"
    rig.hear(DC1)
    assert rig.of(Resumed)
    pass_polls(rig, 1000)
    assert rig.end is None
    rig.hear(DC3)
    pass_polls(rig, 100)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("posting", ["on", "off"])
def test_a_dc3_that_came_long_after_the_last_byte_is_the_end_however_late_the_source_ends(posting: str) -> None:
    rig = ends_late(PROGRAM[:8000], 200, posting=posting)
    rig.wait(SECOND + MILLISECOND)
    rig.hear(DC3)
    pass_polls(rig, 300)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("end", ["second DC3", "source"])
def test_the_wait_for_a_dc1_soon_is_over_where_the_read_ends(end: str) -> None:
    rig = ends_late(PROGRAM[:100], 160 if end == "source" else 5, er="not shown")
    rig.wait(200 * MILLISECOND)
    rig.hear(DC3)
    pass_polls(rig, 170)
    if end == "second DC3":
        rig.hear(DC3)
    pass_polls(rig, 300)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 100)


def test_the_wait_behind_a_damaged_character_is_over_where_the_read_ends() -> None:
    rig = held_with_its_last_bytes(posting="on", er="shown")
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    rig.wait(60 * SECOND - MILLISECOND)
    rig.hear(DC3)
    rig.wait(SECOND // 4)
    assert rig.end is None
    rig.wait(SECOND // 4)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_the_source_may_end_while_a_damaged_character_holds_the_host() -> None:
    """The DC3 behind it is the last one then, as it is when the damage comes after the last byte."""
    rig = ends_late(PROGRAM[:100], 5)
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    pass_polls(rig, 20)
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("how", ["abort", "lost"])
def test_what_left_just_before_the_last_dc3_is_not_certain_when_the_job_is_given_up_behind_it(how: str) -> None:
    rig = Rig(PROGRAM[:8000], posting="off")
    rig.hear(DC1)
    rig.take_in_two_seconds(7990)
    rig.take(10)
    rig.hear(DC3)
    rig.wait(3 * SECOND)
    if how == "abort":
        rig.host.abort(rig.now)
    else:
        rig.host.receive_closed(Closure.LOST, "test", rig.now)
    rig.wait(0)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (7990, 8000)


def stopped_right_behind_its_last_bytes(*, posting: str, er: str) -> Rig:
    """The stop met nothing on its way: the last ten bytes had left 1 ms before."""
    rig = Rig(PROGRAM[:8010], posting=posting)
    if er == "shown":
        rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(8000)
    rig.take(10)
    rig.wait(MILLISECOND)
    rig.hear(DC3)
    return rig


@pytest.mark.parametrize(("posting", "er"), [("off", "shown"), ("on", "not shown"), ("off", "not shown")])
@pytest.mark.parametrize("more", [1, 2])
def test_a_second_dc3_behind_a_stop_that_met_nothing_is_no_end_either(posting: str, er: str, more: int) -> None:
    rig = stopped_right_behind_its_last_bytes(posting=posting, er=er)
    for _ in range(more):
        rig.wait(MILLISECOND)
        rig.hear(DC3)
    rig.wait(5 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.bytes_low <= 8000


@pytest.mark.parametrize(("posting", "er"), [("off", "shown"), ("on", "not shown")])
def test_the_job_goes_on_where_a_dc1_follows_the_doubtful_dc3(posting: str, er: str) -> None:
    rig = stopped_right_behind_its_last_bytes(posting=posting, er=er)
    rig.hear(DC3)
    rig.wait(SECOND)
    rig.hear(DC1)
    rig.wait(60 * SECOND)
    assert rig.end is None
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 8010)


@pytest.mark.parametrize("posting", ["on", "off"])
@pytest.mark.parametrize("er", ["shown", "not shown"])
@pytest.mark.parametrize("after", [100 * MILLISECOND, SECOND, 4 * SECOND])
def test_6_1_1_7_the_end_behind_a_stop_that_met_nothing_is_the_end(posting: str, er: str, after: int) -> None:
    """The buffer filled with the last bytes, and the control has read EOR out of it."""
    rig = stopped_right_behind_its_last_bytes(posting=posting, er=er)
    rig.wait(after)
    rig.hear(DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, 8010)


@pytest.mark.parametrize("er", ["shown", "not shown"])
def test_a_doubled_last_dc3_of_a_program_that_filled_nothing_is_the_end(er: str) -> None:
    """The first of them cannot have been a stop."""
    rig = Rig(PROGRAM[:100])
    if er == "shown":
        rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3 + DC3)
    rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("held", ["in flight", "nothing in flight"])
@pytest.mark.parametrize("more", [1, 2, 3])
def test_a_further_dc3_takes_no_doubt_away(held: str, more: int) -> None:
    """ER falls behind it: it was a reset of 6.4 (1), posting or not."""
    if held == "in flight":
        rig = held_with_its_last_bytes(posting="on", er="shown")
    else:
        rig = stopped_right_behind_its_last_bytes(posting="on", er="shown")
    for _ in range(more):
        rig.wait(MILLISECOND)
        rig.hear(DC3)
    rig.wait(5 * MILLISECOND)
    rig.see(dsr=False)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.bytes_low <= 8000


@pytest.mark.parametrize("size", [4000, 8010])
@pytest.mark.parametrize("after", [90, 101, 300])
@pytest.mark.parametrize(("dc3_after", "outcome"), [(1, Outcome.CANCELLED), (150, Outcome.COMPLETE)])
def test_a_syn_proves_no_more_than_the_dc3_before_it(size: int, after: int, dc3_after: int, outcome: Outcome) -> None:
    rig = Rig(PROGRAM[:size], syn_at_end="complete")
    rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(size - 10)
    rig.hand_over(10)
    if size > 4000:
        rig.hear(DC3)
    rig.leave()
    rig.wait(dc3_after * MILLISECOND)
    rig.hear(DC3)
    rig.wait(after * MILLISECOND)
    rig.hear(SYN)
    assert rig.end is not None
    assert rig.end.outcome is outcome


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(("posting", "er"), [("off", "shown"), ("on", "not shown"), ("off", "not shown")])
@pytest.mark.parametrize("codes", [DC3, DC3 + DC3])
def test_a_dc3_behind_a_damaged_character_that_may_have_been_a_stop_is_no_end(
    late: bool, posting: str, er: str, codes: bytes
) -> None:
    rig = Rig(b"" if late else PROGRAM[:8010], posting=posting)
    if late:
        rig.host.start(_EndsLate(PROGRAM[:8010], 3), 0)
    if er == "shown":
        rig.see()
    rig.hear(DC1)
    rig.take_in_two_seconds(8000)
    rig.hand_over(10)
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    rig.leave()
    rig.wait(MILLISECOND)
    rig.hear(codes)
    for _ in range(6):
        rig.wait(SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.bytes_low <= 8000


@pytest.mark.parametrize(("posting", "outcome"), [("on", Outcome.FAILED), ("off", Outcome.COMPLETE)])
def test_6_1_2_what_comes_damaged_behind_the_last_dc3_may_have_been_syn_or_nak(posting: str, outcome: Outcome) -> None:
    """Where nothing is posted nothing is said there, so it was noise."""
    rig = Rig(PROGRAM[:100], posting=posting)
    rig.hear(DC1)
    rig.take_in_two_seconds(100)
    rig.wait(SECOND)
    rig.hear(DC3)
    rig.host.receive_line_fault(LineFault.FRAMING, None, rig.now)
    rig.leave()
    rig.wait(10 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is outcome
