"""What was seen of one transfer, apart from what the engines say: the wires, the faults, the persons.

The checkers judge by this and nothing else, so that an engine cannot talk its way out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from tapewire.engine import Nanos, Outcome
from tapewire.line.faults.log import Injected
from tapewire.line.faults.plan import EndFault, Wire
from tapewire.line.link import Link
from tapewire.line.transport import Fault, LineItem
from tapewire.sim.frames import LAST_CODES, last_codes
from tapewire.sim.names import Undetectable

__all__ = ["Attempt", "Damage", "Evidence", "Job", "Tap", "Wait"]

MOST_DAMAGES: Final = 500_000
"""A wrong baud rate damages nearly every character, and 64 KB go there and back a few times. More excuse nothing."""


@dataclass(frozen=True, slots=True)
class Damage:
    """One stroke of a fault on a wire: `sent` went in, `arrived` came out. `place` counts characters from 1; 0 is what
    came out of nothing.
    """

    moment: Nanos
    kind: str
    wire: Wire
    place: int
    sent: bytes
    arrived: tuple[bytes | Fault, ...]
    late: Nanos = 0
    """So much later than it would have been it arrives, and what is behind it."""
    told: int = 0
    """Characters that the host had handed over then."""

    @property
    def plain(self) -> bytes:
        """What arrived without a mark."""
        return b"".join(item for item in self.arrived if isinstance(item, bytes))

    @property
    def marked(self) -> bool:
        """The receiver was told that something is wrong here."""
        return any(isinstance(item, Fault) for item in self.arrived)

    @property
    def unseen(self) -> bool:
        """Nothing tells the receiver of it, and what it reads is not what was sent."""
        return not self.marked and self.plain != self.sent

    @property
    def name(self) -> Undetectable:
        """How what the receiver reads differs."""
        if not self.sent:
            return Undetectable.OUT_OF_NOTHING
        if not self.plain:
            return Undetectable.LOST
        return Undetectable.DOUBLED if len(self.plain) > len(self.sent) else Undetectable.FLIP


@dataclass(slots=True)
class Tap:
    """What one end handed over, less what was called back, and what it was brought, marks left out."""

    sent: bytearray = field(default_factory=bytearray)
    brought: bytearray = field(default_factory=bytearray)
    stops: frozenset[int] = frozenset()
    """Characters that stop this end, as it reads them,"""
    goes: frozenset[int] = frozenset()
    """and those that let it go on, or end what it was doing."""
    opens: frozenset[int] = frozenset()
    """Behind these the other end has something to say, and until another code nothing stops this one."""
    codes: frozenset[int] = frozenset()
    """What counts as a code where codes are listened for."""
    last_codes: bytes = b""
    """The last ones that were brought unmarked."""
    after_stop: int = 0
    """Characters handed over between one and the other."""
    _stopped: bool = False
    _opened: bool = False

    def listen(self, link: Link) -> None:
        link.on_write = self._write if self.stops else self.sent.extend
        link.on_recall = self.never_left
        before = link.on_item
        link.on_item = self._hear if before is None else _both(self._hear, before)

    def never_left(self, count: int) -> None:
        """The last `count` characters handed over were called back, or lost with the power."""
        if count:
            del self.sent[-count:]

    def _write(self, data: bytes) -> None:
        self.sent += data
        if self._stopped:
            self.after_stop += len(data)

    def _hear(self, item: LineItem, now: Nanos) -> None:
        if isinstance(item, bytes):
            self.brought += item
            if self.codes and (found := last_codes(item, self.codes)):
                self.last_codes = (self.last_codes + found)[-LAST_CODES:]
            for byte in item if self.stops else b"":
                if byte in self.stops:
                    self._stopped = self._stopped or not self._opened
                else:
                    self._stopped = self._stopped and byte not in self.goes
                    self._opened = byte in self.opens or (self._opened and byte not in self.codes)
        elif isinstance(item, Fault) and item.byte is not None:
            self.brought.append(item.byte)


def _both(
    first: Callable[[LineItem, Nanos], None], second: Callable[[LineItem, Nanos], None]
) -> Callable[[LineItem, Nanos], None]:
    def hear(item: LineItem, now: Nanos) -> None:
        first(item, now)
        second(item, now)

    return hear


@dataclass(slots=True)
class Attempt:
    """One reading of a program by the control, or one punch-out, from its CYCLE START on."""

    began: Nanos
    armed: bool
    """The host had something to give, or waited for what came."""
    place: int
    """Characters the host had sent before,"""
    heard: int
    """and the control,"""
    brought: int
    """and those that had been brought to the end that takes the program."""
    delivered: bytearray = field(default_factory=bytearray)
    """What came out at the other end."""
    got: int = 0
    """The most of the program that was ever there: taken, or in the buffer."""
    asked: Nanos = 0
    """When a Bridgeport control, behind the name, had handed over its request."""


@dataclass(slots=True)
class Job:
    """What the host was armed with, and what it said of it."""

    began: Nanos
    attempts_before: int
    place: int = 0
    """Characters the host had sent before."""
    complete: bool | None = None
    """None: it has not ended, or its process was killed."""
    killed: bool = False
    reason: str = ""
    low: int = 0
    high: int = 0
    got_at_end: int = 0
    delivered_at_end: int = 0
    ended: Nanos = 0
    stored: bytearray = field(default_factory=bytearray)
    """What a reception has stored."""

    def covers(self, moment: Nanos) -> bool:
        return self.began <= moment and (not self.ended or moment <= self.ended)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wait:
    """Patience was over, and the operator had to end it."""

    who: tuple[str, ...]
    """Those who were still waiting."""
    job: Job
    attempt: Attempt | None
    said: bytes
    """The last codes that the control had said,"""
    heard: bytes
    """and the last ones that had come to the host unmarked."""
    last_place: int = 0
    """Of all characters that the control had said, counted from 1."""
    brought: int = 0
    """Characters that had been brought to the host."""
    told: int = 0
    """Characters that the host had handed over."""
    moving: bool = False
    """The control was in the middle of a block."""


@dataclass(slots=True)
class Evidence:
    """Everything about one transfer."""

    program: bytes
    expected: bytes
    """The same as it comes out at the other end: the control may have been told to convert it."""
    host: Tap = field(default_factory=Tap)
    cnc: Tap = field(default_factory=Tap)
    damages: list[Damage] = field(default_factory=list)
    acts: list[tuple[Nanos, str]] = field(default_factory=list)
    """What persons did, and what happened to the ends."""
    sleeps: list[tuple[Nanos, Nanos]] = field(default_factory=list)
    """From when to when the host's computer did nothing."""
    attempts: list[Attempt] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)
    last_disturbance: Nanos = 0
    cut_short: list[int] = field(default_factory=list)
    """Where in what the host has sent its process ended, in the middle of a message or not."""
    control_ends: list[tuple[Nanos, Outcome]] = field(default_factory=list)
    """How the operations of the control ended."""
    waits: list[Wait] = field(default_factory=list)
    """Where patience was over."""
    stuck: list[str] = field(default_factory=list)
    """Who did not end even then."""
    broken: str = ""
    """What an engine or the world raised."""
    disagreement: str = ""
    """What the ends believed differently when a job was complete."""
    footprint: int = 0
    """The most memory an engine held, bytes."""
    overruns: list[tuple[Nanos, int, int]] = field(default_factory=list)
    """Characters after a stop: when told, how many, how many are allowed."""

    @property
    def overruns_beyond(self) -> bool:
        """More came after a stop than the control tolerates: it may then end the job."""
        return any(count > allowed for _, count, allowed in self.overruns)

    def note_fault(self, entry: Injected) -> None:
        self.last_disturbance = max(self.last_disturbance, entry.moment)
        if len(self.damages) < MOST_DAMAGES:
            what = entry.sent, entry.arrived, entry.late
            self.damages.append(Damage(entry.moment, entry.kind, entry.wire, entry.place, *what, len(self.host.sent)))

    def note_act(self, what: str, now: Nanos) -> None:
        self.acts.append((now, what))
        self.last_disturbance = max(self.last_disturbance, now)

    def control_ended(self, job: Job, *outcomes: Outcome) -> bool:
        """In the time of `job`."""
        return any(outcome in outcomes and job.covers(moment) for moment, outcome in self.control_ends)

    def handed_over(self, attempt: Attempt, since: int) -> bytes:
        """By the host, from its character `since` on until the attempt behind `attempt` began."""
        later = [other.place for other in self.attempts if other.began > attempt.began]
        return bytes(self.host.sent[since : min(later, default=None)])

    def happened(self, *whats: str) -> bool:
        return any(what in whats for _, what in self.acts)

    def note_end_fault(self, fault: EndFault, now: Nanos) -> None:
        self.note_act(f"{fault.kind}: {fault.end}", now)

    def on(self, wire: Wire) -> list[Damage]:
        """Damages of characters on `wire`."""
        return [damage for damage in self.damages if damage.wire is wire and (damage.sent or damage.arrived)]

    @property
    def left_alone(self) -> bool:
        """Nobody and nothing interfered with the first job but what happened to characters."""
        job = self.jobs[0] if self.jobs else None
        return job is not None and not any(moment <= job.ended or job.complete is None for moment, _ in self.acts)

    @property
    def host_lives(self) -> list[bytes]:
        """What the host has sent, from one beginning of its process to the next."""
        sent = bytes(self.host.sent)
        places = [0, *self.cut_short, len(sent)]
        return [sent[begin:end] for begin, end in itertools.pairwise(places)]

    def unseen(self, wire: Wire) -> list[Damage]:
        return [damage for damage in self.on(wire) if damage.unseen]

    def kinds(self, *kinds: str) -> bool:
        return any(damage.kind.startswith(kinds) for damage in self.damages)
