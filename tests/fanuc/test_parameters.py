"""Chapter 10 as records: held against the manual's own figures, written down here a second time."""

from __future__ import annotations

import pytest

from tapewire.fanuc.parameters import (
    BAUD_CODES,
    CATALOGUE,
    LINE_NUMBERS,
    Entry,
    Interface,
    ParameterSet,
    PowerRule,
)

S, P = Entry.SETTING, Entry.PARAMETER

MANUAL = {  # number: range, kind of input, clause
    20: (0, 16, S, "10.1"),
    21: (0, 16, S, "10.1"),
    22: (0, 16, S, "10.1"),
    23: (0, 16, S, "10.1"),
    5070: (0, 13, S, "10.2"),
    5071: (0, 8, S, "10.2"),
    5072: (1, 2, S, "10.2"),
    5073: (2, 15, S, "10.2"),
    5074: (1, 3, S, "10.2"),
    5081: (0, 8, S, "10.2"),
    5082: (1, 2, S, "10.2"),
    5083: (1, 12, S, "10.2"),
    5084: (1, 3, S, "10.2"),
    2010: (0, 32767, P, "10.3"),
    2012: (0, 32767, P, "10.3"),
    2034: (0, 3, P, "10.3"),
    7635: (0, 24, P, "10.3"),
}
BITS = {  # number: name and position of each bit, kind of input, clause
    0: ({"TVC": 0, "CTV": 1, "ISP": 2, "NCR": 3, "EIA": 4, "XXX": 5}, S, "10"),
    5000: ({"422": 0, "ECH": 1, "TCC": 2, "ETX": 3, "CDC": 4, "0": 5}, P, "10.2"),
    2007: ({"G5S": 3}, P, "10.3"),
    7609: ({"RDS": 2, "RAX": 3}, P, "10.3"),
    7618: ({"TM0": 0, "TM1": 1, "TM2": 2}, P, "10.3"),
    7713: ({"G5H": 3}, P, "10.3"),
}


def test_10_every_parameter_and_no_other() -> None:
    assert set(CATALOGUE) == {*MANUAL, *BITS}
    assert all(record.number == number for number, record in CATALOGUE.items())


@pytest.mark.parametrize("number", MANUAL)
def test_10_ranges_and_kinds_of_input(number: int) -> None:
    record = CATALOGUE[number]
    assert (record.low, record.high, record.entry, record.clause) == MANUAL[number]
    assert not record.is_bits


@pytest.mark.parametrize("number", BITS)
def test_10_bits_and_kinds_of_input(number: int) -> None:
    record = CATALOGUE[number]
    names = {bit.name: bit.position for bit in record.bits}
    assert (names, record.entry, record.clause) == BITS[number]


def test_10_0000_bit_5_must_always_be_zero() -> None:
    fixed = [(number, bit.position) for number, record in CATALOGUE.items() for bit in record.bits if bit.must_be_zero]
    assert fixed == [(0, 5), (5000, 5)]


def test_10_2_baud_rates_of_5070_5073_and_5083() -> None:
    rates = (50, 100, 110, 150, 200, 300, 600, 1200, 2400, 4800, 9600, 19200, 38400, 76800, 86400)
    assert dict(enumerate(rates, 1)) == BAUD_CODES
    for number, codes in ((5070, range(1, 14)), (5073, range(2, 16)), (5083, range(1, 13))):
        assert CATALOGUE[number].values == {code: f"{BAUD_CODES[code]} baud" for code in codes}


def test_10_2_what_is_507x_for_rs_422_is_508x_for_rs_232_c() -> None:
    for number in LINE_NUMBERS[Interface.RS_422]:
        assert CATALOGUE[number].interface is Interface.RS_422
        assert CATALOGUE[number + 10].interface is Interface.RS_232_C
        assert CATALOGUE[number].title.partition(": ")[2] == CATALOGUE[number + 10].title.partition(": ")[2]
    assert tuple(LINE_NUMBERS[Interface.RS_232_C]) == tuple(n + 10 for n in LINE_NUMBERS[Interface.RS_422])


def test_10_2_5071_and_5081_specification_numbers() -> None:
    rs_422, rs_232_c = CATALOGUE[5071].values, CATALOGUE[5081].values
    assert (set(rs_422), set(rs_232_c)) == ({1, 2, 3, 4, 8}, {1, 2, 3, 4, 7, 8})
    assert [number for number in (1, 2, 3, 4) if "DC1 to DC4" in rs_422[number]] == [1, 3]
    assert [number for number in (1, 2, 3, 4) if "punches feed" in rs_422[number]] == [1, 2]


def test_10_numbers_that_take_effect_after_power_off_and_on() -> None:
    rules = {number: record.power for number, record in CATALOGUE.items() if record.power is not PowerRule.AT_ONCE}
    always, by_protocol = PowerRule.POWER_OFF_AND_ON, PowerRule.BY_PROTOCOL
    assert rules == {
        **dict.fromkeys((5000, 5074, 5084, 7618), always),
        **dict.fromkeys((5070, 5072, 5073, 5082, 5083), by_protocol),
    }


@pytest.mark.parametrize(("bits", "unit_time_ms"), [("100", 1), ("001", 2), ("010", 4), ("000", 8), ("011", 16)])
def test_10_3_7618_unit_times(bits: str, unit_time_ms: int) -> None:
    assert ParameterSet({7618: int(bits, 2)}).unit_time_ms == unit_time_ms


@pytest.mark.parametrize("bits", ["101", "110", "111"])
def test_10_3_7618_other_combinations_have_no_unit_time(bits: str) -> None:
    assert ParameterSet({7618: int(bits, 2)}).unit_time_ms is None


def test_10_2_5000_bit_0_names_the_interface() -> None:
    assert ParameterSet({5000: 0}).interface is Interface.RS_232_C
    assert ParameterSet({5000: 1}).interface is Interface.RS_422
    assert ParameterSet().interface is None
