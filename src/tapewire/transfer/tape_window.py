"""The blocks around the one under execution, as a control's screen shows them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

__all__ = ["Block", "TapeWindow"]

MOST_BLOCKS: Final = 600
"""The control takes 256 characters ahead, which are 256 blocks at most; the rest is what was executed last."""

SHOWN_BYTES: Final = 256
"""What is kept of a longer block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """One block without its EOB. It stands on the tape from byte `begin` up to `end`, its EOB included."""

    begin: int
    end: int
    data: bytes
    is_whole: bool = True
    """Its EOB is there."""


class TapeWindow:
    """Takes a program as it comes, the first byte being number `first`, and keeps the last blocks of it."""

    def __init__(self, eob: bytes, first: int) -> None:
        self._eob = eob
        self._begin = self._end = first
        self._rest = b""
        self._blocks: deque[Block] = deque(maxlen=MOST_BLOCKS)

    def write(self, data: bytes) -> None:
        """More of the program."""
        *whole, rest = (self._rest + data).split(self._eob)
        at = self._end - len(self._rest)
        self._end += len(data)
        for block in whole:
            at += len(block) + len(self._eob)
            self._blocks.append(Block(begin=self._begin, end=at, data=block[:SHOWN_BYTES]))
            self._begin = at
        self._rest = rest[:SHOWN_BYTES] + rest[-len(self._eob) :] if len(rest) > 2 * SHOWN_BYTES else rest

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The oldest first; the last one may be unfinished."""
        if not self._rest:
            return tuple(self._blocks)
        unfinished = Block(begin=self._begin, end=self._end, data=self._rest[:SHOWN_BYTES], is_whole=False)
        return (*self._blocks, unfinished)

    def index_at(self, position: int) -> int | None:
        """Which of `blocks` holds byte `position`."""
        return next((n for n, block in enumerate(self.blocks) if block.begin <= position < block.end), None)
