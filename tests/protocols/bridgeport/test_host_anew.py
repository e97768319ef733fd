"""A reception that gets no end: the control begins anew, or noise says so, or the job ends before it."""

from __future__ import annotations

from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import SECOND, Closure, LineFault, Notice, Outcome, SignalsIn, Violation
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.protocols.bridgeport.messages import classify
from tests.protocols.bridgeport.host_rig import DC1, DC2, DC4, DLE, EOT, Drawer, P, Rig

HEADS = [b"%", b"12", b"123456;L", b"%\nO0001\n"]
REST = b"the rest of it\r\n"


def receiving(**settings: str) -> tuple[Rig, BytesIO]:
    rig, sink = Rig(None, **settings), BytesIO()
    rig.host.receive(sink, 0)
    return rig, sink


def ended(rig: Rig) -> tuple[Outcome, int]:
    rig.wait(3 * SECOND)
    assert rig.end is not None
    assert rig.end.bytes_low == rig.end.bytes_high
    return rig.end.outcome, rig.end.bytes_low


@given(
    text=st.text("%NOG01;LD\n ", min_size=9, max_size=90),
    cuts=st.sets(st.integers(0, 90), max_size=3),
    named=st.booleans(),
    punched=st.booleans(),
)
def test_what_a_dc2_out_of_noise_cuts_is_never_complete(text: str, cuts: set[int], named: bool, punched: bool) -> None:
    program = text.encode()
    rig, sink = receiving(punch_mode="on" if punched else "off")
    if named:
        rig.name(b"77;L")
    if not punched:
        rig.say(DC2)
    for position in range(len(program)):
        if position in cuts:
            rig.say(DC2)
        rig.hear(program[position : position + 1])
    rig.hear(EOT).wait(3 * SECOND)
    if rig.end is not None and rig.end.outcome is Outcome.COMPLETE:
        assert sink.getvalue() == program
    if not cuts & set(range(1, len(program))) and classify(program) is None:
        assert rig.end is not None
        assert rig.end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("named", [True, False])
def test_a_program_behind_what_may_be_its_head_has_failed(head: bytes, named: bool) -> None:
    rig, sink = receiving()
    if named:
        rig.name(b"77;L")
    rig.say(DC2)
    rig.hear(head)
    assert rig.say(DC2) == DC1
    assert rig.say(DC2) == DC1, "once more makes it no better"
    rig.hear(REST + EOT)
    assert ended(rig) == (Outcome.FAILED, len(REST))
    assert sink.getvalue() == REST
    assert rig.end is not None
    assert f"behind {len(head)} character" in rig.end.reason


@pytest.mark.parametrize("begun", [b"1", b"1234", b"1234;L"])
@pytest.mark.parametrize("named", [True, False])
def test_1_1_a_name_that_is_said_again_fails_nothing(begun: bytes, named: bool) -> None:
    """The operator presses the key twice, or the control asks again."""
    rig, sink = receiving()
    if named:
        rig.name(b"1234;L")
    rig.say(DC2)
    rig.hear(begun)
    rig.name(b"1234;L").say(DC2)
    rig.hear(P + EOT)
    assert ended(rig) == (Outcome.COMPLETE, len(P))
    assert sink.getvalue() == P


def test_a_dc2_that_is_repeated_before_anything_came_fails_nothing() -> None:
    rig, _ = receiving()
    for _ in range(3):
        assert rig.say(DC2) == DC1
    rig.hear(P + EOT)
    assert ended(rig) == (Outcome.COMPLETE, len(P))
    assert rig.of(Violation) == []


@pytest.mark.parametrize("byte", [0x32, None])
def test_damage_in_what_may_be_the_head_is_not_forgotten(byte: int | None) -> None:
    rig, _ = receiving()
    rig.say(DC2)
    rig.host.receive_line_fault(LineFault.PARITY if byte else LineFault.BREAK, byte, rig.now)
    rig.say(DC2)
    rig.hear(REST + EOT)
    assert ended(rig)[0] is Outcome.FAILED


def test_damage_in_a_name_that_is_said_again_is_made_good() -> None:
    rig, _ = receiving()
    rig.say(DC2)
    rig.host.receive_line_fault(LineFault.PARITY, 0x32, rig.now)
    rig.name(b"1;L").say(DC2)
    rig.hear(P + EOT)
    assert ended(rig)[0] is Outcome.COMPLETE


@pytest.mark.parametrize("head", [b"%\nO1\n", b"N" * 38])
def test_a_standing_shelf_takes_no_rest_of_a_program_for_a_whole_one(head: bytes) -> None:
    rig, drawer = Rig(None), Drawer()
    rig.host.serve(None, 0, shelf=drawer, policy=Policy.STANDING)
    rig.say(DC2)
    rig.hear(head)
    rig.say(DC2)
    rig.hear(REST + EOT).wait(3 * SECOND)
    assert rig.end is not None
    assert "COMPLETE" not in str(rig.events)
    rig.events.clear()
    rig.say(DC2)
    rig.hear(P + EOT)
    assert ended(rig) == (Outcome.COMPLETE, len(P))


# without DC2


@pytest.mark.parametrize("head", [b"%\nO1\n", b"N" * 38])
@pytest.mark.parametrize("silent", [True, False])
def test_a_punch_that_goes_on_behind_a_silence_is_not_whole(head: bytes, silent: bool) -> None:
    rig, drawer = Rig(None, punch_mode="on"), Drawer()
    rig.host.serve(None, 0, shelf=drawer, policy=Policy.STANDING)
    rig.hear(head)
    if silent:
        rig.wait(31 * SECOND)
    rig.hear(REST + EOT).wait(3 * SECOND)
    assert ("COMPLETE" in str(rig.events)) is not silent


@pytest.mark.parametrize("between", [DC2, DLE, DC2 + b"1;L" + DC4])
def test_behind_a_silence_the_control_may_say_that_it_begins(between: bytes) -> None:
    rig, _ = receiving(punch_mode="on")
    rig.hear(b"%\nO1\n").wait(31 * SECOND)
    rig.say(between)
    rig.hear(P + EOT)
    assert ended(rig) == (Outcome.COMPLETE, len(P))


def test_what_is_armed_behind_a_silence_begins_anew() -> None:
    rig, _ = receiving(punch_mode="on")
    rig.hear(b"N" * 38).wait(31 * SECOND)
    rig.events.clear()
    sink = BytesIO()
    rig.host.receive(sink, rig.now)
    rig.hear(P + EOT)
    assert ended(rig) == (Outcome.COMPLETE, len(P))


# an end of the job before that of the program

ENDINGS = ["silence", "DC2", "closed", "cancelled", "aborted", "DSR"]


def end_by(how: str, rig: Rig) -> None:
    match how:
        case "silence":
            rig.wait(31 * SECOND)
        case "DC2":
            rig.hear(DC2)
        case "closed":
            rig.host.receive_closed(Closure.ORDERLY, "closed", rig.now)
        case "cancelled":
            rig.hear(DLE)
        case "aborted":
            rig.host.abort(rig.now)
        case _:
            rig.host.receive_signals(SignalsIn(), rig.now)
            rig.host.receive_signals(SignalsIn(dsr=False), rig.now)
    rig.settle()


@pytest.mark.parametrize("how", ENDINGS)
@pytest.mark.parametrize("length", [9, 38, 64, 65])
@pytest.mark.parametrize("policy", Policy)
def test_what_has_come_is_stored_however_it_ends(how: str, length: int, policy: Policy) -> None:
    rig, drawer = Rig(None), Drawer()
    rig.host.serve(None, 0, shelf=drawer, policy=policy)
    rig.say(DC2)
    rig.hear(b"N" * length)
    end_by(how, rig)
    assert rig.end is not None
    assert rig.end.outcome is not Outcome.COMPLETE
    assert rig.end.bytes_low == rig.end.bytes_high == length
    assert drawer.programs[None].getvalue() == b"N" * length


@pytest.mark.parametrize("how", ENDINGS)
def test_what_may_be_a_name_is_stored_by_none(how: str) -> None:
    rig, drawer = Rig(None), Drawer()
    rig.host.serve(None, 0, shelf=drawer)
    rig.say(DC2)
    rig.hear(b"12345678")
    end_by(how, rig)
    assert rig.end is None
    assert drawer.programs == {}


@pytest.mark.parametrize("how", ENDINGS)
def test_what_nobody_wants_is_dropped_and_told_once(how: str) -> None:
    rig = Rig(None)
    rig.say(DC2)
    rig.hear(b"N" * 38)
    end_by(how, rig)
    assert rig.end is None
    assert sum("dropped" in event.text for event in rig.of(Notice) if isinstance(event, Notice)) == 1


@pytest.mark.parametrize(("length", "said"), [(1, "behind 1 character without"), (8, "behind 8 characters without")])
def test_a_count_is_told_as_one_writes_it(length: int, said: str) -> None:
    rig, _ = receiving()
    rig.say(DC2)
    rig.hear(b"N" * length + DC2)
    assert [said in event.what for event in rig.of(Violation) if isinstance(event, Violation)] == [True]


def test_a_large_count_has_its_separator() -> None:
    rig = Rig(None)
    rig.say(DC2)
    rig.hear(b"N" * 12345 + DC2)
    assert [event.what for event in rig.of(Violation) if isinstance(event, Violation) and "12,345" in event.what]
