"""Draws for the world: seeds, settings, operators. Every name has a stream of its own (`line/faults/chance.py`), so
that another machine in the world, or one more draw by somebody else, shifts nobody's luck.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, log
from typing import TypeVar

from tapewire.line.faults.chance import Stream, derive

__all__ = ["Draws"]

T = TypeVar("T")


class Draws:
    """What follows from `seed` and `names` alone."""

    __slots__ = ("stream",)

    def __init__(self, seed: int, *names: str) -> None:
        self.stream: Stream = derive(seed, *names)

    def random(self) -> float:
        return self.stream.random()

    def happens(self, chance: float) -> bool:
        return self.stream.random() < chance

    def between(self, low: int, high: int) -> int:
        """A whole number from `low` to `high`, both included."""
        return low + self.stream.randrange(high - low + 1)

    def uniform(self, low: float, high: float) -> float:
        return low + self.stream.random() * (high - low)

    def choice(self, of: Sequence[T]) -> T:
        return of[self.stream.randrange(len(of))]

    def log_uniform(self, low: float, high: float) -> float:
        """Every factor of two between the two is equally likely."""
        return exp(self.uniform(log(low), log(high)))
