"""The control's end of REMOTE LOAD and DNC LINK on a line that a test works by hand."""

from __future__ import annotations

from typing import Any, TypeVar

from tapewire.engine import SECOND, Closure, Ended, Event, LineFault, Nanos, Outcome
from tapewire.protocols.bridgeport.cnc import BridgeportCnc, State
from tapewire.protocols.bridgeport.cnc_law import Cause
from tapewire.protocols.bridgeport.messages import Mode, Params
from tapewire.protocols.bridgeport.records import Lrc, encode_record

__all__ = [
    "ACK",
    "CANCEL",
    "DC1",
    "DC2",
    "DC3",
    "DC4",
    "DLE",
    "EOT",
    "ETB",
    "ETX",
    "NAK",
    "Bench",
    "P",
    "Tape",
    "record",
]

ETX, EOT, ACK, DLE, DC1, DC2, DC3, DC4, NAK, ETB = (
    bytes([code]) for code in (0x03, 0x04, 0x06, 0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x17)
)
CANCEL = DC3 + DLE
P = b"N10G0X0Y0\r\nN20M2\r\n"
"""The program of the examples."""

SomeEvent = TypeVar("SomeEvent")


def record(text: bytes, lrc: Lrc = Lrc.XOR7_ETB, end: bytes = ETB) -> bytes:
    return encode_record(text, end[0], lrc)


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


class Recorder(BridgeportCnc):
    """Notes every move."""

    moves: set[tuple[State, Cause, State]]

    def _move(self, cause: Cause, to: State) -> None:
        self.moves.add((self._state, cause, to))
        super()._move(cause, to)

    @property
    def state(self) -> State:
        return self._state


class Bench:
    """An engine on a line that the test works by hand. `settings` are fields of Params."""

    def __init__(self, **settings: Any) -> None:
        self.params = Params(**({"program": "1234", "mode": Mode.LOAD} | settings))
        self.engine = Recorder(self.params)
        self.engine.moves = set()
        self.now: Nanos = 0
        self.events: list[Event] = []

    @classmethod
    def linking(cls, **settings: Any) -> Bench:
        """DNC LINK was asked for, a record is due."""
        return cls(**({"mode": Mode.LINK} | settings)).asked()

    @property
    def state(self) -> State:
        return self.engine.state

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
        self.left(1 << 20)
        return out

    def said(self) -> Bench:
        self.send()
        return self

    def left(self, count: int) -> Bench:
        self.engine.data_left(count, self.now)
        return self.drain()

    def receive(self, data: bytes) -> Bench:
        self.engine.receive_data(data, self.now)
        return self.drain()

    def wait(self, seconds: float) -> Bench:
        """Time passes, and every timer fires when it is due."""
        until = self.now + round(seconds * SECOND)
        while (deadline := self.engine.next_deadline()) is not None and deadline <= until:
            self.now = deadline
            self.engine.handle_timer(self.now)
            self.drain()
        self.now = until
        return self

    def quiet(self) -> Bench:
        return self.wait(self.params.nak_quiet)

    def start(self) -> Bench:
        self.engine.cycle_start(self.now)
        return self.drain()

    def asked(self) -> Bench:
        """The request of a named program has left."""
        self.start()
        assert self.send() == DC2
        self.receive(DC1)
        name = b"%s;%s" % (self.params.program.encode(), self.params.mode.encode())
        assert self.send().startswith(name + self.params.name_trailer + DC1)
        return self

    def stopped(self) -> Bench:
        """REMOTE LOAD is stopped, and the DC3 has left."""
        self.asked().receive(b"0" * (self.params.buffer - self.params.stop_at_free))
        assert self.send() == DC3
        return self

    def punch(self, *pieces: bytes | None) -> Bench:
        self.engine.punch(Tape(*pieces), self.now)
        return self.drain()

    def opened(self, *pieces: bytes | None) -> Bench:
        """A save is announced under its name; the second DC2 has left."""
        self.punch(*pieces)
        assert self.send() == DC2
        self.receive(DC1)
        assert self.send().endswith(DC2)
        return self

    def saving(self, count: int = 4) -> Bench:
        """`count` characters of 1000 have left."""
        self.opened(b"0" * 1000).receive(DC1)
        if count:
            self.engine.data_sent(len(self.engine.data_to_send(count)), self.now)
        return self.left(count)

    def take(self, count: int = 1 << 20) -> bytes:
        data = self.engine.take(count, self.now)
        self.drain()
        return data

    def reset(self) -> Bench:
        self.engine.reset(self.now)
        return self.drain()

    def alarm(self) -> Bench:
        self.engine.alarm(self.now)
        return self.drain()

    def fault(self, fault: LineFault = LineFault.PARITY, byte: int | None = 0x41) -> Bench:
        self.engine.receive_line_fault(fault, byte, self.now)
        return self.drain()

    def close(self, closure: Closure = Closure.ORDERLY) -> Bench:
        self.engine.receive_closed(closure, "end of file", self.now)
        return self.drain()

    def drain(self) -> Bench:
        while (event := self.engine.next_event()) is not None:
            self.events.append(event)
        return self

    def all(self, kind: type[SomeEvent]) -> list[SomeEvent]:
        return [event for event in self.events if isinstance(event, kind)]

    def ended(self) -> Ended:
        (ended,) = self.all(Ended)
        return ended

    def end(self) -> tuple[Outcome, int, int] | None:
        if not self.all(Ended):
            return None
        ended = self.ended()
        return ended.outcome, ended.bytes_low, ended.bytes_high
