"""A fault plan on a line as it is, a real one among them: a Transport around another that damages what passes.

What comes in is damaged when it is read, what goes out before it is handed over. A UART cannot be told to send a wrong
parity bit, so what goes out damaged goes out as another character, which nobody marks.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Final

from tapewire.engine import Nanos, SignalsIn, SignalsOut
from tapewire.line.faults.characters import Late
from tapewire.line.faults.injector import Injector, Injectors
from tapewire.line.faults.plan import (
    BaudMismatch,
    Break,
    EndFault,
    FaultPlan,
    Framing,
    LateStop,
    LineEnd,
    PlannedFault,
    Wire,
)
from tapewire.line.pacing import TxPacer
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance, Transport, watched_of

__all__ = ["FaultyTransport", "made_on_a_line"]

LOST_WINDOW: Final = 16
"""Characters that a pulled cable swallows at once: a line that leads nowhere still takes its time for them."""


def made_on_a_line(plan: FaultPlan, end: LineEnd) -> tuple[FaultPlan, tuple[str, ...]]:
    """What of `plan` a wrapper at `end` can make, and in words what it cannot."""
    outgoing = Wire.FROM_HOST if end is LineEnd.HOST else Wire.FROM_CONTROL
    incoming = Wire.FROM_CONTROL if end is LineEnd.HOST else Wire.FROM_HOST
    made: list[PlannedFault] = []
    missing: list[str] = []
    if plan.path is not None:
        missing.append(f"the path {plan.path.name}: a real line has its own")
    for fault in plan.faults:
        match fault:
            case _ if isinstance(fault, EndFault):
                missing.append(f"{fault.kind} of the {fault.end}: nobody touches the ends of a real line")
            case BaudMismatch():
                missing.append(f"{fault.kind} {fault.wire}: run one end at another --baud instead")
            case Framing() | Break() | LateStop() if fault.wire is not incoming:
                if fault.wire is Wire.BOTH:
                    made.append(replace(fault, wire=incoming))
                missing.append(f"{fault.kind} {outgoing}: what this end sends cannot be damaged so")
            case _:
                made.append(fault)
    return replace(plan, faults=tuple(made), path=None), tuple(dict.fromkeys(missing))


class _Ledger:
    """Which of the characters handed over became which of those written, as far as they can still be called back."""

    __slots__ = ("_runs", "_written")

    def __init__(self) -> None:
        self._runs: deque[list[int]] = deque()
        """[written, given] of runs; only a run of equals is longer than one character given."""
        self._written = 0

    def enter(self, written: int, given: int) -> None:
        self._written += written
        last = self._runs[-1] if self._runs else None
        if last is not None and last[0] == last[1] and written == given:
            last[0] += written
            last[1] += given
        else:
            self._runs.append([written, given])

    def forget(self, in_flight: int) -> None:
        """No more than `in_flight` of those written can still be called back."""
        while self._runs and self._written - self._runs[0][0] >= in_flight:
            self._written -= self._runs.popleft()[0]

    def call_back(self, written: int) -> int:
        """The last `written` never leave. Returns how many of those handed over that means."""
        given = 0
        while written and self._runs:
            run = self._runs[-1]
            if run[0] <= written:
                self._runs.pop()
                written -= run[0]
                self._written -= run[0]
                given += run[1]
                continue
            if run[0] == run[1]:
                run[1] -= written
                given += written
            run[0] -= written
            self._written -= written
            written = 0
        return given


class FaultyTransport:
    """`line`, on which `faults` happen as seen by `end`. Moments of the plan count from the first call.

    `character` is the time of one on the line, ns. A plan without faults changes nothing.
    """

    def __init__(self, line: Transport, faults: Injectors, end: LineEnd, *, character: Nanos) -> None:
        self._line = line
        is_host = end is LineEnd.HOST
        self._in: Injector = faults.from_control if is_host else faults.from_host
        self._out: Injector = faults.from_host if is_host else faults.from_control
        self._began: Nanos | None = None
        self._now: Nanos = 0
        self._ended = False
        self._late: deque[tuple[Nanos, LineItem]] = deque()
        """What was read and is passed on at its moment."""
        self._late_until: Nanos = 0
        self._extra = bytearray()
        """What is written as soon as there is room: doubled characters, noise."""
        self._ledger = _Ledger()
        self._swallowed = TxPacer(character, LOST_WINDOW)
        """Characters that left into a cable that is not plugged."""
        self._cts = True
        self._room = 0

    @property
    def watched(self) -> int | None:
        """What the line itself says."""
        return watched_of(self._line)

    @property
    def stop_distance(self) -> StopDistance:
        return self._line.stop_distance

    def read(self, now: Nanos) -> list[LineItem]:
        items = self._line.read(now)
        since = self._since(now)
        if not self._ended:
            self._happen(now, since, idle=not items)
        for item in items:
            self._pass(item, now, since)
        passed: list[LineItem] = []
        while self._late and self._late[0][0] <= now:
            passed.append(self._late.popleft()[1])
        self._flush(now)
        return passed

    def _since(self, now: Nanos) -> Nanos:
        """`now` as the plan counts."""
        self._now = now
        if self._began is None:
            self._began = now
        return now - self._began

    def _happen(self, now: Nanos, since: Nanos, *, idle: bool) -> None:
        while (moment := self._in.next_moment) is not None and moment <= since:
            for item in self._in.fire(idle=idle):
                self._pass_on(item, now)
        while (moment := self._out.next_moment) is not None and moment <= since:
            for item in self._out.fire(idle=not self._line.in_flight(now)):
                self._send_extra(item, now)

    def _send_extra(self, item: bytes | Fault | SignalsIn, now: Nanos) -> None:
        match item:
            case SignalsIn():
                self._drive(item, now)
            case bytes():
                self._extra += item
                self._ledger.enter(len(item), 0)
            case Fault(byte=int(byte)):
                self._extra.append(byte)
                self._ledger.enter(1, 0)

    def _pass(self, item: LineItem, now: Nanos, since: Nanos) -> None:
        match item:
            case bytes():
                for _, arrived in self._in.characters(item, since, 0):
                    if isinstance(arrived, Late):
                        self._late_until = max(self._late_until, now + arrived.span)
                    else:
                        self._pass_on(arrived, now)
            case SignalsIn():
                for seen in self._in.signals(item, since):
                    self._pass_on(seen, now)
            case Fault():
                if not self._in.pulled:
                    self._pass_on(item, now)
            case Closed():
                self._ended = True
                self._late_until = now
                self._late = deque((now, waiting) for _, waiting in self._late)
                self._pass_on(item, now)

    def _pass_on(self, item: LineItem, now: Nanos) -> None:
        if isinstance(item, SignalsIn):
            self._cts = item.cts
        self._late.append((max(now, self._late_until), item))

    def room(self, now: Nanos) -> int:
        """Nothing while doubled characters wait, or while a fault shows CTS OFF."""
        self._now = now
        self._flush(now)
        self._room = self._line.room(now)
        if not self._cts or self._extra:
            self._room = 0
        if self._swallowed.in_flight(now):
            self._room = min(self._room, self._swallowed.room(now))
        return self._room

    def write(self, data: bytes, now: Nanos) -> None:
        assert len(data) <= self._room, f"{len(data)} characters into room for {self._room}"
        self._room -= len(data)
        if self._out.passes(len(data)):
            self._ledger.enter(len(data), len(data))
            self._line.write(data, now)
            return
        lost = self._out.lost
        sent = [bytearray() for _ in data]
        for place, item in self._out.characters(data, self._since(now), 0):
            self._spread(sent, place, item)
        for piece in sent:
            self._ledger.enter(len(piece), 1)
        written = b"".join(sent)
        if written:
            self._line.write(written[: len(data)], now)
        self._extra += written[len(data) :]
        if self._out.pulled:
            self._swallowed.hand_over(self._out.lost - lost, now)

    @staticmethod
    def _spread(sent: list[bytearray], place: int, item: bytes | Fault | Late) -> None:
        """Note what goes out for each character, damaged ones as what would be read of them."""
        match item:
            case bytes() if len(item) > 1:
                for offset, byte in enumerate(item):
                    sent[place + offset].append(byte)
            case bytes():
                sent[place] += item
            case Fault(byte=int(byte)):
                sent[place].append(byte)

    def _flush(self, now: Nanos) -> None:
        """Write what is too much for the room there was."""
        if self._extra and (room := self._line.room(now)):
            self._line.write(bytes(self._extra[:room]), now)
            del self._extra[:room]
        self._ledger.forget(self._line.in_flight(now) + len(self._extra))

    def in_flight(self, now: Nanos) -> int:
        return self._line.in_flight(now) + len(self._extra) + self._swallowed.in_flight(now)

    def on_its_way(self, now: Nanos) -> int:
        return self._line.on_its_way(now) + len(self._extra) + self._swallowed.in_flight(now)

    def discard(self, now: Nanos) -> int:
        count = len(self._extra) + self._line.discard(now)
        self._extra.clear()
        return self._ledger.call_back(count)

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        driven = SignalsIn(cts=signals.rts, dsr=signals.dtr, cd=signals.dtr)
        for seen in self._out.signals(driven, self._since(now)):
            self._drive(seen, now)

    def _drive(self, seen: SignalsIn, now: Nanos) -> None:
        """Show the other end what it is to see."""
        self._line.set_signals(SignalsOut(rts=seen.cts, dtr=seen.dsr), now)

    def next_deadline(self) -> Nanos | None:
        moments = [self._line.next_deadline(), self._swallowed.next_deadline(self._now)]
        if self._began is not None and not self._ended:
            coming = (self._in.next_moment, self._out.next_moment)
            moments += [self._began + moment for moment in coming if moment is not None]
        if self._late:
            moments.append(self._late[0][0])
        return min((moment for moment in moments if moment is not None), default=None)

    def close(self, now: Nanos) -> None:
        self._ended = True
        self._late.clear()
        self._extra.clear()
        self._line.close(now)
