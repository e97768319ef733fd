"""How much of the line a transfer used: characters over the time in which it was free to use it."""

from __future__ import annotations

from tapewire.engine import SECOND, Nanos

__all__ = ["Meter"]


class Meter:
    """Counts characters and time, leaving out the time held and the first window, which only fills the line.

    `character` is the time of one character on the line in ns, `window` the characters of the first fill.
    """

    def __init__(self, character: Nanos, window: int) -> None:
        self.character = character
        self._window = window
        self._characters = 0
        self._began: Nanos | None = None
        self._base = 0
        self._held_since: Nanos | None = None
        self._held: Nanos = 0
        self._last: Nanos = 0

    @property
    def held(self) -> bool:
        return self._held_since is not None

    def count(self, characters: int, now: Nanos) -> None:
        """`characters` is how many have been handed over by `now`."""
        if characters == self._characters:
            return
        self._characters = characters
        if self._began is None and characters > self._window:
            self._began, self._base, self._held = now, characters, 0
        self._last = now

    def hold(self, in_flight: int, now: Nanos) -> None:
        """Stopped by the other side. What is in flight still uses the line; only then is it held."""
        if self._held_since is None:
            self._held_since = now + in_flight * self.character

    def resume(self, now: Nanos) -> None:
        if self._held_since is not None:
            self._held += max(0, now - self._held_since)
            self._held_since = None

    @property
    def _free(self) -> Nanos:
        return 0 if self._began is None else self._last - self._began - self._held

    @property
    def rate(self) -> float:
        """Characters a second over the time not held; 0 before there is anything to say."""
        return (self._characters - self._base) * SECOND / self._free if self._free > 0 else 0.0

    @property
    def utilisation(self) -> float | None:
        """Share of the line's capacity used over the time not held, from the first window on."""
        if self._free < 10 * self._window * self.character:
            return None
        return (self._characters - self._base) * self.character / self._free
