"""Runs one Link in real time under asyncio. It decides nothing: it wakes the link and sleeps again."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Final

from tapewire.engine import MICROSECOND, Nanos
from tapewire.line.link import Link
from tapewire.line.timetable import Timetable
from tapewire.line.transport import slack_of, watched_of

__all__ = ["LineDriver", "monotonic"]

MAX_STEPS_WITHOUT_WAITING: Final = 1000
"""Steps running whose next deadline was already due: beyond this one of them does not move."""

TOO_NEAR_TO_SLEEP: Final[Nanos] = 150 * MICROSECOND
"""A wake-up takes about as long as this: what is nearer is waited for awake. Only a transmitter that is about to be
empty is asked so often."""


def monotonic() -> Nanos:
    """The clock of everything that runs in real time."""
    return time.monotonic_ns()


class LineDriver:
    """Steps `link` when its line has something, when a deadline comes, and at `wake`.

    Whoever acts on the engine from outside (`engine.abort(monotonic())`) says `wake` after it, from the same loop. The
    line stays open when `run` ends, and `run` may be called again. Steps are taken by the loop itself, without a task
    between: with hundreds of lines that is what most of the time went into.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._until: Callable[[], bool] = lambda: False
        self._end: asyncio.Future[None] | None = None
        self._soon: asyncio.Handle | None = None
        self._watched: int | None = None
        self._overdue = 0
        self._slack: Nanos = 0

    def wake(self) -> None:
        """Step soon: something has changed that no descriptor and no deadline shows."""
        if self._end is not None and self._soon is None:
            self._soon = self._loop.call_soon(self._step)

    async def run(self, until: Callable[[], bool]) -> None:
        """Step until `until()`, which is asked after every step. What a step raises comes out here."""
        self._loop = asyncio.get_running_loop()
        self._timetable = Timetable.of(self._loop)
        self._until, self._overdue = until, 0
        self._slack = slack_of(self.link.transport)
        self._end = self._loop.create_future()
        self._timetable.enter(self._step)
        try:
            self._step()
            await self._end
        finally:
            self._end = None
            self._unwatch()
            self._timetable.leave(self._step)
            if self._soon is not None:
                self._soon.cancel()
                self._soon = None

    def _step(self) -> None:
        self._soon = None
        if self._end is None or self._end.done():
            return
        try:
            now = time.monotonic_ns()
            self.link.step(now)
            if self._until():
                self._end.set_result(None)
                return
            self._plan(now)
        except Exception as error:
            self._end.set_exception(error)

    def _plan(self, now: Nanos) -> None:
        """When to step next."""
        deadline = self.link.next_deadline()
        self._overdue = self._overdue + 1 if deadline is not None and deadline <= now else 0
        assert self._overdue <= MAX_STEPS_WITHOUT_WAITING, f"a deadline of {self.link.engine!r} does not move"
        self._watch()
        if deadline is not None and deadline - now <= TOO_NEAR_TO_SLEEP:
            self._timetable.set(self._step, None)
            self.wake()
        else:
            self._timetable.set(self._step, deadline, self._slack)

    def _watch(self) -> None:
        watched = None if self.link.closed else watched_of(self.link.transport)
        if watched != self._watched:
            self._unwatch()
            if watched is not None:
                self._loop.add_reader(watched, self._step)
                self._watched = watched

    def _unwatch(self) -> None:
        if self._watched is not None:
            self._loop.remove_reader(self._watched)
            self._watched = None
