"""The control's parameters that have to do with the remote buffer (B-63322EN-1/01 chapter 10), as records.

`CATALOGUE` is chapter 10 as data. A `ParameterSet` holds the values of one machine; what is wrong with them is for
`parameter_check.py` to say, and what a host must do with them for `host_settings.py`. Where the manual contradicts
itself, the record says what was chosen:

- 5073 begins at 2 (10.2); the table of 12.2 has 1. The narrower range is kept.
- 5070 may be 0 (10.2), but its table begins at 1. 0 is taken to be below every rate: the clock is always taken.
- The note of 5084 names the numbers of RS-422; those of RS-232-C, 5082 and 5083, are meant.
- The texts of 0021 to 0023 all speak of the input device for the foreground; their titles are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final

__all__ = [
    "BAUD_CODES",
    "CATALOGUE",
    "LINE_NUMBERS",
    "MOST_AXES",
    "REMOTE_BUFFER_DEVICE",
    "Bit",
    "Entry",
    "Interface",
    "LineNumbers",
    "Parameter",
    "ParameterSet",
    "PowerRule",
]

REMOTE_BUFFER_DEVICE: Final = 10
"""The number of the remote buffer as an input or output device (10.1)."""

MOST_AXES: Final = 24
"""Controlled axes of the largest Series 15i: the upper end of 7635 where nobody says how many there are. General
knowledge; the manual says "number of controlled axes"."""

BAUD_CODES: Final[Mapping[int, int]] = MappingProxyType(
    dict(
        enumerate(
            (50, 100, 110, 150, 200, 300, 600, 1200, 2400, 4800, 9600, 19200, 38400, 76800, 86400),
            start=1,
        )
    )
)
"""Setting value to bits a second, for 5070, 5073 and 5083 (10.2)."""


class Interface(StrEnum):
    """What the remote buffer board is fitted with; 5000#0 says which, and the system sets it by itself."""

    RS_232_C = "RS-232-C"
    RS_422 = "RS-422"


class Entry(StrEnum):
    """By what kind of input the operator changes it."""

    SETTING = "setting input"
    PARAMETER = "parameter input"


class PowerRule(StrEnum):
    """When a changed value takes effect."""

    AT_ONCE = "at once"
    POWER_OFF_AND_ON = "after power off and on"
    BY_PROTOCOL = "after power off and on with protocol A, or with 5000#3 = 1; else at once"
    """10.2: the notes of 5000#3, 5074 and 5084."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bit:
    """One bit: what 0 and 1 mean. `must_be_zero` is one that the manual prints as 0."""

    position: int
    name: str
    zero: str
    one: str
    must_be_zero: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter. `low` to `high` is its valid range; of a bit type it is that of the whole byte."""

    number: int
    title: str
    clause: str
    entry: Entry
    low: int
    high: int
    unit: str = ""
    values: Mapping[int, str] = field(default_factory=dict)
    """What single values mean, where the manual lists them."""
    bits: tuple[Bit, ...] = ()
    power: PowerRule = PowerRule.AT_ONCE
    interface: Interface | None = None
    """The only interface it is for; None: both, or neither."""

    @property
    def is_bits(self) -> bool:
        return bool(self.bits)


@dataclass(frozen=True, slots=True, kw_only=True)
class LineNumbers:
    """The parameters of one interface: what is 507x for RS-422 is 508x for RS-232-C."""

    specification: int
    stop_bits: int
    baud: int
    protocol: int

    def __iter__(self) -> Iterator[int]:
        return iter((self.specification, self.stop_bits, self.baud, self.protocol))


LINE_NUMBERS: Final[Mapping[Interface, LineNumbers]] = MappingProxyType(
    {
        Interface.RS_422: LineNumbers(specification=5071, stop_bits=5072, baud=5073, protocol=5074),
        Interface.RS_232_C: LineNumbers(specification=5081, stop_bits=5082, baud=5083, protocol=5084),
    }
)


def _bits(number: int, title: str, clause: str, entry: Entry, *bits: Bit, power: PowerRule) -> Parameter:
    return Parameter(number=number, title=title, clause=clause, entry=entry, low=0, high=0xFF, bits=bits, power=power)


def _bit(position: int, name: str, zero: str, one: str) -> Bit:
    return Bit(position=position, name=name, zero=zero, one=one)


def _fixed(position: int, name: str) -> Bit:
    return Bit(position=position, name=name, zero="always 0", one="not allowed", must_be_zero=True)


def _device(number: int, title: str) -> Parameter:
    return Parameter(
        number=number,
        title=title,
        clause="10.1",
        entry=Entry.SETTING,
        low=0,
        high=16,
        values={REMOTE_BUFFER_DEVICE: "the remote buffer"},
    )


_SPECIFICATIONS: Final = {
    1: "control codes DC1 to DC4; punches feed; tape reader",
    2: "no control codes; punches feed",
    3: "control codes DC1 to DC4; no feed",
    4: "no control codes; no feed",
}
_PROTOCOLS: Final = {1: "protocol B", 2: "expansion protocol B", 3: "protocol A, or expansion protocol A by SET"}
_STOP_BITS: Final = {1: "one stop bit, with even parity", 2: "two stop bits, without parity"}


def _line(interface: Interface, specifications: Mapping[int, str], bauds: tuple[int, int]) -> Iterator[Parameter]:
    """The four parameters of one interface."""
    numbers = LINE_NUMBERS[interface]

    def record(number: int, title: str, low: int, high: int, values: Mapping[int, str], power: PowerRule) -> Parameter:
        return Parameter(
            number=number,
            title=f"{interface}: {title}",
            clause="10.2",
            entry=Entry.SETTING,
            low=low,
            high=high,
            values=values,
            power=power,
            interface=interface,
        )

    low, high = bauds
    rates = {code: f"{baud} baud" for code, baud in BAUD_CODES.items() if low <= code <= high}
    yield record(numbers.specification, "specification number of the device", 0, 8, specifications, PowerRule.AT_ONCE)
    yield record(numbers.stop_bits, "stop bits", 1, 2, _STOP_BITS, PowerRule.BY_PROTOCOL)
    yield record(numbers.baud, "baud rate", low, high, rates, PowerRule.BY_PROTOCOL)
    yield record(numbers.protocol, "protocol", 1, 3, _PROTOCOLS, PowerRule.POWER_OFF_AND_ON)


def _code_parameters() -> Iterator[Parameter]:
    yield _bits(
        0,
        "code of tapes and files",
        "10",
        Entry.SETTING,
        _bit(0, "TVC", "TV check is not performed", "TV check is performed"),
        _bit(1, "CTV", "characters of comments count in the TV check", "they do not count"),
        _bit(2, "ISP", "ISO codes contain a parity bit", "ISO codes contain none"),
        _bit(3, "NCR", "EOB is punched as LF CR CR", "EOB is punched as LF"),
        _bit(4, "EIA", "punches in ISO code", "punches in EIA code"),
        _fixed(5, "XXX"),
        power=PowerRule.AT_ONCE,
    )
    yield _device(20, "input device for the foreground")
    yield _device(21, "output device for the foreground")
    yield _device(22, "input device for the background")
    yield _device(23, "output device for the background")


def _buffer_parameters() -> Iterator[Parameter]:
    yield _bits(
        5000,
        "remote buffer",
        "10.2",
        Entry.PARAMETER,
        _bit(0, "422", "the board has RS-232-C", "the board has RS-422"),
        _bit(1, "ECH", "position 1 of SAT is always 0", "position 1 of SAT repeats that of SET"),
        _bit(
            2,
            "TCC",
            "protocol A: messages in ASCII; protocol B: control codes in ISO",
            "protocol A: messages in ISO; protocol B: control codes in ASCII",
        ),
        _bit(
            3,
            "ETX",
            "protocol A: end code CR; protocol B: reset and alarm are not posted",
            "protocol A: end code ETX; protocol B: SYN for a reset, NAK for an alarm",
        ),
        _bit(4, "CDC", "RS-232-C: CD is checked", "CD is not checked"),
        _fixed(5, "0"),
        power=PowerRule.POWER_OFF_AND_ON,
    )
    yield Parameter(
        number=5070,
        title="RS-422: lowest baud rate at which the host's clock is taken",
        clause="10.2",
        entry=Entry.SETTING,
        low=0,
        high=13,
        values={code: f"{baud} baud" for code, baud in BAUD_CODES.items() if code <= 13},
        power=PowerRule.BY_PROTOCOL,
        interface=Interface.RS_422,
    )
    file_mate = "PROGRAM FILE Mate; Handy File in remote mode"
    yield from _line(Interface.RS_422, {**_SPECIFICATIONS, 8: file_mate}, (2, 15))
    cassettes = {7: "FANUC CASSETTE", 8: f"FLOPPY CASSETTE; {file_mate}"}
    yield from _line(Interface.RS_232_C, {**_SPECIFICATIONS, **cassettes}, (1, 12))


def _binary_parameters() -> Iterator[Parameter]:
    at_once, parameter = PowerRule.AT_ONCE, Entry.PARAMETER
    yield _bits(
        2007,
        "single block in binary input operation",
        "10.3",
        parameter,
        _bit(3, "G5S", "no single-block stop", "single-block stop"),
        power=at_once,
    )
    for number, title in ((2010, "delay of the strobes MF, SF, TF, BF"), (2012, "length of the strobes")):
        yield Parameter(number=number, title=title, clause="10.3", entry=parameter, low=0, high=32767, unit="ms")
    yield Parameter(
        number=2034,
        title="kind of auxiliary function in binary input operation",
        clause="10.3",
        entry=parameter,
        low=0,
        high=3,
        values={0: "second auxiliary function", 1: "miscellaneous function", 2: "S function", 3: "T function"},
    )
    yield _bits(
        7609,
        "format of binary input operation",
        "10.3",
        parameter,
        _bit(2, "RDS", "travel in the special format", "travel in the general format"),
        _bit(3, "RAX", "no auxiliary functions", "auxiliary functions"),
        power=at_once,
    )
    yield _bits(
        7618,
        "unit time of binary input operation: TM2 TM1 TM0 = 100 is 1 ms, 001 2 ms, 010 4 ms, 000 8 ms, 011 16 ms",
        "10.3",
        parameter,
        *(_bit(position, f"TM{position}", "0", "1") for position in range(3)),
        power=PowerRule.POWER_OFF_AND_ON,
    )
    yield Parameter(
        number=7635,
        title="axes that take commands in binary input operation: the first so many",
        clause="10.3",
        entry=parameter,
        low=0,
        high=MOST_AXES,
        unit="axes",
    )
    yield _bits(
        7713,
        "look-ahead in binary input operation",
        "10.3",
        parameter,
        _bit(3, "G5H", "stays enabled", "disabled (unit time 1 ms; 2 ms with 11 axes or more)"),
        power=at_once,
    )


CATALOGUE: Final[Mapping[int, Parameter]] = MappingProxyType(
    {
        record.number: record
        for record in sorted(
            (*_code_parameters(), *_buffer_parameters(), *_binary_parameters()), key=lambda record: record.number
        )
    }
)
"""Every parameter of chapter 10, by number."""

UNIT_TIMES_MS: Final[Mapping[int, int]] = MappingProxyType({0b100: 1, 0b001: 2, 0b010: 4, 0b000: 8, 0b011: 16})
"""Bits 2 to 0 of 7618 to the unit time; the three other combinations are not in the table."""


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """The values of one machine by number. A number that is not there was not told: it is not 0."""

    values: Mapping[int, int] = field(default_factory=dict)

    def __contains__(self, number: int) -> bool:
        return number in self.values

    def get(self, number: int) -> int | None:
        return self.values.get(number)

    def bit(self, number: int, position: int) -> int:
        """One bit; 0 where the parameter was not told."""
        return self.values.get(number, 0) >> position & 1

    def with_values(self, values: Mapping[int, int]) -> ParameterSet:
        return ParameterSet({**self.values, **values})

    @property
    def interface(self) -> Interface | None:
        """What 5000#0 says the board has; None where 5000 was not told."""
        if 5000 not in self:
            return None
        return Interface.RS_422 if self.bit(5000, 0) else Interface.RS_232_C

    @property
    def unit_time_ms(self) -> int | None:
        """By 7618; None for a combination that is not in the table."""
        return UNIT_TIMES_MS.get(self.values.get(7618, 0) & 0b111)
