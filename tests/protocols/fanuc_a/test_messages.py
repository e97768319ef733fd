"""Messages of protocol A against vectors, both ways, and whatever the pieces they come in."""

from __future__ import annotations

import json
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.messages import (
    ANSWERS,
    LONGEST_DATA,
    ORIGINS,
    Coding,
    Command,
    DataError,
    EndCode,
    Error,
    Message,
    MessageCode,
    MessageReader,
    Origin,
    Reading,
    RetryReason,
    Unreadable,
    encode_image,
    encode_message,
    parse_image,
    parse_retry_reason,
)
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import (
    POWER_ON,
    AlarmCause,
    BufferState,
    Filler,
    Parameters,
    Setting,
    Status,
)
from tapewire.protocols.fanuc_a.words import Words
from tapewire.protocols.settings import End

VECTORS: dict[str, Any] = json.loads((Path(__file__).parents[2] / "vectors" / "fanuc_a.json").read_text())
CODINGS = [Coding(code=code, end=end) for code in MessageCode for end in EndCode]
ASCII = Coding()


def name(coding: Coding) -> str:
    return f"{coding.code}_{coding.end}"


def read_all(reader: MessageReader, data: bytes) -> list[Reading]:
    found, position = [], 0
    while position < len(data):
        position, reading = reader.read(data, position)
        if reading is not None:
            found.append(reading)
    return found


def read_one(data: bytes, coding: Coding = ASCII) -> Reading:
    [reading] = read_all(MessageReader(coding), data)
    return reading


@pytest.mark.parametrize("coding", CODINGS, ids=name)
@pytest.mark.parametrize("command", Command)
def test_every_command_both_ways(command: Command, coding: Coding) -> None:
    wire = bytes.fromhex(VECTORS["messages"][command.value][name(coding)])
    assert encode_message(Message(command=command), coding) == wire
    assert read_one(wire, coding) == Message(command=command)


@pytest.mark.parametrize("vector", VECTORS["messages_with_data"], ids=lambda v: v["command"] + v["data"])
def test_messages_with_data_both_ways(vector: dict[str, str]) -> None:
    message = Message(command=Command[vector["command"]], data=vector["data"].encode())
    wire = bytes.fromhex(vector["ascii_cr"])
    assert encode_message(message, ASCII) == wire
    assert read_one(wire) == message


@pytest.mark.parametrize("vector", VECTORS["dat"], ids=lambda v: f"{v['code']}_{v['end']}_{v['bytes'][:5]}")
def test_dat_both_ways(vector: dict[str, str]) -> None:
    coding = Coding(code=MessageCode(vector["code"]), end=EndCode(vector["end"]))
    wire = bytes.fromhex(vector["bytes"])
    message = Message(command=Command.DAT, data=wire[5:-1])
    assert encode_message(message, coding) == wire
    assert read_one(wire, coding) == message


def test_iso_digits() -> None:
    iso = Coding(code=MessageCode.ISO)
    assert {digit: iso.encode(digit.encode()).hex().upper() for digit in "0123456789ABCDEF"} == VECTORS["iso_digits"]


STATUSES: dict[str, Status | Setting] = {
    "SAT, power-on values": Status(),
    "SAT, reset state": Status(state=BufferState.RESET),
    "SAT, operating, 291 bytes stored": Status(state=BufferState.OPERATING, stored=291),
    "SET Ti=0 Tx=10": Setting(parameters=Parameters(ti=0, tx=10)),
    "SET Ti=0 Tx=10 n=1": Setting(parameters=Parameters(ti=0, tx=10, n=1)),
    "SET convert 3B to 0A": Setting(parameters=Parameters(convert_from=0x3B, convert_to=0x0A)),
}


@pytest.mark.parametrize("vector", VECTORS["status_texts"], ids=lambda v: v["what"])
def test_sat_and_set_both_ways(vector: dict[str, str]) -> None:
    record = STATUSES[vector["what"]]
    command = Command.SAT if isinstance(record, Status) else Command.SET
    wire = vector["text"].encode() + b"\r"
    assert encode_message(Message(command=command, data=record.encode()), ASCII) == wire
    reading = read_one(wire)
    assert isinstance(reading, Message)
    assert type(record).parse(reading.data, POWER_ON) == record


@pytest.mark.parametrize(("filler", "total"), [(Filler.ZERO, b"D0"), (Filler.BLANK, b"60")])
@pytest.mark.parametrize("length", [56, 72])
def test_unused_positions_may_be_zero_or_blank(filler: Filler, total: bytes, length: int) -> None:
    data = Status().encode(length, filler)
    assert len(data) == length
    assert encode_message(Message(command=Command.SAT, data=data), ASCII)[:2] == total
    assert Status.parse(data) == Status()


@given(length=st.integers(8, 72))
def test_a_short_sat_leaves_what_it_does_not_say(length: int) -> None:
    said = Status(state=BufferState.ALARM, cause=AlarmCause.OVERRUN, stored=17, parameters=Parameters(nb=1, tw=2, n=4))
    base = Parameters(nb=3000, tw=0, n=2)
    status = Status.parse(said.encode(72)[:length], base)
    assert (status.state, status.cause, status.stored) == (BufferState.ALARM, AlarmCause.OVERRUN, 17)
    assert status.parameters.nb == (1 if length >= 12 else 3000)
    assert status.parameters.tw == (2 if length >= 40 else 0)
    assert status.parameters.n == (4 if length >= 56 else 2)


def test_a_blank_stands_for_a_leading_zero() -> None:
    """The manual's example writes 0Ah as blank and A."""
    data = bytearray(Setting().encode())
    data[44:48] = b"3B A"
    assert Setting.parse(bytes(data), POWER_ON).parameters == Parameters(convert_from=0x3B, convert_to=0x0A)


@pytest.mark.parametrize(
    ("at", "wrong"), [(1, b"9"), (4, b"00G0"), (8, b"0x1F"), (8, b"-001"), (8, b"7 D0"), (12, b"\xff")]
)
def test_a_sat_that_cannot_be(at: int, wrong: bytes) -> None:
    data = bytearray(Status().encode())
    data[at : at + len(wrong)] = wrong
    with pytest.raises(DataError):
        Status.parse(bytes(data))


def test_an_unknown_cause_matters_in_alarm_only() -> None:
    assert Status.parse(b"01Z00000").state is BufferState.RESET
    with pytest.raises(DataError, match="cause"):
        Status.parse(b"03Z00000")
    with pytest.raises(DataError, match="7 positions"):
        Status.parse(b"0100000")


@given(data=st.binary(max_size=80))
def test_no_sat_or_set_raises_anything_else(data: bytes) -> None:
    for parse in (Status.parse, Setting.parse):
        with suppress(DataError):
            parse(data, POWER_ON)


def test_images_and_reasons() -> None:
    assert [parse_image(encode_image(image)) for image in range(256)] == list(range(256))
    assert parse_image(b"A5" + b" " * 70) == 0xA5
    for wrong in (b"", b"A", b"G0"):
        with pytest.raises(DataError):
            parse_image(wrong)
    assert [parse_retry_reason(data) for data in (b"1", b"3xx", b"2", b"")] == [*RetryReason, None, None]


class Test41:
    """Message format."""

    @pytest.mark.parametrize("coding", CODINGS, ids=name)
    def test_data_may_not_hold_the_end_code(self, coding: Coding) -> None:
        data = b"G1\n" + coding.end_byte + b"X"
        with pytest.raises(UsageError, match="offset 3"):
            encode_message(Message(command=Command.DAT, data=data), coding)

    def test_data_has_a_longest(self) -> None:
        encode_message(Message(command=Command.DAT, data=b"x" * 4096), ASCII)
        encode_message(Message(command=Command.SET, data=b"0" * LONGEST_DATA), ASCII)
        for message in (Message(command=Command.DAT, data=b"x" * 4097), Message(command=Command.SET, data=b"0" * 73)):
            with pytest.raises(UsageError, match="at most"):
                encode_message(message, ASCII)

    def test_lower_case_digits_are_understood(self) -> None:
        assert read_one(b"fcRDY\r") == Message(command=Command.RDY)

    @pytest.mark.parametrize(
        ("wire", "error"),
        [
            (b"08SYN\r", Error.CHECKSUM),
            (b"07SYM\r", Error.CHECKSUM),
            (b"G7SYN\r", Error.CHECKSUM),
            (b"\r", Error.SHORT),
            (b"07SY\r", Error.SHORT),
            (b"03ZZZ\r", Error.CHECKSUM),
            (b"1BZZZ\r", Error.UNDEFINED),
            (b"5ASDI" + b"0" * 73 + b"\r", Error.CHECKSUM),
            (b"%02XSDI%s\r" % (sum(b"SDI\r" + b"0" * 73) & 255, b"0" * 73), Error.TOO_LONG),
        ],
    )
    def test_what_is_no_message(self, wire: bytes, error: Error) -> None:
        reading = read_one(wire)
        assert isinstance(reading, Unreadable)
        assert reading.error is error
        assert reading.raw == wire

    def test_a_message_without_end_is_bounded(self) -> None:
        reader = MessageReader(ASCII, longest=LONGEST_DATA)
        assert read_all(reader, b"x" * 100_000) == []
        assert reader.pending == 100_000
        [reading] = read_all(reader, b"\r")
        assert isinstance(reading, Unreadable)
        assert (reading.error, len(reading.raw)) == (Error.TOO_LONG, LONGEST_DATA + 6)
        assert read_all(reader, b"07SYN\r") == [Message(command=Command.SYN)]

    def test_damage_spoils_one_message(self) -> None:
        reader = MessageReader(ASCII)
        assert read_all(reader, b"07S") == []
        reader.damage()
        [spoilt, good] = read_all(reader, b"YN\r07SYN\r")
        assert isinstance(spoilt, Unreadable)
        assert good == Message(command=Command.SYN)

    def test_a_message_that_stops_is_broken_off(self) -> None:
        reader = MessageReader(ASCII)
        assert reader.break_off() is None
        read_all(reader, b"07S")
        assert reader.break_off() == Unreadable(error=Error.BROKEN_OFF, raw=b"07S")
        assert (reader.pending, reader.break_off()) == (0, None)

    @given(
        data=st.lists(st.sampled_from([b"07SYN\r", b"FCRDY\r", b"\r", b"1BZZZ\r", b"D0", b"x" * 90]) | st.binary()),
        cuts=st.lists(st.integers(0, 400)),
    )
    def test_the_same_whatever_the_pieces(self, data: list[bytes], cuts: list[int]) -> None:
        whole = b"".join(data)
        pieces, reader = MessageReader(ASCII, longest=LONGEST_DATA), MessageReader(ASCII, longest=LONGEST_DATA)
        bounds = [0, *sorted(min(cut, len(whole)) for cut in cuts), len(whole)]
        found = [r for at, to in pairwise(bounds) for r in read_all(pieces, whole[at:to])]
        assert found == read_all(reader, whole)
        assert pieces.pending == reader.pending

    @given(data=st.binary(max_size=300), coding=st.sampled_from(CODINGS))
    def test_any_data_that_can_be_sent_comes_back(self, data: bytes, coding: Coding) -> None:
        message = Message(command=Command.DAT, data=data.replace(coding.end_byte, b""))
        assert read_one(encode_message(message, coding), coding) == message


class Test441:
    """Command table."""

    def test_who_sends_what(self) -> None:
        assert len(Command) == 17
        sent = {origin: {command.value for command in Command if ORIGINS[command] is origin} for origin in Origin}
        assert sent == {
            Origin.CONTROL: {"RST", "ALM", "SAT", "GTD", "SDI"},
            Origin.HOST: {"ARS", "AAL", "SET", "DAT", "WAT", "EOD", "CLB", "RDI", "SDO"},
            Origin.BOTH: {"SYN", "RDY", "RTY"},
        }

    def test_the_host_answers_with_what_a_host_may_send(self) -> None:
        for said, answers in ANSWERS.items():
            assert ORIGINS[said] is not Origin.HOST
            assert all(ORIGINS[answer] is not Origin.CONTROL for answer in answers)


class Test45:
    """Parameter table."""

    @pytest.mark.parametrize(
        ("values", "why"),
        [
            ({"Nb": "100", "No": "100"}, "leaves no room"),
            ({"Tw": "6"}, "greater than Tp"),
            ({"Ti": "3"}, "steps of 2"),
            ({"Nb": "4001"}, "1 to 4000"),
            ({"No": "1"}, "2 to 2000"),
        ],
    )
    def test_what_cannot_be_set(self, values: dict[str, str], why: str) -> None:
        with pytest.raises(UsageError, match=why):
            Params.for_protocol_a(values, End.HOST)

    def test_power_on_values_are_the_controls(self) -> None:
        assert Params.for_protocol_a({}, End.CONTROL).wanted == POWER_ON
        assert Params.for_expansion_a({}, End.CONTROL).wanted == POWER_ON
        assert POWER_ON.longest_dat == 1950

    def test_a_host_asks_for_long_dats_and_no_waiting(self) -> None:
        wanted = Params.for_protocol_a({}, End.HOST).wanted
        assert (wanted.longest_dat, wanted.no, wanted.ti, wanted.tx, wanted.n) == (3488, 512, 0, 0, 0)
        assert Params.for_expansion_a({}, End.HOST).packet_n == 4
        assert Params.for_expansion_a({"n": "1"}, End.HOST).packet_n == 1
        with pytest.raises(UsageError, match="fanuc-a"):
            Params.for_expansion_a({"n": "0"}, End.HOST)

    def test_tp_in_tenths(self) -> None:
        assert (Parameters(tp=3).tp_ms, Parameters(tp=3, unit=4).tp_ms) == (3000, 300)

    def test_a_conversion_would_change_binary_records(self) -> None:
        words = {"data": "binary", "convert_from": "10", "convert_to": "59"}
        with pytest.raises(UsageError, match="binary records"):
            Params.for_protocol_a(words, End.HOST)
        assert Params.for_protocol_a(words | {"convert_from": "11"}, End.HOST).wanted.convert_from == 11


def test_words_of_a_dialogue() -> None:
    words = Words(Params())
    sat = encode_message(Message(command=Command.SAT, data=Status(state=BufferState.RESET).encode()), ASCII)
    set_n = encode_message(Message(command=Command.SET, data=Setting(parameters=Parameters(ti=0)).encode()), ASCII)
    assert words.control(b"07SY") == []
    assert words.control(b"N\r" + sat) == ["SYN", "SAT reset, 0 stored"]
    assert words.host(set_n) == ["SET Ti=0"]
    dat = encode_message(Message(command=Command.DAT, data=b"G1\n"), ASCII)
    assert words.host(dat + b"F9SET\r3DRTY1\r00SYN\r") == ["DAT", b"G1\n", "SET", "RTY 1", "(checksum error)"]
