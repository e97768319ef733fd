"""A host engine of protocol B on a line that does what the test says."""

from __future__ import annotations

from io import BytesIO

from tapewire.engine import (
    SECOND,
    Ended,
    Event,
    Nanos,
    SignalsIn,
)
from tapewire.protocols.fanuc_b.host import FanucBHost
from tapewire.protocols.fanuc_b.messages import Params
from tapewire.protocols.settings import End
from tests.contract.rig import drain

DC1, DC3, DC3_ISO, NAK, NAK_ISO, SYN, SYN_ISO = b"\x11", b"\x13", b"\x93", b"\x15", b"\x95", b"\x16", b"\x96"
PROGRAM = b"%\n" + b"G01 X1.\n" * 2500 + b"%"
"""20,003 bytes: enough to fill the buffer twice."""


class Rig:
    """A host engine, a line that takes what it is offered, and a clock."""

    def __init__(self, program: bytes = PROGRAM, *, expansion: bool = False, **settings: str) -> None:
        make = Params.for_expansion_b if expansion else Params.for_protocol_b
        self.host = FanucBHost(make(settings, End.HOST))
        self.now: Nanos = 0
        self.said = b""
        self.in_flight = 0
        self.events: list[Event] = []
        if program:
            self.host.start(BytesIO(program), 0)

    def hear(self, data: bytes) -> None:
        self.host.receive_data(data, self.now)
        self._settle()

    def see(self, **signals: bool) -> None:
        self.host.receive_signals(SignalsIn(**signals), self.now)
        self._settle()

    def take(self, count: int) -> bytes:
        """The line takes up to `count` bytes and they leave."""
        said = self.hand_over(count)
        self.leave()
        return said

    def take_in_two_seconds(self, count: int) -> None:
        """As a line takes it, whose pace shows before a pause comes."""
        for part in (count // 2, count - count // 2):
            self.take(part)
            self.wait(SECOND)

    def hand_over(self, count: int) -> bytes:
        said = b""
        while len(said) < count and (data := self.host.data_to_send(count - len(said))):
            self.host.data_sent(len(data), self.now)
            said += data
        self.said += said
        self.in_flight += len(said)
        self._settle()
        return said

    def leave(self) -> None:
        if self.in_flight:
            count, self.in_flight = self.in_flight, 0
            self.host.data_left(count, self.now)
        self._settle()

    def wait(self, span: Nanos) -> None:
        self.now += span
        self.host.handle_timer(self.now)
        self._settle()

    def _settle(self) -> None:
        self.events += drain(self.host)

    def recall(self, count: int) -> None:
        assert self.host.recall
        self.in_flight -= count
        self.host.data_discarded(count, self.now)
        self._settle()

    @property
    def end(self) -> Ended | None:
        if self.host.recall and not self.in_flight:
            self.host.data_discarded(0, self.now)
            self._settle()
        return next((event for event in self.events if isinstance(event, Ended)), None)

    def of(self, kind: type) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]
