"""NC programs of straight moves and arcs, as the planner of binary input operation takes them.

    G00 G01 G02 G03   G17 G18 G19   G20 G21   G90 G91   X Y Z ..., I J K R, F, N

What stands before the first move whose place is known, and from the first block on that does anything but move, stays
text: it is executed as before, behind a block that says again what is modal by then. Only a few moves may stand there,
the way home: between the moves there is no room for text in binary input operation. Whatever is not understood is
refused with its line, and nothing is guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from tapewire.errors import ProgramError
from tapewire.g05.modes import ModalWatch
from tapewire.g05.path import Moves
from tapewire.g05.sections import find_g05, find_g05_with_point
from tapewire.nc.arcs import RADIUS_ERROR_MM, Arc, chords
from tapewire.nc.modal import MODES, Modal, Places, is_plain
from tapewire.nc.text import PlainRuns, ProgramText, Words, refusal_at

__all__ = ["NcReader", "Reading"]

MOST_KEPT_BLOCKS: Final = 10_000
"""Of a header or a trailer: no program has more before its first or behind its last move."""
MOST_MOVES_HOME: Final = 20
"""Moves behind the first block of other text: more are no way home, but a program that needs text among its moves."""
MOVES_AT_A_TIME: Final = 8_192
SHORTEST_RUN: Final = 16
"""Blocks; fewer are as fast one by one."""
MM_PER_INCH: Final = 25.4
_WHOLE_FEED: Final = re.compile(r"F[0-9]++[^0-9.]")


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
    """Reads a program once, from its text in pieces cut anywhere.

    `header` and `start` are there from the beginning, `trailer` when `moves` has ended. Raises ProgramError with the
    line, at once or from `moves`.
    """

    def __init__(self, text: Iterable[str], reading: Reading) -> None:
        self._reading = reading
        self._text = ProgramText(text)
        self._runs = PlainRuns(reading.axes)
        self._one_by_one = 0
        """Up to this line a run has been looked for, and was too short or not plain enough."""
        self._modal = Modal()
        self._moves_home = 0
        self.header: list[str] = []
        self.trailer: list[str] = []
        self._trailer_line = 0
        known = Places(reading.axes, reading.start)
        self._place = known.at
        self._first: tuple[str, Words] | None = self._read_header(known)
        self._place = known.at
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
            run = self._plain_run()
            if run is not None:
                if ends:
                    yield _moves(ends, speeds)
                    ends, speeds = [], []
                yield run
            block = self._text.block()
        if ends:
            yield _moves(ends, speeds)

    # the header

    def _read_header(self, places: Places) -> tuple[str, Words] | None:
        """Blocks up to the first move from a place that is known; that one is returned."""
        modes, modal = ModalWatch(), self._modal
        displaced: ProgramError | None = None
        while (block := self._text.block()) is not None:
            kept, words = block
            if not places.unknown and self._is_plain_move(words):
                self._refuse_modes(modes, places, words)
                return block
            if (modes.displacing or places.elsewhere) and displaced is None and self._is_plain_move(words):
                displaced = self._forbidden(modes) if modes.displacing else self._elsewhere(places)
            self._keep(self.header, kept)
            going = places.follow(kept, words, modal, modes, self._text.line)
            for letter, value in words:
                if letter == "F" and not modal.other_feed:
                    self._set_feed(value)
            self._go(places, going, absolute=Places.presets(words))
        if displaced is not None and (modes.displacing or places.elsewhere):
            raise displaced
        missing = ", ".join(places.unknown)
        why = "it holds no move"
        if missing and places.lost_by:
            why = (
                f"behind {places.lost_by} it never says where {missing} is: what that block leaves behind is not known "
                "here; let an absolute move of each axis follow it"
            )
        elif missing:
            why = f"it never says where {missing} is; say so with --start"
        raise ProgramError(f"the program cannot be turned into binary input operation: {why}")

    def _refuse_modes(self, modes: ModalWatch, places: Places, words: Words) -> None:
        """Of the first move: it must be a plain one at the control too."""
        if modes.forbidden:
            raise self._forbidden(modes)
        if places.macro:
            raise self._text.refusal(f"moves while {places.macro!r} calls a macro with every move: G67 ends that")
        if self._modal.other_feed:
            raise self._text.refusal(
                f"moves while the feed is that of {self._modal.other_feed}: only feed per minute (G94) is read"
            )
        said = Modal(unsaid=dict(self._modal.unsaid))
        for letter, value in words:
            if letter == "G":
                said.take(float(value))
                said.take_feed_kind(float(value))
        for mode, line in said.unsaid.items():
            if mode != "plane":
                raise self._text.refusal(
                    f"moves, and the subprogram called in line {line} may have changed {MODES[mode]}: say it again "
                    "behind the call"
                )

    def _forbidden(self, modes: ModalWatch) -> ProgramError:
        named = ", ".join(modes.forbidden)
        return self._text.refusal(f"would be binary input operation while {named} is on: an alarm (9.3)")

    def _elsewhere(self, places: Places) -> ProgramError:
        named = ", ".join(places.elsewhere)
        return self._text.refusal(f"moves while {named} is on: its numbers are not where the axes go")

    def _go(self, places: Places, going: Words, *, absolute: bool) -> None:
        unsaid = self._modal.unsaid
        for axis, value in going:
            here, length = places.at[axis], self._length(axis, value)
            if "units" in unsaid or ("distance" in unsaid and not absolute):
                places.at[axis] = None
            elif absolute or not self._modal.incremental:
                places.at[axis] = length
            elif here is not None:
                places.at[axis] = here + length

    def _is_plain_move(self, words: Words) -> bool:
        codes = [float(value) for letter, value in words if letter == "G"]
        others = any(letter not in "GNFIJKR" and letter not in self._place for letter, _ in words)
        moves = any(letter in self._place for letter, _ in words)
        motion = next((code for code in codes if code in (0, 1, 2, 3)), self._modal.motion)
        return moves and motion is not None and not others and all(is_plain(code) for code in codes)

    def _keep(self, blocks: list[str], kept: str) -> None:
        if len(blocks) >= MOST_KEPT_BLOCKS:
            raise self._text.refusal(f"is the block number {MOST_KEPT_BLOCKS + 1:,} without a move of known place")
        text = kept.encode("latin-1", "replace")
        if find_g05(text) is not None or find_g05_with_point(text) is not None:
            raise self._text.refusal("is G05 already: take it out, or decode the section that follows")
        blocks.append(kept)

    # blocks among the moves

    def _plain_run(self) -> Moves | None:
        """The run of plain moves that follows, if it is worth it."""
        modal, text = self._modal, self._text
        if self._trailer_line or text.line < self._one_by_one:
            return None
        if modal.motion not in (0.0, 1.0) or (self._reading.rotary and self._scale != 1.0):
            return None
        run = text.run(self._runs.pattern)
        lines = run.count("\n")
        self._one_by_one = text.line + lines
        if lines < SHORTEST_RUN or (modal.inch and _WHOLE_FEED.search(run)):
            return None
        nan = math.nan
        before = [modal.motion, *[nan] * len(self._place), nan if modal.feed is None else modal.feed]
        read = self._runs.read(run, before)
        fed = read.motions == 1.0
        if not (read.feeds[fed] > 0).all():
            return None
        text.take(run, lines)
        scale = self._scale
        here = np.array(list(self._place.values()), np.float64)
        if modal.incremental:
            ends = np.cumsum(np.concatenate([here[None], np.nan_to_num(read.said * scale)]), axis=0)[1:]
        else:
            ends = np.where(np.isnan(read.carried), here, read.carried * scale)
        self._place.update(zip(self._place, ends[-1].tolist(), strict=True))
        modal.motion = float(read.motions[-1])
        if read.feed_word:
            modal.feed, modal.feed_word = float(read.feeds[-1]), read.feed_word
        return Moves(ends=ends, speeds=np.where(fed, read.feeds / 60 * scale, np.inf))

    def _take(self, kept: str, words: Words, ends: list[tuple[float, ...]], speeds: list[float]) -> None:
        targets: dict[str, str] = {}
        arc: dict[str, str] = {}
        is_text = False
        feed = ""
        for letter, value in words:
            if letter in self._place:
                targets[letter] = value
            elif letter in "IJKR":
                arc[letter] = value
            elif letter == "G":
                is_text = not self._modal.take(float(value)) or is_text
            elif letter == "F":
                feed = value
            elif letter != "N":
                is_text = True
        if feed:  # behind G20 and G21, wherever in the block they stand
            self._set_feed(feed)
        moves = bool(targets or arc)
        if self._trailer_line or is_text:
            self._leave(kept, plain_move=moves and not is_text)
        elif moves:
            self._move(targets, arc, ends, speeds)

    def _leave(self, kept: str, *, plain_move: bool) -> None:
        """From here on it is text."""
        if not self._trailer_line:
            self._trailer_line = self._text.line
            self._keep(self.trailer, self._modal_words())
        self._keep(self.trailer, kept)
        self._moves_home += plain_move
        if self._moves_home > MOST_MOVES_HOME:
            raise refusal_at(
                self._trailer_line,
                f"{self.trailer[1]!r} is more than a move, and over {MOST_MOVES_HOME} moves follow: in binary input "
                "operation there is nothing but motion; put it elsewhere, or plan the parts one by one",
            )

    def _modal_words(self) -> str:
        """What the control does not know by itself when binary input operation ends: it has seen none of the moves."""
        modal = self._modal
        if modal.motion in (2.0, 3.0):
            raise self._text.refusal("follows an arc without a straight move between: say G00 or G01 before it")
        plane = "" if "plane" in modal.unsaid else f"G{modal.plane}"
        distance = 91 if modal.incremental else 90
        words = f"G{int(modal.motion or 0):02d}{plane}G{20 if modal.inch else 21}G{distance}"
        return words + (f"F{modal.feed_word}" if modal.feed_word else "")

    def _move(
        self, targets: dict[str, str], arc: dict[str, str], ends: list[tuple[float, ...]], speeds: list[float]
    ) -> None:
        place, motion = self._place, self._modal.motion
        if arc and motion in (0.0, 1.0):
            raise self._text.refusal(f"has {', '.join(sorted(arc))} in a straight move: that belongs to G02 and G03")
        before = tuple(place.values())
        for axis, value in targets.items():
            length = self._length(axis, value)
            place[axis] = place[axis] + length if self._modal.incremental else length  # type: ignore[operator]
        if motion is None:
            raise self._text.refusal("moves before any of G00, G01, G02 and G03")
        if motion == 0.0:
            speeds.append(np.inf)
            ends.append(tuple(place.values()))  # type: ignore[arg-type]
        elif self._modal.feed is None:
            raise self._text.refusal("moves at a feed that no F has given, or one before the change of G20 and G21")
        elif motion == 1.0:
            speeds.append(self._modal.feed / 60 * self._feed_scale(before))
            ends.append(tuple(place.values()))  # type: ignore[arg-type]
        else:
            self._arc(before, arc, ends, speeds)

    def _feed_scale(self, before: tuple[float | None, ...]) -> float:
        """What the feed is multiplied by for units of the machine.

        A feed is along the path of the program, in which degrees count like its millimetres or inches: a rotary axis
        alone turns so many degrees, whatever G20 and G21 say.
        """
        scale, rotary = self._scale, self._reading.rotary
        if scale == 1.0 or not rotary:
            return scale
        ways = {
            axis: (value or 0.0) - (old or 0.0) for (axis, value), old in zip(self._place.items(), before, strict=True)
        }
        here = math.hypot(*ways.values())
        said = math.hypot(*(way if axis in rotary else way / scale for axis, way in ways.items()))
        return here / said if said else scale

    def _arc(
        self,
        before: tuple[float | None, ...],
        words: dict[str, str],
        ends: list[tuple[float, ...]],
        speeds: list[float],
    ) -> None:
        modal = self._modal
        assert modal.feed is not None
        if "plane" in modal.unsaid:
            raise self._text.refusal(
                f"is an arc, and the subprogram called in line {modal.unsaid['plane']} may have changed "
                f"{MODES['plane']}: say it again behind the call"
            )
        arc = Arc(
            clockwise=modal.motion == 2.0,
            plane=modal.plane,
            offsets={letter: self._length(letter, value) for letter, value in words.items()},
        )
        try:
            made, longer = chords(
                arc,
                dict(zip(self._place, (value or 0.0 for value in before), strict=True)),
                {axis: value or 0.0 for axis, value in self._place.items()},
                self._reading.chord_error,
                RADIUS_ERROR_MM / (MM_PER_INCH if self._reading.inch_machine else 1.0),
            )
        except ProgramError as error:
            raise self._text.refusal(str(error)) from None
        ends.extend(made)
        speeds.extend([modal.feed / 60 * self._scale * longer] * len(made))

    # numbers

    def _length(self, letter: str, text: str) -> float:
        """In units of the machine. Without a point it counts increments."""
        value = float(text)
        rotary = letter in self._reading.rotary
        if "." not in text:
            value /= 10.0 ** (self._reading.decimals + (self._modal.inch and not rotary))
        return value if rotary else value * self._scale

    @property
    def _scale(self) -> float:
        if self._modal.inch == self._reading.inch_machine:
            return 1.0
        return MM_PER_INCH if self._modal.inch else 1 / MM_PER_INCH

    def _set_feed(self, text: str) -> None:
        feed = float(text)
        if not feed > 0:
            raise self._text.refusal(f"has the feed F{text}: it is above 0")
        if self._modal.inch and "." not in text:
            raise self._text.refusal(
                f"has the feed F{text} in G20: without a point some controls take it for inches a minute and some for "
                "hundredths (No. 1403#0, 3401#0): write the point"
            )
        self._modal.feed, self._modal.feed_word = feed, text


def _moves(ends: list[tuple[float, ...]], speeds: list[float]) -> Moves:
    return Moves(ends=np.array(ends, np.float64), speeds=np.array(speeds, np.float64))
