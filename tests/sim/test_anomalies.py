"""Anomaly loops: the first, second, third ... character of a short dialogue goes wrong, then each edge of a control
line, then each time an end wakes, until a run ends with nothing gone wrong any more.

Every operation that a protocol has, in the directions it has. Where a handshake is long, each character goes wrong in
one of three ways; tests/protocols/fanuc_a/test_faults.py has each of them lost and flipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import pytest

from tapewire.codes import DataCode
from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.faults.plan import (
    DoubleCharacter,
    FaultPlan,
    FlipBits,
    HoldSignal,
    Level,
    LineEnd,
    Lose,
    Nth,
    Signal,
    Wire,
)
from tapewire.sim.checkers import judge
from tapewire.sim.scenarios import Direction, Finish, Scenario
from tapewire.sim.switches import Settings
from tapewire.sim.trial import Trial

Spoil: TypeAlias = Lose | FlipBits | DoubleCharacter

_RARE_POLLS = {"Tp": "5", "Tw": "5"}
"""Half a minute of waiting is then six exchanges."""

_NO_GAPS = {"Ti": "0", "Tx": "0"}
"""As after the first SET: a gap behind each character would cost a wake-up."""

OPERATIONS = {
    "fanuc-a": ("fanuc-a", Direction.SEND, _RARE_POLLS, _NO_GAPS),
    "fanuc-a-expansion": ("fanuc-a-expansion", Direction.SEND, {**_RARE_POLLS, "n": "1"}, _NO_GAPS),
    "fanuc-b": ("fanuc-b", Direction.SEND, {}, {}),
    "fanuc-b, punch-out": ("fanuc-b", Direction.RECEIVE, {}, {}),
    "fanuc-b-expansion": ("fanuc-b-expansion", Direction.SEND, {"posting": "off"}, {"posting": "off"}),
    "fanuc-b-expansion, punch-out": ("fanuc-b-expansion", Direction.RECEIVE, {"posting": "off"}, {"posting": "off"}),
    "bridgeport, load": ("bridgeport", Direction.SEND, {}, {"mode": "L"}),
    "bridgeport, load without a name": ("bridgeport", Direction.SEND, {}, {"program": "-1"}),
    "bridgeport, link": ("bridgeport", Direction.SEND, {"ack_limit": "30"}, {"mode": "D"}),
    "bridgeport, save": ("bridgeport", Direction.RECEIVE, {}, {}),
    "bridgeport, save without a name": ("bridgeport", Direction.RECEIVE, {}, {"program": "-1"}),
}
"""Protocol, direction, settings of the host and of the control."""

STALLS = {LineEnd.HOST: 3 * SECOND, LineEnd.CONTROL: 300 * MILLISECOND}
"""A control that is busy for longer may run into a limit of its host: not complete, and told so."""

LONG = ("fanuc-a", "fanuc-a-expansion")

KINDS: tuple[type[Spoil], ...] = (Lose, FlipBits, DoubleCharacter)

MOST = 2000
"""No short dialogue has more of anything."""


def scenario(name: str, parity: bool) -> Scenario:
    protocol, direction, host, cnc = OPERATIONS[name]
    return Scenario(
        protocol=protocol,
        preset="anomalies",
        seed=1,
        direction=direction,
        size=60,
        place=0,
        baud=19200,
        path="uart-16550",
        has_signals=True,
        parity=parity,
        settings=Settings(host=host, cnc=cnc, data=DataCode.ASCII),
        grain=16,
        cnc_window=16,
        window=None,
        late=0,
        source_pauses=0.0,
        start=0,
        blocks_per_second=None,
        override=None,
        acts=(),
        finish=Finish.LEAVE,
    )


def complaints(trial: Trial, what: str) -> list[str]:
    trial.run()
    findings = judge(trial.scenario, trial.evidence)
    return [f"{what}: {finding}" for finding in findings if not finding.undetectable]


def until_nothing_goes_wrong(name: str, fault: type[Spoil], wire: Wire, parity: bool) -> Iterator[str]:
    first, step = (1 + KINDS.index(fault), len(KINDS)) if name in LONG else (1, 1)
    for number in range(first, MOST, step):
        plan = FaultPlan(name="one", why="an anomaly", faults=(fault(when=Nth(number), wire=wire),))
        trial = Trial(scenario(name, parity), plan)
        yield from complaints(trial, f"{name}: {fault.__name__} {number} {wire}")
        if not trial.pair.line.log.counts:
            heard = wire is Wire.FROM_HOST and OPERATIONS[name][1] is Direction.RECEIVE
            assert number > first or heard, "nothing ever goes wrong"
            return
    raise AssertionError(f"{name} has no end")


@pytest.mark.parametrize("wire", [Wire.FROM_HOST, Wire.FROM_CONTROL])
@pytest.mark.parametrize("fault", KINDS)
@pytest.mark.parametrize("name", OPERATIONS)
def test_every_character_goes_wrong_once(name: str, fault: type[Spoil], wire: Wire) -> None:
    assert list(until_nothing_goes_wrong(name, fault, wire, parity=fault is not FlipBits)) == []


@pytest.mark.parametrize("wire", [Wire.FROM_HOST, Wire.FROM_CONTROL])
@pytest.mark.parametrize("signal", Signal)
@pytest.mark.parametrize("name", OPERATIONS)
def test_every_edge_of_a_control_line_is_held_once(name: str, signal: Signal, wire: Wire) -> None:
    for number in range(1, 20):
        hold = HoldSignal(when=Nth(number), signal=signal, level=Level.STAYS, wire=wire, span=3 * SECOND)
        trial = Trial(scenario(name, parity=True), FaultPlan(name="one", why="an edge", faults=(hold,)))
        assert complaints(trial, f"{name}: edge {number} of {signal} {wire}") == []
        if not trial.pair.line.log.counts:
            return
    raise AssertionError(f"{name} has no end of edges")


@pytest.mark.parametrize("end", LineEnd)
@pytest.mark.parametrize("name", OPERATIONS)
def test_an_end_stalls_once_at_every_wake_up(name: str, end: LineEnd) -> None:
    """Its timers are late, and what came meanwhile comes at once."""
    clean = FaultPlan(name="none", why="nothing but a stall")
    for number in range(1, MOST):
        trial = Trial(scenario(name, parity=True), clean)
        side = trial.pair.host_side if end is LineEnd.HOST else trial.pair.cnc_side
        wakes = 0

        def late() -> Nanos:
            nonlocal wakes
            wakes += 1
            return STALLS[end] if wakes == number else 0  # noqa: B023

        side.late = late
        assert complaints(trial, f"{name}: stall of {end} at wake-up {number}") == []
        if wakes < number:
            return
    raise AssertionError(f"{name} has no end of wake-ups")
