"""What code and which rate a control seems to talk in, by the characters that came. Pure.

A character of eight bits tells its parity: ISO 840 is even, EIA RS-244 odd, ASCII leaves the eighth bit alone. At a
wrong rate most characters come without a stop bit, and what does come is no text.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["Heard", "best_of", "code_of"]

ENOUGH: Final = 8
"""Characters below which nothing is concluded."""

MOSTLY: Final = 0.98

_CODES: Final = (0x0A, 0x0D, 0x11, 0x12, 0x13, 0x14, 0x93, 0x90)
_TEXT: Final = frozenset(range(0x20, 0x60)) | frozenset(_CODES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What came in one way of listening."""

    data: bytes
    damaged: int

    @property
    def score(self) -> float:
        """Share of characters that came undamaged and mean something; 0 where too few came."""
        count = len(self.data) + self.damaged
        if count < ENOUGH:
            return 0.0
        return sum(byte & 0x7F in _TEXT for byte in self.data) / count


def code_of(data: bytes) -> str:
    """The code in words."""
    if len(data) < ENOUGH:
        return f"only {len(data)} characters came: nothing can be said of the code"
    counts = Counter(data)
    total = len(data)
    even = sum(number for byte, number in counts.items() if byte.bit_count() % 2 == 0) / total
    high = sum(number for byte, number in counts.items() if byte & 0x80) / total
    if high == 0:
        return "the eighth bit is never set: ASCII, or seven data bits with a parity that the port takes off"
    if even >= MOSTLY:
        return "every character has even parity: ISO 840"
    if even <= 1 - MOSTLY:
        return "every character has odd parity: EIA RS-244"
    return f"{even:.0%} of the characters have even parity: no tape code, binary data, or a wrong rate"


def best_of(heard: Mapping[str, Heard]) -> Sequence[str]:
    """Ways of listening, the likeliest first; those that brought nothing are left out."""
    likely = [name for name, what in heard.items() if what.score > 0]
    return sorted(likely, key=lambda name: heard[name].score, reverse=True)
