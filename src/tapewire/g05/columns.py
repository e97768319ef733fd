"""Words of many records side by side, so that numpy works on all of them at once.

Travel stands in memory record by record, in an array of numbers as on the line. Here it stands column by column: four
axes to a column of eight bytes as long as there are four, then two, then one. A word of sixteen bits is the same
wherever it stands, so packing and unpacking look at no column; few and wide columns mean few passes through memory.
Columns are little-endian on every computer.
"""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.layout import SIGNIFICANT, RecordFormat

__all__ = [
    "Columns",
    "Words",
    "all_move",
    "columns",
    "copy",
    "fields",
    "moving",
    "pack",
    "pack_auxiliary",
    "sum_of_bytes",
    "unpack",
    "unpack_auxiliary",
]

Words: TypeAlias = NDArray[np.uint16]
Columns: TypeAlias = list[NDArray[Any]]

_SEVEN_BITS: Final = (0x7F, 0x7F << 7, 0x7F << 14, 0x3F << 21)


def columns(words: Words, axis_count: int) -> Columns:
    """The columns of records in `words`, one behind the other and all of it used."""
    count, flat = len(words) // axis_count, words.view(np.uint8)
    made: Columns = []
    begin = 0
    for size, rows in _widths(axis_count):
        end = begin + size * rows * count
        made.append(flat[begin:end].view(f"<u{size}").reshape(rows, count))
        begin = end
    return made


def fields(data: NDArray[np.uint8], axis_count: int, stride: int) -> Columns:
    """The same columns where they stand in `data`: records that begin `stride` bytes apart."""
    count = len(data) // stride
    made: Columns = []
    begin = 0
    for size, rows in _widths(axis_count):
        shape = (rows, count)
        made.append(np.ndarray(shape, f"<u{size}", data.data, begin, (size, stride)) if count else np.empty(shape))
        begin += size * rows
    return made


def _widths(axis_count: int) -> list[tuple[int, int]]:
    """(bytes, how many columns) from the beginning of a record."""
    counts = (8, axis_count // 4), (4, axis_count % 4 // 2), (2, axis_count % 2)
    return [(size, rows) for size, rows in counts if rows]


def copy(source: Columns, into: Columns) -> None:
    for column, place in zip(source, into, strict=True):
        np.copyto(place, column)


def pack(words: Words, spare: Words, form: RecordFormat) -> None:
    """Numbers to words as the line carries them, high byte first: special D6..D0 0 D13..D7 0, general D7..D0 D15..D8.

    In place; `spare` is as long.
    """
    special = form is RecordFormat.SPECIAL
    np.right_shift(words, np.uint16(6 if special else 8), out=spare)
    if special:
        np.bitwise_and(spare, np.uint16(0x00FE), out=spare)
    np.left_shift(words, np.uint16(9 if special else 8), out=words)
    np.bitwise_or(words, spare, out=words)


def unpack(words: Words, spare: Words, form: RecordFormat) -> None:
    """The other way of `pack`; bits that the special format keeps 0 are passed over."""
    special = form is RecordFormat.SPECIAL
    np.right_shift(words, np.uint16(7 if special else 8), out=spare)
    np.left_shift(words, np.uint16(8), out=words)
    np.bitwise_or(words, spare, out=words)
    if special:
        signed = words.view("<i2")
        np.right_shift(signed, np.int16(2), out=signed)


def sum_of_bytes(packed: Columns) -> NDArray[np.uint8]:
    """Of all bytes of each record, modulo 256. Bytes are added side by side, and wide columns then folded in two."""
    total: NDArray[Any] | None = None
    for size in (8, 4, 2):
        for column in packed:
            if column.dtype.itemsize == size:
                added = column.view(np.uint8)
                side_by_side = added[0] if len(added) == 1 else np.add.reduce(added, axis=0, dtype=np.uint8)
                total = (side_by_side if total is None else total.view(np.uint8) + side_by_side).view(f"<u{size}")
        if total is not None:
            upper = total >> total.dtype.type(4 * size)
            np.add(upper.view(np.uint8), total.view(np.uint8), out=upper.view(np.uint8))
            total = upper.astype(f"<u{size // 2}")
    assert total is not None
    return total


def all_move(packed: Columns) -> bool:
    """False where it takes `moving` to tell: the first axes of nearly all records move."""
    return bool(packed[0][0].min(initial=1))


def moving(packed: Columns) -> NDArray[np.bool_]:
    """Which records have any travel, packed or not."""
    some: NDArray[np.bool_] | None = None
    for column in packed:
        here = (column[0] if len(column) == 1 else np.bitwise_or.reduce(column, axis=0)) != 0
        some = here if some is None else np.logical_or(some, here, out=some)
    assert some is not None
    return some


def pack_auxiliary(auxiliary: NDArray[np.uint32], form: RecordFormat) -> NDArray[np.uint32]:
    """Auxiliary functions as the line carries them, highest byte first: as numbers here their bytes are swapped.

    In the special format the data are twice fourteen bits, packed as those of travel, and the bit that says whether
    they are significant is the highest of all.
    """
    if form is RecordFormat.GENERAL:
        return auxiliary.astype("<u4", copy=False).byteswap()
    upper = np.left_shift(auxiliary.astype("<u4", copy=False), np.uint32(1))
    packed: NDArray[np.uint32] = upper >> np.uint32(15)
    np.left_shift(upper, np.uint32(15), out=upper)
    np.bitwise_or(packed, upper, out=packed)
    pack(packed.view("<u2"), upper.view("<u2"), form)
    np.right_shift(auxiliary, np.uint32(24), out=upper)
    np.bitwise_and(upper, np.uint32(0x80), out=upper)
    np.bitwise_or(packed, upper, out=packed)
    return packed


def unpack_auxiliary(packed: NDArray[np.uint32], form: RecordFormat) -> NDArray[np.uint32]:
    """The other way of `pack_auxiliary`."""
    words = packed.byteswap().astype(np.uint32, copy=False)
    if form is RecordFormat.GENERAL:
        return words
    auxiliary = words & np.uint32(SIGNIFICANT)
    for group, bits in enumerate(_SEVEN_BITS):
        auxiliary |= (words >> np.uint32(group + 1)) & np.uint32(bits)
    return auxiliary
