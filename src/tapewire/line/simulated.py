"""A serial cable in memory: two ends, a baud rate, what stands between each end and the wire, control lines, faults.

No clock of its own: every moment is handed in. A character handed over waits in the sender's queue, enters its FIFO,
and arrives whole at the other end one character time after the one before it. What has entered the FIFO, an adapter
or a server cannot be called back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from tapewire.engine import Closure, Nanos, SignalsIn, SignalsOut
from tapewire.errors import UsageError
from tapewire.line.closed_loop import ClosedLoop
from tapewire.line.faults.damage import Parity
from tapewire.line.faults.injector import Injector, Injectors
from tapewire.line.lateness import EARLY
from tapewire.line.pacing import BITS_PER_CHARACTER, Pacing, TxPacer, character_time
from tapewire.line.paths import PathKind, TransmitterEmpty
from tapewire.line.reception import Cut, Reception
from tapewire.line.transport import Closed, LineItem, StopDistance

__all__ = ["CableEnd", "EndSettings", "simulated_cable"]

UART_FIFO: Final = 16
"""Characters in the transmit FIFO of a 16550."""


@dataclass(frozen=True, slots=True)
class _Cable:
    """What both ends have in common."""

    character: Nanos
    latency: Nanos
    has_signals: bool
    bits: int
    parity: Parity


@dataclass(frozen=True, slots=True, kw_only=True)
class EndSettings:
    """One end of a simulated cable. Raises UsageError for a closed loop on a path that cannot be asked.

    Without a `path` it is a bare UART, counted by the character, that tells what it received as soon as nothing is
    behind it.
    """

    window: int
    """Characters this end allows itself in flight; in a closed loop, those it hands over at once."""
    fifo: int = UART_FIFO
    """Characters of these that can no longer be called back. Without a path only."""
    grain: int = 1
    """Received characters reported at once. Without a path only."""
    path: PathKind | None = None
    """What stands between this end and the wire."""
    pacing: Pacing = Pacing.WINDOW
    """In a closed loop the receive FIFO tells of every character: a stop request must not lie in it."""
    early: Nanos = EARLY
    """How long before a transmitter should be empty a closed loop begins to ask."""
    clock_percent: float = 0.0
    """How much faster than its rate this end's UART sends, unknown to whoever paces it."""

    def __post_init__(self) -> None:
        if self.pacing is Pacing.CLOSED_LOOP and self.path_kind.transmitter_empty is not TransmitterEmpty.ASKED:
            raise UsageError(f"{self.path_kind.name} cannot be paced in a closed loop: its transmitter cannot be asked")

    @property
    def path_kind(self) -> PathKind:
        if self.path is None:
            return PathKind(
                name="bare",
                why="a UART alone",
                fifo=self.fifo,
                trigger=self.grain,
                timeout_characters=0,
                transmitter_empty=TransmitterEmpty.ASKED,
            )
        return self.path if self.pacing is Pacing.WINDOW else replace(self.path, trigger=1)


class CableEnd:
    """One end of a simulated cable; a Transport."""

    def __init__(self, settings: EndSettings, cable: _Cable, injector: Injector | None, other: EndSettings) -> None:
        path = settings.path_kind
        self.peer: CableEnd
        self._settings = settings
        self._cable = cable
        self._path = path
        self._out_of_reach = path.out_of_reach
        self._has_signals = cable.has_signals and path.signal_delay is not None
        self._character = round(cable.character / (1 + settings.clock_percent / 100))
        """What one really takes."""
        self._reception = Reception(path, cable.character, injector)
        self._now: Nanos = 0
        self._cts = True
        # A serial server holds its own RTS and DTR ON, whoever is at the other side of the network.
        driven = other.path_kind.signal_delay is not None
        self._signals_seen = SignalsIn(cts=not driven, dsr=not driven, cd=not driven)
        self._closed = False
        self._away = False
        """Nobody works this end: its power is cut, or its program is gone."""
        if self._has_signals:
            self._reception.mark(0, self._signals_seen)
        self._begin()

    def _begin(self) -> None:
        self._tx = TxPacer(self._cable.character, self._settings.window)
        self._loop: ClosedLoop | None = None
        if self._settings.pacing is Pacing.CLOSED_LOOP:
            self._loop = ClosedLoop(self._cable.character, early=self._settings.early)
        self._uart_free: Nanos = 0
        """When the last character handed over has left the UART."""
        self._is_counted = self._settings.path is None and self._loop is None
        """The model of the line is the line."""

    def read(self, now: Nanos) -> list[LineItem]:
        self._now = now
        if self._away:
            return []
        items = self._reception.take(now)
        for item in items:
            if isinstance(item, SignalsIn):
                self._cts = item.cts
        return items

    def room(self, now: Nanos) -> int:
        self._now = now
        if not self._cts or self._closed or self._away:
            return 0
        if self._is_counted:
            return self._tx.room(now)
        return self._tx.offer(self._settings.window - self.in_flight(now))

    def write(self, data: bytes, now: Nanos) -> None:
        self._now = now
        count, character = len(data), self._character
        self._tx.hand_over(count, now)
        if self._loop is not None:
            self._loop.hand_over(count, now)
        begins = max(self._reaches_uart(now), self._uart_free)
        self._uart_free = begins + count * character
        self.peer._reception.put(begins + character + self._cable.latency, data, character)

    def _reaches_uart(self, now: Nanos) -> Nanos:
        """When what is handed over at `now` has come through the adapter or the network."""
        path = self._path
        moment = now + path.latency
        return -(-moment // path.poll) * path.poll if path.poll else moment

    def transmitter_empty(self, now: Nanos) -> bool:
        """The last character has physically left. To be asked only of a path that can be."""
        return now >= self._uart_free

    def _within_reach(self, now: Nanos) -> int:
        """Characters handed over that can be called back."""
        unsent = -(-(self._uart_free - now) // self._character)
        if unsent <= self._out_of_reach:
            return 0
        if not self._path.poll and not self._path.latency:
            return unsent - self._out_of_reach
        return max(0, self.peer._reception.on_the_wire(now + self._cable.latency) - self._out_of_reach)

    def in_flight(self, now: Nanos) -> int:
        if self._loop is not None:
            return self._loop.in_flight(now, lambda: self.transmitter_empty(now))
        by_model = self._tx.in_flight(now)
        return by_model if self._is_counted else max(by_model, self._within_reach(now))

    def on_its_way(self, now: Nanos) -> int:
        """A bare UART knows what it holds; a driver knows what it could not yet give to the UART or the adapter."""
        if self._settings.path is None or self._loop is not None:
            return self.in_flight(now)
        return self._within_reach(now)

    def discard(self, now: Nanos) -> int:
        self._now = now
        count = self._within_reach(now)
        self._tx.call_back(count)
        if self._loop is not None:
            self._loop.call_back(count)
        self._uart_free -= count * self._character
        self.peer._reception.call_back(count)
        return count

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        """The cross connection of B-63322EN-1 3.2: RTS to CTS, DTR to DSR, and the peer's CD strapped to DTR."""
        seen = SignalsIn(cts=signals.rts, dsr=signals.dtr, cd=signals.dtr)
        peer = self.peer
        delay = self._path.signal_delay
        if peer._has_signals and delay is not None and seen != peer._signals_seen:
            peer._signals_seen = seen
            peer._reception.mark(now + delay + self._cable.latency, seen)

    def next_deadline(self) -> Nanos | None:
        if self._away:
            return None
        told = self._reception.next_deadline()
        sent = self._tx.next_deadline(self._now) if self._loop is None else self._loop.next_question(self._now)
        if told is None or sent is None:
            return sent if told is None else told
        return min(told, sent)

    @property
    def stop_distance(self) -> StopDistance:
        return stop_distance_of(self._settings, self._path, self._cable.character)

    def close(self, now: Nanos) -> None:
        """What has been handed over still arrives; then the other end sees the signals fall and the line closed."""
        if self._closed:
            return
        self._closed = True
        self.set_signals(SignalsOut(rts=False, dtr=False), now)
        gone = max(now, self._uart_free) + self._cable.latency
        closed = Closed(closure=Closure.ORDERLY, reason="the other end closed the line")
        self.peer._reception.mark(gone, closed)

    # what happens to the computer or the control at this end

    def cut_power(self, now: Nanos) -> Cut:
        """This end is dead in the middle of what it says, until `restore`; its signals fall.

        What has come as far as a serial server still leaves: that has a power supply of its own.
        """
        self._away = True
        cut = Cut()
        if not self._path.latency:
            cut = self.peer._reception.cut(now + self._cable.latency, self._cable.bits, self._cable.parity)
        self._begin()
        self.set_signals(SignalsOut(rts=False, dtr=False), now)
        return cut

    def abandon(self, now: Nanos) -> None:
        """The program at this end is gone, until `restore`: what the driver holds still leaves, the signals stay."""
        self._away = True

    def restore(self, now: Nanos) -> None:
        """Somebody works this end again. What came meanwhile is lost; the signals are told as at the beginning."""
        self._away = False
        self._now = now
        self._reception.forget(now)


def stop_distance_of(settings: EndSettings, path: PathKind, character: Nanos) -> StopDistance:
    """What may still reach the other end after its stop request has left it, by the figures of the path."""
    if settings.pacing is Pacing.CLOSED_LOOP:
        how = f"simulated UART: the next {settings.window} only when its transmitter is empty"
        return StopDistance(characters=settings.window, guaranteed=True, how=how)
    if settings.path is None:
        return StopDistance(characters=settings.window, guaranteed=True, how="simulated UART, counted by the character")
    told_late = -(-2 * (path.poll + path.latency) // character)
    if path.trigger > 1:
        told_late += path.timeout_characters
    characters = settings.window + told_late
    if path.transmitter_empty is TransmitterEmpty.ASKED:
        how = f"simulated UART: a window of {settings.window}, and {path.fifo} in its FIFO"
        return StopDistance(characters=characters + path.fifo, guaranteed=True, how=how)
    how = f"simulated {path.name}: a window of {settings.window} by a model of the line; it may hold {path.buffer} more"
    return StopDistance(characters=characters, guaranteed=False, how=how)


def simulated_cable(
    baud: int,
    near: EndSettings,
    far: EndSettings,
    *,
    latency: Nanos = 0,
    has_signals: bool = True,
    bits: int = BITS_PER_CHARACTER,
    parity: Parity = Parity.CHECKED,
    faults: Injectors | None = None,
) -> tuple[CableEnd, CableEnd]:
    """Two ends of one cable at `baud`, `bits` a character, `latency` ns longer than the characters themselves take.

    Without signals it is a line as TCP gives it: only characters, and nothing that says so. Where there are `faults`,
    the near end is the host's.
    """
    cable = _Cable(character_time(baud, bits), latency, has_signals, bits, parity)
    ends = (
        CableEnd(near, cable, faults.from_control if faults else None, far),
        CableEnd(far, cable, faults.from_host if faults else None, near),
    )
    ends[0].peer, ends[1].peer = ends[1], ends[0]
    return ends
