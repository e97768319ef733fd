"""The rates UARTs really make: the figures of stack and data sheets, and what holds for any clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.line.rates import Divider, is_near

PC = Divider(top=115200)


@pytest.mark.parametrize(
    ("divider", "baud", "real"),
    [
        (PC, 9600, 9600),
        (PC, 86400, 115200),
        (PC, 76800, 57600),
        (Divider(top=14_745_600 // 16), 76800, 76800),
        (Divider(top=14_745_600 // 16), 86400, 83782),
        (Divider(top=62_500_000 // 16), 86400, 86806),
        (Divider(top=3_000_000, parts=8), 86400, 86331),
        (Divider(top=3_000_000, parts=8), 76800, 76677),
        (Divider(top=3_000_000, parts=8), 4_000_000, 3_000_000),
        (PC, 1, 115200 / 65535),
    ],
)
def test_real_rates(divider: Divider, baud: int, real: float) -> None:
    assert divider.real_rate(baud) == pytest.approx(real, abs=0.5)


@pytest.mark.parametrize(("real", "near"), [(9600, True), (9408, True), (9407, False), (9792, True), (9793, False)])
def test_two_percent(real: float, near: bool) -> None:
    assert is_near(real, 9600) is near


@given(top=st.integers(1000, 10_000_000), parts=st.sampled_from([1, 8]), baud=st.integers(50, 4_000_000))
def test_the_neighbours_enclose_the_rate(top: int, parts: int, baud: int) -> None:
    divider = Divider(top=top, parts=parts)
    below, above = divider.neighbours(baud)
    assert divider.real_rate(baud) in (below, above)
    if top * parts // 65535 <= baud <= top:
        assert below <= baud <= above
