"""G05 sections inside NC programs: found, passed through untouched, and never taken for text."""

from __future__ import annotations

import io
from itertools import pairwise
from typing import Final
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.errors import ProgramError
from tapewire.fanuc import tape
from tapewire.fanuc.tape import TapeScanner, prepare
from tapewire.g05 import records
from tapewire.g05.layout import SIGNIFICANT, AuxiliaryUse, BinaryInput, Layout, RecordFormat, UnitTime
from tapewire.g05.sections import LONGEST_BLOCK, BlockWatch, ExitFinder, Section, record_lengths

BEFORE: Final = b"%\nO1\nG05\n"
AFTER: Final = b"M02\n%"
WITH_AUXILIARY: Final = Layout(axis_count=5, format=RecordFormat.GENERAL, auxiliary=AuxiliaryUse.USED)

layouts = st.builds(
    Layout,
    axis_count=st.integers(1, 24),
    format=st.sampled_from(RecordFormat),
    auxiliary=st.sampled_from(AuxiliaryUse),
)


def section(layout: Layout, count: int = 50, seed: int = 1) -> bytes:
    """Random records that hold every byte a format can hold, and the exit record."""
    random = np.random.default_rng(seed)
    low, high = layout.travel_limits
    travel = random.integers(low, high + 1, (count, layout.axis_count))
    travel[(travel == 0).all(axis=1), 0] = 1
    words = random.integers(1, layout.largest_auxiliary, count) | SIGNIFICANT
    data = records.encode(travel, layout, words if layout.uses_auxiliary else None)
    return data.tobytes() + layout.exit_record


def prepared(file: bytes, code: DataCode = DataCode.ASCII, record_bytes: int | None = None) -> bytes:
    out = bytearray()
    prepare(io.BytesIO(file).read, out.extend, code, record_bytes)
    return bytes(out)


@settings(max_examples=60, deadline=None)
@given(layout=layouts, seed=st.integers(0, 999), chunk=st.integers(1, 90), sections=st.integers(1, 3))
def test_records_pass_untouched_however_the_file_is_read(layout: Layout, seed: int, chunk: int, sections: int) -> None:
    data = section(layout, 30, seed)
    file = b"%\r\nO1\r\n" + b"".join(b"G05\r\n" + data + b"G01X1.\r\n" for _ in range(sections)) + b"M02\r\n%\r\n"
    expected = b"%\nO1\n" + b"".join(b"G05\n" + data + b"G01X1.\n" for _ in range(sections)) + AFTER
    with mock.patch.object(tape, "CHUNK_BYTES", chunk):
        assert prepared(file) == expected


@pytest.mark.parametrize("code", [DataCode.ISO, DataCode.EIA])
def test_the_text_is_converted_and_the_records_are_not(code: DataCode) -> None:
    data = section(Layout(axis_count=3, format=RecordFormat.GENERAL))
    assert prepared(BEFORE + data + AFTER, code) == encode(BEFORE, code) + data + encode(AFTER, code)


def test_nothing_is_put_behind_an_exit_record_but_eor() -> None:
    data = section(Layout(axis_count=3))
    assert prepared(BEFORE + data) == BEFORE + data + b"%"


@pytest.mark.parametrize("at", range(0, 71, 7))
def test_a_damaged_record_is_named_with_its_line(at: int) -> None:
    data = bytearray(section(Layout(axis_count=3), 10))
    data[at] ^= 4
    words = rf"line 3, column 1: .* record {at // 7 + 1} of 7 bytes has the check byte"
    with pytest.raises(ProgramError, match=words):
        prepared(BEFORE + data + AFTER, record_bytes=7)


def test_a_section_that_is_cut_off_is_refused() -> None:
    data = section(Layout(axis_count=3), 10)
    for length in range(len(data)):
        with pytest.raises(ProgramError, match="line 3, column 1: after the block G05"):
            prepared(BEFORE + data[:length])
        with pytest.raises(ProgramError, match="line 3, column 1: after the block G05"):
            prepared(BEFORE + data[:length] + AFTER, record_bytes=7)


def test_random_bytes_are_no_section() -> None:
    random = np.random.default_rng(3)
    for _ in range(300):
        with pytest.raises(ProgramError, match="line 3"):
            prepared(BEFORE + random.bytes(200))


def test_a_long_section_is_checked_to_its_end_in_little_memory() -> None:
    data = bytearray(section(Layout(axis_count=3), 100_000))
    held = Section()
    passed = sum(len(held.feed(bytes(data[at : at + 1000]))[0]) for at in range(0, len(data), 1000))
    assert (held.ended, held.record_count, held.record_bytes, passed) == (True, 100_000, 7, len(data))
    assert held.is_special
    data[7 * 99_000] ^= 2
    with pytest.raises(ProgramError, match="record 99,001 of 7"):
        prepared(BEFORE + data + AFTER)


@settings(max_examples=60, deadline=None)
@given(layout=layouts, seed=st.integers(0, 999))
def test_the_length_of_records_is_found(layout: Layout, seed: int) -> None:
    data = section(layout, 12, seed)
    assert record_lengths(data + AFTER, whole=True) == [layout.record_bytes]


def test_a_section_without_records_is_none() -> None:
    with pytest.raises(ProgramError, match="no length of records"):
        prepared(BEFORE + bytes(7) + AFTER)


@settings(max_examples=100, deadline=None)
@given(layout=layouts, seed=st.integers(0, 999), cuts=st.lists(st.integers(0, 3000), max_size=8))
def test_the_exit_record_is_found_however_the_records_are_cut(layout: Layout, seed: int, cuts: list[int]) -> None:
    data = section(layout, 20, seed) + AFTER
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    finder, end = ExitFinder(layout.record_bytes), None
    for start, stop in pairwise(places):
        end = finder.feed(data[start:stop])
        if end is not None:
            end += start
            break
    assert end == len(data) - len(AFTER)


@settings(max_examples=100, deadline=None)
@given(layout=layouts, seed=st.integers(0, 999), cuts=st.lists(st.integers(0, 3000), max_size=8))
def test_an_eor_code_among_the_records_ends_nothing(layout: Layout, seed: int, cuts: list[int]) -> None:
    data = BEFORE + section(layout, 20, seed) + AFTER
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for code in (DataCode.ASCII, DataCode.ISO):
        scanner = TapeScanner(code, layout.record_bytes)
        ends = [scanner.feed(data[a:b]) for a, b in pairwise(places)]
        assert scanner.ended
        assert not any(end is not None for end in ends[:-1]) or len(data) in places[:-1]


def test_a_scanner_that_knows_no_records_takes_a_percent_sign_for_the_end() -> None:
    data = BEFORE + bytes.fromhex("25 00 25") + bytes(3) + AFTER
    assert TapeScanner(DataCode.ASCII).feed(data) == len(BEFORE) + 1
    assert TapeScanner(DataCode.ASCII, 3).feed(data) == len(data)


@pytest.mark.parametrize(
    ("word", "layout", "unit_time"),
    [
        ("auto", None, UnitTime.MS_8),
        ("3", Layout(axis_count=3), UnitTime.MS_8),
        (
            "5,general,aux,2ms",
            Layout(axis_count=5, format=RecordFormat.GENERAL, auxiliary=AuxiliaryUse.USED),
            UnitTime.MS_2,
        ),
    ],
)
def test_parameters_in_one_word(word: str, layout: Layout | None, unit_time: UnitTime) -> None:
    parsed = BinaryInput.parse(word)
    assert parsed == BinaryInput(layout=layout, unit_time=unit_time)
    assert BinaryInput.parse(str(parsed)) == parsed


@pytest.mark.parametrize("word", ["", "x", "0", "25", "3,", "3,fast", "auto,2ms", "3,3ms", "-3", "100", "³"])
def test_a_word_that_is_none(word: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        BinaryInput.parse(word)


@pytest.mark.parametrize("blanks", [LONGEST_BLOCK - 4, LONGEST_BLOCK - 3, LONGEST_BLOCK + 900])
@pytest.mark.parametrize("between", [b"", b"X1"])
def test_a_block_too_long_is_none_however_it_is_cut(blanks: int, between: bytes) -> None:
    text = b"O1\n" + b" " * blanks + between + b"G05\n"
    found = [BlockWatch().feed(text)]
    for at in (3 + blanks, 3 + blanks + len(between), len(text) - 1):
        watch = BlockWatch()
        first = watch.feed(text[:at])
        second = watch.feed(text[at:])
        assert first is None
        found.append(None if second is None else at + second)
    assert found == [None if between or blanks > LONGEST_BLOCK - 4 else len(text)] * 4
