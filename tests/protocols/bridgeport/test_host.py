"""The host's end: the worked examples byte by byte, names (1.1) and requests (1.2)."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    SECOND,
    Ended,
    Held,
    LineFault,
    Notice,
    Outcome,
    Requested,
    Resumed,
    Started,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.protocols.bridgeport.host_law import State
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Lrc, lrc_of
from tests.protocols.bridgeport.host_rig import (
    ACK,
    DC1,
    DC2,
    DC3,
    DC4,
    EOT,
    ETB,
    LINES,
    LINK,
    NAK,
    PAIRS,
    Books,
    Drawer,
    P,
    Rig,
    linked,
    surfacing,
)

# the worked examples


def test_example_1_a_named_remote_load() -> None:
    rig = Rig()
    assert rig.say(DC2) == DC1
    assert rig.say(b"1234;L" + DC4) == b""
    assert rig.say(DC1) == P + EOT
    assert rig.of(Requested) == [Requested(number="1234", served=True)]
    assert rig.of(Started) == [Started(why="program 1234 by REMOTE LOAD")]
    assert rig.end is None
    assert rig.wait(2 * SECOND).end == Ended(
        outcome=Outcome.COMPLETE, reason="the control has been sent the whole program", bytes_low=18, bytes_high=18
    )


def test_example_1_with_parity_made_in_software() -> None:
    rig = Rig(parity="software")
    assert rig.say(DC2) == DC1
    assert rig.say(bytes.fromhex("B1 B2 33 B4 BB CC 14")) == b""
    text = "4E B1 30 47 30 D8 30 59 30 8D 0A 4E B2 30 4D B2 8D 0A 84"
    assert rig.say(DC1) == bytes.fromhex(text)
    assert rig.of(Requested) == [Requested(number="1234", served=True)]
    assert rig.wait(2 * SECOND).end


def test_example_2_a_program_the_control_saves() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.name(b"1234;L")
    assert rig.say(DC2) == DC1
    assert rig.say(P + EOT + DC4) == b""
    assert sink.getvalue() == P
    assert rig.end is None, "a cancel may still follow"
    assert rig.wait(2 * SECOND).end == Ended(
        outcome=Outcome.COMPLETE, reason="the control has sent program 1234", bytes_low=18, bytes_high=18
    )
    assert rig.of(Violation) == []


def test_example_3_dnc_link_with_a_damaged_record() -> None:
    rig = linked()
    assert rig.say(DC1) == LINES[0] + ETB + b"\x33"
    assert rig.say(ACK) == LINES[1] + ETB + b"\x34"
    assert rig.say(NAK) == LINES[1] + ETB + b"\x34"
    assert rig.say(ACK) == LINES[2] + ETB + b"\x22"
    assert rig.say(ACK) == EOT
    assert rig.wait(2 * SECOND).end == Ended(
        outcome=Outcome.COMPLETE,
        reason="the control has been sent the whole program",
        bytes_low=len(LINK),
        bytes_high=len(LINK),
    )


@pytest.mark.parametrize("data", [b"0" * 256, b"04", b"06", b"07", b"03", b"05", b"02", b"01", b"AR", b"AP", b"%\r\n"])
@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
def test_example_4_a_check_character_may_look_like_any_code(data: bytes, lrc: Lrc) -> None:
    rig = Rig(data, lrc=lrc).name(b"1;D")
    assert rig.say(DC1) == data + ETB + bytes([lrc_of(data, 0x17, lrc)])
    assert rig.say(ACK) == EOT


@pytest.mark.parametrize("late", range(4))
def test_example_5_flow_control(late: int) -> None:
    rig = Rig()
    rig.hear(DC1)
    assert rig.take(5) == P[:5]
    rig.hand_over(late)
    rig.hear(DC3)
    assert rig.take() == b""
    assert rig.wait(60 * SECOND).take() == b""
    assert rig.say(DC1) == (P + EOT)[5 + late :]
    assert rig.of(Held)
    assert rig.of(Resumed)


@pytest.mark.parametrize("pair", PAIRS)
def test_example_6_cancel_by_any_pair(pair: bytes) -> None:
    rig = Rig()
    rig.hear(DC1)
    rig.take(6)
    assert rig.say(pair) == b""
    assert rig.end is not None
    assert rig.end.outcome is Outcome.CANCELLED
    assert (rig.end.bytes_low, rig.end.bytes_high) == (0, 6)
    assert rig.say(DC1) == b"", "a later DC1 brings nothing"
    assert rig.of(Violation) == [], "the other half of the pair is swallowed"


def test_example_7_the_dumb_subset() -> None:
    rig = Rig()
    assert rig.say(DC1) == P + EOT
    assert rig.of(Requested) == [Requested(number=None, served=True)]
    assert rig.of(Started) == [Started(why="a program without a name by REMOTE LOAD")]


def test_example_7_with_nothing_armed_nothing_is_sent_and_the_operator_is_asked() -> None:
    rig = Rig(None)
    assert rig.say(DC1) == b""
    assert rig.host.state is State.HOLD
    assert rig.of(Requested) == [Requested(number=None, served=False)]


@pytest.mark.parametrize(
    ("settings", "records", "last", "total"),
    [({}, 51, 132, 12403), ({"record_cut": "fixed"}, 49, 12, 12399), ({"avoid_lrc_codes": "on"}, 54, None, None)],
)
def test_example_8_the_long_program(
    settings: dict[str, str], records: int, last: int | None, total: int | None
) -> None:
    program = surfacing()
    assert len(program) == 12300
    rig = Rig(program, **settings).name(b"77;D")
    said = [rig.say(DC1)]
    while said[-1] != EOT:
        said.append(rig.say(ACK))
    texts = [record[:-2] for record in said[:-1]]
    assert b"".join(texts) == program
    assert len(texts) == records
    assert max(map(len, texts)) <= 256
    assert last is None or len(texts[-1]) == last
    assert total is None or sum(map(len, said)) == total
    assert not rig.of(Notice)


# 1.1, names


@pytest.mark.parametrize("ending", [DC4, EOT, b"\r\n" + DC4, EOT + DC4, b"\x00\x7f" + DC4])
@pytest.mark.parametrize("number", ["1", "123456", "000042"])
@pytest.mark.parametrize("letter", list(Mode))
def test_1_1_a_name_in_any_ending_is_for_the_next_request(number: str, letter: Mode, ending: bytes) -> None:
    books = Books({number: LINK})
    rig = Rig(None)
    rig.host.serve(books, 0)
    assert rig.say(DC2) == DC1
    assert rig.say(f"{number};{letter}".encode() + ending) == b""
    assert books.asked == []
    first = LINK + ETB + bytes([lrc_of(LINK, 0x17, Lrc.XOR7_ETB)]) if letter is Mode.LINK else LINK + EOT
    assert rig.say(DC1) == first
    assert books.asked == [(number, letter)]
    assert rig.of(Violation) == []


@pytest.mark.parametrize(
    ("word", "number"),
    [(b"1234", "1234"), (b"AB;L", None), (b"", None), (b"1234567", None), (b"../x;L", None), (b"1;X", None)],
)
def test_1_1_an_unusual_name_never_becomes_more_than_digits(word: bytes, number: str | None) -> None:
    books = Books({"1234": P})
    rig = Rig(None)
    rig.host.serve(books, 0)
    rig.name(word)
    assert len(rig.of(Notice)) == 1
    assert rig.say(DC1) == (P + EOT if number else b"")
    assert books.asked == [(number, None)]


def test_1_1_an_unusual_name_without_a_letter_gets_what_its_length_asks_for() -> None:
    rig = Rig(surfacing()).name(b"1234")
    assert rig.say(DC1)[-2:-1] == ETB


def test_1_1_a_name_is_used_once() -> None:
    books = Books({"1": P})
    rig = Rig(None)
    rig.host.serve(books, 0)
    rig.name(b"1;L").say(DC1)
    rig.wait(5 * SECOND)
    rig.say(DC1)
    assert books.asked == [("1", Mode.LOAD), (None, None)]


def test_1_1_the_control_repeats_its_opening_until_it_is_answered() -> None:
    rig = Rig()
    rig.hear(DC2).wait(3 * SECOND)
    assert rig.say(DC2) == DC1
    rig.wait(3 * SECOND)
    assert rig.say(DC2) == DC1
    rig.hear(b"1;L", DC4)
    assert rig.say(DC1) == P + EOT
    assert rig.of(Violation) == []


# 1.2, requests


def test_1_2_what_is_not_there_is_asked_of_the_operator_who_may_answer() -> None:
    rig = Rig(None)
    rig.host.serve(Books({}), 0)
    assert rig.name(b"42;L").say(DC1) == b""
    assert rig.host.state is State.HOLD
    assert rig.of(Requested) == [Requested(number="42", served=False)]
    assert rig.say(DC1) == b"", "the control only repeats itself"
    rig.host.answer(BytesIO(P), rig.now)
    assert rig.take() == P + EOT


def test_1_2_what_is_armed_while_the_control_waits_goes_to_its_next_request() -> None:
    rig = Rig(None).name(b"42;L")
    rig.say(DC1)
    rig.host.start(BytesIO(P), rig.now)
    assert rig.take() == b""
    assert rig.say(DC1) == P + EOT
    assert rig.of(Requested)[1] == Requested(number="42", served=True)


def test_1_2_an_answer_that_nobody_waits_for_is_refused() -> None:
    with pytest.raises(UsageError, match="waits for no program"):
        Rig().host.answer(BytesIO(P), 0)


def test_1_2_a_request_that_waits_too_long_has_failed() -> None:
    rig = Rig(None)
    rig.host.serve(Books({}), 0, policy=Policy.ONCE)
    rig.name(b"42;L").say(DC1)
    rig.wait(601 * SECOND)
    assert rig.end is not None
    assert rig.end.reason.startswith("nobody gave program 42 within 600 s")
    assert rig.host.state is State.REST


def test_1_2_a_missing_program_may_be_answered_by_an_empty_one() -> None:
    rig = Rig(None, missing="eot")
    rig.host.serve(Books({}), 0)
    assert rig.name(b"42;L").say(DC1) == EOT
    rig.wait(2 * SECOND)
    assert rig.end is not None
    assert (rig.end.outcome, rig.end.bytes_high) == (Outcome.FAILED, 0)
    assert "no program 42" in rig.end.reason


@pytest.mark.parametrize("ending", [EOT + DC4, EOT, DC4, b"\x03\x04", EOT + b"\r\n"])
def test_1_2_2_a_program_in_any_ending_goes_to_its_place_by_number(ending: bytes) -> None:
    drawer, rig = Drawer(), Rig(None, name_end="03 04 14")
    rig.host.serve(None, 0, shelf=drawer)
    for number, text in (("7", LINK), ("12", P)):
        rig.name(f"{number};L".encode())
        assert rig.say(DC2) == DC1
        rig.say(text + ending)
        rig.wait(2 * SECOND)
        assert drawer.programs[number].getvalue() == text
    assert [event.outcome for event in rig.events if isinstance(event, Ended)] == [Outcome.COMPLETE] * 2


def test_1_2_2_a_program_without_a_name_is_unnamed() -> None:
    drawer, rig = Drawer(), Rig(None)
    rig.host.serve(None, 0, shelf=drawer)
    assert rig.say(DC2) == DC1
    rig.say(P + EOT)
    rig.wait(2 * SECOND)
    assert drawer.programs[None].getvalue() == P


def test_1_2_2_a_program_nobody_asked_for_is_dropped_and_told() -> None:
    rig = Rig(None)
    rig.hear(DC2)
    rig.take()
    rig.hear(LINK + EOT)
    assert rig.of(Notice) == [
        Notice(text="the control sends a program without a name, which nobody has asked for: it is dropped"),
        Notice(text=f"{len(LINK)} bytes of it were dropped"),
    ]
    assert rig.end is None


def test_1_2_2_a_program_nobody_asked_for_is_told_before_its_end_which_may_not_come() -> None:
    rig = Rig()
    rig.hear(DC2)
    rig.take()
    rig.hear(b"9" * 65)
    assert "nobody has asked for" in str(rig.of(Notice))
    rig.hear(b"9" * 2_000_000)
    assert len(rig.of(Notice)) == 1
    assert rig.end is None, "what is armed stays armed"


def test_1_2_2_nothing_but_text_is_stored() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(DC2)
    rig.take()
    rig.hear(b"\x00" * 40 + P[:5] + DC1 + DC3 + b"\x7f" + P[5:] + b"\x00" * 9 + EOT + DC4)
    assert sink.getvalue() == P


def test_1_2_2_silence_inside_a_program_is_a_failure() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(DC2)
    rig.take()
    rig.hear(LINK * 4)
    rig.wait(29 * SECOND).hear(LINK)
    rig.wait(31 * SECOND)
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert rig.end.bytes_low == len(LINK) * 5


def test_1_2_2_silence_after_the_opening_leaves_what_is_armed() -> None:
    rig = Rig()
    rig.hear(DC2)
    rig.take()
    rig.wait(31 * SECOND)
    assert rig.end is None
    assert rig.say(DC1) == P + EOT


def test_1_2_2_more_than_the_limit_is_a_failure_and_what_came_before_is_kept() -> None:
    rig, sink = Rig(None, upload_limit="100"), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(DC2)
    rig.take()
    rig.hear(b"X" * 150, b"Y" * 1000 + EOT + DC4)
    assert sink.getvalue() == b"X" * 100
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "more than 100 bytes" in rig.end.reason


def test_1_2_2_a_damaged_character_makes_the_program_doubtful() -> None:
    rig, sink = Rig(None), BytesIO()
    rig.host.receive(sink, 0)
    rig.hear(DC2)
    rig.take()
    rig.hear(P)
    rig.host.receive_line_fault(LineFault.PARITY, 0x80 | ord("Z"), rig.now)
    rig.hear(EOT + DC4).wait(2 * SECOND)
    assert sink.getvalue() == P + b"Z"
    assert rig.end is not None
    assert rig.end.outcome is Outcome.FAILED
    assert "parity error at byte 19" in rig.end.reason


def test_1_2_2_the_operator_may_be_answered_by_xoff_where_related_links_do() -> None:
    rig = Rig(None, closing_dc3="on")
    rig.host.receive(BytesIO(), 0)
    rig.hear(DC2)
    rig.take()
    assert rig.say(P + EOT) == DC3


def test_1_2_2_a_program_as_to_a_tape_punch() -> None:
    rig, sink = Rig(None, punch_mode="on"), BytesIO()
    rig.host.receive(sink, 0)
    assert rig.say(P + EOT) == b""
    rig.wait(2 * SECOND)
    assert sink.getvalue() == P
    assert rig.end is not None
    assert rig.end.outcome is Outcome.COMPLETE
