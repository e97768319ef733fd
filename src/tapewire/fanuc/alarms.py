"""The alarms of the remote buffer (B-63322EN-1/01 chapter 11, and 12.2 no. 3): why, what is seen, what to do.

This table is the only place where the text of an alarm stands. The simulated controls raise `Alarm` events with
`text_of`; `tapewire fanuc alarm` prints an entry. The manual writes SR0807 and SR 941; here it is SR807 and SR941, as
operators say it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Final

from tapewire.errors import UsageError

__all__ = ["ALARMS", "AlarmNumber", "AlarmRecord", "alarm_named", "text_of"]


class AlarmNumber(StrEnum):
    """Chapter 11, in its order."""

    PS10 = "PS10"
    PS11 = "PS11"
    PS12 = "PS12"
    SR807 = "SR807"
    SR855 = "SR855"
    SR856 = "SR856"
    SR890 = "SR890"
    SR891 = "SR891"
    SR941 = "SR941"
    SR944 = "SR944"
    SR945 = "SR945"
    SR946 = "SR946"
    SR947 = "SR947"
    SR948 = "SR948"


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmRecord:
    """One alarm. `seen` is what the operator notices beside the message, `remedies` what to try, the likeliest first.

    `protocols` says in which it can come up; `sides` whose fault it is, as far as the manual says.
    """

    number: AlarmNumber
    message: str
    causes: tuple[str, ...]
    seen: str
    remedies: tuple[str, ...]
    protocols: str
    fault_of: str


_COMMUNICATION: Final = "COMMUNICATION ERROR (RMT-BUF)"
_STOPS: Final = "The operation stops at once; what the control had not yet executed is lost with RESET."
_BEGIN_AGAIN: Final = "Press RESET, and begin again from the top or from a block that a person has chosen."
_NO_PROGRAM_FAULT: Final = "the host"


def _program_alarm(number: AlarmNumber, message: str, cause: str, remedy: str) -> AlarmRecord:
    return AlarmRecord(
        number=number,
        message=message,
        causes=(cause,),
        seen="The control stops before the block that it cannot execute; what is before it has been executed.",
        remedies=(remedy, "Compare what the control got with the file: a character lost on the line looks like this."),
        protocols="every protocol",
        fault_of="the program, or the line",
    )


def _protocol_a(number: AlarmNumber, causes: tuple[str, ...], seen: str, *remedies: str) -> AlarmRecord:
    return AlarmRecord(
        number=number,
        message=_COMMUNICATION,
        causes=causes,
        seen=seen,
        remedies=remedies,
        protocols="protocol A and expansion protocol A",
        fault_of=_NO_PROGRAM_FAULT,
    )


_RECORDS: Final = (
    _program_alarm(
        AlarmNumber.PS10, "IMPROPER G-CODE", "A G code that the control does not have.", "Correct the G code."
    ),
    _program_alarm(
        AlarmNumber.PS11,
        "IMPROPER NC-ADDRESS",
        "An address that cannot stand in this block, or whose axis name No. 1020 does not give.",
        "Correct the address, or the axis names in No. 1020.",
    ),
    _program_alarm(
        AlarmNumber.PS12,
        "INVALID BREAK POINT OF WORDS",
        "A block that is not made of words, an address and a number each; or a wrong word in a custom macro.",
        "Correct the block.",
    ),
    AlarmRecord(
        number=AlarmNumber.SR807,
        message="PARAMETER SETTING ERROR",
        causes=(
            "The device number in No. 0020 to 0023 names an interface that is not fitted, or whose option is missing.",
            "The baud rate (No. 5073, 5083), the stop bits (5072, 5082) or the protocol (5074, 5084) are out of range.",
        ),
        seen="Cycle start, read or punch brings the alarm at once; nothing goes over the line.",
        remedies=(
            "Check No. 5072 to 5074 for RS-422 (5000#0 = 1), No. 5082 to 5084 for RS-232-C: "
            "`tapewire fanuc host-settings` says which value is wrong.",
            "Set No. 0020 to 0023 to 10 for the remote buffer, and see that its board is fitted.",
        ),
        protocols="every protocol",
        fault_of="the parameters",
    ),
    AlarmRecord(
        number=AlarmNumber.SR855,
        message="DATA SET READY DOWN (RMT-BUF)",
        causes=(
            "The signal DR (on RS-422 RR) went OFF.",
            "On RS-232-C with 5000#4 = 0: the signal CD went OFF.",
        ),
        seen=_STOPS,
        remedies=(
            "Check the cable: DR comes from the host's ER (DTR), CD is strapped to the control's ER.",
            "See that the host is switched on, its program runs and has not closed the port.",
            "Look for an error that the host, or the device, reports itself.",
        ),
        protocols="every protocol",
        fault_of="the line, or the host",
    ),
    AlarmRecord(
        number=AlarmNumber.SR856,
        message="BUFFER OVERFLOW (RMT-BUF)",
        causes=(
            "The host went on sending after DC3, or after RS went OFF: 512 characters more in protocol B, 2560 in "
            "expansion protocol B.",
        ),
        seen=_STOPS,
        remedies=(
            "Let the host stop sooner: what its driver, its port and a serial server hold back counts too.",
            "See that RS is wired to the host's CTS (protocol A), and that the host reads what the control says.",
        ),
        protocols="every protocol",
        fault_of="the host",
    ),
    AlarmRecord(
        number=AlarmNumber.SR890,
        message="CHECK SUM ERROR (G05)",
        causes=("The check byte of a record of binary input operation does not agree with the record.",),
        seen="The axes stop; the record and those after it are not executed.",
        remedies=(
            "Compare No. 7609 (format, auxiliary functions) and No. 7635 (axes) with what the records were made for: "
            "one byte more or less in each shifts all that follow.",
            "Send again with the parity bit on (stop bits 1), so that damage on the line is noticed where it happens.",
        ),
        protocols="every protocol",
        fault_of="the program, or the line",
    ),
    AlarmRecord(
        number=AlarmNumber.SR891,
        message="ILLEGAL COMMAND G05",
        causes=(
            "G05 was commanded where it must not be: in one of the modes of 9.3 NOTE 2, as cutter compensation or a "
            "canned cycle.",
            "The control has no binary input operation, or the operation is no DNC operation.",
        ),
        seen="The control stops at the block G05.",
        remedies=(
            "Cancel the mode before G05.",
            "Run the program in DNC operation: it cannot be registered in memory (9.3 NOTE 7).",
        ),
        protocols="every protocol",
        fault_of="the program",
    ),
    AlarmRecord(
        number=AlarmNumber.SR941,
        message=_COMMUNICATION,
        causes=("The control gave the remote buffer a command that it does not know: an error of the control itself.",),
        seen=_STOPS,
        remedies=(
            "Switch the control off and on.",
            "If it comes back, note the send buffer and the LEDs (12.2) and report them to the maker of the control.",
        ),
        protocols="every protocol",
        fault_of="the control",
    ),
    _protocol_a(
        AlarmNumber.SR944,
        ("The host did not answer within To.",),
        _STOPS,
        "See that the host's program runs, and answers WAT when it has no data yet.",
        "Check that the host's SD reaches the control, and the baud rate of both ends.",
        "Give the host more time by To (SET, positions 25 to 28).",
    ),
    _protocol_a(
        AlarmNumber.SR945,
        ("A message or packet was asked for more than Ne times, or the host asked more than Ne times.",),
        _STOPS,
        "Look for disturbance on the line: cable, shield, length (2.1).",
        "See that both ends agree on the code (5000#2) and the end code (5000#3).",
    ),
    AlarmRecord(
        number=AlarmNumber.SR946,
        message=_COMMUNICATION,
        causes=("A framing error or an overrun error: a character came damaged, or before the last had been fetched.",),
        seen=_STOPS,
        remedies=(
            "Check the baud rate: No. 5073 or 5083, and the host's.",
            "Check the stop bits: No. 5072 or 5082, and the host's. One stop bit goes with even parity.",
            "Look for disturbance on the line: cable, shield, length (2.1).",
        ),
        protocols="every protocol",
        fault_of="the line, or the settings of either end",
    ),
    _protocol_a(
        AlarmNumber.SR947,
        ("The host answered with a command that is no answer to what was asked.",),
        _STOPS,
        "Mend the host's program: only certain answers are allowed to each message (4.4.1).",
    ),
    _protocol_a(
        AlarmNumber.SR948,
        (
            "The end code stood inside the name of a command.",
            "The command does not exist.",
            "A command came that was not expected.",
        ),
        _STOPS,
        "See that both ends agree on the code (5000#2) and the end code (5000#3).",
        "See that the program holds no end code: blocks end with LF, without CR.",
        "Mend the host's program.",
    ),
)

ALARMS: Final[Mapping[AlarmNumber, AlarmRecord]] = MappingProxyType({record.number: record for record in _RECORDS})
"""Every alarm of chapter 11."""

BEGIN_AGAIN: Final = _BEGIN_AGAIN
"""The last thing to do after every alarm that ended an operation."""

_NAME: Final = re.compile(r"(?:(SR|PS)\s*)?0*(\d{1,4})\Z", re.I)


def text_of(number: AlarmNumber, detail: str) -> str:
    """What the control shows, with what the simulation knows beside it."""
    return f"{ALARMS[number].message}: {detail}"


def alarm_named(name: str) -> AlarmRecord:
    """The alarm called SR945, sr0945, `SR 945` or 945. Raises UsageError with the numbers there are."""
    found = _NAME.match(name.strip())
    kind, digits = (found[1] or "", found[2]) if found else ("", "")
    for number, record in ALARMS.items():
        if number[2:] == digits and kind.upper() in ("", number[:2]):
            return record
    raise UsageError(f"there is no alarm {name!r} of the remote buffer; its alarms are {', '.join(ALARMS)}")
