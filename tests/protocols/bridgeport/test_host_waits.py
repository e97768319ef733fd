"""Requests that cannot be served at once (1.2): a number that is not there, a name that came damaged."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import SECOND, Ended, LineFault, Notice, Outcome, Requested, Started, Violation
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
    LINK,
    NAK,
    Books,
    Drawer,
    P,
    Rig,
    linked,
)


def waiting(policy: Policy = Policy.ONCE, **settings: str) -> tuple[Rig, dict[str | None, bytes]]:
    """A control that waits for program 42, and the shelf it could come from."""
    programs: dict[str | None, bytes] = {}
    rig = Rig(None, **settings)
    rig.host.serve(Books(programs), 0, policy=policy)
    assert rig.name(b"42;L").say(DC1) == b""
    assert rig.host.state is State.HOLD
    return rig, programs


# 1.2, the program comes while the control waits


@pytest.mark.parametrize("policy", Policy)
def test_a_program_that_appears_while_the_control_waits_is_sent(policy: Policy) -> None:
    rig, programs = waiting(policy)
    rig.wait(30 * SECOND)
    assert rig.take() == b""
    programs["42"] = P
    rig.wait(SECOND)
    assert rig.take() == P + EOT
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE
    assert [event.why for event in rig.events if isinstance(event, Started)] == ["program 42 by REMOTE LOAD"]


def test_another_program_that_appears_is_not_what_it_waits_for() -> None:
    rig, programs = waiting()
    programs |= {"43": P, None: P}
    rig.wait(60 * SECOND)
    assert rig.take() == b""


def test_after_the_limit_it_is_not_looked_for_any_more() -> None:
    rig, programs = waiting(hold_limit="5")
    rig.wait(6 * SECOND)
    programs["42"] = P
    rig.wait(60 * SECOND)
    assert rig.take() == b""
    assert rig.host.next_deadline() is None
    assert rig.end is not None
    assert "nobody gave program 42 within 5 s" in rig.end.reason


@pytest.mark.parametrize("pair", [DLE, DC3 + DLE, DLE + EOT, DLE + DLE])
def test_cancelled_while_it_waits_nothing_is_sent_when_the_program_appears(pair: bytes) -> None:
    rig, programs = waiting(Policy.STANDING)
    rig.say(pair)
    programs["42"] = P
    rig.wait(60 * SECOND)
    assert rig.take() == b""
    assert rig.host.state is State.REST
    assert rig.name(b"42;L").say(DC1) == P + EOT


def test_given_up_here_nothing_is_sent_when_the_program_appears() -> None:
    rig, programs = waiting()
    rig.host.abort(rig.now)
    programs["42"] = P
    rig.wait(60 * SECOND)
    assert rig.take() == b""
    assert rig.host.next_deadline() is None


def test_the_operator_who_presses_enter_twice_gets_one_program() -> None:
    rig, programs = waiting()
    assert rig.say(DC1 + DC1) == b""
    programs["42"] = P
    rig.wait(SECOND)
    assert rig.take() == P + EOT
    assert rig.say(DC1) == b""
    rig.wait(10 * SECOND)
    assert rig.take() == b""
    assert len(rig.of(Ended)) == 1


def test_a_wrong_number_and_then_the_right_one() -> None:
    rig, programs = waiting(Policy.STANDING)
    programs["24"] = LINK
    assert rig.name(b"24;L").say(DC1) == LINK + EOT
    programs["42"] = P
    rig.wait(10 * SECOND)
    assert rig.take() == b""


def test_what_is_saved_while_it_waited_is_not_saved_under_the_number_it_waited_for() -> None:
    rig, drawer = Rig(None), Drawer()
    rig.host.serve(Books({}), 0, shelf=drawer)
    rig.name(b"42;L").say(DC1)
    assert rig.say(DC2) == DC1
    rig.say(P + EOT + DC4)
    assert drawer.programs[None].getvalue() == P
    assert set(drawer.programs) == {None}


# 1.1, a name that came damaged is no name


@pytest.mark.parametrize("byte", [0xB6, None])
@pytest.mark.parametrize("letter", [b"L", b"D"])
def test_a_damaged_name_gets_no_program_though_it_looks_like_one(byte: int | None, letter: bytes) -> None:
    """7 with one wrong bit is 6, and L is D."""
    rig = Rig(None)
    rig.host.serve(Books({"67": P, "7": P, "77": P, None: P}), 0, policy=Policy.ONCE)
    rig.say(DC2)
    rig.host.receive_line_fault(LineFault.PARITY if byte else LineFault.UART_OVERRUN, byte, rig.now)
    assert rig.say(b"7;" + letter + DC4) == b""
    assert rig.say(DC1) == b""
    assert rig.say(DC1) == b""
    assert rig.host.state is State.REST
    assert rig.of(Requested) == [Requested(served=False)] * 2
    assert any("its name came damaged" in event.text for event in rig.events if isinstance(event, Notice))
    rig.say(DC3 + DLE)
    assert rig.of(Ended) == []
    assert rig.name(b"77;L").say(DC1) == P + EOT


def test_a_damaged_name_does_not_serve_the_one_armed_program_either() -> None:
    rig = Rig(P, parity="software")
    rig.say(b"\x12")
    assert rig.say(b"1;D" + b"\x14") == b"", "1 has an odd number of ones"
    assert rig.say(b"\x11") == b""
    assert rig.of(Ended) == []


def test_what_is_saved_under_a_damaged_name_has_no_number() -> None:
    rig, drawer = Rig(None), Drawer()
    rig.host.serve(None, 0, shelf=drawer)
    rig.say(DC2)
    rig.host.receive_line_fault(LineFault.PARITY, 0x36, rig.now)
    rig.say(b"7;L" + DC4)
    assert rig.say(DC2) == DC1
    rig.say(P + EOT)
    assert {number: sink.getvalue() for number, sink in drawer.programs.items()} == {None: P}


# a name that is none, and a start that is none


def test_an_unusual_name_is_served_as_its_length_asks_for() -> None:
    for program, first in ((P, P + EOT), (b"N1\r\n" * 4000, b"N1\r\n" * 64)):
        rig = Rig(program).name(b"A77;D")
        assert rig.say(DC1).startswith(first)


@pytest.mark.parametrize(("word", "low"), [(b"A77;D", 0), (b"77;L", len(P))])
def test_2_1_2_without_its_letter_nothing_is_certain_to_be_with_the_control(word: bytes, low: int) -> None:
    """It may have asked for DNC LINK, and then keeps nothing that is not of a record."""
    rig = Rig().name(word)
    assert rig.say(DC1) == P + EOT
    rig.now += SECOND // 2
    rig.hear(DLE)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low, rig.end.bytes_high) == (Outcome.CANCELLED, low, len(P))


@pytest.mark.parametrize("answer", [ACK, NAK])
@pytest.mark.parametrize("count", [0, 7, len(P), 100])
def test_2_1_2_an_answer_to_a_guessed_text_says_that_records_were_wanted(answer: bytes, count: int) -> None:
    rig = Rig().name(b"A77;D").hear(DC1)
    said = rig.take(count)
    rig.hear(answer)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "REMOTE LOAD was guessed" in rig.end.reason
    assert (rig.end.bytes_low, rig.end.bytes_high) == (0, min(len(said), len(P)))
    assert rig.take() == b""


def test_2_1_2_what_is_called_back_of_a_guessed_text_was_not_sent() -> None:
    rig = Rig().name(b"A77;D").hear(DC1)
    rig.hand_over(10)
    rig.host.receive_data(DLE, rig.now)
    rig.settle(recalled=4)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (0, 6)


@pytest.mark.parametrize(("word", "guessed"), [(b"A77;D", True), (b"77", True), (b"77;L", False)])
def test_2_1_2_complete_says_that_it_was_guessed(word: bytes, guessed: bool) -> None:
    rig = Rig().name(word)
    assert rig.say(DC1) == P + EOT
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE
    assert ("REMOTE LOAD was guessed" in rig.end.reason) is guessed


@pytest.mark.parametrize("stray", [b"\x00", b"\x7f", b"\x03", b"\x18"])
def test_what_is_no_text_begins_no_program_as_to_a_tape_punch(stray: bytes) -> None:
    rig, sink = Rig(None, punch_mode="on"), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(stray)
    assert rig.host.state is State.REST
    rig.say(P + EOT)
    rig.wait(2 * SECOND)
    assert sink.getvalue() == P


# the end of DNC LINK, refused


def test_nak_to_the_end_of_dnc_link_is_no_complete_program() -> None:
    rig = linked()
    assert rig.say(DC1).startswith(LINES[0])
    assert rig.say(ACK).startswith(LINES[1])
    assert rig.say(ACK).startswith(LINES[2])
    assert rig.say(ACK) == EOT
    rig.hear(NAK)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "answers the end with NAK" in rig.end.reason
    assert (rig.end.bytes_low, rig.end.bytes_high) == (len(LINK), len(LINK))


def test_nak_after_a_load_means_nothing() -> None:
    load = Rig(P)
    assert load.say(DC1) == P + EOT
    load.hear(NAK)
    load.wait(2 * SECOND)
    assert load.end is not None
    assert load.end.outcome is Outcome.COMPLETE
    assert load.of(Violation)


# a damaged character where nothing of ours is under way may have been a cancel


@pytest.mark.parametrize("mode", ["L", "D"])
def test_behind_the_end_of_a_program_it_makes_the_job_failed(mode: str) -> None:
    rig = Rig(P).name(f"1;{mode}".encode())
    rig.say(DC1)
    if mode == "D":
        rig.say(ACK)
    assert rig.host.state is State.TAIL
    rig.host.receive_line_fault(LineFault.PARITY, 0x90, rig.now)
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "may have been a cancel" in rig.end.reason
    assert rig.end.bytes_high == len(P)


def test_behind_the_end_of_a_save_it_makes_the_save_damaged() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(DC2)
    rig.say(P + EOT)
    rig.host.receive_line_fault(LineFault.FRAMING, 0, rig.now)
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "framing error behind its end" in rig.end.reason


def test_while_the_control_waits_it_ends_the_wait_and_leaves_what_is_armed() -> None:
    rig, programs = waiting()
    rig.host.receive_line_fault(LineFault.PARITY, None, rig.now)
    programs["42"] = P
    rig.wait(60 * SECOND)
    assert rig.take() == b""
    assert rig.of(Ended) == []
    assert rig.name(b"42;L").say(DC1) == P + EOT


def test_behind_a_name_it_makes_the_name_none() -> None:
    rig = Rig(P).name(b"42;L")
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    assert rig.say(DC1) == b""
    rig.say(DLE)
    assert rig.name(b"42;L").say(DC1) == P + EOT


def test_before_a_name_it_changes_nothing() -> None:
    rig = Rig(P)
    rig.host.receive_line_fault(LineFault.PARITY, 0x11, rig.now)
    assert rig.name(b"42;L").say(DC1) == P + EOT
