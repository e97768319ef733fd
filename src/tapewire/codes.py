"""Punched-tape codes: ISO 840, EIA RS-244 and plain ASCII, as bytes on the wire.

ISO 840 is 7-bit ASCII with even parity in bit 8. EIA RS-244 has odd parity in channel 5, an order of its
own, no lower case and no code for most signs; ( and ) are FANUC's assignment, channels 2-4-5 and 2-4-7.
This parity belongs to the character and has nothing to do with the parity bit of the line.

Text means ASCII bytes whose blocks end with LF (EOB) and whose end of record (EOR) is `%`, whatever the code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.errors import UsageError

NUL: Final = 0x00
ETX: Final = 0x03
TAB: Final = 0x09
LF: Final = 0x0A
CR: Final = 0x0D
DC1: Final = 0x11
DC2: Final = 0x12
DC3: Final = 0x13
DC4: Final = 0x14
NAK: Final = 0x15
SYN: Final = 0x16
CAN: Final = 0x18
SUB: Final = 0x1A
DEL: Final = 0x7F

_CONTROL_NAMES: Final = (
    "NUL SOH STX ETX EOT ENQ ACK BEL BS TAB LF VT FF CR SO SI "
    "DLE DC1 DC2 DC3 DC4 NAK SYN ETB CAN EM SUB ESC FS GS RS US"
)


class DataCode(StrEnum):
    """What the data of a transfer is made of; the values are the words of `--set data=`."""

    ISO = "iso"
    EIA = "eia"
    ASCII = "ascii"
    BINARY = "binary"


def with_even_parity(byte: int) -> int:
    """The ISO 840 form of a 7-bit character: DC3 13h becomes 93h."""
    return byte | 0x80 if byte.bit_count() % 2 else byte


def name_of(byte: int) -> str:
    """A byte as an operator may look it up: `NUL (00h)`, `'#' (23h)`, `byte C3h (not ASCII)`."""
    if byte < 0x20:
        return f"{_CONTROL_NAMES.split()[byte]} ({byte:02X}h)"
    if byte == DEL:
        return "DEL (7Fh)"
    return f"'{chr(byte)}' ({byte:02X}h)" if byte < DEL else f"byte {byte:02X}h (not ASCII)"


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeTable:
    """One code: `characters[i]` is sent as `codes[i]`; the other two are its `bytes.translate` tables.

    A translate table leaves a byte that has no code as it is: look with `first_outside` before.
    """

    characters: bytes
    codes: bytes
    to_code: bytes
    to_ascii: bytes


def _table(codes: Mapping[int, int]) -> CodeTable:
    characters, values = bytes(codes), bytes(codes.values())
    return CodeTable(
        characters=characters,
        codes=values,
        to_code=bytes.maketrans(characters, values),
        to_ascii=bytes.maketrans(values, characters),
    )


def _eia_codes() -> dict[int, int]:
    """RS-244 by ASCII character. UC (7Ch) and LC (7Ah) shift case and have none; blank tape is NUL."""
    codes = dict(zip(b"1234567890", bytes.fromhex("01 02 13 04 15 16 07 08 19 20"), strict=True))
    codes |= zip(b"ABCDEFGHI", bytes.fromhex("61 62 73 64 75 76 67 68 79"), strict=True)
    codes |= zip(b"JKLMNOPQR", bytes.fromhex("51 52 43 54 45 46 57 58 49"), strict=True)
    codes |= zip(b"STUVWXYZ", bytes.fromhex("32 23 34 25 26 37 38 29"), strict=True)
    codes |= zip(b"+-/.,& ()", bytes.fromhex("70 40 31 6B 3B 0E 10 1A 4A"), strict=True)
    codes |= zip(b"\x00\x08\t\x7f%\n", bytes.fromhex("00 2A 3E 7F 0B 80"), strict=True)
    return codes


TABLES: Final[Mapping[DataCode, CodeTable]] = {
    DataCode.ISO: _table({byte: with_even_parity(byte) for byte in range(0x80)}),
    DataCode.EIA: _table(_eia_codes()),
    DataCode.ASCII: _table({byte: byte for byte in range(0x80)}),
    DataCode.BINARY: _table({byte: byte for byte in range(0x100)}),
}

EOB_CODES: Final[Mapping[DataCode, bytes]] = {
    DataCode.ISO: b"\x0a",
    DataCode.EIA: b"\x80",
    DataCode.ASCII: b"\x0a",
    DataCode.BINARY: b"",
}
"""The bytes that end a block. Binary data has none."""

EOR_CODES: Final[Mapping[DataCode, bytes]] = {
    DataCode.ISO: b"\xa5\x25",
    DataCode.EIA: b"\x0b",
    DataCode.ASCII: b"\x25\xa5",
    DataCode.BINARY: b"",
}
"""The bytes a control takes as end of record, the one we send first; ISO and ASCII text may be mixed up."""


def first_outside(data: bytes, allowed: bytes) -> int | None:
    """The offset of the first byte of `data` that is not among `allowed`."""
    others = data.translate(None, allowed)
    return data.find(others[:1]) if others else None


def encode(text: bytes, code: DataCode) -> bytes:
    """ASCII bytes in `code`. UsageError names the first character that has no code, and its offset."""
    table = TABLES[code]
    if (offset := first_outside(text, table.characters)) is not None:
        raise UsageError(f"{name_of(text[offset])} at offset {offset} has no {code.upper()} code")
    return text.translate(table.to_code)


def decode(data: bytes, code: DataCode) -> bytes:
    """What `data` in `code` means, in ASCII. UsageError names the first byte that is no code, and where."""
    table = TABLES[code]
    if (offset := first_outside(data, table.codes)) is not None:
        raise UsageError(f"{data[offset]:02X}h at offset {offset} is not an {code.upper()} code")
    return data.translate(table.to_ascii)
