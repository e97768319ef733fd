"""A line that goes and comes back: what waits for it, and what never does.

A job that has begun ends with its line and is not continued by anybody but a person. What has not begun has nothing
that could be continued wrongly: a command that was told to wait opens the line anew, by the same name, when it is back.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from enum import StrEnum
from typing import Final

from tapewire.engine import SECOND, Nanos
from tapewire.errors import LineError
from tapewire.line.descriptor import DescriptorLine

__all__ = ["Losses", "WhenLost", "open_when_back"]

STEADY: Final[Nanos] = 5 * SECOND
"""A line that goes again sooner than this, and for the same reason, has not really been back."""

REOPEN_PAUSE_S: Final = 0.5
"""How often a line that is gone is looked for. A USB adapter takes a second or two until its name is there again."""


class WhenLost(StrEnum):
    """What becomes of a command whose line is lost before anything has begun on it."""

    END = "end"
    WAIT = "wait"


class Losses:
    """Which losses of a line are news: not the same again of one that hardly stays."""

    def __init__(self) -> None:
        self._last = ""
        self._at: Nanos = 0

    def is_news(self, reason: str, now: Nanos) -> bool:
        again = reason == self._last and now - self._at < STEADY
        self._last, self._at = reason, now
        return not again


async def open_when_back(
    opening: Callable[[], Awaitable[DescriptorLine]], tell: Callable[[str], object]
) -> DescriptorLine:
    """Try `opening` again and again until the line is there; `tell` gets each new reason why it is not.

    Nothing that a line can be refused for ends the waiting: a serial server that restarts hangs up at first, and an
    adapter in another socket may be held by another program for a while. A person reads the reasons.
    """
    last = ""
    while True:
        await asyncio.sleep(REOPEN_PAUSE_S)
        try:
            return await opening()
        except LineError as error:
            if str(error) != last:
                last = str(error)
                tell(f"not yet: {last}")
