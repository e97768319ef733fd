"""The contract of every protocol engine.

An engine is one end of a line. It has no clock, no port and no randomness: time and bytes are its inputs, so the
same engine runs on a real port, in the simulated world and in a test, and a run can be repeated to the byte.

Why these verbs:

- Bytes are pulled (`data_to_send`, then `data_sent`), never pushed: the other side may stop us between any two of
  them, and what has not been pulled cannot overrun anybody.
- Handing over is not leaving. Between the engine and the wire stand a driver, a FIFO, an adapter. `data_sent` says a
  byte was handed over, `data_left` that it has physically gone, `data_discarded` that it was called back.
- `next_deadline` is a question without side effect and `handle_timer` is harmless when early.

A driver calls: first what the line brought, then `handle_timer` when due, then `data_to_send`/`data_sent` with no
other call between the two while the line has room, then it drains `next_event`. `line/link.py` is that rule.

The application's side is not part of this protocol: a host engine has `start`, `receive`, `abort`,
`hold_reception` and `release`; a CNC engine has `cycle_start`, `reset`, `alarm`, `punch` and `take`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final, Protocol, TypeAlias

__all__ = [
    "ALL_ON",
    "MICROSECOND",
    "MILLISECOND",
    "SECOND",
    "AfterStop",
    "Alarm",
    "Closure",
    "CncEngine",
    "Ended",
    "Engine",
    "Event",
    "Events",
    "Held",
    "HostEngine",
    "LineFault",
    "Named",
    "Nanos",
    "Notice",
    "Outcome",
    "Received",
    "Requested",
    "Resumed",
    "SignalsIn",
    "SignalsOut",
    "Sink",
    "Source",
    "Started",
    "Timers",
    "Violation",
]

Nanos: TypeAlias = int
"""A moment or a span in nanoseconds. Moments come from one monotonic clock whose zero means nothing."""

MICROSECOND: Final[Nanos] = 1_000
MILLISECOND: Final[Nanos] = 1_000_000
SECOND: Final[Nanos] = 1_000_000_000


class LineFault(StrEnum):
    """What a UART can report of a received character."""

    PARITY = "parity error"
    FRAMING = "framing error"
    UART_OVERRUN = "UART overrun"
    BREAK = "break"


class Closure(StrEnum):
    """How a line ended."""

    ORDERLY = "closed by the other side"
    """After all it had said; on TCP it counts as ER OFF."""
    LOST = "lost"
    """Unplugged, reset, power gone: what was on its way may be lost too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalsIn:
    """The control lines this end sees, True meaning ON. A line without them never reports any."""

    cts: bool = True
    dsr: bool = True
    cd: bool = True
    ri: bool = False
    """Ring indicator: no protocol here asks for it; it is shown and recorded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalsOut:
    """The control lines this end drives, True meaning ON."""

    rts: bool = True
    dtr: bool = True


ALL_ON: Final = SignalsOut()
"""An end that never holds the other by a control line drives this and nothing else."""


class Source(Protocol):
    """Where the bytes to send come from."""

    def read(self, size: int) -> bytes | None:
        """At most `size` bytes; `b""` at the end; None for nothing yet. Never blocks."""
        ...


class Sink(Protocol):
    """Where received bytes go."""

    def write(self, data: bytes) -> object:
        """Take all of `data`. Never blocks."""
        ...


class Outcome(StrEnum):
    """How a job ended. Whatever is not COMPLETE is spoken of as interrupted."""

    COMPLETE = "complete"
    CANCELLED = "cancelled"
    """By an act of a person, at the control or here."""
    FAILED = "failed"
    """By a fault."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Requested:
    """The control asks for a program. `number` is what it asked for, None where the protocol has no numbers."""

    number: str | None = None
    served: bool = True
    """False: nothing is armed, so nothing is sent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """A transfer began: the first byte may follow."""

    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """The other side stopped us; we wait."""

    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumed:
    """The other side lets us go on with the next byte."""

    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """`count` bytes of a program were written to the sink."""

    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class AfterStop:
    """A control saw `count` characters after its stop request had left; `allowed` is what it tolerates."""

    count: int
    allowed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A control raises an alarm: `number` as the manual prints it, "SR856"."""

    number: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """The other side, or the line, broke the rules `count` times running; the transfer goes on unless it says so."""

    what: str
    count: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """Something the operator should know that breaks no rule."""

    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """A job is over. `bytes_low` are certainly with the control, `bytes_high` is what it may have at most.

    For a reception both are the bytes stored.
    """

    outcome: Outcome
    reason: str
    bytes_low: int
    bytes_high: int


Event: TypeAlias = Requested | Started | Held | Resumed | Received | AfterStop | Alarm | Violation | Notice | Ended


class Events:
    """The queue behind `next_event`. A driver drains it after every call.

    Repeated violations and receptions are merged, so that a line full of noise does not fill the memory.
    """

    __slots__ = ("_queue",)

    def __init__(self) -> None:
        self._queue: deque[Event] = deque()

    def put(self, event: Event) -> None:
        last = self._queue[-1] if self._queue else None
        match event, last:
            case Violation(what=what, count=count), Violation(what=same, count=before) if what == same:
                self._queue[-1] = Violation(what=what, count=before + count)
            case Received(count=count), Received(count=before):
                self._queue[-1] = Received(count=before + count)
            case _:
                self._queue.append(event)

    def get(self) -> Event | None:
        return self._queue.popleft() if self._queue else None

    def __len__(self) -> int:
        return len(self._queue)


class Named(Enum):
    """A state, a timer, an act: each is there once, and is hashed as what it is, not by its text."""

    __hash__ = object.__hash__


class Timers:
    """Named deadlines in one table: start, stop, next, due.

    `name` is a member of an enumeration, so that a timer has the manual's name and not a number.
    """

    __slots__ = ("_deadlines",)

    def __init__(self) -> None:
        self._deadlines: dict[Enum, Nanos] = {}

    def start(self, name: Enum, at: Nanos) -> None:
        """Run `name` until the moment `at`; a running one is set anew."""
        self._deadlines[name] = at

    def stop(self, name: Enum) -> None:
        self._deadlines.pop(name, None)

    def stop_all(self) -> None:
        self._deadlines.clear()

    def running(self, *names: Enum) -> bool:
        """Any of them."""
        return not self._deadlines.keys().isdisjoint(names)

    def next(self) -> Nanos | None:
        """The nearest deadline."""
        return min(self._deadlines.values()) if self._deadlines else None

    def due(self, now: Nanos) -> Iterator[Enum]:
        """Each timer whose moment has come, earliest first, taken out of the table before it is handed out.

        A timer that the caller stops while handling an earlier one is not handed out any more.
        """
        while True:
            due = [(at, name.name, name) for name, at in self._deadlines.items() if at <= now]
            if not due:
                return
            name = min(due, key=lambda entry: entry[:2])[2]
            del self._deadlines[name]
            yield name


class Engine(Protocol):
    """One end of a line. See the module's docstring for the order of calls."""

    # from the line
    def receive_data(self, data: bytes, now: Nanos) -> None: ...

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """A character came damaged; `byte` is what the UART read, None where it read nothing."""
        ...

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        """The control lines as they are now: once when the line opens, then at every change.

        Never called on a line without control lines: the engine then takes all as ON and knows it cannot see them.
        """
        ...

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        """The line is gone. Nothing more comes and nothing more can be sent."""
        ...

    # to the line
    def data_to_send(self, limit: int) -> bytes:
        """Look at the next bytes, at most `limit` (at least 1). Does not consume and changes nothing."""
        ...

    def data_sent(self, count: int, now: Nanos) -> None:
        """The first `count` bytes of the last look were handed over to the line."""
        ...

    def data_left(self, count: int, now: Nanos) -> None:
        """`count` more of the bytes handed over have physically left, as far as the line can tell."""
        ...

    def data_discarded(self, count: int, now: Nanos) -> None:
        """The last `count` bytes handed over were called back and never leave. The answer to `recall`."""
        ...

    @property
    def recall(self) -> bool:
        """True: call back what was handed over and has not left, then say `data_discarded` (also with 0)."""
        ...

    @property
    def signals(self) -> SignalsOut:
        """The control lines this end wants."""
        ...

    # time and what happened
    def next_deadline(self) -> Nanos | None: ...

    def handle_timer(self, now: Nanos) -> None: ...

    def next_event(self) -> Event | None: ...


class HostEngine(Engine, Protocol):
    """The host computer's end."""

    def start(self, source: Source, now: Nanos) -> None:
        """Arm a program: it is sent when the control asks for it."""
        ...

    def receive(self, sink: Sink, now: Nanos) -> None:
        """Arm a reception: what the control punches out next goes to `sink`."""
        ...

    def abort(self, now: Nanos) -> None:
        """Give the job up. Nothing that would make a cut program look whole is sent. Ends as cancelled."""
        ...

    def hold_reception(self, now: Nanos) -> None:
        """Ask the control to pause its punch-out, because our side cannot keep up."""
        ...

    def release(self, now: Nanos) -> None:
        """Let a paused punch-out go on."""
        ...

    @property
    def progress(self) -> int:
        """Bytes of the program handed over, or stored, in this job."""
        ...

    @property
    def needs_stop_distance(self) -> int:
        """Characters the control tolerates after its stop request."""
        ...


class CncEngine(Engine, Protocol):
    """The control's end: the remote buffer and its communication."""

    def cycle_start(self, now: Nanos) -> None:
        """The control begins to read a program."""
        ...

    def reset(self, now: Nanos) -> None:
        """The operator presses RESET."""
        ...

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm for a reason of its own."""
        ...

    def punch(self, source: Source, now: Nanos) -> None:
        """The control punches a program out."""
        ...

    def take(self, count: int, now: Nanos) -> bytes:
        """The control takes at most `count` bytes of program out of the buffer, up to and including EOR."""
        ...

    @property
    def progress(self) -> int:
        """Bytes of program taken out of the buffer, or punched, in this operation."""
        ...

    @property
    def buffered(self) -> int:
        """Bytes of program in the buffer."""
        ...

    @property
    def program_ended(self) -> bool:
        """The end of the program has been taken: there is nothing to wait for."""
        ...
