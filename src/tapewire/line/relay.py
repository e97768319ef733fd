"""Stands between a host and a control: passes on what either says to the other, and lets somebody listen.

Nothing is understood and nothing is changed. What has come in and cannot be passed on yet waits here, within a bound.
Whatever waits here is more than the sender knows of, and still reaches the far side after a stop request; so a line
without control lines is not read while more than a little waits, and what is not read there counts as in flight at its
sender. One with control lines is read, since a wire waits for nobody: the far side's RTS is passed on as ours, and a
sender that goes on all the same has gone too far.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Final, TypeAlias

from tapewire.engine import SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.captures.records import Side
from tapewire.line.transport import Closed, Fault, LineItem, Transport, can_break, send_break, watched_of

__all__ = ["Damaged", "Relay"]

MOST_WAITING: Final = 1 << 17
"""A sender that ignores RTS OFF for so many characters has lost them; that ends it. Twice what one look can bring."""

DRAIN: Final[Nanos] = 2 * SECOND
"""What still waits for one side when the other has closed may take so long to leave."""


class Damaged(StrEnum):
    """What becomes of a character that arrived damaged. It cannot be passed on as such: our UART makes a new parity."""

    STOP = "stop"
    """The lines are closed: the far side must not take a wrong character for a right one, nor miss one unawares."""
    DROP = "drop"
    """It is left out, which a protocol with sums finds."""


OnItem: TypeAlias = Callable[[Side, LineItem, Nanos], None]


class Relay:
    """Between `lines`: that to the host and that to the control. With one of them alone it only listens.

    `on_item(side, item, now)` hears everything that came from `side`, before it is passed on. A line without control
    lines is read while fewer than `hold` characters wait.
    """

    def __init__(self, lines: Mapping[Side, Transport], damaged: Damaged, hold: int, on_item: OnItem) -> None:
        self._lines = lines
        self._damaged = damaged
        self._hold = hold
        self._on_item = on_item
        self._waiting = {side: bytearray() for side in lines}
        """What came from a side and has not been passed on."""
        self._break_behind: dict[Side, int] = {}
        """A break that came from a side is passed on behind so many of the characters that wait."""
        self._has_signals = dict.fromkeys(lines, False)
        self._closing: tuple[Closed, Nanos] | None = None
        self._now: Nanos = 0
        self.ended: Closed | None = None
        """How it ended."""
        self.characters = 0
        """All that came in, from either side."""
        self.most_waiting = dict.fromkeys(lines, 0)
        """The most of what a side said that waited here."""

    def step(self, now: Nanos) -> None:
        """Bring everything up to `now`."""
        self._now = now
        for side, line in self._lines.items():
            if self._reads(side):
                for item in line.read(now):
                    self._take(side, item, now)
        for side in self._lines:
            self._pass_on(side, now)
        if self._closing is not None:
            closed, at = self._closing
            if now - at >= DRAIN or not any(map(self._is_owed, self._lines)):
                self.ended = self.ended or closed

    def next_deadline(self) -> Nanos | None:
        """The nearest moment at which `step` has something to do by itself."""
        moments = [line.next_deadline() for side, line in self._lines.items() if self._reads(side)]
        moments += [line.next_deadline() for side, line in self._lines.items() if self._is_owed(side.other)]
        if self._closing is not None:
            moments.append(self._closing[1] + DRAIN)
        return min((moment for moment in moments if moment is not None), default=None)

    @property
    def watched(self) -> frozenset[int]:
        """The descriptors whose readiness means that there is something to read."""
        found = {watched_of(line) for side, line in self._lines.items() if self._reads(side)}
        return frozenset(fd for fd in found if fd is not None)

    def _reads(self, side: Side) -> bool:
        return len(self._waiting[side]) < self._hold or self._has_signals[side]

    def _is_owed(self, side: Side) -> bool:
        """Something of what `side` said has not left towards the other."""
        if side not in self._lines or (other := self._lines.get(side.other)) is None:
            return False
        return bool(self._waiting[side]) or side in self._break_behind or other.in_flight(self._now) > 0

    def _take(self, side: Side, item: LineItem, now: Nanos) -> None:
        self._on_item(side, item, now)
        match item:
            case bytes():
                self.characters += len(item)
                self._keep(side, item)
            case Fault(fault=LineFault.BREAK) if (far := self._lines.get(side.other)) is not None and can_break(far):
                # A second one before the first has been passed on is the same to whoever listens there.
                self._break_behind.setdefault(side, len(self._waiting[side]))
            case Fault(fault=fault):
                self.characters += 1
                if self._damaged is Damaged.STOP and len(self._lines) > 1:
                    self._fail(f"{fault} from the {side}: a damaged character cannot be passed on as damaged")
            case SignalsIn(cts=cts, dsr=dsr):
                self._has_signals[side] = True
                if (other := self._lines.get(side.other)) is not None:
                    other.set_signals(SignalsOut(rts=cts, dtr=dsr), now)
            case Closed():
                self._closing = self._closing or (item, now)

    def _keep(self, side: Side, data: bytes) -> None:
        if side.other not in self._lines:
            return
        self._waiting[side] += data
        if len(self._waiting[side]) > MOST_WAITING:
            self._fail(f"the {side} sends and sends, and the {side.other} takes nothing: characters are lost")

    def _fail(self, reason: str) -> None:
        self.ended = self.ended or Closed(closure=Closure.LOST, reason=reason)

    def _pass_on(self, side: Side, now: Nanos) -> None:
        waiting, other = self._waiting[side], self._lines.get(side.other)
        while other is not None and self.ended is None:
            if self._break_behind.get(side) == 0:
                del self._break_behind[side]
                send_break(other, now)
            before = self._break_behind.get(side, len(waiting))
            if not before or not (room := other.room(now)):
                break
            piece = bytes(waiting[: min(room, before)])
            other.write(piece, now)
            del waiting[: len(piece)]
            if side in self._break_behind:
                self._break_behind[side] -= len(piece)
        self.most_waiting[side] = max(self.most_waiting[side], len(waiting))
