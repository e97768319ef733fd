"""A folder of programs by number, for controls that ask for a program by its number and save under one.

The number of a file is its name without its extension: one to six digits, after an O or a P if there is one, and
leading zeros do not count. `1234.nc`, `O1234` and `P01234.txt` are all program 1234. Other files are not programs.
Numbers are looked up among the names that are there; what a control sent never becomes part of a path but as digits.
"""

from __future__ import annotations

import itertools
import os
import re
from pathlib import Path
from typing import Final, TypeAlias

from tapewire.errors import UsageError

__all__ = ["ProgramFolder", "Signature", "signature_of"]

Signature: TypeAlias = tuple[int, int, int]
"""Which file it is, how long, and when it was written last: another when it was changed."""

_NUMBERED: Final = re.compile(r"[OoPp]?([0-9]{1,6})")

SUFFIX: Final = ".nc"


class ProgramFolder:
    """The programs in `path`. Raises UsageError when it cannot be read, or when two files have one number."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.signatures()

    def find(self, number: str) -> Path | None:
        """The file of program `number` as the folder is now; None where there is none. Raises UsageError."""
        assert _is_number(number), number
        return self._only(self._files().get(int(number), []))

    def signatures(self) -> dict[Path, Signature]:
        """Of every program as the folder is now. Raises UsageError."""
        only = (self._only(paths) for paths in self._files().values())
        return {path: signature_of(path) for path in only if path is not None}

    def place_for(self, number: str | None, *, force: bool) -> Path:
        """Where a program that the control sends as `number` is stored: nothing that is there, unless `force`.

        Beside a program of the same number stands `1234.received-1.nc`, which is no program by number itself.
        """
        if number is None:
            return self._first_free("unnamed")
        taken = self.find(number)
        if taken is None:
            return self.path / f"{number}{SUFFIX}"
        return taken if force else self._first_free(f"{number}.received")

    def _first_free(self, stem: str) -> Path:
        candidates = (self.path / f"{stem}-{count}{SUFFIX}" for count in itertools.count(1))
        return next(path for path in candidates if not os.path.lexists(path))

    def _only(self, paths: list[Path]) -> Path | None:
        if len(paths) > 1:
            number = int(_numbered(paths[0]) or 0)
            raise UsageError(f"{paths[0].name} and {paths[1].name} in {self.path} are both program {number}")
        return paths[0] if paths else None

    def _files(self) -> dict[int, list[Path]]:
        found: dict[int, list[Path]] = {}
        try:
            paths = sorted(entry for entry in self.path.iterdir() if entry.is_file())
        except OSError as error:
            raise UsageError(f"{self.path}: cannot be read as a folder of programs ({error.strerror})") from None
        for path in paths:
            number = _numbered(path)
            if number is not None:
                found.setdefault(int(number), []).append(path)
        return found


def _numbered(path: Path) -> str | None:
    """The number in the name of `path`; None where that is no program's."""
    named = _NUMBERED.fullmatch(path.stem)
    return None if named is None or path.name.startswith(".") else named[1]


def signature_of(path: Path) -> Signature:
    """Raises UsageError where it cannot be seen."""
    try:
        status = path.stat()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    return status.st_ino, status.st_size, status.st_mtime_ns


def _is_number(number: str) -> bool:
    return number.isascii() and number.isdigit() and len(number) <= 6
