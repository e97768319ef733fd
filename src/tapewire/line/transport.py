"""The contract of every line, as small and as clock-free as the engine's: the simulated cable and a real port obey
the same rule.

Every call returns at once. Pacing lives in `room` and nowhere else: a line that must not have more than so many
characters in flight says 0, and nobody above it needs to know why.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias, cast

from tapewire.engine import Closure, LineFault, Nanos, SignalsIn, SignalsOut

__all__ = [
    "Closed",
    "Fault",
    "LineItem",
    "StopDistance",
    "Transport",
    "can_break",
    "send_break",
    "slack_of",
    "watched_of",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A damaged character, at its place among the others. `byte` is what was read, None where nothing was."""

    fault: LineFault
    byte: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Closed:
    """The line is gone. Always the last item."""

    closure: Closure
    reason: str


LineItem: TypeAlias = bytes | Fault | SignalsIn | Closed


@dataclass(frozen=True, slots=True, kw_only=True)
class StopDistance:
    """How many characters may still reach the control after its stop request has reached this computer."""

    characters: int
    guaranteed: bool
    """False: it rests on a model of the line (TCP, a pseudo terminal), not on asking the transmitter."""
    how: str
    """Where the figure comes from, in words for the operator."""


class Transport(Protocol):
    """One end of a line."""

    def read(self, now: Nanos) -> list[LineItem]:
        """What came since the last call: bytes, faults, signal changes and the end, in the order they came.

        A line with control lines reports them once at the first call and then at every change.
        """
        ...

    def room(self, now: Nanos) -> int:
        """How many characters may be handed over now; 0 while CTS is OFF."""
        ...

    def write(self, data: bytes, now: Nanos) -> None:
        """Hand `data` over; never more than the last `room`."""
        ...

    def in_flight(self, now: Nanos) -> int:
        """Characters handed over that a line at its rate would still be carrying, and at least `on_its_way`."""
        ...

    def on_its_way(self, now: Nanos) -> int:
        """Characters handed over that have not left, as far as the line can tell: over TCP, what the other computer
        has not acknowledged; on a pseudo terminal, what its other side has not read.
        """
        ...

    def discard(self, now: Nanos) -> int:
        """Call back what has not left. Returns how many characters, counted from the last one handed over."""
        ...

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None: ...

    def next_deadline(self) -> Nanos | None:
        """When this line has something to say without being woken: room again, all left, characters come in."""
        ...

    @property
    def stop_distance(self) -> StopDistance: ...

    def close(self, now: Nanos) -> None:
        """Let go of the line. Harmless when done twice."""
        ...


def watched_of(transport: Transport) -> int | None:
    """The descriptor whose readiness means that `read` has something; None while there is none to wait on, as always
    on a line in memory. A line around another passes on what that one says.
    """
    watched: int | None = getattr(transport, "watched", None)
    return watched


def slack_of(transport: Transport) -> Nanos:
    """How much later than its deadline a line may be looked at without a gap on the wire; 0 unless it says more."""
    slack: Nanos = getattr(transport, "slack", 0)
    return slack


class _Breaks(Protocol):
    can_break: bool

    def send_break(self, now: Nanos) -> None: ...


def can_break(transport: Transport) -> bool:
    """The wire can be held for longer than any character: a serial port here, or behind a server by RFC 2217."""
    can: bool = getattr(transport, "can_break", False)
    return can


def send_break(transport: Transport, now: Nanos) -> None:
    """Hold the wire of a line that `can_break`, behind all that was handed over; there is no room until it is over."""
    assert can_break(transport), "this kind of line has no breaks"
    cast(_Breaks, transport).send_break(now)
