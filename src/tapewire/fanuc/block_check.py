"""Blocks that a control does not execute: PS10, PS11 and PS12 (B-63322EN-1/01 chapter 11).

A character lost or damaged on the way often ends in one of them. Which G codes and axes a control has is a matter of
its model and options, so both can be said; the defaults are those of a machining centre of the Series 15i as generally
known, and no list of the manual. A custom macro statement is believed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from tapewire.fanuc.alarms import AlarmNumber

__all__ = ["AXES", "G_CODES", "BlockCheck", "Complaint"]

ADDRESSES: Final = "NOGFSTMDHIJKLPQR"
"""Addresses that every control has; letters of its axes come beside them."""

AXES: Final = "XYZABCUVW"

_G_CODES: Final = (
    "0 1 2 3 4 5 5.1 6.2 7 7.1 8 9 10 10.3 10.6 10.9 11 12 12.1 13 13.1 15 16 17 18 19 20 21 22 23 25 26 27 28 29 30 "
    "30.1 31 33 37 38 39 40 41 42 43 43.1 44 45 46 47 48 49 50 50.1 51 51.1 52 53 54 54.1 55 56 57 58 59 60 61 61.1 "
    "62 63 64 65 66 66.1 67 68 69 72.1 72.2 73 74 76 80 80.5 81 82 83 84 84.2 84.3 85 86 87 88 89 90 91 92 92.1 93 94 "
    "95 96 97 98 99"
)
G_CODES: Final = frozenset(_G_CODES.split())

_COMMENT: Final = re.compile(r"\([^)]*\)?")
_SKIP: Final = re.compile(r"/[1-9]?")
_NUMBER: Final = re.compile(r"[O:][ \t]*\d+")
_MACRO: Final = re.compile(r"[#=\[\]]|IF|WHILE|GOTO|DO\d|END|POPEN|PCLOS|BPRNT|DPRNT|SETVN")
_WORD: Final = re.compile(r"[ \t]*([A-Z])[ \t]*([+-]?(?:\d+\.?\d*|\.\d+))[ \t]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Complaint:
    """The alarm, and what of the block brought it."""

    number: AlarmNumber
    what: str


class BlockCheck:
    """Checks one block at a time, without its EOB."""

    def __init__(self, *, axes: str = AXES, g_codes: frozenset[str] = G_CODES) -> None:
        self._addresses = frozenset(ADDRESSES + axes)
        self._g_codes = g_codes

    def complaint(self, block: bytes) -> Complaint | None:
        """What is wrong with `block`, which is ASCII; None for one that a control can execute."""
        text = _COMMENT.sub("", block.decode("ascii", "backslashreplace")).strip(" \t\r\x00\x7f")
        text = _SKIP.sub("", text, count=1) if text.startswith("/") else text
        text = _NUMBER.sub("", text, count=1) if text.startswith((":", "O")) else text
        return None if _MACRO.search(text) else self._words(text)

    def _words(self, text: str) -> Complaint | None:
        at = 0
        while at < len(text):
            word = _WORD.match(text, at)
            if word is None:
                return Complaint(number=AlarmNumber.PS12, what=f"{text[at : at + 12]!r} is no word")
            address, value = word[1], word[2]
            if address not in self._addresses:
                return Complaint(number=AlarmNumber.PS11, what=f"there is no address {address}")
            if address == "G" and not self._has_g(value):
                return Complaint(number=AlarmNumber.PS10, what=f"there is no G{value}")
            at = word.end()
        return None

    def _has_g(self, value: str) -> bool:
        whole, _, fraction = value.partition(".")
        name = whole.lstrip("0") or "0"
        return value[0] not in "+-" and (f"{name}.{fraction}" if fraction.strip("0") else name) in self._g_codes
