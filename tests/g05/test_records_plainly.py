"""Records against a plain reading of the manual, one bit after the other, and pieces cut anywhere (B-63322EN-1 9.1)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.g05 import records
from tapewire.g05.layout import AuxiliaryUse, Layout, RecordFormat
from tapewire.g05.records import decode, decode_as_they_are, encode, faults, first_exit

THREE_AXES: Final = Layout(axis_count=3)

layouts = st.builds(
    Layout,
    axis_count=st.integers(1, 24),
    format=st.sampled_from(RecordFormat),
    auxiliary=st.sampled_from(AuxiliaryUse),
)
piece_bytes = st.sampled_from([1, 20, 64, 200, records.PIECE_BYTES])


def plain_word(value: int, form: RecordFormat) -> list[int]:
    """Two bytes of a number, high byte first; of the special format bits 8 and 0 stay 0."""
    if form is RecordFormat.GENERAL:
        return [value >> 8 & 0xFF, value & 0xFF]
    bits = [value >> place & 1 for place in range(14)]
    high = sum(bit << place for place, bit in enumerate(bits[7:], 1))
    return [high, sum(bit << place for place, bit in enumerate(bits[:7], 1))]


def plain_auxiliary(word: int, form: RecordFormat) -> list[int]:
    """Four bytes of an auxiliary function, the fourth first, whose highest bit says that the others are significant."""
    if form is RecordFormat.GENERAL:
        return [word >> 24 & 0xFF, word >> 16 & 0xFF, word >> 8 & 0xFF, word & 0xFF]
    groups = [word >> 21 & 0x3F, word >> 14 & 0x7F, word >> 7 & 0x7F, word & 0x7F]
    return [groups[0] << 1 | word >> 31 << 7, *(group << 1 for group in groups[1:])]


def plain(travel: NDArray[Any], layout: Layout, auxiliary: NDArray[Any] | None) -> bytes:
    line = bytearray()
    for index, numbers in enumerate(travel.tolist()):
        record = [byte for number in numbers for byte in plain_word(number, layout.format)]
        if auxiliary is not None:
            record += plain_auxiliary(int(auxiliary[index]), layout.format)
        line += bytes([*record, sum(record) % 256])
    return bytes(line)


def drawn(layout: Layout, count: int, seed: int, share_of_zeros: float) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Numbers over the whole range with many zeros and many ends among them; records may be without motion."""
    random = np.random.default_rng(seed)
    low, high = layout.travel_limits
    travel = random.integers(low, high + 1, (count, layout.axis_count))
    travel = np.where(random.random(travel.shape) < 0.2, random.choice([low, high, -1, 1, 128], travel.shape), travel)
    travel[random.random(travel.shape) < share_of_zeros] = 0
    if not layout.uses_auxiliary:
        return travel, None
    values = random.integers(0, layout.largest_auxiliary + 1, count)
    values = np.where(random.random(count) < 0.2, layout.largest_auxiliary, values)
    values[random.random(count) < share_of_zeros] = 0
    return travel, values | random.choice([0, 1 << 31], count)


def first_still(travel: NDArray[Any], auxiliary: NDArray[Any] | None) -> int | None:
    """The first record that may not be sent."""
    for index, numbers in enumerate(travel.tolist()):
        if not any(numbers) and (auxiliary is None or int(auxiliary[index]) <= 1 << 31):
            return index
    return None


@settings(max_examples=300, deadline=None)
@given(
    layout=layouts,
    count=st.integers(0, 40),
    seed=st.integers(0, 2**32),
    zeros=st.sampled_from([0.0, 0.1, 0.7, 0.95]),
    size=piece_bytes,
)
@example(layout=THREE_AXES, count=1, seed=1, zeros=0.0, size=1)
@example(layout=THREE_AXES, count=40, seed=1, zeros=0.0, size=20)
def test_records_are_as_the_manual_draws_them(layout: Layout, count: int, seed: int, zeros: float, size: int) -> None:
    travel, auxiliary = drawn(layout, count, seed, zeros)
    still = first_still(travel, auxiliary)
    line = plain(travel, layout, auxiliary)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(records, "PIECE_BYTES", size)
        read = decode_as_they_are(line, layout)
        assert list(faults(line, layout)) == []
        leaves = [
            index for index in range(count) if not any(line[index * layout.record_bytes :][: layout.record_bytes])
        ]
        assert first_exit(line, layout) == (leaves[0] if leaves else None)
        if still is None:
            assert encode(travel, layout, auxiliary).tobytes() == line
            decode(line, layout)
        else:
            with pytest.raises(ProgramError, match=f"^record {still + 1}: no travel and no auxiliary"):
                encode(travel, layout, auxiliary)
            with pytest.raises(ProgramError, match=f"^record {still + 1}: no travel and no auxiliary"):
                decode(line, layout)
    assert np.array_equal(read.travel, travel)
    assert (read.auxiliary is None) is (auxiliary is None)
    assert read.auxiliary is None or (read.auxiliary == auxiliary).all()


@settings(max_examples=100, deadline=None)
@given(layout=layouts, seed=st.integers(0, 2**32), size=piece_bytes, data=st.data())
def test_damage_is_found_in_its_piece(layout: Layout, seed: int, size: int, data: st.DataObject) -> None:
    travel, auxiliary = drawn(layout, 30, seed, 0.0)
    travel[travel == 0] = 1
    line = bytearray(plain(travel, layout, auxiliary))
    records_damaged = set()
    for at in data.draw(st.lists(st.integers(0, len(line) - 1), min_size=1, max_size=3, unique=True)):
        record = at // layout.record_bytes
        if record not in records_damaged:
            line[at] ^= 1 << data.draw(st.integers(0, 7))
            records_damaged.add(record)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(records, "PIECE_BYTES", size)
        assert [index for index, _ in faults(line, layout)] == sorted(records_damaged)
        with pytest.raises(ProgramError, match=f"^record {min(records_damaged) + 1}: "):
            decode(line, layout)


@pytest.mark.parametrize("layout", [THREE_AXES, Layout(axis_count=5, auxiliary=AuxiliaryUse.USED)], ids=str)
@pytest.mark.parametrize("dtype", ["<i2", ">i2", "<i8", ">i4"])
def test_arrays_of_any_order_in_memory(layout: Layout, dtype: str) -> None:
    travel, auxiliary = drawn(layout, 50, 3, 0.0)
    travel[:, 0] |= 1
    line = plain(travel, layout, auxiliary)
    apart = np.zeros((100, 2 * layout.axis_count), dtype)
    apart[::2, ::2] = travel
    orders = [travel.astype(dtype), np.asfortranarray(travel.astype(dtype)), apart[::2, ::2]]
    for words in [None] if auxiliary is None else _orders_of(auxiliary):
        for order in orders:
            assert encode(order, layout, words).tobytes() == line
    backwards = None if auxiliary is None else auxiliary[::-1]
    assert encode(orders[0][::-1], layout, backwards).tobytes() == plain(travel[::-1], layout, backwards)


def _orders_of(auxiliary: NDArray[Any]) -> list[NDArray[Any]]:
    apart = np.zeros(2 * len(auxiliary), np.uint32)
    apart[::2] = auxiliary
    return [auxiliary, auxiliary.astype(np.uint32), auxiliary.astype(">u4"), apart[::2]]


@pytest.mark.parametrize("axes", [3, 5, 7, 9, 12, 19, 20])
@pytest.mark.parametrize("at", [0, 18, 19, 20, 38, 39, 40])
def test_the_last_record_of_a_piece(axes: int, at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """More of a record may be written at once than there is of it: what stands behind a piece and behind all stays."""
    layout = Layout(axis_count=axes)
    monkeypatch.setattr(records, "PIECE_BYTES", 20 * layout.record_bytes)
    travel = np.arange(41 * axes).reshape(41, axes)
    travel[at] = -8192
    made = encode(travel, layout)
    assert made.tobytes() == plain(travel, layout, None)
    assert np.array_equal(decode(made, layout).travel, travel)
    for axis in range(axes):
        travel[at] = 0
        travel[at, axis] = 1
        assert encode(travel, layout).tobytes() == plain(travel, layout, None)
    travel[at] = 0
    assert first_exit(plain(travel, layout, None), layout) == at
    with pytest.raises(ProgramError, match=f"^record {at + 1}: no travel"):
        encode(travel, layout)


@pytest.mark.parametrize("size", [1, 30, 1000])
def test_of_several_numbers_out_of_range_the_first_is_named(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records, "PIECE_BYTES", size)
    travel = np.ones((50, 3), np.int16)
    travel[31, 2] = travel[44, 0] = -8193
    with pytest.raises(ProgramError, match=r"^record 32, axis 3: -8,193 increments per unit time are outside"):
        encode(travel, THREE_AXES)
    layout = Layout(axis_count=3, auxiliary=AuxiliaryUse.USED)
    for dtype in (np.uint32, np.int64):
        words = np.full(50, 1 << 31 | 5, dtype)
        words[30] |= 1 << 27
        with pytest.raises(ProgramError, match=r"^record 31: auxiliary function 134,217,733 is outside 0 to 134,217,7"):
            encode(np.ones((50, 3), np.int16), layout, words)
    with pytest.raises(ProgramError, match=r"^record 1: auxiliary function .* is outside"):
        encode(np.ones((1, 3), np.int16), layout, np.array([-1]))
