"""NC programs of straight moves and arcs, as the planner of binary input operation takes them.

    G00 G01 G02 G03   G17 G18 G19   G20 G21   G90 G91   X Y Z ..., I J K R, F, N

What stands before the first move whose place is known, and from the first block on that does anything but move, stays
text: it is executed as before, behind a block that says again what is modal by then. Only a few moves may stand there,
the way home: between the moves there is no room for text in binary input operation. Whatever is not understood is
refused with its line, and nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from tapewire.errors import ProgramError
from tapewire.g05.modes import ModalWatch
from tapewire.g05.path import Moves
from tapewire.g05.sections import find_g05
from tapewire.nc.arcs import Arc, chords

__all__ = ["NcReader", "Reading"]

MOST_KEPT_BLOCKS: Final = 10_000
"""Of a header or a trailer: no program has more before its first or behind its last move."""
MOST_MOVES_HOME: Final = 20
"""Moves behind the first block of other text: more are no way home, but a program that needs text among its moves."""
MOVES_AT_A_TIME: Final = 8_192
MM_PER_INCH: Final = 25.4

_WORD: Final = re.compile(r"([A-Z])([-+]?[0-9]*\.?[0-9]*)")
_COMMENT: Final = re.compile(r"\([^()]*\)")
_PLACE_LOST: Final = frozenset((10.0, 27.0, 28.0, 29.0, 30.0, 52.0, 53.0, 92.1))
"""G codes after which the axes are where this program does not say."""
_WITHOUT_MOTION: Final = frozenset((9, 17, 18, 19, 20, 21, 40, 61, 64, 69, 80, 90, 91, 94))
_WORK_COORDINATES: Final = frozenset((54.0, 55.0, 56.0, 57.0, 58.0, 59.0))
_FEED_OF_OTHER_KIND: Final = {93.0: "G93, inverse time", 95.0: "G95, per revolution"}

_Words: TypeAlias = list[tuple[str, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """How a program is read: the addresses of the axes in their order, and where they stand before, if that is known.

    `chord_error` is how far a chord may be from its arc. `decimals` are those of the increment system in millimetres: a
    number without a point counts increments. `inch_machine` says what the units of the machine are, `rotary` which of
    the axes are in degrees.
    """

    axes: tuple[str, ...]
    start: tuple[float, ...] | None = None
    chord_error: float = 0.001
    decimals: int = 3
    inch_machine: bool = False
    rotary: frozenset[str] = frozenset()


class NcReader:
    """Reads a program once. `header` and `start` are there from the beginning, `trailer` when `moves` has ended.

    Raises ProgramError with the line, at once or from `moves`.
    """

    def __init__(self, lines: Iterable[str], reading: Reading) -> None:
        self._reading = reading
        self._lines = iter(lines)
        self._number = 0
        self._place: dict[str, float | None] = dict.fromkeys(reading.axes)
        if reading.start is not None:
            self._place.update(zip(reading.axes, reading.start, strict=True))
        self._motion: float | None = None
        self._plane, self._incremental, self._inch = 17, False, False
        self._feed: float | None = None
        self._feed_word = ""
        self._feed_kind = 94.0
        self._work_coordinate: float | None = None
        self._moves_home = 0
        self._modes = ModalWatch()
        self.header: list[str] = []
        self.trailer: list[str] = []
        self._trailer_line = 0
        self._first: tuple[str, _Words] | None = self._read_header()
        self.start = tuple(value for value in self._place.values() if value is not None)

    def moves(self) -> Iterator[Moves]:
        """The moves in pieces, straight ones; arcs are chords."""
        ends: list[tuple[float, ...]] = []
        speeds: list[float] = []
        block = self._first
        while block is not None:
            self._take(*block, ends, speeds)
            if len(ends) >= MOVES_AT_A_TIME:
                yield _moves(ends, speeds)
                ends, speeds = [], []
            block = self._next()
        if ends:
            yield _moves(ends, speeds)

    # lines

    def _next(self) -> tuple[str, _Words] | None:
        """The next block that holds anything; None at the end, which is the second % or that of the file."""
        for line in self._lines:
            self._number += 1
            if len(line) > 4096:
                raise self._refusal("is longer than 4,096 characters: this is no NC program")
            text = line.strip()
            if text.startswith("%") and self._number == 1:
                continue
            if "%" in text:
                return None
            kept, text = text, text.upper()
            if "(" in text:
                text = _COMMENT.sub("", text)
            text = text.replace(" ", "").rstrip(";")
            if not text:
                continue
            words = _WORD.findall(text)
            if sum(len(letter) + len(value) for letter, value in words) != len(text):
                if text.startswith("/"):
                    raise self._refusal("has a block skip: say by editing whether the block is to be executed")
                raise self._refusal("holds something that is no word of an NC block")
            return kept, words
        return None

    def _read_header(self) -> tuple[str, _Words] | None:
        """Blocks up to the first move from a place that is known; that one is returned."""
        while (block := self._next()) is not None:
            kept, words = block
            if None not in self._place.values() and self._is_plain_move(words):
                if self._modes.forbidden:
                    modes = ", ".join(self._modes.forbidden)
                    raise self._refusal(f"would be binary input operation while {modes} is on: an alarm (9.3)")
                if self._feed_kind in _FEED_OF_OTHER_KIND:
                    kind = _FEED_OF_OTHER_KIND[self._feed_kind]
                    raise self._refusal(f"moves while the feed is that of {kind}: only feed per minute (G94) is read")
                return block
            self._keep(self.header, kept)
            self._modes.feed(kept.encode("utf-8", "replace"))
            self._follow(words)
        missing = ", ".join(axis for axis, value in self._place.items() if value is None)
        why = f"it never says where {missing} is; say so with --start" if missing else "it holds no move"
        raise ProgramError(f"the program cannot be turned into binary input operation: {why}")

    def _keep(self, blocks: list[str], kept: str) -> None:
        if len(blocks) >= MOST_KEPT_BLOCKS:
            raise self._refusal(f"is the block number {MOST_KEPT_BLOCKS + 1:,} without a move of known place")
        if find_g05(kept.encode("latin-1", "replace")) is not None:
            raise self._refusal("is G05 already: take it out, or decode the section that follows")
        blocks.append(kept)

    def _is_plain_move(self, words: _Words) -> bool:
        codes = [self._value(value) for letter, value in words if letter == "G"]
        others = any(letter not in "GNFIJKR" and letter not in self._place for letter, _ in words)
        moves = any(letter in self._place for letter, _ in words)
        motion = next((code for code in codes if code in (0, 1, 2, 3)), self._motion)
        known = all(code in (0, 1, 2, 3) or code in _WITHOUT_MOTION for code in codes)
        return moves and motion is not None and known and not others

    def _follow(self, words: _Words) -> None:
        """What a block of the header does to the modes and to the place, as far as it says so."""
        codes = {self._value(value) for letter, value in words if letter == "G"}
        for code in codes:
            self._modal(code)
        if codes & _PLACE_LOST:
            self._place = dict.fromkeys(self._place)
            return
        self._change_coordinates(codes)
        for letter, value in words:
            if letter == "F":
                self._set_feed(value)
            if letter in self._place:
                here = self._place[letter]
                length = self._length(letter, value)
                if not self._incremental:
                    self._place[letter] = length
                elif here is not None:
                    self._place[letter] = here + length

    def _change_coordinates(self, codes: set[float]) -> None:
        """Of a block of the header: in another work coordinate system the numbers of before mean other places."""
        for code in codes & _WORK_COORDINATES:
            if self._work_coordinate not in (None, code):
                self._place = dict.fromkeys(self._place)
            self._work_coordinate = code
        for code in codes & {93.0, 94.0, 95.0}:
            self._feed_kind = code

    # blocks among the moves

    def _take(self, kept: str, words: _Words, ends: list[tuple[float, ...]], speeds: list[float]) -> None:
        targets: dict[str, str] = {}
        arc: dict[str, str] = {}
        is_text = False
        for letter, value in words:
            if letter in self._place:
                targets[letter] = value
            elif letter in "IJKR":
                arc[letter] = value
            elif letter == "G":
                is_text = not self._modal(self._value(value)) or is_text
            elif letter == "F":
                self._set_feed(value)
            elif letter != "N":
                is_text = True
        moves = bool(targets or arc)
        if self._trailer_line or is_text:
            self._leave(kept, plain_move=moves and not is_text)
        elif moves:
            self._move(targets, arc, ends, speeds)

    def _leave(self, kept: str, *, plain_move: bool) -> None:
        """From here on it is text."""
        if not self._trailer_line:
            self._trailer_line = self._number
            self._keep(self.trailer, self._modal_words())
        self._keep(self.trailer, kept)
        self._moves_home += plain_move
        if self._moves_home > MOST_MOVES_HOME:
            raise self._refusal_at(
                self._trailer_line,
                f"{self.trailer[1]!r} is more than a move, and over {MOST_MOVES_HOME} moves follow: in binary input "
                "operation there is nothing but motion; put it elsewhere, or plan the parts one by one",
            )

    def _modal_words(self) -> str:
        """What the control does not know by itself when binary input operation ends: it has seen none of the moves."""
        if self._motion in (2.0, 3.0):
            raise self._refusal("follows an arc without a straight move between: say G00 or G01 before it")
        words = (
            f"G{int(self._motion or 0):02d}G{self._plane}G{20 if self._inch else 21}G{91 if self._incremental else 90}"
        )
        return words + (f"F{self._feed_word}" if self._feed_word else "")

    def _modal(self, code: float) -> bool:
        """False for a code that is none of the moves'."""
        if code in (0.0, 1.0, 2.0, 3.0):
            self._motion = code
        elif code in (17.0, 18.0, 19.0):
            self._plane = int(code)
        elif code in (20.0, 21.0):
            self._inch = code == 20.0
        elif code in (90.0, 91.0):
            self._incremental = code == 91.0
        else:
            return code in _WITHOUT_MOTION
        return True

    def _move(
        self, targets: dict[str, str], arc: dict[str, str], ends: list[tuple[float, ...]], speeds: list[float]
    ) -> None:
        if arc and self._motion in (0.0, 1.0):
            raise self._refusal(f"has {', '.join(sorted(arc))} in a straight move: that belongs to G02 and G03")
        place = self._place
        before = tuple(place.values()) if self._motion in (2.0, 3.0) else ()
        for axis, value in targets.items():
            length = self._length(axis, value)
            place[axis] = place[axis] + length if self._incremental else length  # type: ignore[operator]
        if self._motion == 0.0:
            speeds.append(np.inf)
            ends.append(tuple(place.values()))  # type: ignore[arg-type]
            return
        if self._motion is None:
            raise self._refusal("moves before any of G00, G01, G02 and G03")
        if self._feed is None:
            raise self._refusal("moves at a feed that no F has given")
        if self._motion == 1.0:
            speeds.append(self._feed)
            ends.append(tuple(place.values()))  # type: ignore[arg-type]
            return
        self._arc(before, arc, ends, speeds)

    def _arc(
        self,
        before: tuple[float | None, ...],
        words: dict[str, str],
        ends: list[tuple[float, ...]],
        speeds: list[float],
    ) -> None:
        assert self._feed is not None
        arc = Arc(
            clockwise=self._motion == 2.0,
            plane=self._plane,
            offsets={letter: self._length(letter, value) for letter, value in words.items()},
        )
        try:
            made, longer = chords(
                arc,
                dict(zip(self._place, (value or 0.0 for value in before), strict=True)),
                {axis: value or 0.0 for axis, value in self._place.items()},
                self._reading.chord_error,
            )
        except ProgramError as error:
            raise self._refusal(str(error)) from None
        ends.extend(made)
        speeds.extend([self._feed * longer] * len(made))

    # numbers

    def _value(self, text: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise self._refusal("has a letter without a number") from None

    def _length(self, letter: str, text: str) -> float:
        """In units of the machine. Without a point it counts increments."""
        value = self._value(text)
        rotary = letter in self._reading.rotary
        if "." not in text:
            value /= 10.0 ** (self._reading.decimals + (self._inch and not rotary))
        return value if rotary else value * self._scale

    @property
    def _scale(self) -> float:
        if self._inch == self._reading.inch_machine:
            return 1.0
        return MM_PER_INCH if self._inch else 1 / MM_PER_INCH

    def _set_feed(self, text: str) -> None:
        feed = self._value(text) * self._scale / 60
        if not feed > 0:
            raise self._refusal(f"has the feed F{text}: it is above 0")
        self._feed, self._feed_word = feed, text

    def _refusal(self, why: str) -> ProgramError:
        return self._refusal_at(self._number, why)

    @staticmethod
    def _refusal_at(line: int, why: str) -> ProgramError:
        return ProgramError(f"line {line}: {why}", line=line)


def _moves(ends: list[tuple[float, ...]], speeds: list[float]) -> Moves:
    return Moves(ends=np.array(ends, np.float64), speeds=np.array(speeds, np.float64))
