"""Holds a recorded dialogue of protocol A or its expansion against chapters 4 and 5."""

from __future__ import annotations

import re
from typing import Final

from tapewire.engine import SECOND, Nanos
from tapewire.protocols.fanuc_a.messages import ANSWERS, ORIGINS, Command, Origin
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import POWER_ON
from tapewire.protocols.listening import Word, is_unreadable
from tapewire.protocols.settings import End

__all__ = ["Listener"]

_TIME_OUT: Final = re.compile(r"\bTo=(\d+)")
_COMMANDS: Final = {command.value: command for command in Command}
_INTERRUPTIONS: Final = frozenset({Command.RST, Command.ALM, Command.SYN, Command.RTY, Command.RDY})
"""What the control may say instead of waiting for the answer (4.3)."""


class Listener:
    """Were all sums right, was every command answered in time and with an answer it may have (4.4.1)."""

    def __init__(self, params: Params) -> None:
        self._expected_packets = bool(params.packet_n)
        self._time_out_s = POWER_ON.to
        self._asked: tuple[Command, Nanos] | None = None
        self._right = self._wrong = self._packets = 0
        self._slowest: Nanos = 0
        self.evidence = 0

    def heard(self, who: End, word: Word, began: Nanos, ended: Nanos) -> list[str]:
        if isinstance(word, bytes):
            return []
        if is_unreadable(word):
            self._wrong += 1
            self.evidence -= 1
            # Asked again it will be, and what it was an answer to is not known.
            self._asked = None
            return [f"the {who} said something unreadable: {word[1:-1]}"]
        self._right += 1
        command = _COMMANDS.get(word[:3])
        if who is End.HOST:
            return self._host_says(command, word, began)
        return self._control_says(command, word, began, ended)

    def _control_says(self, command: Command | None, word: str, began: Nanos, ended: Nanos) -> list[str]:
        if command is None:
            self._packets += 1
            return []
        wrong = self._origin(command, Origin.HOST)
        if self._asked is not None and command not in _INTERRUPTIONS and self._asked[0] in ANSWERS:
            asked, at = self._asked
            wrong.append(f"{asked.value} got no answer in {(began - at) / SECOND:.1f} s (To is {self._time_out_s} s)")
        self._asked = (command, ended) if command in ANSWERS else None
        return wrong

    def _host_says(self, command: Command | None, word: str, began: Nanos) -> list[str]:
        if command is None:
            self._packets += 1
            self.evidence += self._expected_packets
        else:
            self.evidence += 2
        asked, self._asked = self._asked, None
        wrong = [] if command is None else self._origin(command, Origin.CONTROL)
        if asked is not None:
            wrong += self._answer(*asked, command, began)
        if command is Command.SET and (said := _TIME_OUT.search(word)):
            self._time_out_s = int(said[1])
        return wrong

    def _answer(self, asked: Command, at: Nanos, command: Command | None, began: Nanos) -> list[str]:
        took = began - at
        self._slowest = max(self._slowest, took)
        wrong = []
        if command is not None and command is not Command.RTY and command not in ANSWERS[asked]:
            wrong.append(f"{command.value} is no answer to {asked.value} (4.4.1)")
        if took > self._time_out_s * SECOND:
            wrong.append(f"the answer to {asked.value} came after {took / SECOND:.1f} s, To is {self._time_out_s} s")
        return wrong

    def _origin(self, command: Command, other: Origin) -> list[str]:
        if ORIGINS[command] is not other:
            return []
        self.evidence -= 4
        return [f"{command.value} is a word of the {other} (4.4.1)"]

    def summary(self) -> list[str]:
        if not self._right and not self._wrong:
            return []
        said = [f"{self._right} messages and packets with a right sum, {self._wrong} unreadable"]
        if self._slowest:
            said.append(f"slowest answer of the host: {self._slowest / SECOND:.3f} s, To is {self._time_out_s} s")
        return said
