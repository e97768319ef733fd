"""The control's end, DNC LINK: clause by clause of the text, without a host."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import AfterStop, Alarm, LineFault, Notice, Outcome, Violation
from tapewire.protocols.bridgeport.cnc import State
from tapewire.protocols.bridgeport.messages import FirstRecord, Hold, Mode, Parity
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Cut, DncEnd, Lrc, cut_length
from tests.protocols.bridgeport.cnc_bench import (
    ACK,
    DC1,
    DC2,
    DC3,
    DC4,
    DLE,
    EOT,
    ETB,
    ETX,
    NAK,
    Bench,
    record,
)

FIRST, SECOND, THIRD = b"N10G1X1F5\r\n", b"N20Y1\r\n", b"N30M2\r\n"
ALL = FIRST + SECOND + THIRD

# 4.2.1: the dialogue


def test_4_2_1_the_example_to_the_byte() -> None:
    bench = Bench(program="77", mode=Mode.LINK).start()
    assert bench.send() == DC2
    assert bench.receive(DC1).send() == bytes.fromhex("37 37 3B 44 14 11")
    bench.receive(bytes.fromhex("4E 31 30 47 31 58 31 46 35 0D 0A 17 33"))
    assert bench.send() == ACK
    bench.receive(bytes.fromhex("4E 32 30 59 31 0D 0A 17 35"))
    assert (bench.send(), bench.quiet().send()) == (b"", NAK)
    bench.receive(bytes.fromhex("4E 32 30 59 31 0D 0A 17 34"))
    assert bench.send() == ACK
    bench.receive(bytes.fromhex("4E 33 30 4D 32 0D 0A 17 22"))
    assert bench.send() == ACK
    assert bench.receive(EOT).take() == ALL
    assert (bench.send(), bench.end()) == (b"", (Outcome.COMPLETE, 25, 25))


def test_2_2_4_only_a_good_record_reaches_the_control() -> None:
    bench = Bench.linking().receive(FIRST + ETB)
    assert (bench.take(), bench.engine.buffered) == (b"", 0)
    bench.receive(b"\x32")
    assert bench.take() == b""
    assert bench.quiet().send() == NAK
    assert bench.receive(record(FIRST)).take() == FIRST


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
def test_2_2_4_every_candidate_of_the_lrc_and_no_other(lrc: Lrc) -> None:
    for text in (FIRST, SECOND, b"0" * 256, b""):
        good = record(text, lrc)
        for other in range(128):
            bench = Bench.linking(lrc=lrc).receive(good[:-1] + bytes([other]))
            assert bench.quiet().send() == (ACK if other == good[-1] else NAK)


@pytest.mark.parametrize("text", [b"04", b"06", b"07", b"03", b"05", b"02", b"AR", b"AP", b"", b"0" * 256, b"%\r\n"])
def test_2_2_the_lrc_is_known_by_its_place_whatever_its_value(text: bytes) -> None:
    bench = Bench.linking().receive(record(text))
    assert (bench.send(), bench.take(), bench.state) == (ACK, text, State.RECORD_DUE)


def test_2_2_4_the_lrc_under_parity_made_in_software() -> None:
    bench = Bench(parity=Parity.SOFTWARE, mode=Mode.LINK, program="77").start().said()
    bench.receive(DC1).said()
    wire = bytes(byte | 0x80 if byte.bit_count() % 2 else byte for byte in record(FIRST))
    assert bench.receive(wire).send() == b"\x06"
    damaged = bytes([wire[0] ^ 0x10]) + wire[1:]
    bench.receive(damaged)
    assert bench.quiet().send() == b"\x95", "NAK with its even parity bit"
    assert bench.take() == FIRST


def test_2_2_3_a_record_of_256_is_the_longest() -> None:
    assert Bench.linking().receive(record(b"7" * 256)).quiet().send() == ACK
    longer = b"7" * 256 + b"0" * 2
    assert Bench.linking().receive(longer + record(longer[:256])[-2:]).quiet().send() == NAK


def test_1_2_1_the_first_record_on_the_request_or_on_an_ack() -> None:
    assert Bench.linking().state is State.RECORD_DUE
    bench = Bench(mode=Mode.LINK, first_record=FirstRecord.ON_ACK).start().said().receive(DC1)
    assert bench.send() == b"1234;D" + DC4 + DC1 + ACK
    assert bench.receive(record(FIRST)).take() == FIRST


def test_2_2_1_a_short_program_is_pointed_out_a_long_one_is_not() -> None:
    bench = Bench.linking().receive(record(FIRST)).said().receive(EOT)
    assert "2.2.1" in bench.all(Notice)[0].text
    brim = Bench.linking(buffer=20_000)
    for count in (*[256] * 46, 224):
        brim.receive(record(b"7" * count)).said()
    assert "has 12000" in brim.receive(EOT).all(Notice)[0].text
    long = Bench.linking(buffer=20_000)
    for _ in range(47):
        assert long.receive(record(b"7" * 256)).send() == ACK
    assert long.receive(EOT).all(Notice) == []
    assert long.take() == b"7" * 47 * 256


def test_2_2_leader_before_a_record_is_passed_over_and_counted_within_it() -> None:
    bench = Bench.linking().receive(bytes(9) + b"\x7f" + record(b"N1\x7f\x00\r\n"))
    assert (bench.send(), bench.take()) == (ACK, b"N1\r\n")


def test_2_2_what_is_no_program_is_stored_and_reported() -> None:
    text = b"N1" + EOT + DC3 + NAK
    bench = Bench.linking().receive(record(text))
    assert (bench.send(), bench.take()) == (ACK, text)
    assert [violation.count for violation in bench.all(Violation)] == [3]


# 2.2.4 and 4.2.1: damage in every position


@pytest.mark.parametrize("fault", list(LineFault))
@pytest.mark.parametrize("position", range(len(record(SECOND))))
def test_2_2_4_a_damaged_character_in_every_position(position: int, fault: LineFault) -> None:
    bench = Bench.linking().receive(record(FIRST)).said()
    wire = record(SECOND)
    bench.receive(wire[:position]).fault(fault, wire[position] ^ 1).receive(wire[position + 1 :])
    assert bench.send() == b""
    assert bench.wait(10).send() == NAK
    assert bench.receive(wire).send() == ACK
    bench.receive(EOT)
    assert (bench.take(), bench.end()) == (FIRST + SECOND, (Outcome.COMPLETE, 18, 18))


@pytest.mark.parametrize("position", range(len(record(SECOND))))
def test_2_2_4_a_lost_character_in_every_position(position: int) -> None:
    bench = Bench.linking().receive(record(FIRST)).said()
    wire = record(SECOND)
    bench.receive(wire[:position]).fault(LineFault.UART_OVERRUN, None).receive(wire[position + 1 :])
    assert bench.wait(10).send() == NAK
    assert bench.receive(wire).send() == ACK
    assert bench.take() == FIRST + SECOND


@pytest.mark.parametrize("bit", range(7))
@pytest.mark.parametrize("position", range(len(record(b"N27W5\r\n"))))
def test_4_2_1_a_wrong_bit_that_no_parity_shows_in_every_position(position: int, bit: int) -> None:
    wire = record(b"N27W5\r\n")
    wrong = bytearray(wire)
    wrong[position] ^= 1 << bit
    bench = Bench.linking().receive(record(FIRST)).said().receive(bytes(wrong))
    assert bench.wait(10).send() == NAK, "once, even where an ETB seemed to come"
    assert bench.receive(wire).send() == ACK
    assert bench.take() == FIRST + b"N27W5\r\n"


def test_4_2_1_nak_at_once_as_a_setting() -> None:
    assert Bench.linking(nak_quiet=0.0).receive(FIRST + ETB + b"\x00").send() == NAK


def test_4_2_1_nak_waits_for_a_quiet_line_and_swallows_what_disturbs_it() -> None:
    bench = Bench.linking().receive(FIRST + ETB + b"\x00").wait(0.15).receive(b"abc").wait(0.15)
    assert bench.send() == b""
    bench.fault().wait(0.15)
    assert bench.send() == b""
    assert bench.wait(0.05).send() == NAK
    assert len(bench.all(Violation)) == 2
    assert bench.receive(record(FIRST)).send() == ACK


def test_4_2_1_what_comes_before_the_ack_is_ignored() -> None:
    bench = Bench.linking().receive(record(FIRST) + b"abc")
    assert (bench.send(), [violation.count for violation in bench.all(Violation)]) == (ACK, [3])


def test_4_2_1_the_control_gives_up_as_a_setting() -> None:
    bench = Bench.linking(nak_limit=3)
    for _ in range(3):
        assert bench.receive(b"N1" + ETB + b"\x00").quiet().send() == NAK
    assert bench.receive(b"N1" + ETB + b"\x00").send() == DLE
    assert bench.ended().outcome is Outcome.FAILED
    assert "nak_limit" in bench.all(Alarm)[0].text
    for_ever = Bench.linking(nak_limit=0)
    for _ in range(100):
        assert for_ever.receive(b"N1" + ETB + b"\x00").quiet().send() == NAK


def test_4_2_1_it_gives_up_by_itself_but_not_before_every_candidate_was_tried_twice() -> None:
    bench, naks = Bench.linking(), 0
    while (answer := bench.receive(b"N1" + ETB + b"\x00").quiet().send()) == NAK:
        naks += 1
    assert (answer, naks) == (DLE, 20)
    assert naks > 2 * len(LRC_CANDIDATES)
    assert "a record was bad 21 times running (nak_limit)" in bench.ended().reason


def test_4_2_1_naks_are_counted_for_each_record() -> None:
    bench = Bench.linking(nak_limit=1)
    for _ in range(3):
        assert bench.receive(b"N1" + ETB + b"\x00").quiet().send() == NAK
        assert bench.receive(record(FIRST)).send() == ACK


# a record that stops in the middle


@pytest.mark.parametrize("part", [FIRST, FIRST + ETB])
def test_a_record_that_stops_in_the_middle_is_asked_for_again(part: bytes) -> None:
    bench = Bench.linking().receive(part).wait(4.9).receive(b"").wait(0.05)
    assert bench.send() == b""
    assert bench.wait(0.05).send() == NAK
    assert bench.receive(record(SECOND)).send() == ACK
    assert bench.take() == SECOND
    never = Bench.linking(record_timeout=0.0).receive(part)
    assert never.engine.next_deadline() is None


def test_every_character_puts_the_silence_off() -> None:
    bench = Bench.linking()
    for character in FIRST:
        bench.receive(bytes([character])).wait(4.9)
    assert bench.send() == b""


def test_between_records_a_silence_is_none() -> None:
    bench = Bench.linking().receive(record(FIRST)).said()
    assert bench.wait(100_000).send() == b"", "a second ACK would skip a record, a NAK might double one"


def test_after_a_silence_a_remote_that_had_only_paused_is_given_up() -> None:
    bench = Bench.linking().receive(FIRST[:5]).wait(5)
    assert bench.send() == NAK
    assert bench.receive(FIRST[5:] + record(FIRST)[-2:]).send() == DLE
    assert "where records begin" in bench.ended().reason
    assert bench.end() == (Outcome.FAILED, 0, 0)


def test_after_a_silence_a_record_that_stops_again_has_an_end_of_its_own() -> None:
    bench = Bench.linking().receive(record(FIRST, end=ETX)).wait(5)
    assert bench.send() == NAK
    bench.receive(record(FIRST, end=ETX))
    assert bench.wait(5).send() == DLE
    assert "its end is not known here" in bench.ended().reason
    damaged = Bench.linking().receive(FIRST).wait(5).said().fault()
    assert damaged.wait(5).send() == NAK, "this time it is known why"


def test_after_a_silence_a_copy_damaged_on_the_line_is_asked_for_again() -> None:
    bench = Bench.linking().receive(FIRST[:5]).wait(5).said()
    bench.fault().receive(record(FIRST)[1:])
    assert bench.quiet().send() == NAK
    assert bench.receive(record(FIRST)).send() == ACK
    assert bench.receive(FIRST + ETB + b"\x00").quiet().send() == NAK, "the silence is forgotten"


def test_after_a_silence_the_record_before_it_once_more_means_a_lost_ack() -> None:
    bench = Bench.linking().receive(record(FIRST)).said().receive(b"#").wait(5)
    assert bench.send() == NAK
    assert bench.receive(record(FIRST)).send() == DLE
    assert "an ACK was lost" in bench.ended().reason
    assert bench.end() == (Outcome.FAILED, 0, len(FIRST))


# the end of the program, in every way it may be said


def link(dnc_end: DncEnd, *said: bytes) -> Bench:
    bench = Bench.linking(dnc_end=dnc_end)
    for data in said:
        bench.receive(data).said()
    bench.take()
    return bench


def test_the_end_by_eot_on_the_last_ack() -> None:
    bench = link(DncEnd.EOT_ON_ACK, record(FIRST), record(SECOND), EOT)
    assert bench.end() == (Outcome.COMPLETE, 18, 18)


@pytest.mark.parametrize("dnc_end", [DncEnd.EOT_AFTER_LRC, DncEnd.EOT_ON_ACK])
def test_the_end_by_eot_behind_the_lrc_before_or_after_the_ack(dnc_end: DncEnd) -> None:
    before = link(dnc_end, record(FIRST), record(SECOND) + EOT)
    assert (before.end(), before.all(Violation)) == ((Outcome.COMPLETE, 18, 18), [])
    after = link(dnc_end, record(FIRST), record(SECOND), EOT)
    assert (after.end(), after.all(Violation)) == ((Outcome.COMPLETE, 18, 18), [])


@pytest.mark.parametrize("room", [1024, 300])
def test_the_ack_of_the_last_record_is_said_though_its_eot_has_come(room: int) -> None:
    bench = Bench.linking(dnc_end=DncEnd.EOT_AFTER_LRC, buffer=room, start_at_free=40).receive(record(FIRST) + EOT)
    assert (bench.send(), bench.take(), bench.ended().outcome) == (ACK, FIRST, Outcome.COMPLETE)


def test_the_end_by_eot_behind_the_lrc_of_a_record_that_is_refused_is_none() -> None:
    bench = link(DncEnd.EOT_AFTER_LRC, record(FIRST), SECOND + ETB + b"\x00" + EOT)
    assert (bench.end(), bench.quiet().send()) == (None, NAK)
    bench.receive(EOT)
    assert (bench.end(), bench.state) == (None, State.RECORD_DUE)
    bench.receive(record(SECOND) + EOT).said()
    assert (bench.take(), bench.ended().outcome, bench.all(Violation)) == (SECOND, Outcome.COMPLETE, [])


def test_eot_in_place_of_a_refused_record_is_no_end() -> None:
    bench = link(DncEnd.EOT_ON_ACK, record(FIRST), SECOND + ETB + b"\x00")
    assert bench.quiet().send() == NAK
    assert bench.receive(EOT).send() == DLE
    assert bench.end() == (Outcome.FAILED, 11, 11)
    assert "in place of the record that was refused" in bench.ended().reason


def test_the_end_by_etx_in_the_last_record() -> None:
    bench = link(DncEnd.ETX_LAST, record(FIRST), record(SECOND, end=ETX), EOT)
    assert bench.end() == (Outcome.COMPLETE, 18, 18)
    bench = link(DncEnd.ETX_LAST, record(FIRST), record(SECOND), EOT)
    assert bench.ended().outcome is Outcome.FAILED
    assert "dnc_end=etx_last" in bench.ended().reason


def test_etx_is_text_where_it_does_not_end_the_last_record() -> None:
    bench = link(DncEnd.EOT_ON_ACK, record(FIRST), record(b"N1" + ETX))
    assert bench.engine.progress == 11 + 3


def test_the_end_by_an_empty_record() -> None:
    bench = link(DncEnd.EMPTY_THEN_EOT, record(FIRST), record(SECOND), record(b""), EOT)
    assert bench.end() == (Outcome.COMPLETE, 18, 18)
    bench = link(DncEnd.EMPTY_THEN_EOT, record(FIRST), record(SECOND), EOT)
    assert "dnc_end=empty_then_eot" in bench.ended().reason


@pytest.mark.parametrize("dnc_end", list(DncEnd))
def test_a_lone_eot_is_no_program(dnc_end: DncEnd) -> None:
    bench = link(dnc_end, EOT)
    assert (bench.end(), bench.send()) == ((Outcome.FAILED, 0, 0), b"")
    assert "no such program" in bench.ended().reason


def test_program_ended_only_when_the_last_record_is_taken() -> None:
    bench = Bench.linking().receive(record(FIRST)).said()
    assert bench.take() == FIRST
    assert (bench.engine.program_ended, bench.end()) == (False, None)
    bench.receive(EOT)
    assert (bench.engine.program_ended, bench.ended().outcome) == (True, Outcome.COMPLETE)


# what holds the remote


def test_the_ack_waits_for_room_for_a_whole_record() -> None:
    bench = Bench.linking(buffer=600).receive(record(b"7" * 256)).said()
    assert bench.receive(record(b"8" * 256)).wait(1000).send() == b""
    bench.take(167)
    assert bench.send() == b""
    bench.take(1)
    assert bench.send() == ACK
    assert bench.receive(record(b"9" * 256)).take() == b"7" * 88 + b"8" * 256 + b"9" * 256
    assert (bench.send(), bench.all(AfterStop)) == (ACK, [])


def test_a_nak_needs_no_room() -> None:
    bench = Bench.linking(buffer=300).receive(b"7" * 256 + ETB + b"\x00")
    assert bench.quiet().send() == NAK


def test_3_1_xoff_in_the_data_of_a_record_as_a_setting() -> None:
    bench = Bench.linking(hold=Hold.XOFF, buffer=600, stop_at_free=10, start_at_free=200)
    bench.receive(record(b"7" * 256))
    assert bench.send() == ACK
    bench.receive(record(b"8" * 256))
    assert bench.send() == ACK
    assert bench.receive(b"9" * 77).send() == b""
    assert bench.receive(b"9").send() == DC3
    bench.receive(b"9" * 3)
    assert bench.wait(100).send() == b"", "silence is our own doing"
    assert len(bench.take(192)) == 192
    assert bench.send() == b""
    bench.take(1)
    assert bench.send() == DC1
    assert bench.all(AfterStop) == [AfterStop(count=3, allowed=3)]
    bench.receive(record(b"9" * 256)[81:])
    assert (bench.take(), bench.send()) == (b"7" * 63 + b"8" * 256 + b"9" * 256, ACK)


def full(*, part: bytes) -> Bench:
    """Stopped within a record that is `part`, which then ends within the three characters."""
    bench = Bench.linking(hold=Hold.XOFF, buffer=300, stop_at_free=10, start_at_free=40)
    assert bench.receive(record(b"7" * 256)).send() == ACK
    assert bench.receive(part).send() == DC3
    return bench


def test_3_2_a_record_that_ends_while_the_remote_is_held_is_answered_after_the_xon() -> None:
    part = b"9" * 34
    bench = full(part=part).receive(record(part)[-2:])
    assert (bench.wait(100).send(), bench.state) == (b"", State.ANSWERING)
    bench.take(29)
    assert bench.send() == b""
    bench.take(1)
    assert bench.send() == DC1 + ACK
    assert bench.all(AfterStop) == [AfterStop(count=2, allowed=3)]


def test_3_2_a_bad_record_gives_its_room_back_and_so_the_xon() -> None:
    bench = full(part=b"9" * 34).receive(ETB + b"\x00")
    assert bench.send() == DC1
    assert bench.quiet().send() == NAK


def test_3_2_an_xon_between_the_end_of_a_record_and_its_lrc() -> None:
    part = b"9" * 34
    bench = full(part=part).receive(ETB)
    bench.take()
    assert (bench.send(), bench.state) == (DC1, State.CHECK)
    assert bench.receive(record(part)[-1:]).send() == ACK


def test_3_2_a_record_without_room_is_refused_not_cut() -> None:
    bench = full(part=b"9" * 34).receive(b"9" * 20 + record(b"9" * 54)[-2:])
    assert bench.send() == DC1
    assert bench.quiet().send() == NAK
    bench.take()
    assert bench.receive(record(b"9" * 54)).send() == ACK
    assert bench.take() == b"9" * 54


# 5: sizes


@pytest.mark.parametrize(("cut", "count", "wire"), [(Cut.LINES, 51, 12403), (Cut.FIXED, 49, 12399)])
def test_2_2_3_the_file_of_12300_bytes(cut: Cut, count: int, wire: int) -> None:
    lines = (b"N%dG1X%.4fY%.4f\r\n" % (n, n / 100, n / 200) for n in range(1, 1000))
    text = b"".join(lines)[:12300]
    text = text[: text.rindex(b"\n") + 1]
    bench, rest, said, taken = Bench.linking(), text, 0, b""
    while rest:
        length = cut_length(rest, 256, cut, whole=True)
        assert length
        said += len(record(rest[:length]))
        assert bench.receive(record(rest[:length])).send() == ACK
        taken, rest, count = taken + bench.take(), rest[length:], count - 1
    bench.receive(EOT)
    assert (count, said + 1, taken == text) == (0, wire, True)
    assert bench.end() == (Outcome.COMPLETE, len(text), len(text))
    assert bench.all(Notice) == []


# everything at once


@given(
    texts=st.lists(st.binary(max_size=256).map(lambda data: bytes(32 + byte % 90 for byte in data)), max_size=12),
    lrc=st.sampled_from(LRC_CANDIDATES),
    hold=st.sampled_from(Hold),
    damage=st.dictionaries(st.integers(0, 11), st.tuples(st.integers(0, 257), st.integers(1, 127))),
    step=st.integers(1, 700),
)
def test_any_records_any_damage_any_appetite(
    texts: list[bytes], lrc: Lrc, hold: Hold, damage: dict[int, tuple[int, int]], step: int
) -> None:
    """A host as simple as the text: record, wait for ACK or NAK, next or same. Obeys XOFF at once."""
    texts = [b"%d" % number + text[:240] for number, text in enumerate(texts)]
    bench = Bench.linking(lrc=lrc, hold=hold, buffer=700)
    taken = bytearray()
    for number, text in enumerate(texts):
        wire = bytearray(record(text, lrc))
        if number in damage:
            position, flip = damage[number]
            wire[position % len(text)] ^= flip
            wire[position % len(text)] |= 0x20  # stays text, so that the record keeps its shape
        for sent in (bytes(wire), record(text, lrc)):
            answer = say(bench, sent, step, taken)
            if answer == ACK:
                break
        assert answer == ACK
    bench.receive(EOT)
    taken += bench.take()
    assert bytes(taken) == b"".join(texts)
    assert all(stop.count == 0 for stop in bench.all(AfterStop))
    assert bench.ended().outcome is (Outcome.COMPLETE if texts else Outcome.FAILED)


def say(bench: Bench, wire: bytes, step: int, taken: bytearray) -> bytes:
    """One record, character by character, none while XOFF holds; the ACK or NAK that answers it."""
    said = b""
    for character in wire:
        bench.receive(bytes([character]))
        said = bench.send()
        while said == DC3:
            taken += bench.take(step)
            said = bench.send() or said
    while not said.endswith((ACK, NAK)):
        taken += bench.take(step)
        said = bench.wait(0.2).send()
    return said[-1:]
