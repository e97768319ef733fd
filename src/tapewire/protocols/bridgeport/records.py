"""The records of DNC LINK (2.2, 4.2): how a program is cut, what guards a record, how one is written and read.

    up to 256 bytes of text | ETB | LRC

The text does not say how the check character is computed. Eight readings are kept; the first is the likeliest. With
or without the record's end code they differ by a constant, and whether a control counts seven bits or eight makes no
difference under even parity. The check character may have any value, that of a code too: it is known by its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce
from operator import xor
from typing import Final, TypeAlias

from tapewire.protocols.bridgeport.code_table import SEVEN_BITS, CodeTable

__all__ = [
    "LINK_TEXT_BYTES",
    "LRC_CANDIDATES",
    "RECORD_BYTES",
    "Cut",
    "DncEnd",
    "Lrc",
    "ReadRecord",
    "RecordReader",
    "TextEnded",
    "cut_length",
    "encode_record",
    "fitting_length",
    "lrc_of",
    "record_end_codes",
    "tells_candidates_apart",
]

RECORD_BYTES: Final = 256
"""The most text in one record (2.2.3)."""

LINK_TEXT_BYTES: Final = 12000
"""A text of at most so many bytes is for REMOTE LOAD, a longer one for DNC LINK (2.1.1, 2.2.1)."""


class Lrc(StrEnum):
    """How the check character is computed."""

    XOR7_ETB = "xor7_etb"
    XOR7 = "xor7"
    NEG7_ETB = "neg7_etb"
    NEG7 = "neg7"
    SUM7_ETB = "sum7_etb"
    SUM7 = "sum7"
    XOR7_ETB_INV = "xor7_etb_inv"
    XOR7_INV = "xor7_inv"
    AUTO = "auto"
    """The host finds out: a wrong check character only draws a NAK."""


LRC_CANDIDATES: Final = tuple(lrc for lrc in Lrc if lrc is not Lrc.AUTO)
"""In the order in which `auto` tries them."""


def _xor(data: bytes) -> int:
    return reduce(xor, data, 0)


def _inverted_xor(data: bytes) -> int:
    return ~_xor(data)


def _negated_sum(data: bytes) -> int:
    return -sum(data)


_ARITHMETIC: Final[dict[Lrc, tuple[Callable[[bytes], int], bool]]] = {
    Lrc.XOR7_ETB: (_xor, True),
    Lrc.XOR7: (_xor, False),
    Lrc.NEG7_ETB: (_negated_sum, True),
    Lrc.NEG7: (_negated_sum, False),
    Lrc.SUM7_ETB: (sum, True),
    Lrc.SUM7: (sum, False),
    Lrc.XOR7_ETB_INV: (_inverted_xor, True),
    Lrc.XOR7_INV: (_inverted_xor, False),
}
"""The arithmetic, and whether the record's end code takes part."""


def lrc_of(data: bytes, end_code: int, lrc: Lrc) -> int:
    """The check character of a record with text `data` and end code `end_code`: seven bits, no parity."""
    arithmetic, with_end = _ARITHMETIC[lrc]
    return arithmetic(data + bytes([end_code]) if with_end else data) & SEVEN_BITS


def encode_record(data: bytes, end_code: int, lrc: Lrc) -> bytes:
    """A whole record, without parity. `data` is text of at most RECORD_BYTES."""
    assert len(data) <= RECORD_BYTES
    return data + bytes([end_code, lrc_of(data, end_code, lrc)])


class DncEnd(StrEnum):
    """How a program ends in DNC LINK, of which the text says nothing."""

    EOT_ON_ACK = "eot_on_ack"
    """The last ACK is answered by EOT."""
    EOT_AFTER_LRC = "eot_after_lrc"
    """EOT stands right behind the last check character."""
    ETX_LAST = "etx_last"
    """The last record ends with ETX; its ACK is answered by EOT."""
    EMPTY_THEN_EOT = "empty_then_eot"
    """A record without text follows the last one; its ACK is answered by EOT."""


class Cut(StrEnum):
    """Where a program is cut into records."""

    LINES = "lines"
    """Behind the last line end that fits; a longer line in the middle."""
    FIXED = "fixed"
    """Every record is full."""


def cut_length(text: bytes, size: int, cut: Cut, *, whole: bool) -> int | None:
    """How much of `text` the next record takes, at most `size` bytes; None: more must be known of the text first.

    `whole` says that nothing follows `text`. The answer does not depend on how much of what follows is known.
    """
    if len(text) <= size:
        return len(text) if whole else None
    line_end = text.rfind(b"\n", 0, size) + 1 if cut is Cut.LINES else 0
    return line_end or size


def fitting_length(text: bytes, longest: int, fits: Callable[[bytes], bool]) -> int:
    """The longest record of at most `longest` bytes of `text` that `fits`; `longest` itself where none does.

    A cut behind a line end is preferred.
    """
    lengths = range(longest, 0, -1)
    behind_lines = (length for length in lengths if length == longest or text[length - 1 : length] == b"\n")
    best = next((length for length in behind_lines if fits(text[:length])), None)
    return best or next((length for length in lengths if fits(text[:length])), longest)


def tells_candidates_apart(data: bytes, end_code: int) -> bool:
    """No two candidates have the same check character for this record, so its ACK proves one of them."""
    return len({lrc_of(data, end_code, lrc) for lrc in LRC_CANDIDATES}) == len(LRC_CANDIDATES)


def record_end_codes(codes: CodeTable, dnc_end: DncEnd) -> frozenset[int]:
    """What ends a record. ETX in the middle of one is a damaged character unless it ends the last."""
    if dnc_end is DncEnd.ETX_LAST:
        return frozenset((codes.rec_end, codes.rec_end_last))
    return frozenset((codes.rec_end,))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadRecord:
    """A record that came in whole: its text, and whether it is `good`."""

    data: bytes
    good: bool
    last: bool
    """It ended with the code of a last record."""


@dataclass(frozen=True, slots=True)
class TextEnded:
    """The end of the program, where a record would begin."""


RecordItem: TypeAlias = ReadRecord | TextEnded


class RecordReader:
    """Reads records out of characters without parity, however they are cut. Holds one record at most.

    A record longer than RECORD_BYTES is bad and its text is dropped. `consumed` counts the characters of the last
    `feed` up to and including its last item: a caller that must act between two items feeds up to each.
    """

    def __init__(self, codes: CodeTable, lrc: Lrc, dnc_end: DncEnd) -> None:
        self._codes = codes
        self._end_codes = record_end_codes(codes, dnc_end)
        self._lrc = lrc
        self._data = bytearray()
        self._end_code: int | None = None
        self._spoilt = False

    @property
    def begun(self) -> bool:
        """Some of a record has come in, and not all of it."""
        return bool(self._data) or self._end_code is not None or self._spoilt

    @property
    def in_text(self) -> bool:
        """The next character is text, or ends it; False: it is the check character, whatever its value."""
        return self._end_code is None

    def spoil(self) -> None:
        """A character of this record came damaged: the record is bad."""
        self._spoilt = True

    def forget(self) -> None:
        """Drop what has come of this record."""
        self._data.clear()
        self._end_code = None
        self._spoilt = False

    def feed(self, characters: bytes) -> Iterator[RecordItem]:
        """Each record that becomes whole, and the end of the program."""
        for character in characters:
            item = self.take(character)
            if item is not None:
                yield item

    def take(self, character: int) -> RecordItem | None:
        """The item that `character` makes whole."""
        if self._end_code is not None:
            return self._finish(character)
        if character in self._end_codes:
            self._end_code = character
        elif character == self._codes.text_end and not self.begun:
            return TextEnded()
        elif len(self._data) == RECORD_BYTES:
            self._spoilt = True
        else:
            self._data.append(character)
        return None

    def _finish(self, character: int) -> ReadRecord:
        assert self._end_code is not None
        data, end_code = bytes(self._data), self._end_code
        good = not self._spoilt and character == lrc_of(data, end_code, self._lrc)
        self.forget()
        return ReadRecord(data=data, good=good, last=end_code != self._codes.rec_end)
