"""The frame of Telnet around a line's bytes: escapes, options, subnegotiations (RFC 854, 855). Pure and bounded.

Data may be cut anywhere. FFh is a character like any other and goes doubled; what is not data comes out as an item of
its own at its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias

__all__ = ["Asked", "Command", "Option", "Other", "Sub", "TelnetDecoder", "TelnetItem", "Verb", "ask", "escape", "sub"]

IAC: Final = 0xFF

SUB_BOUND: Final = 256
"""Bytes of one subnegotiation; the longest we know is a signature. What is longer is counted and dropped."""


class Command(IntEnum):
    """What may follow IAC, as far as it is told apart here."""

    SE = 240
    NOP = 241
    BREAK = 243
    ARE_YOU_THERE = 246
    SB = 250


class Verb(IntEnum):
    """An offer, a wish, and their refusals."""

    WILL = 251
    WONT = 252
    DO = 253
    DONT = 254


class Option(IntEnum):
    """The options spoken of here. Any other is refused."""

    BINARY = 0
    SUPPRESS_GO_AHEAD = 3
    COM_PORT = 44


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """WILL, WONT, DO or DONT of an option, by its number."""

    verb: Verb
    option: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Sub:
    """A subnegotiation."""

    option: int
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Other:
    """Any other command, by its number."""

    command: int


TelnetItem: TypeAlias = bytes | Asked | Sub | Other


def escape(data: bytes) -> bytes:
    """Data as it goes out."""
    return data.replace(b"\xff", b"\xff\xff")


def ask(verb: Verb, option: int) -> bytes:
    return bytes((IAC, verb, option))


def sub(option: int, payload: bytes) -> bytes:
    return bytes((IAC, Command.SB, option)) + escape(payload) + bytes((IAC, Command.SE))


class _State(IntEnum):
    DATA = 0
    COMMAND = 1
    OPTION = 2
    SUB = 3
    SUB_COMMAND = 4


class TelnetDecoder:
    """Takes a stream apart. `dropped` counts subnegotiations that were too long to be any of ours."""

    def __init__(self) -> None:
        self.dropped = 0
        self._state = _State.DATA
        self._verb = Verb.WILL
        self._sub = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[TelnetItem]:
        items: list[TelnetItem] = []
        plain = bytearray()
        at = 0
        while at < len(data):
            if self._state is _State.DATA:
                mark = data.find(IAC, at)
                end = len(data) if mark < 0 else mark
                plain += data[at:end]
                at = end + 1
                if mark >= 0:
                    self._state = _State.COMMAND
                continue
            item = self._take(data[at])
            at += 1
            if isinstance(item, int):
                plain.append(item)
            elif item is not None:
                items += [bytes(plain), item] if plain else [item]
                plain = bytearray()
        return [*items, bytes(plain)] if plain else items

    def _take(self, byte: int) -> int | Asked | Sub | Other | None:
        """One byte outside plain data: a character, an item, or nothing yet."""
        match self._state:
            case _State.COMMAND:
                return self._command(byte)
            case _State.OPTION:
                self._state = _State.DATA
                return Asked(verb=self._verb, option=byte)
            case _State.SUB if byte == IAC:
                self._state = _State.SUB_COMMAND
            case _State.SUB:
                self._keep(byte)
            case _:
                return self._sub_command(byte)
        return None

    def _command(self, byte: int) -> int | Other | None:
        self._state = _State.DATA
        match byte:
            case 0xFF:
                return byte
            case Command.SB:
                self._state = _State.SUB
                self._sub = bytearray()
                self._too_long = False
            case Verb.WILL | Verb.WONT | Verb.DO | Verb.DONT:
                self._verb = Verb(byte)
                self._state = _State.OPTION
            case _:
                return Other(command=byte)
        return None

    def _sub_command(self, byte: int) -> Sub | None:
        if byte == IAC:
            self._state = _State.SUB
            self._keep(byte)
            return None
        # SE ends it. Anything else is an error of the other side, which ends it as well.
        self._state = _State.DATA
        if self._too_long or not self._sub:
            self.dropped += 1
            return None
        return Sub(option=self._sub[0], payload=bytes(self._sub[1:]))

    def _keep(self, byte: int) -> None:
        if len(self._sub) < SUB_BOUND:
            self._sub.append(byte)
        else:
            self._too_long = True
