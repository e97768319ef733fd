"""One fault at one place of a simulated line: the k-th character that comes in at an end is lost, or spoilt."""

from __future__ import annotations

from collections.abc import Callable

from tapewire.engine import Nanos, SignalsOut
from tapewire.line.transport import Fault, LineItem, StopDistance, Transport

Spoil = Callable[[int], bytes]
"""What arrives instead of a character."""


def lost(byte: int) -> bytes:
    return b""


def flipped(byte: int) -> bytes:
    """The lowest bit turned: for most characters of these protocols still a character."""
    return bytes([byte ^ 1])


class FaultyEnd:
    """An end of a line where the character number `at` (from 0) arrives as `spoil` has it."""

    def __init__(self, line: Transport, at: int | None, spoil: Spoil = lost) -> None:
        self._line = line
        self._at = at
        self._spoil = spoil
        self.received = 0
        self.struck = False

    def read(self, now: Nanos) -> list[LineItem]:
        items: list[LineItem] = []
        for item in self._line.read(now):
            came = self._strike(item) if isinstance(item, bytes) else item
            self.received += isinstance(item, Fault)
            if came != b"":
                items.append(came)
        return items

    def _strike(self, data: bytes) -> bytes:
        at = None if self._at is None else self._at - self.received
        self.received += len(data)
        if at is None or not 0 <= at < len(data):
            return data
        self.struck = True
        return data[:at] + self._spoil(data[at]) + data[at + 1 :]

    def room(self, now: Nanos) -> int:
        return self._line.room(now)

    def write(self, data: bytes, now: Nanos) -> None:
        self._line.write(data, now)

    def in_flight(self, now: Nanos) -> int:
        return self._line.in_flight(now)

    def on_its_way(self, now: Nanos) -> int:
        return self._line.on_its_way(now)

    def discard(self, now: Nanos) -> int:
        return self._line.discard(now)

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        self._line.set_signals(signals, now)

    def next_deadline(self) -> Nanos | None:
        return self._line.next_deadline()

    @property
    def stop_distance(self) -> StopDistance:
        return self._line.stop_distance

    def close(self, now: Nanos) -> None:
        self._line.close(now)
