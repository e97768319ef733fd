"""The LEDs of the remote buffer board: every state, and what it means (B-63322EN-1/01 12.1).

Two green ones tell what the software does, three red ones what the hardware has. Not flashing and without a message on
the screen is the normal state; flashing is a system error, which only power off and on ends.

How the green ones look in the first three system errors is a lost figure. Here they are drawn after their codes, as in
the normal states, where the code is the number that LED 1 and LED 2 make: a reconstruction, and said so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum
from types import MappingProxyType
from typing import Final

from tapewire.errors import UsageError

__all__ = [
    "RED_MEANINGS",
    "STATUSES",
    "SYSTEM_MESSAGES",
    "BoardStatus",
    "Led",
    "Red",
    "Status",
    "SystemFault",
    "read_leds",
]


class Led(StrEnum):
    ON = "on"
    OFF = "off"
    FLASHING = "flashing"
    ALTERNATING = "alternating"
    """Flashing in turn with the other one."""


class BoardStatus(Enum):
    """What the green LEDs say: Table 12.1.1, then Table 12.1.2 (a)."""

    POWER_ON = "power has just come on, and the remote buffer's processor does not run yet"
    INITIALISING = "power-on: it waits until all modules are initialised"
    IDLE = "it waits for a request of the control"
    HANDLING = "it has a request of the control, and handles it"
    STOPPING = "a reset, an alarm or the end of the program told it to stop, and it waits for the control to shut down"
    DRAM_TEST = "the test of the DRAM module failed; the system does not start"
    LOADING = "the parity of what was loaded into the code area is wrong; the system does not start"
    NMI = "an NMI came up in another module than the remote buffer"
    SYSTEM_ALARM = "a system alarm, with its message on the screen"


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """One row. `code` is None where the table has none; `message` says whether the screen shows one."""

    status: BoardStatus
    green: tuple[Led, Led]
    code: int | None
    message: bool = False
    reconstructed: bool = False

    @property
    def is_normal(self) -> bool:
        return all(led in (Led.ON, Led.OFF) for led in self.green)


_ON, _OFF, _FLASH, _TURN = Led.ON, Led.OFF, Led.FLASHING, Led.ALTERNATING


def _error(status: BoardStatus, green: tuple[Led, Led], code: int | None, *, message: bool = True) -> Status:
    return Status(status=status, green=green, code=code, message=message, reconstructed=True)


_ROWS: Final = (
    Status(status=BoardStatus.POWER_ON, green=(_ON, _ON), code=3),
    Status(status=BoardStatus.INITIALISING, green=(_OFF, _OFF), code=0),
    Status(status=BoardStatus.IDLE, green=(_ON, _OFF), code=1),
    Status(status=BoardStatus.HANDLING, green=(_OFF, _ON), code=2),
    Status(status=BoardStatus.STOPPING, green=(_ON, _ON), code=3),
    _error(BoardStatus.DRAM_TEST, (_FLASH, _FLASH), None),
    _error(BoardStatus.LOADING, (_FLASH, _OFF), 1),
    _error(BoardStatus.NMI, (_OFF, _FLASH), 2, message=False),
    Status(status=BoardStatus.SYSTEM_ALARM, green=(_TURN, _TURN), code=None, message=True),
)

STATUSES: Final[Mapping[BoardStatus, Status]] = MappingProxyType({row.status: row for row in _ROWS})
"""Every row of both tables."""


class Red(Enum):
    """The red LED that is on: Table 12.1.2 (b)."""

    NONE = 0
    RESET = 1
    L_BUS = 2
    DRAM_PARITY = 3


RED_MEANINGS: Final[Mapping[Red, str]] = MappingProxyType(
    {
        Red.NONE: "the hardware has nothing to report",
        Red.RESET: "the board is held in reset: the main processor has not started it",
        Red.L_BUS: "L-BUS bus error: an error inside this printed circuit board, which must be replaced",
        Red.DRAM_PARITY: "DRAM parity error in the DRAM module of this board: replace the module",
    }
)


class SystemFault(Enum):
    """Table 12.1.2 (c), by code. Codes 4 to B flash alternately."""

    DRAM_CHECK_SUM = 0x1
    HARD = 0x4
    ILLEGAL_INTERRUPT = 0x5
    F_BUS = 0x6
    DRAM_PARITY = 0x7
    ARES_BUS = 0x8
    LFP_BUS = 0x9
    F_BUS_WRITE = 0xA
    OTHER_WRITE = 0xB


SYSTEM_MESSAGES: Final[Mapping[SystemFault, tuple[str, str]]] = MappingProxyType(
    {
        SystemFault.DRAM_CHECK_SUM: (
            "DRAM CHECK SUM ERROR",
            "the parity of what was loaded into the code area is wrong",
        ),
        SystemFault.HARD: ("HARD ERROR", "the printed circuit board must be replaced"),
        SystemFault.ILLEGAL_INTERRUPT: (
            "UNDEF IRT 00nn(aaaaaaaa) ERR-CODE:cccc",
            "an interrupt that there is none of; 00nn is its type",
        ),
        SystemFault.F_BUS: ("F-BUS ERROR(aaaaaaaa)", "a bus error with the board as master of the F-BUS"),
        SystemFault.DRAM_PARITY: (
            "DRAM PARITY 000n(aaaaaaaa)",
            "a parity error in DRAM; 000n is the row of bytes",
        ),
        SystemFault.ARES_BUS: ("BUS ERROR(ARES) (aaaaaaaa)", "a bus error with the ARES as master of the L-BUS"),
        SystemFault.LFP_BUS: ("BUS ERROR(LFP) (aaaaaaaa)", "a bus error with the LFP as master of the L-BUS"),
        SystemFault.F_BUS_WRITE: (
            "WRITE BUS ERROR(F-BUS) (aaaaaaaa)",
            "an error in a write with the F-BUS as master of the L-BUS",
        ),
        SystemFault.OTHER_WRITE: (
            "WRITE BUS ERROR(aaaaaaaa)",
            "an error in a write with another master of the L-BUS",
        ),
    }
)
"""Message on the screen, and what it means: aaaaaaaa is the address of the next instruction, cccc an error code."""


def read_leds(words: str) -> tuple[BoardStatus, ...]:
    """What green LEDs written as two words may mean, LED 1 first: `on,off`. Code 3 means either of two things.

    Raises UsageError for words that are none, and for a pair that no table has.
    """
    parts = tuple(word.strip().lower() for word in words.split(","))
    if len(parts) != 2 or not all(part in list(Led) for part in parts):
        known = ", ".join(Led)
        raise UsageError(f"LEDs {words!r}: two words for LED 1 and LED 2 are expected, as in on,off; they are {known}")
    green = (Led(parts[0]), Led(parts[1]))
    found = tuple(status for status, row in STATUSES.items() if row.green == green)
    if not found:
        raise UsageError(f"LEDs {words!r}: no state of 12.1 looks so; look again, and whether they flash in turn")
    return found
