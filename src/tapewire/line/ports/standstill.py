"""A transmitter that holds characters and sends none: a hung adapter, a driver that has lost its device."""

from __future__ import annotations

from typing import Final

from tapewire.engine import SECOND, Nanos

__all__ = ["STANDSTILL", "Standstill"]

STANDSTILL: Final[Nanos] = 10 * SECOND
"""After so long without one character sent the transmitter counts as gone. At 50 baud one takes 0.22 s; nothing that
this computer switches on may hold it longer, since both flow controls of the driver are off."""


class Standstill:
    """Watches what a transmitter was given and what it still holds."""

    __slots__ = ("_given", "_left", "_since")

    def __init__(self) -> None:
        self._given = 0
        self._left = 0
        self._since: Nanos | None = None

    def hand_over(self, count: int) -> None:
        self._given += count

    def call_back(self, count: int) -> None:
        self._given -= count

    def lasts(self, held: int, now: Nanos) -> Nanos:
        """How long nothing has left although `held` characters are there; 0 while all is well."""
        left = self._given - held
        if not held or left != self._left or self._since is None:
            self._left, self._since = left, now
        return now - self._since
