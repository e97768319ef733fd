"""Programs as text on a Bridgeport line: what may be sent, how it is prepared, and what a control sent.

Control characters other than CR, LF and TAB, and bytes of eight bits, would forge codes of the protocol: a program that
holds any is refused, never repaired. Line ends become CR LF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tapewire.codes import CR, DEL, LF, NUL, TAB, first_outside, name_of
from tapewire.errors import ProgramError
from tapewire.protocols.bridgeport.messages import NAME_BYTES
from tapewire.protocols.bridgeport.records import LINK_TEXT_BYTES
from tapewire.protocols.text_rules import Read, Told, Write

__all__ = ["TEXT", "BridgeportText", "SavedText", "inspect_raw", "prepare"]

TEXT: Final = bytes((*range(0x20, DEL), CR, LF, TAB))
"""What the text of a program may hold."""

CHUNK_BYTES: Final = 1 << 16

_LONE_CR: Final = re.compile(rb"\r(?!\n)")
_FEED: Final = bytes((NUL, DEL))


def prepare(read: Read, write: Write) -> Told:
    """Write the text file behind `read` as it can be sent: with CR LF, in constant memory.

    A lone CR as line end is refused, as FANUC's preparation does: it may be a lost LF. Raises ProgramError with line
    and column at the first byte that cannot be sent; what has been written until then is to be thrown away.
    """
    byte_count = lone_lf_count = 0
    last = b""
    line = 1
    for piece in _pieces(read):
        _check(piece, line)
        if lone := _LONE_CR.search(piece):
            raise _refusal(piece, lone.start(), line, "CR without LF: end the lines with LF or CR LF")
        lone_lf_count += piece.count(b"\n") - piece.count(b"\r\n")
        line += piece.count(b"\n")
        text = piece.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")
        last = text[-1:]
        byte_count += len(text)
        write(text)
    changes = [f"LF made CR LF in {_counted(lone_lf_count, 'line')}"] if lone_lf_count else []
    if byte_count and last != b"\n":
        write(b"\r\n")
        byte_count += 2
        changes.append("CR LF put after the last line, which had no line end")
    return Told(changes=tuple(changes), notes=_notes(byte_count))


def inspect_raw(read: Read) -> Told:
    """Read a file that is to be sent untouched. What would forge codes is refused here too."""
    byte_count, line = 0, 1
    for piece in _pieces(read):
        _check(piece, line)
        line += piece.count(b"\n")
        byte_count += len(piece)
    return Told(notes=_notes(byte_count))


def _notes(byte_count: int) -> tuple[str, ...]:
    """Raises ProgramError for an empty file."""
    if not byte_count:
        raise ProgramError("the file is empty: there is nothing to send")
    if byte_count <= NAME_BYTES:
        return (f"{_counted(byte_count, 'byte')}: the protocol knows no program of less than {NAME_BYTES + 1}",)
    if byte_count > LINK_TEXT_BYTES:
        return (f"{byte_count:,} bytes: too long for REMOTE LOAD (;L), the control must ask for it by DNC LINK (;D)",)
    return ()


def _pieces(read: Read) -> Iterator[bytes]:
    """The file in pieces that end with LF where they can, so that no CR LF is cut."""
    pending = b""
    while chunk := read(CHUNK_BYTES):
        pending += chunk
        cut = pending.rfind(b"\n") + 1 or (len(pending) - 1 if len(pending) > CHUNK_BYTES else 0)
        if cut:
            yield pending[:cut]
            pending = pending[cut:]
    if pending:
        yield pending


def _check(piece: bytes, line: int) -> None:
    offset = first_outside(piece, TEXT)
    if offset is not None:
        what = f"{name_of(piece[offset])} is no character of a program and could be taken for a code: remove it"
        raise _refusal(piece, offset, line, what)


def _refusal(piece: bytes, offset: int, line: int, why: str) -> ProgramError:
    at, column = line + piece.count(b"\n", 0, offset), offset - piece.rfind(b"\n", 0, offset)
    return ProgramError(f"line {at}, column {column}: {why}", line=at, column=column)


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


class SavedText:
    """Turns what a control sent into a text file with LF line ends, without leader and trailer, however it is cut.

    Nothing is repaired: a CR without LF and a control character stay, and `damage` says so.
    """

    def __init__(self, write: Write) -> None:
        self._write = write
        self._carry = b""
        self.damage: list[str] = []
        self._count = 0

    def feed(self, data: bytes) -> None:
        data = self._carry + data.translate(None, _FEED)
        self._carry = b"\r" if data.endswith(b"\r") else b""
        self._put(data[: len(data) - len(self._carry)])

    def finish(self) -> list[str]:
        self._put(self._carry)
        self._carry = b""
        return self.damage

    def _put(self, data: bytes) -> None:
        if (offset := first_outside(data, TEXT)) is not None:
            self._note(f"{name_of(data[offset])}, no character of a program,", offset)
        if lone := _LONE_CR.search(data):
            self._note("CR without LF", lone.start())
        self._count += len(data)
        if text := data.replace(b"\r\n", b"\n"):
            self._write(text)

    def _note(self, what: str, offset: int) -> None:
        if not self.damage:
            self.damage.append(f"{what} at byte {self._count + offset + 1:,}")


@dataclass(frozen=True, slots=True)
class BridgeportText:
    """The rules of a Bridgeport line."""

    @property
    def eob(self) -> bytes:
        return b"\n"

    def prepare(self, read: Read, write: Write) -> Told:
        return prepare(read, write)

    def inspect_raw(self, read: Read) -> Told:
        return inspect_raw(read)

    def reader(self, write: Write) -> SavedText:
        return SavedText(write)
