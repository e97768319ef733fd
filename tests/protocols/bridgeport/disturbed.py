"""A line that disturbs one character."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tapewire.engine import Nanos, SignalsOut
from tapewire.line.transport import LineItem, StopDistance, Transport


class Disturbed:
    """A line that does something once to the character at `position` of what comes in. A Transport."""

    def __init__(self, line: Transport, position: int, act: Callable[[int], LineItem]) -> None:
        self._line = line
        self._left = position
        self._act = act
        self.done = False

    def read(self, now: Nanos) -> list[LineItem]:
        return [piece for item in self._line.read(now) for piece in self._pass(item)]

    def _pass(self, item: LineItem) -> Iterator[LineItem]:
        if self.done or not isinstance(item, bytes):
            yield item
        elif len(item) <= self._left:
            self._left -= len(item)
            yield item
        else:
            self.done = True
            yield item[: self._left]
            yield self._act(item[self._left])
            yield item[self._left + 1 :]

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
