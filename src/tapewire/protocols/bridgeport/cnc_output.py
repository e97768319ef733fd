"""What the control's end of REMOTE LOAD and DNC LINK has to say, and how much of it has left."""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import Final

from tapewire.protocols.bridgeport.code_table import SEVEN_BITS
from tapewire.protocols.bridgeport.messages import Parity, on_the_wire

__all__ = ["Mark", "Output"]

_SEVEN_BITS: Final = bytes(byte & SEVEN_BITS for byte in range(256))


class Mark(Enum):
    """Characters whose handing over matters to the engine."""

    OPEN = "DC2"
    REQUEST = "the request, or the request again"
    STOP = "DC3"
    GO = "the DC1 that resumes"
    ANSWER = "ACK or NAK"


class Output:
    """What goes to the line: codes and names, and behind them the text of a program that is saved.

    Positions count every character handed over since the line was opened. Everything goes out as seven bits, under
    an even parity bit where software makes it.
    """

    def __init__(self, parity: Parity) -> None:
        self._form = on_the_wire(_SEVEN_BITS, parity)
        self._waiting: deque[tuple[int, Mark | None]] = deque()
        self.chunk = b""
        """Text read from the source, not handed over yet."""
        self.saved = 0
        """Characters of this text handed over."""
        self.handed = 0
        self.left = 0
        self._code_at = 0
        self._text_at = 0

    def say(self, codes: bytes, mark: Mark | None = None) -> None:
        """`mark` stands at the last of `codes`."""
        self._waiting.extend((code, None) for code in codes[:-1])
        self._waiting.extend((code, mark) for code in codes[-1:])

    def waits(self, mark: Mark) -> bool:
        return any(mark is other for _, other in self._waiting)

    def withdraw(self, mark: Mark) -> bool:
        """Do not say what has `mark` after all; False if it was handed over already."""
        for entry in self._waiting:
            if entry[1] is mark:
                self._waiting.remove(entry)
                return True
        return False

    @property
    def saved_left(self) -> int:
        """Characters of this text that have left."""
        return min(max(self.left - self._text_at, 0), self.saved)

    @property
    def in_flight(self) -> int:
        """Characters handed over that have not left."""
        return self.handed - self.left

    @property
    def text_in_flight(self) -> bool:
        return self.saved_left < self.saved

    @property
    def has_codes(self) -> bool:
        return bool(self._waiting)

    @property
    def codes_have_left(self) -> bool:
        return not self._waiting and self.left >= self._code_at

    def look(self, limit: int, text: int) -> bytes:
        """The next characters: the codes, or at most `text` characters of text."""
        if self._waiting:
            codes = bytes(code for code, _ in self._waiting)[:limit]
            return codes.translate(self._form)
        return self.chunk[: min(limit, text)].translate(self._form)

    def hand_over_code(self) -> Mark | None:
        self.handed += 1
        self._code_at = self.handed
        return self._waiting.popleft()[1]

    def hand_over_text(self, count: int) -> None:
        assert count <= len(self.chunk)
        if not self.saved:
            self._text_at = self.handed
        self.chunk = self.chunk[count:]
        self.handed += count
        self.saved += count

    def leave(self, count: int) -> None:
        self.left = min(self.left + count, self.handed)

    def call_back(self, count: int) -> None:
        """The last `count` characters never leave."""
        self.handed = max(self.left, self.handed - count)
        self.saved = min(self.saved, max(self.handed - self._text_at, 0))
        self._code_at = min(self._code_at, self.handed)

    def drop_codes(self) -> None:
        """What still waits is not said."""
        self._waiting.clear()

    def abandon(self) -> None:
        """The line is gone: nothing more is said, and nothing is waited for."""
        self._waiting.clear()
        self._code_at = 0
