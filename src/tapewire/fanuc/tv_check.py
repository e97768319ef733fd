"""TV check: every block has an even number of characters (B-63322EN-1/01 chapter 10, 0000#0 and #1).

A character lost or doubled on the way makes its block odd. Characters are counted from behind an EOB to the next EOB,
this one included; what label skip passes over is exempt, and what follows EOR is not read. Blank tape and DEL do not
count. Not stated, and taken so: each CR counts (LF CR CR adds two, and so changes nothing), and a comment that is not
counted is left out with its parentheses.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.codes import EIA_SIGNS, DataCode, EiaSigns, table_of
from tapewire.errors import UsageError

__all__ = ["Comments", "TvCheck", "TvFailure"]

_FEED: Final = b"\x00\x7f"
_SHOWN: Final = 40


class Comments(StrEnum):
    """0000#1: whether the characters of comments are counted."""

    COUNTED = "counted"
    NOT_COUNTED = "not counted"


@dataclass(frozen=True, slots=True, kw_only=True)
class TvFailure:
    """One block with an odd count. `block` counts from 1 behind the label, `offset` is that of its first byte."""

    block: int
    offset: int
    characters: int
    text: str

    def __str__(self) -> str:
        where = f"block {self.block:,} at byte {self.offset:,}"
        return f"TV check: {where} has {self.characters:,} characters, an odd number: {self.text}"


class TvCheck:
    """Checks a program as it comes in, however it is cut."""

    def __init__(self, code: DataCode, *, comments: Comments = Comments.COUNTED, signs: EiaSigns = EIA_SIGNS) -> None:
        if code is DataCode.BINARY:
            raise UsageError("binary data has no blocks: there is nothing for a TV check")
        to_ascii = bytearray(table_of(code, signs).to_ascii)
        if code is not DataCode.EIA:
            to_ascii[0x80:] = bytes(byte & 0x7F for byte in range(0x80, 0x100))
        self._to_ascii = bytes(to_ascii)
        self._comments = comments
        self._in_label = True
        self._ended = False
        self._in_comment = False
        self._offset = 0
        self._begin = 0
        self._count = 0
        self._text = b""
        self.blocks = 0
        """Blocks checked."""

    def feed(self, data: bytes) -> list[TvFailure]:
        """Take the next bytes; the failures of the blocks that end in them."""
        failures: list[TvFailure] = []
        rest = data.translate(self._to_ascii)
        while rest and not self._ended:
            end = rest.find(b"\n") + 1
            piece, rest = (rest[:end], rest[end:]) if end else (rest, b"")
            self._take(piece, failures)
        self._offset += len(rest)
        return failures

    def _take(self, piece: bytes, failures: list[TvFailure]) -> None:
        eor = -1 if self._in_label else piece.find(b"%")
        if eor >= 0:
            self._ended = True
            return
        if not self._text:
            self._begin = self._offset + len(piece) - len(piece.lstrip(_FEED + b"\r"))
        self._offset += len(piece)
        characters = piece.translate(None, _FEED)
        self._count += len(characters) if self._comments is Comments.COUNTED else self._count_outside(characters)
        self._text = (self._text + characters.lstrip(b"\r" if not self._text else b""))[:_SHOWN]
        if piece.endswith(b"\n"):
            self._end_block(failures)

    def _count_outside(self, characters: bytes) -> int:
        count = 0
        while characters:
            if self._in_comment:
                end = characters.find(b")") + 1
                if not end and not characters.endswith(b"\n"):
                    return count
                self._in_comment = False
                characters = characters[end or len(characters) - 1 :]
            else:
                begin = characters.find(b"(")
                count += begin if begin >= 0 else len(characters)
                self._in_comment = begin >= 0
                characters = characters[begin + 1 :] if begin >= 0 else b""
        return count

    def _end_block(self, failures: list[TvFailure]) -> None:
        if self._in_label:
            self._in_label = False
        else:
            self.blocks += 1
            if self._count % 2:
                text = self._text.rstrip(b"\n").decode("ascii", "backslashreplace")
                failures.append(TvFailure(block=self.blocks, offset=self._begin, characters=self._count, text=text))
        self._count, self._text, self._in_comment = 0, b"", False
