"""A line that goes and comes back: what waits for it, and what never does.

A job that has begun ends with its line and is not continued by anybody but a person. What has not begun has nothing
that could be continued wrongly: a command that was told to wait opens the line anew, by the same name, when it is back.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from enum import StrEnum
from typing import Final

from tapewire.errors import LineBusy, LineNotFound
from tapewire.line.descriptor import DescriptorLine

__all__ = ["WhenLost", "open_when_back"]

REOPEN_PAUSE_S: Final = 0.5
"""How often a line that is gone is looked for. A USB adapter takes a second or two until its name is there again."""


class WhenLost(StrEnum):
    """What becomes of a command whose line is lost before anything has begun on it."""

    END = "end"
    WAIT = "wait"


async def open_when_back(opening: Callable[[], Awaitable[DescriptorLine]]) -> DescriptorLine:
    """Try `opening` until the line is there and nobody else holds it. What can never be mended by waiting is raised:
    a rate the port does not make, a path that is no port.
    """
    while True:
        try:
            return await opening()
        except (LineNotFound, LineBusy):
            await asyncio.sleep(REOPEN_PAUSE_S)
