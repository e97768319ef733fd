"""The closed loop by itself: an adapter that answers late is not believed too early."""

from __future__ import annotations

import itertools
from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MICROSECOND, MILLISECOND, Nanos
from tapewire.line.closed_loop import ClosedLoop
from tapewire.line.pacing import character_time

CHARACTER = character_time(9600)


class LateTransmitter:
    """Its state is seen `late` after it was true, as over USB."""

    def __init__(self, character: Nanos, late: Nanos) -> None:
        self.character = character
        self.late = late
        self.busy: list[tuple[Nanos, Nanos]] = []

    def take(self, count: int, now: Nanos) -> None:
        begins = max(now, self.busy[-1][1] if self.busy else now)
        self.busy.append((begins, begins + count * self.character))

    def was_empty(self, now: Nanos) -> bool:
        return all(not begins <= now - self.late < end for begins, end in self.busy)


@given(
    late=st.integers(0, 20 * MILLISECOND),
    true=st.floats(0.98, 1.5),
    waits=st.lists(st.integers(1, 5 * MILLISECOND), min_size=1, max_size=60),
)
def test_nothing_is_handed_over_while_anything_is_inside(late: Nanos, true: float, waits: list[Nanos]) -> None:
    loop, uart = ClosedLoop(CHARACTER, late), LateTransmitter(round(CHARACTER * true), late)
    for now in itertools.accumulate(waits):
        if not loop.in_flight(now, partial(uart.was_empty, now)):
            assert all(end <= now for _, end in uart.busy)
            uart.take(2, now)
            loop.hand_over(2, now)


def test_one_moment_asks_once() -> None:
    loop = ClosedLoop(CHARACTER)
    loop.hand_over(2, 0)
    asked: list[int] = []

    def is_empty() -> bool:
        asked.append(1)
        return False

    end = 2 * CHARACTER
    for now in (0, end, end, end + 1):
        assert loop.in_flight(now, is_empty) == 2
    assert len(asked) == 2


def test_when_to_ask() -> None:
    loop = ClosedLoop(CHARACTER, late=5 * MILLISECOND)
    assert loop.next_question(0) is None
    loop.hand_over(2, 0)
    assert loop.next_question(0) == 5 * MILLISECOND
    assert loop.next_question(5 * MILLISECOND) == 5 * MILLISECOND + (5 * MILLISECOND - 2 * CHARACTER) // 4
    prompt = ClosedLoop(CHARACTER)
    prompt.hand_over(2, 0)
    assert prompt.next_question(0) == 2 * CHARACTER - 300 * MICROSECOND
    assert prompt.next_question(2 * CHARACTER) == 2 * CHARACTER + 50 * MICROSECOND


def test_what_is_called_back_is_not_in_flight() -> None:
    loop = ClosedLoop(CHARACTER)
    loop.hand_over(2, 0)
    loop.call_back(2)
    assert loop.in_flight(0, bool) == 0
    assert loop.next_question(0) is None
