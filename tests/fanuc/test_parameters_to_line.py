"""Parameters in, a working line out. Here a share of the combinations; `benchmarks/parameters_to_line.py` runs all."""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.fanuc.parameters import Interface
from tests.fanuc.working_line import Line, combinations, complaint_of, is_complete, is_legal, lines_of

EVERY = {Interface.RS_232_C: 13, Interface.RS_422: 101}
"""One combination in so many; primes, so that no parameter keeps its value from one to the next."""
TRANSFERS_EVERY = 12


def share(interface: Interface) -> list[Line]:
    """The lines of a share of the legal combinations, each once."""
    some = [values for values in combinations(interface, every=EVERY[interface]) if is_legal(values, interface)]
    return sorted({line for values in some for line in lines_of(values, interface)}, key=str)[::TRANSFERS_EVERY]


@pytest.mark.parametrize("interface", Interface)
def test_10_2_there_is_a_line_exactly_where_chapter_10_allows_one(interface: Interface) -> None:
    for values in combinations(interface, beside=1, every=3 * EVERY[interface]):
        assert (complaint_of(values) is None) is is_legal(values, interface), values


@pytest.mark.parametrize("interface", Interface)
def test_11_sr807_is_said_of_every_rate_stop_bits_and_protocol_out_of_range(interface: Interface) -> None:
    required = (5072, 5073, 5074) if interface is Interface.RS_422 else (5082, 5083, 5084)
    top = {5072: 2, 5073: 15, 5074: 3, 5082: 2, 5083: 12, 5084: 3}
    low = {5073: 2}
    for values in combinations(interface, beside=1, every=3 * EVERY[interface]):
        wrong = [number for number in required if not low.get(number, 1) <= values.values[number] <= top[number]]
        said = complaint_of(values) or ""
        assert [number for number in required if f"SR807: No. {number} " in said] == wrong


@pytest.mark.parametrize("interface", Interface)
def test_the_derived_host_completes_a_transfer_with_the_control_of_the_same_parameters(interface: Interface) -> None:
    lines = share(interface)
    assert len(lines) > 10
    assert [line for line in lines if not is_complete(line)] == []


@pytest.mark.parametrize("key", ["code", "end"])
def test_a_host_that_is_told_otherwise_does_not(key: str) -> None:
    other = {"ascii": "iso", "iso": "ascii", "cr": "etx", "etx": "cr"}
    values = next(values for values in combinations(Interface.RS_422) if values.values[5074] == 3)
    line = next(line for line in lines_of(values, Interface.RS_422) if line.protocol == "fanuc-a")
    wrong = tuple((name, other[word] if name == key else word) for name, word in line.host)
    assert is_complete(line)
    assert not is_complete(dataclasses.replace(line, host=wrong))
