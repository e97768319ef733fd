"""The control's end of protocol B on a line that a test works by hand."""

from __future__ import annotations

from typing import TypeVar

from tapewire.engine import Closure, Ended, Event, LineFault, Nanos, Outcome, SignalsIn
from tapewire.protocols.fanuc_b.cnc import FanucBCnc, State
from tapewire.protocols.fanuc_b.cnc_law import Cause
from tapewire.protocols.fanuc_b.messages import Params

__all__ = ["DC1", "DC2", "DC3", "DC4", "NAK", "PROGRAM", "SYN", "Bench", "Tape"]

DC1, DC2, DC3, DC4, NAK, SYN = b"\x11", b"\x12", b"\x93", b"\x14", b"\x95", b"\x96"
PROGRAM = b"%\nO0001\nG91G01X1.\nM02\n%"

SomeEvent = TypeVar("SomeEvent")


class Tape:
    """A source that gives `data` in the order of its pieces; None is a piece that is not there yet."""

    def __init__(self, *pieces: bytes | None) -> None:
        self._pieces = [*pieces]

    def read(self, size: int) -> bytes | None:
        if not self._pieces:
            return b""
        piece = self._pieces[0]
        if piece is None or len(piece) <= size:
            return self._pieces.pop(0)
        self._pieces[0] = piece[size:]
        return piece[:size]


class Recorder(FanucBCnc):
    """Notes every move."""

    moves: set[tuple[State, Cause, State]]

    def _move(self, cause: Cause, to: State) -> None:
        self.moves.add((self._state, cause, to))
        super()._move(cause, to)


class Bench:
    """An engine on a line that the test works by hand."""

    def __init__(self, params: Params | None = None) -> None:
        self.params = params or Params()
        self.engine = Recorder(self.params)
        self.engine.moves = set()
        self.now: Nanos = 0
        self.events: list[Event] = []
        self.seen = SignalsIn()

    def hand_over(self, limit: int = 64) -> bytes:
        """Everything the engine wants to send is now in the line, but has not left."""
        out = bytearray()
        while data := self.engine.data_to_send(limit):
            assert data == self.engine.data_to_send(limit), "a look changes nothing"
            out += data
            self.engine.data_sent(len(data), self.now)
        self.drain()
        return bytes(out)

    def send(self, limit: int = 64) -> bytes:
        """Everything the engine wants to send has left."""
        out = self.hand_over(limit)
        self.left(10_000)
        return out

    def left(self, count: int) -> None:
        self.engine.data_left(count, self.now)
        self.drain()

    def receive(self, data: bytes) -> Bench:
        self.engine.receive_data(data, self.now)
        self.drain()
        return self

    def signals(self, *, cts: bool = True, dsr: bool = True, cd: bool = True) -> Bench:
        self.seen = SignalsIn(cts=cts, dsr=dsr, cd=cd)
        self.engine.receive_signals(self.seen, self.now)
        self.drain()
        return self

    def close(self, closure: Closure = Closure.ORDERLY) -> None:
        self.engine.receive_closed(closure, "end of file", self.now)
        self.drain()

    def start(self) -> Bench:
        self.engine.cycle_start(self.now)
        self.drain()
        return self

    def reading(self) -> Bench:
        self.start()
        assert self.send() == DC1
        return self

    def stopped(self) -> Bench:
        """The level DC3 has left."""
        self.reading().receive(bytes(8192 - self.params.limits.stop_at_free))
        assert self.send() == DC3
        return self

    def punch(self, *pieces: bytes | None) -> Bench:
        self.engine.punch(Tape(*pieces), self.now)
        self.drain()
        return self

    def punching(self, count: int = 4) -> Bench:
        """The DC2 and `count` characters of 1000 have left."""
        self.punch(bytes(1000))
        assert self.engine.data_to_send(1) == DC2
        self.engine.data_sent(1, self.now)
        if count:
            self.engine.data_sent(len(self.engine.data_to_send(count)), self.now)
        self.left(1 + count)
        return self

    def take(self, count: int = 10_000) -> bytes:
        data = self.engine.take(count, self.now)
        self.drain()
        return data

    def reset(self) -> Bench:
        self.engine.reset(self.now)
        self.drain()
        return self

    def alarm(self) -> Bench:
        self.engine.alarm(self.now)
        self.drain()
        return self

    def fault(self, fault: LineFault = LineFault.FRAMING, byte: int | None = 0x41) -> Bench:
        self.engine.receive_line_fault(fault, byte, self.now)
        self.drain()
        return self

    def drain(self) -> None:
        while (event := self.engine.next_event()) is not None:
            self.events.append(event)

    def all(self, kind: type[SomeEvent]) -> list[SomeEvent]:
        return [event for event in self.events if isinstance(event, kind)]

    def end(self) -> tuple[Outcome, int, int] | None:
        ended = self.all(Ended)
        assert len(ended) <= 1
        return (ended[0].outcome, ended[0].bytes_low, ended[0].bytes_high) if ended else None

    @property
    def er(self) -> bool:
        return self.engine.signals.dtr
