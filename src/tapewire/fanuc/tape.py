"""NC programs as text: how FANUC controls read them from a line and punch them (B-63322EN/01 chapter 8).

To the control, `prepare` turns a text file into exactly what will be sent, or refuses it with the line:

    O0001 CR LF G91 CR LF M30 CR LF   ->   % LF O0001 LF G91 LF M30 LF %

A control begins with label skip on: it passes over everything up to the first EOB, the leading `%` too.
From there the first `%` (EOR) ends the data, in a comment as well, and what follows is not read. So a
program begins with `%` or an EOB and holds no `%` until its last byte. `TapeScanner` is that rule as a
control sees it.

From the control, `PunchReader` turns a punch-out into a text file and keeps account of what was spoilt.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Final

from tapewire.codes import (
    CR,
    DEL,
    EIA_SIGNS,
    EOB_CODES,
    EOR_CODES,
    NUL,
    SUB,
    TABLES,
    CodeTable,
    DataCode,
    EiaSigns,
    first_outside,
    name_of,
    table_of,
)
from tapewire.errors import ProgramError, UsageError

Read = Callable[[int], bytes]
"""Gives at most so many bytes of the file, and b"" only at its end."""
Write = Callable[[bytes], object]

CHUNK_BYTES: Final = 65536
"""Work in pieces of this size: large enough for the speed of bytes methods, small against any memory."""
MAX_BLOCK_BYTES: Final = 1 << 20
"""No block is longer than the control's buffer (8 KB); a file without LF must not end up in memory."""

_PRINTABLE: Final = bytes(range(0x20, DEL))
_TEXT: Final = _PRINTABLE + b"\n\r\t"
_BLANKS: Final = b" \t\r"
_AFTER_EOR: Final = b" \t\r\n\x00\x1a"  # 1Ah ends a text file of CP/M and MS-DOS

_LONE_CR: Final = re.compile(rb"\r(?!\n)")
# Binary data follows the block G05 EOB (chapter 9); block number, block skip and comments do not change that.
_G05_END: Final = re.compile(rb"[Gg][ \t]*(?:0[ \t]*)*5[ \t]*(?:\([^()\n]*\)[ \t]*)*\r?(?:\n|\Z)")
_G05_BEGINNING: Final = re.compile(rb"(?:/[1-9]?)?(?:[Nn][0-9]+)?")
_COMMENT: Final = re.compile(rb"\([^()\n]*\)")

_RAW_ADVICE: Final = "or send the file untouched with --raw"


@dataclass(frozen=True, slots=True, kw_only=True)
class Preparation:
    """What `prepare` wrote, and how it differs from the file.

    `byte_count` counts the bytes written. `block_count` counts the blocks that hold anything, without the
    title that label skip passes over. `changes` says for the operator what was changed; it is empty when
    the text went through as it was (the conversion to `code` is no change of the text).
    """

    byte_count: int
    block_count: int
    changes: tuple[str, ...]


def prepare(read: Read, write: Write, code: DataCode) -> Preparation:
    """Write the text file behind `read` as a control can take it, in `code`, in constant memory.

    Raises ProgramError for a text that the control would take wrongly, at the first place where it would.
    What has been written until then is to be thrown away: call it once with a `write` that keeps nothing to
    know the result before anything is sent. Binary data is never prepared: UsageError.
    """
    if code is DataCode.BINARY:
        raise UsageError("binary data cannot be prepared as text: send the file untouched with --raw")
    preparer = _Preparer(write, code)
    for piece in _pieces(read):
        preparer.take(piece)
    return preparer.finish()


def _pieces(read: Read) -> Iterator[bytes]:
    """The file in pieces that end with LF (the last may not), so that no CR LF and no block is ever cut.

    A piece longer than a block may be, without any LF, is handed on as it is.
    """
    pending = bytearray()
    while chunk := read(CHUNK_BYTES):
        pending += chunk
        if len(pending) < CHUNK_BYTES:
            continue
        cut = pending.rfind(b"\n") + 1 or (len(pending) if len(pending) > MAX_BLOCK_BYTES else 0)
        if cut:
            yield bytes(pending[:cut])
            del pending[:cut]
    if pending:
        yield bytes(pending)


class _Preparer:
    def __init__(self, write: Write, code: DataCode) -> None:
        self._write = write
        self._code = code
        self._table = TABLES[code]
        self._sendable = bytes(set(_TEXT) & {*self._table.characters, CR})
        self._line = 1
        self._begun = False
        self._eor: tuple[int, int] | None = None
        self._last = b""
        self._byte_count = 0
        self._block_count = 0
        self._beginning_added = False
        self._dropped_cr_count = 0
        self._dropped_after_eor_bytes = 0

    def take(self, piece: bytes) -> None:
        if self._eor is not None:
            self._take_after_eor(piece)
            return
        label_bytes = 0 if self._begun else self._begin(piece)
        eor = piece.find(b"%", 1 if label_bytes else 0)
        body = piece if eor < 0 else piece[:eor]
        self._check(body, label_bytes)
        if 0 <= eor < label_bytes:
            raise self._refusal(piece, eor, "a second % before the first EOB: remove it")
        self._emit(body, label_bytes)
        if eor >= 0:
            self._eor = _position(self._line, piece, eor)
            self._take_after_eor(piece[eor + 1 :])
        self._line += body.count(b"\n")

    def finish(self) -> Preparation:
        if not self._begun:
            raise ProgramError("the file is empty: there is nothing to send")
        if not self._block_count:
            raise ProgramError("the file holds no block: there is nothing for the control to execute")
        changes = self._changes()
        if self._eor is None and self._last != b"\n":
            self._put(b"\n")
        self._put(b"%")
        return Preparation(byte_count=self._byte_count, block_count=self._block_count, changes=changes)

    def _changes(self) -> tuple[str, ...]:
        changes = []
        if self._beginning_added:
            changes.append("% and LF put before the first block, or the control would skip it")
        if self._dropped_cr_count:
            changes.append(f"CR dropped before LF in {_counted(self._dropped_cr_count, 'block')}")
        if self._eor is None:
            if self._last != b"\n":
                changes.append("LF put after the last block, which had no EOB")
            changes.append("EOR (%) added at the end")
        if self._dropped_after_eor_bytes:
            dropped = _counted(self._dropped_after_eor_bytes, "byte")
            changes.append(f"{dropped} after the last % dropped (line ends, blanks, NUL or 1Ah)")
        return tuple(changes)

    def _begin(self, piece: bytes) -> int:
        """See to it that label skip ends before the first block; the length of the title it passes over."""
        self._begun = True
        if piece.startswith(b"%"):
            return piece.find(b"\n") + 1 or len(piece)
        if not piece.startswith((b"\n", b"\r\n")):
            self._beginning_added = True
            self._put(b"%\n")
        return 0

    def _check(self, body: bytes, label_bytes: int) -> None:
        """Refuse the first thing in `body` that must not reach the control as text."""
        found: list[tuple[int, str]] = []
        if (offset := first_outside(body, self._sendable)) is not None:
            found.append((offset, self._why_not_sendable(body[offset])))
        if body.count(b"\r") != body.count(b"\r\n") and (lone := _LONE_CR.search(body)):
            found.append((lone.start(), "CR without LF: end the blocks with LF or CR LF, " + _RAW_ADVICE))
        if (offset := find_g05(body, label_bytes)) is not None:
            found.append((offset, "after the block G05 the control reads binary: send the file with --raw"))
        if found:
            raise self._refusal(body, *min(found))
        if max(body.find(b"\n"), len(body) - body.rfind(b"\n") - 1) > MAX_BLOCK_BYTES:
            raise self._refusal(body, 0, "more than 1 MiB without an EOB: this is no NC program")

    def _why_not_sendable(self, byte: int) -> str:
        if byte in _PRINTABLE:
            return f"{name_of(byte)} has no EIA code: replace it, or send the program in ISO or ASCII"
        return f"{name_of(byte)} is no character of an NC program: remove it, {_RAW_ADVICE}"

    def _emit(self, body: bytes, label_bytes: int) -> None:
        text = body.replace(b"\r\n", b"\n")
        self._dropped_cr_count += len(body) - len(text)
        self._block_count += _count_blocks(body[label_bytes:])
        self._put(text)

    def _put(self, text: bytes) -> None:
        if text:
            self._last = text[-1:]
            self._byte_count += len(text)
            self._write(text if self._code is DataCode.ASCII else text.translate(self._table.to_code))

    def _take_after_eor(self, data: bytes) -> None:
        if data.strip(_AFTER_EOR):
            assert self._eor is not None
            why = "% ends the program for the control, in a comment too, and more text follows: remove it"
            raise _refusal_at(*self._eor, why)
        self._dropped_after_eor_bytes += len(data)

    def _refusal(self, piece: bytes, offset: int, why: str) -> ProgramError:
        return _refusal_at(*_position(self._line, piece, offset), why)


def _position(first_line: int, piece: bytes, offset: int) -> tuple[int, int]:
    """Line and column, from 1, of an offset in a piece that begins a line."""
    return first_line + piece.count(b"\n", 0, offset), offset - piece.rfind(b"\n", 0, offset)


def _refusal_at(line: int, column: int, why: str) -> ProgramError:
    return ProgramError(f"line {line}, column {column}: {why}", line=line, column=column)


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _count_blocks(lines: bytes) -> int:
    """How many of these lines hold more than blanks."""
    packed = lines.translate(None, _BLANKS)
    if b"\n\n" in packed or packed.startswith(b"\n"):
        return len(packed.split())
    return packed.count(b"\n") + (packed != b"" and not packed.endswith(b"\n"))


def find_g05(body: bytes, start: int) -> int | None:
    """The offset, from `start` on, of the G of the first block that is G05 alone: binary data follows it."""
    for match in _G05_END.finditer(body, start):
        before = body[body.rfind(b"\n", 0, match.start()) + 1 : match.start()]
        if _G05_BEGINNING.fullmatch(_COMMENT.sub(b"", before).translate(None, _BLANKS)):
            return match.start()
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class RawInspection:
    """A file to be sent untouched: how many bytes, and what the operator should know before they go out."""

    byte_count: int
    notes: tuple[str, ...]


def inspect_raw(read: Read, code: DataCode) -> RawInspection:
    """Read a file that is to be sent untouched and say what the control will make of it, in constant memory.

    Nothing is refused but an empty file. Of binary data nothing can be said.
    """
    scanner = TapeScanner(code)
    byte_count = taken_count = 0
    begins = b""
    while chunk := read(CHUNK_BYTES):
        begins = begins or chunk.lstrip(b"\x00")[:1]
        index = scanner.feed(chunk)
        taken_count += len(chunk) if index is None else index
        byte_count += len(chunk)
    if not byte_count:
        raise ProgramError("the file is empty: there is nothing to send")
    if code is DataCode.BINARY:
        return RawInspection(byte_count=byte_count, notes=())
    notes = []
    if scanner.label_skip:
        notes.append("no EOB: the control will skip all of it")
    elif begins not in {bytes((byte,)) for byte in EOR_CODES[code] + EOB_CODES[code]}:
        notes.append("neither % nor an EOB at the beginning: the control will skip the first block")
    if not scanner.ended:
        notes.append("no EOR: the control will wait for more")
    elif taken_count < byte_count:
        ignored = _counted(byte_count - taken_count, "byte")
        notes.append(
            f"EOR at byte {taken_count:,}: unless it lies in a G05 section, the control will ignore "
            f"the {ignored} after it"
        )
    return RawInspection(byte_count=byte_count, notes=tuple(notes))


class TapeScanner:
    """Finds the end of the data as a control does: label skip until the first EOB, then EOR ends it (8.2).

    The answer does not depend on how the data is cut. Binary data has no end that could be seen. The
    scanner does not know the records of a G05 section: an EOR code among them looks like the end.
    """

    def __init__(self, code: DataCode) -> None:
        self._eob = EOB_CODES[code]
        self._eor = re.compile(b"[" + re.escape(EOR_CODES[code]) + b"]") if EOR_CODES[code] else None
        self.label_skip = True
        self.ended = False

    def feed(self, data: bytes) -> int | None:
        """The index just after EOR in `data`, or None while it has not come.

        After the end it is 0: nothing of `data` belongs to the program.
        """
        if self.ended:
            return 0
        if self._eor is None:
            return None
        start = 0
        if self.label_skip:
            start = data.find(self._eob) + 1
            if not start:
                return None
            self.label_skip = False
        eor = self._eor.search(data, start)
        if eor is None:
            return None
        self.ended = True
        return eor.end()


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
