"""Characters on their way out of the remote buffer, with the gaps of Ti between them (B-63322EN-1 4.3 (2))."""

from __future__ import annotations

__all__ = ["Sender"]


class Sender:
    """What is to be said, and how much of it has physically left.

    With gaps each character is offered alone: the one before it has left, and the gap has passed.
    """

    def __init__(self) -> None:
        self._out = bytearray()
        self._handed = 0
        self._left = 0
        self._gap = False

    def queue(self, data: bytes) -> None:
        self._out += data

    def drop(self) -> None:
        """What has not been handed over is not said."""
        self._out.clear()
        self._gap = False

    @property
    def busy(self) -> bool:
        """Something is still to be handed over."""
        return bool(self._out)

    @property
    def in_line(self) -> int:
        """Characters handed over that have not left."""
        return self._handed - self._left

    def look(self, limit: int, gaps: bool) -> bytes:
        if not gaps:
            return bytes(self._out[:limit])
        return b"" if self._gap else bytes(self._out[:1])

    def sent(self, count: int, gaps: bool) -> None:
        assert count <= len(self._out)
        del self._out[:count]
        self._handed += count
        self._gap = gaps

    def left(self, count: int) -> bool:
        """`count` more characters have left. True when nothing is in the line any more: a gap begins here."""
        self._left = min(self._left + count, self._handed)
        return self._left == self._handed

    def discarded(self, count: int) -> None:
        self._handed -= min(count, self.in_line)

    def gap_over(self) -> None:
        self._gap = False
