"""More deliberate bugs of protocol A: each of them the checkers once passed over."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tapewire.engine import Outcome
from tapewire.protocols.fanuc_a.cnc_turn import Turn
from tapewire.protocols.fanuc_a.host import FanucAHost
from tapewire.protocols.fanuc_a.host_streaming import Streaming
from tests.sim.mutants import Mutant

__all__ = ["MUTANTS_OF_A"]


def _empty_whatever_is_stored(method: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self, stored, now: method(self, 0, now)


def _ends_the_job(method: Callable[..., Any]) -> Callable[..., Any]:
    def fault(self: Any, fault: Any, byte: int | None, now: int) -> None:
        self._interrupt(Outcome.FAILED, f"{fault}", now)
        method(self, fault, byte, now)

    return fault


def _proves_nothing(method: Callable[..., Any]) -> Callable[..., Any]:
    def note_taken(self: Any) -> None:
        before = self._proven
        method(self)
        self._proven = before

    return note_taken


def _can_is_remembered(method: Callable[..., Any]) -> Callable[..., Any]:
    def leave_packets(self: Any) -> None:
        before = self._canned
        method(self)
        self._canned = self._canned or before

    return leave_packets


def _ten_times_too_late(method: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self: 10 * method(self)


def _never(method: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self: False


_A, _AX = "fanuc-a", "fanuc-a-expansion"

MUTANTS_OF_A: tuple[Mutant, ...] = (
    Mutant(
        name="A: complete though the buffer is not empty",
        protocol=_A,
        presets=("clean", "host-restart"),
        spoils=((FanucAHost, "_judge_operating", _empty_whatever_is_stored),),
    ),
    Mutant(
        name="A: a damaged character ends the job instead of being asked for again",
        protocol=_A,
        presets=("worn-connector", "noisy-idle"),
        spoils=((FanucAHost, "receive_line_fault", _ends_the_job),),
    ),
    Mutant(
        name="A: nothing counts as certain before all is delivered",
        protocol=_A,
        presets=("clean",),
        spoils=((FanucAHost, "_note_taken", _proves_nothing),),
    ),
    Mutant(
        name="expansion A: a program armed among invalid packets does not begin",
        protocol=_AX,
        presets=("clean",),
        spoils=((Streaming, "waits_for_job", _never),),
    ),
    Mutant(
        name="expansion A: To goes on while the host is held",
        protocol=_AX,
        presets=("clean",),
        spoils=((Turn, "_held", _never),),
    ),
    Mutant(
        name="expansion A: the CAN of a job ends the next one",
        protocol=_AX,
        presets=("clean",),
        spoils=((FanucAHost, "_leave_packets", _can_is_remembered),),
    ),
    Mutant(
        name="expansion A: invalid packets ten times too late",
        protocol=_AX,
        presets=("clean",),
        spoils=((Streaming, "_keep_alive_time", _ten_times_too_late),),
    ),
)
