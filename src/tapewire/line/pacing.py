"""The arithmetic of a serial line: how long a character takes, how many may be in flight, how fast they come in.

Real lines, pseudo terminals, TCP and the simulated cable all count with these two.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from tapewire.engine import SECOND, Nanos
from tapewire.line.closed_loop import CLOSED_LOOP_WINDOW
from tapewire.line.paths import TransmitterEmpty

__all__ = [
    "BITS_PER_CHARACTER",
    "Pacing",
    "RxPacer",
    "TxPacer",
    "character_time",
    "default_window",
    "pacing_for",
]

BITS_PER_CHARACTER: Final = 11
"""8E1 and 8N2 alike: start, eight data bits, parity or a second stop bit, stop (B-63322EN-1 3.1)."""

WINDOW_BAUD_PER_CHARACTER: Final = 400
"""Baud for one character of window: 27.5 ms of line whatever the rate, 216 characters at 86400 and 48 at 19200.

Long enough for the wake-ups of an ordinary computer to be late (a few milliseconds) without a gap on the wire,
short enough to stay far under the overrun that protocol B (512) and its expansion (1280) allow.
"""


OFFERED_SHARE: Final = 4
"""A window is refilled when so large a part of it, one fourth, is free."""


def character_time(baud: int, bits: int = BITS_PER_CHARACTER) -> Nanos:
    """Nanoseconds one character occupies the line, rounded up."""
    return -(-bits * SECOND // baud)


def default_window(baud: int, tolerated: int) -> int:
    """Characters that may be in flight at `baud` for a control that tolerates `tolerated` after its stop request."""
    return max(1, min(baud // WINDOW_BAUD_PER_CHARACTER, tolerated - 1))


class Pacing(Enum):
    """How the characters in flight are bounded."""

    WINDOW = "window"
    """By a model of the line at its rate, and by what the driver says it holds."""
    CLOSED_LOOP = "closed loop"
    """By asking the transmitter whether it is empty."""


def pacing_for(window: int, transmitter: TransmitterEmpty) -> Pacing:
    """How a line with this window is paced. The closed loop costs a wake-up a window, so it is for small ones."""
    small = window <= CLOSED_LOOP_WINDOW
    return Pacing.CLOSED_LOOP if small and transmitter is TransmitterEmpty.ASKED else Pacing.WINDOW


class TxPacer:
    """What is on its way out of this end, by the model of a line that sends one character per `character` ns.

    A quarter of the window is the least that is offered: a fast line is fed in chunks, not by the character, and a
    computer may be late by three quarters of the window before the wire is empty.
    """

    __slots__ = ("_free_at", "_least", "character", "window")

    def __init__(self, character: Nanos, window: int) -> None:
        self.character = character
        self.window = window
        self._least = -(-window // OFFERED_SHARE)
        self._free_at: Nanos | None = None

    @property
    def free_at(self) -> Nanos | None:
        """When the last character handed over has left; None before the first one."""
        return self._free_at

    def in_flight(self, now: Nanos) -> int:
        if self._free_at is None or self._free_at <= now:
            return 0
        return -(-(self._free_at - now) // self.character)

    def room(self, now: Nanos) -> int:
        free_at = self._free_at
        free = self.window if free_at is None or free_at <= now else self.window + (now - free_at) // self.character
        return free if free >= self._least else 0

    def offer(self, free: int) -> int:
        """`free` characters of the window as they are offered: all of them, or none while they are too few."""
        return free if free >= self._least else 0

    def hand_over(self, count: int, now: Nanos) -> Nanos:
        """Returns when the first of the `count` characters begins to leave."""
        begins = now if self._free_at is None else max(self._free_at, now)
        self._free_at = begins + count * self.character
        return begins

    def call_back(self, count: int) -> None:
        if count:
            assert self._free_at is not None, "nothing was handed over"
            self._free_at -= count * self.character

    def next_deadline(self, now: Nanos) -> Nanos | None:
        """When the least that is offered is free again, then when all has left; None while nothing is in flight."""
        if self._free_at is None or self._free_at <= now:
            return None
        offered = self._free_at - (self.window - self._least) * self.character
        return offered if offered > now else self._free_at


class RxPacer:
    """Takes characters no faster than a serial line would bring them.

    TCP and pseudo terminals deliver in bursts. A control that took a burst at once would never see an overrun, and a
    stop distance measured with it would mean nothing.
    """

    __slots__ = ("_last", "_waiting", "character")

    def __init__(self, character: Nanos) -> None:
        self.character = character
        self._last: Nanos = 0
        self._waiting = False

    def due(self, waiting: int, now: Nanos) -> int:
        """How many of the `waiting` characters have come in by `now`.

        While characters waited at the last look the line counts as having been busy since: a reader that is late
        takes what came meanwhile, and no more.
        """
        if not waiting:
            self._waiting = False
            return 0
        if not self._waiting:
            self._last = now
            self._waiting = True
        count = min(waiting, (now - self._last) // self.character)
        self._last += count * self.character
        self._waiting = count < waiting
        return count

    def next_deadline(self, at_least: int) -> Nanos | None:
        """When `at_least` more characters will have come in; None while none are waiting."""
        if not self._waiting:
            return None
        return self._last + at_least * self.character
