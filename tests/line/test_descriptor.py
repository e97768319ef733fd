"""What came in and waits: order, pace and bound; and the settings no line can have."""

from __future__ import annotations

import socket
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import SECOND, Closure, LineFault, SignalsIn
from tapewire.errors import UsageError
from tapewire.line.descriptor import Arrivals, DescriptorLine
from tapewire.line.pacing import RxPacer
from tapewire.line.transport import Closed, Fault, LineItem
from tests.line.helpers import Clock, open_pair, settings

CHARACTER = 1000

Items = st.lists(
    st.one_of(
        st.binary(min_size=1, max_size=50),
        st.builds(Fault, fault=st.sampled_from(LineFault), byte=st.none() | st.integers(0, 255)),
        st.builds(SignalsIn, cts=st.booleans()),
    ),
    max_size=20,
)
END = Closed(closure=Closure.ORDERLY, reason="over")


def _flat(items: list[LineItem]) -> list[object]:
    """Bytes one by one, so that the cutting does not matter."""
    return [part for item in items for part in (item if isinstance(item, bytes) else [item])]


def _cost(items: list[LineItem]) -> int:
    return sum(isinstance(part, int | Fault) for part in _flat(items))


@given(items=Items, looks=st.lists(st.integers(0, 40 * CHARACTER), max_size=30))
def test_everything_comes_in_order_and_in_its_time(items: list[LineItem], looks: list[int]) -> None:
    arrivals, now, taken = Arrivals(RxPacer(CHARACTER)), SECOND, list[LineItem]()
    for item in [*items, END]:
        arrivals.put(item)
    taken += arrivals.take(now)
    for passed in looks:
        now += passed
        taken += arrivals.take(now)
        assert _cost(taken) <= (now - SECOND) // CHARACTER
        deadline = arrivals.next_deadline()
        assert deadline is None or deadline > now
    taken += arrivals.take(now + SECOND)
    assert _flat(taken) == _flat([*items, END])
    assert b"" not in taken
    assert arrivals.next_deadline() is None


@given(items=Items)
def test_without_a_pace_everything_comes_at_once(items: list[LineItem]) -> None:
    arrivals = Arrivals()
    for item in items:
        arrivals.put(item)
    assert arrivals.take(SECOND) == items


def test_a_paced_end_takes_a_few_thousand_characters_ahead_and_then_stops_watching() -> None:
    clock = Clock()
    with open_pair("tcp client", far_window=100_000, paced=True) as (near, far):
        far.room(clock.now)
        far.write(bytes(100_000), clock.now)
        for _ in clock.looks(0):
            near.read(clock.now)
            if near.watched is None:  # type: ignore[attr-defined]
                break
        assert near.next_deadline() is not None
        taken = sum(len(item) for item in near.read(clock.advance(SECOND)) if isinstance(item, bytes))
        assert 0 < taken <= 4096


@pytest.mark.parametrize(
    ("baud", "stopbits", "window"), [(0, 1, 1), (5_000_000, 1, 1), (-9600, 1, 1), (9600, 3, 1), (9600, 1, 0)]
)
def test_settings_no_line_can_have(baud: int, stopbits: int, window: int) -> None:
    with pytest.raises(UsageError, match="give"):
        settings(baud=baud, stopbits=stopbits, window=window)


def test_more_than_the_room_is_our_own_mistake() -> None:
    with open_pair("pty master", window=10) as (near, _):
        near.read(SECOND)
        assert near.room(SECOND) == 10
        with pytest.raises(AssertionError, match="11 characters"):
            near.write(bytes(11), SECOND)


class _Draining(DescriptorLine):
    """A line whose kernel queue holds what the test says at each question, and is empty after that."""

    answers: ClassVar[list[int]] = []

    def _queued(self, fd: int) -> int:
        return self.answers.pop(0) if self.answers else 0


def test_a_queue_that_empties_between_two_questions_is_still_looked_at_again() -> None:
    """Found by a punch-out that slept for ever: `room` refused for a queue that `next_deadline` found empty."""
    near, far = socket.socketpair()
    near.setblocking(False)
    line = _Draining(near.detach(), settings(window=4))
    try:
        now = SECOND
        line.read(now)
        line.write(b"abcd"[: line.room(now)], now)
        now += SECOND
        line.answers[:] = [4]
        assert line.room(now) == 0
        deadline = line.next_deadline()
        assert deadline is not None
        line.read(deadline)
        assert line.room(deadline) == 4
        assert line.next_deadline() is None
    finally:
        line.close(now)
        far.close()


def test_the_queue_is_asked_once_for_one_moment_and_again_later() -> None:
    near, far = socket.socketpair()
    near.setblocking(False)
    line = _Draining(near.detach(), settings(window=4))
    try:
        now = SECOND
        line.read(now)
        line.write(b"ab"[: line.room(now)], now)
        now += SECOND
        line.read(now)
        line.answers[:] = [2]
        assert line.on_its_way(now) == 2
        assert line.room(now) == 2
        deadline = line.next_deadline()
        assert deadline is not None
        line.read(deadline)
        assert line.room(deadline) == 4
    finally:
        line.close(now)
        far.close()
