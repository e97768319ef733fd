"""`g05 check` sees a program as a control does: label skip, EOR, and what is nearly G05."""

from __future__ import annotations

import io

import pytest

from tapewire.g05.check import Asked, Checked, check
from tapewire.g05.layout import Layout, RecordFormat
from tests.g05.test_sections import AFTER, section

SPECIAL = Layout(axis_count=3)
GENERAL = Layout(axis_count=3, format=RecordFormat.GENERAL)


def checked(data: bytes, cut: int = 1 << 18) -> Checked:
    file = io.BytesIO(data)
    return check(lambda count: file.read(min(count, cut)), Asked(layout=SPECIAL))


@pytest.mark.parametrize("cut", [1, 5, 1 << 18])
@pytest.mark.parametrize(
    ("before", "line"),
    [(b"%\nO1(5% FEED)\nG05\n", 2), (b"%\nO1\nM30\n%\nO2\nG05\n", 4), (b"\n%\nG05\n", 2), (b"O1\nM30%\nG05\n", 2)],
)
def test_a_section_behind_the_end_of_the_data_is_a_problem(before: bytes, line: int, cut: int) -> None:
    result = checked(before + section(SPECIAL, 30) + AFTER, cut)
    assert [f"% in line {line} ends the data" in problem for problem in result.sections[0].problems] == [True]


@pytest.mark.parametrize("before", [b"%\nG05\n", b"%(A % IN THE TITLE)\nG05\n", b"O1%\nG05\n", b"\nG05\n"])
def test_label_skip_passes_over_the_first_block(before: bytes) -> None:
    result = checked(before + section(SPECIAL, 30) + b"G05\n" + section(SPECIAL, 30) + AFTER)
    assert result.sound
    assert [found.notes for found in result.sections] == [[], []]


@pytest.mark.parametrize(("made", "read", "told"), [(SPECIAL, GENERAL, True), (GENERAL, GENERAL, False)])
def test_records_of_the_special_format_do_not_pass_for_general_ones(made: Layout, read: Layout, told: bool) -> None:
    """Read with the other format every check byte is right, and every travel wrong."""
    file = io.BytesIO(b"%\nO1\nG05\n" + section(made, 30) + AFTER)
    result = check(file.read, Asked(layout=read))
    assert result.sound
    assert ["look like the special format" in note for note in result.sections[0].notes[-1:]].count(True) == told


def test_percent_among_the_records_ends_nothing() -> None:
    general = Layout(axis_count=1)
    data = bytes.fromhex("24 4A 6E") * 3 + bytes(3)
    file = io.BytesIO(b"%\nG05\n" + data + b"G05\n" + data + AFTER)
    result = check(file.read, Asked(layout=general))
    assert (result.sound, result.section_count) == (True, 2)


@pytest.mark.parametrize("cut", [1, 1 << 18])
def test_g05_in_the_first_block_is_told(cut: int) -> None:
    data = section(SPECIAL, 30)
    result = checked(b"G05\n" + data + b"G05\n" + data + AFTER, cut)
    assert ["label skip" in " ".join(found.notes) for found in result.sections] == [True, False]


@pytest.mark.parametrize("cut", [1, 1 << 18])
@pytest.mark.parametrize("block", [b"G05.", b"N5 g5.0 (X)", b"G0 5. 0\r"])
def test_g05_with_a_point_is_named(block: bytes, cut: int) -> None:
    result = checked(b"%\nO1\n" + block + b"\n" + section(SPECIAL, 30) + AFTER, cut)
    assert (result.sound, result.section_count) == (False, 0)
    assert [problem.split(":")[0] for problem in result.problems] == ["line 3"]


@pytest.mark.parametrize("block", [b"G05.1Q1", b"G05P10000", b"G05.5", b"X05."])
def test_what_only_looks_like_it(block: bytes) -> None:
    result = checked(b"%\n" + block + b"\n" + AFTER)
    assert (result.problems, result.section_count) == ([], 0)
