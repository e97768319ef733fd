"""Parameter files: as a control punches them (`N5074 P3`, bits `N5000 P00001000`), and TOML.

A machine's whole parameter punch may be read: numbers that are not in chapter 10 of B-63322EN-1/01 are counted and
left alone. What is written holds the parameters of chapter 10 and nothing else.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from tapewire.errors import UsageError
from tapewire.fanuc.parameters import CATALOGUE, ParameterSet

__all__ = [
    "LONGEST_FILE_BYTES",
    "ParameterFile",
    "read_parameters",
    "value_of",
    "word_of",
    "write_punch",
    "write_toml",
]

LONGEST_FILE_BYTES: Final = 8 << 20
"""The largest control has some ten thousand parameters for each of 24 axes; a file beyond this is none of them."""

_BLOCK: Final = re.compile(r"N(?P<number>\d{1,6})(?P<rest>[^N]*)\Z", re.I)
_VALUE: Final = re.compile(r"P(?P<value>[+-]?\d{1,40})\Z", re.I)
_TORN: Final = re.compile(r"\d[ \t]+\d")
_COMMENT: Final = re.compile(r"\([^()\n]*\)")
_BITS: Final = re.compile(r"[01]{1,8}\Z")
_NO_PARAMETER: Final = re.compile(r"(%.*|[O:]\d+.*|G10.*|G11|M\d+|)\Z", re.I)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterFile:
    """What a file says of the parameters of chapter 10; `others` counts the numbers beside them."""

    parameters: ParameterSet
    others: int = 0


def read_parameters(text: str) -> ParameterFile:
    """A parameter file in either form. Raises UsageError at the first line that cannot be one.

    TOML is known by a line `NAME = VALUE` before any other; a punch has no equals sign outside comments.
    """
    bare = _COMMENT.sub("", text)
    first = next((line for line in map(str.strip, bare.splitlines()) if line and not line.startswith("#")), "")
    return _read_toml(text) if "=" in first or first.startswith("[") else _read_punch(bare)


def _read_punch(text: str) -> ParameterFile:
    values: dict[int, int] = {}
    others = 0
    for where, block in _blocks(text):
        found = _BLOCK.match(block)
        if found is None:
            if not _NO_PARAMETER.match(block):
                raise UsageError(f"{where}: {block[:40]!r} is no parameter: N5074 P3 is expected")
            continue
        number = int(found["number"])
        if number not in CATALOGUE:
            others += 1
            continue
        _put(values, number, _punched_value(where, number, found["rest"]), where)
    if not values and not others:
        raise UsageError("the file holds no parameter: lines such as N5074 P3 are expected")
    return ParameterFile(parameters=ParameterSet(values), others=others)


def _blocks(text: str) -> Iterator[tuple[str, str]]:
    """Every block without blanks, and which line it is on. On one line `;` ends a block too.

    Digits with a blank between them are two words, of which one lost its letter: `N5074 3` is not No. 50743.
    """
    for line_number, line in enumerate(text.splitlines(), start=1):
        for part in line.split(";"):
            if torn := _TORN.search(part):
                raise UsageError(f"line {line_number}: {torn[0]!r}: a letter is missing before the second number")
            block = "".join(character for character in part if not character.isspace() and character != "\x00")
            yield f"line {line_number}", block


def _punched_value(where: str, number: int, rest: str) -> int:
    found = _VALUE.match(rest)
    if found is None:
        raise UsageError(
            f"{where}: N{number:04d} {rest[:40]}: one value P is expected. A control that punches other addresses here "
            "is of another series, where this number means something else"
        )
    return _value(where, number, found["value"])


def value_of(number: int, word: str) -> int:
    """The value of `word` as it is punched or typed, digits with a sign. Raises UsageError for what is no bits."""
    if not CATALOGUE[number].is_bits:
        return int(word)
    if not _BITS.match(word):
        raise UsageError(f"No. {number:04d} is of bit type: eight digits 0 or 1 are expected, not {word}")
    return int(word, 2)


def _value(where: str, number: int, word: str) -> int:
    try:
        return value_of(number, word)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None


def _put(values: dict[int, int], number: int, value: int, where: str) -> None:
    if values.get(number, value) != value:
        raise UsageError(f"{where}: No. {number:04d} is given twice, with two values: say which one is meant")
    values[number] = value


def _read_toml(text: str) -> ParameterFile:
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise UsageError("the parameter file is no TOML: brackets within brackets without end") from None
    except ValueError as error:
        # A number of thousands of digits is an error of Python's own, and no TOMLDecodeError.
        raise UsageError(f"the parameter file is no TOML: {str(error).partition(';')[0]}") from None
    table = document.get("parameters", document)
    if not isinstance(table, dict):
        raise UsageError("`parameters` must be a table, as in [parameters]")
    values: dict[int, int] = {}
    others = 0
    for key, value in table.items():
        name = key[1:] if key[:1] in ("N", "n") else key
        if not name.isascii() or not name.isdigit() or len(name) > 6:
            raise UsageError(f"{key} is no parameter: a number is expected, as in 5074 = 3")
        if int(name) in CATALOGUE:
            _put(values, int(name), _toml_value(key, int(name), value), key)
        else:
            others += 1
    if not values and not others:
        raise UsageError("the file holds no parameter: lines such as 5074 = 3 are expected")
    return ParameterFile(parameters=ParameterSet(values), others=others)


def _toml_value(key: str, number: int, value: object) -> int:
    match value:
        case bool():
            pass
        case dict():
            return _named_bits(key, number, value)
        case str() if CATALOGUE[number].is_bits:
            return _value(key, number, value)
        case int() if not CATALOGUE[number].is_bits:
            return value
    kind = 'eight digits in quotes, as in 5000 = "00001000"' if CATALOGUE[number].is_bits else "a whole number"
    raise UsageError(f"{key} = {value!r}: {kind} is expected")


def _named_bits(key: str, number: int, names: Mapping[object, object]) -> int:
    """`5000 = { ETX = 1 }`; bits that are not named are 0."""
    positions = {bit.name: bit.position for bit in CATALOGUE[number].bits}
    byte = 0
    for name, value in names.items():
        if name not in positions or isinstance(value, bool) or value not in (0, 1):
            known = ", ".join(positions) or "none: it is a number"
            raise UsageError(f"{key}: {name} = {value!r}: 0 or 1 for one of its bits is expected ({known})")
        byte |= int(value == 1) << positions[str(name)]
    return byte


def write_punch(parameters: ParameterSet) -> str:
    """As a control punches them: between `%`, one block a line."""
    blocks = [f"N{number:04d} P{word_of(number, value)}" for number, value in sorted(parameters.values.items())]
    return "\n".join(("%", *blocks, "%")) + "\n"


def write_toml(parameters: ParameterSet) -> str:
    """With what each value means beside it."""
    lines = ["[parameters]"]
    for number, value in sorted(parameters.values.items()):
        record = CATALOGUE[number]
        word = f'"{word_of(number, value)}"' if record.is_bits else str(value)
        meaning = record.values.get(value)
        lines.append(f"{number:04d} = {word}  # {record.title}{f': {meaning}' if meaning else ''}")
    return "\n".join(lines) + "\n"


def word_of(number: int, value: int) -> str:
    """As it is punched: bits as eight digits."""
    return f"{value:08b}" if CATALOGUE[number].is_bits else str(value)
