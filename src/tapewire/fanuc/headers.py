"""Program numbers and comments, as a control finds them in what it reads (B-63322EN-1/01 8.2).

A tape holds `% ; O0001(SHAFT) ; ... M02 ; O0002 ; ... M30 ; %`: label skip until the first EOB, then programs, each
beginning with O and its number, or in ISO and ASCII with `:`, until EOR. A comment directly behind the number is the
program's name.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

__all__ = ["LONGEST_LIST", "HeaderReader", "ProgramHeader"]

LONGEST_LIST: Final = 1000
"""Programs listed; a control of the Series 15i registers no more."""

_HEADER: Final = re.compile(rb"[ \t]*[O:o][ \t]*(\d{1,8})[ \t]*(?:\(([^()\n]*)\))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramHeader:
    """`line` counts from 1 in the file; `comment` is None where there is none."""

    number: int
    comment: str | None
    line: int

    def __str__(self) -> str:
        return f"O{self.number:04d}" + (f" ({self.comment})" if self.comment is not None else "")


class HeaderReader:
    """Takes the lines of a text, each with its LF, and keeps the programs that begin in them."""

    def __init__(self) -> None:
        self.programs: list[ProgramHeader] = []
        self.label: str | None = None
        """What label skip passes over, without `%`; None until the first EOB."""
        self.eor_line: int | None = None
        self._line = 0

    def take(self, line: bytes) -> None:
        self._line += 1
        if self.eor_line is not None:
            return
        if self.label is None:
            self.label = line.rstrip(b"\n").lstrip(b"%").decode("ascii", "backslashreplace")
            return
        if b"%" in line:
            self.eor_line = self._line
            line = line[: line.index(b"%")]
        found = _HEADER.match(line)
        if found and len(self.programs) < LONGEST_LIST:
            comment = None if found[2] is None else found[2].decode("ascii", "backslashreplace")
            self.programs.append(ProgramHeader(number=int(found[1]), comment=comment, line=self._line))
