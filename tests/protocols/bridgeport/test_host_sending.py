"""A program on its way to the control, and what makes its end doubtful: DSR, damage, a second answer, a pause."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Ended,
    LineFault,
    Notice,
    Outcome,
    Requested,
    SignalsIn,
    Started,
)
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.protocols.bridgeport.host_law import State
from tests.protocols.bridgeport.host_rig import (
    ACK,
    DC1,
    DC2,
    DC3,
    DC4,
    DLE,
    EOT,
    LINES,
    NAK,
    Books,
    Drawer,
    P,
    Rig,
    linked,
)


def outcome(rig: Rig) -> Outcome | None:
    rig.wait(3 * SECOND)
    return rig.end.outcome if rig.end is not None else None


def damage(rig: Rig, byte: int | None = 0x00) -> Rig:
    rig.host.receive_line_fault(LineFault.PARITY, byte, rig.now)
    rig.settle()
    return rig


# DSR falls where no program is under way


def dsr(rig: Rig, *levels: bool) -> None:
    for level in levels:
        rig.host.receive_signals(SignalsIn(dsr=level), rig.now)
    rig.settle()


@pytest.mark.parametrize("policy", Policy)
@pytest.mark.parametrize("back", [True, False])
def test_a_control_that_went_off_is_not_sent_what_it_waited_for(policy: Policy, back: bool) -> None:
    programs: dict[str | None, bytes] = {}
    rig = Rig(None)
    rig.host.serve(Books(programs), 0, policy=policy)
    dsr(rig, True)
    rig.name(b"42;L").say(DC1)
    dsr(rig, False, back)
    programs["42"] = P
    assert rig.wait(5 * SECOND).take() == b""
    assert rig.end is None
    assert any("not waited for any more" in event.text for event in rig.events if isinstance(event, Notice))
    dsr(rig, True)
    assert rig.name(b"42;L").say(DC1) == P + EOT, "what is armed stays armed"


def test_a_name_before_dsr_fell_is_none_behind_it() -> None:
    """Nothing tells a control that was switched on again from one whose DSR had a bad contact."""
    rig = linked()
    dsr(rig, True, False)
    rig.wait(60 * SECOND)
    dsr(rig, True)
    assert rig.say(DC1) == b""
    assert rig.of(Requested) == [Requested(served=False)]
    rig.say(DLE)
    assert rig.name(b"77;D").say(DC1).startswith(LINES[0])


def test_half_a_name_before_dsr_fell_is_none_either() -> None:
    rig = Rig()
    dsr(rig, True)
    rig.say(DC2)
    rig.say(b"77")
    dsr(rig, False, True)
    assert rig.say(b";D" + DC4) == b""
    assert rig.say(DC1) == b""
    assert rig.name(b"77;L").say(DC1) == P + EOT


def test_dsr_that_is_hidden_takes_nothing_away() -> None:
    rig = linked(er="hidden")
    dsr(rig, True, False)
    assert rig.say(DC1).startswith(LINES[0])


# 4.2.1, a second answer to the last record


@pytest.mark.parametrize("ending", ["eot_on_ack", "etx_last", "empty_then_eot"])
@pytest.mark.parametrize("handed", [True, False])
@pytest.mark.parametrize("held", [True, False])
def test_4_2_1_an_ack_and_a_nak_to_the_last_record_end_the_job(ending: str, handed: bool, held: bool) -> None:
    rig = linked(dnc_end=ending)
    rig.say(DC1)
    for _ in range(2 + (ending == "empty_then_eot")):
        rig.say(ACK)
    rig.hear(DC3 if held else b"", ACK)
    assert rig.host.state is State.TAIL
    if handed and not held:
        assert rig.hand_over() == EOT
    rig.hear(NAK, DC1)
    assert outcome(rig) is Outcome.FAILED
    assert rig.end is not None
    assert "by ACK and then by NAK" in rig.end.reason
    assert handed or rig.take() == b""


# what is certain


@pytest.mark.parametrize("left", [99, 100, 101])
def test_behind_damage_at_the_end_of_a_text_nothing_proves_more(left: int) -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    for _ in range(left):
        rig.take(1)
        rig.now += 1_150_000
    damage(rig).wait(SECOND // 2).hear(DLE)
    assert rig.end is not None
    assert rig.end.bytes_low == left - 86, "what had left 100 ms before the damage was heard"


def test_behind_damage_at_the_end_an_xon_takes_the_doubt_away_neither() -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.take()
    damage(rig).wait(SECOND // 2)
    rig.hear(DC1, DLE)
    assert rig.end is not None
    assert rig.end.bytes_low == 0


# 3.2, an XON that is still due


@pytest.mark.parametrize("times", [1, 2])
def test_an_xon_for_what_was_given_up_here_starts_nothing(times: int) -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.take(40)
    rig.hear(DC3)
    for _ in range(times):
        rig.host.abort(rig.now)
        rig.settle()
        rig.host.start(BytesIO(P), rig.now)
    assert rig.wait(SECOND).say(DC1) == b""
    assert rig.say(DC1) == P + EOT


def test_after_the_controls_own_cancel_no_xon_is_due() -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.take(40)
    rig.hear(DC3)
    rig.host.abort(rig.now)
    rig.settle()
    rig.host.start(BytesIO(P), rig.now)
    rig.hear(DLE)
    assert rig.end is not None
    assert rig.of(Ended)[1:] == []
    assert rig.say(DC1) == P + EOT


@pytest.mark.parametrize("listening", [True, False])
def test_an_xoff_that_came_damaged_at_the_end_has_its_xon_too(listening: bool) -> None:
    rig = Rig()
    rig.say(DC1)
    rig.wait(0 if listening else 1100 * MILLISECOND)
    damage(rig, 0x13).wait(SECOND if listening else 0)
    assert rig.end is not None
    rig.host.start(BytesIO(P), rig.now)
    assert rig.wait(SECOND // 2).say(DC1) == b""
    assert rig.say(DC1) == P + EOT


# 2, a source that has nothing yet


class Late:
    """A source that gives these pieces, None for *nothing yet*, and then no more."""

    def __init__(self, *pieces: bytes | None) -> None:
        self._pieces = list(pieces)

    def read(self, size: int) -> bytes | None:
        return self._pieces.pop(0) if self._pieces else b""


def late(word: bytes, *pieces: bytes | None, **settings: str) -> Rig:
    rig = Rig(None, **settings)
    rig.host.start(Late(*pieces), 0)
    return rig.name(word).hear(DC1)


@pytest.mark.parametrize("word", [b"77;L", b"77;D", b"77"])
@pytest.mark.parametrize("first_record", ["at_once", "on_ack"])
@pytest.mark.parametrize("dnc_end", ["eot_on_ack", "empty_then_eot"])
@pytest.mark.parametrize("answer", [b"", ACK, NAK])
@pytest.mark.parametrize("waits", [0, 1, 2])
@pytest.mark.parametrize("end", [b"", EOT])
def test_an_empty_program_sends_nothing_however_late_that_is_known(
    word: bytes, first_record: str, dnc_end: str, answer: bytes, waits: int, end: bytes
) -> None:
    rig = late(word, *[None] * waits, end, first_record=first_record, dnc_end=dnc_end)
    rig.hear(answer).wait(SECOND // 10)
    assert rig.take() == b""
    if rig.host.state is State.WAIT_ACK:
        rig.hear(ACK).wait(SECOND // 10)
    assert rig.take() == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.reason == "the program is empty: nothing was sent"


@pytest.mark.parametrize("waits", [0, 1, 3])
@pytest.mark.parametrize(("size", "by"), [(12000, "REMOTE LOAD"), (12001, "DNC LINK")])
def test_2_1_1_2_2_1_what_a_name_without_a_letter_wants_is_guessed_when_the_length_is_known(
    waits: int, size: int, by: str
) -> None:
    rig = late(b"77", *[None] * waits, b"X" * 6000, *[None] * waits, b"X" * (size - 6000))
    rig.wait(SECOND // 10)
    assert len(rig.take()) == (12001 if by == "REMOTE LOAD" else 258)
    assert [event.why for event in rig.events if isinstance(event, Started)] == [f"program 77 by {by}"]


def test_2_2_1_a_short_program_is_told_however_late_that_is_known() -> None:
    rig = late(b"77;D", None, b"X" * 300, None)
    rig.wait(SECOND // 10).take()
    rig.hear(ACK).wait(SECOND // 10).take()
    rig.hear(ACK).take()
    texts = [event.text for event in rig.events if isinstance(event, Notice)]
    assert texts == ["300 bytes by DNC LINK: 12,000 or less are for ;L (2.2.1)"]


def test_2_2_1_of_a_long_program_nothing_is_told_however_late() -> None:
    rig = late(b"77;D", None, b"X" * 6000, None, b"X" * 6001)
    said = b""
    while rig.end is None and (more := rig.wait(SECOND // 10).take()):
        said += more
        rig.hear(ACK)
    assert said.count(b"X") == 12001
    assert rig.of(Notice) == []


@pytest.mark.parametrize("word", [b"77;D", b"77"])
def test_4_2_1_the_first_ack_may_be_limited_too(word: bytes) -> None:
    rig = Rig(b"X" * 12001, first_record="on_ack", ack_limit="5").name(word)
    assert rig.say(DC1) == b""
    rig.wait(6 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "within 5 s" in rig.end.reason


# jobs one behind the other


def test_an_empty_program_for_one_that_is_missing_counts_no_byte_of_what_was_saved_before() -> None:
    rig = Rig(None, missing="eot")
    rig.host.serve(Books({}), 0, shelf=Drawer())
    rig.say(DC2)
    rig.hear(P + EOT, DC1)
    assert rig.take() == EOT
    rig.wait(3 * SECOND)
    ends = [(event.outcome, event.bytes_low, event.bytes_high) for event in rig.events if isinstance(event, Ended)]
    assert ends == [(Outcome.COMPLETE, 18, 18), (Outcome.FAILED, 0, 0)]


@pytest.mark.parametrize("recalled", [0, 2])
def test_of_two_jobs_that_end_in_one_breath_each_is_told(recalled: int) -> None:
    """What is still on its way when the second ends is called back, though none of it is of the second."""
    rig = Rig(None)
    rig.host.serve(Books({"1": P * 3, "2": P}), 0)
    rig.name(b"1;L").hear(DC1)
    assert len(rig.hand_over(3)) == 3
    rig.host.receive_data(DC2 + b"2;L" + DC4 + DC1 + DLE, rig.now)
    assert rig.host.recall
    rig.settle(recalled=recalled)
    assert not rig.host.recall
    assert rig.take() == b""
    ends = [(event.outcome, event.bytes_low, event.bytes_high) for event in rig.events if isinstance(event, Ended)]
    assert ends == [(Outcome.FAILED, 0, 3), (Outcome.CANCELLED, 0, 0)]
    assert len(rig.of(Started)) == 2


# damage while a program is under way


def nameless(**settings: str) -> Rig:
    rig = Rig(b"X" * 100, **settings)
    rig.hear(DC1)
    rig.take(40)
    return rig


@pytest.mark.parametrize("between", [b"", DC3])
def test_1_2_1_a_dc1_behind_damage_may_be_a_new_request_where_nothing_else_asks(between: bytes) -> None:
    """The control that cancelled, and asks for program -1 again, would get the rest of it and an end."""
    rig = damage(nameless()).wait(20 * SECOND)
    assert rig.hear(between).say(DC1) == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "a new request" in rig.end.reason
    assert (rig.end.bytes_low, rig.end.bytes_high) == (0, 40)
    assert rig.say(DC1) == b"", "nothing is armed any more"


def test_1_2_1_before_the_end_code_it_is_so_too() -> None:
    rig = nameless()
    rig.take(60)
    assert damage(rig).say(DC1) == b""
    assert outcome(rig) is Outcome.FAILED


@pytest.mark.parametrize("word", [b"77;L", b"77"])
def test_1_1_who_asks_by_a_name_goes_on_by_a_dc1(word: bytes) -> None:
    rig = Rig(b"X" * 100).name(word).hear(DC1)
    rig.take(40)
    assert damage(rig).say(DC1) == b"X" * 60 + EOT


@pytest.mark.parametrize("pause_limit", ["600", "0"])
def test_3_1_damage_in_a_pause_does_not_shorten_it(pause_limit: str) -> None:
    rig = linked(pause_limit=pause_limit).hear(DC1)
    rig.take(5)
    damage(damage(rig.hear(DC3))).wait(500 * SECOND)
    assert rig.end is None
    assert rig.say(DC1).startswith(LINES[0][5:])


def test_damage_upon_damage_has_its_limit() -> None:
    rig = damage(nameless())
    damage(rig.wait(50 * SECOND)).wait(59 * SECOND)
    assert rig.end is None
    rig.wait(SECOND)
    assert rig.end is not None


def test_3_2_an_ack_behind_which_damage_comes_is_not_believed_to_end_a_pause() -> None:
    rig = linked(xoff_ack_grace="1").hear(DC1)
    rig.take()
    damage(rig.hear(DC3, ACK)).wait(5 * SECOND)
    assert rig.take() == b""
    assert rig.say(DC1).startswith(LINES[1])


@pytest.mark.parametrize("recalled", [0, 1])
def test_4_3_2_what_was_cancelled_before_its_end_had_left_was_not_sent_whole(recalled: int) -> None:
    rig = Rig(b"X" * 100).hear(DC1)
    rig.take(100)
    assert rig.hand_over() == EOT
    rig.host.receive_data(DLE, rig.now)
    rig.settle(recalled=recalled)
    assert rig.end is not None
    assert rig.end.reason == "cancelled at the control (DLE)"


# 1.2, giving up while the control waits


@pytest.mark.parametrize("policy", Policy)
def test_what_is_given_up_here_is_not_waited_for(policy: Policy) -> None:
    rig = Rig(None)
    rig.host.serve(Books({}), 0, policy=policy)
    rig.name(b"9;L").say(DC1)
    rig.host.abort(rig.now)
    rig.settle()
    assert rig.host.state is State.REST
    assert rig.host.next_deadline() is None
    with pytest.raises(UsageError, match="waits for no program"):
        rig.host.answer(BytesIO(P), rig.now)
