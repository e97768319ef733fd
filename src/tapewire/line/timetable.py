"""When each line of a loop is to be stepped next: one alarm for all of them, and one wake-up for all that are due.

With a line or two every step comes at its moment. The more lines there are, the longer one that can wait does wait, for
others to fall due with it: what a wake-up costs is then shared, and no line is late by more than it says it can be.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Final
from weakref import WeakKeyDictionary

from tapewire.engine import MICROSECOND, Nanos
from tapewire.line.alarm import Alarm

__all__ = ["Timetable"]

SHARED: Final[Nanos] = 40 * MICROSECOND
"""How much longer each further line lets the others wait: about what it costs to step one."""

Step = Callable[[], None]


class Timetable:
    """The one of `loop`: it has an alarm while anybody is in it.

    The moments are those of the monotonic clock. A step is entered once, and again whenever its moment changes.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._moments: dict[Step, tuple[Nanos, Nanos]] = {}
        """Of each who waits: the moment, and how much later it may be."""
        self._entered: set[Step] = set()
        self._alarm: Alarm | None = None
        self._rings_at: Nanos | None = None

    @classmethod
    def of(cls, loop: asyncio.AbstractEventLoop) -> Timetable:
        """The one that all lines of `loop` share."""
        found = _OF_LOOPS.get(loop)
        if found is None:
            found = _OF_LOOPS[loop] = cls(loop)
        return found

    def enter(self, step: Step) -> None:
        self._entered.add(step)
        if self._alarm is None:
            self._alarm = Alarm()
            self._loop.add_reader(self._alarm.fd, self._ring)

    def leave(self, step: Step) -> None:
        self._entered.discard(step)
        self._moments.pop(step, None)
        if not self._entered and self._alarm is not None:
            self._loop.remove_reader(self._alarm.fd)
            self._alarm.close()
            self._alarm = self._rings_at = None

    def set(self, step: Step, at: Nanos | None, slack: Nanos = 0) -> None:
        """Call `step` at the moment `at`, or at most `slack` later; None takes it off."""
        if at is None:
            self._moments.pop(step, None)
            return
        self._moments[step] = at, slack
        latest = at + min(slack, SHARED * (len(self._entered) - 1))
        if self._rings_at is None or latest < self._rings_at:
            self._set_alarm(latest)

    def _set_alarm(self, at: Nanos) -> None:
        assert self._alarm is not None
        self._rings_at = at
        self._alarm.set(at)

    def _ring(self) -> None:
        """Step all that are due. The alarm is set anew once, for whoever is next behind them."""
        assert self._alarm is not None
        self._alarm.clear()
        now = time.monotonic_ns()
        due = [step for step, (at, _) in self._moments.items() if at <= now]
        self._rings_at = 0
        for step in due:
            if self._moments.pop(step, None) is not None:
                step()
        self._rings_at = None
        if self._moments and self._alarm is not None:
            shared = SHARED * (len(self._entered) - 1)
            self._set_alarm(min(at + min(slack, shared) for at, slack in self._moments.values()))


_OF_LOOPS: WeakKeyDictionary[asyncio.AbstractEventLoop, Timetable] = WeakKeyDictionary()
