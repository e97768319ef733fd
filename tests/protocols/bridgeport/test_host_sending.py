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
)
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
