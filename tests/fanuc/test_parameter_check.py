"""SR807 and what else a control does not take; when a changed parameter takes effect."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import UsageError
from tapewire.fanuc.parameter_check import Finding, ParameterMemory, Weight, check, refuse_unusable
from tapewire.fanuc.parameters import CATALOGUE, LINE_NUMBERS, Interface, ParameterSet, PowerRule

GOOD = {
    Interface.RS_422: {5000: 0b1001, 5072: 1, 5073: 11, 5074: 1},
    Interface.RS_232_C: {5000: 0b1000, 5082: 1, 5083: 11, 5084: 1},
}


def findings(values: dict[int, int], board: Interface | None) -> tuple[Finding, ...]:
    return check(ParameterSet(values), board)


@pytest.mark.parametrize("board", Interface)
def test_nothing_is_said_of_what_is_right(board: Interface) -> None:
    assert findings(GOOD[board], board) == ()


@pytest.mark.parametrize("board", Interface)
@pytest.mark.parametrize("field", ["stop_bits", "baud", "protocol"])
@pytest.mark.parametrize("side", ["below", "above"])
def test_11_sr807_baud_rate_stop_bits_and_protocol_out_of_range(board: Interface, field: str, side: str) -> None:
    number = getattr(LINE_NUMBERS[board], field)
    record = CATALOGUE[number]
    value = record.low - 1 if side == "below" else record.high + 1
    (finding,) = findings({**GOOD[board], number: value}, board)
    assert (finding.weight, finding.number) == (Weight.ALARM, number)
    with pytest.raises(UsageError, match=rf"^SR807: No\. {number} .* is {value}: {record.low} to {record.high} is"):
        refuse_unusable((finding,))


@pytest.mark.parametrize("number", [20, 21, 22, 23])
def test_11_sr807_an_interface_that_is_not_fitted(number: int) -> None:
    (finding,) = findings({number: 10}, None)
    assert (finding.weight, finding.number) == (Weight.ALARM, number)
    assert findings({number: 1}, None) == ()
    assert findings({number: 10}, Interface.RS_422) == ()


def test_12_2_3_the_other_interfaces_parameters_raise_no_sr807() -> None:
    (finding,) = findings({**GOOD[Interface.RS_422], 5084: 9}, Interface.RS_422)
    assert finding.weight is Weight.ERROR


@pytest.mark.parametrize("number", [0, 5000])
def test_10_a_bit_that_must_always_be_zero(number: int) -> None:
    (finding,) = findings({number: 0b100000}, Interface.RS_232_C)
    assert "must always be 0" in str(finding)
    assert finding.weight is Weight.ERROR


def test_10_3_7618_a_combination_that_is_no_unit_time() -> None:
    (finding,) = findings({7618: 0b111}, None)
    assert "TM2 TM1 TM0 = 111" in str(finding)


def test_10_3_7635_no_more_axes_than_are_controlled() -> None:
    values = ParameterSet({7635: 4})
    assert check(values, None, controlled_axes=4) == ()
    (finding,) = check(values, None, controlled_axes=3)
    assert finding.number == 7635


@given(st.sampled_from(sorted(CATALOGUE)), st.integers(-(1 << 16), 1 << 16), st.sampled_from([None, *Interface]))
def test_any_value_is_taken_or_complained_of(number: int, value: int, board: Interface | None) -> None:
    record = CATALOGUE[number]
    found = findings({number: value}, board)
    assert bool(found) >= (not record.low <= value <= record.high)
    assert all(finding.number == number for finding in found)


# -- when it takes effect ----------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [5000, 5074, 7618])
def test_10_some_take_effect_only_after_power_off_and_on(number: int) -> None:
    memory = ParameterMemory(ParameterSet({5000: 1, 5074: 1, 7618: 0}), Interface.RS_422)
    value = 0b11 if number == 5000 else 2
    assert memory.enter(number, value) is PowerRule.POWER_OFF_AND_ON
    assert list(memory.waiting) == [number]
    assert memory.in_force.get(number) != value
    memory.power_off_and_on()
    assert list(memory.waiting) == []
    assert memory.in_force.get(number) == value


@pytest.mark.parametrize("board", Interface)
@pytest.mark.parametrize(("protocol", "etx"), [(1, 0), (2, 0), (1, 1), (2, 1), (3, 0), (3, 1)])
def test_10_2_rate_and_stop_bits_wait_with_protocol_a_or_with_posting(
    board: Interface, protocol: int, etx: int
) -> None:
    numbers = LINE_NUMBERS[board]
    before = {5000: etx << 3, numbers.protocol: protocol, numbers.baud: 11, numbers.stop_bits: 1, 5070: 13}
    memory = ParameterMemory(ParameterSet(before), board)
    waits = protocol == 3 or etx == 1
    changed = [numbers.baud, numbers.stop_bits, *([5070] if board is Interface.RS_422 else [])]
    for number in changed:
        memory.enter(number, 2)
    assert memory.waiting == (tuple(sorted(changed)) if waits else ())
    memory.power_off_and_on()
    assert all(memory.in_force.get(number) == 2 for number in changed)


@pytest.mark.parametrize("board", Interface)
def test_10_2_the_system_sets_5000_bit_0_from_the_board(board: Interface) -> None:
    wrong = 0 if board is Interface.RS_422 else 1
    memory = ParameterMemory(ParameterSet({5000: wrong}), board)
    assert memory.in_force.interface is board
    memory.enter(5000, wrong)
    memory.power_off_and_on()
    assert memory.in_force.interface is board


def test_a_value_that_would_be_sr807_can_be_entered_and_others_cannot() -> None:
    memory = ParameterMemory(ParameterSet(), Interface.RS_422)
    memory.enter(5073, 1)
    with pytest.raises(UsageError, match="0 to 8 is expected"):
        memory.enter(5071, 9)
    with pytest.raises(UsageError, match=r"No\. 5099 is no parameter"):
        memory.enter(5099, 1)
