"""The control behind the buffer: how long its blocks take, and what its operator does to it."""

from __future__ import annotations

from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND
from tapewire.sim.execution import BlockTime, Speeds
from tapewire.sim.machine import Motion
from tapewire.sim.world import Pair, World

PROGRAM = b"%\nO1\n" + b"".join(b"G91 G01 X%d. F600\n" % (n % 3) for n in range(50)) + b"M30\n%"


@pytest.mark.parametrize(
    ("blocks", "seconds"),
    [
        ([b"G91 G01 X10. F600\n"], 1.0),
        ([b"G90 G01 X3. Y4. F60\n", b"X3. Y4.\n"], 5.004),
        ([b"G01 X10. F600\n", b"G00 X0.\n"], 1.06),
        ([b"G20 G91 G01 X1. F1\n"], 60.0),
        ([b"G91 G02 X3. Y4. I1. J0 F60\n"], 5.0),
        ([b"G04 X2.5\n"], 2.5),
        ([b"G04 P500\n"], 0.5),
        ([b"(G01 X9999.) M08\n"], 0.004),
        ([b"G91 G01 X10.\n"], 1.2),
    ],
)
def test_a_block_takes_what_its_length_and_feed_say(blocks: list[bytes], seconds: float) -> None:
    time = BlockTime()
    assert sum(time(block) for block in blocks) == pytest.approx(seconds * SECOND)


def test_the_override_slows_the_feed_and_not_the_rapid() -> None:
    time = BlockTime(Speeds(override=0.5))
    assert time(b"G91 G01 X10. F600\n") == 2 * SECOND
    assert time(b"G00 X10.\n") == pytest.approx(SECOND * 0.06)


@given(st.lists(st.binary(max_size=60), max_size=5))
def test_any_block_takes_a_bounded_time(blocks: list[bytes]) -> None:
    time = BlockTime()
    for block in blocks:
        assert 4 * MILLISECOND <= time(block) <= 24 * 3600 * SECOND


def running(**operator: object) -> tuple[World, Pair]:
    world = World()
    pair = world.pair("fanuc-b", **operator)  # type: ignore[arg-type]
    pair.host.start(BytesIO(PROGRAM), world.now)
    pair.control.cycle_start(world.now)
    return world, pair


def test_a_feed_hold_stops_in_the_middle_and_cycle_start_goes_on() -> None:
    world, pair = running(block_time=BlockTime())
    world.run_for(3 * SECOND)
    pair.control.feed_hold(world.now)
    executed = pair.control.blocks_executed
    assert executed
    world.run_for(60 * SECOND)
    assert pair.control.blocks_executed == executed
    assert pair.control.motion is Motion.HELD
    pair.control.go(world.now)
    world.run_until(lambda: pair.host_end is not None and pair.control.idle)
    assert pair.program.getvalue() == PROGRAM


def test_single_block_waits_for_cycle_start_after_each() -> None:
    world, pair = running(blocks_per_second=10, single_block=True)
    for count in range(1, 5):
        world.run_for(5 * SECOND)
        assert (pair.control.blocks_executed, pair.control.motion) == (count, Motion.STOPPED)
        pair.control.go(world.now)
    pair.control.single_block = False
    world.run_until(lambda: pair.host_end is not None and pair.control.idle)
    assert pair.program.getvalue() == PROGRAM


def test_reset_forgets_what_was_taken_and_a_new_start_begins_anew() -> None:
    world, pair = running(blocks_per_second=10)
    world.run_for(2 * SECOND)
    pair.control.reset(world.now)
    assert pair.control.idle
    world.run_for(2 * SECOND)
    taken = len(pair.program.getvalue())
    pair.host.start(BytesIO(PROGRAM), world.now)
    pair.host_end = None
    pair.control.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None)
    assert pair.program.getvalue()[taken:] == PROGRAM


def test_an_alarm_ends_the_reading() -> None:
    world, pair = running(blocks_per_second=10)
    world.run_for(2 * SECOND)
    pair.control.alarm(world.now)
    world.run_until(lambda: pair.host_end is not None)
    assert "alarm (NAK)" in str(pair.host_end)
