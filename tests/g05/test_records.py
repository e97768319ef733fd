"""Records of binary input operation, both ways, over the whole range (B-63322EN-1 9.1, 9.2)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tapewire.errors import ProgramError, UsageError
from tapewire.g05.layout import (
    SIGNIFICANT,
    AuxiliaryUse,
    IncrementSystem,
    Layout,
    RecordFormat,
    Unit,
    UnitTime,
    required_baud,
)
from tapewire.g05.records import PIECE_BYTES, decode, decode_as_they_are, encode, faults, first_exit

VECTORS: Final[dict[str, Any]] = json.loads((Path(__file__).parents[1] / "vectors" / "g05.json").read_text())
CASES: Final = [(vector, name) for vector in VECTORS["records"] for name in RecordFormat if name in vector]

layouts = st.builds(
    Layout,
    axis_count=st.integers(1, 24),
    format=st.sampled_from(RecordFormat),
    auxiliary=st.sampled_from(AuxiliaryUse),
)


def layout_of(vector: dict[str, Any], name: RecordFormat) -> Layout:
    use = AuxiliaryUse.USED if "auxiliary" in vector else AuxiliaryUse.UNUSED
    return Layout(axis_count=len(vector["travel"]), format=name, auxiliary=use)


def auxiliary_of(vector: dict[str, Any]) -> NDArray[np.uint32] | None:
    if "auxiliary" not in vector:
        return None
    word = vector["auxiliary"]
    return np.array([word["value"] | (SIGNIFICANT if word["significant"] else 0)], np.uint32)


def same(one: NDArray[np.uint32] | None, other: NDArray[np.uint32] | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


@pytest.mark.parametrize(("vector", "name"), CASES, ids=str)
def test_vectors_both_ways(vector: dict[str, Any], name: RecordFormat) -> None:
    layout, record = layout_of(vector, name), bytes.fromhex(vector[name])
    travel, auxiliary = np.array([vector["travel"]], np.int16), auxiliary_of(vector)
    if record == layout.exit_record:
        assert first_exit(record, layout) == 0
        with pytest.raises(ProgramError, match="record 1: no travel and no auxiliary"):
            encode(travel, layout, auxiliary)
        with pytest.raises(ProgramError, match="record 1: no travel and no auxiliary"):
            decode(record, layout)
        return
    assert encode(travel, layout, auxiliary).tobytes() == record
    read = decode(record, layout)
    assert (read.travel == travel).all()
    assert same(read.auxiliary, auxiliary)


def test_a_whole_section() -> None:
    section = VECTORS["section"]
    layout = Layout(axis_count=section["axes"])
    made = encode(np.array(section["travel"]), layout).tobytes() + layout.exit_record
    assert made == bytes.fromhex(section["special"])


@pytest.mark.parametrize("case", VECTORS["required_baud"], ids=str)
def test_required_baud(case: dict[str, Any]) -> None:
    use = AuxiliaryUse.USED if case["auxiliary"] else AuxiliaryUse.UNUSED
    layout = Layout(axis_count=case["axes"], auxiliary=use)
    assert required_baud(layout, UnitTime(case["unit_time_ms"])) == case["baud"]


def drawn(layout: Layout, count: int, seed: int) -> tuple[NDArray[np.int16], NDArray[np.uint32] | None]:
    """Numbers over the whole range, the ends often among them, no record without motion."""
    random = np.random.default_rng(seed)
    low, high = layout.travel_limits
    travel = random.integers(low, high + 1, (count, layout.axis_count))
    travel = np.where(random.random(travel.shape) < 0.1, random.choice([low, high, 0, -1, 1], travel.shape), travel)
    travel[(travel == 0).all(axis=1), 0] = 1
    if not layout.uses_auxiliary:
        return travel.astype(np.int16), None
    values = random.integers(0, layout.largest_auxiliary + 1, count)
    values = np.where(random.random(count) < 0.1, layout.largest_auxiliary, values)
    return travel.astype(np.int16), (values | random.choice([0, SIGNIFICANT], count)).astype(np.uint32)


@settings(max_examples=150, deadline=None)
@given(layout=layouts, count=st.integers(0, 300), seed=st.integers(0, 2**32))
def test_decoding_undoes_encoding(layout: Layout, count: int, seed: int) -> None:
    travel, auxiliary = drawn(layout, count, seed)
    data = encode(travel, layout, auxiliary)
    read = decode(data, layout)
    assert np.array_equal(read.travel, travel)
    assert same(read.auxiliary, auxiliary)
    assert len(data) == count * layout.record_bytes
    if layout.format is RecordFormat.SPECIAL:
        assert not (data & 1).any(), "an odd byte: protocol A could meet its end code"
    records = data.reshape(count, layout.record_bytes)
    assert np.array_equal(records[:, :-1].sum(axis=1) % 256, records[:, -1])


@pytest.mark.parametrize("name", RecordFormat)
def test_every_travel_there_is(name: RecordFormat) -> None:
    layout = Layout(axis_count=1, format=name)
    low, high = layout.travel_limits
    travel = np.tile(np.array([[value] for value in range(low, high + 1) if value], np.int16), (3, 1))
    assert len(travel) * layout.record_bytes > PIECE_BYTES or name is RecordFormat.SPECIAL
    assert (decode(encode(travel, layout), layout).travel == travel).all()


@pytest.mark.parametrize("dtype", [np.int8, np.int32, np.int64, np.uint16])
def test_any_integers_will_do(dtype: Any) -> None:
    layout = Layout(axis_count=2)
    assert (decode(encode(np.array([[1, 2], [3, 4]], dtype), layout), layout).travel == [[1, 2], [3, 4]]).all()


@pytest.mark.parametrize(
    ("value", "name", "words"),
    [
        (8192, RecordFormat.SPECIAL, "record 12, axis 2: 8,192 increments .* -8192 to 8191 of the special"),
        (-8193, RecordFormat.SPECIAL, "record 12, axis 2: -8,193"),
        (32768, RecordFormat.GENERAL, "record 12, axis 2: 32,768 increments .* -32768 to 32767 of the general"),
    ],
)
def test_travel_out_of_range_names_record_axis_and_value(value: int, name: RecordFormat, words: str) -> None:
    travel = np.ones((5, 3), np.int64)
    travel[2, 1] = travel[3, 0] = value
    with pytest.raises(ProgramError, match=words):
        encode(travel, Layout(axis_count=3, format=name), first_record=10)


def test_an_auxiliary_function_out_of_range_names_its_record() -> None:
    layout = Layout(axis_count=1, auxiliary=AuxiliaryUse.USED)
    with pytest.raises(ProgramError, match="record 2: auxiliary function 134,217,728 is outside 0 to 134,217,727"):
        encode(np.array([[1], [1]]), layout, np.array([5, 1 << 27]))


@pytest.mark.parametrize("word", [0, 7, SIGNIFICANT])
def test_no_motion_goes_only_with_a_significant_auxiliary_function(word: int) -> None:
    layout = Layout(axis_count=2, auxiliary=AuxiliaryUse.USED)
    still = np.array([[1, 0], [0, 0]])
    with pytest.raises(ProgramError, match=r"record 2: no travel .* leave it out, or let it carry"):
        encode(still, layout, np.array([0, word]))
    assert decode(encode(still, layout, np.array([0, SIGNIFICANT | 8])), layout).auxiliary is not None


@given(layout=layouts, seed=st.integers(0, 2**32), bit=st.integers(0, 7), data=st.data())
@settings(max_examples=100, deadline=None)
def test_a_flipped_bit_is_found_and_named(layout: Layout, seed: int, bit: int, data: st.DataObject) -> None:
    sound = encode(*_swap(drawn(layout, 20, seed), layout))
    spoilt = sound.copy()
    at = data.draw(st.integers(0, len(spoilt) - 1))
    spoilt[at] ^= 1 << bit
    record = at // layout.record_bytes
    found = list(faults(spoilt, layout))
    assert [index for index, _ in found] == [record]
    with pytest.raises(ProgramError, match=f"record {record + 1}: "):
        decode(spoilt, layout)
    assert len(decode_as_they_are(spoilt, layout)) == 20


def _swap(
    drawn_: tuple[NDArray[np.int16], NDArray[np.uint32] | None], layout: Layout
) -> tuple[NDArray[np.int16], Layout, NDArray[np.uint32] | None]:
    return drawn_[0], layout, drawn_[1]


def test_bytes_that_are_no_whole_records() -> None:
    with pytest.raises(ProgramError, match=r"22 bytes are no whole number of records of 7 .*: 1 are left over"):
        decode(bytes(22), Layout(axis_count=3))


@pytest.mark.parametrize("axes", [0, 25])
def test_axes_that_no_control_has(axes: int) -> None:
    with pytest.raises(UsageError, match=f"{axes} axes: a record has 1 to 24"):
        Layout(axis_count=axes)


@pytest.mark.parametrize(
    ("travel", "auxiliary"),
    [(np.zeros(3, int), None), (np.zeros((1, 2), int), None), (np.zeros((1, 3)), None), (np.ones((1, 3), int), True)],
)
def test_arrays_of_another_shape_are_refused(travel: NDArray[Any], auxiliary: bool | None) -> None:
    with pytest.raises(UsageError):
        encode(travel, Layout(axis_count=3), None if auxiliary is None else np.ones(1, int))


def test_units_of_the_manual() -> None:
    assert [system.per_unit(Unit.MM) for system in IncrementSystem] == [100, 1000, 10_000, 100_000, 1_000_000]
    assert [system.per_unit(Unit.DEGREE) for system in IncrementSystem] == [100, 1000, 10_000, 100_000, 1_000_000]
    assert [system.per_unit(Unit.INCH) for system in IncrementSystem] == [1000, 10_000, 100_000, 1_000_000, 10_000_000]
    assert [time.parameter_bits for time in UnitTime] == ["100", "001", "010", "000", "011"]
