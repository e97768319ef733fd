"""A host on the bench: the test plays the control, message by message, and the clock."""

from __future__ import annotations

from io import BytesIO
from typing import TypeVar

from tapewire.engine import SECOND, Ended, Event, Nanos, Source
from tapewire.protocols.fanuc_a.host import FanucAHost
from tapewire.protocols.fanuc_a.messages import (
    Command,
    Message,
    MessageReader,
    Unreadable,
    encode_message,
)
from tapewire.protocols.fanuc_a.packets import (
    BadPacket,
    Monitor,
    Packet,
    PacketReader,
    encode_monitor,
    packet_bytes,
)
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState, Parameters, Status
from tapewire.protocols.settings import End

E = TypeVar("E")

PROGRAM = b"%\n" + b"".join(b"N%05dX%d.Y%d.\n" % (n, n % 90, n % 70) for n in range(700)) + b"M30\n%"


class Trickle:
    """A source whose bytes come when the test says so; None in between."""

    def __init__(self, data: bytes = b"", *, closed: bool = False) -> None:
        self.data = data
        self.closed = closed

    def read(self, size: int) -> bytes | None:
        if not self.data:
            return b"" if self.closed else None
        data, self.data = self.data[:size], self.data[size:]
        return data


class Bench:
    """`in_force` are the parameters this control answers SAT with: it takes every SET."""

    def __init__(self, expansion: bool = False, **settings: str) -> None:
        make = Params.for_expansion_a if expansion else Params.for_protocol_a
        self.params = make(settings, End.HOST)
        self.host = FanucAHost(self.params)
        self.now: Nanos = 0
        self.events: list[Event] = []
        self.in_force = Parameters()

    def say(self, command: Command, data: bytes = b"") -> bytes:
        """The control says a message. Returns what the host answers, all of it handed over and gone."""
        return self.say_raw(encode_message(Message(command=command, data=data), self.params.coding))

    def say_raw(self, data: bytes) -> bytes:
        self.host.receive_data(data, self.now)
        return self.pull()

    def monitor(self, monitor: Monitor, number: int | None = None) -> bytes:
        return self.say_raw(encode_monitor(monitor, number=number))

    def answer(self, command: Command, data: bytes = b"") -> Message:
        """The one message the host answers."""
        [message] = self.messages(self.say(command, data))
        return message

    def messages(self, said: bytes) -> list[Message]:
        reader, position, found = MessageReader(self.params.coding), 0, []
        while position < len(said):
            position, reading = reader.read(said, position)
            assert not isinstance(reading, Unreadable), reading
            if reading is not None:
                found.append(reading)
        assert not reader.pending
        return found

    def packets(self, said: bytes) -> list[Packet]:
        reader, position, found = PacketReader(self.params.packet_n), 0, []
        while position < len(said):
            position, reading = reader.read(said, position)
            assert not isinstance(reading, BadPacket), reading
            if reading is not None:
                found.append(reading)
        assert not reader.pending
        return found

    def pull(self, limit: int = 1 << 20) -> bytes:
        """At most `limit` characters of what the host wants to say, each leaving at once."""
        said = bytearray()
        if self.host.recall:
            self.host.data_discarded(0, self.now)
        while len(said) < limit and (data := self.host.data_to_send(min(64, limit - len(said)))):
            self.host.data_sent(len(data), self.now)
            self.host.data_left(len(data), self.now)
            said += data
        self.drain()
        return bytes(said)

    def drain(self) -> None:
        while (event := self.host.next_event()) is not None:
            self.events.append(event)

    def wait(self, seconds: float) -> bytes:
        """Let time pass. Returns what the host says meanwhile."""
        end, said = self.now + round(seconds * SECOND), bytearray(self.pull())
        while (deadline := self.host.next_deadline()) is not None and deadline <= end:
            self.now = max(self.now, deadline)
            self.host.handle_timer(self.now)
            said += self.pull()
        self.now = end
        return bytes(said)

    # whole scenes

    def sat(
        self, state: BufferState = BufferState.RESET, stored: int = 0, cause: AlarmCause = AlarmCause.NC_ALARM
    ) -> Message:
        status = Status(state=state, stored=stored, parameters=self.in_force, cause=cause)
        return self.answer(Command.SAT, status.encode())

    def power_on(self) -> None:
        """SYN, RDY, and two SATs: the control takes the parameters and says so."""
        assert self.answer(Command.SYN) == Message(command=Command.SYN)
        assert self.answer(Command.RDY) == Message(command=Command.RDY)
        assert self.sat().command is Command.SET
        self.in_force = self.params.wanted
        assert self.sat() == Message(command=Command.SET)

    def arm(self, program: bytes | Source = PROGRAM) -> None:
        source = BytesIO(program) if isinstance(program, bytes) else program
        self.host.start(source, self.now)

    def sending(self, program: bytes | Source = PROGRAM) -> Message:
        """Powered on, armed, and the first GTD. Returns its answer."""
        self.power_on()
        self.arm(program)
        return self.answer(Command.GTD)

    def delivered(self) -> None:
        """All of PROGRAM has been taken, and EOD said."""
        self.sending()
        while self.answer(Command.GTD).command is not Command.EOD:
            pass

    def streaming(self, program: bytes | Source = PROGRAM, limit: int = 1 << 20) -> bytes:
        """Powered on, armed, GTD, and the host's packets up to `limit` characters."""
        self.power_on()
        self.arm(program)
        self.host.receive_data(encode_message(Message(command=Command.GTD), self.params.coding), self.now)
        return self.pull(limit)

    @property
    def packet(self) -> int:
        return packet_bytes(self.params.packet_n)

    def all(self, kind: type[E]) -> list[E]:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def ended(self) -> Ended:
        [ended] = self.all(Ended)
        return ended
