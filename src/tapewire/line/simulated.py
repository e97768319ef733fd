"""A serial cable in memory: two ends, a baud rate, what stands between each end and the wire, control lines, faults.

No clock of its own: every moment is handed in. A character handed over waits in the sender's queue, enters its FIFO,
and arrives whole at the other end one character time after the one before it. What has entered the FIFO, an adapter
or a server cannot be called back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tapewire.engine import Closure, Nanos, SignalsIn, SignalsOut
from tapewire.line.faults.injector import Injector, Injectors
from tapewire.line.pacing import BITS_PER_CHARACTER, TxPacer, character_time
from tapewire.line.paths import PathKind
from tapewire.line.reception import Reception
from tapewire.line.transport import Closed, LineItem, StopDistance

__all__ = ["CableEnd", "EndSettings", "simulated_cable"]

UART_FIFO: Final = 16
"""Characters in the transmit FIFO of a 16550."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EndSettings:
    """One end of a simulated cable.

    Without a `path` it is a bare UART that tells what it received as soon as nothing is behind it.
    """

    window: int
    """Characters this end allows itself in flight."""
    fifo: int = UART_FIFO
    """Characters of these that can no longer be called back. Without a path only."""
    grain: int = 1
    """Received characters reported at once. Without a path only."""
    path: PathKind | None = None
    """What stands between this end and the wire."""

    @property
    def path_kind(self) -> PathKind:
        bare = PathKind(name="bare", why="a UART alone", fifo=self.fifo, trigger=self.grain, timeout_characters=0)
        return self.path or bare


class CableEnd:
    """One end of a simulated cable; a Transport."""

    def __init__(
        self,
        settings: EndSettings,
        character: Nanos,
        latency: Nanos,
        has_signals: bool,
        injector: Injector | None = None,
    ) -> None:
        path = settings.path_kind
        self.peer: CableEnd
        self._settings = settings
        self._path = path
        self._character = character
        self._latency = latency
        self._has_signals = has_signals and path.signal_delay is not None
        self._tx = TxPacer(character, settings.window)
        self._wire_free: Nanos = 0
        """When the last character handed over has left the UART."""
        self._reception = Reception(path, character, injector)
        self._now: Nanos = 0
        self._cts = True
        self._signals_seen = SignalsIn(cts=False, dsr=False, cd=False)
        self._closed = False
        if self._has_signals:
            self._reception.mark(0, self._signals_seen)

    def read(self, now: Nanos) -> list[LineItem]:
        self._now = now
        items = self._reception.take(now)
        for item in items:
            if isinstance(item, SignalsIn):
                self._cts = item.cts
        return items

    def room(self, now: Nanos) -> int:
        self._now = now
        return self._tx.room(now) if self._cts and not self._closed else 0

    def write(self, data: bytes, now: Nanos) -> None:
        self._tx.hand_over(len(data), now)
        begins = max(self._reaches_uart(now), self._wire_free)
        self._wire_free = begins + len(data) * self._character
        self.peer._reception.put(begins + self._character + self._latency, data, self._character)

    def _reaches_uart(self, now: Nanos) -> Nanos:
        """When what is handed over at `now` has come through the adapter or the network."""
        path = self._path
        moment = now + path.latency
        return -(-moment // path.poll) * path.poll if path.poll else moment

    def _within_reach(self, now: Nanos) -> int:
        """Characters handed over that can be called back."""
        return max(0, self.peer._reception.on_the_wire(now + self._latency) - self._path.out_of_reach)

    def in_flight(self, now: Nanos) -> int:
        return self._tx.in_flight(now)

    def on_its_way(self, now: Nanos) -> int:
        """A bare UART knows what it holds; a driver knows what it could not yet give to the UART or the adapter."""
        if self._settings.path is None:
            return self._tx.in_flight(now)
        return min(self._tx.in_flight(now), self._within_reach(now))

    def discard(self, now: Nanos) -> int:
        count = self._within_reach(now)
        self._tx.call_back(count)
        self._wire_free -= count * self._character
        self.peer._reception.call_back(count)
        return count

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        """The cross connection of B-63322EN-1 3.2: RTS to CTS, DTR to DSR, and the peer's CD strapped to DTR."""
        seen = SignalsIn(cts=signals.rts, dsr=signals.dtr, cd=signals.dtr)
        peer = self.peer
        delay = self._path.signal_delay
        if peer._has_signals and delay is not None and seen != peer._signals_seen:
            peer._signals_seen = seen
            peer._reception.mark(now + delay + self._latency, seen)

    def next_deadline(self) -> Nanos | None:
        told, sent = self._reception.next_deadline(), self._tx.next_deadline(self._now)
        if told is None or sent is None:
            return sent if told is None else told
        return min(told, sent)

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
        gone = max(now, self._wire_free) + self._latency
        closed = Closed(closure=Closure.ORDERLY, reason="the other end closed the line")
        self.peer._reception.mark(gone, closed)


def simulated_cable(
    baud: int,
    near: EndSettings,
    far: EndSettings,
    *,
    latency: Nanos = 0,
    has_signals: bool = True,
    bits: int = BITS_PER_CHARACTER,
    faults: Injectors | None = None,
) -> tuple[CableEnd, CableEnd]:
    """Two ends of one cable at `baud`, `bits` a character, `latency` ns longer than the characters themselves take.

    Without signals it is a line as TCP gives it: only characters, and nothing that says so. Where there are `faults`,
    the near end is the host's.
    """
    character = character_time(baud, bits)
    ends = (
        CableEnd(near, character, latency, has_signals, faults.from_control if faults else None),
        CableEnd(far, character, latency, has_signals, faults.from_host if faults else None),
    )
    ends[0].peer, ends[1].peer = ends[1], ends[0]
    return ends
