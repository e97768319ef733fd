"""The world: one clock, one seed, streams by name, ends that stall, die and come back."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, Outcome
from tapewire.errors import UsageError
from tapewire.line.faults.plan import FaultPlan, FlipBits, Rate
from tapewire.sim.pair import Pair, Side
from tapewire.sim.world import World

PROGRAM = b"%\nO0001\n" + b"".join(b"N%d G01 X%d. Y-%d.\n" % (n, n, n) for n in range(120)) + b"M30\n%"
NOISY = FaultPlan(name="noisy", why="for the test", faults=(FlipBits(when=Rate(0.002), bits=2),))


def deliver(world: World, *pairs: Pair) -> None:
    for pair in pairs:
        pair.host.start(BytesIO(PROGRAM), world.now)
        pair.control.cycle_start(world.now)
    world.run_until(lambda: all(pair.host_end is not None for pair in pairs))


def noisy_run(seed: int, others: int = 0) -> tuple[str, bytes, list[str]]:
    world = World(seed)
    pair = world.pair("fanuc-b", faults=NOISY)
    more = [world.pair("fanuc-b", faults=NOISY) for _ in range(others)]
    deliver(world, pair, *more)
    return str(pair.transcript), pair.program.getvalue(), [str(entry) for entry in pair.line.log.entries]


def test_the_same_seed_is_the_same_run_to_the_byte() -> None:
    first, second = noisy_run(7), noisy_run(7)
    assert first == second
    assert first[2], "nothing was injected"
    assert noisy_run(8)[2] != first[2]


def test_one_more_machine_shifts_nobodys_luck() -> None:
    alone, accompanied = noisy_run(7), noisy_run(7, others=2)
    assert alone[1:] == accompanied[1:]


def test_many_machines_on_one_clock() -> None:
    world = World()
    pairs = [world.pair(name) for name in ("fanuc-a", "fanuc-a-expansion", "fanuc-b", "fanuc-b-expansion")]
    deliver(world, *pairs)
    for pair in pairs:
        assert pair.host_end is not None
        assert pair.host_end.outcome is Outcome.COMPLETE
        assert pair.program.getvalue() == PROGRAM


def test_run_for_lets_exactly_that_pass_and_acts_happen_at_their_moment() -> None:
    world = World()
    world.pair("fanuc-a")
    seen: list[int] = []
    world.at(3 * SECOND, lambda: seen.append(world.now))
    world.run_for(2 * SECOND)
    assert (world.now, seen) == (2 * SECOND, [])
    world.run_for(2 * SECOND)
    assert (world.now, seen) == (4 * SECOND, [3 * SECOND])


def test_advance_says_whether_it_is_done() -> None:
    world = World()
    pair = world.pair("fanuc-b")
    pair.host.start(BytesIO(PROGRAM), world.now)
    assert not world.advance(lambda: pair.host_end is not None, 5 * SECOND)
    assert world.now == 5 * SECOND
    pair.control.cycle_start(world.now)
    assert world.advance(lambda: pair.host_end is not None, 60 * SECOND)


@pytest.mark.parametrize("late", [0, 15 * MILLISECOND])
def test_a_host_that_is_woken_late_or_stalls_delivers_all_the_same(late: int) -> None:
    world = World()
    pair = world.pair("fanuc-b", blocks_per_second=20)
    pair.host_side.late = lambda: late
    world.at(SECOND, lambda: setattr(pair.host_side, "asleep_until", 4 * SECOND))
    deliver(world, pair)
    assert pair.program.getvalue() == PROGRAM


class _NothingDue:
    """A link with something to say, and no deadline of its own."""

    def __init__(self) -> None:
        self.steps: list[int] = []

    def step(self, now: int) -> None:
        self.steps.append(now)

    def next_deadline(self) -> int | None:
        return None


def test_an_end_that_was_acted_on_in_its_sleep_speaks_when_it_wakes() -> None:
    link: Any = _NothingDue()
    side = Side(link)
    side.asleep_until = 4 * SECOND
    assert side.due() is None
    side.step(2 * SECOND)
    assert (link.steps, side.due()) == ([], 4 * SECOND)
    side.step(4 * SECOND)
    assert (link.steps, side.due()) == ([4 * SECOND], None)


def test_a_restarted_host_resumes_nothing_by_itself() -> None:
    world = World()
    pair = world.pair("fanuc-b", blocks_per_second=20)
    pair.host.start(BytesIO(PROGRAM * 10), world.now)
    pair.control.cycle_start(world.now)
    world.run_for(SECOND)
    pair.host_side.off = True
    world.run_for(SECOND)
    pair.restart_host(world.now)
    before = pair.cnc.progress + pair.cnc.buffered
    world.run_for(60 * SECOND)
    assert 0 < pair.cnc.progress + pair.cnc.buffered == before


def test_a_control_comes_back_from_a_power_cut_with_nothing_in_its_memory() -> None:
    world = World()
    pair = world.pair("fanuc-b", blocks_per_second=20)
    pair.host.start(BytesIO(PROGRAM * 10), world.now)
    pair.control.cycle_start(world.now)
    world.run_for(SECOND)
    pair.cut_power(pair.cnc_side, world.now)
    world.run_for(SECOND)
    assert pair.host_end is not None, "its ER has fallen"
    assert pair.host_end.outcome is Outcome.FAILED
    program = BytesIO()
    pair.restart_control(program, world.now)
    pair.host.start(BytesIO(PROGRAM), world.now)
    pair.control.cycle_start(world.now)
    pair.host_end = None
    world.run_until(lambda: pair.host_end is not None)
    assert program.getvalue() == PROGRAM


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(UsageError, match="no path"):
        World().pair("fanuc-b", path="uart-of-wood")
    with pytest.raises(UsageError, match="no fault preset"):
        World().pair("fanuc-b", faults="gremlins")
