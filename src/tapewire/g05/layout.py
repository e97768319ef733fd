"""What a record of binary input operation is made of, and the line rate it asks for (B-63322EN-1 9.1, 9.2).

    axis 1 high, low | ... | axis N high, low | auxiliary function, 4 bytes, if used | check byte

Every record is the travel of one unit of time, in increments of the machine, and of a fixed length: nothing stands
between two of them. A record of zeros leaves binary input operation.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum, StrEnum
from typing import Final

from tapewire.errors import UsageError

__all__ = [
    "BITS_PER_CHARACTER",
    "MOST_AXES",
    "SIGNIFICANT",
    "AuxiliaryUse",
    "BinaryInput",
    "IncrementSystem",
    "Layout",
    "RecordFormat",
    "Unit",
    "UnitTime",
    "required_baud",
]

MOST_AXES: Final = 24
"""Controlled axes of the largest control of the series; parameter 7635 takes the first N of them."""

SIGNIFICANT: Final = 1 << 31
"""Bit 31 of an auxiliary function: the data is significant (9.1 (8))."""

BITS_PER_CHARACTER: Final = 11
"""Start, eight bits, parity or a second stop bit, stop: the factor of the formula of 9.2."""


class RecordFormat(StrEnum):
    """Parameter 7609#2 (RDS)."""

    SPECIAL = "special"
    """7609#2 = 0: bits 8 and 0 of every word stay 0. The only one for protocol A (9.1 (5) note)."""
    GENERAL = "general"
    """7609#2 = 1: all sixteen bits carry data."""


class AuxiliaryUse(StrEnum):
    """Parameter 7609#3 (RAX): four bytes of auxiliary function in every record, or none."""

    UNUSED = "no-aux"
    USED = "aux"


class UnitTime(IntEnum):
    """Milliseconds that one record stands for; parameter 7618 TM2 TM1 TM0."""

    MS_1 = 1
    MS_2 = 2
    MS_4 = 4
    MS_8 = 8
    MS_16 = 16

    @property
    def parameter_bits(self) -> str:
        """TM2 TM1 TM0 of parameter 7618."""
        return {1: "100", 2: "001", 4: "010", 8: "000", 16: "011"}[self.value]


class Unit(StrEnum):
    """What an axis is measured in. It belongs to the machine: G20 and G21 do not change it (9.1 (4))."""

    MM = "mm"
    INCH = "inch"
    DEGREE = "deg"


class IncrementSystem(Enum):
    """Increment systems of 9.1 (4); the value is the decimal places of a millimetre or a degree."""

    IS_A = 2
    IS_B = 3
    IS_C = 4
    IS_D = 5
    IS_E = 6

    @property
    def title(self) -> str:
        return self.name.replace("_", "-")

    def per_unit(self, unit: Unit) -> int:
        """Increments in one `unit`: 1000 for IS-B and millimetres."""
        return int(10 ** (self.value + (unit is Unit.INCH)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The records of one section: parameters 7635 (axes), 7609#2 (format) and 7609#3 (auxiliary function)."""

    axis_count: int
    format: RecordFormat = RecordFormat.SPECIAL
    auxiliary: AuxiliaryUse = AuxiliaryUse.UNUSED

    def __post_init__(self) -> None:
        if not 1 <= self.axis_count <= MOST_AXES:
            raise UsageError(f"{self.axis_count} axes: a record has 1 to {MOST_AXES} (parameter 7635)")

    @property
    def uses_auxiliary(self) -> bool:
        return self.auxiliary is AuxiliaryUse.USED

    @property
    def record_bytes(self) -> int:
        """2N + 1, or 2N + 5 with an auxiliary function (9.1 (6))."""
        return 2 * self.axis_count + (5 if self.uses_auxiliary else 1)

    @property
    def exit_record(self) -> bytes:
        return bytes(self.record_bytes)

    @property
    def travel_limits(self) -> tuple[int, int]:
        """Smallest and largest travel of an axis per unit time, in increments."""
        bits = 14 if self.format is RecordFormat.SPECIAL else 16
        return -(1 << bits - 1), (1 << bits - 1) - 1

    @property
    def largest_auxiliary(self) -> int:
        """Of the data of an auxiliary function, without its significant bit."""
        return (1 << 27) - 1 if self.format is RecordFormat.SPECIAL else (1 << 31) - 1

    def __str__(self) -> str:
        axes = "1 axis" if self.axis_count == 1 else f"{self.axis_count} axes"
        auxiliary = "with auxiliary functions" if self.uses_auxiliary else "without auxiliary functions"
        return f"{axes}, {self.format} format, {auxiliary}"


def required_baud(layout: Layout, unit_time: UnitTime) -> int:
    """The rate in bits a second that the line must keep up without a pause, rounded up (9.2)."""
    return -(-layout.record_bytes * BITS_PER_CHARACTER * 1000 // unit_time)


FOUND: Final = "auto"
"""Instead of the number of axes: the length of the records is found by their check bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BinaryInput:
    """The parameters of binary input operation as a user writes them in one word: `3`, `3,general,aux,2ms`, `auto`.

    `layout` is None for `auto`. The unit time is parameter 7618, 8 ms when all its bits are 0.
    """

    layout: Layout | None = None
    unit_time: UnitTime = UnitTime.MS_8

    @property
    def record_bytes(self) -> int | None:
        return None if self.layout is None else self.layout.record_bytes

    @classmethod
    def parse(cls, text: str) -> BinaryInput:
        """Raises ValueError saying what is wrong."""
        axes, *words = text.split(",")
        if axes == FOUND and not words:
            return cls()
        if not axes.isascii() or not axes.isdigit() or len(axes) > 2:
            raise ValueError(f"{axes!r} is no number of axes")
        form, use, unit_time = RecordFormat.SPECIAL, AuxiliaryUse.UNUSED, UnitTime.MS_8
        for word in words:
            if word in list(RecordFormat):
                form = RecordFormat(word)
            elif word in list(AuxiliaryUse):
                use = AuxiliaryUse(word)
            elif word in _UNIT_TIMES:
                unit_time = _UNIT_TIMES[word]
            else:
                raise ValueError(f"{word!r} is none of {', '.join((*RecordFormat, *AuxiliaryUse, *_UNIT_TIMES))}")
        return cls(layout=Layout(axis_count=int(axes), format=form, auxiliary=use), unit_time=unit_time)

    def __str__(self) -> str:
        if self.layout is None:
            return FOUND
        layout = self.layout
        return f"{layout.axis_count},{layout.format},{layout.auxiliary},{self.unit_time.value}ms"


_UNIT_TIMES: Final = {f"{time.value}ms": time for time in UnitTime}
