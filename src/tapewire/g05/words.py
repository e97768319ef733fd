"""Words of many records, one record behind the other, so that numpy works on all of them at once.

A word of sixteen bits is the same wherever it stands, so packing and unpacking look at no record, and neither do sums
of neighbouring bytes. What looks at records is `carry`, between words and records on the line. To take memory costs as
much as to work on it: rooms as long as the words are handed in, and what they hold is lost. Words are little-endian on
every computer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.layout import SIGNIFICANT, RecordFormat

__all__ = [
    "Auxiliary",
    "Bytes",
    "Rooms",
    "Sums",
    "Words",
    "carry",
    "has_odd_byte",
    "lane_bytes",
    "moving",
    "pack",
    "pack_auxiliary",
    "unpack",
    "unpack_auxiliary",
]

Bytes: TypeAlias = NDArray[np.uint8]
Words: TypeAlias = NDArray[np.uint16]
Auxiliary: TypeAlias = NDArray[np.uint32]
Rooms: TypeAlias = tuple[Bytes, Bytes]

_WIDE: Final = 40
"""Bytes of a record from which on it is quicker to copy records one by one."""

_SEVEN_BITS: Final = (0x7F, 0x7F << 7, 0x7F << 14, 0x3F << 21)


def lane_bytes(width: int) -> int:
    """How much of a row of `width` bytes, an even number, `carry` takes at once: 2, 4, 8 or 16."""
    return min(1 << (width - 1).bit_length(), 16)


def carry(source: Bytes, into: Bytes, width: int, room: Bytes) -> bool:
    """The first `width` bytes of every row of `source` to every row of `into`, whose rows may be longer or shorter.

    Up to sixteen bytes of all rows at a time, the last as far as need be over those before. numpy is quick from or to
    items without a gap, but not between two arrays with gaps of an odd length. Of rows of six bytes eight are taken, of
    ten to fourteen sixteen: what is too much the next row overwrites, and the last row therefore goes by itself. `room`
    is as long as `lane_bytes` of all rows.

    Returns whether the first eight bytes, if there are as many, are other than 0 in every row.
    """
    size = lane_bytes(width)
    count = len(source) - (size > width)
    lane = room[: count * size].view(f"V{size}")
    if width < _WIDE:
        last = max(width - size, 0)
        for begin in (last, *reversed(range(0, last, size))):
            np.copyto(lane, _column(source, begin, lane))
            np.copyto(_column(into, begin, lane), lane)
        into[count:, :width] = source[count:, :width]
    else:
        into[:, :width] = source[:, :width]
        np.copyto(lane, _column(source, 0, lane))
    return _are_not_0(lane.view(np.uint8), size, width) and bool(source[-1, :width].any())


def _column(rows: Bytes, begin: int, like: NDArray[np.void]) -> NDArray[np.void]:
    """Items like those of `like` at byte `begin` of every row."""
    return np.ndarray(like.shape, like.dtype, rows.data, begin, rows.strides[:1])


def _are_not_0(lane: Bytes, size: int, width: int) -> bool:
    """The first eight bytes, or `width`, of every `size`. Mostly a look at all is enough, without a gap or a mask."""
    if lane.view("<u4" if width == 6 else f"<u{min(size, 8)}").min(initial=1):
        return True
    first = lane.view(f"<u{min(size, 8)}")[:: max(size // 8, 1)]
    return bool((first & ((1 << 8 * min(width, 8)) - 1)).min())


def pack(numbers: NDArray[np.int16], words: Words, spare: Words, form: RecordFormat) -> None:
    """Numbers to words as the line carries them, high byte first: special D6-D0 0 D13-D7 0, general D7-D0 D15-D8."""
    bits = numbers.view("<u2")
    if form is RecordFormat.GENERAL:
        np.copyto(words.view(">u2"), bits)
        return
    np.right_shift(bits, 6, out=spare)
    np.bitwise_and(spare, 0x00FE, out=spare)
    np.multiply(bits, 1 << 9, out=words)
    np.bitwise_or(words, spare, out=words)


def unpack(words: Words, numbers: NDArray[np.int16], spare: Words, form: RecordFormat) -> None:
    """The other way of `pack`; bits that the special format keeps 0 are passed over. `words` are lost."""
    if form is RecordFormat.GENERAL:
        np.copyto(numbers, words.view(">i2"))
        return
    np.right_shift(words, 7, out=spare)
    np.multiply(words, 1 << 8, out=words)
    np.bitwise_or(words, spare, out=words)
    np.right_shift(words.view("<i2"), 2, out=numbers)


class Sums:
    """Sums of the bytes of every `width` in `data`, an even number, modulo 256, as `data` stand when `add` is called.

    All steps are made ready here: that takes as long as a step on a few thousand records. As long as the width is even
    every byte is added to the next one and every other sum kept. Then come the sums of all neighbours, twice as many a
    step and one more where the odd width asks for it, of which one of every `width` counts. `total` stands in a room.
    """

    def __init__(self, data: Bytes, width: int, rooms: Rooms) -> None:
        self._steps: list[tuple[Callable[..., object], tuple[Bytes, ...]]] = []
        sums_room, half_room = rooms
        while width % 2 == 0:
            pairs = sums_room[: len(data)]
            self._steps.append((np.add, (data[:-1], data[1:], pairs[:-1])))
            data, width = half_room[: len(data) // 2], width // 2
            self._steps.append((_keep_low_bytes, (data, pairs.view("<u2"))))
        here, there = sums_room, half_room[len(data) :]
        run, taken = data, 1
        for digit in f"{width:b}"[1:]:
            longer = here[: len(run) - taken]
            self._steps.append((np.add, (run[:-taken], run[taken:], longer)))
            run, taken = longer, 2 * taken
            if digit == "1":
                run = run[:-1]
                self._steps.append((np.add, (run, data[taken:], run)))
                taken += 1
            here, there = there, here
        self.total: Final = run[::width]

    def add(self) -> Bytes:
        for step, arrays in self._steps:
            step(*arrays)
        return self.total


_keep_low_bytes: Final = partial(np.copyto, casting="unsafe")


def has_odd_byte(words: Words | Auxiliary) -> bool:
    return bool(int(np.bitwise_or.reduce(words)) & 0x01010101)


def moving(words: Words, axis_count: int) -> NDArray[np.bool_]:
    """Which records have any travel, packed or not."""
    some: NDArray[np.bool_] = reduce(np.bitwise_or, words.reshape(-1, axis_count).T) != 0
    return some


def pack_auxiliary(auxiliary: Auxiliary, packed: Auxiliary, room: Bytes, form: RecordFormat) -> None:
    """Auxiliary functions to numbers whose highest byte the line carries first.

    In the special format the data are four times seven bits, each a place higher than in the one below, and the bit
    that says whether they are significant is the highest of all. First the upper fourteen go up by two, then the upper
    seven of either fourteen by one, then all by one: bits go up by one or two as they are added once or three times.
    """
    if form is RecordFormat.GENERAL:
        np.copyto(packed, auxiliary)
        return
    part = room[: packed.nbytes].view(np.uint32)
    np.bitwise_and(auxiliary, 0x3FFF << 14, out=part)
    np.multiply(part, 3, out=part)
    np.add(auxiliary, part, out=packed)
    np.bitwise_and(packed, 0x3F803F80, out=part)
    np.add(packed, part, out=packed)
    np.bitwise_and(packed, SIGNIFICANT - 1, out=part)
    np.add(packed, part, out=packed)


def unpack_auxiliary(packed: Auxiliary, form: RecordFormat) -> Auxiliary:
    """The other way of `pack_auxiliary`."""
    if form is RecordFormat.GENERAL:
        return packed
    auxiliary = packed & np.uint32(SIGNIFICANT)
    for group, bits in enumerate(_SEVEN_BITS):
        auxiliary |= (packed >> np.uint32(group + 1)) & np.uint32(bits)
    return auxiliary
