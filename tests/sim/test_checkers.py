"""The judges themselves: what they see, what they excuse, and what they do not."""

from __future__ import annotations

import dataclasses
from io import BytesIO

import pytest

from tapewire.engine import LineFault
from tapewire.line.faults.plan import Wire
from tapewire.line.transport import Fault
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Lrc, encode_record
from tapewire.protocols.fanuc_a.packets import encode_packet
from tapewire.sim.beliefs import disagreement
from tapewire.sim.evidence import Damage, Tap
from tapewire.sim.frames import cancelled_sums, forged_records, rest_fits
from tapewire.sim.undetectable import first_difference
from tapewire.sim.world import World

ENDS = frozenset(b"\x03\x17")
GTD, SYN = b"ECGTD\r", b"07SYN\r"


def damage(sent: bytes, *arrived: bytes | Fault) -> Damage:
    return Damage(0, "for the test", Wire.FROM_HOST, 1, sent, arrived)


@pytest.mark.parametrize(
    ("seen", "name", "unseen"),
    [
        (damage(b"A", b"C"), "flip without parity", True),
        (damage(b"A"), "lost character", True),
        (damage(b"A", b"AA"), "doubled character", True),
        (damage(b"", b"A"), "character out of nothing", True),
        (damage(b"A", Fault(fault=LineFault.PARITY, byte=0x43)), "lost character", False),
        (damage(b"A", b"A", Fault(fault=LineFault.BREAK)), "flip without parity", False),
    ],
)
def test_a_damage_is_unseen_when_nothing_marks_it(seen: Damage, name: str, unseen: bool) -> None:
    assert seen.unseen is unseen
    assert not unseen or seen.name == name


def test_a_sum_that_cancels_is_found_and_a_wrong_one_is_not() -> None:
    assert not cancelled_sums([GTD + SYN], GTD + SYN, 0)
    assert not cancelled_sums([GTD], b"ECGTE\r", 0), "one bit more: the sum is wrong"
    assert cancelled_sums([GTD], b"ECGUC\r", 0), "one up, one down: the sum is right"


def test_a_packet_whose_sum_cancels_is_found_and_a_wrong_one_is_not() -> None:
    packet = encode_packet(0x30, b"N1 X1.\n".ljust(256), 1)
    assert not cancelled_sums([packet], packet, 1)
    assert not cancelled_sums([packet], packet.replace(b"X1", b"X3"), 1)
    assert cancelled_sums([packet], packet.replace(b"N1 X1", b"N2 X0"), 1)


@pytest.mark.parametrize("lrc", list(LRC_CANDIDATES))
def test_a_record_whose_check_cancels_is_found_and_a_wrong_one_is_not(lrc: str) -> None:
    record = encode_record(b"N10X1\r\n", 0x17, next(each for each in LRC_CANDIDATES if each == lrc))
    assert not forged_records(record, record, lrc, ENDS)
    assert not forged_records(record, record.replace(b"X1", b"X3"), lrc, ENDS)
    by_sum = not lrc.startswith("xor")
    twice = record.replace(b"10X1", b"20X0") if by_sum else record.replace(b"10X1", b"30X3")
    assert forged_records(record, twice, lrc, ENDS)


def test_the_first_record_stands_behind_the_answer_to_the_name() -> None:
    record = encode_record(b"N10X1\r\n", 0x17, Lrc.XOR7_ETB)
    twice = record.replace(b"10X1", b"30X3")
    assert not forged_records(b"\x11" + record, b"\x11" + record, "xor7_etb", ENDS)
    assert forged_records(b"\x11" + record, b"\x11" + twice, "xor7_etb", ENDS)
    for before, found in ((b"\x11\x13", True), (b"\x00\x11\x7f\x13", True), (b"X", False), (b"\x11X", False)):
        assert forged_records(before + record, before + twice, "xor7_etb", ENDS) is found


FIRST, RECORD, LAST = b"N1\r\n", b"X1X1Z9\r\n", b"M30\r\n"


@pytest.mark.parametrize(
    ("taken", "fits"),
    [
        (FIRST + b"Z9\r\n" + LAST, True),
        (FIRST + b"Z9\r\n", True),
        (FIRST + b"X1Z9\r\n" + LAST, False),
        (FIRST + LAST, False),
        (FIRST + RECORD + b"Z9\r\n" + LAST, False),
        (FIRST + b"Y5\r\n" + LAST, False),
    ],
)
def test_the_rest_of_a_record_stands_where_the_record_should(taken: bytes, fits: bool) -> None:
    """Its head has every character twice, so that the rest has the same check character."""
    brought = b"\x11" + b"".join(encode_record(text, 0x17, Lrc.XOR7_ETB) for text in (FIRST, RECORD, LAST))
    program = FIRST + RECORD + LAST
    wrong = first_difference(taken, program)
    assert wrong is not None
    assert rest_fits(brought, taken, program, wrong, "xor7_etb", ENDS) is fits
    skipped = FIRST + LAST
    other = first_difference(taken, skipped)
    assert other is None or not rest_fits(brought, taken, skipped, other, "xor7_etb", ENDS), "the host sent other text"


@pytest.mark.parametrize(("got", "where"), [(b"", None), (b"AB", None), (b"AX", 1), (b"ABCD", 3)])
def test_where_what_came_is_no_beginning_any_more(got: bytes, where: int | None) -> None:
    assert first_difference(got, b"ABC") == where


def test_ends_that_believe_different_parameters_are_found() -> None:
    world = World()
    pair = world.pair("fanuc-a", binary=None)
    pair.host.start(BytesIO(b"%\nO1\nM30\n%"), world.now)
    pair.control.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None)
    assert disagreement(pair.host, pair.cnc) == ""
    dialogue = pair.cnc._line  # type: ignore[attr-defined]
    dialogue.parameters = dataclasses.replace(dialogue.parameters, no=77)
    assert "77" in disagreement(pair.host, pair.cnc)


def test_what_is_handed_over_after_a_stop_is_counted_until_it_may_go_on() -> None:
    tap = Tap(stops=frozenset(b"\x13"), goes=frozenset(b"\x11"))
    tap._write(b"before")
    tap._hear(b"\x13", 0)
    tap._write(b"ab")
    tap._hear(b"\x11", 0)
    tap._write(b"after")
    assert (tap.after_stop, bytes(tap.sent)) == (2, b"beforeabafter")


@pytest.mark.parametrize(("heard", "counted"), [(b"\x12\x13", 0), (b"\x13\x12", 0), (b"\x1277;D\x14\x13", 1)])
def test_3_1_what_answers_dc2_is_no_text_that_xoff_could_stop(heard: bytes, counted: int) -> None:
    """A control that is reset says DC2, DC3, DLE, and the answer to its DC2 may be on its way."""
    codes = frozenset(b"\x10\x11\x12\x13\x14")
    tap = Tap(stops=frozenset(b"\x13"), goes=frozenset(b"\x10\x11\x12"), opens=frozenset(b"\x12"), codes=codes)
    tap._hear(heard, 0)
    tap._write(b"\x11")
    assert tap.after_stop == counted
