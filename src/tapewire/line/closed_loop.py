"""Pacing for a control that bears next to nothing after its stop request: hand over only into an empty transmitter.

Time alone cannot keep such a bound: a line whose clock is slower than it should be piles up arrears that nobody sees
(15 % slow: 54 to 142 characters). So the transmitter is asked. What is handed over is a chunk so small that it may all
leave after the stop request; the next one waits until the transmitter says that it is physically empty.

An ordinary computer wakes a millisecond late, half a chunk at 9600 baud. So the deadline stands before the predicted
moment, and from then on the transmitter is polled. Polls that ask in vain for long grow rare.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Final

from tapewire.engine import MICROSECOND, MILLISECOND, Nanos
from tapewire.line.paths import TransmitterEmpty

__all__ = ["EARLY", "POLL", "ClosedLoop", "Pacing", "pacing_for"]

EARLY: Final[Nanos] = 1200 * MICROSECOND
"""So long before the predicted moment the wait ends: as late as 99 of 100 wake-ups are (1.12 ms measured)."""

POLL: Final[Nanos] = 100 * MICROSECOND
"""Between two polls: a twentieth of two characters at 9600 baud, five times what a poll costs."""

SLOWEST_POLL: Final[Nanos] = 5 * MILLISECOND
"""Where nothing leaves for long, a poll is rarer than this and no rarer: a held line must not eat the computer."""

QUICK_POLLS: Final = 20
"""Polls in vain after the predicted moment, 2 ms of them, before they grow rare: each twice as late as the last."""

STRICT: Final = 16
"""A control that bears no more than this after a stop cannot be fed through the 16 characters of a UART's FIFO."""


class Pacing(Enum):
    """How the characters in flight are bounded."""

    WINDOW = "window"
    """By a model of the line at its rate, and by what the driver says it holds."""
    CLOSED_LOOP = "closed loop"
    """By asking the transmitter whether it is empty."""


def pacing_for(needs_stop_distance: int, transmitter: TransmitterEmpty) -> Pacing:
    """How a line is paced for a control that bears `needs_stop_distance` characters after its stop request.

    The closed loop costs a wake-up for every two characters, so it is for those that need it, where it can be had.
    """
    strict = needs_stop_distance <= STRICT
    return Pacing.CLOSED_LOOP if strict and transmitter is TransmitterEmpty.ASKED else Pacing.WINDOW


class ClosedLoop:
    """What may be handed over to a transmitter that can be asked. `character` is the time of one by its rate.

    At most `chunk` characters are in the transmitter, whatever its clock is.
    """

    __slots__ = ("_asked_in_vain", "_empty_at", "_inside", "character", "chunk")

    def __init__(self, character: Nanos, chunk: int) -> None:
        self.character = character
        self.chunk = chunk
        self._inside = 0
        """Characters handed over since the transmitter was last known to be empty."""
        self._empty_at: Nanos = 0
        """When it should be empty, by the rate."""
        self._asked_in_vain = 0

    def room(self, now: Nanos, is_empty: Callable[[], bool]) -> int:
        """How many characters may be handed over. The transmitter is asked only where the answer matters."""
        if self._inside and now >= self._empty_at - EARLY:
            self._ask(now, is_empty)
        return self.chunk - self._inside

    def _ask(self, now: Nanos, is_empty: Callable[[], bool]) -> None:
        if is_empty():
            self._inside = self._asked_in_vain = 0
        elif now > self._empty_at:
            self._asked_in_vain += 1

    def hand_over(self, count: int, now: Nanos) -> None:
        self._inside += count
        self._empty_at = max(now, self._empty_at if self._inside > count else now) + count * self.character
        self._asked_in_vain = 0

    def call_back(self, count: int) -> None:
        """`count` of them never leave."""
        self._inside -= count
        self._empty_at -= count * self.character

    def in_flight(self, now: Nanos, is_empty: Callable[[], bool]) -> int:
        """Characters that may still be in the transmitter: those that the rate says, and one until it is empty."""
        if not self._inside or is_empty():
            return 0
        return max(1, min(self._inside, -(-(self._empty_at - now) // self.character)))

    def next_deadline(self, now: Nanos) -> Nanos | None:
        """When to ask; None while the transmitter is known to be empty."""
        if not self._inside:
            return None
        if now < self._empty_at - EARLY:
            return self._empty_at - EARLY
        if now < self._empty_at:
            return min(now + POLL, self._empty_at)
        doublings = max(0, self._asked_in_vain - QUICK_POLLS)
        return now + min(POLL << min(doublings, 10), SLOWEST_POLL)
