"""Tables of positions and paths as CSV and npz, read and written in pieces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import IO, TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.g05.limits import Floats

if TYPE_CHECKING:
    from zipfile import ZipFile

__all__ = ["Table", "read_csv", "read_npz"]

ROWS: Final = 16_384
LONGEST_LINE: Final = 10_000
MOST_ARRAY_BYTES: Final = 1 << 30
"""Of one array of an npz file: 44 million positions of three axes."""


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
    """The arrays `key` and, if it is there, 'feed' of an npz file; nothing pickled. Raises ProgramError.

    What an array would take in memory is known, and refused, before any of it is unpacked.
    """
    import zipfile

    try:
        with zipfile.ZipFile(file) as archive:
            there = set(archive.namelist()) & {f"{key}.npy", "feed.npy"}
            arrays = {member.removesuffix(".npy"): _array(archive, member, name) for member in there}
    except ProgramError:
        raise
    except Exception as error:  # a damaged archive makes zipfile, zlib and numpy raise nearly anything
        why = str(error) or type(error).__name__
        raise ProgramError(f"{name}: cannot be read as npz ({why[:200]})") from None
    if key not in arrays or arrays[key].ndim != 2:
        raise ProgramError(f"{name}: an array {key!r} of shape (rows, axes) is expected in it")
    return arrays


_HEADERS: Final = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def _array(archive: ZipFile, member: str, name: str) -> NDArray[np.float64]:
    with archive.open(member) as packed:
        version = np.lib.format.read_magic(packed)
        if version not in _HEADERS:
            raise ProgramError(f"{name}: {member} is in version {version} of the format: 1.0 and 2.0 are read")
        shape, _, dtype = _HEADERS[version](packed)
    if dtype.kind not in "iuf":
        raise ProgramError(f"{name}: {member} holds {str(dtype)[:60]} and no numbers")
    if math.prod(shape) * 8 > MOST_ARRAY_BYTES:
        raise ProgramError(
            f"{name}: {member} is of shape {str(shape)[:60]}, more than {MOST_ARRAY_BYTES >> 30} GiB in memory: write "
            "it as CSV, which is read in pieces"
        )
    with archive.open(member) as packed:
        array: NDArray[np.float64] = np.lib.format.read_array(packed, allow_pickle=False).astype(np.float64, copy=False)
    return array
