"""What reaches one end of a simulated line, and when that end is told of it.

Characters cross the wire one after the other, each at its moment; there the faults meet them. Then they lie in a
receive FIFO, an adapter or a network until the end is told. All of it is arithmetic on runs of characters: it costs
by the piece handed over, not by the character, and it comes out the same however time is cut.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from operator import itemgetter
from typing import TypeAlias

from tapewire.engine import Nanos, SignalsIn
from tapewire.line.faults.characters import Late
from tapewire.line.faults.damage import Parity, truncated
from tapewire.line.faults.injector import Injector
from tapewire.line.paths import PathKind
from tapewire.line.transport import Closed, Fault, LineItem

__all__ = ["Cut", "Mark", "Reception", "Segment"]

Mark: TypeAlias = tuple[Nanos, SignalsIn | Closed | Fault]
"""Something that is no plain character, and its moment."""

_moment = itemgetter(0)


def _sooner(one: Nanos | None, other: Nanos | None) -> Nanos | None:
    if one is None or (other is not None and other < one):
        return other
    return one


@dataclass(slots=True)
class Segment:
    """Characters that come without a gap: character i at `first` + i x `step`. The first `taken` are gone."""

    first: Nanos
    data: bytes
    step: Nanos
    taken: int = 0

    def arrived(self, until: Nanos) -> int:
        """How many have come by `until`, those taken among them; for one whose first character has come."""
        if not self.step:
            return len(self.data)
        return min((until - self.first) // self.step + 1, len(self.data))

    @property
    def next(self) -> Nanos:
        """When the first that is not taken comes."""
        return self.first + self.taken * self.step

    @property
    def last(self) -> Nanos:
        """When the last one comes."""
        return self.first + (len(self.data) - 1) * self.step


@dataclass(frozen=True, slots=True)
class Cut:
    """What a power cut did to characters handed over."""

    lost: int = 0
    """How many did not come out whole; `was`, the one that was under way, is among them."""
    was: bytes = b""
    read: bytes | Fault | None = None
    """What the other end reads of it; None where not even its start bit was sent."""


class Reception:
    """The receiving side of one end. `put` and `mark` are called by the other end, `take` by this one."""

    def __init__(self, path: PathKind, character: Nanos, injector: Injector | None) -> None:
        self._path = path
        self._timeout = path.timeout_characters * character
        self._injector = injector
        self._wire: deque[Segment] = deque()
        """Characters on their way."""
        self._wire_marks: list[Mark] = []
        self._arrived = self._wire if injector is None else deque()
        """Characters behind the faults. Where there are none, both are the same."""
        self._marks = self._wire_marks if injector is None else []
        self._is_bare = injector is None and not (path.poll or path.latency or path.timeout_characters)
        """What has arrived has been told."""
        self._signals: SignalsIn | None = None
        """What this end was told of the control lines."""
        self._late_until: Nanos = 0
        """Before this moment nothing arrives any more that has not."""
        self._deadline: Nanos | None = None
        self._deadline_holds = False
        """Nothing has come, gone or been taken since it was worked out."""

    # what the other end does

    def put(self, first: Nanos, data: bytes, step: Nanos) -> None:
        """`data` is on its way; behind what is on its way without a gap, it is one with that."""
        self._deadline_holds = False
        before = self._wire[-1] if self._wire else None
        if before is not None and before.step == step and before.last + step == first:
            before.first, before.data, before.taken = before.next, before.data[before.taken :] + data, 0
        else:
            self._wire.append(Segment(first, data, step))

    def mark(self, moment: Nanos, what: SignalsIn | Closed | Fault) -> None:
        self._deadline_holds = False
        insort(self._wire_marks, (moment, what), key=_moment)

    def call_back(self, count: int) -> None:
        """The last `count` characters on their way never leave."""
        self._deadline_holds = False
        while count:
            segment = self._wire[-1]
            waiting = len(segment.data) - segment.taken
            if waiting > count:
                segment.data = segment.data[:-count]
                return
            self._wire.pop()
            count -= waiting

    def cut(self, moment: Nanos, bits: int, parity: Parity) -> Cut:
        """The other end lost its power, which shows here at `moment`: what has not arrived never does, but for what
        is read of the character of `bits` bits that was under way.
        """
        self._deadline_holds = False
        under_way, lost, was = None, 0, b""
        while self._wire and self._wire[-1].last > moment:
            segment = self._wire.pop()
            arrived = segment.arrived(moment) if segment.first <= moment else 0
            lost += len(segment.data) - max(arrived, segment.taken)
            begun = segment.first + arrived * segment.step - segment.step
            if begun < moment:
                was = segment.data[arrived : arrived + 1]
                under_way = truncated(was[0], (moment - begun) * bits // segment.step, parity)
                ends = begun + segment.step
            if arrived > segment.taken:
                segment.data = segment.data[:arrived]
                self._wire.append(segment)
        match under_way:
            case bytes(byte):
                self.put(ends, byte, ends - moment)
            case Fault():
                self.mark(ends, under_way)
        return Cut(lost, was, under_way)

    def forget(self, now: Nanos) -> None:
        """What has arrived by `now` is lost, told or not; the control lines are told again as they are."""
        self._deadline_holds = False
        if self._injector is not None:
            self._cross(now, self._injector)
        self._collect([], now, None)
        gone = [mark for moment, mark in self._marks if moment <= now]
        self._marks[: len(gone)] = []
        for mark in gone:
            if isinstance(mark, SignalsIn):
                self._signals = mark
        last = gone[-1] if gone else None
        again: list[SignalsIn | Closed] = [] if self._signals is None else [self._signals]
        again += [last] if isinstance(last, Closed) else []
        self._marks[:0] = [(now, mark) for mark in again]

    def on_the_wire(self, now: Nanos) -> int:
        """Characters that have not arrived by `now`."""
        return sum(
            len(segment.data) - (segment.arrived(now) if segment.first <= now else 0)
            for segment in self._wire
            if segment.last > now
        )

    # what this end sees

    def take(self, now: Nanos) -> list[LineItem]:
        """What this end has been told of by `now` and has not taken."""
        if self._timeout and self._deadline_holds and (self._deadline is None or now < self._deadline):
            # A FIFO that tells by itself has nothing to tell before.
            return []
        if self._injector is not None:
            self._cross(now, self._injector)
        items: list[LineItem] = []
        marks = self._marks
        self._deadline_holds = False
        if self._is_bare and not (marks and marks[0][0] <= now):
            self._collect(items, now, None)
            return items
        until = self._visible(now)
        while marks and marks[0][0] <= until:
            at, mark = marks.pop(0)
            # A damaged character makes a UART tell at once, with all before it.
            self._collect(items, at, self._told(at) if isinstance(mark, SignalsIn) else None)
            if isinstance(mark, SignalsIn):
                self._signals = mark
            items.append(mark)
        if self._arrived:
            self._collect(items, until, self._told(until))
        return items

    def next_deadline(self) -> Nanos | None:
        """When this end is told of something."""
        if not self._deadline_holds:
            self._deadline = self._nearest()
            self._deadline_holds = True
        return self._deadline

    def _nearest(self) -> Nanos | None:
        if self._is_bare:
            marked = self._marks[0][0] if self._marks else None
            if not self._wire:
                return marked
            segment = self._wire[0]
            told = segment.first + (min(segment.taken + self._path.trigger, len(segment.data)) - 1) * segment.step
            return told if marked is None or told < marked else marked
        nearest = self._told_at(self._next_told()) if self._arrived or self._wire else None
        if self._marks:
            nearest = _sooner(nearest, self._told_at(self._marks[0][0]))
        injector = self._injector
        if injector is not None:
            if self._wire_marks:
                nearest = _sooner(nearest, self._wire_marks[0][0])
            nearest = _sooner(nearest, injector.next_moment)
            if self._wire and self._path.trigger > 1:
                nearest = _sooner(nearest, self._next_hit(injector.spared))
        return nearest

    def _visible(self, now: Nanos) -> Nanos:
        """What has arrived by this moment can be seen at `now`."""
        path = self._path
        return now - now % path.poll - path.latency if path.poll else now - path.latency

    def _told_at(self, arrived: Nanos) -> Nanos:
        """When what arrives at `arrived` can be seen."""
        path = self._path
        moment = arrived + path.latency
        return -(-moment // path.poll) * path.poll if path.poll else moment

    def _collect(self, items: list[LineItem], until: Nanos, limit: int | None) -> None:
        """Take what has arrived by `until`, at most `limit` characters."""
        pieces = []
        arrived = self._arrived
        while arrived and (segment := arrived[0]).first <= until:
            start, data = segment.taken, segment.data
            end = segment.arrived(until)
            if limit is not None:
                end = min(end, start + limit)
                limit -= end - start
            segment.taken = end
            if end < len(data):
                if end > start:
                    pieces.append(data[start:end])
                break
            pieces.append(data[start:] if start else data)
            arrived.popleft()
        if pieces:
            items.append(pieces[0] if len(pieces) == 1 else b"".join(pieces))

    def _told(self, until: Nanos) -> int | None:
        """How many of the characters that wait in the receive FIFO this end has been told of; None: of all."""
        path = self._path
        if not path.timeout_characters:
            return None
        told = waiting = 0
        last: Nanos = 0
        for segment in self._arrived:
            if segment.next > until:
                break
            if waiting and segment.next > last + self._timeout:
                told, waiting = told + waiting, 0
            end = segment.arrived(until)
            waiting += end - segment.taken
            told += waiting - waiting % path.trigger
            waiting %= path.trigger
            last = segment.first + (end - 1) * segment.step
        return told + waiting if waiting and last + self._timeout <= until else told

    def _next_told(self) -> Nanos:
        """When the characters now on their way or waiting are told of next: the FIFO is full enough, or a time-out."""
        trigger, timeout = self._path.trigger, self._timeout
        waiting = 0
        last: Nanos = 0
        for segment in self._pending():
            if waiting and segment.next > last + timeout:
                break
            count = len(segment.data) - segment.taken
            if waiting + count >= trigger:
                return segment.next + (trigger - waiting - 1) * segment.step
            waiting += count
            last = segment.last
        return last + timeout

    def _next_hit(self, spared: int) -> Nanos | None:
        """When the character behind the next `spared` ones arrives, which may come damaged; None: not on its way."""
        for segment in self._wire:
            count = len(segment.data) - segment.taken
            if spared < count:
                return segment.next + spared * segment.step
            spared -= count
        return None

    def _pending(self) -> Iterable[Segment]:
        return self._wire if self._injector is None else chain(self._arrived, self._wire)

    # the wire and its faults

    def _cross(self, until: Nanos, injector: Injector) -> None:
        """Let everything up to `until` cross the wire, each fault at its moment."""
        marks = self._wire_marks
        while True:
            wire = self._wire
            if not marks and (not wire or wire[0].next > until) and not injector.is_due(until):
                return
            fault_at, mark_at = injector.next_moment, marks[0][0] if marks else None
            if mark_at is not None and mark_at <= until and (fault_at is None or mark_at <= fault_at):
                self._cross_characters(mark_at, injector)
                self._cross_mark(*marks.pop(0), injector)
            elif fault_at is not None and fault_at <= until:
                self._cross_characters(fault_at, injector)
                idle = not self._wire or self._wire[0].next - self._wire[0].step >= fault_at
                for item in injector.fire(idle=idle):
                    self._arrive(fault_at, item)
            else:
                self._cross_characters(until, injector)
                return

    def _cross_mark(self, moment: Nanos, mark: SignalsIn | Closed | Fault, injector: Injector) -> None:
        if not isinstance(mark, SignalsIn):
            self._arrive(moment, mark)
            return
        for seen in injector.signals(mark, moment):
            self._arrive(moment, seen)

    def _cross_characters(self, until: Nanos, injector: Injector) -> None:
        wire = self._wire
        while wire and (segment := wire[0]).next <= until:
            end = segment.arrived(until)
            is_whole = end == len(segment.data) and not segment.taken and segment.first >= self._late_until
            if is_whole and injector.passes(end):
                self._arrived.append(wire.popleft())
                continue
            first, data = segment.next, segment.data[segment.taken : end]
            segment.taken = end
            if end == len(segment.data):
                wire.popleft()
            if first >= self._late_until and injector.passes(len(data)):
                self._arrived.append(Segment(first, data, segment.step))
                continue
            for place, item in injector.characters(data, first, segment.step):
                moment = first + place * segment.step
                if isinstance(item, Late):
                    self._late_until = max(self._late_until, moment + item.span)
                elif isinstance(item, bytes):
                    self._arrive_characters(moment, item, segment.step)
                else:
                    self._arrive(moment, item)

    def _arrive_characters(self, first: Nanos, data: bytes, step: Nanos) -> None:
        late = min(len(data), max(0, -(-(self._late_until - first) // step))) if step else len(data)
        if late:
            self._arrived.append(Segment(max(first, self._late_until), data[:late], 0))
        if late < len(data):
            self._arrived.append(Segment(first + late * step, data[late:], step))

    def _arrive(self, moment: Nanos, item: LineItem) -> None:
        moment = max(moment, self._late_until)
        if isinstance(item, bytes):
            self._arrived.append(Segment(moment, item, 0))
        else:
            insort(self._marks, (moment, item), key=_moment)
