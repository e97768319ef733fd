"""Parameter files in both forms: what is written is read again, and nothing that comes in raises anything else."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import UsageError
from tapewire.fanuc.parameter_check import check
from tapewire.fanuc.parameter_file import ParameterFile, read_parameters, write_punch, write_toml
from tapewire.fanuc.parameters import CATALOGUE, ParameterSet

values = st.dictionaries(st.sampled_from(sorted(CATALOGUE)), st.integers(0, 255), min_size=1)
words = st.sampled_from(
    (
        *("N5074", "N0000", "N77", "P3", "P-1", "P00001000", " ", "\n", ";", "%", "(A)", "(", "=", "[parameters]"),
        *("5000 = { ETX = 1 }", '"', "#", "\x00", "A1", "N9999999", "P99999999999", "5000.1 = 3", "\ud800", "N²", "P²"),
    )
)


@given(values)
def test_what_is_punched_is_read_again(numbers: dict[int, int]) -> None:
    assert read_parameters(write_punch(ParameterSet(numbers))).parameters.values == numbers


@given(values)
def test_what_is_written_as_toml_is_read_again(numbers: dict[int, int]) -> None:
    text = write_toml(ParameterSet(numbers))
    assert read_parameters(text).parameters.values == numbers
    assert len(tomllib.loads(text)["parameters"]) == len(numbers)


@given(st.lists(words, max_size=12).map("".join) | st.text(max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        file = read_parameters(text)
    except UsageError:
        return
    assert file.parameters.values or file.others
    assert set(file.parameters.values) <= set(CATALOGUE)


def test_the_form_users_know() -> None:
    text = "%\nO9999(PARAMETER)\nN5000 P00001001\nN05074P3;N5073 P11\r\nN6001 P5\n%\n"
    values = {5000: 0b1001, 5074: 3, 5073: 11}
    assert read_parameters(text) == ParameterFile(parameters=ParameterSet(values), others=1)


def test_it_is_punched_as_the_control_does() -> None:
    assert write_punch(ParameterSet({5074: 3, 5000: 8, 0: 4})) == "%\nN0000 P00000100\nN5000 P00001000\nN5074 P3\n%\n"


@pytest.mark.parametrize("text", ["5000 = { ETX = 1, ECH = 1 }", '5000 = "1010"', '[parameters]\nN5000 = "00001010"'])
def test_bits_in_toml(text: str) -> None:
    assert read_parameters(text).parameters.values == {5000: 0b1010}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("N5074 P3\nN5074 P1", "line 2: No. 5074 is given twice, with two values"),
        ("N5000 P3", "line 1: No. 5000 is of bit type: eight digits 0 or 1 are expected, not 3"),
        ("N5074 A1P3", "of another series"),
        ("N5074 Q1L1P3", "of another series"),
        ("N5074", "one value P is expected"),
        ("N5074 P3\nX100.", "line 2: 'X100.' is no parameter"),
        ("", "holds no parameter"),
        ("%\n%\n", "holds no parameter"),
        ("5074 = ", "is no TOML"),
        ('5074 = "3"', "a whole number is expected"),
        ("5074 = true", "a whole number is expected"),
        ("5000 = 8", "eight digits in quotes"),
        ("5000 = { XYZ = 1 }", "0 or 1 for one of its bits is expected"),
        ("5000 = { ETX = 2 }", "0 or 1 for one of its bits is expected"),
        ("5074 = { A = 1 }", "none: it is a number"),
        ("protocol = 3", "protocol is no parameter"),
        ("parameters = 3", "`parameters` must be a table"),
        ("[parameters]\n", "holds no parameter"),
        ("5074 = 3\nN5074 = 1", "given twice"),
        ("N5074 P2 P3", "one value P is expected"),
        ("N5074 P2 N5073 P3", "is no parameter"),
        ("N5074 3", "line 1: '4 3': a letter is missing before the second number"),
        ("N5074 P1 2", "a letter is missing"),
        (f"5074 = {'9' * 5000}", "is no TOML: Exceeds the limit"),
        (f"5074 = {'[' * 3000}{']' * 3000}", "is no TOML: brackets within brackets"),
        ("5074 = 1979-05-27", "a whole number is expected"),
        ("5074 = [3]", "a whole number is expected"),
        ("5000 = { ETX = [1] }", "0 or 1 for one of its bits is expected"),
        ('"\\n" = 1', "is no parameter"),
        ("5074 = 1\n5074 = 2", "is no TOML"),
        ("[[[", "is no TOML"),
    ],
)
def test_what_is_wrong_is_named(text: str, complaint: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_parameters(text)
    assert complaint in str(caught.value)


@pytest.mark.parametrize("value", [10**9, 10**39, -(10**39)])
def test_a_huge_number_is_read_and_is_out_of_range(value: int) -> None:
    parameters = read_parameters(f"N5000 P1\nN5074 P{value}").parameters
    assert f"is {value}: 1 to 3 is expected" in str(check(parameters, parameters.interface)[0])
