"""The host's end: texts and records (2), suspension (3), errors (4), endings, and lrc=auto."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Ended,
    Notice,
    Outcome,
    Violation,
)
from tapewire.protocols.bridgeport.host_law import State
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Cut, DncEnd, Lrc, lrc_of
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
    LINK,
    NAK,
    PAIRS,
    Books,
    P,
    Rig,
    in_state,
    linked,
    surfacing,
)

# 2, records


@pytest.mark.parametrize("word", [b"1;L", None])
def test_2_1_1_more_than_12000_bytes_send_nothing(word: bytes | None) -> None:
    rig = Rig(surfacing())
    if word:
        rig.name(word)
    assert rig.say(DC1) == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "12,000 bytes" in rig.end.reason
    assert rig.end.bytes_high == 0


def test_2_1_1_exactly_12000_bytes_are_one_text() -> None:
    rig = Rig(b"X" * 12000).name(b"1;L")
    assert rig.say(DC1) == b"X" * 12000 + EOT


def test_2_2_1_a_short_program_is_served_by_records_and_told() -> None:
    rig = linked()
    rig.say(DC1)
    assert rig.of(Notice) == [Notice(text="25 bytes by DNC LINK: 12,000 or less are for ;L (2.2.1)")]


def test_2_2_1_of_a_long_program_nothing_is_told() -> None:
    rig = Rig(b"X" * 12001).name(b"1;D")
    rig.say(DC1)
    assert rig.of(Notice) == []


@pytest.mark.parametrize("cut", list(Cut))
def test_2_2_3_a_line_longer_than_a_record_is_cut(cut: Cut) -> None:
    program = b"A" * 300 + b"\r\nB\r\n"
    rig = Rig(program, record_cut=cut).name(b"1;D")
    records = [rig.say(DC1)]
    assert records[0][:-2] == b"A" * 256
    while records[-1] != EOT:
        records.append(rig.say(ACK))
    assert b"".join(record[:-2] for record in records[:-1]) == program


@pytest.mark.parametrize("size", [255, 256, 257, 512])
@pytest.mark.parametrize("cut", list(Cut))
def test_2_2_3_no_record_is_empty_and_none_too_long(size: int, cut: Cut) -> None:
    rig = Rig(b"A" * size, record_cut=cut).name(b"1;D")
    records = [rig.say(DC1)]
    while records[-1] != EOT:
        assert 3 <= len(records[-1]) <= 258
        records.append(rig.say(ACK))
    assert b"".join(record[:-2] for record in records[:-1]) == b"A" * size


@pytest.mark.parametrize("word", [b"1;L", b"1;D"])
@pytest.mark.parametrize("byte", [0x00, 0x04, 0x07, 0x10, 0x11, 0x17, 0x1B, 0x7F, 0x80, 0xB1])
def test_a_byte_that_would_forge_a_code_ends_the_job_before_anything_is_sent(word: bytes, byte: int) -> None:
    rig = Rig(P + bytes([byte]) + P).name(word)
    assert rig.say(DC1) == b""
    assert rig.end is not None
    assert rig.end.reason.startswith("byte 19 of the program is ")


@pytest.mark.parametrize(("word", "ack"), [(b"1;L", b""), (b"1;D", ACK)])
def test_an_end_code_as_the_last_byte_is_the_programs_own(word: bytes, ack: bytes) -> None:
    rig = Rig(P + EOT).name(word)
    said = rig.say(DC1) + rig.say(ack)
    assert said.count(EOT) == 1
    assert said.endswith(EOT)
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low, rig.end.bytes_high) == (Outcome.COMPLETE, 19, 19)


def test_a_program_without_a_name_may_end_with_its_text() -> None:
    rig = Rig(dumb_eot="off")
    assert rig.say(DC1) == P
    assert rig.wait(2 * SECOND).end


@pytest.mark.parametrize("word", [b"1;L", b"1;D"])
def test_an_empty_program_sends_nothing(word: bytes) -> None:
    rig = Rig(b"").name(word)
    assert rig.say(DC1) == b""
    assert rig.end is not None
    assert "empty" in rig.end.reason


# 3, suspension


def test_3_1_a_program_the_control_sends_is_paused_by_xoff_and_xon() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(DC2)
    rig.take()
    rig.hear(P)
    rig.host.hold_reception(rig.now)
    assert rig.take() == DC3
    rig.wait(100 * SECOND)
    assert rig.end is None, "silence that we asked for is no failure"
    rig.host.release(rig.now)
    assert rig.take() == DC1
    rig.hear(EOT + DC4).wait(2 * SECOND)
    assert sink.getvalue() == P


def test_3_2_a_pause_without_end_is_limited() -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(5)
    rig.hear(DC3).wait(601 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "held by XOFF" in rig.end.reason
    assert rig.say(DC1) == b"", "the control that lost power does not resume in the middle"


@pytest.mark.parametrize("position", range(13))
def test_3_2_nothing_of_a_record_is_sent_while_held_its_check_character_neither(position: int) -> None:
    rig = linked()
    rig.hear(DC1)
    first = LINES[0] + ETB + b"\x33"
    assert rig.take(position) == first[:position]
    assert rig.say(DC3) == b""
    assert rig.say(DC1) == first[position:]


def test_3_2_an_ack_while_held_waits_for_xon() -> None:
    rig = linked()
    rig.say(DC1)
    assert rig.say(DC3 + ACK) == b""
    assert rig.wait(60 * SECOND).take() == b""
    assert rig.say(DC1) == LINES[1] + ETB + b"\x34"


def test_3_2_an_ack_while_held_may_be_believed_after_a_grace() -> None:
    rig = linked(xoff_ack_grace="2")
    rig.say(DC1)
    assert rig.say(DC3 + ACK) == b""
    assert rig.wait(SECOND).take() == b""
    assert rig.wait(SECOND).take() == LINES[1] + ETB + b"\x34"


# 4, errors


def test_4_1_1_the_control_cancels_a_text_with_a_damaged_character() -> None:
    rig = Rig(b"X" * 1000)
    rig.hear(DC1)
    rig.take(300)
    rig.wait(200 * MILLISECOND)
    rig.take(50)
    assert rig.say(DLE) == b""
    assert rig.end == Ended(
        outcome=Outcome.CANCELLED, reason="cancelled at the control (DLE)", bytes_low=300, bytes_high=350
    )


def test_4_2_1_records_are_proven_by_their_ack() -> None:
    rig = linked()
    rig.say(DC1)
    rig.say(ACK)
    rig.hear(ACK)
    rig.take(4)
    rig.hear(DLE)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (18, 22)


def test_4_2_1_an_ack_and_a_nak_to_one_record_end_the_job() -> None:
    """Whether the control has it cannot be told: the next one behind a missing one would make a wrong part."""
    rig = linked()
    rig.say(DC1)
    rig.hear(ACK, NAK)
    assert rig.take() == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "by ACK and then by NAK" in rig.end.reason


def test_4_2_1_two_naks_before_the_copy_begins_draw_one_copy() -> None:
    rig = linked()
    first = rig.say(DC1)
    rig.hear(NAK, NAK)
    assert rig.take() == first


def test_4_2_1_one_ack_too_many_after_an_early_copy_ends_the_job() -> None:
    """The record was good in spite of the NAK inside it, and so was its copy: the control has it twice."""
    rig = linked()
    rig.hear(DC1)
    rig.take(3)
    rig.hear(NAK)
    rig.take()
    rig.hear(ACK)
    rig.take(3)
    rig.hear(ACK)
    assert rig.take() == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "one too many" in rig.end.reason


@pytest.mark.parametrize(("early", "outcome"), [(True, Outcome.FAILED), (False, Outcome.COMPLETE)])
def test_4_2_1_an_ack_behind_the_end_is_one_too_many_only_where_a_copy_was_unasked(
    early: bool, outcome: Outcome
) -> None:
    """A control that holds every ACK back until the next record is out has its last one come behind EOT."""
    rig = linked()
    rig.hear(DC1)
    if early:
        rig.take(3)
        rig.hear(NAK)
    while EOT not in rig.take():
        rig.hear(ACK)
    rig.hear(ACK)
    rig.wait(60 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is outcome, rig.end.reason


def test_4_2_1_a_nak_before_the_record_is_complete_waits_for_its_end() -> None:
    rig = linked()
    rig.hear(DC1)
    first = LINES[0] + ETB + b"\x33"
    assert rig.take(5) == first[:5]
    rig.hear(NAK)
    assert rig.take() == first[5:] + first


def test_4_2_1_an_ack_before_the_record_is_complete_is_no_ack() -> None:
    rig = linked()
    rig.hear(DC1)
    rig.take(5)
    rig.hear(ACK)
    rig.take()
    assert len(rig.of(Violation)) == 1
    assert rig.say(ACK) == LINES[1] + ETB + b"\x34"


@pytest.mark.parametrize("inside", [True, False])
def test_4_2_1_an_ack_inside_a_record_and_a_nak_behind_it_end_the_job(inside: bool) -> None:
    """The control took a part of the record for the whole, and has that part already."""
    rig = linked()
    rig.hear(DC1)
    rig.take(5)
    rig.hear(ACK)
    rig.take(0 if inside else 100)
    rig.hear(NAK)
    assert rig.take() == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "an ACK came inside record 1 and a NAK behind it" in rig.end.reason
    assert "cancel the transfer at the control" in rig.end.reason


def test_4_2_1_an_ack_inside_a_copy_ends_the_job() -> None:
    """The control has it already, and takes the rest of the copy for more."""
    rig = linked()
    rig.hear(DC1)
    rig.take()
    rig.hear(NAK)
    rig.take(5)
    rig.hear(ACK)
    assert rig.take() == b""
    assert rig.end is not None
    assert "an ACK came inside a copy of record 1" in rig.end.reason


def test_4_2_1_an_ack_inside_a_record_that_is_then_acknowledged_means_nothing() -> None:
    rig = linked()
    rig.hear(DC1)
    rig.take(5)
    rig.hear(ACK)
    rig.take()
    assert rig.say(ACK).startswith(LINES[1])
    assert rig.say(NAK).startswith(LINES[1])


def test_4_2_1_an_ack_counts_from_when_the_record_was_handed_over() -> None:
    rig = linked()
    rig.hear(DC1)
    rig.hand_over(13)
    rig.hear(ACK)
    rig.leave()
    assert rig.take() == LINES[1] + ETB + b"\x34"


def test_4_2_1_many_naks_of_one_record_are_told_once() -> None:
    rig = linked()
    rig.say(DC1)
    rig.say(ACK)
    for _ in range(6):
        assert rig.say(NAK) == LINES[1] + ETB + b"\x34"
    told = [event.text for event in rig.events if isinstance(event, Notice) and "refused" in event.text]
    assert told == ["record 2 was refused 3 times; the setting of lrc is doubtful"]


def test_4_2_1_the_first_record_may_wait_for_an_ack() -> None:
    rig = linked(first_record="on_ack")
    assert rig.say(DC1) == b""
    assert rig.say(ACK) == LINES[0] + ETB + b"\x33"
    assert rig.say(ACK) == LINES[1] + ETB + b"\x34"


def test_4_2_1_no_answer_to_a_record_may_be_limited() -> None:
    assert linked().wait(0).end is None
    patient, strict = linked(), linked(ack_limit="20")
    for rig in (patient, strict):
        rig.say(DC1)
        rig.wait(24 * 3600 * SECOND)
    assert patient.end is None
    assert strict.end is not None
    assert "no answer" in strict.end.reason


@pytest.mark.parametrize("state", [state for state in State if state is not State.REST])
@pytest.mark.parametrize("pair", PAIRS)
def test_4_3_2_cancel_in_every_state(state: State, pair: bytes) -> None:
    rig = in_state(state)
    said = rig.say(pair)
    assert said == b""
    assert rig.host.state is State.REST
    rig.wait(5 * SECOND)
    assert rig.say(DC1) == b""
    assert not [event for event in rig.events if isinstance(event, Violation)]


def test_4_3_2_after_a_cancel_the_name_is_forgotten() -> None:
    books = Books({"1": P})
    rig = Rig(None)
    rig.host.serve(books, 0)
    rig.name(b"1;L").say(DLE)
    rig.say(DC1)
    assert books.asked == [(None, None)]


def test_4_3_2_a_cancel_between_name_and_request_ends_what_is_armed() -> None:
    rig = Rig().name(b"1;L")
    rig.say(DLE)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED


def test_4_3_2_what_was_on_its_way_is_called_back() -> None:
    rig = Rig(b"X" * 100)
    rig.hear(DC1)
    rig.hand_over(40)
    rig.host.receive_data(DLE, rig.now)
    assert rig.host.recall
    rig.settle(recalled=15)
    assert rig.end is not None
    assert (rig.end.bytes_low, rig.end.bytes_high) == (0, 25)


# how a program ends, and the search for the check character


@pytest.mark.parametrize(
    ("how", "tail"),
    [
        (DncEnd.EOT_ON_ACK, [b"N30M2\r\n\x17\x22", EOT]),
        (DncEnd.EOT_AFTER_LRC, [b"N30M2\r\n\x17\x22\x04", b""]),
        (DncEnd.ETX_LAST, [b"N30M2\r\n\x03\x36", EOT]),
        (DncEnd.EMPTY_THEN_EOT, [b"N30M2\r\n\x17\x22", b"\x17\x17", EOT]),
    ],
)
def test_every_ending_of_a_dnc_file(how: DncEnd, tail: list[bytes]) -> None:
    rig = linked(dnc_end=how)
    rig.say(DC1)
    assert rig.say(ACK) == LINES[1] + ETB + b"\x34"
    for expected in tail:
        assert rig.end is None
        assert rig.say(ACK) == expected
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, len(LINK))


def test_a_last_record_may_be_answered_before_the_eot_behind_it_is_out() -> None:
    """In a closed loop the check character leaves before the EOT is handed over: the control has the record then."""
    rig = linked(dnc_end=DncEnd.EOT_AFTER_LRC)
    rig.say(DC1)
    rig.say(ACK)
    rig.hear(ACK)
    assert rig.take(9) == b"N30M2\r\n\x17\x22"
    assert rig.say(ACK) == EOT
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_low) == (Outcome.COMPLETE, len(LINK))


@pytest.mark.parametrize("how", list(DncEnd))
def test_a_refused_last_record_comes_again_with_its_ending(how: DncEnd) -> None:
    rig = linked(dnc_end=how)
    rig.say(DC1)
    rig.say(ACK)
    last = rig.say(ACK)
    assert rig.say(NAK) == last


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
@pytest.mark.parametrize("program", [LINK, surfacing(), P * 100])
def test_lrc_auto_finds_every_candidate(lrc: Lrc, program: bytes) -> None:
    rig = Rig(program, lrc="auto").name(b"1;D")
    taken, said = b"", rig.say(DC1)
    refused = 0
    while said != EOT:
        data, end_code, check = said[:-2], said[-2], said[-1]
        good = check == lrc_of(data, end_code, lrc)
        refused += not good
        taken += data if good else b""
        said = rig.say(ACK if good else NAK)
    assert taken == program
    assert refused <= 2 * LRC_CANDIDATES.index(lrc), "only the search itself is refused"
    assert Notice(text=f"the control takes lrc={lrc}") in rig.of(Notice)


def test_lrc_auto_gives_every_candidate_a_second_chance_and_the_list_a_second_round() -> None:
    rig = Rig(LINK, lrc="auto").name(b"1;D")
    records = [rig.say(DC1)] + [rig.say(NAK) for _ in range(2 * len(LRC_CANDIDATES))]
    assert records[0::2][: len(LRC_CANDIDATES)] == records[1::2]
    assert len(set(records)) == len(LRC_CANDIDATES)
    assert records[-1] == records[0]


def test_lrc_auto_never_changes_after_the_first_ack() -> None:
    rig = Rig(surfacing(), lrc="auto").name(b"1;D")
    rig.say(DC1)
    second = rig.say(ACK)
    assert {rig.say(NAK) for _ in range(20)} == {second}
