"""Captures: all that is said on a line, with time, control lines and faults, so that it can be proved later.

A capture is a pcapng file of link type RTAC serial, which Wireshark opens. This is the format and nothing else: what
a record is, and how one is written. `capture_reader.py` reads, `capture_file.py` fills files.

A packet is a header of 12 characters, high byte first, and the characters of the line:

    seconds  microseconds  what  control lines  reserved  characters
    4        4             1     1              2         0 and more

Both times stand in the frame around it too, there in nanoseconds. Sources: tcpdump.org, LINKTYPE_RTAC_SERIAL;
IETF draft-ietf-opsawg-pcapng.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag, StrEnum
from typing import Final

from tapewire.engine import MICROSECOND, SECOND, LineFault, Nanos

__all__ = [
    "ALL_ON",
    "FAULTS",
    "FROM_THIS_SIDE",
    "LINK_TYPE",
    "MAX_DATA",
    "ByteOrder",
    "Encoder",
    "Happening",
    "Lines",
    "Origin",
    "Record",
    "Side",
    "called_back",
    "recalled",
]

LINK_TYPE: Final = 250
"""LINKTYPE_RTAC_SERIAL."""

RTAC_HEADER: Final = struct.Struct(">IIBBH")

SECTION_HEADER: Final = 0x0A0D0D0A
INTERFACE_DESCRIPTION: Final = 1
ENHANCED_PACKET: Final = 6
BYTE_ORDER_MAGIC: Final = 0x1A2B3C4D

OPT_COMMENT: Final = 1
IF_NAME: Final = 2
IF_DESCRIPTION: Final = 3
SHB_USERAPPL: Final = 4
IF_SPEED: Final = 8
IF_TSRESOL: Final = 9
EPB_FLAGS: Final = 2

NANOSECONDS: Final = 9
"""if_tsresol: a power of ten."""

MAX_DATA: Final = 0x8000
"""Characters in one record; more are cut into several."""

MAX_OPTION: Final = 0xFFFF
"""An option's length has 16 bits."""


class Happening(IntEnum):
    """What a packet is about, in the numbers of its header."""

    STATUS_CHANGE = 0x00
    SENT = 0x01
    """DATA_TX_START: characters that the end which wrote the capture handed over to the line."""
    RECEIVED = 0x02
    """DATA_RX_START."""
    SENT_ALL = 0x03
    """DATA_TX_END. Never written here; read as SENT when it has characters."""
    RECEIVED_ALL = 0x04
    """DATA_RX_END."""
    DATA_LOST = 0x05
    """Something is missing from the capture here, though not from the line."""
    COMPLETE = 0x06
    """The end of the line, or of the capture."""
    FRAMING_ERROR = 0x07
    PARITY_ERROR = 0x08
    BREAK = 0x09
    UART_OVERRUN = 0x0A


class Lines(IntFlag):
    """The control lines at the moment of a packet; a bit that is set means ON."""

    CTS = 0x01
    CD = 0x02
    DSR = 0x04
    RTS = 0x08
    DTR = 0x10
    RING = 0x20
    MBOK = 0x40
    """A line of the RTAC only."""


ALL_ON: Final = Lines.CTS | Lines.CD | Lines.DSR | Lines.RTS | Lines.DTR
"""What a line without control lines says throughout: all are taken as ON there."""

FAULTS: Final = {
    Happening.FRAMING_ERROR: LineFault.FRAMING,
    Happening.PARITY_ERROR: LineFault.PARITY,
    Happening.BREAK: LineFault.BREAK,
    Happening.UART_OVERRUN: LineFault.UART_OVERRUN,
}


FROM_THIS_SIDE: Final = "from this side"
"""The remark of a fault in what the side said that wrote the capture, as a monitor between two lines sees it. Any other
fault was in what came in."""


class ByteOrder(IntEnum):
    """Of the frame around the packets; the values are those that `Encoder` puts into struct formats."""

    LITTLE = ord("<")
    BIG = ord(">")


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """One packet. `at` is Unix time; `data` of a fault is what the UART read, empty where it read nothing."""

    at: Nanos
    what: Happening
    lines: Lines = ALL_ON
    data: bytes = b""
    remark: str = ""
    """In words, for people."""


def called_back(count: int) -> str:
    """The remark that the last `count` characters handed over were called back and never left."""
    return f"called back: {count}"


def recalled(remark: str) -> int:
    """How many characters a remark says were called back; 0 for any other remark."""
    words, _, count = remark.rpartition(" ")
    return int(count) if words == "called back:" and count.isascii() and count.isdigit() and len(count) < 10 else 0


class Side(StrEnum):
    """Who says something on a line. A capture calls *sent* what the side said that wrote it."""

    HOST = "host"
    CONTROL = "control"

    @property
    def other(self) -> Side:
        return Side.CONTROL if self is Side.HOST else Side.HOST


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """What a capture says of itself: which line, which side of it, and what was spoken."""

    line: str = ""
    baud: int = 0
    framing: str = ""
    side: Side | None = None
    """None where the capture does not say."""
    protocol: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    """The `--set` words of the job."""

    @property
    def description(self) -> str:
        said = (self.line, f"{self.baud} baud {self.framing}".rstrip() if self.baud else "", self.protocol)
        return ", ".join(part for part in said if part)

    def dumps(self) -> str:
        """As a comment that `loads` understands and people can read."""
        return json.dumps({"side": self.side, "protocol": self.protocol, "settings": dict(self.settings)})

    @classmethod
    def loads(cls, comment: str, *, line: str = "", baud: int = 0) -> Origin:
        """From a comment, which may be anybody's: what is not understood is left empty. Never raises."""
        try:
            said = json.loads(comment)
        except (ValueError, RecursionError):
            said = None
        said = said if isinstance(said, dict) else {}
        side, protocol, settings = said.get("side"), said.get("protocol"), said.get("settings")
        words = settings.items() if isinstance(settings, dict) else ()
        return cls(
            line=line,
            baud=baud,
            side=Side(side) if side in list(Side) else None,
            protocol=protocol if isinstance(protocol, str) else "",
            settings={key: word for key, word in words if isinstance(word, str)},
        )


class Encoder:
    """Writes the blocks of one section with one interface. It holds no state: any block may be left out."""

    def __init__(self, byte_order: ByteOrder = ByteOrder.LITTLE) -> None:
        order = chr(byte_order)
        self._word = struct.Struct(f"{order}I")
        self._section = struct.Struct(f"{order}IHHq")
        self._interface = struct.Struct(f"{order}HHI")
        self._packet = struct.Struct(f"{order}IIIII")
        self._option = struct.Struct(f"{order}HH")
        self._speed = struct.Struct(f"{order}Q")

    def header(self, origin: Origin, *, program: str = "Tapewire") -> bytes:
        """What a file, or a section of it, begins with."""
        section = self._section.pack(BYTE_ORDER_MAGIC, 1, 0, -1)
        section += self._options((SHB_USERAPPL, program.encode()))
        name = origin.side or "line"
        # Snapshot length 0: no limit.
        interface = self._interface.pack(LINK_TYPE, 0, 0) + self._options(
            (IF_NAME, name.encode()),
            (IF_DESCRIPTION, origin.description.encode()),
            (IF_SPEED, self._speed.pack(origin.baud)),
            (IF_TSRESOL, bytes([NANOSECONDS])),
            (OPT_COMMENT, origin.dumps().encode()),
        )
        return self._block(SECTION_HEADER, section) + self._block(INTERFACE_DESCRIPTION, interface)

    def record(self, record: Record) -> bytes:
        """One packet, or several when its characters are too many for one."""
        if len(record.data) <= MAX_DATA:
            return self._enhanced(record, record.data)
        pieces = range(0, len(record.data), MAX_DATA)
        return b"".join(self._enhanced(record, record.data[at : at + MAX_DATA]) for at in pieces)

    def _enhanced(self, record: Record, data: bytes) -> bytes:
        seconds, rest = divmod(record.at, SECOND)
        head = RTAC_HEADER.pack(seconds & 0xFFFFFFFF, rest // MICROSECOND, record.what, record.lines, 0)
        length = len(head) + len(data)
        body = self._packet.pack(0, record.at >> 32 & 0xFFFFFFFF, record.at & 0xFFFFFFFF, length, length)
        body += _padded(head + data)
        flags = _DIRECTIONS.get(record.what)
        options = [(EPB_FLAGS, self._word.pack(flags))] if flags else []
        if record.remark:
            options.append((OPT_COMMENT, record.remark.encode()))
        return self._block(ENHANCED_PACKET, body + self._options(*options))

    def _options(self, *options: tuple[int, bytes]) -> bytes:
        said = [(code, value[:MAX_OPTION]) for code, value in options if value]
        encoded = b"".join(self._option.pack(code, len(value)) + _padded(value) for code, value in said)
        return encoded + self._option.pack(0, 0) if said else b""

    def _block(self, kind: int, body: bytes) -> bytes:
        length = self._word.pack(len(body) + 12)
        return self._word.pack(kind) + length + body + length


_DIRECTIONS: Final = {Happening.RECEIVED: 0b01, Happening.SENT: 0b10}
"""epb_flags: inbound, outbound."""


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
