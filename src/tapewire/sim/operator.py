"""Somebody who works a control by a list: which key at how many bytes of program, or how long after the beginning.

It stands between a link and the control: `Operator` is the application of the link.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.engine import SECOND, Event, Nanos, Notice
from tapewire.errors import UsageError
from tapewire.sim.machine import Motion
from tapewire.sim.nc import Nc, Operation

__all__ = ["Key", "Operator", "Press"]


class Key(StrEnum):
    """What can be pressed, or happens."""

    START = "start"
    """CYCLE START."""
    HOLD = "hold"
    RESET = "reset"
    STOP = "stop"
    """The soft key."""
    SINGLE_BLOCK = "single-block"
    """The switch, the other way each time."""
    OPTIONAL_STOP = "optional-stop"
    ALARM = "alarm"
    """The control goes to alarm for a reason of its own."""


_WHEN: Final = re.compile(r"(?:(?P<bytes>\d{1,12})|(?P<seconds>\d{1,6}(?:\.\d{1,3})?)s)\Z", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """One key. `count` is in bytes of program taken, or punched, `after` from the beginning of the operation; one of
    them is None."""

    key: Key
    count: int | None = None
    after: Nanos | None = None

    @classmethod
    def parse(cls, word: str) -> Press:
        """KEY@BYTES or KEY@SECONDSs, as in hold@2000 and start@7.5s. Raises UsageError."""
        name, _, when = word.partition("@")
        found = _WHEN.match(when)
        if name not in list(Key) or found is None:
            form = "KEY@BYTES or KEY@SECONDSs is expected, as in hold@2000 or start@7.5s"
            raise UsageError(f"{word}: {form}; keys are {', '.join(Key)}")
        if found["bytes"] is not None:
            return cls(key=Key(name), count=int(found["bytes"]))
        return cls(key=Key(name), after=round(float(found["seconds"]) * SECOND))


class Operator:
    """Presses `presses`, and CYCLE START `stand` after the control has stopped by itself: at M00 and M01, between two
    single blocks, behind the end of a program. FEED HOLD waits for a CYCLE START in the list. `tell` gets notices.
    """

    def __init__(
        self, nc: Nc, presses: tuple[Press, ...], stand: Nanos, tell: Callable[[Event, Nanos], object]
    ) -> None:
        self._nc = nc
        self._stand = stand
        self._tell = tell
        self._later = sorted((press.after, press.key) for press in presses if press.after is not None)
        for press in presses:
            if press.count is not None:
                nc.control.at(press.count, lambda now, key=press.key: self._press(key, now))  # type: ignore[misc]
        self._began: Nanos | None = None
        self._go_on: Nanos | None = None
        self._do = 0
        self._told: set[Motion] = set()

    def begin(self, now: Nanos) -> None:
        """The operation begins: seconds count from here."""
        self._began = now

    def step(self, now: Nanos) -> None:
        while self._began is not None and self._later and self._began + self._later[0][0] <= now:
            self._press(self._later.pop(0)[1], now)
        self._nc.step(now)
        while self._stands(now):
            self._go_on = None
            self._nc.cycle_start(now)
            self._nc.step(now)
        self._see_do(now)

    def _stands(self, now: Nanos) -> bool:
        """The control has stopped by itself, and has stood long enough."""
        motion = self._nc.control.motion
        if motion in (Motion.RUNNING, Motion.HELD) or self._nc.operation is not Operation.DNC or self._nc.alarms:
            self._go_on = None
            return False
        if self._go_on is None:
            self._go_on = now + self._stand
            if motion is not Motion.STOPPED or motion not in self._told:
                self._say(f"stands: {motion.value}, after {self._nc.control.blocks_executed:,} blocks", now)
            self._told.add(motion)
        return self._go_on <= now

    def next_deadline(self) -> Nanos | None:
        moments = [self._nc.next_deadline(), self._go_on]
        if self._began is not None and self._later:
            moments.append(self._began + self._later[0][0])
        return min((moment for moment in moments if moment is not None), default=None)

    def next_event(self) -> Event | None:
        return self._nc.next_event()

    def _press(self, key: Key, now: Nanos) -> None:
        self._say(f"pressed: {key}", now)
        nc = self._nc
        try:
            match key:
                case Key.START:
                    nc.cycle_start(now)
                case Key.HOLD:
                    nc.feed_hold(now)
                case Key.RESET:
                    nc.reset(now)
                case Key.STOP:
                    nc.stop(now)
                case Key.SINGLE_BLOCK:
                    nc.turn_single_block(nc.single_block.other)
                case Key.OPTIONAL_STOP:
                    nc.turn_optional_stop(nc.optional_stop.other)
                case Key.ALARM:
                    nc.alarm(now)
        except UsageError as error:
            self._say(f"not obeyed: {error}", now)

    def _see_do(self, now: Nanos) -> None:
        """What the host has set by SDO (4.4.2 5))."""
        if self._nc.has_images and self._nc.f152 != self._do:
            self._do = self._nc.f152
            self._say(f"the host has set F152 to {self._do:02X}h", now)

    def _say(self, text: str, now: Nanos) -> None:
        self._tell(Notice(text=text), now)
