"""Troubleshooting after 12.2: from what an operator can see and read to the case it is (B-63322EN-1/01 12.1, 12.2).

The order is the manual's: the parameters first, then the LEDs, then the pointers of the buffer, then what the remote
buffer said last. A recording of the line, where there is one, says the same without the memory display, and more:
who was silent, and who was still sending after a stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple, TypeAlias

from tapewire.fanuc.alarms import ALARMS, BEGIN_AGAIN, AlarmNumber
from tapewire.fanuc.leds import RED_MEANINGS, STATUSES, BoardStatus, Red
from tapewire.fanuc.memory import Cause, pointers_say
from tapewire.fanuc.parameter_check import Weight, check
from tapewire.fanuc.parameters import LINE_NUMBERS, ParameterSet

__all__ = ["Case", "Diagnosis", "From", "Heard", "Seen", "Symptom", "diagnose"]

DC1: Final = 0x11
DC3_CODES: Final = frozenset((0x13, 0x93))


class Symptom(Enum):
    """The external phenomena of 12.2."""

    DOES_NOT_START = "operation does not start after a cycle start"
    STOPPED_EARLY = "operation stopped before its end"
    ALARM = "an alarm is shown"


class Case(Enum):
    """Whose fault it is."""

    PARAMETERS = "the parameters"
    HARDWARE = "the board"
    NOT_ASKED = "the control has not asked the remote buffer"
    LINE = "the line"
    HOST = "the host"
    CONTROL = "the NC"
    HOST_OR_BUFFER = "the host or the remote buffer"
    PROGRAM = "the program, or a character lost on the line"
    UNKNOWN = "not known yet"


class From(Enum):
    """Who said it."""

    HOST = "host"
    CONTROL = "control"


class Heard(NamedTuple):
    """A piece of a recording: the moment in ns, who, and what."""

    at: int
    who: From
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What is known; everything may be missing."""

    symptom: Symptom = Symptom.DOES_NOT_START
    parameters: ParameterSet | None = None
    green: tuple[BoardStatus, ...] = ()
    """What the green LEDs may mean."""
    red: Red = Red.NONE
    pointers: tuple[int, int] | None = None
    """Read pointer and write pointer."""
    alarm: AlarmNumber | None = None
    recording: Sequence[Heard] = field(default_factory=tuple)


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """The case, the steps that led to it, and what to do."""

    case: Case
    steps: tuple[str, ...]
    remedies: tuple[str, ...]


Note: TypeAlias = Callable[[str], object]
Verdict: TypeAlias = tuple[Case, tuple[str, ...]]
"""The case and what to do. A step that leaves it open has none; each notes what it saw."""


def _case(case: Case, *remedies: str) -> Verdict:
    return case, remedies


def diagnose(seen: Seen) -> Diagnosis:
    """Go through the procedure until something tells the case."""
    steps: list[str] = []
    for look in (_at_alarm, _at_parameters, _at_red, _at_green, _at_pointers, _at_recording):
        verdict = look(seen, steps.append)
        if verdict is not None:
            return Diagnosis(case=verdict[0], steps=tuple(steps), remedies=verdict[1])
    return Diagnosis(case=Case.UNKNOWN, steps=tuple(steps), remedies=tuple(_what_to_look_at(seen)))


_CASE_OF_ALARM: Final = {
    AlarmNumber.PS10: Case.PROGRAM,
    AlarmNumber.PS11: Case.PROGRAM,
    AlarmNumber.PS12: Case.PROGRAM,
    AlarmNumber.SR807: Case.PARAMETERS,
    AlarmNumber.SR855: Case.LINE,
    AlarmNumber.SR856: Case.HOST,
    AlarmNumber.SR890: Case.PROGRAM,
    AlarmNumber.SR891: Case.PROGRAM,
    AlarmNumber.SR941: Case.CONTROL,
    AlarmNumber.SR944: Case.HOST,
    AlarmNumber.SR945: Case.HOST,
    AlarmNumber.SR946: Case.LINE,
    AlarmNumber.SR947: Case.HOST,
    AlarmNumber.SR948: Case.HOST,
}


def _at_alarm(seen: Seen, note: Note) -> Verdict | None:
    """12.2 no. 3, and chapter 11."""
    number = seen.alarm
    if number is None:
        return None
    record = ALARMS[number]
    note(f"{number} {record.message}: {' '.join(record.causes)}")
    return _case(_CASE_OF_ALARM[number], *record.remedies, BEGIN_AGAIN)


def _at_parameters(seen: Seen, note: Note) -> Verdict | None:
    """12.2 no. 1 assumes them to be right; so they come first."""
    parameters = seen.parameters
    if parameters is None:
        return None
    interface = parameters.interface
    wrong = [finding for finding in check(parameters, interface) if finding.weight in (Weight.ALARM, Weight.ERROR)]
    if wrong:
        note(f"the parameters are wrong: {'; '.join(map(str, wrong))}")
        return _case(Case.PARAMETERS, "Correct them; switch the control off and on where they ask for it.")
    told = "of an interface that 5000#0 would tell" if interface is None else f"of {interface}"
    note(f"the parameters {told} are in range")
    number = None if interface is None else LINE_NUMBERS[interface].specification
    uses_b = interface is not None and parameters.get(LINE_NUMBERS[interface].protocol) in (1, 2)
    if number is not None and uses_b and parameters.get(number) in (2, 4):
        note(f"No. {number} is {parameters.get(number)}: a device without control codes")
        return _case(Case.PARAMETERS, f"Set No. {number} to 1 or 3: so the control sends no DC1 (protocol B).")
    return None


def _at_red(seen: Seen, note: Note) -> Verdict | None:
    if seen.red is Red.NONE:
        return None
    note(f"red LED {seen.red.value}: {RED_MEANINGS[seen.red]}")
    return _case(Case.HARDWARE, "Switch the control off and on; if it comes back, the hardware must be replaced.")


def _at_green(seen: Seen, note: Note) -> Verdict | None:
    """12.2 no. 1, step 1: is it No. 4 of the normal state?"""
    green = seen.green
    if not green:
        return None
    note(f"green LEDs: {', or '.join(status.value for status in green)}")
    if BoardStatus.HANDLING in green:
        return None
    if not all(STATUSES[status].is_normal for status in green):
        return _case(
            Case.HARDWARE,
            "Note the nine words from 4n80E014 to 4n80E024, and report them (12.1.2).",
            "Switch the control off and on; if it comes back, the hardware must be replaced.",
        )
    if green == (BoardStatus.IDLE,):
        return _case(
            Case.NOT_ASKED,
            "Set the input device, No. 0020 or 0022, to 10, and choose the mode in which cycle start reads from it.",
        )
    return _case(
        Case.NOT_ASKED,
        "Press RESET, and wait until LED 1 alone is on; if that does not come, switch the control off and on.",
    )


def _at_pointers(seen: Seen, note: Note) -> Verdict | None:
    """12.2 no. 1, step 2. With an empty buffer a recording says more."""
    if seen.pointers is None:
        return None
    cause = pointers_say(*seen.pointers)
    note(f"read pointer {seen.pointers[0]:X}h, write pointer {seen.pointers[1]:X}h: {cause.value}")
    if cause is Cause.CONTROL:
        return _case(
            Case.CONTROL,
            "The data is there and is not taken: look for feed hold, single block, an interlock, a block that waits.",
        )
    if not seen.recording:
        return _case(
            Case.HOST_OR_BUFFER,
            "Read what the remote buffer said last: 4n823104 + (write pointer - 1), the pointer at 4n823100 (12.2).",
            "Record the line at the host, and say it here too.",
        )
    return None


def _at_recording(seen: Seen, note: Note) -> Verdict | None:
    """What the line itself says."""
    recording = seen.recording
    if not recording:
        return None
    host = [heard for heard in recording if heard.who is From.HOST and heard.data]
    control = [heard for heard in recording if heard.who is From.CONTROL and heard.data]
    note(f"the recording: {_count(host)} from the host, {_count(control)} from the control")
    if not control and not host:
        return _case(Case.LINE, "Nothing was said: check that cycle start was pressed, the cable, and ER and DR.")
    if not control:
        return _case(Case.LINE, "Nothing came from the control: check SD to the host's RxD, the baud rate, ER and DR.")
    if not host:
        note(f"the control said {_words(control[-1].data)}, and the host nothing")
        return _case(Case.HOST, "Arm a program; check that the host knows this protocol, its code and its rate.")
    last = control[-1]
    after = sum(len(heard.data) for heard in host if heard.at > last.at)
    if len(last.data) == 1 and last.data[0] in DC3_CODES:
        note(f"the control's last word is DC3, and {after:,} characters came from the host after it")
        return _case(
            Case.CONTROL,
            "The control stopped the host, or has ended: look for feed hold, an alarm, or the end of the program.",
            "If hundreds of characters came after the DC3, let the host stop sooner: SR856 comes next.",
        )
    note(f"the control's last word is {_words(last.data)}")
    if last.at >= host[-1].at:
        return _case(Case.HOST, "The control waits for the host, which says nothing more: look at its program and log.")
    return _case(Case.CONTROL, "The host spoke last: the control has what it needs, or has not understood it.")


def _what_to_look_at(seen: Seen) -> Iterator[str]:
    if seen.parameters is None:
        yield "Check the parameters: `tapewire fanuc host-settings`."
    if not seen.green:
        yield "Look at the two green LEDs of the board: which is on, which flashes?"
    if seen.pointers is None:
        yield "Read the pointers of the buffer on the memory display: 4n810500 and 4n810504, long (12.2)."
    if not seen.recording:
        yield "Record the line at the host."


def _count(heard: Sequence[Heard]) -> str:
    return f"{sum(len(one.data) for one in heard):,} characters"


_CODES: Final = {0x11: "DC1", 0x12: "DC2", 0x13: "DC3", 0x93: "DC3", 0x14: "DC4", 0x15: "NAK", 0x95: "NAK"}


def _words(data: bytes) -> str:
    """A code by its name, or the last of a message as text: in ISO the eighth bit is parity."""
    if len(data) == 1 and data[0] in _CODES:
        return _CODES[data[0]]
    text = "".join(chr(byte & 0x7F) if 0x20 <= byte & 0x7F < 0x7F else "." for byte in data[-24:])
    return f'"{text}"'
