"""The text of an NC program: blocks one by one, and runs of plain moves as arrays.

A finishing program is nearly all blocks like `X1.234Y5.678Z-.9`. A run of them is recognised as a whole by one
expression and turned into numbers as a whole: ten times as fast as block by block, and with the same numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError

__all__ = ["PlainRuns", "ProgramText", "Run", "Words", "refusal_at"]

LONGEST_LINE: Final = 4096
Words: TypeAlias = list[tuple[str, str]]

_WORD: Final = re.compile(r"([A-Z])([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_WITHOUT_NUMBER: Final = re.compile(r"(?:[A-Z][-+]?[0-9]*\.?[0-9]*)+")
_COMMENT: Final = re.compile(r"\([^()]*\)")
_LF, _LETTERS = 10, 64
_TO_BLANKS: Final = bytes(0x20 if byte > _LETTERS else byte for byte in range(0x100))


class ProgramText:
    """Text that comes in pieces, cut anywhere, taken block by block. `line` is the number of the last one taken."""

    def __init__(self, pieces: Iterable[str]) -> None:
        self.line = 0
        self._pieces = iter(pieces)
        self._text = ""
        self._at = 0

    def block(self) -> tuple[str, Words] | None:
        """The next block that holds anything; None at the end: of the text, or a line that begins with a second %."""
        while (line := self._next_line()) is not None:
            self.line += 1
            if len(line) > LONGEST_LINE:
                raise self.refusal(f"is longer than {LONGEST_LINE:,} characters: this is no NC program")
            kept = line.strip()
            if kept.startswith("%") and self.line == 1:
                continue
            if kept.startswith("%"):
                return None
            if "%" in kept:
                raise self.refusal("holds %, which ends the data for the control (EOR), in a comment too: take it out")
            words = self._words(kept.upper())
            if words:
                return kept, words
        return None

    def run(self, pattern: re.Pattern[str]) -> str:
        """What `pattern` matches from here on: whole lines, not taken yet."""
        found = pattern.match(self._text, self._at)
        return "" if found is None else found[0]

    def take(self, run: str, lines: int) -> None:
        self._at += len(run)
        self.line += lines

    def refusal(self, why: str) -> ProgramError:
        return refusal_at(self.line, why)

    def _next_line(self) -> str | None:
        end = self._text.find("\n", self._at)
        while end < 0:
            rest = self._text[self._at :]
            if len(rest) > LONGEST_LINE:
                self._text, self._at = "", 0
                return rest
            piece = next(self._pieces, None)
            self._text, self._at = rest + (piece or ""), 0
            if piece is None:
                self._text = ""
                return rest or None
            end = self._text.find("\n", len(rest))
        line = self._text[self._at : end]
        self._at = end + 1
        return line

    def _words(self, text: str) -> Words:
        if "(" in text:
            text = _COMMENT.sub("", text)
        text = text.replace(" ", "").replace("\t", "").rstrip(";")
        words = _WORD.findall(text)
        if sum(len(letter) + len(value) for letter, value in words) != len(text):
            if text.startswith("/"):
                raise self.refusal("has a block skip: say by editing whether the block is to be executed")
            if _WITHOUT_NUMBER.fullmatch(text):
                raise self.refusal("has a letter without a number")
            raise self.refusal("holds something that is no word of an NC block")
        return words


def refusal_at(line: int, why: str) -> ProgramError:
    return ProgramError(f"line {line}: {why}", line=line)


@dataclass(frozen=True, slots=True)
class Run:
    """Plain moves: by line the motion (0 or 1), the lengths (lines, axes), and the feed. All but `said` are carried on
    from the line before where the block does not say them, NaN where none has.
    """

    motions: NDArray[np.float64]
    said: NDArray[np.float64]
    """The lengths as the blocks say them, NaN where they do not."""
    carried: NDArray[np.float64]
    feeds: NDArray[np.float64]
    feed_word: str
    """The last F, empty where there is none."""


class PlainRuns:
    """Runs of blocks that are nothing but `N1G01X1.Y2.Z3.F100`, in this order, each word or none of it, all lengths
    with a decimal point. Everything else is for whoever reads block by block.
    """

    def __init__(self, axes: tuple[str, ...]) -> None:
        length = r"[-+]?+(?:[0-9]{1,12}+\.[0-9]{0,12}+|\.[0-9]{1,12}+)"
        moves = f"(?:[{''.join(axes)}]{length} ?+){{1,{len(axes)}}}+"
        feed = r"(?:F[0-9]{1,8}+(?:\.[0-9]{0,8}+)?+ ?+)?+"
        self.pattern = re.compile(rf"(?:(?:N[0-9]{{1,8}}+ ?+)?+(?:G0?[01] ?+)?+{moves}{feed}\r?\n)*+")
        """Possessive throughout: nothing is tried twice, however long the run."""
        self._count = 3 + len(axes)
        self._column = np.zeros(0x100, np.intp)
        for index, letter in enumerate(("N", "G", *axes, "F")):
            self._column[ord(letter)] = index

    def read(self, run: str, before: list[float]) -> Run:
        """`before` is the motion, the places and the feed, in one row, that hold in front of the run; NaN for none."""
        data = run.encode("ascii")
        numbers = np.fromstring(data.translate(_TO_BLANKS), np.float64, sep=" ")
        characters = np.frombuffer(data, np.uint8)
        marks = characters[(characters > _LETTERS) | (characters == _LF)]
        ends = marks == _LF
        lines = np.cumsum(ends)
        table = np.full((int(lines[-1]) + 1, self._count), np.nan)
        table[0, 1:] = before
        table[lines[~ends] + 1, self._column[marks[~ends]]] = numbers
        carried = np.empty((len(table) - 1, self._count - 1))
        rows = np.arange(len(table))
        for index in range(1, self._count):
            column = table[:, index]
            said = np.maximum.accumulate(np.where(np.isnan(column), 0, rows))
            carried[:, index - 1] = column[said][1:]
        at = run.rfind("F") + 1
        word = re.match("[0-9.]+", run[at : at + 20]) if at else None
        return Run(carried[:, 0], table[1:, 2:-1], carried[:, 1:-1], carried[:, -1], word[0] if word else "")
