"""A host engine of REMOTE LOAD and DNC LINK, a line that takes what it is offered, and a clock."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO

from tapewire.engine import Ended, Event, Nanos, Source
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.protocols.bridgeport.host_law import State
from tapewire.protocols.bridgeport.messages import Mode, Params
from tapewire.protocols.settings import End
from tests.contract.rig import drain

ACK, NAK, DLE, DC1, DC2, DC3, DC4, EOT, ETB = (
    b"\x06",
    b"\x15",
    b"\x10",
    b"\x11",
    b"\x12",
    b"\x13",
    b"\x14",
    b"\x04",
    b"\x17",
)

P = b"N10G0X0Y0\r\nN20M2\r\n"
"""The program of the worked examples, 18 bytes."""


def surfacing(size: int = 12300) -> bytes:
    """The long program of the worked examples: whole lines within `size` bytes."""
    text = b""
    number = 1
    while True:
        line = b"N%dG1X%.4fY%.4f\r\n" % (number, number / 100, number / 200)
        if len(text) + len(line) > size:
            return text
        text += line
        number += 1


class Books:
    """A library that remembers what it was asked for."""

    def __init__(self, programs: Mapping[str | None, bytes]) -> None:
        self._programs = programs
        self.asked: list[tuple[str | None, Mode | None]] = []

    def find(self, number: str | None, mode: Mode | None) -> Source | None:
        self.asked.append((number, mode))
        program = self._programs.get(number)
        return None if program is None else BytesIO(program)


class Drawer:
    """A shelf that takes everything."""

    def __init__(self) -> None:
        self.programs: dict[str | None, BytesIO] = {}

    def place(self, number: str | None) -> BytesIO:
        return self.programs.setdefault(number, BytesIO())


class Rig:
    """`hear` is what the control says, `take` what the line takes; everything leaves at once unless `hand_over`."""

    def __init__(self, program: bytes | None = P, **settings: str) -> None:
        self.host = BridgeportHost(Params.for_bridgeport(settings, End.HOST))
        self.now: Nanos = 0
        self.said = b""
        self.in_flight = 0
        self.events: list[Event] = []
        if program is not None:
            self.host.start(BytesIO(program), 0)

    def hear(self, *data: bytes) -> Rig:
        for piece in data:
            self.host.receive_data(piece, self.now)
        self.settle()
        return self

    def take(self, count: int = 1 << 20) -> bytes:
        """The line takes up to `count` characters and they leave."""
        said = self.hand_over(count)
        self.leave()
        return said

    def hand_over(self, count: int = 1 << 20) -> bytes:
        said = b""
        while len(said) < count and (data := self.host.data_to_send(min(count - len(said), 7))):
            self.host.data_sent(len(data), self.now)
            said += data
        self.said += said
        self.in_flight += len(said)
        self.settle()
        return said

    def leave(self) -> None:
        if self.in_flight:
            count, self.in_flight = self.in_flight, 0
            self.host.data_left(count, self.now)
        self.settle()

    def say(self, data: bytes) -> bytes:
        """The control says `data`; what the host answers to it."""
        self.hear(data)
        return self.take()

    def name(self, word: bytes) -> Rig:
        """The name transaction (1.1)."""
        assert self.say(DC2) == DC1
        assert self.say(word + DC4) == b""
        return self

    def wait(self, span: Nanos) -> Rig:
        """Let `span` pass, a deadline at a time."""
        end = self.now + span
        while (deadline := self.host.next_deadline()) is not None and deadline <= end:
            assert deadline >= self.now, "a deadline is in the past"
            self.now = deadline
            self.host.handle_timer(self.now)
            self.settle()
        self.now = end
        return self

    def settle(self, recalled: int = 0) -> None:
        if self.host.recall:
            self.in_flight -= recalled
            self.host.data_discarded(recalled, self.now)
        self.events += drain(self.host)

    @property
    def end(self) -> Ended | None:
        return next((event for event in self.events if isinstance(event, Ended)), None)

    def of(self, kind: type) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]


LINES = (b"N10G1X1F5\r\n", b"N20Y1\r\n", b"N30M2\r\n")
LINK = b"".join(LINES)
PAIRS = (b"\x13\x10", b"\x10\x04", b"\x10\x10", b"\x10\x13", b"\x10\x14", b"\x10")


def linked(**settings: str) -> Rig:
    """A rig whose control has asked for program 77 by DNC LINK, in the short records of the examples."""
    return Rig(LINK, **{"record_bytes": "12", **settings}).name(b"77;D")


def in_state(state: State, **settings: str) -> Rig:
    """A rig brought to `state`, with a job wherever that state can have one."""
    request = bytes.fromhex(settings.get("read_request", "11"))
    match state:
        case State.REST:
            return Rig(surfacing(), **settings)
        case State.HOLD:
            rig = Rig(None, **settings)
            rig.host.serve(Books({}), 0, policy=Policy.ONCE)
            rig.say(request)
        case State.RECEIVING | State.SAVED:
            rig = Rig(None, **settings)
            rig.host.receive(BytesIO(), 0)
            rig.hear(DC2)
            rig.take()
            rig.hear(LINK * 4 + (EOT if state is State.SAVED else b""))
        case State.TEXT | State.TAIL:
            rig = Rig(b"X" * 100, **settings)
            rig.hear(request)
            rig.take(10 if state is State.TEXT else 200)
        case State.RECORD | State.WAIT_ACK:
            rig = Rig(surfacing(), **settings).name(b"1;D")
            rig.hear(request)
            rig.take(10 if state is State.RECORD else 1000)
    assert rig.host.state is state
    return rig
