"""What a host can know about where its characters are: handed over, on their way, with the control.

A protocol without acknowledgement has only counts and moments, and what they prove is kept here.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from tapewire.engine import MILLISECOND, Nanos

__all__ = ["HEARD_LATE", "HEARD_LATE_CHARACTERS", "SLOWEST", "Delivery"]

HEARD_LATE: Final[Nanos] = 100 * MILLISECOND
"""What the control says is heard at most so long after it said it, by way of a serial server and a busy computer: what
had left earlier than that was with the control when it said it."""


HEARD_LATE_CHARACTERS: Final = 16
"""On a slow line it takes longer: two codes cross it, a receive FIFO at either end waits four character times for a
fifth, and what is being said is finished first; at 1200 baud servers and computers add as much as five characters."""

SLOWEST: Final[Nanos] = 220 * MILLISECOND
"""A character at 50 baud, the least of 5083 (10.2). Slower than that something held the line: not its pace."""


PACED_CHARACTERS: Final = 8
"""The pace of a line is taken over so many characters at least."""


class Delivery:
    """The characters of one job. `stale` are characters of an earlier one that are still on their way."""

    def __init__(self, stale: int = 0) -> None:
        self._stale = stale
        self._left_at: Nanos = 0
        self._log: deque[tuple[Nanos, int]] = deque()
        self._step: Nanos = 0
        self._pace: Nanos = 0
        self._paced_from: tuple[Nanos, int] | None = None
        self.sent = 0
        """Handed over to the line and not called back."""
        self.in_flight = 0
        """Of these, not yet left."""

    @property
    def on_the_way(self) -> int:
        """Everything in flight: `stale` for the job that follows."""
        return self.in_flight + self._stale

    def hand_over(self, count: int) -> None:
        self.sent += count
        self.in_flight += count

    def leave(self, count: int, now: Nanos) -> None:
        stale = min(count, self._stale)
        self._stale -= stale
        self.in_flight -= count - stale
        if not self.in_flight:
            self._left_at = now
        if self._log and count and now > self._log[-1][0]:
            step = min(SLOWEST, (now - self._log[-1][0]) // count)
            self._step = min(self._step or step, step)
        self._measure(now, self.sent - self.in_flight)
        self._log.append((now, self.sent - self.in_flight))
        heard = now - self.heard_late
        while len(self._log) > 1 and self._log[1][0] <= heard:
            self._log.popleft()

    def _measure(self, now: Nanos, left: int) -> None:
        """A computer that is late tells of one character right behind another: over some the pace of the line shows."""
        since, before = self._paced_from or (now, left)
        if self._paced_from is None or left - before >= PACED_CHARACTERS:
            self._paced_from = now, left
        if left - before >= PACED_CHARACTERS:
            pace = (now - since) // (left - before)
            self._pace = min(self._pace or pace, pace)

    def call_back(self, count: int) -> None:
        own = min(count, self.in_flight)
        self._stale -= count - own
        self.sent -= own
        self.in_flight -= own

    def certain(self, now: Nanos) -> int:
        """Characters the control certainly had when it said what is heard at `now`."""
        heard = now - self.heard_late
        certain = [left for at, left in self._log if at <= heard]
        return certain[-1] if certain else 0

    @property
    def heard_late(self) -> Nanos:
        """How late what the control says may be heard. What leaves one after the other shows how long a character takes
        on this line. A pause in all that has left so far makes it longer than it is, and less certain.
        """
        pace = min(self._pace or self._step, SLOWEST)
        return max(HEARD_LATE, HEARD_LATE_CHARACTERS * pace)
