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
_Words: TypeAlias = NDArray[np.uint16]

PIECE_RECORDS: Final = 1 << 15
"""The few arrays of a piece fit into a second-level cache; a call of numpy is small against it."""

_EIGHT: Final = np.uint16(8)
_SEVEN_BITS: Final = (0x7F, 0x7F << 7, 0x7F << 14, 0x3F << 21)

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
    view = out.view(_record_dtype(layout))
    for start in range(0, len(travel), PIECE_RECORDS):
        piece = slice(start, start + PIECE_RECORDS)
        words = _checked_columns(travel[piece], layout, first_record + start)
        extra = None if auxiliary is None else _checked_auxiliary(auxiliary[piece], layout, first_record + start)
        _refuse_no_motion(words, extra, first_record + start)
        _pack(view[piece], words, extra, layout)
    return out


def decode(data: bytes | bytearray | memoryview | Bytes, layout: Layout, *, first_record: int = 1) -> Records:
    """What the records in `data` say, without the exit record. Exactly the other way of `encode`.

    Raises ProgramError at the first record with a wrong check byte, with a bit that the format keeps 0, or that
    would end the section, and for a number of bytes that is not whole records.
    """
    view = _view(data, layout)
    travel = np.empty((len(view), layout.axis_count), np.int16)
    auxiliary = np.empty(len(view), np.uint32) if layout.uses_auxiliary else None
    for start in range(0, len(view), PIECE_RECORDS):
        piece = slice(start, start + PIECE_RECORDS)
        raw = _raw(view[piece], layout)
        wrong = raw.wrong(layout)
        if wrong.any():
            index = start + int(np.argmax(wrong))
            raise ProgramError(f"record {first_record + index:,}: {_what_is_wrong(view[index].tobytes(), layout)}")
        for axis in range(layout.axis_count):
            travel[piece, axis] = _unpacked(raw.words[axis], layout)
        extra = None
        if auxiliary is not None:
            extra = auxiliary[piece] = _unpacked_auxiliary(raw.auxiliary, layout)
        _refuse_no_motion(raw.words, extra, first_record + start)
    return Records(travel=travel, auxiliary=auxiliary)


def decode_as_they_are(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Records:
    """As `decode`, whatever is wrong with the records: what a reader makes of them who looks at no check byte."""
    raw = _raw(_view(data, layout), layout)
    travel = np.ascontiguousarray(_unpacked(raw.words, layout).T)
    return Records(
        travel=travel, auxiliary=_unpacked_auxiliary(raw.auxiliary, layout) if layout.uses_auxiliary else None
    )


def faults(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> Iterator[tuple[int, str]]:
    """(index from 0, what is wrong) of every record with a wrong check byte or a bit that must be 0."""
    view = _view(data, layout)
    for start in range(0, len(view), PIECE_RECORDS):
        records = view[start : start + PIECE_RECORDS]
        for index in np.flatnonzero(_raw(records, layout).wrong(layout)):
            yield start + int(index), _what_is_wrong(records[index].tobytes(), layout)


def first_exit(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> int | None:
    """The index of the first record whose travel and auxiliary function are all 0, whatever its check byte."""
    view = _view(data, layout)
    for start in range(0, len(view), PIECE_RECORDS):
        raw = _raw(view[start : start + PIECE_RECORDS], layout)
        zero = np.flatnonzero((np.bitwise_or.reduce(raw.words, axis=0) == 0) & (raw.auxiliary == 0))
        if len(zero):
            return start + int(zero[0])
    return None


@dataclass(frozen=True, slots=True)
class _Raw:
    """The columns of a piece as they stand on the line: words with their bytes swapped, shape (axes, records)."""

    words: _Words
    auxiliary: Auxiliary
    check: Bytes

    def wrong(self, layout: Layout) -> NDArray[np.bool_]:
        total = _sum_of_words(self.words)
        if layout.uses_auxiliary:
            total += _sum_of_longs(self.auxiliary)
        wrong: NDArray[np.bool_] = total != self.check
        if layout.format is RecordFormat.SPECIAL:
            wrong |= (np.bitwise_or.reduce(self.words, axis=0) & np.uint16(0x0101)) != 0
            wrong |= (self.auxiliary & np.uint32(0x01010101)) != 0
        return wrong


def _raw(records: NDArray[Any], layout: Layout) -> _Raw:
    words = np.empty((layout.axis_count, len(records)), np.uint16)
    for axis in range(layout.axis_count):
        words[axis] = records[f"axis{axis}"]
    auxiliary = records["aux"].astype(np.uint32) if layout.uses_auxiliary else np.zeros(1, np.uint32)
    return _Raw(words, auxiliary, np.ascontiguousarray(records["check"]))


def _what_is_wrong(record: bytes, layout: Layout) -> str:
    shown = record.hex(" ").upper()
    if layout.format is RecordFormat.SPECIAL and any(byte & 1 for byte in record[:-1]):
        at = next(index for index, byte in enumerate(record) if byte & 1)
        return (
            f"byte {at + 1} is {record[at]:02X}h, but bits 8 and 0 of every word are 0 in the special format ({shown})"
        )
    expected = sum(record[:-1]) & 0xFF
    return f"the check byte is {record[-1]:02X}h, the sum of the other bytes {expected:02X}h ({shown}): alarm SR890"


def _record_dtype(layout: Layout) -> np.dtype[Any]:
    """One record; words have their high byte first, so as little-endian numbers they are swapped."""
    names = [f"axis{axis}" for axis in range(layout.axis_count)]
    formats = ["<u2"] * layout.axis_count
    offsets = list(range(0, 2 * layout.axis_count, 2))
    if layout.uses_auxiliary:
        names, formats, offsets = [*names, "aux"], [*formats, ">u4"], [*offsets, 2 * layout.axis_count]
    return np.dtype(
        {
            "names": [*names, "check"],
            "formats": [*formats, "u1"],
            "offsets": [*offsets, layout.record_bytes - 1],
            "itemsize": layout.record_bytes,
        }
    )


def _view(data: bytes | bytearray | memoryview | Bytes, layout: Layout) -> NDArray[Any]:
    flat = np.frombuffer(data, np.uint8)
    if len(flat) % layout.record_bytes:
        raise ProgramError(
            f"{len(flat):,} bytes are no whole number of records of {layout.record_bytes} ({layout}): "
            f"{len(flat) % layout.record_bytes} are left over"
        )
    return flat.view(_record_dtype(layout))


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


def _checked_columns(travel: NDArray[Any], layout: Layout, first_record: int) -> _Words:
    """Shape (axes, records): one contiguous row an axis."""
    low, high = layout.travel_limits
    columns = np.ascontiguousarray(travel.T)
    if columns.size and not (columns.min() >= low and columns.max() <= high):
        axis, record = _first((columns < low) | (columns > high))
        raise ProgramError(
            f"record {first_record + record:,}, axis {axis + 1}: {int(columns[axis, record]):,} increments per unit "
            f"time are outside {low} to {high} of the {layout.format} format"
        )
    return columns.astype(np.int16, copy=False).view(np.uint16)


def _first(wrong: NDArray[np.bool_]) -> tuple[int, int]:
    """(row, column) of the first True in the order of columns."""
    column, row = np.argwhere(wrong.T)[0]
    return int(row), int(column)


def _checked_auxiliary(auxiliary: NDArray[Any], layout: Layout, first_record: int) -> Auxiliary:
    words = auxiliary.astype(np.int64, copy=False)
    wrong = np.flatnonzero((words < 0) | ((words & ~SIGNIFICANT) > layout.largest_auxiliary))
    if len(wrong):
        raise ProgramError(
            f"record {first_record + int(wrong[0]):,}: auxiliary function {int(words[wrong[0]]) & ~SIGNIFICANT:,} is "
            f"outside 0 to {layout.largest_auxiliary:,} of the {layout.format} format"
        )
    return words.astype(np.uint32)


def _refuse_no_motion(words: _Words, auxiliary: Auxiliary | None, first_record: int) -> None:
    """Whether a zero auxiliary function alone leaves the mode is not stated (9.1): it is not sent."""
    moving: NDArray[Any] = np.bitwise_or.reduce(words, axis=0)
    if auxiliary is not None:
        moving = (moving != 0) | (auxiliary > np.uint32(SIGNIFICANT))
    if moving.size and not moving.min():
        raise ProgramError(f"record {first_record + int(np.argmin(moving)):,}: {NO_MOTION}")


def _pack(view: NDArray[Any], words: _Words, auxiliary: Auxiliary | None, layout: Layout) -> None:
    swapped = _swapped(words, layout)
    for axis in range(layout.axis_count):
        view[f"axis{axis}"] = swapped[axis]
    total = _sum_of_words(swapped)
    if auxiliary is not None:
        packed = _packed_auxiliary(auxiliary, layout)
        view["aux"] = packed
        total += _sum_of_longs(packed)
    view["check"] = total


def _swapped(words: _Words, layout: Layout) -> _Words:
    """Words as the line carries them, high byte first: special D6..D0 0 D13..D7 0, general D7..D0 D15..D8."""
    if layout.format is RecordFormat.GENERAL:
        return words.byteswap()
    swapped = words >> np.uint16(6)
    swapped &= np.uint16(0x00FE)
    swapped |= words << np.uint16(9)
    return swapped


def _unpacked(column: _Words, layout: Layout) -> Travel:
    if layout.format is RecordFormat.GENERAL:
        return column.byteswap().view(np.int16)
    spread = column >> _EIGHT
    spread <<= np.uint16(1)
    spread |= column << _EIGHT
    travel: Travel = spread.view(np.int16)
    travel >>= np.int16(2)
    return travel


def _packed_auxiliary(auxiliary: Auxiliary, layout: Layout) -> Auxiliary:
    if layout.format is RecordFormat.GENERAL:
        return auxiliary
    packed = auxiliary & np.uint32(SIGNIFICANT)
    for group, bits in enumerate(_SEVEN_BITS):
        packed |= (auxiliary & np.uint32(bits)) << np.uint32(group + 1)
    return packed


def _unpacked_auxiliary(packed: NDArray[Any], layout: Layout) -> Auxiliary:
    words: Auxiliary = packed.astype(np.uint32)
    if layout.format is RecordFormat.GENERAL:
        return words
    auxiliary = words & np.uint32(SIGNIFICANT)
    for group, bits in enumerate(_SEVEN_BITS):
        auxiliary |= (words >> np.uint32(group + 1)) & np.uint32(bits)
    return auxiliary


def _sum_of_words(words: _Words) -> Bytes:
    """Of all bytes of each record, modulo 256: added up as bytes, high and low ones side by side, then each pair."""
    pairs = np.add.reduce(words.view(np.uint8), axis=0, dtype=np.uint8).view(np.uint16)
    total: Bytes = (pairs + (pairs >> _EIGHT)).astype(np.uint8)
    return total


def _sum_of_longs(packed: Auxiliary) -> Bytes:
    quarters = (packed >> np.uint32(shift) for shift in (8, 16, 24))
    total: Bytes = sum(quarters, packed).astype(np.uint8)
    return total
