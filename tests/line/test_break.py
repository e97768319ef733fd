"""Breaks that this end sends: behind what was handed over, with nothing between, and ended when the line closes."""

from __future__ import annotations

import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Nanos
from tapewire.line.captures.records import Side
from tapewire.line.descriptor import BREAK_TIME, LineSettings
from tapewire.line.ports.standstill import STANDSTILL
from tapewire.line.relay import Damaged, Relay
from tapewire.line.rfc2217.lines import ClientLine, ServerLine
from tapewire.line.transport import Fault, LineItem, StopDistance, can_break, send_break
from tests.line.fake_uart import Bench, FakeUart, bench
from tests.line.helpers import Clock, Seen, hand_over, open_pair, settings, tcp_pair

HOW = settings(baud=9600, window=48, stopbits=2)
BREAK = Fault(fault=LineFault.BREAK)


class BreakingUart(FakeUart):
    """Notes when its wire is held."""

    held: list[tuple[Nanos, str]]

    def begin_break(self, fd: int) -> None:
        self.held.append((self.clock.now, "begin"))

    def end_break(self, fd: int) -> None:
        self.held.append((self.clock.now, "end"))


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path, HOW.character) as made:
        uart = made.uart = BreakingUart(made.uart.master, made.uart.clock, HOW.character)
        uart.held = []
        uart.lines = termios.TIOCM_CTS
        yield made


def held(port: Bench) -> list[tuple[Nanos, str]]:
    assert isinstance(port.uart, BreakingUart)
    return port.uart.held


@pytest.mark.parametrize("window", [2, 48])
def test_a_serial_port_breaks_behind_what_was_handed_over(port: Bench, window: int) -> None:
    line, clock = port.open(LineSettings(baud=9600, stopbits=2, window=window)), port.uart.clock
    line.read(clock.now)
    hand_over(line, b"N1"[:window], clock.now)
    send_break(line, clock.now)
    assert line.room(clock.now) == 0
    while not held(port):
        deadline = line.next_deadline()
        assert deadline is not None
        clock.now = deadline
        line.read(clock.now)
    assert port.uart.inside == 0
    ((began, _),) = held(port)
    assert line.room(clock.advance()) == 0
    send_break(line, clock.now)
    while line.next_deadline() != began + BREAK_TIME:
        line.read(clock.advance())
    clock.now = began + BREAK_TIME
    line.read(clock.now)
    assert held(port) == [(began, "begin"), (began + BREAK_TIME, "end")]
    assert line.room(clock.now) == window
    line.close(clock.now)


def test_a_port_that_is_closed_lets_go_of_its_break(port: Bench) -> None:
    line, clock = port.open(HOW), port.uart.clock
    line.read(clock.now)
    send_break(line, clock.now)
    line.close(clock.now)
    assert [what for _, what in held(port)] == ["begin", "end"]


@pytest.mark.parametrize("kind", ["tcp client", "pty master", "tty slave", "simulated"])
def test_what_is_no_wire_has_no_breaks(kind: str) -> None:
    with open_pair(kind) as (near, _):
        assert not can_break(near)
        with pytest.raises(AssertionError, match="has no breaks"):
            send_break(near, SECOND)


async def test_a_break_crosses_a_serial_server_both_ways() -> None:
    client, server = await tcp_pair(HOW, HOW, "rfc2217+listen")
    assert isinstance(client, ClientLine)
    assert isinstance(server, ServerLine)
    for near, far in ((client, server), (server, client)):
        clock, seen = Clock(), Seen()
        near.read(clock.now)
        hand_over(near, b"N1", clock.now)
        send_break(near, clock.now)
        while BREAK not in seen.items:
            near.read(clock.advance())
            seen.read(far, clock.now)
        for now in clock.looks(BREAK_TIME):
            near.read(now)
            seen.read(far, now)
            if near.room(now):
                break
        assert seen.data == b"N1"
        assert seen.items.count(BREAK) == 1
        assert seen.items.index(b"N1") < seen.items.index(BREAK)
    assert not server._end_of_it._in_break
    client.close(0)
    server.close(0)


class Wire:
    """One side of a monitor: what comes from there, and what was passed on to there."""

    stop_distance = StopDistance(characters=1, guaranteed=True, how="none")
    can_break = True

    def __init__(self, coming: list[LineItem]) -> None:
        self.coming = coming
        self.passed: list[LineItem] = []

    def read(self, now: Nanos) -> list[LineItem]:
        coming, self.coming = self.coming, []
        return coming

    def room(self, now: Nanos) -> int:
        return 3

    def write(self, data: bytes, now: Nanos) -> None:
        self.passed.append(data)

    def send_break(self, now: Nanos) -> None:
        self.passed.append(BREAK)

    def in_flight(self, now: Nanos) -> int:
        return 0

    on_its_way = discard = in_flight

    def set_signals(self, signals: object, now: Nanos) -> None: ...

    def next_deadline(self) -> Nanos | None:
        return None

    def close(self, now: Nanos) -> None: ...


def test_a_monitor_passes_a_break_on_at_its_place() -> None:
    host, control = Wire([b"N1G00", BREAK, b"N2"]), Wire([])
    relay = Relay({Side.HOST: host, Side.CONTROL: control}, Damaged.STOP, 40, lambda *_: None)
    relay.step(SECOND)
    assert relay.ended is None
    at = control.passed.index(BREAK)
    assert b"".join(item for item in control.passed[:at] if isinstance(item, bytes)) == b"N1G00"
    assert b"".join(item for item in control.passed[at:] if isinstance(item, bytes)) == b"N2"


def test_a_break_that_cannot_be_passed_on_ends_a_monitor_as_damage_does() -> None:
    host, control = Wire([BREAK]), Wire([])
    control.can_break = False
    relay = Relay({Side.HOST: host, Side.CONTROL: control}, Damaged.STOP, 40, lambda *_: None)
    relay.step(SECOND)
    assert relay.ended is not None
    assert "break from the host" in relay.ended.reason


@pytest.mark.parametrize("window", [2, 48])
def test_a_transmitter_that_sends_nothing_ends_the_line_within_its_limit(port: Bench, window: int) -> None:
    """An adapter that hangs: the job must not wait for it without end."""
    port.uart.character = 3600 * SECOND
    port.uart.fifo = 0
    line, clock = port.open(LineSettings(baud=9600, stopbits=2, window=window)), port.uart.clock
    line.read(clock.now)
    hand_over(line, b"N1"[:window], clock.now)
    began, seen = clock.now, Seen()
    while not seen.ends:
        deadline = line.next_deadline()
        assert deadline is not None
        clock.now = max(deadline, clock.now + 1)
        seen.read(line, clock.now)
        assert clock.now < began + STANDSTILL + SECOND
    (end,) = seen.ends
    assert end.closure is Closure.LOST
    assert "holds 2 characters and has sent none for 10 s" in end.reason
    assert clock.now >= began + STANDSTILL
    line.close(clock.now)


def test_a_slow_transmitter_is_no_hung_one(port: Bench) -> None:
    port.uart.character = 9 * SECOND
    port.uart.fifo = 0
    line, clock = port.open(HOW), port.uart.clock
    line.read(clock.now)
    hand_over(line, bytes(4), clock.now)
    seen = Seen()
    for _ in range(400):
        seen.read(line, clock.advance(100 * MILLISECOND))
    assert not seen.ends
    line.close(clock.now)
