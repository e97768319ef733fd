"""Engines of every registered protocol, both ends, in each of the situations a line can put them in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO

from tapewire.engine import CncEngine, Engine, Event, HostEngine, Nanos, Sink
from tapewire.errors import UsageError
from tapewire.protocols import PROTOCOLS, ProtocolEntry
from tapewire.protocols.settings import End

PROGRAM = b"%\nO0001\n" + b"".join(b"N%d G01 X%d.5 Y-%d.25\n" % (n, n % 90, n % 70) for n in range(40)) + b"M30\n%"


class Forgetful:
    """A sink that only counts."""

    def __init__(self) -> None:
        self.count = 0

    def write(self, data: bytes) -> None:
        self.count += len(data)


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """An engine brought to a point from which the suite goes on."""

    name: str
    make: Callable[[], Engine]


def _host(entry: ProtocolEntry) -> HostEngine:
    return entry.host(entry.params({}, End.HOST))


def _cnc(entry: ProtocolEntry) -> CncEngine:
    return entry.cnc(entry.params({}, End.CONTROL))


def _armed(entry: ProtocolEntry) -> HostEngine:
    engine = _host(entry)
    engine.start(BytesIO(PROGRAM * 20), 0)
    return engine


def _listening(entry: ProtocolEntry, sink: Sink | None = None) -> HostEngine:
    engine = _host(entry)
    engine.receive(sink or Forgetful(), 0)
    return engine


def _reading(entry: ProtocolEntry) -> CncEngine:
    engine = _cnc(entry)
    engine.cycle_start(0)
    return engine


def _punching(entry: ProtocolEntry) -> CncEngine:
    engine = _cnc(entry)
    engine.punch(BytesIO(PROGRAM), 0)
    return engine


def situations() -> Iterator[Situation]:
    """Every engine, idle and at the beginning of each job its protocol has."""
    for entry in PROTOCOLS.values():
        makers = [("host idle", _host), ("host armed", _armed), ("cnc idle", _cnc), ("cnc reading", _reading)]
        if entry.punches_out:
            makers += [("host listening", _listening), ("cnc punching", _punching)]
        for name, make in makers:
            yield Situation(name=f"{entry.name}: {name}", make=lambda make=make, entry=entry: make(entry))  # type: ignore[misc]


def hand_over(engine: Engine, now: Nanos, limit: int = 1 << 20) -> bytes:
    """Everything the engine wants to send at `now`, at most `limit` bytes, handed over and physically left at once."""
    said = bytearray()
    while len(said) < limit and (data := engine.data_to_send(min(64, limit - len(said)))):
        engine.data_sent(len(data), now)
        engine.data_left(len(data), now)
        said += data
    return bytes(said)


def settle(engine: Engine, now: Nanos) -> tuple[bytes, list[Event]]:
    """What a driver does after each call: recall, send, drain."""
    if engine.recall:
        engine.data_discarded(0, now)
    said = hand_over(engine, now)
    return said, drain(engine)


def drain(engine: Engine) -> list[Event]:
    events = []
    while (event := engine.next_event()) is not None:
        events.append(event)
    return events


def refuses(act: Callable[[], object]) -> bool:
    try:
        act()
    except UsageError:
        return True
    return False
