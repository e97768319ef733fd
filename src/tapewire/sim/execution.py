"""How long a control takes for a block: from its length and its feed, or its dwell.

Only what a buffer runs empty or full by: straight moves at feed and at rapid, arcs by their chord, dwells. Everything
else takes the least time a block takes. What a block does to the part is nobody's business here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import hypot
from typing import Final

from tapewire.codes import TABLES, DataCode
from tapewire.engine import MILLISECOND, SECOND, Nanos

__all__ = ["BlockTime", "Speeds"]

_COMMENT: Final = re.compile(rb"\([^)]*\)?")
_WORD: Final = re.compile(rb"([A-Z])([+-]?[0-9]*\.?[0-9]*)")
_MM_PER_INCH: Final = 25.4
_LONGEST_BLOCK: Final[Nanos] = 24 * 3600 * SECOND
"""A dwell of days is a slip of the pen, and the world would wait for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """What of a machine decides how fast it goes through a program."""

    rapid_mm_per_min: float = 10_000.0
    """G00; a machining centre of the time of these manuals."""
    feed_mm_per_min: float = 500.0
    """Where a program moves at feed before it has said F."""
    override: float = 1.0
    """The operator's switch: 0.5 halves the feed. Rapid has its own switch and is left alone."""
    least: Nanos = 4 * MILLISECOND
    """No block takes less: reading and preparing it."""


class BlockTime:
    """Execution time block by block. Keeps what is modal: G00/G01/G02/G03, G90/G91, G20/G21, F, the position."""

    def __init__(self, speeds: Speeds | None = None, code: DataCode = DataCode.ASCII) -> None:
        self._speeds = speeds or Speeds()
        self._to_ascii = TABLES[code].to_ascii
        self._motion = 0
        self._incremental = False
        self._unit_mm = 1.0
        self._feed = self._speeds.feed_mm_per_min
        self._position = {b"X": 0.0, b"Y": 0.0, b"Z": 0.0}

    def __call__(self, block: bytes) -> Nanos:
        """Nanoseconds for `block`, as taken from the buffer. Never raises: a control has its own checks."""
        text = block.translate(self._to_ascii).upper()
        words = [(letter, _number(number)) for letter, number in _WORD.findall(_COMMENT.sub(b"", text))]
        dwell = False
        for value in (value for letter, value in words if letter == b"G"):
            dwell = self._prepare(value) or dwell
        if dwell:
            return self._bounded(_dwell_seconds(words))
        for letter, value in words:
            if letter == b"F" and value > 0:
                self._feed = value * self._unit_mm
        return self._bounded(self._move(words))

    def _prepare(self, code: float) -> bool:
        """A G word; True for a dwell."""
        match code:
            case 0 | 1 | 2 | 3:
                self._motion = int(code)
            case 20 | 21:
                self._unit_mm = _MM_PER_INCH if code == 20 else 1.0
            case 90 | 91:
                self._incremental = code == 91
        return code == 4

    def _move(self, words: list[tuple[bytes, float]]) -> float:
        """Seconds of the straight way from here to where the block leads."""
        lengths = dict.fromkeys(self._position, 0.0)
        for letter, value in words:
            if letter in lengths:
                target = value * self._unit_mm + (self._position[letter] if self._incremental else 0.0)
                lengths[letter] = target - self._position[letter]
        for axis, length in lengths.items():
            self._position[axis] += length
        rate = self._speeds.rapid_mm_per_min if self._motion == 0 else self._feed * self._speeds.override
        return hypot(*lengths.values()) * 60 / max(rate, 1e-6)

    def _bounded(self, seconds: float) -> Nanos:
        return max(self._speeds.least, min(round(seconds * SECOND), _LONGEST_BLOCK))


def _dwell_seconds(words: list[tuple[bytes, float]]) -> float:
    """G04 X or U in seconds, P in milliseconds."""
    for letter, value in words:
        if letter in (b"X", b"U"):
            return abs(value)
        if letter == b"P":
            return abs(value) / 1000
    return 0.0


def _number(text: bytes) -> float:
    """What stands behind the letter; nothing, or a lone point, is 0. Long runs of digits are cut to what counts."""
    try:
        return float(text[:18])
    except ValueError:
        return 0.0
