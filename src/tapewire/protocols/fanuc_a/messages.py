"""The messages of protocol A (B-63322EN-1 4.1, 4.2, 4.4.1) and what their short data parts hold (4.4.2).

    sum  command  data        end
    2    3        0 and more  1      characters

Sum: the low 8 bits of all bytes from the command to the end code as transmitted, two hexadecimal digits, high digit
first. There is no start mark and no length: a message ends with its end code, which therefore never occurs in data.

The control speaks, the host answers. What SAT and SET carry is in `status.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final, TypeAlias

from tapewire.codes import TABLES, DataCode
from tapewire.errors import UsageError

__all__ = [
    "ANSWERS",
    "LONGEST_DAT",
    "LONGEST_DATA",
    "ORIGINS",
    "Coding",
    "Command",
    "DataError",
    "EndCode",
    "Error",
    "Message",
    "MessageCode",
    "MessageReader",
    "Origin",
    "Reading",
    "RetryReason",
    "Unreadable",
    "checksum",
    "encode_image",
    "encode_message",
    "parse_image",
    "parse_retry_reason",
]

LONGEST_DAT: Final = 4096
"""Bytes of data in a DAT (4.4.2). No legal pair of Nb and No lets it be reached (4.5 note 1)."""

LONGEST_DATA: Final = 72
"""Bytes of data in any other message (4.4.2)."""

_OVERHEAD: Final = 6
"""Sum, command, end code."""


class Command(Enum):
    """The 17 commands of 4.4.1."""

    SYN = "SYN"
    """Initialise."""
    RDY = "RDY"
    """Initialised."""
    RST = "RST"
    """The CNC was reset."""
    ARS = "ARS"
    """Seen: RST."""
    ALM = "ALM"
    """The CNC has an alarm."""
    AAL = "AAL"
    """Seen: ALM."""
    SAT = "SAT"
    """Status of the remote buffer, and the parameters it works with."""
    SET = "SET"
    """Seen: SAT; with data, parameters to work with from now on."""
    GTD = "GTD"
    """Send NC data."""
    DAT = "DAT"
    """NC data."""
    WAT = "WAT"
    """No NC data yet; ask again."""
    EOD = "EOD"
    """No NC data any more."""
    CLB = "CLB"
    """Clear the buffer."""
    RDI = "RDI"
    """Read the DI byte."""
    SDI = "SDI"
    """The DI byte."""
    SDO = "SDO"
    """Write the DO byte."""
    RTY = "RTY"
    """Repeat the message before; it arrived damaged."""


class Origin(StrEnum):
    """Who sends a command."""

    CONTROL = "control"
    HOST = "host"
    BOTH = "both"


def _origins() -> dict[Command, Origin]:
    by_control = (Command.RST, Command.ALM, Command.SAT, Command.GTD, Command.SDI)
    by_both = (Command.SYN, Command.RDY, Command.RTY)
    origins = dict.fromkeys(Command, Origin.HOST)
    return origins | dict.fromkeys(by_control, Origin.CONTROL) | dict.fromkeys(by_both, Origin.BOTH)


ORIGINS: Final[dict[Command, Origin]] = _origins()

_SAT_ANSWERS: Final = frozenset({Command.SET, Command.CLB, Command.RDI, Command.SDO, Command.SYN})
_GTD_ANSWERS: Final = frozenset({Command.DAT, Command.EOD, Command.WAT, Command.RDI, Command.SDO})

ANSWERS: Final[dict[Command, frozenset[Command]]] = {
    Command.SYN: frozenset({Command.SYN}),
    Command.RDY: frozenset({Command.RDY, Command.SYN}),
    Command.RST: frozenset({Command.ARS}),
    Command.ALM: frozenset({Command.AAL}),
    Command.SAT: _SAT_ANSWERS,
    Command.GTD: _GTD_ANSWERS,
    Command.SDI: _SAT_ANSWERS | _GTD_ANSWERS,
}
"""What the host may answer to what the control says (4.4.1; the table prints EOB where it means EOD).

SDI draws the answer still owed to the SAT or GTD that was answered with RDI: one of that command's, not of both.
RTY may answer anything and draws a repetition of the message before it.
"""


class MessageCode(StrEnum):
    """Parameter 5000#2, with the polarity it has in protocol A: 0 is ASCII, 1 is ISO (4.2)."""

    ASCII = "ascii"
    ISO = "iso"


class EndCode(StrEnum):
    """Parameter 5000#3: 0 is CR, 1 is ETX (4.1)."""

    CR = "cr"
    ETX = "etx"


_TABLE: Final = {MessageCode.ASCII: TABLES[DataCode.ASCII], MessageCode.ISO: TABLES[DataCode.ISO]}
_DECODE: Final = {
    code: bytes(table.to_ascii[byte] if byte in table.codes else ord("?") for byte in range(0x100))
    for code, table in _TABLE.items()
}
_END: Final = {EndCode.CR: b"\r", EndCode.ETX: b"\x03"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Coding:
    """How messages are written on this line: 5000#2 and 5000#3."""

    code: MessageCode = MessageCode.ASCII
    end: EndCode = EndCode.CR

    @property
    def end_byte(self) -> bytes:
        """The one byte that ends a message: 0Dh, 8Dh or 03h."""
        return self.encode(_END[self.end])

    def encode(self, text: bytes) -> bytes:
        """ASCII characters as this line carries them."""
        return text.translate(_TABLE[self.code].to_code)

    def decode(self, raw: bytes) -> bytes:
        """ASCII characters from the line; `?` for a byte that is no character of this code."""
        return raw.translate(_DECODE[self.code])


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """A message without its frame. `data` is ASCII whatever the code of the line, but in DAT it is what is sent."""

    command: Command
    data: bytes = b""


class Error(StrEnum):
    """Why a message cannot be read."""

    CHECKSUM = "checksum error"
    """4.6 2) (1): ask for it again."""
    SHORT = "end code inside the command"
    """4.6 2) (2), chapter 11 SR948 cause 1."""
    UNDEFINED = "undefined command"
    TOO_LONG = "data part too long"
    BROKEN_OFF = "message broken off"
    """It began and did not end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unreadable:
    """Characters up to an end code that are no message; `raw` is their beginning."""

    error: Error
    raw: bytes


Reading: TypeAlias = Message | Unreadable


class DataError(ValueError):
    """The data part of a message whose sum was right says something that cannot be."""


def checksum(data: bytes | bytearray) -> bytes:
    """Two hexadecimal digits, ASCII: the low 8 bits of the sum (4.1).

    sum() takes about 6 µs a kilobyte, for which a line of 86400 baud needs 130 ms: no need for numpy.
    """
    return b"%02X" % (sum(data) & 0xFF)


def encode_message(message: Message, coding: Coding) -> bytes:
    """The bytes on the wire. UsageError when the data is too long or holds the end code (4.1, 4.4.2)."""
    command, data = message.command, message.data
    is_dat = command is Command.DAT
    limit = LONGEST_DAT if is_dat else LONGEST_DATA
    if len(data) > limit:
        raise UsageError(f"{command.value} with {len(data)} bytes of data: at most {limit} are possible")
    body = coding.encode(command.value.encode()) + (data if is_dat else coding.encode(data))
    end = coding.end_byte
    if end in body:
        offset = body.index(end) - len(command.value)
        raise UsageError(f"the data of {command.value} holds the end code {end[0]:02X}h at offset {offset}")
    body += end
    return coding.encode(checksum(body)) + body


class MessageReader:
    """Finds messages in what comes in, the same whatever the pieces it comes in.

    `longest` is the longest data part to expect. A longer message is read to its end code and is `TOO_LONG`; no more
    than `longest` and the frame is ever kept.
    """

    def __init__(self, coding: Coding, *, longest: int = LONGEST_DAT) -> None:
        self._coding = coding
        self._end = coding.end_byte[0]
        self._bound = longest + _OVERHEAD
        self._commands = {coding.encode(command.value.encode()): command for command in Command}
        self._kept = bytearray()
        self._length = 0
        self._damaged = False

    @property
    def pending(self) -> int:
        """Characters of a message that has begun and not ended."""
        return self._length

    def read(self, data: bytes, position: int = 0) -> tuple[int, Reading | None]:
        """Take characters from `position` to the end of one message. Returns where to go on, and what was found."""
        found = data.find(self._end, position)
        stop = len(data) if found < 0 else found + 1
        self._kept += data[position : min(stop, position + self._bound + 1 - len(self._kept))]
        self._length += stop - position
        return stop, None if found < 0 else self._finish()

    def damage(self) -> None:
        """A character was lost or damaged: the message it belongs to has a checksum error, whatever its sum says."""
        self._damaged = True

    def break_off(self) -> Unreadable | None:
        """Give up waiting for the rest of a message; None when none has begun."""
        unreadable = Unreadable(error=Error.BROKEN_OFF, raw=bytes(self._kept)) if self._length else None
        self._reset()
        return unreadable

    def _reset(self) -> None:
        self._kept.clear()
        self._length = 0
        self._damaged = False

    def _finish(self) -> Reading:
        raw, damaged, length = bytes(self._kept), self._damaged, self._length
        self._reset()
        if damaged:
            return Unreadable(error=Error.CHECKSUM, raw=raw)
        if length > self._bound:
            return Unreadable(error=Error.TOO_LONG, raw=raw[: self._bound])
        return self._decode(raw)

    def _decode(self, raw: bytes) -> Reading:
        """The sum comes first: what a damaged message says, its command too, means nothing."""
        if len(raw) < _OVERHEAD:
            return Unreadable(error=Error.SHORT, raw=raw)
        if self._coding.decode(raw[:2]).upper() != checksum(raw[2:]):
            return Unreadable(error=Error.CHECKSUM, raw=raw)
        command = self._commands.get(raw[2:5])
        if command is None:
            return Unreadable(error=Error.UNDEFINED, raw=raw)
        data = raw[5:-1]
        if command is Command.DAT:
            return Message(command=command, data=data)
        if len(data) > LONGEST_DATA:
            return Unreadable(error=Error.TOO_LONG, raw=raw)
        return Message(command=command, data=self._coding.decode(data))


class RetryReason(Enum):
    """Data of RTY (4.4.2 6))."""

    CHECKSUM = b"1"
    OVERRUN = b"3"
    """Data came after RS had been turned OFF."""


def parse_retry_reason(data: bytes) -> RetryReason | None:
    """Why the other side asks again; None for a reason the manual does not know, or none given."""
    return next((reason for reason in RetryReason if reason.value == data[:1]), None)


def encode_image(image: int) -> bytes:
    """Data of SDI and SDO: 8 bits of G152 or F152 (4.4.2 4), 5))."""
    return b"%02X" % image


def parse_image(data: bytes) -> int:
    """The 8 bits of SDI or SDO. DataError when there are none."""
    return parse_hex(data[:2].rjust(2, b"?"), "image of DI or DO")


def parse_hex(digits: bytes, what: str) -> int:
    """Hexadecimal digits; a leading blank stands for 0 (4.4.2 1), example). DataError otherwise."""
    significant = digits.lstrip(b" ")
    if not significant or significant.translate(None, _HEX_DIGITS):
        raise DataError(f"{what}: {digits.decode('latin-1')!r} is no hexadecimal number")
    return int(significant, 16)


_HEX_DIGITS: Final = b"0123456789ABCDEFabcdef"
