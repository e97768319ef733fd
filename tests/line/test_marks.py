"""Marks of damaged characters among the others: escapes cut anywhere, and which damage it was."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tapewire.engine import LineFault
from tapewire.line.ports.kernel import Counters
from tapewire.line.ports.marks import Damage, decode_marks
from tapewire.line.transport import Fault


@pytest.mark.parametrize(
    ("data", "items", "carry"),
    [
        (b"", [], b""),
        (b"plain\x00\x11", [b"plain\x00\x11"], b""),
        (b"a\xff\xffb", [b"a\xffb"], b""),
        (b"a\xff\x00Xb", [b"a", ord("X"), b"b"], b""),
        (b"\xff\x00\x00", [0], b""),
        (b"\xff\x00\xff", [0xFF], b""),
        (b"\xff\xff\x00\x11", [b"\xff\x00\x11"], b""),
        (b"\xff\xff\xff\x00\x11", [b"\xff", 0x11], b""),
        (b"a\xff", [b"a"], b"\xff"),
        (b"a\xff\x00", [b"a"], b"\xff\x00"),
        (b"a\xff\x41", [b"a\xffA"], b""),
    ],
)
def test_marks(data: bytes, items: list[bytes | int], carry: bytes) -> None:
    assert decode_marks(data) == (items, carry)


def _decoded(pieces: list[bytes]) -> tuple[list[tuple[str, int]], bytes]:
    flat: list[tuple[str, int]] = []
    carry = b""
    for piece in pieces:
        items, carry = decode_marks(carry + piece)
        assert b"" not in items
        for item in items:
            flat += [("plain", byte) for byte in item] if isinstance(item, bytes) else [("damaged", item)]
    return flat, carry


Marked = st.lists(st.sampled_from([b"\xff", b"\x00", b"\x11", b"A", b"\xff\xff", b"\xff\x00"])).map(b"".join)


@given(data=Marked, cuts=st.lists(st.integers(0, 60)))
def test_cutting_does_not_matter(data: bytes, cuts: list[int]) -> None:
    places = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    assert _decoded([data[start:end] for start, end in pairwise(places)]) == _decoded([data])


@given(st.lists(st.tuples(st.sampled_from(["plain", "damaged"]), st.integers(0, 255))))
@example([("plain", 0xFF), ("damaged", 0), ("plain", 0xFF), ("plain", 0xFF), ("damaged", 0xFF), ("plain", 0)])
def test_what_a_driver_marks_is_understood(line: list[tuple[str, int]]) -> None:
    wire = bytearray()
    for kind, byte in line:
        wire += bytes((0xFF, 0, byte)) if kind == "damaged" else bytes((byte,)) * (2 if byte == 0xFF else 1)
    assert _decoded([bytes(wire)]) == (line, b"")


def test_a_mark_is_what_was_counted() -> None:
    damage = Damage(LineFault.PARITY, Counters(parity=7, framing=2, breaks=1))
    assert damage.count(Counters(parity=7, framing=3, breaks=1)) == 0
    assert damage.of(0x41) == Fault(fault=LineFault.FRAMING, byte=0x41)
    damage.count(Counters(parity=8, framing=3, breaks=1))
    assert damage.of(0) == Fault(fault=LineFault.PARITY, byte=0)
    damage.count(Counters(parity=8, framing=3, breaks=2))
    assert damage.of(0) == Fault(fault=LineFault.BREAK)


def test_what_is_counted_before_it_is_read_waits_for_its_mark() -> None:
    damage = Damage(LineFault.PARITY, Counters())
    damage.count(Counters(framing=2))
    assert [damage.of(1).fault, damage.of(2).fault, damage.of(3).fault] == [
        LineFault.FRAMING,
        LineFault.FRAMING,
        LineFault.PARITY,
    ]


def test_without_counters_a_mark_is_what_it_is_likely_to_be() -> None:
    damage = Damage(LineFault.FRAMING, None)
    assert damage.of(0x41) == Fault(fault=LineFault.FRAMING, byte=0x41)
    assert damage.of(0) == Fault(fault=LineFault.BREAK)


def test_lost_characters_are_counted_over_the_end_of_the_counter() -> None:
    damage = Damage(LineFault.PARITY, Counters(uart_overrun=2**32 - 1))
    assert damage.count(Counters(uart_overrun=1, queue_overrun=3)) == 5
