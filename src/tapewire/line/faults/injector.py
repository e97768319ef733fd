"""Carries a fault plan out on one wire: decides what happens to which character, edge and moment.

It works on the characters of a wire in their order and is handed the moments, so that the simulated cable and a real
line run the same plan. Each fault of a plan draws from a stream of its own: what one of them does shifts none of the
others, and how time is cut shifts nothing.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from tapewire.engine import LineFault, Nanos, SignalsIn
from tapewire.line.faults.chance import SplitMix, Stream
from tapewire.line.faults.characters import STOP_CODES, CharacterRule, Late, Passed, StopRule
from tapewire.line.faults.damage import Parity, garbled, misreadings
from tapewire.line.faults.log import FaultLog, Injected
from tapewire.line.faults.plan import (
    At,
    BaudMismatch,
    Break,
    Every,
    Extent,
    FaultPlan,
    HoldSignal,
    LateStop,
    LinePlan,
    Noise,
    Nth,
    PerTransfer,
    PullCable,
    Rate,
    Sight,
    When,
    Wire,
)
from tapewire.line.faults.signals import SignalFaults
from tapewire.line.faults.when import NEVER, next_moment
from tapewire.line.transport import Fault

__all__ = ["Injector", "Injectors", "injectors"]

Came: TypeAlias = bytes | Fault | SignalsIn
"""What comes of a fault that happens by itself."""


class Injector:
    """The faults of one wire. `character` is the time one takes on it, ns; `parity` is what its receiver checks.

    `characters` is what a wire does to what was sent, `signals` to what the other end drives; `next_moment` and
    `fire` are what happens without either.
    """

    def __init__(
        self,
        wire: Wire,
        log: FaultLog,
        *,
        extent: Extent | None = None,
        character: Nanos = 0,
        parity: Parity = Parity.CHECKED,
    ) -> None:
        self.wire = wire
        self.log = log
        self.seen = 0
        """Characters that came to this wire."""
        self.lost = 0
        """Those of them that did not arrive."""
        self.added = 0
        """What arrived and was never sent; a break counts."""
        self.damaged = 0
        """Characters that arrived other than they were sent, marked or not."""
        self._extent = extent or Extent()
        self._character = character
        self._parity = parity
        self._rules: list[CharacterRule] = []
        self._stops: list[StopRule] = []
        self._stops_seen = 0
        self._misread: tuple[bytes | Fault, ...] | None = None
        self._signals = SignalFaults()
        self._pulled = 0
        """Cables pulled now."""
        self._due = NEVER
        """Characters that pass before the next one that may be hit."""
        self._moments: list[tuple[Nanos, int, Callable[[Nanos, bool], list[Came]]]] = []
        self._moments_made = 0
        self._calm = False

    def add(self, fault: LinePlan, draws: Stream) -> None:
        """One more fault of the plan, with the stream it draws from."""
        match fault:
            case BaudMismatch(percent=percent):
                self._misread = misreadings(percent, self._parity)
            case PullCable(when=when):
                self._schedule(when, draws, lambda moment, idle: self._pull(fault, moment))
            case LateStop():
                self._stops.append(StopRule(fault, draws))
            case HoldSignal(when=Nth() | Rate()):
                self._signals.add(fault, draws)
            case HoldSignal(when=when):
                self._schedule(when, draws, lambda moment, idle: self._hold(fault, moment))
            case Noise(when=PerTransfer() | At() | Every() as when):
                self._schedule(when, draws, lambda moment, idle: self._noise(draws, moment, idle))
            case Break(when=PerTransfer() | At() | Every() as when):
                self._schedule(when, draws, lambda moment, idle: self._break(moment))
            case _:
                rule = CharacterRule(fault, draws, self._extent)
                self._rules.append(rule)
                self._schedule_arming(fault.when, rule, draws)
        self._look_ahead()

    def calm(self) -> None:
        """Nothing more goes wrong; a line that is held and a cable that is pulled come back in their time."""
        self._calm = True
        self._rules.clear()
        self._stops.clear()
        self._misread = None
        self._signals.calm()
        self._look_ahead()

    # moments

    @property
    def next_moment(self) -> Nanos | None:
        """When something happens by itself."""
        return self._moments[0][0] if self._moments else None

    def is_due(self, moment: Nanos) -> bool:
        """Something has happened by itself by `moment`."""
        return bool(self._moments) and self._moments[0][0] <= moment

    def fire(self, *, idle: bool) -> list[Came]:
        """Let happen what is next. `idle`: no character is under way on this wire at that moment."""
        moment, _, happens = heapq.heappop(self._moments)
        return happens(moment, idle)

    def _at(self, moment: Nanos, happens: Callable[[Nanos, bool], list[Came]]) -> None:
        self._moments_made += 1
        heapq.heappush(self._moments, (moment, self._moments_made, happens))

    def _schedule(self, when: When, draws: Stream, act: Callable[[Nanos, bool], list[Came]], after: Nanos = 0) -> None:
        moment = next_moment(when, draws, after, self._extent)
        if moment is None:
            return

        def happens(moment: Nanos, idle: bool) -> list[Came]:
            if self._calm:
                return []
            self._schedule(when, draws, act, moment)
            return act(moment, idle)

        self._at(moment, happens)

    def _schedule_arming(self, when: When, rule: CharacterRule, draws: Stream) -> None:
        """A fault of characters at a moment hits the next one."""
        if isinstance(when, At | Every):
            self._schedule(when, draws, lambda moment, idle: self._arm(rule))

    def _arm(self, rule: CharacterRule) -> list[Came]:
        rule.due = self.seen
        self._look_ahead()
        return []

    def _noise(self, draws: Stream, moment: Nanos, idle: bool) -> list[Came]:
        return self._out_of_nothing(Noise.kind, moment, garbled(draws, self._parity)) if idle else []

    def _break(self, moment: Nanos) -> list[Came]:
        return self._out_of_nothing(Break.kind, moment, Fault(fault=LineFault.BREAK))

    def _out_of_nothing(self, kind: str, moment: Nanos, item: bytes | Fault) -> list[Came]:
        if self._pulled:
            return []
        self.log.note(moment, kind, self.wire, 0, b"", (item,))
        self.added += 1
        return [item]

    def _pull(self, fault: PullCable, moment: Nanos) -> list[Came]:
        shows = int(fault.sight is Sight.SEEN)
        if self.wire is Wire.FROM_HOST:
            self.log.note(moment, fault.kind, Wire.BOTH, 0)
        self._pulled += 1
        self._signals.gone += shows

        def plugged(moment: Nanos, idle: bool) -> list[Came]:
            self._pulled -= 1
            self._signals.gone -= shows
            self._look_ahead()
            return [*self._signals.change()]

        self._at(moment + fault.span, plugged)
        self._look_ahead()
        return [*self._signals.change()]

    # control lines

    def signals(self, driven: SignalsIn, moment: Nanos) -> list[SignalsIn]:
        """What the receiving end sees when the other end drives `driven`: one change, or none."""
        for fault, level, number in self._signals.drive(driven):
            self._hold_at(fault, level, moment, number)
        return self._signals.change()

    def _hold(self, fault: HoldSignal, moment: Nanos) -> list[Came]:
        self._hold_at(fault, self._signals.level_held(fault), moment, 0)
        return [*self._signals.change()]

    def _hold_at(self, fault: HoldSignal, level: bool, moment: Nanos, number: int) -> None:
        self.log.note(moment, f"{fault.signal} {fault.level}", self.wire, number)
        self._signals.hold(fault.signal, level)

        def let_go(moment: Nanos, idle: bool) -> list[Came]:
            self._signals.let_go(fault.signal, level)
            return [*self._signals.change()]

        self._at(moment + fault.span, let_go)

    # characters

    @property
    def pulled(self) -> bool:
        """Nothing passes now."""
        return self._pulled > 0

    @property
    def spared(self) -> int:
        """How many characters pass before the next one that a fault hits."""
        due = self._due or min((rule.due for rule in self._rules), default=NEVER)
        return due - self.seen

    def passes(self, count: int) -> bool:
        """True when nothing happens to the next `count` characters, and they have passed."""
        if self.seen + count > self._due:
            return False
        self.seen += count
        return True

    def characters(self, data: bytes, first: Nanos, step: Nanos) -> list[Passed]:
        """What arrives of `data`, whose characters come `step` ns apart from the moment `first` on."""
        if self.passes(len(data)):
            return [(0, data)] if data else []
        if self._pulled:
            self.log.tell(Injected(first, PullCable.kind, self.wire, self.seen + 1, data))
            self.seen += len(data)
            self.lost += len(data)
            return []
        passed: list[Passed] = []
        at = 0
        while at < len(data):
            clean = self._clean(data, at)
            if clean > at:
                passed += self._unhit(data, at, clean, first + at * step, step)
                self.seen += clean - at
            if clean < len(data):
                passed += self._hit(data, clean, first + clean * step)
                self.seen += 1
            at = clean + 1
        return passed

    def _clean(self, data: bytes, at: int) -> int:
        """Where in `data` the next character stands, from `at` on, that a fault or a stop request meets."""
        due = min((rule.due for rule in self._rules), default=NEVER)
        end = min(len(data), at + max(0, due - self.seen))
        if self._stops:
            found = (data.find(code, at, end) for code in STOP_CODES)
            end = min((place for place in found if place >= 0), default=end)
        return end

    def _hit(self, data: bytes, place: int, moment: Nanos) -> list[Passed]:
        byte = data[place]
        passed = self._late(place, moment) if byte in STOP_CODES else []
        due = [rule for rule in self._rules if rule.due <= self.seen]
        for rule in due[1:]:
            rule.due = self.seen + 1
        if due:
            arrived = due[0].hit(byte, self._parity)
            self.log.note(moment, due[0].fault.kind, self.wire, self.seen + 1, bytes((byte,)), tuple(arrived))
            self._account(byte, arrived)
            self._look_ahead()
            passed += ((place, item) for item in arrived)
        else:
            passed += self._unhit(data, place, place + 1, moment, 0)
        return passed

    def _late(self, place: int, moment: Nanos) -> list[Passed]:
        number = self._stops_seen
        self._stops_seen += 1
        spans = [rule.fault.characters * self._character for rule in self._stops if rule.hits(number)]
        if not spans:
            return []
        self.log.note(moment, LateStop.kind, self.wire, number + 1, late=max(spans))
        return [(place, Late(max(spans)))]

    def _account(self, byte: int, arrived: list[bytes | Fault]) -> None:
        whole = arrived[:1] == [bytes((byte,))]
        self.added += max(0, len(arrived) - 1)
        self.lost += not arrived
        self.damaged += bool(arrived) and not whole

    def _unhit(self, data: bytes, start: int, end: int, first: Nanos, step: Nanos) -> list[Passed]:
        """Characters that no fault hits, read by a clock that may run wrong."""
        if self._misread is None:
            return [(start, data[start:end])]
        passed: list[Passed] = []
        for place in range(start, end):
            read = self._misread[data[place]]
            if read != data[place : place + 1]:
                self.damaged += 1
                moment, number = first + (place - start) * step, self.seen + place - start + 1
                self.log.note(moment, BaudMismatch.kind, self.wire, number, data[place : place + 1], (read,))
            passed.append((place, read))
        return passed

    def _look_ahead(self) -> None:
        always = self._pulled or self._stops or self._misread is not None
        self._due = 0 if always else min((rule.due for rule in self._rules), default=NEVER)


@dataclass(frozen=True, slots=True)
class Injectors:
    """The faults of both wires of one line, with one log."""

    from_host: Injector
    from_control: Injector
    log: FaultLog


def injectors(
    plan: FaultPlan,
    stream: Callable[[str], Stream],
    *,
    extent: Extent | None = None,
    character: Nanos = 0,
    parity: Parity = Parity.CHECKED,
) -> Injectors:
    """What carries the line's part of `plan` out. `stream(name)` gives the seeded stream of that name.

    Each wire draws from the stream of its own name, and both from the one named "cable" for what hits both at once.
    """
    log = FaultLog()
    both = stream("cable")
    pulls = [both.randrange(1 << 64) for fault in plan.line_faults if isinstance(fault, PullCable)]

    def on(wire: Wire) -> Injector:
        injector = Injector(wire, log, extent=extent, character=character, parity=parity)
        own, cable = stream(wire), iter(pulls)
        for fault in plan.line_faults:
            seed = own.randrange(1 << 64)
            if isinstance(fault, PullCable):
                injector.add(fault, SplitMix(next(cable)))
            elif fault.wire in (wire, Wire.BOTH):
                injector.add(fault, SplitMix(seed))
        return injector

    return Injectors(on(Wire.FROM_HOST), on(Wire.FROM_CONTROL), log)
