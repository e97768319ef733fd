"""A remote buffer on a line that the test works by hand: what it says, when it says it, what happened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from tapewire.engine import (
    SECOND,
    Alarm,
    Closure,
    Ended,
    Event,
    LineFault,
    Nanos,
    Outcome,
    SignalsIn,
    Violation,
)
from tapewire.protocols.fanuc_a.cnc import FanucACnc
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.messages import Command, Message, MessageReader, encode_message
from tapewire.protocols.fanuc_a.packets import data_bytes, encode_packet
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import POWER_ON, Parameters, Setting, Status

PROGRAM = b"%\nO0001\nG91G01X1.\nM02\n%"


def quick(**values: object) -> Params:
    """Power-on values of table 4.5 but those named, without the gaps of Ti and Tx."""
    return Params(**{"nb": 2000, "no": 50, "tp": 5, "ti": 0, "tx": 0, "tw": 5, **values})  # type: ignore[arg-type]


QUICK = quick()
"""Power-on values of table 4.5, without the gaps of Ti and Tx."""
SLOW = Params(nb=2000, no=50, tp=5, ti=10, tx=100, tw=5)
"""Power-on values of table 4.5."""

SomeEvent = TypeVar("SomeEvent")


class Bench:
    """`out` is everything said, `messages` what of it are messages of protocol A, `times` when each ended."""

    def __init__(self, params: Params = QUICK) -> None:
        self.params = params
        self.engine = FanucACnc(params)
        self.now: Nanos = 0
        self.events: list[Event] = []
        self.out = bytearray()
        self.messages: list[Message] = []
        self.times: list[Nanos] = []
        self.pulling = True
        self._reader = MessageReader(params.coding)

    # the line

    def pull(self) -> None:
        """Everything the engine wants to say at this moment leaves at once."""
        while self.pulling and (data := self.engine.data_to_send(64)):
            self.engine.data_sent(len(data), self.now)
            self.engine.data_left(len(data), self.now)
            self.out += data
            self._read(data)
        self.drain()

    def _read(self, data: bytes) -> None:
        position = 0
        while position < len(data):
            position, reading = self._reader.read(data, position)
            if isinstance(reading, Message):
                self.messages.append(reading)
                self.times.append(self.now)

    def drain(self) -> None:
        while (event := self.engine.next_event()) is not None:
            self.events.append(event)

    def receive(self, data: bytes) -> Bench:
        self.engine.receive_data(data, self.now)
        self.pull()
        return self

    def fault(self, fault: LineFault = LineFault.FRAMING) -> Bench:
        self.engine.receive_line_fault(fault, 0x55, self.now)
        self.pull()
        return self

    def signals(self, *, cts: bool = True, dsr: bool = True, cd: bool = True) -> Bench:
        self.engine.receive_signals(SignalsIn(cts=cts, dsr=dsr, cd=cd), self.now)
        self.pull()
        return self

    def close(self) -> None:
        self.engine.receive_closed(Closure.ORDERLY, "end of file", self.now)
        self.pull()

    def run(self, seconds: float) -> Bench:
        """Let time pass."""
        end = self.now + round(seconds * SECOND)
        while (deadline := self.engine.next_deadline()) is not None and deadline <= end:
            self.now = max(self.now, deadline)
            self.engine.handle_timer(self.now)
            self.pull()
        self.now = end
        return self

    # the host's part

    def host(self, command: Command, data: bytes = b"") -> bytes:
        return encode_message(Message(command=command, data=data), self.params.coding)

    def answer(self, command: Command, data: bytes = b"") -> Bench:
        return self.receive(self.host(command, data))

    def spoil(self, command: Command, data: bytes = b"") -> Bench:
        """The same with one bit of the command wrong."""
        raw = bytearray(self.host(command, data))
        raw[2] ^= 0x10
        return self.receive(bytes(raw))

    def set(self, **values: int) -> Bench:
        """SET with data: the power-on values of table 4.5 but those named."""
        quick = {"nb": self.params.nb, "no": self.params.no, "ti": 0, "tx": 0, "tw": self.params.tw}
        return self.answer(Command.SET, Setting(parameters=Parameters(**{**quick, **values})).encode())

    def packet(self, number: int, data: bytes = b"", n: int = 1) -> Bench:
        return self.receive(encode_packet(number, data.ljust(data_bytes(n), b"\0"), n))

    # what was said

    def next(self, seconds: float = 0.2) -> Command:
        """The one message said since the last call, within `seconds`."""
        self.run(seconds)
        assert len(self.messages) == 1, self.messages
        self.times.clear()
        return self.messages.pop().command

    def silent(self, seconds: float = 0.2) -> bool:
        """No message waits to be read, and nothing is said for `seconds`."""
        before = len(self.out)
        self.run(seconds)
        return len(self.out) == before and not self.messages

    def status(self) -> Status:
        """Of the one SAT said since the last call."""
        self.run(0)
        assert [message.command for message in self.messages] == [Command.SAT], self.messages
        self.times.clear()
        return Status.parse(self.messages.pop().data, POWER_ON)

    def monitors(self) -> bytes:
        """Everything said since the last call, as it went out."""
        self.run(0)
        said = bytes(self.out)
        self.out.clear()
        return said

    def poll(self) -> Status:
        """The next SAT."""
        self.run(self.engine._line.parameters.tp_ms / 1000 + 0.2)
        return self.status()

    # situations

    def powered(self) -> Bench:
        """SYN has just been said."""
        assert self.next(2.2) is Command.SYN
        return self

    def ready(self, **values: int) -> Bench:
        """SYN, RDY and the first SAT are over, and SET with `values` where there are any."""
        self.powered()
        self.answer(Command.SYN)
        assert self.next() is Command.RDY
        self.answer(Command.RDY)
        assert self.next(1.0) is Command.SAT
        self.set(**values) if values else self.answer(Command.SET)
        return self

    def asked(self, **values: int) -> Bench:
        """The first GTD has just been said."""
        self.ready(**values)
        return self.start()

    def start(self) -> Bench:
        self.engine.cycle_start(self.now)
        self.pull()
        assert self.next(0) is Command.GTD
        self.out.clear()
        return self

    def reset(self) -> Bench:
        self.engine.reset(self.now)
        self.pull()
        return self

    def alarm(self) -> Bench:
        self.engine.alarm(self.now)
        self.pull()
        return self

    def take(self, count: int = 1 << 20) -> bytes:
        data = self.engine.take(count, self.now)
        self.pull()
        return data

    # what happened

    @property
    def state(self) -> State:
        return self.engine._line.state

    def of(self, kind: type[SomeEvent]) -> list[SomeEvent]:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def ended(self) -> Ended:
        (ended,) = self.of(Ended)
        return ended

    @property
    def alarms(self) -> list[str]:
        return [alarm.number for alarm in self.of(Alarm)]

    def ended_as(self, outcome: Outcome, reason: str = "") -> bool:
        return self.ended.outcome is outcome and reason in self.ended.reason

    def complained(self, words: str) -> bool:
        return any(words in violation.what for violation in self.of(Violation))


def commands(messages: Sequence[Message]) -> list[Command]:
    return [message.command for message in messages]
