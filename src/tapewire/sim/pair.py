"""One machine of the simulated world: a host, a cable, a control with its operator, and what was seen of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Final

from tapewire.engine import CncEngine, Ended, Engine, Event, HostEngine, Nanos, Received, Sink
from tapewire.line.faults.injector import Injectors
from tapewire.line.link import Application, Link
from tapewire.line.reception import Cut
from tapewire.line.simulated import CableEnd
from tapewire.line.transport import Closed, Fault, LineItem, Transport
from tapewire.protocols import ProtocolEntry, Reader
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.machine import Control
from tapewire.sim.transcript import Transcript, event_text

__all__ = ["MOST_EVENTS", "Pair", "Side"]

MAX_STEPS_AT_ONCE: Final = 1000
"""Steps at one moment after which the world is taken to run in circles."""

MOST_EVENTS: Final = 1_000_000
"""Events of one end that are kept. A dialogue of a day has a few thousand, a punch-out at a wrong rate 200,000."""


class Side:
    """An end of the line as the world runs it: when it wakes, and whether it is awake at all.

    `late` says how much later than it wanted its computer wakes it, each time; None is a control, which is never late.
    """

    __slots__ = ("_due", "_missed", "_wanted", "asleep_until", "late", "link", "off")

    def __init__(self, link: Link) -> None:
        self.link = link
        self.asleep_until: Nanos = 0
        """A computer that stalls: nothing of this end happens before."""
        self.off = False
        """Its power is off, or its program does not run."""
        self.late: Callable[[], Nanos] | None = None
        self._wanted: Nanos | None = None
        self._due: Nanos | None = None
        self._missed = False
        """Somebody acted on this end while it was asleep: what it has to say to that waits for no deadline."""

    def step(self, now: Nanos) -> None:
        if self.off:
            return
        self._missed = now < self.asleep_until
        if not self._missed:
            self.link.step(now)

    def due(self) -> Nanos | None:
        """When it steps next by itself."""
        if self.off:
            return None
        if self._missed:
            return self.asleep_until
        wanted = self.link.next_deadline()
        if wanted is None:
            return None
        if self.late is not None:
            if wanted != self._wanted:
                self._wanted = wanted
                self._due = wanted + self.late()
            assert self._due is not None
            wanted = self._due
        return wanted if wanted > self.asleep_until else self.asleep_until


@dataclass(slots=True)
class Pair:
    """One machine: a host, a cable and a control with its operator.

    `host_events` and `cnc_events` collect (moment, event); `program` is what the control has taken, `received` a
    place for what the host receives.
    """

    entry: ProtocolEntry
    host_params: Any
    cnc_params: Any
    host: HostEngine
    cnc: CncEngine
    control: Control
    host_side: Side
    cnc_side: Side
    program: BytesIO
    transcript: Transcript
    line: Injectors
    """What goes wrong on the line; `line.log` is what was done to it."""
    received: BytesIO = field(default_factory=BytesIO)
    host_events: list[tuple[Nanos, Event]] = field(default_factory=list)
    cnc_events: list[tuple[Nanos, Event]] = field(default_factory=list)
    host_end: Ended | None = None
    """How the host's last job ended."""
    cnc_end: Ended | None = None
    """How the control's last operation ended."""
    on_host_event: Callable[[Event, Nanos], None] | None = None
    on_cnc_event: Callable[[Event, Nanos], None] | None = None
    on_step: Callable[[Nanos], None] | None = None
    """Called after every step of either end."""
    _dues: tuple[Nanos | None, Nanos | None] = (None, None)
    _readers: tuple[Reader, Reader] | None = None

    @property
    def host_link(self) -> Link:
        return self.host_side.link

    @property
    def cnc_link(self) -> Link:
        return self.cnc_side.link

    def step(self, now: Nanos) -> None:
        """Both ends, whether they are due or not: somebody may have acted on them."""
        self.host_side.step(now)
        self.cnc_side.step(now)

    def settle(self, now: Nanos, *, touched: bool) -> Nanos | None:
        """Step until nothing is left to do at this moment; the nearest deadline after it. Only who is due is stepped,
        unless somebody has `touched` the machine since.
        """
        if touched:
            self.step(now)
            if self.on_step is not None:
                self.on_step(now)
            host, cnc = self.host_side.due(), self.cnc_side.due()
        else:
            host, cnc = self._dues
        for _ in range(MAX_STEPS_AT_ONCE):
            host_due, cnc_due = host is not None and host <= now, cnc is not None and cnc <= now
            if not host_due and not cnc_due:
                self._dues = host, cnc
                return host if cnc is None or (host is not None and host < cnc) else cnc
            if host_due:
                self.host_side.step(now)
            if cnc_due:
                self.cnc_side.step(now)
            if self.on_step is not None:
                self.on_step(now)
            host, cnc = self.host_side.due(), self.cnc_side.due()
        raise AssertionError(f"no end of steps at {now} ns:\n{self.transcript}")

    def calm(self) -> None:
        """From now on nothing more goes wrong on the line."""
        self.line.from_host.calm()
        self.line.from_control.calm()

    def next_deadline(self) -> Nanos | None:
        return min((due for due in (self.host_side.due(), self.cnc_side.due()) if due is not None), default=None)

    # ends that lose their power or their program

    def cut_power(self, side: Side, now: Nanos) -> Cut:
        """The end is dead from the middle of the character it is sending."""
        side.off = True
        return _end(side).cut_power(now)

    def kill_host(self, now: Nanos) -> None:
        """The host's program is gone: what its driver holds still leaves, and the control lines stay."""
        self.host_side.off = True
        _end(self.host_side).abandon(now)

    def restart_host(self, now: Nanos) -> None:
        """The host's program is started anew on the same port: it knows nothing of what was."""
        self.host = self.entry.host(self.host_params)
        self._restart(self.host_side, self._connect_host(self.host, self.host_link.transport), now)

    def restart_control(self, sink: Sink, now: Nanos, **operator: Any) -> None:
        """The control comes back with nothing in its memory."""
        self.cnc = self.entry.cnc(self.cnc_params)
        operator.setdefault("binary", binary_operation(self.entry.binary_input(self.cnc_params)))
        self.control = Control(self.cnc, sink, eob=self.entry.text(self.cnc_params).eob, **operator)
        self._restart(self.cnc_side, self._connect_cnc(self.cnc, self.cnc_link.transport, self.control), now)

    @staticmethod
    def _restart(side: Side, link: Link, now: Nanos) -> None:
        """What came while nobody listened is gone; the control lines are told as when a port is opened."""
        _end(side).restore(now)
        side.link = link
        side.off = False

    def _connect_host(self, host: Engine, transport: Transport) -> Link:
        return Link(host, transport, on_event=self._note_host, on_item=self._hear("cnc", 1))

    def _connect_cnc(self, cnc: Engine, transport: Transport, control: Application) -> Link:
        return Link(cnc, transport, application=control, on_event=self._note_cnc, on_item=self._hear("host", 0))

    def connect(self) -> None:
        """Have both links tell what they see."""
        self.host_side.link = self._connect_host(self.host, self.host_link.transport)
        self.cnc_side.link = self._connect_cnc(self.cnc, self.cnc_link.transport, self.control)

    def _hear(self, who: str, reader: int) -> Callable[[LineItem, Nanos], None] | None:
        if not self.transcript.kept_lines:
            return None
        if self._readers is None:
            # One pair of readers for both directions: what one end says tells how the other is to be read.
            self._readers = self.entry.words(self.cnc_params)
        return _listener(self.transcript, who, self._readers[reader])

    def _note_host(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Ended):
            self.host_end = event
        self._note(event, now, "host", self.host_events)
        if self.on_host_event is not None:
            self.on_host_event(event, now)

    def _note_cnc(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Ended):
            self.cnc_end = event
        self._note(event, now, "cnc", self.cnc_events)
        if self.on_cnc_event is not None:
            self.on_cnc_event(event, now)

    def _note(self, event: Event, now: Nanos, who: str, events: list[tuple[Nanos, Event]]) -> None:
        if not isinstance(event, Received):
            assert len(events) < MOST_EVENTS, f"{who} tells more than {MOST_EVENTS} events:\n{self.transcript}"
            events.append((now, event))
        if self.transcript.kept_lines and (text := event_text(event)):
            self.transcript.happened(who, text, now)


def _end(side: Side) -> CableEnd:
    """What happens to a computer happens to its end of the cable."""
    end = side.link.transport
    assert isinstance(end, CableEnd)
    return end


def _listener(transcript: Transcript, who: str, read: Reader) -> Callable[[LineItem, Nanos], None]:
    def listen(item: LineItem, now: Nanos) -> None:
        match item:
            case bytes():
                for word in read(item):
                    transcript.said(who, word, now)
            case Fault(fault=fault):
                transcript.said(who, f"({fault})", now)
            case Closed(reason=reason):
                transcript.happened(who, reason, now)
            case _:
                pass

    return listen
