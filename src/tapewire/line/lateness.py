"""How late an ordinary computer wakes, for simulated time.

Measured with asyncio on a busy two-core virtual machine, 16 lines at 9600 baud: half of the wake-ups 0.57 ms late or
more, one of a hundred 1.12 ms, the worst 1.9 ms; a turn of the loop without sleeping takes some ten microseconds.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

from tapewire.engine import MICROSECOND, Nanos
from tapewire.line.faults.chance import Stream
from tapewire.line.link import Link

__all__ = ["EARLY", "LateLink", "Lateness"]

MEASURED: Final[tuple[tuple[float, Nanos], ...]] = (
    (0.0, 60 * MICROSECOND),
    (0.5, 570 * MICROSECOND),
    (0.99, 1120 * MICROSECOND),
    (1.0, 1900 * MICROSECOND),
)
"""Share of the wake-ups, and how late they are at most; straight between these points."""

EARLY: Final[Nanos] = 1200 * MICROSECOND
"""Whoever may be no later than a moment wakes so long before it: as late as 99 of 100 wake-ups are."""

SHORT_WAIT: Final[Nanos] = 150 * MICROSECOND
"""A driver does not sleep for so short a wait: it lets the others have a turn and looks again."""

TURN: Final[Nanos] = 50 * MICROSECOND
"""A short wait ends so late at most."""


class Lateness:
    """Draws how late each wake-up is."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream

    def wake(self, deadline: Nanos, now: Nanos) -> Nanos:
        """When a computer that at `now` goes to wait for `deadline` goes on."""
        share = self._stream.random()
        if deadline - now <= SHORT_WAIT:
            return max(now, deadline) + int(share * TURN)
        for (low, least), (high, most) in pairwise(MEASURED):
            if share <= high:
                return deadline + least + int((share - low) / (high - low) * (most - least))
        raise AssertionError(f"{share} is no share")


class LateLink:
    """A Link on a computer that wakes late: it is stepped at its own moments and at no others."""

    def __init__(self, link: Link, lateness: Lateness) -> None:
        self.link = link
        self._lateness = lateness
        self._deadline: Nanos | None = None
        self._wake: Nanos | None = None
        self._now: Nanos = 0
        self._woken = True
        self.steps = 0

    def wake(self) -> None:
        """Step at once next time: something has been done to the engine from outside."""
        self._woken = True

    def step(self, now: Nanos) -> None:
        wake = self.next_deadline()
        if not self._woken and (wake is None or now < wake):
            return
        self._woken = False
        self._deadline = self._wake = None
        self._now = now
        self.steps += 1
        self.link.step(now)

    def next_deadline(self) -> Nanos | None:
        deadline = self.link.next_deadline()
        if deadline != self._deadline:
            self._deadline = deadline
            self._wake = None if deadline is None else self._lateness.wake(deadline, self._now)
        return self._wake
