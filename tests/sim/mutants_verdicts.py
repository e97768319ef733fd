"""Deliberate bugs in what an end tells, and in what it waits for before it does: see `mutants.py`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tapewire.engine import Outcome, Received
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.host_job import _Ending
from tapewire.protocols.bridgeport.host_law import State as BridgeportState
from tapewire.protocols.fanuc_b.cnc import FanucBCnc
from tapewire.protocols.fanuc_b.host import FanucBHost
from tapewire.protocols.fanuc_b.host import State as BState
from tapewire.protocols.fanuc_b.host_delivery import Delivery
from tapewire.protocols.fanuc_b.host_job import Job as BJob
from tapewire.protocols.fanuc_b.host_reception import Reception
from tapewire.protocols.fanuc_b.host_signs import Signs
from tests.sim.mutants import Mutant

__all__ = ["MUTANTS_OF_WORDS"]

Method = Callable[..., Any]


def _no_wait(_: Method) -> Method:
    return lambda self, state, delivery: 0


def _nothing_is_certain(_: Method) -> Method:
    return lambda self, now: 0


def _still_counted(_: Method) -> Method:
    """What was called back counts as handed over."""

    def call_back(self: Any, count: int) -> None:
        self.in_flight -= min(count, self.in_flight)

    return call_back


def _not_heard_in(*states: Any) -> Callable[[Method], Method]:
    """A damaged character that comes then is passed over."""

    def wrap(method: Method) -> Method:
        def fault(self: Any, what: Any, byte: int | None, now: int) -> None:
            if self.state not in states:
                method(self, what, byte, now)

        return fault

    return wrap


def _is_never_text(_: Method) -> Method:
    return lambda self, byte: None


def _first_mark_only_of_damage(method: Method) -> Method:
    def mark(self: Any, what: str) -> None:
        if "inside" not in what:
            method(self, what)

    return mark


def _the_other_way(method: Method) -> Method:
    """An alarm counts as given up, and a reset as a failure."""
    other = {Outcome.CANCELLED: Outcome.FAILED, Outcome.FAILED: Outcome.CANCELLED}

    def end(self: Any, *args: Any) -> Any:
        found = method(self, *args)
        return found and (other.get(found[0], found[0]), found[1])

    return end


def _as_much_as_fits(method: Method) -> Method:
    """The control goes on punching when its host has said DC3."""

    def look(self: Any, limit: int) -> Any:
        self._may_still_punch = limit
        return method(self, limit)

    return look


def _reports_all_again(method: Method) -> Method:
    """What is reported of a program is all of it each time, and not what is new."""

    def receive(self: Any, data: bytes, position: int, now: int) -> Any:
        before = self._reception.stored
        result = method(self, data, position, now)
        if before and self._reception.stored > before:
            self._events.put(Received(count=before))
        return result

    return receive


def _all_but_the_last(method: Method) -> Method:
    """A complete job counts one less than it has sent."""

    def finish(self: Any) -> None:
        if self._ending[0] is Outcome.COMPLETE and self._reception is None:
            self._delivery.sent -= 1
        method(self)

    return finish


def _nothing_proven(method: Method) -> Method:
    def delivered(self: Any) -> tuple[int, int]:
        low, high = method(self)
        sends = self.transmission is not None and self.outcome is not Outcome.COMPLETE
        return (0 if sends else low), high

    return delivered


_B, _BX, _BP = "fanuc-b", "fanuc-b-expansion", "bridgeport"
_QUIET, _PLAIN, _ARCS, _NOISE = ("clean",), ("no-parity",), ("welder-next-door",), ("noisy-idle",)

MUTANTS_OF_WORDS: tuple[Mutant, ...] = (
    Mutant(
        name="B: no wait for SYN and NAK behind the last DC3",
        protocol=_B,
        presets=_QUIET,
        spoils=((Signs, "wait_behind_last_dc3", _no_wait),),
    ),
    Mutant(
        name="B: bytes_low is always 0",
        protocol=_B,
        presets=_QUIET,
        spoils=((Delivery, "certain", _nothing_is_certain),),
    ),
    Mutant(
        name="B: what was called back stays counted",
        protocol=_BX,
        presets=_QUIET,
        spoils=((Delivery, "call_back", _still_counted),),
    ),
    Mutant(
        name="B: a complete job counts one byte less",
        protocol=_B,
        presets=_QUIET,
        spoils=((BJob, "_finish", _all_but_the_last),),
    ),
    Mutant(
        name="B: damage behind the last DC3 is passed over",
        protocol=_BX,
        presets=(*_NOISE, *_ARCS),
        spoils=((FanucBHost, "receive_line_fault", _not_heard_in(BState.CLOSING)),),
    ),
    Mutant(
        name="B: damage behind DC4 is passed over",
        protocol=_BX,
        presets=(*_NOISE, *_ARCS),
        spoils=((FanucBHost, "receive_line_fault", _not_heard_in(BState.AFTER_DC4)),),
    ),
    Mutant(
        name="B: text behind DC4 is passed over",
        protocol=_BX,
        presets=_NOISE,
        spoils=((Reception, "behind_dc4", _is_never_text),),
    ),
    Mutant(
        name="B: a code inside a punch-out is passed over",
        protocol=_BX,
        presets=_PLAIN,
        spoils=((Reception, "_mark", _first_mark_only_of_damage),),
    ),
    Mutant(
        name="B: a reset counts as an alarm, and an alarm as a reset",
        protocol=_B,
        presets=_QUIET,
        spoils=((Signs, "end_by_notice", _the_other_way),),
    ),
    Mutant(
        name="B: what is stored is reported again and again",
        protocol=_B,
        presets=_QUIET,
        spoils=((FanucBHost, "_receive_punched", _reports_all_again),),
    ),
    Mutant(
        name="B: the control punches on behind DC3",
        protocol=_B,
        presets=_QUIET,
        spoils=((FanucBCnc, "data_to_send", _as_much_as_fits),),
    ),
    Mutant(
        name="Bridgeport: bytes_low is always 0",
        protocol=_BP,
        presets=_QUIET,
        spoils=((_Ending, "delivered", _nothing_proven),),
    ),
    Mutant(
        name="Bridgeport: damage behind a save is passed over",
        protocol=_BP,
        presets=_NOISE,
        spoils=((BridgeportHost, "receive_line_fault", _not_heard_in(BridgeportState.SAVED)),),
    ),
)
