"""When the host's computer does nothing: two stalls are one sleep only where it does nothing between them."""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.faults.plan import FaultPlan
from tapewire.sim.scenarios import Act, Direction, OperatorAct, draw
from tapewire.sim.trial import Trial

MS = MILLISECOND
BEGUN = 3 * SECOND


@pytest.mark.parametrize("late", [0, 20, 100])
@pytest.mark.parametrize(
    ("second_at", "sleeps"),
    [
        (30, [(0, 90)]),
        (60, [(0, 120)]),
        (61, [(0, 60), (61, 121)]),
        (74, [(0, 60), (74, 134)]),
    ],
)
def test_two_stalls_are_one_sleep_where_the_computer_does_not_wake_between(
    second_at: int, sleeps: list[tuple[int, int]], late: int
) -> None:
    """A sleep of more than 100 ms excuses what two short ones do not."""
    acts = tuple(OperatorAct(moment=BEGUN + at * MS, act=Act.STALL, span=60 * MS) for at in (0, second_at))
    drawn = draw("fanuc-b", "clean", 1)
    scenario = dataclasses.replace(drawn, direction=Direction.SEND, size=6000, baud=9600, late=late * MS, acts=acts)
    trial = Trial(scenario, FaultPlan(name="none", why="for the test", faults=()))
    side, stepped = trial.pair.host_side, set[Nanos]()
    trial.pair.on_step = lambda now: stepped.add(now) if now >= side.asleep_until else None
    evidence = trial.run()
    assert evidence.broken == ""
    assert [(since - BEGUN, until - BEGUN) for since, until in evidence.sleeps] == [(a * MS, b * MS) for a, b in sleeps]
    assert {until for _, until in evidence.sleeps} <= stepped, "it has something to do when it wakes"
