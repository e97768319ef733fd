"""The modes in which G05 is an alarm (B-63322EN-1 9.3 note 2), as the blocks before it set them.

The manual names the modes; the codes that switch them are those of the G code list of a machining centre, and are no
part of it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

__all__ = ["FORBIDDEN", "MOVING_AXES_ELSEWHERE", "ForbiddenMode", "ModalWatch"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForbiddenMode:
    """A mode of 9.3 with the codes, as numbers without leading zeros, that switch it on and off."""

    name: str
    on: tuple[str, ...]
    off: tuple[str, ...]


def _mode(name: str, on: str, off: str) -> ForbiddenMode:
    return ForbiddenMode(name=name, on=tuple(on.split()), off=tuple(off.split()))


FORBIDDEN: Final = (
    _mode("cutter compensation", "G41 G42", "G40"),
    _mode("three-dimensional cutter compensation", "G41.2 G42.2 G41.3 G41.4 G42.4 G41.5 G42.5 G41.6 G42.6", "G40"),
    _mode("interrupt macro", "M96", "M97"),
    _mode("canned cycle", "G73 G74 G76 G81 G82 G83 G84 G84.2 G84.3 G85 G86 G87 G88 G89", "G80 G0 G1 G2 G3 G33"),
    _mode("coordinate conversion", "G68", "G69"),
    _mode("programmable mirror image", "G51.1", "G50.1"),
    _mode("scaling", "G51", "G50"),
    _mode("polar coordinate interpolation", "G12.1 G112", "G13.1 G113"),
    _mode("polar coordinate command", "G16", "G15"),
    _mode("normal direction control", "G41.1 G42.1 G151 G152", "G40.1 G150"),
    _mode("hypothetical axis interpolation", "G7", ""),
    _mode("cylindrical interpolation", "G7.1 G107", ""),
    _mode("constant surface speed control", "G96", "G97"),
    _mode("spindle speed fluctuation detection", "G26", "G25"),
)

MOVING_AXES_ELSEWHERE: Final = (
    _mode("tool center point control", "G43.4 G43.5", "G49"),
    _mode("a tilted working plane", "G68.1 G68.2 G68.3 G68.4", "G69 G69.1"),
    _mode("dynamic fixture offset", "G54.2", ""),
    _mode("workpiece error compensation", "G54.4", ""),
)
"""Modes not named there, in which the axes do not go where the blocks say either; the last two end with P0."""

_WITHOUT_EFFECT: Final = frozenset(
    ("interrupt macro", "constant surface speed control", "spindle speed fluctuation detection")
)
"""Modes in which the axes go where the blocks say."""

_COMMENT: Final = re.compile(rb"\([^()\n]*\)?")
_WORD: Final = re.compile(rb"([A-Z])([+-]?[0-9]*\.?[0-9]*)")
_ZERO: Final = re.compile(rb"[+-]?0*\.?0*")


class ModalWatch:
    """Knows which of the modes, the forbidden ones if nothing is said, the blocks seen so far have left on."""

    def __init__(self, modes: tuple[ForbiddenMode, ...] = FORBIDDEN) -> None:
        self._watched = modes
        self._on: dict[str, bool] = {}

    @property
    def forbidden(self) -> tuple[str, ...]:
        """Names of the modes that are on, in the manual's order."""
        return tuple(mode.name for mode in self._watched if self._on.get(mode.name))

    @property
    def displacing(self) -> frozenset[str]:
        """Of those, the modes in which the axes do not go where the blocks say."""
        return frozenset(self.forbidden) - _WITHOUT_EFFECT

    def feed(self, block: bytes) -> None:
        """One block of ASCII text, or many lines of it."""
        for line in block.split(b"\n"):
            if b"G" in line or b"M" in line or b"g" in line or b"m" in line:
                self._take(_WORD.findall(_COMMENT.sub(b"", line).upper().replace(b" ", b"")))

    def _take(self, words: list[tuple[bytes, bytes]]) -> None:
        codes = {_code(letter, number) for letter, number in words if letter in (b"G", b"M")}
        for mode in self._watched:
            if codes.intersection(mode.off):
                self._on[mode.name] = False
            if codes.intersection(mode.on):
                self._on[mode.name] = mode.off != () or not _cancels(words)


def _code(letter: bytes, number: bytes) -> str:
    whole, _, part = number.decode("ascii").partition(".")
    part = part.rstrip("0")
    return f"{letter.decode('ascii')}{whole.lstrip('+0') or '0'}" + (f".{part}" if part else "")


def _cancels(words: list[tuple[bytes, bytes]]) -> bool:
    """Cylindrical interpolation ends with the radius 0, hypothetical axis interpolation with the axis word 1."""
    hypothetical = any(letter == b"G" and _code(letter, number) == "G7" for letter, number in words)
    values = [number for letter, number in words if letter not in (b"G", b"M", b"N", b"F", b"S", b"T")]
    if hypothetical:
        return any(number and not _ZERO.fullmatch(number) for number in values)
    return any(_ZERO.fullmatch(number) is not None for number in values)
