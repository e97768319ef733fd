"""The next characters only when the transmitter says that it is empty.

Whatever the true rate of the line is, and however late this computer wakes up, no more than one chunk can still leave
after a stop request has been read. The time says only when to ask.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tapewire.engine import MICROSECOND, MILLISECOND, Nanos

__all__ = ["ASK_EARLY", "CLOSED_LOOP_WINDOW", "ClosedLoop"]

CLOSED_LOOP_WINDOW: Final = 16
"""Up to this window the transmitter is asked before each chunk; a larger one does not fit into a FIFO at once."""

ASK_EARLY: Final[Nanos] = 300 * MICROSECOND
"""Before the last stop bit should have left: a line may be two percent faster than it is told, and a wake-up is late
by a tenth of a millisecond."""

ASK_AGAIN: Final[Nanos] = 50 * MICROSECOND
"""A question costs 2 µs; the gap it may leave on the wire is a twentieth of a character at 9600."""

ASK_AGAIN_SLOWLY: Final[Nanos] = 5 * MILLISECOND
"""A transmitter that has stood still for twenty milliseconds is held, and not about to be empty."""


class ClosedLoop:
    """What is in flight, by asking. `late` is how much older than the question the answer may be: one that was true
    before the characters got there is not believed. `early` is how long before the predicted moment the asking begins:
    longer than a wake-up is late.
    """

    __slots__ = ("_asked", "_character", "_early", "_end", "_in_flight", "_late", "_trusted")

    def __init__(self, character: Nanos, late: Nanos = 0, early: Nanos = ASK_EARLY) -> None:
        self._character = character
        self._early = early
        self._late = late
        self._in_flight = 0
        self._end: Nanos = 0
        self._trusted: Nanos = 0
        self._asked: Nanos | None = None

    def hand_over(self, count: int, now: Nanos) -> None:
        """`count` characters more have gone to a transmitter that was empty."""
        self._in_flight += count
        self._end = max(self._end, now) + count * self._character
        self._trusted = now + self._late
        self._asked = None

    def call_back(self, count: int) -> None:
        self._in_flight -= count
        self._end -= count * self._character

    def in_flight(self, now: Nanos, is_empty: Callable[[], bool]) -> int:
        """All of it, until `is_empty` says that it has left; asked once for one moment."""
        if self._in_flight and now >= self._first_question() and now != self._asked:
            self._asked = now
            if is_empty():
                self._in_flight = 0
        return self._in_flight

    def next_question(self, now: Nanos) -> Nanos | None:
        """When to ask next; None while nothing is in flight."""
        if not self._in_flight:
            return None
        first = self._first_question()
        if now < first:
            return first
        if now < self._end:
            # One question stands where the answer should change: a gap of half a step less on the wire.
            return min(now + ASK_AGAIN, self._end)
        return now + min(max(ASK_AGAIN, (now - self._end) // 4), ASK_AGAIN_SLOWLY)

    def _first_question(self) -> Nanos:
        return max(self._trusted, self._end - self._early)
