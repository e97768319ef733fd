"""Damaged characters as a terminal marks them among the others (PARMRK), and which damage it was.

A mark says that a character came damaged, not how. The driver's counters do: a mark is a parity error, a framing error
or a break by what has been counted since the last one.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import LineFault
from tapewire.line.ports.kernel import Counters
from tapewire.line.transport import Fault

__all__ = ["Damage", "decode_marks"]

MARK: Final = 0xFF

UNEXPLAINED: Final = 64
"""Counted errors kept for marks that have not been read yet."""


def decode_marks(data: bytes) -> tuple[list[bytes | int], bytes]:
    """Take the marks out of `data`: (plain characters, and each damaged character as an int; the beginning of a mark
    that is not complete yet, which goes before the next piece).

    FF FF is the character FF, FF 00 xx the damaged character xx. A break is a damaged NUL. termios(3)
    """
    if MARK not in data:
        return ([data] if data else []), b""
    items: list[bytes | int] = []
    plain = bytearray()
    at = 0
    while (mark := data.find(MARK, at)) >= 0:
        plain += data[at:mark]
        match data[mark : mark + 3]:
            case bytes(sequence) if sequence in (b"\xff", b"\xff\x00"):
                return _with(items, plain), sequence
            case bytes(sequence) if sequence[1] == MARK:
                plain.append(MARK)
                at = mark + 2
            case bytes(sequence) if sequence[1] == 0:
                items = [*_with(items, plain), sequence[2]]
                plain = bytearray()
                at = mark + 3
            case _:
                # Came in before marks were switched on, so it is meant as it is.
                plain.append(MARK)
                at = mark + 1
    plain += data[at:]
    return _with(items, plain), b""


def _with(items: list[bytes | int], plain: bytearray) -> list[bytes | int]:
    return [*items, bytes(plain)] if plain else items


class Damage:
    """Says of each marked character what was wrong with it. `likely` is what it is where no counter tells.

    Counters run ahead of what has been read, so an error is kept until a mark asks for it.
    """

    def __init__(self, likely: LineFault, counters: Counters | None) -> None:
        self._likely = likely
        self._seen = counters
        self._parity = 0
        self._framing = 0
        self._breaks = 0

    def count(self, counters: Counters) -> int:
        """Take the counters as they are now. Returns how many characters were lost since: they have no mark."""
        added = counters.since(self._seen) if self._seen is not None else Counters()
        self._seen = counters
        self._parity = min(self._parity + added.parity, UNEXPLAINED)
        self._framing = min(self._framing + added.framing, UNEXPLAINED)
        self._breaks = min(self._breaks + added.breaks, UNEXPLAINED)
        return added.uart_overrun + added.queue_overrun

    def of(self, byte: int) -> Fault:
        """The fault of one marked character, in the order they are read."""
        counted = self._seen is not None and (self._parity or self._framing or self._breaks)
        if byte == 0 and (self._breaks or not counted):
            self._breaks = max(0, self._breaks - 1)
            return Fault(fault=LineFault.BREAK)
        if self._framing and not self._parity:
            self._framing -= 1
            return Fault(fault=LineFault.FRAMING, byte=byte)
        if self._parity and not self._framing:
            self._parity -= 1
            return Fault(fault=LineFault.PARITY, byte=byte)
        # Both were counted: their order is not known, only their number.
        self._parity = max(0, self._parity - 1)
        return Fault(fault=self._likely, byte=byte)
