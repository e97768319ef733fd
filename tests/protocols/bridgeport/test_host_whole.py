"""The host's end: no part of a program the control sends counts as a whole one."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import SECOND, Ended, Event, LineFault, Outcome, Requested, SignalsIn
from tapewire.protocols.bridgeport.host_arming import Policy
from tests.protocols.bridgeport.host_rig import DC1, DC2, DC3, DC4, DLE, EOT, Books, Drawer, P, Rig

REST = b"the rest of it\r\n"


def shelved(**settings: str) -> tuple[Rig, Drawer]:
    rig, drawer = Rig(None, **settings), Drawer()
    rig.host.serve(None, 0, shelf=drawer, policy=Policy.STANDING)
    return rig, drawer


def punching(**settings: str) -> tuple[Rig, Drawer]:
    return shelved(punch_mode="on", **settings)


def endings(rig: Rig) -> list[tuple[Outcome, int]]:
    rig.wait(3 * SECOND)
    return [(event.outcome, event.bytes_low) for event in rig.events if isinstance(event, Ended)]


def reasons(events: list[Event]) -> str:
    return "; ".join(event.reason for event in events if isinstance(event, Ended))


# more than the limit


@pytest.mark.parametrize("length", [19, 20, 21, 40, 63, 64, 65, 66])
@pytest.mark.parametrize("ends", [EOT, EOT + DC4])
def test_more_than_the_limit_is_no_whole_program_however_long(length: int, ends: bytes) -> None:
    """As many as 64 characters wait until it is known that they are no name."""
    rig, drawer = shelved(upload_limit="20")
    rig.say(DC2)
    rig.hear(b"N" * length + ends)
    fits = length <= 20
    assert endings(rig) == [(Outcome.COMPLETE if fits else Outcome.FAILED, min(length, 20))]
    assert drawer.programs[None].getvalue() == b"N" * min(length, 20)
    assert fits or "more than 20 bytes" in reasons(rig.events)


@pytest.mark.parametrize("length", [40, 80])
@pytest.mark.parametrize("punch_mode", ["on", "off"])
def test_the_next_program_is_not_the_rest_of_one_that_was_too_long_and_has_ended(length: int, punch_mode: str) -> None:
    rig, _ = shelved(punch_mode=punch_mode, upload_limit="20")
    if punch_mode == "off":
        rig.say(DC2)
    rig.hear(b"N" * length)
    rig.hear(EOT + DC4)
    if punch_mode == "off":
        rig.say(DC2)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.FAILED, 20), (Outcome.COMPLETE, len(P))]


def test_the_rest_of_a_punch_that_is_too_long_is_no_program() -> None:
    rig, _ = punching(upload_limit="100")
    rig.hear(b"N" * 60)
    rig.hear(b"M" * 60)
    rig.hear(REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, 100), (Outcome.FAILED, len(REST))]
    assert "behind 120 characters" in reasons(rig.events)


# what goes on behind the end of the job


def dsr_falls(rig: Rig) -> None:
    rig.host.receive_signals(SignalsIn(), rig.now)
    rig.host.receive_signals(SignalsIn(dsr=False), rig.now)
    rig.settle()


def test_the_rest_of_a_punch_behind_a_dsr_that_fell_is_no_program() -> None:
    rig, _ = punching()
    rig.hear(b"N" * 100)
    dsr_falls(rig)
    rig.hear(REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, 100), (Outcome.FAILED, len(REST))]


@pytest.mark.parametrize("between", [DC2, DLE, EOT, DC4])
def test_behind_a_job_that_failed_the_control_may_say_that_it_begins(between: bytes) -> None:
    rig, _ = punching()
    rig.hear(b"N" * 100)
    dsr_falls(rig)
    rig.say(between)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.FAILED, 100), (Outcome.COMPLETE, len(P))]


def test_4_3_2_behind_a_cancel_a_punch_begins_anew() -> None:
    rig, _ = punching()
    rig.hear(b"N" * 100 + DLE)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.CANCELLED, 100), (Outcome.COMPLETE, len(P))]


# the first character of a punch


@pytest.mark.parametrize("policy", Policy)
@pytest.mark.parametrize("byte", [0x25, None])
def test_a_punch_whose_first_character_came_damaged_is_not_whole(policy: Policy, byte: int | None) -> None:
    rig, drawer = Rig(None, punch_mode="on"), Drawer()
    rig.host.serve(None, 0, shelf=drawer, policy=policy)
    rig.host.receive_line_fault(LineFault.PARITY, byte, rig.now)
    rig.hear(REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, len(REST))]
    assert "behind a damaged character (parity error)" in reasons(rig.events)


@pytest.mark.parametrize(("span", "outcome"), [(29, Outcome.FAILED), (31, Outcome.COMPLETE)])
def test_damage_long_before_a_punch_is_not_its_first_character(span: int, outcome: Outcome) -> None:
    """A control that is switched on makes a break."""
    rig, _ = punching()
    rig.host.receive_line_fault(LineFault.BREAK, None, rig.now)
    rig.wait(span * SECOND)
    rig.hear(P + EOT)
    assert endings(rig) == [(outcome, len(P))]


def test_damage_before_a_request_stays_nothing() -> None:
    rig = Rig(None, punch_mode="on")
    rig.host.receive_line_fault(LineFault.PARITY, 0x25, rig.now)
    rig.host.start(BytesIO(P), rig.now)
    assert rig.say(b"\x11") == P + EOT
    assert endings(rig) == [(Outcome.COMPLETE, len(P))]


@pytest.mark.parametrize("announced", [DC2, DC2 + b"77;L" + DC4 + DC2])
def test_damage_before_an_announced_program_is_not_its_first_character(announced: bytes) -> None:
    rig, _ = punching()
    rig.host.receive_line_fault(LineFault.PARITY, 0x25, rig.now)
    rig.say(announced)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.COMPLETE, len(P))]


def test_damage_behind_what_had_no_end_does_not_make_it_forgotten() -> None:
    rig, _ = punching()
    rig.hear(b"N" * 100)
    dsr_falls(rig)
    rig.host.receive_line_fault(LineFault.PARITY, 0x25, rig.now)
    rig.wait(31 * SECOND)
    rig.hear(REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, 100), (Outcome.FAILED, len(REST))]


# text behind the end


@pytest.mark.parametrize("punch_mode", ["on", "off"])
@pytest.mark.parametrize("position", [9, 30, 64, 65, 200, 840])
def test_an_end_out_of_noise_makes_no_part_a_whole_program(punch_mode: str, position: int) -> None:
    program = b"N30 rest of program\r\n" * 41
    rig, _ = shelved(punch_mode=punch_mode)
    rig.say(DC2)
    rig.hear(program[:position] + EOT + program[position:] + EOT + DC4)
    ended = endings(rig)
    assert ended[0] == (Outcome.FAILED, position)
    assert all(outcome is Outcome.FAILED for outcome, _ in ended)
    assert "text behind its end" in reasons(rig.events)


@pytest.mark.parametrize("again", [DC2, DC1, b""])
def test_text_behind_an_end_is_not_forgotten_however_the_wait_ends(again: bytes) -> None:
    rig, _ = shelved()
    rig.say(DC2)
    rig.hear(P + EOT + b"M" + again)
    assert endings(rig) == [(Outcome.FAILED, len(P))]


@pytest.mark.parametrize("punch_mode", ["on", "off"])
@pytest.mark.parametrize("trailer", [EOT, EOT + DC4, EOT + b"\r\n" + DC4, EOT + b"\x00\x7f\r\n"])
def test_line_ends_and_blank_tape_behind_the_end_are_nothing(punch_mode: str, trailer: bytes) -> None:
    rig, _ = shelved(punch_mode=punch_mode)
    rig.say(DC2)
    rig.hear(P + trailer)
    assert endings(rig) == [(Outcome.COMPLETE, len(P))]


def test_a_punch_right_behind_another_is_kept_whole_and_neither_counts() -> None:
    """Nothing tells it from the rest behind an end out of noise."""
    rig, drawer = punching()
    rig.hear(P + EOT)
    drawer.programs.clear()
    rig.wait(SECOND // 2).hear(REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, len(P)), (Outcome.FAILED, len(REST))]
    assert drawer.programs[None].getvalue() == REST


def test_a_punch_behind_the_wait_after_another_is_one_of_its_own() -> None:
    rig, _ = punching()
    for _ in range(2):
        rig.hear(P + EOT).wait(2 * SECOND)
    assert endings(rig) == [(Outcome.COMPLETE, len(P))] * 2


def test_the_one_program_asked_for_takes_nothing_of_the_next() -> None:
    rig, sink = Rig(None, punch_mode="on"), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(P + EOT + REST + EOT)
    assert endings(rig) == [(Outcome.FAILED, len(P))]
    assert sink.getvalue() == P


# our pause


def paused(length: int = 100, **settings: str) -> tuple[Rig, BytesIO]:
    rig, sink = Rig(None, **settings), BytesIO()
    rig.host.receive(sink, 0)
    rig.say(DC2)
    rig.hear(b"N" * length)
    rig.host.hold_reception(rig.now)
    assert rig.take() == DC3
    return rig, sink


@pytest.mark.parametrize(("span", "failed"), [(29, False), (31, True)])
def test_3_1_behind_our_pause_the_control_has_its_time_again(span: int, failed: bool) -> None:
    rig, _ = paused()
    rig.wait(59 * SECOND + SECOND // 2)
    rig.host.release(rig.now)
    assert rig.take() == DC1
    rig.wait(span * SECOND)
    assert (rig.end is not None) is failed


@pytest.mark.parametrize("length", [0, 5, 100])
def test_3_1_dsr_that_falls_in_our_pause_ends_the_job(length: int) -> None:
    """A control that is still there is held, and XON behind it could pass for an answer."""
    rig, _ = paused(length)
    dsr_falls(rig)
    rig.host.release(rig.now)
    assert rig.take() == b""
    assert endings(rig) == [(Outcome.FAILED, length if length > 8 else 0)]


@pytest.mark.parametrize("released", ["before the end", "behind it", "never"])
def test_3_1_an_end_among_the_last_three_characters_ends_the_pause(released: str) -> None:
    """Its DC4 may wait for that."""
    rig, sink = paused()
    if released == "before the end":
        rig.host.release(rig.now)
    rig.hear(b"NN" + EOT)
    assert rig.take() == DC1
    if released == "behind it":
        rig.host.release(rig.now)
    rig.hear(DC4)
    assert endings(rig) == [(Outcome.COMPLETE, 102)]
    assert sink.getvalue() == b"N" * 102
    assert rig.take() == b"", "once is enough"


def test_3_1_the_pause_ends_before_the_closing_xoff_of_related_links() -> None:
    rig, _ = paused(closing_dc3="on")
    rig.hear(EOT)
    assert rig.take() == DC1 + DC3


def test_a_pause_is_that_of_its_job() -> None:
    rig, _ = paused()
    rig.host.abort(rig.now)
    rig.settle()
    rig.host.receive(BytesIO(), rig.now)
    assert rig.say(DC2) == DC1
    rig.hear(P)
    assert rig.take() == b""
    rig.wait(31 * SECOND)
    assert endings(rig) == [(Outcome.CANCELLED, 100), (Outcome.FAILED, len(P))]


# nothing that counts


@pytest.mark.parametrize("noise", [b"\r", b"\n", b"\r\n", b"\x00", b"\x7f"])
def test_line_ends_and_blank_tape_long_before_a_punch_are_not_its_head(noise: bytes) -> None:
    rig, _ = punching()
    rig.hear(noise).wait(8 * 3600 * SECOND)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.COMPLETE, len(P))]


@pytest.mark.parametrize("noise", [b"%", b" ", b"\r%"])
def test_anything_else_may_be(noise: bytes) -> None:
    rig, _ = punching()
    rig.hear(noise).wait(31 * SECOND)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.FAILED, len(P))]


def test_damage_among_line_ends_is_not_forgotten() -> None:
    rig, _ = punching()
    rig.hear(b"\r")
    rig.host.receive_line_fault(LineFault.PARITY, 0x0A, rig.now)
    rig.wait(31 * SECOND)
    rig.hear(P + EOT)
    assert endings(rig) == [(Outcome.FAILED, len(P))]


@pytest.mark.parametrize("empty", [b"", b"\r\n", b"\x00", b" "])
def test_1_1_nothing_is_no_name(empty: bytes) -> None:
    rig = Rig(None)
    rig.host.serve(Books({"77": REST, None: P}), 0)
    rig.name(b"77;D")
    rig.say(DC2)
    rig.hear(empty + DC4)
    assert rig.say(DC1) == P + EOT
    assert rig.of(Requested) == [Requested(served=True)]
