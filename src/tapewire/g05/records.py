"""Records of binary input operation as numpy arrays, both ways and strictly (B-63322EN-1 9.1).

Travel is an array of shape (records, axes) in increments per unit time. Auxiliary functions are 32-bit words, bit 31
meaning significant. Work goes in pieces that stay in the cache; a caller with gigabytes brings them in pieces too.

The packing of an auxiliary function in the special format is not drawn in the manual: it follows from that of the
travel, whose example of 700 increments (0A 78) proves it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError, UsageError
from tapewire.g05.columns import (
    Columns,
    Words,
    all_move,
    columns,
    copy,
    fields,
    moving,
    pack,
    pack_auxiliary,
    sum_of_bytes,
    unpack,
    unpack_auxiliary,
)
from tapewire.g05.layout import SIGNIFICANT, Layout, RecordFormat

__all__ = [
    "Auxiliary",
    "Bytes",
    "Records",
    "Travel",
    "decode",
    "decode_as_they_are",
    "encode",
    "faults",
    "first_exit",
]

Travel: TypeAlias = NDArray[np.int16]
Auxiliary: TypeAlias = NDArray[np.uint32]
Bytes: TypeAlias = NDArray[np.uint8]

PIECE_BYTES: Final = 1 << 19
"""Of records. The few arrays of a piece fit into a second-level cache; a call of numpy is small against it."""

NO_MOTION: Final = (
    "no travel and no auxiliary function: the control would leave binary input operation here. A unit of time "
    "without motion cannot be sent: leave it out, or let it carry an auxiliary function other than 0"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Records:
    """What records say. `auxiliary` is None where the layout has none."""

    travel: Travel
    auxiliary: Auxiliary | None = None

    def __len__(self) -> int:
        return len(self.travel)


def encode(
    travel: NDArray[Any], layout: Layout, auxiliary: NDArray[Any] | None = None, *, first_record: int = 1
) -> Bytes:
    """Records of `travel` (records, axes), any integers, as bytes on the line in one flat array.

    Records are counted from `first_record` in what is said of them. The exit record is not added. Raises ProgramError
    with record, axis and value for a number out of range, and for a record that would end the section.
    """
    _expect_shapes(travel, layout, auxiliary)
    out = np.empty(len(travel) * layout.record_bytes, np.uint8)
    desk = _Desk(len(travel), layout)
    for piece in desk.pieces():
        first = first_record + piece.start
        numbers = _as_words(travel[piece], layout, first)
        extra = None if auxiliary is None else _checked_auxiliary(auxiliary[piece], layout, first)
        words, spare = desk.words(len(numbers))
        made = columns(words, layout.axis_count)
        copy(fields(numbers.reshape(-1).view(np.uint8), layout.axis_count, 2 * layout.axis_count), made)
        if not _in_range(words.view("<i2"), layout):
            raise _out_of_range(numbers, layout, first)
        pack(words, spare, layout.format)
        _refuse_no_motion(made, extra, first)
        _put(out[piece.start * layout.record_bytes : piece.stop * layout.record_bytes], made, extra, layout)
    return out


def _put(out: Bytes, made: Columns, auxiliary: Auxiliary | None, layout: Layout) -> None:
    """Records from their columns."""
    size = layout.record_bytes
    copy(made, fields(out, layout.axis_count, size))
    if auxiliary is not None:
        packed = pack_auxiliary(auxiliary, layout.format)
        np.copyto(_auxiliary_field(out, layout), packed)
        made = [*made, packed[None]]
    out[size - 1 :: size] = sum_of_bytes(made)


def decode(data: bytes | bytearray | memoryview | Bytes, layout: Layout, *, first_record: int = 1) -> Records:
    """What the records in `data` say, without the exit record. Exactly the other way of `encode`.

    Raises ProgramError at the first record with a wrong check byte, with a bit that the format keeps 0, or that
    would end the section, and for a number of bytes that is not whole records.
    """
    return _decoded(data, layout, first_record)


def decode_as_they_are(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Records:
    """As `decode`, whatever is wrong with the records: what a reader makes of them who looks at no check byte."""
    return _decoded(data, layout, None)


def _decoded(data: bytes | bytearray | memoryview | Bytes, layout: Layout, first_record: int | None) -> Records:
    """`first_record` None: nothing is checked."""
    flat = _whole(data, layout)
    size, axes = layout.record_bytes, layout.axis_count
    travel = np.empty((len(flat) // size, axes), np.int16)
    auxiliary = np.empty(len(travel), np.uint32) if layout.uses_auxiliary else None
    desk = _Desk(len(travel), layout)
    for piece in desk.pieces():
        raw = desk.raw(flat[piece.start * size : piece.stop * size])
        if first_record is not None:
            raw.refuse_wrong(first_record + piece.start)
        if auxiliary is not None:
            auxiliary[piece] = unpack_auxiliary(raw.auxiliary, layout.format)
        if first_record is not None:
            _refuse_no_motion(raw.columns, None if auxiliary is None else auxiliary[piece], first_record + piece.start)
        unpack(raw.words, raw.spare, layout.format)
        copy(raw.columns, fields(travel[piece].reshape(-1).view(np.uint8), axes, 2 * axes))
    return Records(travel=travel, auxiliary=auxiliary)


def faults(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Iterator[tuple[int, str]]:
    """(index from 0, what is wrong) of every record with a wrong check byte or a bit that must be 0."""
    flat, size = _whole(data, layout), layout.record_bytes
    desk = _Desk(len(flat) // size, layout)
    for piece in desk.pieces():
        raw = desk.raw(flat[piece.start * size : piece.stop * size])
        for index in np.flatnonzero(raw.wrong()):
            yield piece.start + int(index), _what_is_wrong(raw.record(int(index)), layout)


def first_exit(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> int | None:
    """The index of the first record whose travel and auxiliary function are all 0, whatever its check byte."""
    flat, size = _whole(data, layout), layout.record_bytes
    desk = _Desk(len(flat) // size, layout)
    for piece in desk.pieces():
        raw = desk.raw(flat[piece.start * size : piece.stop * size])
        some = moving(raw.columns)
        if layout.uses_auxiliary:
            some |= raw.auxiliary != 0
        if not some.all():
            return int(piece.start) + int(np.argmin(some))
    return None


class _Desk:
    """Room to work on one piece of records after the other."""

    def __init__(self, count: int, layout: Layout) -> None:
        self._count, self._layout = count, layout
        self._at_a_time = min(max(PIECE_BYTES // layout.record_bytes, 1), max(count, 1))
        self._words = np.empty((2, self._at_a_time * layout.axis_count), "<u2")

    def pieces(self) -> Iterator[slice]:
        for start in range(0, self._count, self._at_a_time):
            yield slice(start, min(start + self._at_a_time, self._count))

    def words(self, count: int) -> tuple[Words, Words]:
        """For `count` records; what they held is lost."""
        both = self._words[:, : count * self._layout.axis_count]
        return both[0], both[1]

    def raw(self, data: Bytes) -> _Raw:
        layout = self._layout
        words, spare = self.words(len(data) // layout.record_bytes)
        made = columns(words, layout.axis_count)
        copy(fields(data, layout.axis_count, layout.record_bytes), made)
        packed = _auxiliary_field(data, layout).copy() if layout.uses_auxiliary else np.zeros(0, np.uint32)
        return _Raw(layout, data, words, spare, made, packed)


@dataclass(frozen=True, slots=True)
class _Raw:
    """A piece as it stands on the line: words with their bytes swapped, column by column."""

    layout: Layout
    data: Bytes
    words: Words
    spare: Words
    columns: Columns
    auxiliary: Auxiliary

    def record(self, index: int) -> bytes:
        size = self.layout.record_bytes
        return self.data[index * size : (index + 1) * size].tobytes()

    def refuse_wrong(self, first_record: int) -> None:
        wrong = self.wrong()
        if wrong.any():
            index = int(np.argmax(wrong))
            why = _what_is_wrong(self.record(index), self.layout)
            raise ProgramError(f"record {first_record + index:,}: {why}")

    def wrong(self) -> NDArray[np.bool_]:
        size = self.layout.record_bytes
        total = sum_of_bytes([*self.columns, self.auxiliary[None]] if self.layout.uses_auxiliary else self.columns)
        wrong: NDArray[np.bool_] = total != self.data[size - 1 :: size]
        if self.layout.format is RecordFormat.SPECIAL and self._has_odd_byte():
            wrong |= (self.data.reshape(-1, size)[:, :-1] & 1).any(axis=1)
        return wrong

    def _has_odd_byte(self) -> bool:
        np.bitwise_and(self.words, np.uint16(0x0101), out=self.spare)
        return bool(self.spare.any()) or bool((self.auxiliary & np.uint32(0x01010101)).any())


def _auxiliary_field(data: Bytes, layout: Layout) -> NDArray[np.uint32]:
    """Where the auxiliary functions stand in records, highest byte first: as numbers their bytes are swapped."""
    size = layout.record_bytes
    field: NDArray[np.uint32] = np.ndarray((len(data) // size,), "<u4", data.data, 2 * layout.axis_count, (size,))
    return field


def _what_is_wrong(record: bytes, layout: Layout) -> str:
    shown = record.hex(" ").upper()
    if layout.format is RecordFormat.SPECIAL and any(byte & 1 for byte in record[:-1]):
        at = next(index for index, byte in enumerate(record) if byte & 1)
        return (
            f"byte {at + 1} is {record[at]:02X}h, but bits 8 and 0 of every word are 0 in the special format ({shown})"
        )
    expected = sum(record[:-1]) & 0xFF
    return f"the check byte is {record[-1]:02X}h, the sum of the other bytes {expected:02X}h ({shown}): alarm SR890"


def _whole(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Bytes:
    flat = np.frombuffer(data, np.uint8)
    if len(flat) % layout.record_bytes:
        raise ProgramError(
            f"{len(flat):,} bytes are no whole number of records of {layout.record_bytes} ({layout}): "
            f"{len(flat) % layout.record_bytes} are left over"
        )
    return flat


def _expect_shapes(travel: NDArray[Any], layout: Layout, auxiliary: NDArray[Any] | None) -> None:
    if travel.ndim != 2 or travel.shape[1] != layout.axis_count or travel.dtype.kind not in "iu":
        raise UsageError(
            f"travel of shape {travel.shape} and type {travel.dtype}: integers of shape (records, {layout.axis_count}) "
            "are expected"
        )
    if (auxiliary is not None) is not layout.uses_auxiliary:
        raise UsageError(f"auxiliary functions are {'missing' if auxiliary is None else 'not'} in records {layout}")
    if auxiliary is not None and (auxiliary.shape != travel.shape[:1] or auxiliary.dtype.kind not in "iu"):
        raise UsageError(f"auxiliary functions of shape {auxiliary.shape} for {len(travel):,} records")


def _as_words(travel: NDArray[Any], layout: Layout, first_record: int) -> Travel:
    """One record behind the other. Numbers that no word holds are refused; those that no record does, not yet."""
    if travel.dtype != np.int16 and not _in_range(travel, layout):
        raise _out_of_range(travel, layout, first_record)
    return np.ascontiguousarray(travel, "<i2")


def _in_range(numbers: NDArray[Any], layout: Layout) -> bool:
    low, high = layout.travel_limits
    held = np.iinfo(numbers.dtype)
    return not numbers.size or (
        (held.min >= low or bool(numbers.min() >= low)) and (held.max <= high or bool(numbers.max() <= high))
    )


def _out_of_range(travel: NDArray[Any], layout: Layout, first_record: int) -> ProgramError:
    low, high = layout.travel_limits
    record, axis = np.argwhere((travel < low) | (travel > high))[0].tolist()
    return ProgramError(
        f"record {first_record + record:,}, axis {axis + 1}: {int(travel[record, axis]):,} increments per unit "
        f"time are outside {low} to {high} of the {layout.format} format"
    )


def _checked_auxiliary(auxiliary: NDArray[Any], layout: Layout, first_record: int) -> Auxiliary:
    if auxiliary.dtype == np.uint32:
        words: Auxiliary = auxiliary
        outside = np.uint32((SIGNIFICANT - 1) & ~layout.largest_auxiliary)
        wrong: NDArray[Any] = words & outside
    else:
        numbers = auxiliary.astype(np.int64, copy=False)
        wrong = (numbers < 0) | ((numbers & ~SIGNIFICANT) > layout.largest_auxiliary)
        words = numbers.astype(np.uint32)
    if wrong.max(initial=0):
        index = int(np.argmax(wrong != 0))
        raise ProgramError(
            f"record {first_record + index:,}: auxiliary function {int(auxiliary[index]) & ~SIGNIFICANT:,} is "
            f"outside 0 to {layout.largest_auxiliary:,} of the {layout.format} format"
        )
    return words


def _refuse_no_motion(packed: Columns, auxiliary: Auxiliary | None, first_record: int) -> None:
    """Whether a zero auxiliary function alone leaves the mode is not stated (9.1): it is not sent."""
    if all_move(packed):
        return
    some = moving(packed)
    if auxiliary is not None:
        some |= auxiliary > np.uint32(SIGNIFICANT)
    if not some.all():
        raise ProgramError(f"record {first_record + int(np.argmin(some)):,}: {NO_MOTION}")
