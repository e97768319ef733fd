"""The program memory of a control: tapes are read into it, programs are punched from it (B-63322EN-1/01 8.2, 10).

A tape is `% ; O0001 ... M02 ; O0002 ... M30 ; %`. What is before the first program number belongs to none and is left
out; 9.3 note 7 keeps programs with binary input operation out of the memory. What happens to a number that is there
already is the control's own setting: here it is said.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.codes import EIA_SIGNS, DataCode, EiaSigns, encode, table_of
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.conversion import EobForm
from tapewire.fanuc.parameters import LINE_NUMBERS, ParameterSet
from tapewire.g05.sections import find_g05

__all__ = ["FEED_BYTES", "Existing", "ProgramMemory", "PunchForm", "Registration", "punch_form", "tape_of"]

FEED_BYTES: Final = 400
"""Blank tape before and after a punch-out with feed: a metre of tape, as is usual; the manual gives no length."""

MOST_PROGRAMS: Final = 1000

_BEGIN: Final = re.compile(rb"(?m)^[ \t]*[O:][ \t]*(\d{1,8})\b")


class Existing(StrEnum):
    """What becomes of a program whose number is in the memory already."""

    KEPT = "kept"
    REPLACED = "replaced"


@dataclass(frozen=True, slots=True, kw_only=True)
class Registration:
    """What reading one tape has done. `refused` says of each program that was not registered, why."""

    registered: tuple[int, ...]
    refused: tuple[str, ...] = ()
    alarm: AlarmNumber | None = None


class ProgramMemory:
    """Programs by number, each as text from its number on, blocks ending with LF."""

    def __init__(self, existing: Existing = Existing.KEPT) -> None:
        self._existing = existing
        self.programs: dict[int, bytes] = {}

    def read(self, text: bytes) -> Registration:
        """Register what a tape holds: `text` is ASCII with LF, from its label to its EOR."""
        body = text.partition(b"\n")[2].partition(b"%")[0]
        begins = [(found.start(), int(found[1])) for found in _BEGIN.finditer(body)]
        if not begins:
            return Registration(registered=(), refused=("the tape holds no program number",))
        registered: list[int] = []
        refused: list[str] = []
        alarm = None
        for (begin, number), (end, _) in zip(begins, [*begins[1:], (len(body), 0)], strict=True):
            why = self._refusal(number, program := body[begin:end])
            if why is None:
                self.programs[number] = program
                registered.append(number)
            else:
                refused.append(f"O{number:04d}: {why}")
                alarm = alarm or (AlarmNumber.SR891 if find_g05(program, 0) is not None else None)
        return Registration(registered=tuple(registered), refused=tuple(refused), alarm=alarm)

    def _refusal(self, number: int, program: bytes) -> str | None:
        if find_g05(program, 0) is not None:
            return text_of(AlarmNumber.SR891, "binary input operation cannot be registered (9.3 note 7)")
        if number in self.programs:
            return None if self._existing is Existing.REPLACED else "is in the memory already"
        return "the memory is full" if len(self.programs) >= MOST_PROGRAMS else None

    def text(self, numbers: tuple[int, ...] = ()) -> bytes:
        """A tape of these programs, or of all: `%` LF, the programs, `%`. Raises UsageError for one not there."""
        for number in numbers:
            if number not in self.programs:
                raise UsageError(f"O{number:04d} is not in the memory; it holds {len(self.programs)} programs")
        if not self.programs:
            raise UsageError("the program memory is empty: there is nothing to punch")
        chosen = numbers or tuple(sorted(self.programs))
        return b"%\n" + b"".join(self.programs[number] for number in chosen) + b"%"


@dataclass(frozen=True, slots=True, kw_only=True)
class PunchForm:
    """How a control punches: what 0000 and 5081 or 5071 make of a text."""

    code: DataCode
    eob: EobForm
    feed: int


def punch_form(parameters: ParameterSet) -> PunchForm:
    """0000#2, #3 and #4; feed by the specification number of the interface (10.2)."""
    eia = parameters.bit(0, 4)
    code = DataCode.EIA if eia else DataCode.ASCII if parameters.bit(0, 2) else DataCode.ISO
    eob = EobForm.LF if eia or parameters.bit(0, 3) else EobForm.LF_CR_CR
    interface = parameters.interface
    specification = None if interface is None else parameters.get(LINE_NUMBERS[interface].specification)
    return PunchForm(code=code, eob=eob, feed=FEED_BYTES if specification in (1, 2) else 0)


def tape_of(text: bytes, form: PunchForm, signs: EiaSigns = EIA_SIGNS) -> bytes:
    """`text` as it is punched. Raises UsageError for a character that has no code."""
    if form.code is DataCode.EIA and signs != EIA_SIGNS:
        body = text.translate(table_of(form.code, signs).to_code)
    else:
        body = encode(text.replace(b"\n", b"\n\r\r") if form.eob is EobForm.LF_CR_CR else text, form.code)
    return bytes(form.feed) + body + bytes(form.feed)
