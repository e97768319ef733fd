"""Busy control while a DAT comes in: RS, and the No bytes that may still come after it (B-63322EN-1 4.3 (5))."""

from __future__ import annotations

from tapewire.engine import AfterStop, Events
from tapewire.protocols.fanuc_a.status import Parameters

__all__ = ["Room"]


class Room:
    """Watches one message at a time.

    RS goes OFF when what is free has come down to No, so that No bytes still fit, and ON again when more than Nb is
    free, as for GTD: the manual gives neither level.
    """

    def __init__(self, events: Events) -> None:
        self._events = events
        self.rs_on = True
        self.overran = False
        """More than No bytes came after RS OFF: the message is lost."""
        self._length = 0
        self._stopped_at = 0
        self._allowed = 0

    def heard(self, length: int, free: int, parameters: Parameters) -> None:
        """The message holds `length` bytes of data so far, and `free` bytes were free when it began."""
        if self.overran:
            return
        self._length = length
        limit = max(free - parameters.no, 0)
        if self.rs_on and length >= limit:
            self.rs_on = False
            self._stopped_at = limit
            self._allowed = parameters.no
        if not self.rs_on and length - self._stopped_at > self._allowed:
            self.overran = True
            self._resume()

    def freed(self, free: int, parameters: Parameters) -> bool:
        """The control has taken something out of the buffer. True when RS goes ON."""
        if self.rs_on or free - self._length <= parameters.nb:
            return False
        self._resume()
        return True

    def end(self) -> None:
        """The message is over, or nobody waits for it any more."""
        if not self.rs_on:
            self._resume()
        self.overran = False
        self._length = 0

    def _resume(self) -> None:
        self.rs_on = True
        self._events.put(AfterStop(count=self._length - self._stopped_at, allowed=self._allowed))
