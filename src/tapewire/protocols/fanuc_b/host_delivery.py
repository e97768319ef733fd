"""What the host of protocol B can know about where its bytes are: handed over, on their way, with the control.

Protocol B acknowledges nothing. All there is are counts and moments, and what they prove is kept here.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.protocols.fanuc_b.messages import Limits

__all__ = ["Delivery"]

HEARD_LATE: Final[Nanos] = 100 * MILLISECOND
"""What the control says is heard at most so long after it said it, by way of a serial server and a busy computer: what
had left earlier than that was with the control when it said it."""

LEVEL_DELAY: Final[Nanos] = SECOND
"""A DC3 that stops us is drawn by a character that comes in: so long after the last one it can only be the end."""


class Delivery:
    """The bytes of one job. `stale` are characters of an earlier one that are still on their way."""

    def __init__(self, limits: Limits, stale: int = 0) -> None:
        self._limits = limits
        self._stale = stale
        self._at_dc1 = 0
        self._resumed = False
        self._left_at: Nanos = 0
        self._log: deque[tuple[Nanos, int]] = deque()
        self.sent = 0
        """Handed over to the line and not called back."""
        self.in_flight = 0
        """Of these, not yet left."""

    def hand_over(self, count: int) -> None:
        self.sent += count
        self.in_flight += count

    def leave(self, count: int, now: Nanos) -> None:
        stale = min(count, self._stale)
        self._stale -= stale
        self.in_flight -= count - stale
        if not self.in_flight:
            self._left_at = now
        self._log.append((now, self.sent - self.in_flight))
        while len(self._log) > 1 and self._log[1][0] <= now - HEARD_LATE:
            self._log.popleft()

    def call_back(self, count: int) -> None:
        self.sent -= count
        self.in_flight -= count

    def start(self) -> None:
        """The control sent the DC1 that starts, or resumes when something has been sent."""
        self._resumed = self.sent > 0
        self._at_dc1 = self.sent

    @property
    def may_have_filled_the_buffer(self) -> bool:
        """Enough has been sent since the last DC1 for a DC3 to be a stop (6.3)."""
        least = self._limits.next_stop if self._resumed else self._limits.first_stop
        return self.sent - self._at_dc1 >= least

    def long_silent(self, now: Nanos) -> bool:
        """Nothing has left for so long that a DC3 heard now cannot be a stop."""
        return not self.in_flight and now - self._left_at > LEVEL_DELAY

    def certain(self, now: Nanos) -> int:
        """Bytes the control certainly had when it said what is heard at `now`."""
        certain = [left for at, left in self._log if at <= now - HEARD_LATE]
        return certain[-1] if certain else 0
