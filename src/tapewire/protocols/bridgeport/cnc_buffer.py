"""What the control holds of a program that comes in, and how it counts what comes when it has said stop."""

from __future__ import annotations

import re
from typing import Final

from tapewire.codes import CR, LF, TAB
from tapewire.protocols.bridgeport.messages import STOP_CHARACTERS, TapeEnd

__all__ = ["Latecomers", "StopCount", "TapeEndFinder", "TextBuffer", "strange_characters"]

_PROGRAM: Final = bytes((*range(0x20, 0x7F), CR, LF, TAB))

_M02_OR_M30: Final = re.compile(rb"M(?:30|0?2)(?![0-9])")
_BLOCK_BYTES: Final = 256
"""More of a block than this is not searched for its M02 or M30."""


def strange_characters(text: bytes) -> int:
    """How many characters of `text` no program holds: neither printable nor a line end or TAB."""
    return len(text.translate(None, _PROGRAM))


class TextBuffer:
    """The text of one program between the line and the control."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._text = bytearray()
        self.received = 0
        """Characters stored."""
        self.taken = 0
        """Those that the control has taken out."""

    def __len__(self) -> int:
        return len(self._text)

    @property
    def free(self) -> int:
        return self._capacity - len(self._text)

    def store(self, text: bytes) -> None:
        self._text += text
        self.received += len(text)

    def take(self, count: int) -> bytes:
        text = bytes(self._text[:count])
        del self._text[:count]
        self.taken += len(text)
        return text

    def clear(self) -> None:
        self._text.clear()


class StopCount:
    """Characters that come after a DC3 has left completely: at most three (3.2)."""

    def __init__(self) -> None:
        self.active = False
        """The remote is to wait: DC3 was said, or is about to be."""
        self.count = 0
        self._dc3_at: int | None = None

    def begin(self) -> None:
        self.active = True
        self.count = 0
        self._dc3_at = None

    def dc3_handed_over(self, position: int) -> None:
        self._dc3_at = position

    def end(self) -> None:
        self.active = False

    def character_came(self, left: int) -> bool:
        """`left` characters have left the line. True: this one is more than the three of 3.2."""
        if not self.active or self._dc3_at is None or left < self._dc3_at:
            return False
        self.count += 1
        return self.count > STOP_CHARACTERS


class Latecomers:
    """Characters that nobody reads any more. 3.2 lets three of them come when a job has ended.

    What comes before a cancel has left is not counted: the remote cannot know.
    """

    def __init__(self, allowed: int = 0) -> None:
        self._left = allowed
        self.seen = False

    def may_come(self, *, job_over: bool) -> bool:
        """One more comes."""
        if job_over:
            self._left -= 1
        return not job_over or self._left >= 0


class TapeEndFinder:
    """The end of a load without a name from a tape that has no EOT punched, which the text leaves open."""

    def __init__(self, end: TapeEnd) -> None:
        self._end = end
        self._block = bytearray()
        self._begun = False

    def is_last(self, character: int) -> bool:
        """`character` of the text, each given once and in order, is the last of the program."""
        match self._end:
            case TapeEnd.PERCENT:
                begun, self._begun = self._begun, self._begun or character not in b"\r\n\t "
                return begun and character == ord("%")
            case TapeEnd.M30:
                return self._ends_block(character)
            case TapeEnd.EOT:
                return False

    def _ends_block(self, character: int) -> bool:
        if character != LF:
            if len(self._block) < _BLOCK_BYTES:
                self._block.append(character)
            return False
        found = _M02_OR_M30.search(self._block)
        self._block.clear()
        return found is not None
