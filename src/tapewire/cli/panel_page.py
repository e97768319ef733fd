"""The page of the panel that shows the parameters and takes new values: `5083=11`, and INPUT."""

from __future__ import annotations

import re
from typing import Final

from tapewire.cli.panel_view import Mark, Page, Row
from tapewire.errors import UsageError
from tapewire.fanuc.parameter_check import ParameterMemory, check
from tapewire.fanuc.parameter_file import value_of, word_of
from tapewire.fanuc.parameters import CATALOGUE
from tapewire.transfer.operated import OperatedControl

__all__ = ["ParameterPage"]

LONGEST_ENTRY: Final = 20

_NUMBERS: Final = tuple(CATALOGUE)
_TYPED: Final = re.compile(r"(?P<number>\d{1,4})=(?P<value>-?\d{1,9})\Z", re.ASCII)


class ParameterPage:
    """Which page is shown, and what is being typed. 0 is the program."""

    def __init__(self, control: OperatedControl) -> None:
        self._control = control
        self.number = 0
        self._typed = ""

    def turn(self, room: int) -> None:
        """The next page of `room` parameters; behind the last one comes the program."""
        self._typed = ""
        if self._control.parameters is None:
            self._control.say("there are no parameters: --parameters FILE gives them")
            return
        pages = -(-len(_NUMBERS) // room)
        self.number = (self.number + 1) % (pages + 1)

    def key(self, key: str, room: int) -> bool:
        """True for a key of this page."""
        if not self.number:
            return False
        if key in "0123456789=-":
            self._typed = (self._typed + key)[:LONGEST_ENTRY]
        elif key in "\b\x7f":
            self._typed = self._typed[:-1]
        elif key in "\r\n":
            self._enter(room)
        else:
            return False
        return True

    def _enter(self, room: int) -> None:
        typed, self._typed = self._typed, ""
        found = _TYPED.match(typed)
        if found is None:
            self._control.say(f"{typed or 'nothing'}: NUMBER=VALUE is expected, as in 5083=11")
            return
        number = int(found["number"])
        try:
            if number not in CATALOGUE:
                raise UsageError(f"No. {number:04d} is no parameter of the remote buffer")
            self._control.enter(number, value_of(number, found["value"]))
        except UsageError as error:
            self._control.say(str(error))
            return
        self.number = _NUMBERS.index(number) // room + 1

    def shown(self, room: int) -> Page | None:
        """None while the program is shown."""
        memory = self._control.parameters
        if memory is None or not self.number:
            return None
        pages = -(-len(_NUMBERS) // room)
        self.number = min(self.number, pages)
        numbers = _NUMBERS[(self.number - 1) * room : self.number * room]
        wrong = {finding.number for finding in check(memory.entered, memory.entered.interface)}
        rows = tuple(_row(number, memory, number in wrong) for number in numbers)
        return Page(title=f"PARAMETER {self.number}/{pages}", rows=rows, entry=self._typed)


def _row(number: int, memory: ParameterMemory, is_wrong: bool) -> Row:
    record, values = CATALOGUE[number], memory.entered
    value, waits = values.get(number), number in memory.waiting
    word = "-" if value is None else word_of(number, value)
    meaning = record.title if value is None or record.is_bits else record.values.get(value, record.title)
    if waits:
        before = memory.in_force.get(number)
        meaning = f"power off and on, till then {'-' if before is None else word_of(number, before)}"
    mark = Mark.WRONG if is_wrong else Mark.WAITING if waits else Mark.PLAIN
    return Row(text=f"{number:04d} {word:>8} {meaning}", mark=mark)
