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
from tapewire.g05.layout import SIGNIFICANT, Layout, RecordFormat
from tapewire.g05.words import (
    Auxiliary,
    Bytes,
    Sums,
    Words,
    carry,
    has_odd_byte,
    lane_bytes,
    moving,
    pack,
    pack_auxiliary,
    unpack,
    unpack_auxiliary,
)

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

PIECE_BYTES: Final = 3 << 17
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
    records = out.reshape(-1, layout.record_bytes)
    desk = _Desk(len(travel), layout)
    for piece in desk.pieces():
        first = first_record + piece.start
        numbers = _as_words(travel[piece], layout, first)
        part = desk.part(len(numbers))
        extra = None
        if auxiliary is not None:
            extra = _checked_auxiliary(auxiliary[piece], layout, first)
            pack_auxiliary(extra, part.auxiliary, part.room, layout.format)
        if layout.format is RecordFormat.SPECIAL and not _in_range(numbers, layout):
            raise _out_of_range(numbers, layout, first)
        pack(numbers.reshape(-1), part.words, part.spare, layout.format)
        part.put(records[piece])
        _refuse_no_motion(part, extra, first)
    return out


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
    records = _whole(data, layout)
    travel = np.empty((len(records), layout.axis_count), "<i2")
    auxiliary = np.empty(len(records), np.uint32) if layout.uses_auxiliary else None
    desk = _Desk(len(records), layout)
    for piece in desk.pieces():
        part = desk.part_of(records[piece])
        if first_record is not None:
            _refuse_wrong(part, records[piece], first_record + piece.start)
        if auxiliary is not None:
            auxiliary[piece] = unpack_auxiliary(part.auxiliary, layout.format)
        if first_record is not None:
            extra = None if auxiliary is None else auxiliary[piece]
            _refuse_no_motion(part, extra, first_record + piece.start)
        unpack(part.words, travel[piece].reshape(-1), part.spare, layout.format)
    return Records(travel=travel.astype(np.int16, copy=False), auxiliary=auxiliary)


def faults(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Iterator[tuple[int, str]]:
    """(index from 0, what is wrong) of every record with a wrong check byte or a bit that must be 0."""
    records = _whole(data, layout)
    desk = _Desk(len(records), layout)
    for piece in desk.pieces():
        for index in np.flatnonzero(desk.part_of(records[piece]).wrong(records[piece])):
            at = piece.start + int(index)
            yield at, _what_is_wrong(records[at].tobytes(), layout)


def first_exit(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> int | None:
    """The index of the first record whose travel and auxiliary function are all 0, whatever its check byte."""
    records = _whole(data, layout)
    desk = _Desk(len(records), layout)
    for piece in desk.pieces():
        part = desk.part_of(records[piece])
        if part.all_move:
            continue
        some = moving(part.words, layout.axis_count)
        if layout.uses_auxiliary:
            some |= part.auxiliary != 0
        if not some.all():
            return int(piece.start) + int(np.argmin(some))
    return None


class _Desk:
    """Room to work on one piece of records after the other."""

    def __init__(self, count: int, layout: Layout) -> None:
        self._count, self._layout = count, layout
        self._at_a_time = min(max(PIECE_BYTES // layout.record_bytes, 1), max(count, 1))
        width = 2 * layout.axis_count
        row = self._at_a_time * max(width, lane_bytes(width), 8 if layout.uses_auxiliary else 0)
        self._rooms = np.empty((4 if layout.uses_auxiliary else 3, -(-row // 64) * 64), np.uint8)
        self._part = _Part(self._rooms, self._at_a_time, layout)

    def pieces(self) -> Iterator[slice]:
        for start in range(0, self._count, self._at_a_time):
            yield slice(start, min(start + self._at_a_time, self._count))

    def part(self, count: int) -> _Part:
        """For `count` records; what the last one held is lost."""
        if count != self._part.count:
            self._part = _Part(self._rooms, count, self._layout)
        return self._part

    def part_of(self, records: Bytes) -> _Part:
        part = self.part(len(records))
        part.take(records)
        return part


class _Part:
    """Some records as they stand on the line: their words, and their auxiliary functions, none if they are not used.

    What stands in `spare` and in `room`, which is the same place, is lost. `all_move` is False where it takes `moving`
    to tell: the first four axes of nearly all records move.
    """

    def __init__(self, rooms: Bytes, count: int, layout: Layout) -> None:
        self.layout, self.count, self._width = layout, count, 2 * layout.axis_count
        words, self.room, other = rooms[:3]
        last = rooms[-1]
        flat = words[: self._width * count]
        self.words: Words = flat.view("<u2")
        self.spare: Words = self.room[: len(flat)].view("<u2")
        self._rows = flat.reshape(count, self._width)
        self._sums = Sums(flat, self._width, (self.room, other))
        size = 4 * count if layout.uses_auxiliary else 0
        self.auxiliary: Auxiliary = last[:size].view(np.uint32)
        self._auxiliary_sums = Sums(last[:size], 4, (self.room, last[size:]))
        self.all_move = False

    def put(self, records: Bytes) -> None:
        """Travel first: of three axes it goes over what stands behind it."""
        self.all_move = carry(self._rows, records, self._width, self.room)
        if self.layout.uses_auxiliary:
            np.copyto(_auxiliary_field(records), self.auxiliary)
        self._put_check_bytes(records[:, -1])

    def take(self, records: Bytes) -> None:
        self.all_move = carry(records, self._rows, self._width, self.room)
        if self.layout.uses_auxiliary:
            np.copyto(self.auxiliary, _auxiliary_field(records))

    def wrong(self, records: Bytes) -> NDArray[np.bool_]:
        """Which of the `records` that were taken have a wrong check byte or a bit that must be 0."""
        total = np.empty(len(records), np.uint8)
        self._put_check_bytes(total)
        wrong: NDArray[np.bool_] = total != records[:, -1]
        if self.layout.format is RecordFormat.SPECIAL and (has_odd_byte(self.words) or has_odd_byte(self.auxiliary)):
            wrong |= (records[:, :-1] & 1).any(axis=1)
        return wrong

    def _put_check_bytes(self, into: Bytes) -> None:
        if self.layout.uses_auxiliary:
            more = self._auxiliary_sums.add()  # first: it ends outside the rooms in which the other one works
            np.add(self._sums.add(), more, out=into)
        else:
            np.copyto(into, self._sums.add())


def _auxiliary_field(records: Bytes) -> NDArray[np.uint32]:
    """Where the auxiliary functions stand, highest byte first."""
    field: NDArray[np.uint32] = records[:, -5:-1].view(">u4")[:, 0]
    return field


def _refuse_wrong(part: _Part, records: Bytes, first_record: int) -> None:
    wrong = part.wrong(records)
    if wrong.any():
        index = int(np.argmax(wrong))
        raise ProgramError(f"record {first_record + index:,}: {_what_is_wrong(records[index].tobytes(), part.layout)}")


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
    return flat.reshape(-1, layout.record_bytes)


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
    return bool(numbers.min() >= low and numbers.max() <= high)


def _out_of_range(travel: NDArray[Any], layout: Layout, first_record: int) -> ProgramError:
    low, high = layout.travel_limits
    record, axis = np.argwhere((travel < low) | (travel > high))[0].tolist()
    return ProgramError(
        f"record {first_record + record:,}, axis {axis + 1}: {int(travel[record, axis]):,} increments per unit "
        f"time are outside {low} to {high} of the {layout.format} format"
    )


def _checked_auxiliary(auxiliary: NDArray[Any], layout: Layout, first_record: int) -> Auxiliary:
    outside = (SIGNIFICANT - 1) & ~layout.largest_auxiliary
    if auxiliary.dtype == np.uint32 and not int(np.bitwise_or.reduce(auxiliary)) & outside:
        return auxiliary
    numbers = auxiliary.astype(np.int64, copy=False)
    wrong = (numbers < 0) | ((numbers & ~SIGNIFICANT) > layout.largest_auxiliary)
    if wrong.any():
        index = int(np.argmax(wrong))
        raise ProgramError(
            f"record {first_record + index:,}: auxiliary function {int(auxiliary[index]) & ~SIGNIFICANT:,} is "
            f"outside 0 to {layout.largest_auxiliary:,} of the {layout.format} format"
        )
    return numbers.astype(np.uint32)


def _refuse_no_motion(part: _Part, auxiliary: Auxiliary | None, first_record: int) -> None:
    """Whether a zero auxiliary function alone leaves the mode is not stated (9.1): it is not sent."""
    if part.all_move:
        return
    some = moving(part.words, part.layout.axis_count)
    if auxiliary is not None:
        some |= auxiliary > np.uint32(SIGNIFICANT)
    if not some.all():
        raise ProgramError(f"record {first_record + int(np.argmin(some)):,}: {NO_MOTION}")
