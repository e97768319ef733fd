"""Runs one Link in real time under asyncio. It decides nothing: it wakes the link and sleeps again."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Final

from tapewire.engine import MICROSECOND, Nanos
from tapewire.line.alarm import Alarm
from tapewire.line.link import Link
from tapewire.line.transport import watched_of

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
    line stays open when `run` ends, and `run` may be called again.
    """

    def __init__(self, link: Link, clock: Callable[[], Nanos] = monotonic) -> None:
        self.link = link
        self._clock = clock
        self._woken = asyncio.Event()
        self._watched: int | None = None

    def wake(self) -> None:
        """Step soon: something has changed that no descriptor and no deadline shows."""
        self._woken.set()

    async def run(self, until: Callable[[], bool]) -> None:
        """Step until `until()`, which is asked after every step. What a step raises comes out here."""
        overdue = 0
        loop = asyncio.get_running_loop()
        alarm = Alarm()
        loop.add_reader(alarm.fd, self._ring, alarm)
        try:
            while True:
                self._woken.clear()
                now = self._clock()
                self.link.step(now)
                if until():
                    return
                deadline = self.link.next_deadline()
                overdue = overdue + 1 if deadline is not None and deadline <= now else 0
                assert overdue <= MAX_STEPS_WITHOUT_WAITING, f"a deadline of {self.link.engine!r} does not move"
                self._watch()
                await self._wait(deadline, now, alarm)
        finally:
            self._unwatch()
            loop.remove_reader(alarm.fd)
            alarm.close()

    async def _wait(self, deadline: Nanos | None, now: Nanos, alarm: Alarm) -> None:
        if deadline is not None and deadline - now <= TOO_NEAR_TO_SLEEP:
            await asyncio.sleep(0)
            return
        if deadline is not None:
            alarm.set(monotonic() + deadline - self._clock())
        await self._woken.wait()

    def _ring(self, alarm: Alarm) -> None:
        alarm.clear()
        self._woken.set()

    def _watch(self) -> None:
        watched = None if self.link.closed else watched_of(self.link.transport)
        if watched != self._watched:
            self._unwatch()
            if watched is not None:
                asyncio.get_running_loop().add_reader(watched, self._woken.set)
                self._watched = watched

    def _unwatch(self) -> None:
        if self._watched is not None:
            asyncio.get_running_loop().remove_reader(self._watched)
            self._watched = None
