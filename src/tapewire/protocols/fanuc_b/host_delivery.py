"""What the host of protocol B has still to send, and what it can conclude from how much it has sent: can this DC3 be a
stop, is it the end?
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import SECOND, Nanos, Source
from tapewire.protocols import delivery
from tapewire.protocols.delivery import HEARD_LATE
from tapewire.protocols.fanuc_b.messages import Limits

__all__ = ["HEARD_LATE", "Delivery", "Supply"]

LOOK_AHEAD: Final = 4096
"""Bytes of the program taken from its source before the line asks for them."""

LEVEL_DELAY: Final[Nanos] = SECOND
"""A DC3 that stops us is drawn by a character that comes in: so long after the last one it can only be the end."""


class Delivery(delivery.Delivery):
    """The bytes of one job. `stale` are characters of an earlier one that are still on their way."""

    def __init__(self, limits: Limits, stale: int = 0) -> None:
        super().__init__(stale)
        self._limits = limits
        self._at_dc1 = 0
        self._resumed = False
        self._began: Nanos = 0
        self._may_be_over_since: Nanos | None = None

    def start(self, now: Nanos) -> None:
        """The control sent the DC1 that starts, or resumes when something has been sent."""
        if not self.sent:
            self._began = now
        self._resumed = self.sent > 0
        self._at_dc1 = self.sent - self.in_flight
        self.goes_on()

    @property
    def may_have_filled_the_buffer(self) -> bool:
        """Enough has come since the last DC1 for a DC3 to be a stop (6.3)."""
        least = self._limits.next_stop if self._resumed else self._limits.first_stop
        return self.sent - self._at_dc1 >= least

    def may_be_over(self, now: Nanos) -> None:
        """The control may have ended what it does, by a damaged character or ER: what it says later proves no more, but
        for a DC1.
        """
        if self._may_be_over_since is None:
            self._may_be_over_since = now

    def goes_on(self) -> None:
        """DC1: it has not ended."""
        self._may_be_over_since = None

    def certain(self, now: Nanos) -> int:
        since = self._may_be_over_since
        return super().certain(now if since is None else min(now, since))

    def has_arrived(self, now: Nanos) -> bool:
        """The control had everything when it said what is heard at `now`."""
        return self.certain(now) == self.sent

    def is_past_beginning(self, now: Nanos) -> bool:
        """A control line that changes now is not the late one of the start."""
        return now - self._began > HEARD_LATE

    def long_silent(self, now: Nanos) -> bool:
        """Nothing has left for so long that a DC3 heard now cannot be a stop."""
        return not self.in_flight and now - self._left_at > max(LEVEL_DELAY, self.heard_late)


class Supply:
    """The rest of a program, a little of it at hand. Without a source there is none, and none is to come."""

    def __init__(self, source: Source | None) -> None:
        self._source = source
        self.ahead = b""

    @property
    def is_over(self) -> bool:
        return self._source is None and not self.ahead

    def fill(self) -> bool:
        """Ask the source when nothing is at hand. False: it has nothing yet."""
        if self._source is None or self.ahead:
            return True
        data = self._source.read(LOOK_AHEAD)
        if data is None:
            return False
        self.ahead = data
        if not data:
            self._source = None
        return True

    def take(self, count: int) -> None:
        self.ahead = self.ahead[count:]
