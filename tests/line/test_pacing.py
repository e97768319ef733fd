"""The arithmetic of a line at its rate."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import SECOND
from tapewire.line.pacing import RxPacer, TxPacer, character_time, default_window

Characters = st.integers(1, 1_000_000)
Spans = st.lists(st.tuples(st.integers(0, 50_000_000), st.integers(0, 500)), max_size=50)


@pytest.mark.parametrize(
    ("baud", "tolerated", "window"),
    [(86400, 1280, 216), (19200, 512, 48), (9600, 3, 2), (9600, 1, 1), (110, 512, 1)],
)
def test_default_window(baud: int, tolerated: int, window: int) -> None:
    assert default_window(baud, tolerated) == window


@given(character=Characters, window=st.integers(1, 500), spans=Spans)
def test_sender_never_has_more_than_the_window_in_flight_and_no_gap(
    character: int, window: int, spans: list[tuple[int, int]]
) -> None:
    pacer, now, sent = TxPacer(character, window), SECOND, 0
    for passed, wanted in spans:
        now += passed
        count = min(pacer.room(now), wanted)
        if count:
            pacer.hand_over(count, now)
            sent += count
        assert pacer.in_flight(now) <= window
        assert sent - pacer.in_flight(now) <= (now - SECOND) // character
        deadline = pacer.next_deadline(now)
        assert (deadline is None) == (pacer.in_flight(now) == 0)
        if deadline is not None:
            assert deadline > now
            assert pacer.room(deadline) > 0


@given(character=Characters, window=st.integers(1, 500), count=st.integers(0, 500))
def test_what_is_called_back_makes_room_again(character: int, window: int, count: int) -> None:
    pacer = TxPacer(character, window)
    pacer.call_back(0)
    pacer.hand_over(window, SECOND)
    pacer.call_back(min(count, window))
    assert pacer.in_flight(SECOND) == window - min(count, window)


@given(character=Characters, spans=Spans)
def test_reception_is_never_faster_than_the_line(character: int, spans: list[tuple[int, int]]) -> None:
    pacer, now, waiting, taken = RxPacer(character), SECOND, 0, 0
    first_seen: int | None = None
    for passed, arriving in spans:
        now += passed
        waiting += arriving
        if waiting and first_seen is None:
            first_seen = now
        count = pacer.due(waiting, now)
        assert 0 <= count <= waiting
        waiting -= count
        taken += count
        assert taken <= (0 if first_seen is None else (now - first_seen) // character)
        deadline = pacer.next_deadline(1)
        assert (deadline is None) == (waiting == 0)
        if deadline is not None:
            assert deadline > now


@given(st.integers(50, 4_000_000))
def test_a_character_is_never_taken_for_shorter_than_it_is(baud: int) -> None:
    assert character_time(baud) * baud >= 11 * SECOND
    assert (character_time(baud) - 1) * baud < 11 * SECOND
