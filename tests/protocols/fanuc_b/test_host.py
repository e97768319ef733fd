"""The host's end of protocol B, clause by clause: what it says to each code in each state."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Closure,
    Ended,
    Held,
    LineFault,
    Notice,
    Outcome,
    Received,
    Requested,
    Resumed,
    Started,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.host_law import LAW, State
from tapewire.protocols.fanuc_b.messages import ControlCode
from tests.contract.rig import drain
from tests.protocols.fanuc_b.host_rig import DC1, DC3, DC3_ISO, NAK, NAK_ISO, PROGRAM, SYN, SYN_ISO, Rig


def test_6_1_1_1_nothing_is_sent_before_dc1() -> None:
    rig = Rig()
    assert rig.take(100) == b""
    rig.hear(DC1)
    assert rig.take(100) == PROGRAM[:100]
    assert rig.of(Requested) == [Requested(served=True)]
    assert len(rig.of(Started)) == 1


@pytest.mark.parametrize("stop", [DC3, DC3_ISO])
def test_6_1_1_4_dc3_in_either_form_stops_at_once_and_6_dc1_goes_on_with_the_next_byte(stop: bytes) -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(8000)
    rig.hear(stop)
    assert rig.take(100) == b""
    assert rig.of(Held) == [Held(why="DC3")]
    rig.wait(3600 * SECOND)
    assert rig.take(100) == b""
    rig.hear(DC1)
    assert rig.take(100) == PROGRAM[8000:8100]
    assert rig.of(Resumed) == [Resumed(why="DC1")]


def test_a_stop_between_any_two_bytes_loses_and_doubles_nothing() -> None:
    program = b"%\nO1\nM30\n%"
    for stop in range(1, len(program)):
        rig = Rig(program)
        rig.hear(DC1)
        rig.take(stop)
        rig.hear(DC3)
        assert rig.take(100) == b""
        rig.hear(DC1)
        rig.take(100)
        assert rig.said == program


def test_6_1_1_7_after_the_last_byte_a_dc3_that_cannot_be_a_stop_is_the_end() -> None:
    rig = Rig(b"%\nO1\nM30\n%", posting="off")
    rig.hear(DC1)
    rig.take(100)
    assert rig.end is None
    rig.hear(DC3)
    assert rig.end == Ended(
        outcome=Outcome.COMPLETE, reason="the control has read the whole program", bytes_low=10, bytes_high=10
    )


def test_6_1_2_7_with_posting_the_host_waits_whether_syn_or_nak_follows_the_last_dc3() -> None:
    rig = Rig(b"%\nO1\nM30\n%")
    rig.hear(DC1)
    rig.take(100)
    rig.hear(DC3)
    assert rig.end is None
    rig.wait(500 * MILLISECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_after_the_last_byte_a_dc3_that_can_be_a_stop_waits_the_closing_time_for_dc1() -> None:
    rig = Rig(posting="off", closing_time="7")
    rig.hear(DC1)
    rig.take(len(PROGRAM))
    rig.hear(DC3)
    rig.wait(6 * SECOND)
    rig.hear(DC1)
    assert rig.of(Resumed)
    rig.wait(3600 * SECOND)
    assert rig.end is None
    rig.hear(DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_after_the_closing_time_the_job_is_complete() -> None:
    rig = Rig(closing_time="7")
    rig.hear(DC1)
    rig.take(len(PROGRAM))
    rig.hear(DC3)
    rig.wait(7 * SECOND - 1)
    assert rig.end is None
    rig.wait(1)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, len(PROGRAM))


def test_a_dc3_long_after_the_last_byte_is_no_stop_since_no_character_drew_it() -> None:
    rig = Rig(posting="off", closing_time="3600")
    rig.hear(DC1)
    rig.take(len(PROGRAM))
    rig.wait(2 * SECOND)
    rig.hear(DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        (SYN, Outcome.CANCELLED),
        (SYN_ISO, Outcome.CANCELLED),
        (NAK, Outcome.FAILED),
        (NAK_ISO, Outcome.FAILED),
    ],
)
def test_6_1_2_7_dc3_and_syn_or_nak_end_the_job_with_the_byte_count(code: bytes, outcome: Outcome) -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(5000)
    rig.wait(100 * MILLISECOND)
    rig.hand_over(60)
    rig.hear(DC3 + code)
    assert rig.end is None, "something is still on its way"
    rig.recall(40)
    assert rig.end is None
    rig.leave()
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low, rig.end.bytes_high) == (outcome, 5000, 5020)
    rig.hear(DC1)
    assert rig.take(100) == b""
    assert rig.of(Requested)[-1] == Requested(served=False)


def test_6_1_2_7_syn_without_its_dc3_ends_the_job_too() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(100)
    rig.hear(SYN)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED


@pytest.mark.parametrize("codes", [DC3 + SYN, SYN, DC3 + NAK])
def test_a_reset_or_alarm_after_the_last_byte_is_sent_whole_not_executed(codes: bytes) -> None:
    rig = Rig(b"%\nO1\nM30\n%")
    rig.hear(DC1)
    rig.take(100)
    rig.hear(codes)
    assert rig.end is not None
    assert rig.end.outcome is not Outcome.COMPLETE
    assert rig.end.reason.startswith("sent whole, not executed")
    assert rig.end.bytes_high == 10


@pytest.mark.parametrize(("wait_ms", "outcome"), [(200, Outcome.COMPLETE), (50, Outcome.CANCELLED)])
def test_where_m30_resets_the_control_a_syn_after_the_last_byte_can_be_set_to_complete(
    wait_ms: int, outcome: Outcome
) -> None:
    """What left in the 100 ms before may not have come when the control was reset."""
    rig = Rig(b"%\nO1\nM30\n%", syn_at_end="complete")
    rig.hear(DC1)
    rig.take(100)
    rig.wait(wait_ms * MILLISECOND)
    rig.hear(DC3 + SYN)
    assert rig.end is not None
    assert rig.end.outcome is outcome


def test_3_2_rs_off_stops_and_rs_on_goes_on() -> None:
    rig = Rig()
    rig.see()
    rig.hear(DC1)
    rig.take(100)
    rig.see(cts=False)
    assert rig.take(100) == b""
    rig.see(cts=True)
    assert rig.take(100) == PROGRAM[100:200]
    assert [type(event) for event in rig.events[-2:]] == [Held, Resumed]


def test_6_1_2_idle_syn_and_nak_are_told_and_change_nothing() -> None:
    rig = Rig()
    rig.hear(SYN + NAK)
    assert len(rig.of(Notice)) == 2
    rig.hear(DC1)
    assert rig.take(10) == PROGRAM[:10]


def test_a_request_with_nothing_armed_gets_nothing_and_is_told() -> None:
    rig = Rig(b"")
    rig.hear(DC1)
    assert rig.take(100) == b""
    assert rig.of(Requested) == [Requested(served=False)]


def test_what_left_just_before_a_reset_was_heard_is_not_certain() -> None:
    """The control may have said it earlier than it is heard, and dropped what came in between."""
    rig = Rig()
    rig.hear(DC1)
    rig.take(500)
    rig.wait(60 * MILLISECOND)
    rig.take(300)
    rig.wait(60 * MILLISECOND)
    rig.take(200)
    rig.hear(DC3 + SYN)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (500, 1000)


def test_what_left_after_a_stop_is_not_certain_until_dc1_shows_that_it_was_one() -> None:
    """Blind, a reset after the buffer may have filled looks like a stop; the control dropped what came behind it."""
    rig = Rig(posting="off")
    rig.hear(DC1)
    rig.take(8000)
    rig.wait(SECOND)
    rig.hand_over(40)
    rig.hear(DC3)
    rig.leave()
    rig.wait(60 * SECOND)
    rig.host.abort(rig.now)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (8000, 8040)


def test_abort_calls_back_what_has_not_left_and_sends_no_eor() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(1000)
    rig.wait(SECOND)
    rig.hand_over(200)
    rig.host.abort(rig.now)
    assert rig.host.data_to_send(100) == b""
    rig.recall(150)
    rig.leave()
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low, rig.end.bytes_high) == (Outcome.CANCELLED, 1000, 1050)


def test_abort_on_a_stuck_line_says_between_which_two_counts_the_control_stands() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(1000)
    rig.wait(SECOND)
    rig.hand_over(200)
    rig.host.abort(rig.now)
    rig.recall(150)
    rig.wait(SECOND)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (1000, 1050)


@pytest.mark.parametrize(
    ("said", "closure", "outcome"),
    [
        (DC3, Closure.ORDERLY, Outcome.COMPLETE),
        (DC3, Closure.LOST, Outcome.FAILED),
        (b"", Closure.ORDERLY, Outcome.FAILED),
    ],
)
def test_the_line_closed_behind_the_last_dc3_counts_as_er_off(said: bytes, closure: Closure, outcome: Outcome) -> None:
    """On one stream nothing overtakes that DC3: where none came, nobody has said the end."""
    rig = Rig(b"%\nO1\nM30\n%")
    rig.hear(DC1)
    rig.take(100)
    rig.hear(said)
    rig.host.receive_closed(closure, "test", rig.now)
    rig.leave()
    assert rig.end is not None
    assert rig.end.outcome is outcome


def test_the_line_closed_in_the_middle_fails_with_both_counts() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(900)
    rig.wait(SECOND)
    rig.take(100)
    rig.hand_over(200)
    rig.host.receive_closed(Closure.ORDERLY, "test", rig.now)
    rig.events += drain(rig.host)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low, rig.end.bytes_high) == (Outcome.FAILED, 900, 1200)


def test_a_damaged_character_stops_the_sending_and_is_never_taken_for_dc1() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(100)
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    assert rig.take(100) == b""
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    assert rig.take(100) == b""
    rig.hear(DC1)
    assert rig.take(100) == PROGRAM[100:200]
    assert rig.end is None


def test_a_damaged_character_and_nothing_after_it_fails_after_the_wait() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(8000)
    rig.hear(DC3)
    rig.host.receive_line_fault(LineFault.FRAMING, None, rig.now)
    rig.wait(60 * SECOND - 1)
    assert rig.end is None
    rig.wait(1)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


class Hesitant:
    """A source that has nothing yet on every other call."""

    def __init__(self, data: bytes) -> None:
        self._data, self._calls = data, 0

    def read(self, size: int) -> bytes | None:
        self._calls += 1
        if self._calls % 2:
            return None
        piece, self._data = self._data[:3], self._data[3:]
        return piece


def test_a_source_that_is_late_is_waited_for() -> None:
    program = b"%\nO1\nM30\n%"
    rig = Rig(b"", posting="off")
    rig.host.start(Hesitant(program), 0)
    rig.hear(DC1)
    for _ in range(10):
        rig.wait(10 * MILLISECOND)
        rig.take(100)
    assert rig.said == program
    rig.hear(DC3)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("stop", [DC3, DC3_ISO])
def test_6_4_1_dc3_inside_a_punch_out_is_its_end_before_its_time(stop: bytes) -> None:
    """Without posting a control that is reset says no more than DC3; no character of text looks like it."""
    rig = Rig(b"")
    rig.host.receive(BytesIO(), 0)
    rig.hear(b"\x12O0001\n" + stop)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.FAILED, 6)


def test_a_damaged_character_of_a_punch_out_is_stored_and_told() -> None:
    rig, sink = Rig(b""), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(b"\x12%\nO1")
    rig.host.receive_line_fault(LineFault.PARITY, 0x41, rig.now)
    rig.hear(b"X1\n%\x14")
    told = sum(event.count for event in rig.of(Received) if isinstance(event, Received))
    assert (sink.getvalue(), told) == (b"%\nO1AX1\n%", 9)


def test_one_job_at_a_time() -> None:
    rig = Rig()
    with pytest.raises(UsageError, match="a job is under way"):
        rig.host.start(BytesIO(b"x"), 0)
    with pytest.raises(UsageError, match="a job is under way"):
        rig.host.receive(BytesIO(), 0)


LISTENING = {State.LISTENING: b"", State.RECEIVING: b"\x12", State.AFTER_DC4: b"\x12O1\x14"}


def bring_to(state: State) -> Rig:
    """A host in `state`."""
    rig = Rig(b"" if state is State.IDLE or state in LISTENING else PROGRAM)
    match state:
        case State.LISTENING | State.RECEIVING | State.AFTER_DC4:
            rig.host.receive(BytesIO(), 0)
            rig.hear(LISTENING[state])
        case State.IDLE | State.ARMED:
            pass
        case _:
            rig.hear(DC1)
            rig.take(len(PROGRAM) if state in (State.DELIVERED, State.CLOSING) else 8000)
            if state in (State.HELD, State.CLOSING):
                rig.hear(DC3)
            if state is State.LEAVING:
                rig.hand_over(10)
                rig.host.abort(rig.now)
    assert rig.host.state is state
    rig.events.clear()
    return rig


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("code", ControlCode)
def test_law_every_pair_has_a_row_or_is_a_violation_that_changes_nothing(state: State, code: ControlCode) -> None:
    rig, row = bring_to(state), LAW.get((state, code))
    print(f"{state.value:10} {code.name}  {' | '.join(sorted(after.value for after in row)) if row else 'violation'}")
    before = (rig.host.next_deadline(), rig.host.progress)
    rig.hear(bytes([code.value]))
    if row is not None:
        assert rig.host.state in row
    elif row is None:
        assert (rig.host.state, rig.host.next_deadline(), rig.host.progress) == (state, *before)
        assert state is State.LEAVING or rig.of(Violation)
