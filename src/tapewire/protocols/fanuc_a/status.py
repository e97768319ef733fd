"""What SAT and SET carry (B-63322EN-1 4.4.2 1), 2)) and the parameters of table 4.5.

Positions count from 1. Unused positions may hold anything. A data part may stop early: what it does not say stays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final

from tapewire.protocols.fanuc_a.messages import LONGEST_DATA, DataError, parse_hex

__all__ = [
    "CAUSES",
    "LIMITS",
    "POWER_ON",
    "SHORTEST_STATUS",
    "TENTHS_OF_SECONDS",
    "USED_LENGTH",
    "AlarmCause",
    "BufferState",
    "Doubt",
    "Filler",
    "Limit",
    "Parameters",
    "Setting",
    "Status",
    "disbelief",
]

SHORTEST_STATUS: Final = 8
"""A SAT says at least its state and how much is stored."""

USED_LENGTH: Final = 56
"""The last position with a meaning is 56."""

TENTHS_OF_SECONDS: Final = 0x0004
"""P2 of positions 41 to 44 is bit 2: Tp counts in 0.1 s."""


class BufferState(Enum):
    """Position 2 of SAT."""

    NOT_READY = "0"
    RESET = "1"
    OPERATING = "2"
    ALARM = "3"
    OPEN_LINE = "4"


class AlarmCause(Enum):
    """Position 3 of SAT, when the state is ALARM."""

    NC_ALARM = "0"
    CHECKSUM = "1"
    """Too many retries."""
    UNEXPECTED = "6"
    OVERRUN = "A"
    """Too many retries."""


class Filler(StrEnum):
    """What stands in positions without a meaning: the manual does not say."""

    ZERO = "0"
    BLANK = "blank"

    @property
    def byte(self) -> bytes:
        return b"0" if self is Filler.ZERO else b" "


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """A row of table 4.5."""

    name: str
    meaning: str
    unit: str
    low: int
    high: int
    power_on: int


LIMITS: Final[dict[str, Limit]] = {
    "nb": Limit(name="Nb", meaning="free space above which GTD is sent", unit="bytes", low=1, high=4000, power_on=2000),
    "no": Limit(name="No", meaning="bytes taken after RS OFF", unit="bytes", low=2, high=2000, power_on=50),
    "ne": Limit(name="Ne", meaning="retries", unit="times", low=0, high=100, power_on=10),
    "tp": Limit(name="Tp", meaning="polling interval", unit="s", low=1, high=99, power_on=5),
    "to": Limit(name="To", meaning="time-out", unit="s", low=1, high=999, power_on=20),
    "ti": Limit(
        name="Ti", meaning="least time between bytes the control sends", unit="ms", low=0, high=10, power_on=10
    ),
    "tx": Limit(name="Tx", meaning="least time from reception to sending", unit="ms", low=0, high=100, power_on=100),
    "tw": Limit(name="Tw", meaning="wait after WAT", unit="s", low=0, high=99, power_on=5),
}
"""Table 4.5 by field of `Parameters`. Tw is at most Tp, Ti is even, and Nb is at least No + 1 (notes 1 and 2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Positions 9 to 56 of SAT and SET; the defaults are those of power-on."""

    nb: int = 2000
    no: int = 50
    ne: int = 10
    tp: int = 5
    to: int = 20
    ti: int = 10
    tx: int = 100
    tw: int = 5
    unit: int = 0
    """16 bits, of which only P2 has a meaning and is kept: Tp in tenths of a second."""
    convert_from: int = 0
    convert_to: int = 0
    n: int = 0
    """Data bytes of a packet / 256; anything but 1, 2 and 4 means protocol A (5.2 1))."""

    @property
    def tp_ms(self) -> int:
        """The polling interval in milliseconds, whatever its unit."""
        return self.tp * (100 if self.unit & TENTHS_OF_SECONDS else 1000)

    @property
    def packet_n(self) -> int:
        """n as it counts: 0 when it is anything but 1, 2 and 4 (5.2 1) note)."""
        return self.n if self.n in (1, 2, 4) else 0

    @property
    def longest_dat(self) -> int:
        """Nb - No: what a DAT may hold at most (4.5 note 1)."""
        return self.nb - self.no

    def out_of_range(self) -> str | None:
        """Which value is outside its range (table 4.5); None when none is."""
        for field, limit in LIMITS.items():
            value = getattr(self, field)
            if not limit.low <= value <= limit.high:
                return f"{limit.name} = {value} {limit.unit}: {limit.low} to {limit.high} is possible"
        return None

    def complaint(self) -> str | None:
        """Why these values are not legal (table 4.5 and its notes); None when they are."""
        if out := self.out_of_range():
            return out
        if self.ti % 2:
            return f"Ti = {self.ti} ms: steps of 2 ms are possible"
        if self.tw > self.tp:
            return f"Tw = {self.tw} is greater than Tp = {self.tp}"
        if self.nb < self.no + 1:
            return f"Nb = {self.nb} leaves no room for data beside No = {self.no}"
        return None


POWER_ON: Final = Parameters()

_POSITIONS: Final[dict[str, tuple[int, int]]] = {
    "nb": (9, 12),
    "no": (13, 16),
    "ne": (17, 20),
    "tp": (21, 24),
    "to": (25, 28),
    "ti": (29, 32),
    "tx": (33, 36),
    "tw": (37, 40),
    "unit": (41, 44),
    "convert_from": (45, 46),
    "convert_to": (47, 48),
    "n": (55, 56),
}
"""Field of `Parameters` -> first and last position."""


def _parse_parameters(data: bytes, base: Parameters) -> Parameters:
    values = {}
    for field, (first, last) in _POSITIONS.items():
        digits = data[first - 1 : last]
        if len(digits) == last - first + 1 and digits.strip():
            values[field] = parse_hex(digits, f"positions {first} to {last} ({field.capitalize()})")
    values["unit"] = values.get("unit", base.unit) & TENTHS_OF_SECONDS
    return dataclasses.replace(base, **values)


def _encode(head: bytes, stored: int | None, parameters: Parameters, length: int, filler: Filler) -> bytes:
    data = bytearray(filler.byte * length)
    data[: len(head)] = head
    if stored is not None:
        data[4:8] = b"%04X" % stored
    for field, (first, last) in _POSITIONS.items():
        width = last - first + 1
        data[first - 1 : last] = b"%0*X" % (width, getattr(parameters, field))
    return bytes(data)


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Data of SAT."""

    switching: str = "0"
    """Position 1: what the last SET said there, or always 0 (5000#1)."""
    state: BufferState = BufferState.NOT_READY
    cause: AlarmCause = AlarmCause.NC_ALARM
    stored: int = 0
    """Bytes in the buffer."""
    parameters: Parameters = POWER_ON

    @classmethod
    def parse(cls, data: bytes, base: Parameters = POWER_ON) -> Status:
        """Any length from 8 on; `base` is what parameters it does not name are. DataError."""
        if len(data) < SHORTEST_STATUS:
            raise DataError(f"SAT with {len(data)} positions: {SHORTEST_STATUS} are the least")
        try:
            state = BufferState(chr(data[1]))
        except ValueError:
            raise DataError(f"SAT with state {chr(data[1])!r}") from None
        causes = {cause.value: cause for cause in AlarmCause}
        cause = causes.get(chr(data[2]))
        if cause is None and state is BufferState.ALARM:
            raise DataError(f"SAT with alarm cause {chr(data[2])!r}")
        return cls(
            switching=chr(data[0]),
            state=state,
            cause=cause or AlarmCause.NC_ALARM,
            stored=parse_hex(data[4:8], "positions 5 to 8 (bytes stored)"),
            parameters=_parse_parameters(data, base),
        )

    def encode(self, length: int = USED_LENGTH, filler: Filler = Filler.ZERO) -> bytes:
        """`length` is 56 or 72."""
        assert USED_LENGTH <= length <= LONGEST_DATA
        head = (self.switching + self.state.value + self.cause.value).encode()
        return _encode(head, self.stored, self.parameters, length, filler)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Data of SET. One without data changes nothing and is not made of this."""

    switching: str = "0"
    """Position 1: request to switch between remote and tape operation. Which digit means which is not stated."""
    parameters: Parameters = POWER_ON

    @classmethod
    def parse(cls, data: bytes, base: Parameters) -> Setting:
        """Any length; `base` is what parameters it does not name are, those now in force. DataError."""
        return cls(switching=chr(data[0]) if data else "0", parameters=_parse_parameters(data, base))

    def encode(self, length: int = USED_LENGTH, filler: Filler = Filler.ZERO) -> bytes:
        """`length` is 56 or 72: one that stops at 48 might not be accepted."""
        assert USED_LENGTH <= length <= LONGEST_DATA
        return _encode(self.switching.encode(), None, self.parameters, length, filler)


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """Why nothing of a SAT is believed."""

    what: str
    readable: bool
    """It says a value that no control can work with. Otherwise it says what the manual does not."""


def disbelief(data: bytes, base: Parameters) -> Doubt | None:
    """Of these data of SAT; None when they are believed."""
    try:
        impossible = Status.parse(data, base).parameters.out_of_range()
    except DataError as error:
        return Doubt(what=str(error), readable=False)
    return Doubt(what=f"SAT with {impossible}", readable=True) if impossible else None


CAUSES: Final = {
    AlarmCause.NC_ALARM: "NC alarm",
    AlarmCause.CHECKSUM: "too many checksum errors",
    AlarmCause.UNEXPECTED: "it did not expect our answer",
    AlarmCause.OVERRUN: "too many overruns",
}
"""What alarm state is about, in words."""
