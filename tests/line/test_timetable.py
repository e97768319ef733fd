"""One alarm for many lines: everybody at his moment, those who can wait together, and nothing left behind."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable

import pytest

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.driver import monotonic
from tapewire.line.timetable import Timetable


@pytest.fixture
async def timetable() -> Timetable:
    return Timetable.of(asyncio.get_running_loop())


class Stepped:
    """Notes when it is stepped, and plans again as `then` says."""

    def __init__(self, then: Callable[[], object] = lambda: None) -> None:
        self.moments: list[Nanos] = []
        self._then = then

    def step(self) -> None:
        self.moments.append(monotonic())
        self._then()


async def until(condition: Callable[[], bool]) -> None:
    for _ in range(10_000):
        if condition():
            return
        await asyncio.sleep(0.001)
    raise AssertionError("it never came")


async def test_a_loop_has_one(timetable: Timetable) -> None:
    assert Timetable.of(asyncio.get_running_loop()) is timetable


async def test_each_is_stepped_once_and_not_before_its_moment(timetable: Timetable) -> None:
    lines = [Stepped() for _ in range(20)]
    began = monotonic()
    wanted = {line: began + number * MILLISECOND for number, line in enumerate(reversed(lines))}
    for line in lines:
        timetable.enter(line.step)
    for line, at in wanted.items():
        timetable.set(line.step, at, 50 * MILLISECOND)
    await until(lambda: all(line.moments for line in lines))
    for line in lines:
        assert len(line.moments) == 1
        assert line.moments[0] >= wanted[line]
        timetable.leave(line.step)


async def test_those_who_can_wait_are_served_by_one_wake_up(timetable: Timetable) -> None:
    """Two hundred lines a tenth of a millisecond apart; one that cannot wait is not made to."""
    lines = [Stepped() for _ in range(200)]
    began = monotonic() + 5 * MILLISECOND
    for line in lines:
        timetable.enter(line.step)
    wake_ups: list[Nanos] = []
    ring = timetable._ring

    def counted() -> None:
        wake_ups.append(monotonic())
        ring()

    assert timetable._alarm is not None
    asyncio.get_running_loop().add_reader(timetable._alarm.fd, counted)
    for number, line in enumerate(lines):
        timetable.set(line.step, began + number * MILLISECOND // 10, 0 if number == 100 else 8 * MILLISECOND)
    await until(lambda: all(line.moments for line in lines))
    assert len(wake_ups) < 50
    for line in lines:
        timetable.leave(line.step)


async def test_a_moment_set_anew_counts_and_none_takes_it_off(timetable: Timetable) -> None:
    first, second = Stepped(), Stepped()
    for line in (first, second):
        timetable.enter(line.step)
        timetable.set(line.step, monotonic() + MILLISECOND)
    timetable.set(first.step, None)
    timetable.set(second.step, monotonic() + 3600 * SECOND)
    await asyncio.sleep(0.03)
    assert not first.moments
    assert not second.moments
    timetable.set(second.step, monotonic())
    await until(lambda: bool(second.moments))
    timetable.leave(first.step)
    timetable.leave(second.step)


async def test_who_leaves_in_the_middle_of_a_wake_up_is_stepped_no_more(timetable: Timetable) -> None:
    second = Stepped()
    first = Stepped(lambda: timetable.leave(second.step))
    at = monotonic() + MILLISECOND
    for line in (first, second):
        timetable.enter(line.step)
        timetable.set(line.step, at)
    await until(lambda: bool(first.moments))
    await asyncio.sleep(0.01)
    assert not second.moments
    timetable.leave(first.step)


async def test_the_last_to_leave_closes_the_alarm(timetable: Timetable) -> None:
    before = len(os.listdir("/proc/self/fd"))
    line = Stepped(lambda: timetable.leave(line.step))
    timetable.enter(line.step)
    timetable.set(line.step, monotonic())
    await until(lambda: bool(line.moments))
    assert len(os.listdir("/proc/self/fd")) == before
    timetable.enter(line.step)
    timetable.set(line.step, monotonic())
    await until(lambda: len(line.moments) == 2)
