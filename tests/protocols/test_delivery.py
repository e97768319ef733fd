"""What a host can know about where its characters are."""

from __future__ import annotations

import pytest

from tapewire.line.pacing import character_time
from tapewire.protocols.delivery import HEARD_LATE_CHARACTERS, Delivery


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
