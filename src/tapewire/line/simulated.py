"""A serial cable in memory: two ends, a baud rate, a UART FIFO at each, control lines, and no clock of its own.

A character handed over waits in the sender's queue, enters its FIFO, and arrives whole at the other end one character
time after the one before it. What has entered the FIFO cannot be called back. Characters that have arrived are
reported in groups of at most `grain`, as a UART with a receive trigger does: the group is passed on when it is full or
when nothing is behind it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from tapewire.engine import Closure, Nanos, SignalsIn, SignalsOut
from tapewire.line.pacing import TxPacer, character_time
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance

__all__ = ["CableEnd", "EndSettings", "simulated_cable"]

UART_FIFO: Final = 16
"""Characters in the transmit FIFO of a 16550."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EndSettings:
    """One end of a simulated cable."""

    window: int
    """Characters this end allows itself in flight."""
    fifo: int = UART_FIFO
    """Characters of these that can no longer be called back."""
    grain: int = 1
    """Received characters reported at once."""


@dataclass(slots=True)
class _Segment:
    """Characters that left without a gap: character i has arrived at `first` + i character times."""

    first: Nanos
    data: bytes
    taken: int = 0


class CableEnd:
    """One end of a simulated cable; a Transport."""

    def __init__(self, settings: EndSettings, character: Nanos, latency: Nanos, has_signals: bool) -> None:
        self.peer: CableEnd
        self._settings = settings
        self._character = character
        self._latency = latency
        self._has_signals = has_signals
        self._tx = TxPacer(character, settings.window)
        self._arriving: deque[_Segment] = deque()
        self._marks: deque[tuple[Nanos, SignalsIn | Closed | Fault]] = deque()
        self._now: Nanos = 0
        self._cts = True
        self._signals_seen = SignalsIn(cts=False, dsr=False, cd=False)
        self._closed = False
        if has_signals:
            self._marks.append((0, self._signals_seen))

    def read(self, now: Nanos) -> list[LineItem]:
        self._now = now
        items: list[LineItem] = []
        while self._marks and self._marks[0][0] <= now:
            at, mark = self._marks.popleft()
            self._take_arrived(items, at)
            if isinstance(mark, SignalsIn):
                self._cts = mark.cts
            items.append(mark)
        self._take_arrived(items, now)
        return items

    def _take_arrived(self, items: list[LineItem], until: Nanos) -> None:
        arrived = bytearray()
        while self._arriving and (segment := self._arriving[0]).first <= until:
            count = min((until - segment.first) // self._character + 1, len(segment.data))
            arrived += segment.data[segment.taken : count]
            segment.taken = count
            if count < len(segment.data):
                break
            self._arriving.popleft()
        if arrived:
            items.append(bytes(arrived))

    def room(self, now: Nanos) -> int:
        self._now = now
        return self._tx.room(now) if self._cts and not self._closed else 0

    def write(self, data: bytes, now: Nanos) -> None:
        begins = self._tx.hand_over(len(data), now)
        self.peer._arriving.append(_Segment(begins + self._character + self._latency, data))

    def in_flight(self, now: Nanos) -> int:
        return self._tx.in_flight(now)

    def on_its_way(self, now: Nanos) -> int:
        return self._tx.in_flight(now)

    def discard(self, now: Nanos) -> int:
        count = recalled = max(0, self._tx.in_flight(now) - self._settings.fifo)
        self._tx.call_back(recalled)
        arriving = self.peer._arriving
        while count:
            segment = arriving[-1]
            waiting = len(segment.data) - segment.taken
            if waiting > count:
                segment.data = segment.data[:-count]
                break
            arriving.pop()
            count -= waiting
        return recalled

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        """The cross connection of B-63322EN-1 3.2: RTS to CTS, DTR to DSR, and the peer's CD strapped to DTR."""
        seen = SignalsIn(cts=signals.rts, dsr=signals.dtr, cd=signals.dtr)
        peer = self.peer
        if self._has_signals and seen != peer._signals_seen:
            peer._signals_seen = seen
            peer._marks.append((now + self._latency, seen))

    def next_deadline(self) -> Nanos | None:
        moments = [self._tx.next_deadline(self._now)]
        if self._marks:
            moments.append(self._marks[0][0])
        if self._arriving:
            segment = self._arriving[0]
            group = min(segment.taken + self._settings.grain, len(segment.data))
            moments.append(segment.first + (group - 1) * self._character)
        return min((moment for moment in moments if moment is not None), default=None)

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(
            characters=self._settings.window, guaranteed=True, how="simulated UART, counted by the character"
        )

    def close(self, now: Nanos) -> None:
        """What has been handed over still arrives; then the other end sees the signals fall and the line closed."""
        if self._closed:
            return
        self._closed = True
        self.set_signals(SignalsOut(rts=False, dtr=False), now)
        gone = max(now, self._tx.free_at or now) + self._latency
        self.peer._marks.append((gone, Closed(closure=Closure.ORDERLY, reason="the other end closed the line")))


def simulated_cable(
    baud: int,
    near: EndSettings,
    far: EndSettings,
    *,
    latency: Nanos = 0,
    has_signals: bool = True,
) -> tuple[CableEnd, CableEnd]:
    """Two ends of one cable at `baud`, 11 bits a character, `latency` ns longer than the characters themselves take.

    Without signals it is a line as TCP gives it: only characters, and nothing that says so.
    """
    character = character_time(baud)
    ends = (
        CableEnd(near, character, latency, has_signals),
        CableEnd(far, character, latency, has_signals),
    )
    ends[0].peer, ends[1].peer = ends[1], ends[0]
    return ends
