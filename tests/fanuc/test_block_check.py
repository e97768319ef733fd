"""PS10, PS11 and PS12, and the real fault behind them: a program damaged on the way."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.fanuc.alarms import AlarmNumber
from tapewire.fanuc.block_check import BlockCheck

EXAMPLE = Path(__file__).parents[2] / "examples" / "surfacing.nc"


def alarm(block: bytes) -> AlarmNumber | None:
    complaint = BlockCheck().complaint(block)
    return complaint.number if complaint else None


@pytest.mark.parametrize(
    ("block", "number"),
    [
        (b"N10G123X1.", AlarmNumber.PS10),
        (b"G5.2", AlarmNumber.PS10),
        (b"G-1", AlarmNumber.PS10),
        (b"N10E5.", AlarmNumber.PS11),
        (b"G01X1.Y", AlarmNumber.PS12),
        (b"G01X1.5.2", AlarmNumber.PS12),
        (b"G01X+-1", AlarmNumber.PS12),
        (b"G01x1.", AlarmNumber.PS12),
        (b"12", AlarmNumber.PS12),
        (b"G01X1.\x93", AlarmNumber.PS12),
        (b"HELLO", AlarmNumber.PS12),
        (b"(A)X1.?", AlarmNumber.PS12),
    ],
)
def test_11_ps10_ps11_ps12(block: bytes, number: AlarmNumber) -> None:
    assert alarm(block) is number


@pytest.mark.parametrize(
    "block",
    [
        b"",
        b"\r\r",
        b"(COMMENT WITH ? IN IT)",
        b"O0001(PART)",
        b":0001",
        b"/2 N10 G01 X1. Y-.5 Z+3 F100",
        b"G00G90G40G49G80",
        b"G5.1Q1",
        b"G05",
        b"G1.0X1",
        b"M30",
        b"#100=#101+1",
        b"IF[#1EQ0]GOTO100",
        b"WHILE[#1LT5]DO1",
        b"END1",
    ],
)
def test_what_a_control_can_execute(block: bytes) -> None:
    assert alarm(block) is None


def test_the_example_is_without_fault() -> None:
    lines = EXAMPLE.read_bytes().splitlines()[1:-1]
    assert [line for line in lines if alarm(line)] == []


@given(st.binary(max_size=60))
def test_any_block_is_executed_or_complained_of(block: bytes) -> None:
    assert alarm(block) in (None, AlarmNumber.PS10, AlarmNumber.PS11, AlarmNumber.PS12)


def test_axes_and_g_codes_are_the_controls() -> None:
    check = BlockCheck(axes="XZ", g_codes=frozenset({"1"}))
    assert check.complaint(b"G01X1.Z2.") is None
    assert check.complaint(b"G01Y1.") is not None
    assert check.complaint(b"G02X1.") is not None
