"""Captures as bytes: what is written is read back, whoever wrote it, and nothing in a file does harm."""

from __future__ import annotations

import io
import struct
import tracemalloc
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND
from tapewire.line.captures.reader import MAX_BLOCK, CaptureItem, Packet, Problem, read_capture
from tapewire.line.captures.records import (
    ALL_ON,
    LINK_TYPE,
    MAX_DATA,
    RTAC_HEADER,
    ByteOrder,
    Encoder,
    Happening,
    Lines,
    Origin,
    Record,
    Side,
    called_back,
    recalled,
)

NOW: Final = 1_795_345_111 * SECOND + 86_865_451
ORIGIN: Final = Origin(
    line="/dev/ttyS0", baud=19200, framing="8E1", side=Side.HOST, protocol="fanuc-b", settings={"code": "ascii"}
)

written = st.sampled_from([each for each in Happening if each not in (Happening.SENT_ALL, Happening.RECEIVED_ALL)])
records = st.builds(
    Record,
    at=st.integers(0, 2**62),
    what=written,
    lines=st.integers(0, 0x7F).map(Lines),
    data=st.binary(max_size=40),
    remark=st.text("abc ,:0123", max_size=20),
)


def read(data: bytes) -> list[CaptureItem]:
    return list(read_capture(io.BytesIO(data)))


def records_of(data: bytes) -> list[Record]:
    return [item.record for item in read(data) if isinstance(item, Packet)]


def problems_of(data: bytes) -> list[str]:
    return [item.what for item in read(data) if isinstance(item, Problem)]


def capture(*said: Record, order: ByteOrder = ByteOrder.LITTLE, origin: Origin = ORIGIN) -> bytes:
    encoder = Encoder(order)
    return encoder.header(origin) + b"".join(map(encoder.record, said))


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(f"{order}I", len(body) + 12)
    return struct.pack(f"{order}I", kind) + length + body + length


def section(order: str = "<") -> bytes:
    return block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def interface(options: bytes = b"", *, link_type: int = LINK_TYPE, order: str = "<") -> bytes:
    return block(1, struct.pack(f"{order}HHI", link_type, 0, 0xFFFF) + options, order)


def said(data: bytes, what: int = Happening.SENT, lines: int = 0x1F) -> bytes:
    return RTAC_HEADER.pack(7, 500_000, what, lines, 0) + data


def enhanced(body: bytes, ticks: int, *, number: int = 0, order: str = "<") -> bytes:
    frame = struct.pack(f"{order}5I", number, ticks >> 32, ticks & 0xFFFFFFFF, len(body), len(body))
    return block(6, frame + body, order)


@given(st.lists(records, max_size=8), st.sampled_from(ByteOrder))
def test_what_is_written_is_read(wanted: list[Record], order: ByteOrder) -> None:
    ordered = sorted(wanted, key=lambda record: record.at)
    told = replace(ORIGIN, line="/dev/ttyS0, 19200 baud 8E1, fanuc-b", framing="")
    items = read(capture(*ordered, order=order))
    assert [item.record for item in items if isinstance(item, Packet)] == ordered
    assert not [item for item in items if isinstance(item, Problem)]
    assert all(item.origin == told for item in items if isinstance(item, Packet))


def test_the_header_of_a_packet_is_that_of_the_link_type() -> None:
    (packet,) = records_of(capture(Record(at=NOW, what=Happening.RECEIVED, lines=Lines.CTS, data=b"\x11")))
    assert packet.data == b"\x11"
    whole = capture(Record(at=NOW, what=Happening.RECEIVED, lines=Lines.CTS, data=b"\x11"))
    # Seconds, microseconds, DATA_RX_START, CTS, reserved, the character: big-endian whatever the frame is.
    assert bytes.fromhex("6b02cad7 00015351 02 01 0000 11") in whole


def test_more_characters_than_a_packet_takes_become_several() -> None:
    data = bytes(range(256)) * (MAX_DATA // 128)
    whole = records_of(capture(Record(at=NOW, what=Happening.SENT, data=data)))
    assert len(whole) == 2
    assert b"".join(record.data for record in whole) == data


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    ("resolution", "ticks"),
    [(3, 7_500), (6, 7_500_000), (9, 7_500_000_000), (0x80 | 10, 7_680), (0x80, 7), (127, 2**63), (0xFF, 2**63)],
)
def test_any_resolution_of_time(order: str, resolution: int, ticks: int) -> None:
    option = struct.pack(f"{order}HHB3x", 9, 1, resolution) + struct.pack(f"{order}HHq", 14, 8, 100)
    data = section(order) + interface(option, order=order) + enhanced(said(b"x"), ticks, order=order)
    (record,) = records_of(data)
    per_second = 2 ** (resolution & 0x7F) if resolution & 0x80 else 10**resolution
    assert record.at == ticks * SECOND // per_second + 100 * SECOND


def test_without_a_resolution_it_is_microseconds() -> None:
    assert records_of(section() + interface() + enhanced(said(b"x"), 1_000_001))[0].at == SECOND + 1000


def test_packets_without_a_time_have_that_of_their_own_header() -> None:
    simple = block(3, struct.pack("<I", 13) + said(b"x"))
    obsolete = block(2, struct.pack("<HH4I", 0, 0, 0, 8_000_000, 13, 13) + said(b"y"))
    (first, second) = records_of(section() + interface() + simple + obsolete)
    assert (first.at, first.data) == (7 * SECOND + SECOND // 2, b"x")
    assert (second.at, second.data) == (8 * SECOND, b"y")


@pytest.mark.parametrize(
    ("magic", "fraction"), [(0xA1B2C3D4, 500_000), (0xA1B23C4D, 500_000_000)], ids=["microseconds", "nanoseconds"]
)
@pytest.mark.parametrize("order", "<>")
def test_a_classic_pcap(order: str, magic: int, fraction: int) -> None:
    head = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, LINK_TYPE)
    packet = struct.pack(f"{order}4I", 7, fraction, 15, 15) + said(b"abc")
    assert [(record.at, record.data) for record in records_of(head + packet)] == [(7 * SECOND + SECOND // 2, b"abc")]
    assert "in the middle of a block" in problems_of(head + packet[:-1])[0]
    assert "in the middle of a block" in problems_of((head + packet)[:20])[0]


def test_several_sections_and_interfaces_are_kept_apart() -> None:
    other = interface(link_type=1)
    packets = [enhanced(said(bytes([n])), 10**7, number=n) for n in (0, 1, 2, 0)]
    whole = section() + interface() + other + interface() + b"".join(packets)
    whole += section(">") + interface(order=">") + enhanced(said(b"z"), 10**7, order=">")
    found = [(item.stream, item.record.data) for item in read(whole) if isinstance(item, Packet)]
    assert found == [(0, b"\0"), (2, b"\2"), (0, b"\0"), (3, b"z")]
    assert problems_of(whole) == ["interface 1 is no RTAC serial line: its packets are left out"]


def test_unknown_blocks_and_options_are_passed_over() -> None:
    options = struct.pack("<HH4s", 2988, 4, b"abcd") + struct.pack("<HH4s", 0x8001, 3, b"xyz\0") + bytes(4)
    blocks = block(5, bytes(20)), block(0xBAD, b"custom things"), block(4, bytes(4))
    whole = section() + interface(options) + b"".join(blocks) + enhanced(said(b"x") + bytes(3) + options, 10**7)
    assert problems_of(whole) == []
    assert len(records_of(whole)) == 1


@given(st.lists(records, min_size=1, max_size=4), st.data())
def test_a_file_cut_anywhere_gives_what_is_whole_and_says_so(wanted: list[Record], data: st.DataObject) -> None:
    ordered = sorted(wanted, key=lambda record: record.at)
    whole = capture(*ordered)
    ends = [len(capture(*ordered[:count])) for count in range(len(ordered) + 1)]
    cut = data.draw(st.integers(0, len(whole)))
    found = records_of(whole[:cut])
    assert found == ordered[: sum(end <= cut for end in ends[1:])]
    assert bool(problems_of(whole[:cut])) is not _ends_a_block(whole, cut)


def _ends_a_block(whole: bytes, cut: int) -> bool:
    at = 0
    while at < cut:
        at += int.from_bytes(whole[at + 4 : at + 8], "little")
    return at == cut


@given(st.lists(records, min_size=1, max_size=4), st.data())
@settings(max_examples=200)
def test_no_damage_makes_it_raise(wanted: list[Record], data: st.DataObject) -> None:
    whole = bytearray(capture(*wanted))
    for _ in range(data.draw(st.integers(1, 6))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    for item in read(bytes(whole)):
        assert isinstance(item, Packet | Problem)


@given(st.sampled_from([b"", section(), section() + interface(), b"\xa1\xb2\xc3\xd4"]), st.binary(max_size=300))
def test_nothing_at_all_makes_it_raise(begin: bytes, rest: bytes) -> None:
    read(begin + rest)


@given(st.binary(max_size=80), st.sampled_from([1, 2, 3, 6]), st.sampled_from("<>"))
def test_no_block_of_any_content_makes_it_raise(body: bytes, kind: int, order: str) -> None:
    read(section(order) + interface(order=order) + block(kind, body, order))


@pytest.mark.parametrize("length", [MAX_BLOCK + 4, 2**32 - 4])
def test_a_huge_block_is_passed_over_without_holding_it(length: int) -> None:
    present = min(length, 8 * MAX_BLOCK)
    body = struct.pack("<II", 6, length) + bytes(present - 8)
    stream = io.BytesIO(section() + interface() + body + enhanced(said(b"x"), 10**7))
    tracemalloc.start()
    items = list(read_capture(stream))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MAX_BLOCK // 2
    problems = [item.what for item in items if isinstance(item, Problem)]
    assert ("passed over" in problems[0]) is (length == present)
    assert ("in the middle of a block" in problems[0]) is (length > present)


def test_a_flood_of_interfaces_is_bounded() -> None:
    whole = section() + interface() * 3000 + enhanced(said(b"x"), 10**7, number=2000)
    found = problems_of(whole)
    assert "1024 interfaces" in found[0]
    assert "not described" in found[-1]


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (enhanced(said(b"x"), 1, number=3), "not described"),
        (enhanced(b"short", 1), "no room for the header"),
        (enhanced(said(b"x", what=0x42), 1), "unknown event type 0x42"),
        (block(6, struct.pack("<5I", 0, 0, 1, 13, 40) + said(b"x")), "27 characters of a packet were not captured"),
        (block(6, struct.pack("<5I", 0, 0, 1, 99, 99) + said(b"x")), "longer than the block"),
        (block(6, b"1234"), "too short"),
        (enhanced(said(b"x"), 9_000_000) + enhanced(said(b"y"), 8_500_000), "time goes back by 0.500000 s"),
        (struct.pack("<II", 6, 13), "impossible length 13"),
        (struct.pack("<IIII", 6, 16, 0, 20), "two lengths"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_with_its_place(body: bytes, what: str) -> None:
    begin = section() + interface()
    found = [item for item in read(begin + body) if isinstance(item, Problem)]
    assert what in found[0].what
    assert len(begin) <= found[0].offset < len(begin + body)


def test_what_is_no_capture_is_said() -> None:
    assert "no capture" in problems_of(b"not a capture at all")[0]
    assert "something else" in problems_of(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))[0]


def test_no_control_character_of_a_file_gets_through() -> None:
    evil = "a\x1b[2J\u202eb\x00c\n"
    record = Record(at=NOW, what=Happening.COMPLETE, remark=evil)
    items = read(capture(record, origin=Origin(line=evil, protocol=evil)))
    (packet,) = [item for item in items if isinstance(item, Packet)]
    for text in (packet.record.remark, packet.origin.line):
        assert text.isprintable()


@given(st.text(max_size=200) | st.builds(lambda depth: "[" * depth, st.integers(0, 100_000)))
def test_no_comment_makes_it_raise(comment: str) -> None:
    Origin.loads(comment)


@pytest.mark.parametrize(
    "comment", ['{"side": 7, "protocol": [], "settings": 3}', '{"settings": {"a": 1}}', "[]", '{"side": "sideways"}']
)
def test_a_comment_of_somebody_else_says_nothing(comment: str) -> None:
    assert Origin.loads(comment) == Origin()


@given(st.integers(1, 10**8))
def test_what_was_called_back_is_understood_again(count: int) -> None:
    assert recalled(called_back(count)) == count


@pytest.mark.parametrize("remark", ["", "closed here", "called back: x", "called back: ", "called back: 99999999999"])
def test_no_other_remark_is_taken_for_it(remark: str) -> None:
    assert recalled(remark) == 0


def test_the_lines_of_a_line_without_control_lines_are_on() -> None:
    everything: Sequence[Lines] = (Lines.CTS, Lines.CD, Lines.DSR, Lines.RTS, Lines.DTR)
    assert all(line in ALL_ON for line in everything)
    assert Lines.RING not in ALL_ON
