"""Tables of positions and paths as CSV and npz, read and written in pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.g05.limits import Floats

__all__ = ["Table", "read_csv", "read_npz"]

ROWS: Final = 16_384
LONGEST_LINE: Final = 10_000


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of numbers in pieces of shape (rows, columns), and the names of the columns, empty where there are none."""

    names: tuple[str, ...]
    pieces: Iterator[Floats]


def read_csv(file: IO[bytes], name: str) -> Table:
    """Numbers separated by commas; a first line that is none names the columns. Raises ProgramError with the line."""
    lines = _lines(file, name)
    first = next(lines, "")
    words = tuple(word.strip() for word in first.split(","))
    if not first.strip():
        raise ProgramError(f"{name}: is empty, or begins with an empty line")
    has_names = not all(_is_number(word) for word in words)
    rest = lines if has_names else chain([first], lines)
    return Table(words if has_names else (), _pieces(rest, len(words), name, 2 if has_names else 1))


def _lines(file: IO[bytes], name: str) -> Iterator[str]:
    number = 0
    while line := file.readline(LONGEST_LINE):
        number += 1
        if len(line) == LONGEST_LINE:
            raise ProgramError(f"{name}, line {number}: is longer than {LONGEST_LINE:,} characters: this is no table")
        try:
            yield line.decode("utf-8-sig" if number == 1 else "utf-8")
        except UnicodeDecodeError:
            why = "is no text; a table is numbers separated by commas"
            raise ProgramError(f"{name}, line {number}: {why}", line=number) from None


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _pieces(lines: Iterator[str], columns: int, name: str, number: int) -> Iterator[Floats]:
    while True:
        taken = list(islice(lines, ROWS))
        if not taken:
            return
        try:
            piece = np.loadtxt(taken, delimiter=",", ndmin=2, comments=None)
        except ValueError:
            raise _refusal(taken, columns, name, number) from None
        if piece.shape[1] != columns or not np.isfinite(piece).all() or len(piece) != len(taken):
            raise _refusal(taken, columns, name, number)
        yield piece
        number += len(taken)


def _refusal(lines: Sequence[str], columns: int, name: str, number: int) -> ProgramError:
    """Which line it is: looked for one by one, now that there is time."""
    for index, line in enumerate(lines):
        words = line.split(",")
        sound = len(words) == columns and all(_is_number(word) and np.isfinite(float(word)) for word in words)
        if not sound:
            shown = line.strip()[:60]
            return ProgramError(
                f"{name}, line {number + index}: {shown!r} is not {columns} finite numbers", line=number + index
            )
    return ProgramError(f"{name}: lines {number} to {number + len(lines) - 1} are not {columns} numbers each")


def read_npz(file: IO[bytes], name: str, key: str) -> dict[str, NDArray[np.float64]]:
    """The arrays of an npz file, none of them pickled; `key` must be among them. Raises ProgramError."""
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {word: np.asarray(archive[word], np.float64) for word in archive.files if word in (key, "feed")}
    except (ValueError, OSError, KeyError, EOFError, TypeError, MemoryError) as error:
        raise ProgramError(f"{name}: cannot be read as npz ({error})") from None
    except Exception as error:  # zipfile has its own errors, and numpy hands them on
        raise ProgramError(f"{name}: cannot be read as npz ({type(error).__name__})") from None
    if key not in arrays or arrays[key].ndim != 2:
        raise ProgramError(f"{name}: an array {key!r} of shape (rows, axes) is expected in it")
    return arrays
