"""Chance as an argument: what of a random source the faults of a line need, and a small source that does it.

A stream is made from a seed and a name, so that one more line, wire or fault does not shift the draws of the others.
"""

from __future__ import annotations

from typing import Final, Protocol

__all__ = ["SplitMix", "Stream", "derive"]

_MASK: Final = (1 << 64) - 1
_GAMMA: Final = 0x9E3779B97F4A7C15
"""The odd number nearest to 2**64 over the golden ratio (Steele, Lea, Flood: Fast splittable generators, 2014)."""


class Stream(Protocol):
    """A seeded source of chance. `random.Random` is one, and so is `SplitMix`."""

    def random(self) -> float:
        """At least 0, less than 1."""
        ...

    def randrange(self, stop: int, /) -> int:
        """At least 0, less than `stop`."""
        ...


class SplitMix:
    """A stream of 64-bit words from one 64-bit state: made in no time, good enough to place faults by."""

    __slots__ = ("_state",)

    def __init__(self, seed: int) -> None:
        self._state = seed & _MASK

    def _next(self) -> int:
        self._state = (self._state + _GAMMA) & _MASK
        return _mix(self._state)

    def random(self) -> float:
        return (self._next() >> 11) * 2.0**-53

    def randrange(self, stop: int, /) -> int:
        # The bias of the remainder is stop / 2**64: less than anybody can count.
        return self._next() % stop


def _mix(word: int) -> int:
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & _MASK
    return word ^ (word >> 31)


def derive(seed: int, *names: str) -> SplitMix:
    """The stream of `names` under `seed`: the same for ever, and another for every other name."""
    state = _mix(seed & _MASK)
    for name in names:
        for byte in name.encode():
            state = _mix((state ^ byte) + _GAMMA & _MASK)
        state = _mix(state ^ len(name))
    return SplitMix(state)
