"""Punched-tape codes: ISO 840, EIA RS-244 and plain ASCII, as bytes on the wire.

ISO 840 is 7-bit ASCII with even parity in bit 8. EIA RS-244 has odd parity in channel 5, an order of its
own, no lower case and no code for most signs; ( and ) are FANUC's assignment, channels 2-4-5 and 2-4-7.
This parity belongs to the character and has nothing to do with the parity bit of the line.

Text means ASCII bytes whose blocks end with LF (EOB) and whose end of record (EOR) is `%`, whatever the code.

Which signs beside these have an EIA code is a matter of each control's parameters: `EiaSigns` holds them, and
`table_of` gives the table that goes with them. `Recogniser` tells the code of bytes that nobody has named.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
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
    codes |= zip(b"+-/.,& ", bytes.fromhex("70 40 31 6B 3B 0E 10"), strict=True)
    codes |= zip(b"\x00\x08\t\x7f%\n", bytes.fromhex("00 2A 3E 7F 0B 80"), strict=True)
    return codes


FANUC_PARENTHESES: Final[Mapping[str, int]] = MappingProxyType({"(": 0x1A, ")": 0x4A})
"""Channels 2-4-5 and 2-4-7: FANUC's assignment."""

_CASE_SHIFTS: Final = {0x7A: "LC", 0x7C: "UC"}


@dataclass(frozen=True, slots=True)
class EiaSigns:
    """The EIA codes that RS-244 leaves open: parentheses, and signs that a control's parameters assign.

    Raises UsageError for a code of even parity, one that is taken, and a sign that has a code already.
    """

    codes: Mapping[str, int] = field(default_factory=lambda: FANUC_PARENTHESES)

    def __post_init__(self) -> None:
        taken = {code: name_of(character) for character, code in _eia_codes().items()} | _CASE_SHIFTS
        for sign, code in self.codes.items():
            if len(sign) != 1 or not sign.isascii() or not sign.isprintable() or ord(sign) in _eia_codes():
                raise UsageError(f"{sign!r} cannot be given an EIA code: one printable sign without a code is expected")
            if not 0 < code < 0x100 or code.bit_count() % 2 == 0:
                raise UsageError(f"{sign}={code:02X}: an EIA code has an odd number of holes")
            if code in taken:
                raise UsageError(f"{sign}={code:02X}: this is the EIA code of {taken[code]}")
            taken[code] = f"'{sign}'"

    @classmethod
    def parse(cls, words: tuple[str, ...]) -> EiaSigns:
        """FANUC's parentheses with words such as `#=1C` over them. Raises UsageError."""
        codes = dict(FANUC_PARENTHESES)
        for word in words:
            sign, equals, digits = word[:1], word[1:2], word[2:]
            try:
                code = int(digits, 16)
            except ValueError:
                code = -1
            if equals != "=" or not 1 <= len(digits) <= 2 or code < 0:
                raise UsageError(f"{word}: a sign and its EIA code in hexadecimal are expected, as in #=1C")
            codes[sign] = code
        return cls(codes)


EIA_SIGNS: Final = EiaSigns()
"""The parentheses and nothing else."""


def table_of(code: DataCode, signs: EiaSigns = EIA_SIGNS) -> CodeTable:
    """The table of a code; `signs` matter in EIA alone."""
    if code is not DataCode.EIA or signs == EIA_SIGNS:
        return TABLES[code]
    return _eia_table(signs)


def _eia_table(signs: EiaSigns) -> CodeTable:
    return _table(_eia_codes() | {ord(sign): code for sign, code in signs.codes.items()})


TABLES: Final[Mapping[DataCode, CodeTable]] = {
    DataCode.ISO: _table({byte: with_even_parity(byte) for byte in range(0x80)}),
    DataCode.EIA: _eia_table(EIA_SIGNS),
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognition:
    """What the bytes seen so far are. `code` None: no text, or too little of it; `why` says so for the operator.

    `foreign` counts the bytes that are no code of it: damage, if there are any.
    """

    code: DataCode | None
    foreign: int = 0
    why: str


_FEED: Final = (NUL, DEL, 0xFF)
"""Blank tape, and all holes: in every code, and so no sign of any (ISO's DEL has the parity hole too)."""
_FEW: Final = 20
"""Damage is believed to be damage where it is at most one byte in so many."""


class Recogniser:
    """Tells ISO, EIA and ASCII apart by the bytes of a tape or a stream, however they are cut; leader and feed count
    for nothing.

    ISO bytes have an even number of holes, EIA bytes an odd one, ASCII bytes no eighth. A control goes by the first
    EOB, LF or CR, which tells EIA from the others; all bytes together tell more, and of a damaged tape too. Bytes that
    are the same text in ISO and in ASCII are called ASCII.
    """

    def __init__(self, signs: EiaSigns = EIA_SIGNS) -> None:
        self._codes = {
            DataCode.ASCII: frozenset(TABLES[DataCode.ASCII].codes),
            DataCode.ISO: frozenset(TABLES[DataCode.ISO].codes),
            DataCode.EIA: frozenset(table_of(DataCode.EIA, signs).codes),
        }
        self._seen: Counter[int] = Counter()

    def feed(self, data: bytes) -> None:
        self._seen.update(data)

    @property
    def verdict(self) -> Recognition:
        seen = Counter({byte: count for byte, count in self._seen.items() if byte not in _FEED})
        total = seen.total()
        if not total:
            return Recognition(code=None, why="there is nothing but blank tape")
        foreign = {
            code: sum(count for byte, count in seen.items() if byte not in codes) for code, codes in self._codes.items()
        }
        best, second = sorted(foreign, key=lambda code: foreign[code])[:2]
        if foreign[best] and (foreign[best] * _FEW > total or foreign[best] * 5 > foreign[second]):
            return Recognition(code=None, why="the bytes are no text in ISO, EIA or ASCII: binary, or badly damaged")
        if not foreign[DataCode.EIA] and foreign[best] == foreign[DataCode.ASCII] == 0:
            return Recognition(code=None, why="the bytes are text in EIA and in ASCII, and hold no EOB to tell which")
        return Recognition(code=best, foreign=foreign[best], why=_why_this(best, foreign[best], foreign[DataCode.ISO]))


def _why_this(code: DataCode, foreign: int, foreign_to_iso: int) -> str:
    why = {
        DataCode.ISO: "an even number of holes in every byte",
        DataCode.EIA: "an odd number of holes in every byte",
        DataCode.ASCII: "no eighth bit" if foreign_to_iso else "the same bytes in ISO and in ASCII",
    }[code]
    return f"{why}, but for {foreign:,}" if foreign else why


def recognise(data: bytes) -> Recognition:
    """The code of `data` as a whole, with FANUC's parentheses."""
    recogniser = Recogniser()
    recogniser.feed(data)
    return recogniser.verdict
