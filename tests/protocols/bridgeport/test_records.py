"""The records of DNC LINK: every published check character, cutting, and reading them however they come."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import with_even_parity
from tapewire.protocols.bridgeport.code_table import CodeTable
from tapewire.protocols.bridgeport.records import (
    LRC_CANDIDATES,
    RECORD_BYTES,
    Cut,
    DncEnd,
    Lrc,
    ReadRecord,
    RecordReader,
    TextEnded,
    cut_length,
    encode_record,
    fitting_length,
    lrc_of,
    tells_candidates_apart,
)

ETB, ETX = 0x17, 0x03
VECTORS: Final[dict[str, dict[str, str]]] = json.loads(
    (Path(__file__).parents[2] / "vectors" / "bridgeport.json").read_text()
)["lrc_vectors"]
WORKED = {
    b"N10G1X1F5\r\n": "33 24 4C 5B 59 42 27 3E",
    b"N20Y1\r\n": "34 23 4B 5C 68 51 18 2F",
    b"N30M2\r\n": "22 35 5D 4A 5E 47 22 39",
    b"N10G0X0Y0\r\nN20M2\r\n": "1D 0A 62 75 2B 14 55 6C",
}
ORDER = ("xor7_etb", "xor7", "xor7_etb_inv", "xor7_inv", "sum7_etb", "sum7", "neg7_etb", "neg7")
TEXT = st.lists(st.sampled_from(list(b"NXYZG0123456789.-\r\n")), max_size=RECORD_BYTES).map(bytes)


def text_of(vector: str) -> bytes:
    return b"0" * 256 if vector == "'0'*256" else vector.encode()


@pytest.mark.parametrize("vector", VECTORS)
def test_every_vector(vector: str) -> None:
    found = {lrc.value: f"{lrc_of(text_of(vector), ETB, lrc):02X}" for lrc in LRC_CANDIDATES}
    assert found == VECTORS[vector]


@pytest.mark.parametrize("data", WORKED)
def test_every_worked_example(data: bytes) -> None:
    assert bytes(lrc_of(data, ETB, Lrc(name)) for name in ORDER) == bytes.fromhex(WORKED[data])


def test_the_check_vector_of_a_related_link() -> None:
    """HEIDENHAIN publishes 01 48 31 35 45 17 -> 1F for the XOR of a record with its ETB."""
    assert lrc_of(bytes.fromhex("01 48 31 35 45"), ETB, Lrc.XOR7_ETB) == 0x1F


@given(TEXT)
def test_counting_eight_bits_makes_no_difference_under_even_parity(data: bytes) -> None:
    eight = 0
    for byte in (*data, ETB):
        eight ^= with_even_parity(byte)
    assert eight == with_even_parity(lrc_of(data, ETB, Lrc.XOR7_ETB))


@given(TEXT, st.sampled_from(LRC_CANDIDATES))
def test_with_and_without_etb_differ_by_a_constant(data: bytes, lrc: Lrc) -> None:
    if lrc in (Lrc.XOR7, Lrc.XOR7_INV):
        with_etb = Lrc(f"{lrc}".replace("xor7", "xor7_etb"))
        assert lrc_of(data, ETB, with_etb) == lrc_of(data, ETB, lrc) ^ ETB


@given(TEXT.filter(bool), st.sampled_from(LRC_CANDIDATES), st.integers(0, 7), st.data())
def test_one_wrong_bit_is_always_seen(data: bytes, lrc: Lrc, bit: int, place: st.DataObject) -> None:
    at = place.draw(st.integers(0, len(data) - 1))
    damaged = bytearray(data)
    damaged[at] ^= 1 << min(bit, 6)
    assert lrc_of(bytes(damaged), ETB, lrc) != lrc_of(data, ETB, lrc)


@given(st.lists(TEXT.filter(bool), min_size=1, max_size=5), st.sampled_from(LRC_CANDIDATES), st.data())
def test_records_are_read_however_they_are_cut(texts: list[bytes], lrc: Lrc, cuts: st.DataObject) -> None:
    wire = b"".join(encode_record(text, ETB, lrc) for text in texts) + b"\x04"
    reader = RecordReader(CodeTable(), lrc, DncEnd.EOT_ON_ACK)
    items = []
    while wire:
        count = cuts.draw(st.integers(1, len(wire)))
        items += list(reader.feed(wire[:count]))
        wire = wire[count:]
    assert items == [*(ReadRecord(data=text, good=True, last=False) for text in texts), TextEnded()]
    assert not reader.begun


def test_the_character_after_etb_is_the_check_character_whatever_it_is() -> None:
    reader = RecordReader(CodeTable(), Lrc.XOR7_ETB, DncEnd.EOT_ON_ACK)
    for data in (b"04", b"06", b"07", b"03", b"05", b"02", b"AR", b"0" * 256):
        assert list(reader.feed(encode_record(data, ETB, Lrc.XOR7_ETB))) == [
            ReadRecord(data=data, good=True, last=False)
        ]


@pytest.mark.parametrize("position", range(10))
def test_a_damaged_character_anywhere_makes_the_record_bad(position: int) -> None:
    wire = bytearray(encode_record(b"N20Y1\r\n0", ETB, Lrc.XOR7_ETB))
    reader = RecordReader(CodeTable(), Lrc.XOR7_ETB, DncEnd.EOT_ON_ACK)
    wire[position] ^= 0x40
    items = list(reader.feed(bytes(wire) + (bytes([ETB, 0]) if position == 8 else b"")))
    assert [item.good for item in items if isinstance(item, ReadRecord)] == [False]


def test_a_spoilt_record_is_bad_and_the_next_one_is_not() -> None:
    reader = RecordReader(CodeTable(), Lrc.XOR7, DncEnd.EOT_ON_ACK)
    record = encode_record(b"N1\r\n", ETB, Lrc.XOR7)
    reader.spoil()
    assert reader.begun
    assert [item == ReadRecord(data=b"N1\r\n", good=True, last=False) for item in reader.feed(record * 2)] == [
        False,
        True,
    ]


def test_a_record_too_long_is_bad() -> None:
    reader = RecordReader(CodeTable(), Lrc.XOR7, DncEnd.EOT_ON_ACK)
    data = b"X" * 257
    items = list(reader.feed(data + bytes([ETB, lrc_of(data, ETB, Lrc.XOR7)])))
    assert items == [ReadRecord(data=data[:256], good=False, last=False)]


def test_etx_ends_a_record_only_where_it_ends_the_last() -> None:
    wire = encode_record(b"N1\r\n", ETX, Lrc.XOR7_ETB)
    assert list(RecordReader(CodeTable(), Lrc.XOR7_ETB, DncEnd.ETX_LAST).feed(wire)) == [
        ReadRecord(data=b"N1\r\n", good=True, last=True)
    ]
    assert list(RecordReader(CodeTable(), Lrc.XOR7_ETB, DncEnd.EOT_ON_ACK).feed(wire)) == []


def test_forgetting_begins_a_new_record() -> None:
    reader = RecordReader(CodeTable(), Lrc.XOR7, DncEnd.EOT_ON_ACK)
    assert list(reader.feed(b"N1\r\n\x17")) == []
    assert not reader.in_text
    reader.forget()
    assert reader.in_text
    assert list(reader.feed(b"\x04")) == [TextEnded()]


@given(st.lists(st.sampled_from([b"X", b"Y" * 40, b"\r\n"]), max_size=40).map(b"".join), st.integers(1, 256))
def test_a_cut_does_not_depend_on_how_much_is_known(text: bytes, size: int) -> None:
    for cut in Cut:
        full = cut_length(text, size, cut, whole=True)
        assert full is not None
        assert (full == 0) == (not text)
        assert full <= size
        for known in range(size + 1, len(text)):
            assert cut_length(text[:known], size, cut, whole=False) == full
        assert cut_length(text[:size], size, cut, whole=False) is None


def test_a_cut_is_made_behind_a_line_end_unless_it_is_fixed() -> None:
    text = b"N1\r\n" * 3 + b"N22222\r\n"
    assert cut_length(text, 15, Cut.LINES, whole=True) == 12
    assert cut_length(text, 15, Cut.FIXED, whole=True) == 15
    assert cut_length(b"X" * 20, 15, Cut.LINES, whole=True) == 15


def test_a_fitting_cut_prefers_line_ends_and_gives_up_where_there_is_none() -> None:
    text = b"N1\r\nN2\r\nN3\r\n"
    assert fitting_length(text, 12, lambda data: len(data) < 12) == 8
    assert fitting_length(text, 12, lambda data: len(data) == 7) == 7
    assert fitting_length(text, 12, lambda data: False) == 12


def test_the_third_worked_record_does_not_tell_the_candidates_apart() -> None:
    assert not tells_candidates_apart(b"N30M2\r\n", ETB)
    assert tells_candidates_apart(b"N20Y1\r\n", ETB)
