"""The end of a capture as the troubleshooting procedure takes it."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Final

from tapewire.errors import UsageError
from tapewire.fanuc.diagnosis import From, Heard
from tapewire.line.captures.reader import Packet, read_capture
from tapewire.line.captures.records import Happening, Side
from tapewire.transfer.files import why

__all__ = ["heard_in"]

LATEST: Final = 10_000
"""Pieces that are kept: the end of a recording says why an operation stands still."""

_SENT: Final = (Happening.SENT, Happening.SENT_ALL)
_RECEIVED: Final = (Happening.RECEIVED, Happening.RECEIVED_ALL)


def heard_in(path: Path) -> tuple[Heard, ...]:
    """The latest pieces of the capture at `path`. One that does not say who wrote it is the host's.

    Raises UsageError for a file that cannot be read or holds nothing that was said on a serial line.
    """
    latest: deque[Heard] = deque(maxlen=LATEST)
    try:
        with path.open("rb") as file:
            for item in read_capture(file):
                if isinstance(item, Packet) and item.record.data:
                    latest.extend(_heard(item))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({why(error)})") from None
    if not latest:
        raise UsageError(f"{path}: holds nothing that was said on a serial line; a capture (pcapng) is expected")
    return tuple(latest)


def _heard(packet: Packet) -> list[Heard]:
    side = packet.origin.side or Side.HOST
    record = packet.record
    if record.what in _RECEIVED:
        side = side.other
    elif record.what not in _SENT:
        return []
    who = From.HOST if side is Side.HOST else From.CONTROL
    return [Heard(record.at, who, record.data)]
