"""The host's end: what is stray, what is damaged, how jobs end, and the law of every state and code."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Closure,
    LineFault,
    Notice,
    Outcome,
    Requested,
    SignalsIn,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.host_law import LAW, SENDING, Heard, State
from tapewire.protocols.bridgeport.records import Lrc, encode_record
from tests.protocols.bridgeport.host_rig import (
    ACK,
    DC1,
    DC2,
    DC3,
    DC4,
    DLE,
    EOT,
    ETB,
    LINES,
    P,
    Rig,
    in_state,
    linked,
    surfacing,
)

# stray XON, stray everything


def test_a_late_xoff_and_its_xon_after_the_end_start_nothing() -> None:
    rig = Rig()
    rig.say(DC1)
    rig.hear(DC3).wait(SECOND)
    assert rig.end is not None
    rig.host.start(BytesIO(P), rig.now)
    assert rig.wait(SECOND // 2).say(DC1) == b""
    assert len(rig.of(Requested)) == 1
    assert rig.say(DC1) == P + EOT


def test_a_late_xon_is_a_request_when_a_name_came_before_it() -> None:
    rig = Rig()
    rig.say(DC1)
    rig.hear(DC3).wait(SECOND)
    rig.host.start(BytesIO(P), rig.now)
    assert rig.name(b"1;L").say(DC1) == P + EOT


def test_after_two_seconds_an_xon_is_a_request_again() -> None:
    rig = Rig()
    rig.say(DC1)
    rig.hear(DC3).wait(4 * SECOND)
    rig.host.start(BytesIO(P), rig.now)
    assert rig.say(DC1) == P + EOT


def test_an_xoff_right_after_the_end_counts_too() -> None:
    rig = Rig()
    rig.say(DC1)
    rig.wait(1100 * MILLISECOND)
    assert rig.end is not None
    rig.hear(DC3)
    rig.host.start(BytesIO(P), rig.now)
    assert rig.say(DC1) == b""


def test_after_the_end_code_the_host_listens_for_a_cancel() -> None:
    rig = Rig()
    rig.say(DC1)
    rig.wait(900 * MILLISECOND).hear(DLE)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED
    assert rig.end.reason == "sent whole, then cancelled at the control (DLE)"


def test_while_it_listens_a_dc1_brings_nothing() -> None:
    rig = Rig()
    rig.say(DC1)
    assert rig.say(DC1) == b""
    assert rig.of(Requested)[1:] == [Requested(served=False)]


def test_it_listens_from_when_the_last_character_has_left() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.hand_over()
    assert rig.wait(5 * SECOND).end is None
    rig.leave()
    assert rig.wait(SECOND).end is not None


def test_a_new_transaction_ends_what_it_interrupts() -> None:
    rig = Rig(surfacing()).name(b"1;D")
    rig.hear(DC1)
    rig.take(100)
    assert rig.say(DC2) == DC1
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    rig.hear(b"1;D" + DC4)
    assert rig.say(DC1) == b"", "nothing is armed any more"


def test_a_new_transaction_after_the_end_code_completes_the_old() -> None:
    rig = Rig()
    rig.say(DC1)
    assert rig.say(DC2) == DC1
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


def test_a_new_transaction_before_the_end_code_has_left_does_not() -> None:
    """As on a line that is closed: what has not left, the control has not had."""
    rig = Rig()
    rig.hear(DC1)
    rig.hand_over()
    rig.hear(DC2)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


@pytest.mark.parametrize(("mode", "low", "high"), [(b"L", 0, 5), (b"D", 11, 18)])
def test_what_a_new_transaction_interrupts_is_told_as_of_any_other_job(mode: bytes, low: int, high: int) -> None:
    """Seven characters are under way when DC2 comes, and two of them are called back; DNC LINK counts them all."""
    rig = Rig(b"".join(LINES), record_bytes="12").name(b"1;" + mode)
    rig.hear(DC1)
    if low:
        rig.take(low + 2)
        rig.hear(ACK)
    assert len(rig.hand_over(7)) == 7
    rig.host.receive_data(DC2, rig.now)
    rig.settle(recalled=2)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (low, high)


def test_what_is_stored_counts_where_the_control_begins_anew_under_a_pause() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(DC2)
    rig.say(b"N10 G01 X10.\r\n" * 8)
    rig.host.hold_reception(rig.now)
    assert rig.hand_over() == DC3
    rig.hear(DC2)
    assert rig.end is not None
    assert rig.end.bytes_low == len(sink.getvalue()) > 0


@pytest.mark.parametrize("length", [9, 38, 64, 65, 500])
@pytest.mark.parametrize("anew", [True, False])
def test_1_1_what_is_longer_than_a_name_is_a_program_and_one_without_its_end_is_cut_short(
    length: int, anew: bool
) -> None:
    """The rest of it behind a DC2 out of noise is no program, though its end comes."""
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(DC2)
    rig.hear(b"N" * length)
    if anew:
        assert rig.say(DC2) == DC1
    else:
        rig.wait(31 * SECOND)
    rig.hear(b"the rest of it\r\n" + EOT).wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert ("began anew" if anew else "silence") in rig.end.reason
    assert sink.getvalue() == b"N" * length
    assert rig.end.bytes_low == rig.end.bytes_high == length


@pytest.mark.parametrize("begun", [b"1;", b"123456;L", b"123456;L\r\n", b"N10G0X0Y"])
def test_1_1_a_name_that_is_begun_anew_is_told_and_fails_nothing(begun: bytes) -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(DC2)
    rig.hear(begun)
    assert rig.say(DC2) == DC1
    assert len(rig.of(Violation)) == 1
    rig.name(b"1;L").say(DC2)
    rig.hear(P + EOT).wait(2 * SECOND)
    assert sink.getvalue() == P
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("length", [9, 500])
def test_a_cut_program_that_nobody_wants_ends_no_job(length: int) -> None:
    rig = Rig()
    rig.say(DC2)
    rig.hear(b"N" * length)
    rig.say(DC2)
    assert rig.end is None
    assert len(rig.of(Violation)) == 1


# what is not of the text: giving up, the line, damaged characters


@pytest.mark.parametrize("state", [State.RECEIVING, State.TEXT, State.RECORD, State.WAIT_ACK, State.TAIL])
def test_giving_up_sends_nothing_more(state: State) -> None:
    rig = in_state(state)
    rig.host.abort(rig.now)
    rig.settle()
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED
    assert rig.take() == b""
    assert rig.say(DC1) == b""
    assert rig.say(ACK) == b""


def test_only_one_job_at_a_time() -> None:
    with pytest.raises(UsageError, match="a job is under way"):
        Rig().host.start(BytesIO(P), 0)


@pytest.mark.parametrize("fault", list(LineFault))
@pytest.mark.parametrize("byte", [None, 0x11, 0x13, 0x91])
def test_a_damaged_character_is_obeyed_as_no_code_and_stops_us(fault: LineFault, byte: int | None) -> None:
    rig = Rig(b"X" * 100)
    rig.host.receive_line_fault(fault, byte, 0)
    assert rig.take() == b""
    rig.name(b"1;L").hear(DC1)
    rig.take(10)
    rig.host.receive_line_fault(fault, byte, rig.now)
    assert rig.take() == b""
    rig.settle()
    assert rig.say(DC1) == b"X" * 90 + EOT


def test_a_damaged_character_and_nothing_after_it_is_a_failure() -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.take(10)
    rig.host.receive_line_fault(LineFault.PARITY, None, rig.now)
    rig.wait(61 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED


@pytest.mark.parametrize(("resumed", "low"), [(b"", 0), (DC1, 10)])
def test_what_is_heard_behind_a_damaged_character_proves_no_more(resumed: bytes, low: int) -> None:
    """It may have been the end of the transfer, and what is heard two seconds later is said to nobody."""
    rig = Rig(b"X" * 100).name(b"1;L")
    rig.hear(DC1)
    rig.take(10)
    rig.host.receive_line_fault(LineFault.PARITY, None, rig.now)
    rig.wait(2 * SECOND)
    rig.hear(resumed)
    rig.hear(DC3)
    rig.hear(DLE)
    rig.settle()
    assert rig.end is not None
    assert rig.end.bytes_low == low


def test_4_2_1_what_may_have_been_the_answer_to_a_record_is_told_with_what_to_do() -> None:
    """No time limits the wait for an answer, so nothing else would say that both ends may wait for each other."""
    rig = linked()
    rig.say(DC1)
    assert rig.host.state is State.WAIT_ACK
    rig.host.receive_line_fault(LineFault.PARITY, 0x86, rig.now)
    rig.settle()
    texts = [event.text for event in rig.events if isinstance(event, Notice)]
    [notice] = [text for text in texts if "answer to a record" in text]
    assert notice.endswith("cancel at the control and ask again")
    assert rig.say(ACK), "and the answer, if it comes after all, is obeyed"


def test_an_xoff_after_a_damaged_character_is_a_pause_and_limited_as_one() -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.take(10)
    rig.host.receive_line_fault(LineFault.PARITY, None, rig.now)
    rig.hear(DC3)
    rig.wait(61 * SECOND)
    assert rig.end is None
    rig.wait(600 * SECOND)
    assert rig.end is not None
    assert "held by XOFF for longer than 600 s" in rig.end.reason


def test_a_parity_error_found_in_software_is_a_line_fault() -> None:
    rig = Rig(b"X" * 100, parity="software")
    rig.hear(DC1)
    rig.take(10)
    assert rig.say(b"\x13") == b"", "DC3 has odd parity without bit 8: it may have been anything, so we stop"
    assert len(rig.of(Violation)) == 1


@pytest.mark.parametrize(("er", "outcome"), [("auto", Outcome.FAILED), ("hidden", None)])
def test_a_control_that_goes_off_ends_the_job(er: str, outcome: Outcome | None) -> None:
    rig = linked(er=er)
    rig.host.receive_signals(SignalsIn(), rig.now)
    rig.say(DC1)
    rig.host.receive_signals(SignalsIn(dsr=False), rig.now)
    rig.settle()
    assert (rig.end and rig.end.outcome) == outcome


@pytest.mark.parametrize(
    ("state", "closure", "outcome"),
    [
        (State.TEXT, Closure.ORDERLY, Outcome.FAILED),
        (State.WAIT_ACK, Closure.LOST, Outcome.FAILED),
        (State.TAIL, Closure.ORDERLY, Outcome.COMPLETE),
        (State.TAIL, Closure.LOST, Outcome.FAILED),
        (State.SAVED, Closure.ORDERLY, Outcome.COMPLETE),
        (State.SAVED, Closure.LOST, Outcome.FAILED),
        (State.RECEIVING, Closure.ORDERLY, Outcome.FAILED),
    ],
)
def test_the_line_is_closed(state: State, closure: Closure, outcome: Outcome) -> None:
    rig = in_state(state)
    rig.host.receive_closed(closure, "unplugged", rig.now)
    rig.settle()
    assert rig.end is not None
    assert rig.end.outcome is outcome


class Slow:
    """A source that has nothing at every second call."""

    def __init__(self, data: bytes) -> None:
        self._data = BytesIO(data)
        self._turn = itertools.cycle([True, False])

    def read(self, size: int) -> bytes | None:
        return None if next(self._turn) else self._data.read(min(size, 100))


@pytest.mark.parametrize("word", [b"1;L", b"1;D"])
def test_a_source_that_is_slow_gives_the_same_program(word: bytes) -> None:
    rig = Rig(None)
    program = surfacing(11990)
    rig.host.start(Slow(program), 0)
    rig.name(word).hear(DC1)
    for _ in range(2000):
        rig.wait(10 * MILLISECOND)
        if rig.host.state in (State.RECORD, State.TEXT):
            rig.take()
        if rig.host.state is State.WAIT_ACK:
            rig.hear(ACK)
    rig.take()
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, len(program))


# the law


CHARACTER = {
    Heard.OPEN_WRITE: 0x12,
    Heard.REQUEST: 0x05,
    Heard.XON: 0x11,
    Heard.XOFF: 0x13,
    Heard.CANCEL: 0x10,
    Heard.ACK: 0x06,
    Heard.NAK: 0x15,
    Heard.END: 0x04,
    Heard.TEXT: ord("X"),
}


def pairs() -> Iterator[tuple[State, Heard]]:
    return itertools.product(State, Heard)


@pytest.mark.parametrize(("state", "heard"), list(pairs()), ids=lambda value: value.name)
def test_every_pair_of_state_and_code_is_a_row_or_changes_nothing(state: State, heard: Heard) -> None:
    """With a read request of its own, so that every character means one thing."""
    rig = in_state(state, read_request="05")
    deadline = rig.host.next_deadline()
    rig.host.receive_data(bytes([CHARACTER[heard]]), rig.now)
    if (state, heard) in LAW:
        assert rig.host.state in LAW[state, heard]
        return
    assert rig.host.state is state
    assert rig.host.next_deadline() == deadline or state is State.RECEIVING
    silent = state not in SENDING and heard in (Heard.ACK, Heard.NAK, Heard.XOFF, Heard.END)
    rig.settle()
    assert bool(rig.of(Violation)) is not (silent or state is State.RECEIVING)


def test_the_pairs_without_a_row_are_these() -> None:
    ignored: dict[State, set[Heard]] = {}
    for state, heard in pairs():
        if (state, heard) not in LAW:
            ignored.setdefault(state, set()).add(heard)
    everything_else = {Heard.REQUEST, Heard.ACK, Heard.NAK, Heard.END, Heard.TEXT}
    assert ignored == {
        State.REST: {Heard.XON, Heard.ACK, Heard.NAK},
        State.RECEIVING: {Heard.REQUEST, Heard.ACK, Heard.NAK, Heard.TEXT},
        State.SAVED: {Heard.XON, Heard.XOFF, Heard.ACK, Heard.NAK},
        State.HOLD: {Heard.XON, Heard.XOFF, Heard.ACK, Heard.NAK, Heard.END, Heard.TEXT},
        State.TEXT: everything_else - {Heard.NAK, Heard.ACK},
        State.TAIL: everything_else - {Heard.NAK, Heard.ACK},
        State.RECORD: {Heard.REQUEST, Heard.END, Heard.TEXT},
        State.WAIT_ACK: {Heard.REQUEST, Heard.END, Heard.TEXT},
    }


CODES = st.sampled_from(list(b"\x11\x12\x13\x14\x15\x10\x06\x04\x03\x17\x00X1;LD\r\n\x91\x93"))


@given(
    noise=st.lists(CODES | st.integers(0, 255), max_size=80).map(bytes),
    cut=st.integers(0, 80),
    state=st.sampled_from(State),
)
def test_any_cutting_gives_the_same(noise: bytes, cut: int, state: State) -> None:
    whole, parts = in_state(state), in_state(state)
    whole.host.receive_data(noise, whole.now)
    parts.host.receive_data(noise[:cut], parts.now)
    parts.host.receive_data(noise[cut:], parts.now)
    assert parts.host.next_deadline() == whole.host.next_deadline()
    assert parts.host.state == whole.host.state
    whole.settle()
    parts.settle()
    assert parts.take() == whole.take()
    assert parts.events == whole.events


@given(
    noise=st.lists(st.tuples(CODES, st.integers(0, 40), st.integers(0, 5)), max_size=40), state=st.sampled_from(State)
)
def test_whatever_comes_there_is_no_deadline_in_the_past_and_silence_leads_to_rest(
    noise: list[tuple[int, int, int]], state: State
) -> None:
    rig = in_state(state)
    for byte, count, seconds in noise:
        rig.hear(bytes([byte]))
        rig.take(count)
        rig.wait(seconds * SECOND)
    rig.take()
    rig.wait(2000 * SECOND)
    assert rig.host.next_deadline() is None


def test_lrc_of_a_record_is_what_encode_puts_there() -> None:
    assert encode_record(LINES[0], 0x17, Lrc.XOR7_ETB) == LINES[0] + ETB + b"\x33"
