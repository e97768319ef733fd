"""What a host can know about where its characters are."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND
from tapewire.line.pacing import character_time
from tapewire.protocols.delivery import HEARD_LATE, HEARD_LATE_CHARACTERS, Delivery


@pytest.mark.parametrize("baud", [50, 100, 110, 150, 200, 300])
def test_6_3_on_the_slowest_lines_what_left_within_ten_characters_is_not_certain(baud: int) -> None:
    """10.2: 5083 goes down to 50 baud. What the control says crosses the line at that pace too."""
    delivery, each = Delivery(), character_time(baud)
    for count in range(1, 31):
        delivery.hand_over(1)
        delivery.leave(1, count * each)
    assert delivery.certain(30 * each) == 30 - HEARD_LATE_CHARACTERS


def test_a_pause_is_not_the_pace_of_a_line() -> None:
    """An XOFF between the first two characters: as soon as the line goes on, its own pace counts."""
    delivery, each = Delivery(), character_time(300)
    moments = [each, *(100 * each + count * each for count in range(20))]
    for now in moments:
        delivery.hand_over(1)
        delivery.leave(1, now)
    assert delivery.certain(moments[-1]) == len(moments) - HEARD_LATE_CHARACTERS


def test_a_computer_that_is_late_makes_no_line_faster() -> None:
    """At 1200 baud every eighth character is told of right behind the one before it."""
    delivery, each = Delivery(), character_time(1200)
    for count in range(1, 65):
        delivery.hand_over(1)
        delivery.leave(1, count * each - (each // 2 if count % 8 == 0 else 0))
    assert 64 - HEARD_LATE_CHARACTERS - 1 <= delivery.certain(64 * each) <= 64 - HEARD_LATE_CHARACTERS


def test_nor_does_one_that_tells_of_one_character_at_once_behind_another() -> None:
    delivery, each = Delivery(), character_time(1200)
    for count in range(1, 65):
        delivery.hand_over(1)
        delivery.leave(1, count * each - (each * 19 // 20 if count == 40 else 0))
    assert delivery.certain(64 * each) == 64 - HEARD_LATE_CHARACTERS


@given(
    baud=st.sampled_from([50, 300, 2400, 9600, 86400]),
    chunks=st.lists(st.tuples(st.integers(1, 64), st.integers(0, 200)), min_size=1, max_size=30),
)
def test_nothing_counts_as_there_that_left_less_than_a_tenth_of_a_second_before(
    baud: int, chunks: list[tuple[int, int]]
) -> None:
    """Chunks as a line carries them, with pauses between (ms), told whenever a computer looks."""
    delivery, each, now = Delivery(), character_time(baud), 0
    left: list[int] = []
    for count, pause_ms in chunks:
        delivery.hand_over(count)
        now += pause_ms * MILLISECOND
        for _ in range(count):
            now += each
            left.append(now)
        delivery.leave(count, now)
        assert delivery.certain(now) <= sum(moment <= now - HEARD_LATE for moment in left)
    assert delivery.certain(now + 10 * SECOND) == len(left)
