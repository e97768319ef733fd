"""What blocks of an NC program leave behind: modes, and where the axes stand.

What is known is exact. A block that may leave the axes or the modes where this program does not say makes them
unknown, with the reason, until the program says them again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from tapewire.errors import ProgramError
from tapewire.g05.modes import MOVING_AXES_ELSEWHERE, ModalWatch
from tapewire.nc.text import Words

__all__ = ["MODES", "Modal", "Places", "is_plain"]

_WITHOUT_MOTION: Final = frozenset((9, 17, 18, 19, 20, 21, 40, 61, 64, 69, 80, 90, 91, 94))
"""Codes that may stand among the moves and change nothing but what is known here."""
_WORK_COORDINATES: Final = frozenset((54.0, 55.0, 56.0, 57.0, 58.0, 59.0))
_FEED_KINDS: Final = {93.0: "G93, inverse time", 94.0: "", 95.0: "G95, per revolution"}
_LENGTH_COMPENSATION: Final = frozenset((43.0, 44.0))
_END_OF_COMPENSATION: Final = 49.0
_PRESET: Final = 92.0
_WORDS_ARE_NO_MOVE: Final = frozenset((4.0, 5.1, 8.0, 22.0, 23.0))
"""Dwell, and settings whose words name axes or limits."""
_ENDS_BY_MOVING: Final = frozenset((0.0, 1.0, 2.0, 3.0, 40.0))
"""What ends a forbidden mode with a move to where its words say."""
_MOVES_AS_SAID: Final = (
    _WITHOUT_MOTION
    | _WORK_COORDINATES
    | _LENGTH_COMPENSATION
    | {0, 1, 2, 3, 49, 60, 62, 63, 92, 93, 95, 96, 97, 98, 99}
)
_STAYS: Final = _MOVES_AS_SAID | _WORDS_ARE_NO_MOVE | {11, 13.1, 15, 25, 26, 40.1, 50, 50.1, 67, 113, 150}
"""Codes that leave the axes where they are, or where the block's own words say. Every other one loses the place."""
_CALLS: Final = {"G65", "G66", "G66.1", "M98", "M198"}
_MODAL_CALLS: Final = {"G66", "G66.1"}
_TOOL_CHANGE: Final = "M6"
_ENDS: Final = {"M2", "M30", "M99"}

MODES: Final = {
    "motion": "G00, G01, G02 or G03",
    "plane": "G17, G18 or G19",
    "units": "G20 or G21",
    "distance": "G90 or G91",
    "feed kind": "G94",
}


@dataclass(slots=True)
class Modal:
    """Modes as the blocks so far have left them. At the beginning G17, G90, G94, and millimetres."""

    motion: float | None = None
    plane: int = 17
    incremental: bool = False
    inch: bool = False
    feed_kind: float = 94.0
    feed: float | None = None
    """As its F says it, in units of the program a minute."""
    feed_word: str = ""
    unsaid: dict[str, int] = field(default_factory=dict)
    """Modes (MODES) that a subprogram may have changed, with the line that calls it."""

    def take(self, code: float) -> bool:
        """False for a code that is none of the moves'."""
        if code in (0.0, 1.0, 2.0, 3.0):
            self.motion = code
            self.unsaid.pop("motion", None)
        elif code in (17.0, 18.0, 19.0):
            self.plane = int(code)
            self.unsaid.pop("plane", None)
        elif code in (20.0, 21.0):
            self._take_units(code == 20.0)
        elif code in (90.0, 91.0):
            self.incremental = code == 91.0
            self.unsaid.pop("distance", None)
        else:
            return code in _WITHOUT_MOTION
        return True

    def _take_units(self, inch: bool) -> None:
        """Whether the control converts an F of before is not said here: it is no longer known."""
        if inch is not self.inch or "units" in self.unsaid:
            self.feed, self.feed_word = None, ""
        self.inch = inch
        self.unsaid.pop("units", None)

    def take_feed_kind(self, code: float) -> None:
        """The F of another kind is none of this one."""
        if code in _FEED_KINDS:
            if code != self.feed_kind:
                self.feed, self.feed_word = None, ""
            self.feed_kind = code
            self.unsaid.pop("feed kind", None)

    @property
    def other_feed(self) -> str:
        """The kind of feed, if it is not the one per minute."""
        return _FEED_KINDS[self.feed_kind]

    def forget(self, line: int) -> None:
        """The block in `line` calls a subprogram, which may change everything."""
        self.unsaid = dict.fromkeys(MODES, line)
        self.motion, self.feed, self.feed_word = None, None, ""


def is_plain(code: float) -> bool:
    """Whether a G code may stand in a move."""
    return code in (0.0, 1.0, 2.0, 3.0) or code in _WITHOUT_MOTION


class Places:
    """Where the axes are, in units of the machine, after the blocks of the header. None for an axis: not known."""

    def __init__(self, axes: tuple[str, ...], start: tuple[float, ...] | None) -> None:
        self.at: dict[str, float | None] = dict.fromkeys(axes)
        if start is not None:
            self.at.update(zip(axes, start, strict=True))
        self.lost_by = ""
        """The block after which the last of them was no longer known."""
        self.macro = ""
        """The block that calls a macro with every move (G66), while it does."""
        self._elsewhere = ModalWatch(MOVING_AXES_ELSEWHERE)
        self._work_coordinate: float | None = None
        self._is_compensated = False

    @property
    def unknown(self) -> tuple[str, ...]:
        return tuple(axis for axis, value in self.at.items() if value is None)

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """The modes now on in which words of a move are not places of the axes, beside those that forbid G05."""
        return self._elsewhere.forbidden

    def follow(self, block: str, words: Words, modal: Modal, modes: ModalWatch, line: int) -> Words:
        """What the block does; returns the words that say where the axes go, empty where none does."""
        names = {f"{letter}{_plain(value)}" for letter, value in words if letter in "GM"}
        in_order = [float(value) for letter, value in words if letter == "G"]
        codes = set(in_order)
        before = modes.displacing or self.elsewhere
        for watch in (modes, self._elsewhere):
            watch.feed(block.encode("utf-8", "replace"))
        still = bool(modes.displacing or self.elsewhere)
        if names & _ENDS:
            raise ProgramError(f"line {line}: {block!r} ends the program before a move of known place", line=line)
        for code in in_order:
            modal.take(code)
            modal.take_feed_kind(code)
        if 67.0 in codes:
            self.macro = ""
        if names & _CALLS or self.macro:
            self.macro = block if names & _MODAL_CALLS else self.macro
            modal.forget(line)
            self._lose(block, line)
            return []
        return self._moving(block, words, names, codes, bool(before) or still, still, line)

    def _moving(
        self, block: str, words: Words, names: set[str], codes: set[float], displaced: bool, still: bool, line: int
    ) -> Words:
        axis_words = [(letter, value) for letter, value in words if letter in self.at]
        self._change_coordinates(block, codes, any(letter == "Z" for letter, _ in axis_words), line)
        if displaced:
            self._lose(block, line)
            if still or not codes & _ENDS_BY_MOVING:
                return []
        elif not codes <= _STAYS or _TOOL_CHANGE in names:
            self._lose(block, line)
            return []
        if codes & _WORDS_ARE_NO_MOVE:
            return []
        if axis_words and not codes <= _MOVES_AS_SAID:
            self._lose(block, line)
            return []
        return axis_words

    def _change_coordinates(self, block: str, codes: set[float], z_is_said: bool, line: int) -> None:
        """In another work coordinate system, or with another length of the tool, the same place has other numbers."""
        for code in codes & _WORK_COORDINATES:
            if self._work_coordinate not in (None, code):
                self._lose(block, line)
            self._work_coordinate = code
        begins = bool(codes & _LENGTH_COMPENSATION)
        if not z_is_said and "Z" in self.at and (begins or (_END_OF_COMPENSATION in codes and self._is_compensated)):
            self.at["Z"], self.lost_by = None, _named(block, line)
        if begins or _END_OF_COMPENSATION in codes:
            self._is_compensated = begins

    def _lose(self, block: str, line: int) -> None:
        self.at = dict.fromkeys(self.at)
        self.lost_by = _named(block, line)

    @staticmethod
    def presets(words: Words) -> bool:
        """G92 says where the axes are; it is absolute in G91 too."""
        return any(letter == "G" and _plain(value) == "92" for letter, value in words)


def _named(block: str, line: int) -> str:
    return f"{block[:60]!r} in line {line}"


def _plain(value: str) -> str:
    """A number without zeros that say nothing, as in G01 and G5.10."""
    whole, _, part = value.lstrip("+").partition(".")
    part = part.rstrip("0")
    return (whole.lstrip("0") or "0") + (f".{part}" if part else "")
