"""What a FANUC control punches out, turned into text, with an account of what was spoilt (B-63322EN-1 chapter 8)."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from tapewire.codes import DEL, EIA_SIGNS, NUL, SUB, CodeTable, DataCode, EiaSigns, table_of
from tapewire.errors import UsageError

__all__ = ["Damage", "DamageKind", "PunchReader"]

Write = Callable[[bytes], object]

_TEXT: Final = bytes(range(0x20, DEL)) + b"\n\r\t"


class DamageKind(Enum):
    """What can be wrong with a punch-out; the value is one of them in words."""

    PARITY = "character with wrong parity"
    NO_CODE = "byte that is no character of the code"
    LONE_CR = "CR without LF"
    FEED_IN_BLOCK = "NUL or DEL inside a block"


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """All damage of one kind: how often, and the offset of the first in the punched bytes (from 0)."""

    kind: DamageKind
    first_offset: int
    count: int

    def __str__(self) -> str:
        times = "" if self.count == 1 else f", {self.count:,} times"
        return f"{self.kind.value} at byte {self.first_offset:,}{times}"


_FEED: Final = bytes((NUL, DEL))
_ODD_WEIGHT: Final = bytes(byte for byte in range(256) if byte.bit_count() % 2)
_EVEN_WEIGHT: Final = bytes(byte for byte in range(256) if not byte.bit_count() % 2)
_RUNS: Final = re.compile(rb"[\x00\x7f]+|[^\x00\x7f\r\n]+|[\r\n]")


class PunchReader:
    """Turns what a control punches into ASCII text with LF line ends, however it is cut.

    An EOB may come as LF, CR LF or LF CR CR (parameter NCR, 0000#3), in EIA as 80h. Leader, trailer and feed
    between blocks (NUL, blank, DEL) are left out. Nothing is repaired: a character of wrong parity or a
    control character is stored by its 7 bits, a byte without meaning in EIA as SUB, a CR without LF as CR,
    and each is kept in `damage`: a punch-out with damage has failed. Call `finish` when it has ended.

    What cannot be seen: a character that is missing, one with two wrong bits, in plain ASCII any wrong one,
    and in EIA one spoilt into blank tape at the beginning of a block or at the very end.
    """

    def __init__(self, code: DataCode, write: Write, signs: EiaSigns = EIA_SIGNS) -> None:
        if code is DataCode.BINARY:
            raise UsageError("a binary punch-out cannot be read as text: store it untouched with --raw")
        self._write = write
        table = table_of(code, signs)
        self._to_ascii = _punched_to_ascii(code, table)
        self._wrong_parity, self._no_code = _damaged_bytes(code, table)
        self._damage: dict[DamageKind, Damage] = {}
        self._offset = 0
        self._in_block = False
        self._eob_cr_left = 0
        self._held_cr_offset: int | None = None
        self._feed_in_block: tuple[int, int] | None = None

    @property
    def damage(self) -> tuple[Damage, ...]:
        """One record for each kind of damage seen so far, in the order of their first places."""
        return tuple(sorted(self._damage.values(), key=lambda damage: damage.first_offset))

    def feed(self, data: bytes) -> None:
        """Take the next punched bytes, without the control codes around them."""
        self._note_spoilt(data, self._wrong_parity, DamageKind.PARITY)
        self._note_spoilt(data, self._no_code, DamageKind.NO_CODE)
        text = bytearray()
        for match in _RUNS.finditer(data.translate(self._to_ascii)):
            self._take_run(match.group(), self._offset + match.start(), text)
        self._offset += len(data)
        if text:
            self._write(bytes(text))

    def finish(self) -> tuple[Damage, ...]:
        """Say that the punch-out has ended; all its damage."""
        text = bytearray()
        self._give_up_held_cr(text)
        if text:
            self._write(bytes(text))
        return self.damage

    def _take_run(self, run: bytes, offset: int, text: bytearray) -> None:
        if run[0] in _FEED:
            self._take_feed(offset, len(run))
            return
        self._note_feed_in_block()
        if run == b"\n":
            self._held_cr_offset = None
            self._eob_cr_left = 2
            self._in_block = False
            text += run
        elif run == b"\r":
            self._take_cr(offset, text)
        else:
            self._give_up_held_cr(text)
            self._eob_cr_left = 0
            self._in_block = True
            text += run

    def _take_feed(self, offset: int, count: int) -> None:
        if self._in_block:
            first, before = self._feed_in_block or (offset, 0)
            self._feed_in_block = first, before + count

    def _note_feed_in_block(self) -> None:
        """Feed behind the last block is the trailer; it was inside a block if that goes on."""
        if self._feed_in_block is not None:
            self._note(DamageKind.FEED_IN_BLOCK, *self._feed_in_block)
            self._feed_in_block = None

    def _take_cr(self, offset: int, text: bytearray) -> None:
        if self._eob_cr_left:
            self._eob_cr_left -= 1
            return
        self._give_up_held_cr(text)
        self._held_cr_offset = offset

    def _give_up_held_cr(self, text: bytearray) -> None:
        if self._held_cr_offset is not None:
            self._note(DamageKind.LONE_CR, self._held_cr_offset, 1)
            self._held_cr_offset = None
            text += b"\r"

    def _note_spoilt(self, data: bytes, spoilt: bytes, kind: DamageKind) -> None:
        sound = data.translate(None, spoilt)
        if len(sound) != len(data):
            first = next(index for index, byte in enumerate(data) if byte in spoilt)
            self._note(kind, self._offset + first, len(data) - len(sound))

    def _note(self, kind: DamageKind, offset: int, count: int) -> None:
        before = self._damage.get(kind) or Damage(kind=kind, first_offset=offset, count=0)
        self._damage[kind] = Damage(kind=kind, first_offset=before.first_offset, count=before.count + count)


def _punched_to_ascii(code: DataCode, table: CodeTable) -> bytes:
    if code is not DataCode.EIA:
        return bytes(byte & 0x7F for byte in range(256))
    meant = dict(zip(table.codes, table.characters, strict=True))
    return bytes(meant.get(byte, SUB) for byte in range(256))


def _damaged_bytes(code: DataCode, table: CodeTable) -> tuple[bytes, bytes]:
    """The bytes of wrong parity, and those of right parity that are no character of a program's text."""
    text = _TEXT + _FEED
    sound = {byte for byte, meant in zip(table.codes, table.characters, strict=True) if meant in text}
    wrong_weight = {DataCode.ISO: _ODD_WEIGHT, DataCode.EIA: _EVEN_WEIGHT}.get(code, b"")
    wrong_parity = set(wrong_weight) - sound
    return bytes(sorted(wrong_parity)), bytes(sorted(set(range(256)) - sound - wrong_parity))
