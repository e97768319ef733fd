"""Two ends of every kind of line, a clock that jumps, and an engine that only listens."""

from __future__ import annotations

import asyncio
import itertools
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Closure,
    Event,
    LineFault,
    Nanos,
    Notice,
    SignalsIn,
    SignalsOut,
)
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.faults.chance import derive
from tapewire.line.faults.injector import injectors
from tapewire.line.faults.plan import LineEnd
from tapewire.line.faults.presets import preset
from tapewire.line.faulty import FaultyTransport
from tapewire.line.open import open_line, parse_line
from tapewire.line.pacing import character_time
from tapewire.line.ports.serial_port import open_tty
from tapewire.line.pty import create_pty
from tapewire.line.simulated import EndSettings, simulated_cable
from tapewire.line.transport import Closed, LineItem, Transport

REAL_KINDS: Final = ("tcp client", "tcp listener", "pty master", "tty slave", "rfc2217 client", "rfc2217 server")
COUNTING_KINDS: Final = REAL_KINDS[:4]
"""Those that can tell what they have called back; a serial server is told to throw it away, and does not count."""
FAULTY_KINDS: Final = ("simulated, faulty", "pty master, faulty")
"""Wrapped, with a plan in which nothing goes wrong."""
KINDS: Final = ("simulated", *REAL_KINDS, *FAULTY_KINDS)

LOOKS: Final = 20_000
"""How often a test looks for what the kernel passes on in its own time, before it calls it lost."""


@dataclass
class Clock:
    """The moments a test hands to a line. The kernel's own delays are waited for besides, and never measured."""

    now: Nanos = SECOND

    def advance(self, span: Nanos = MILLISECOND) -> Nanos:
        self.now += span
        return self.now

    def looks(self, span: Nanos = MILLISECOND) -> Iterator[Nanos]:
        for look in range(LOOKS):
            yield self.advance(span)
            if look > 10:
                time.sleep(0.0002)
        raise AssertionError("waited too long for the kernel")


@dataclass
class Seen:
    """What one end read."""

    items: list[LineItem] = field(default_factory=list)

    def read(self, line: Transport, now: Nanos) -> None:
        self.items += line.read(now)

    @property
    def data(self) -> bytes:
        return b"".join(item for item in self.items if isinstance(item, bytes))

    @property
    def ends(self) -> list[Closed]:
        return [item for item in self.items if isinstance(item, Closed)]


def settings(*, baud: int = 86400, window: int = 216, paced_reception: bool = False, stopbits: int = 1) -> LineSettings:
    return LineSettings(baud=baud, stopbits=stopbits, window=window, paced_reception=paced_reception)


@contextmanager
def open_pair(
    kind: str, *, baud: int = 86400, window: int = 216, far_window: int | None = None, paced: bool = False
) -> Iterator[tuple[Transport, Transport]]:
    """(the end under test, its other end), both open; `paced` is the reception of the end under test."""
    near = settings(baud=baud, window=window, paced_reception=paced)
    far = settings(baud=baud, window=far_window or window)
    with tempfile.TemporaryDirectory() as folder:
        ends = _open(kind, near, far, Path(folder) / "line")
        try:
            yield ends
        finally:
            for end in ends:
                end.close(0)


def _open(kind: str, near: LineSettings, far: LineSettings, path: Path) -> tuple[Transport, Transport]:
    if kind in FAULTY_KINDS:
        ends = _open(kind.split(",", maxsplit=1)[0], near, far, path)
        nothing = injectors(preset("clean"), lambda name: derive(1, name))
        character = character_time(near.baud)
        return FaultyTransport(ends[0], nothing, LineEnd.HOST, character=character), ends[1]
    match kind:
        case "simulated":
            ends = simulated_cable(near.baud, EndSettings(window=near.window), EndSettings(window=far.window))
            for end in ends:
                end.set_signals(SignalsOut(), 0)
            return ends
        case "tcp client":
            return asyncio.run(tcp_pair(near, far))
        case "tcp listener":
            return asyncio.run(tcp_pair(far, near))[::-1]
        case "rfc2217 client":
            return asyncio.run(tcp_pair(near, far, "rfc2217+listen"))
        case "rfc2217 server":
            return asyncio.run(tcp_pair(far, near, "rfc2217+listen"))[::-1]
        case "pty master":
            return create_pty(str(path), near), open_tty(str(path), far)
        case _:
            master = create_pty(str(path), far)
            return open_tty(str(path), near), master


async def tcp_pair(
    client: LineSettings, listener: LineSettings, scheme: str = "listen"
) -> tuple[DescriptorLine, DescriptorLine]:
    """Both ends of a connection, opened the way users do."""
    listening: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(_open_like(listener, f"{scheme}://127.0.0.1:0", listening.set_result))
    here = await listening
    near = await _open_like(client, here.replace("rfc2217+listen", "rfc2217").replace("listen", "socket"))
    return near, await waiting


async def _open_like(how: LineSettings, line: str, on_ready: Callable[[str], None] | None = None) -> DescriptorLine:
    return await open_line(
        parse_line(line),
        baud=how.baud,
        stopbits=how.stopbits,
        window=how.window,
        paced_reception=how.paced_reception,
        on_ready=on_ready,
    )


def hand_over(line: Transport, data: bytes, now: Nanos) -> None:
    """All of `data` at once; the window must be made for it."""
    assert line.room(now) >= len(data)
    line.write(data, now)


def send_all(sender: Transport, receiver: Transport, data: bytes, clock: Clock) -> Seen:
    """Hand `data` over as the sender has room, until the receiver has as many bytes."""
    seen, at = Seen(), 0
    for now in clock.looks():
        sender.read(now)
        if (room := sender.room(now)) and at < len(data):
            sender.write(data[at : at + room], now)
            at = min(len(data), at + room)
        seen.read(receiver, now)
        if at == len(data) and len(seen.data) >= len(data):
            break
    return seen


def settle(line: Transport, clock: Clock) -> None:
    """Until nothing is in flight."""
    for now in clock.looks():
        if not line.in_flight(now):
            break


def read_until_closed(line: Transport, clock: Clock, span: Nanos = MILLISECOND) -> Seen:
    seen = Seen()
    for now in clock.looks(span):
        seen.read(line, now)
        if seen.ends:
            break
    return seen


class ListeningEngine:
    """Sends `script`, answers every byte with `answer(byte)`, and keeps what it was told."""

    def __init__(self, script: bytes = b"", answer: Callable[[bytes], bytes] | None = None) -> None:
        self.received = bytearray()
        self.left = 0
        self.closed: tuple[Closure, str] | None = None
        self.faults: list[tuple[LineFault, int | None]] = []
        self.control_lines: list[SignalsIn] = []
        self.deadline: Nanos | None = None
        self.fired = 0
        self.events: list[Event] = []
        self.recall = False
        self.discarded = 0
        self.signals = SignalsOut()
        self._answer = answer
        self._to_send = bytearray(script)

    def say(self, data: bytes) -> None:
        self._to_send += data

    def receive_data(self, data: bytes, now: Nanos) -> None:
        self.received += data
        if self._answer is not None:
            self._to_send += self._answer(data)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        self.faults.append((fault, byte))

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        self.control_lines.append(signals)

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        assert self.closed is None
        self.closed = closure, reason
        self.events.append(Notice(text=reason))

    def data_to_send(self, limit: int) -> bytes:
        return bytes(self._to_send[:limit])

    def data_sent(self, count: int, now: Nanos) -> None:
        del self._to_send[:count]

    def data_left(self, count: int, now: Nanos) -> None:
        self.left += count

    def data_discarded(self, count: int, now: Nanos) -> None:
        self.recall = False
        self.discarded += count

    def next_deadline(self) -> Nanos | None:
        return self.deadline

    def handle_timer(self, now: Nanos) -> None:
        self.fired += 1
        self.deadline = None

    def next_event(self) -> Event | None:
        return self.events.pop(0) if self.events else None


def chunks_of(data: bytes, sizes: list[int]) -> list[bytes]:
    """`data` cut at the given sizes; the rest is the last piece."""
    cuts = [0, *itertools.accumulate(sizes), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(cuts)]
