"""NC programs as text: how FANUC controls read them from a line and punch them (B-63322EN/01 chapter 8).

To the control, `prepare` turns a text file into exactly what will be sent, or refuses it with the line:

    O0001 CR LF G91 CR LF M30 CR LF   ->   % LF O0001 LF G91 LF M30 LF %

A control begins with label skip on: it passes over everything up to the first EOB, the leading `%` too.
From there the first `%` (EOR) ends the data, in a comment as well, and what follows is not read. So a
program begins with `%` or an EOB and holds no `%` until its last byte. `TapeScanner` is that rule as a
control sees it.

A G05 section is binary: nothing inside it is prepared, and CR and 25h are data there. `punch.py` reads what a
control punches out.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tapewire.codes import CR, DEL, EOB_CODES, EOR_CODES, TABLES, DataCode, first_outside, name_of
from tapewire.errors import ProgramError, UsageError
from tapewire.g05.sections import BinaryTally, BlockWatch, ExitFinder, Section, g05_block

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

_RAW_ADVICE: Final = "or send the file untouched with --raw"


@dataclass(frozen=True, slots=True, kw_only=True)
class Preparation:
    """What `prepare` wrote, and how it differs from the file.

    `byte_count` counts the bytes written. `block_count` counts the blocks that hold anything, without the
    title that label skip passes over. `changes` says for the operator what was changed; it is empty when
    the text went through as it was (the conversion to `code` is no change of the text). `notes` says what of
    it is binary.
    """

    byte_count: int
    block_count: int
    changes: tuple[str, ...]
    notes: tuple[str, ...] = ()


def prepare(read: Read, write: Write, code: DataCode, record_bytes: int | None = None) -> Preparation:
    """Write the text file behind `read` as a control can take it, in `code`, in constant memory.

    Raises ProgramError for a text that the control would take wrongly, at the first place where it would.
    What has been written until then is to be thrown away: call it once with a `write` that keeps nothing to
    know the result before anything is sent. Binary data is never prepared: UsageError.

    After a block G05 nothing is prepared until the exit record: the records, of `record_bytes` or of the length
    that their check bytes tell, go through as they are, and a program in which they are not sound is refused.
    """
    if code is DataCode.BINARY:
        raise UsageError("binary data cannot be prepared as text: send the file untouched with --raw")
    pieces = _Pieces(read)
    preparer = _Preparer(write, code, record_bytes)
    while (piece := pieces.text()) is not None:
        binary = preparer.take(piece)
        if binary is not None:
            pieces.give_back(preparer.take_section(binary, pieces.raw))
    return preparer.finish()


class _Pieces:
    """The file in pieces that end with LF (the last may not), so that no CR LF and no block is ever cut.

    A piece longer than a block may be, without any LF, is handed on as it is.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._pending = bytearray()

    def text(self) -> bytes | None:
        while chunk := self._read(CHUNK_BYTES):
            self._pending += chunk
            if len(self._pending) < CHUNK_BYTES:
                continue
            cut = self._pending.rfind(b"\n") + 1 or (len(self._pending) if len(self._pending) > MAX_BLOCK_BYTES else 0)
            if cut:
                return self._taken(cut)
        return self._taken(len(self._pending)) if self._pending else None

    def raw(self) -> bytes:
        """What comes next, cut anywhere; empty at the end."""
        return self._taken(len(self._pending)) if self._pending else self._read(CHUNK_BYTES)

    def give_back(self, data: bytes) -> None:
        self._pending[:0] = data

    def _taken(self, count: int) -> bytes:
        data = bytes(self._pending[:count])
        del self._pending[:count]
        return data


class _Preparer:
    def __init__(self, write: Write, code: DataCode, record_bytes: int | None) -> None:
        self._write = write
        self._code = code
        self._record_bytes = record_bytes
        self._binary = BinaryTally()
        self._table = TABLES[code]
        self._sendable = bytes(set(_TEXT) & {*self._table.characters, CR})
        self._line = 1
        self._begun = False
        self._g05 = (1, 1)
        self._eor: tuple[int, int] | None = None
        self._last = b""
        self._byte_count = 0
        self._block_count = 0
        self._beginning_added = False
        self._dropped_cr_count = 0
        self._dropped_after_eor_bytes = 0

    def take(self, piece: bytes) -> bytes | None:
        """What of the piece stands behind the EOB of a block G05: binary, for `take_section`. None without one."""
        if self._eor is not None:
            self._take_after_eor(piece)
            return None
        label_bytes = 0 if self._begun else self._begin(piece)
        eor = piece.find(b"%", 1 if label_bytes else 0)
        body = piece if eor < 0 else piece[:eor]
        binary = None
        if (g05 := g05_block(body, label_bytes)) is not None and body[g05[1] - 1 : g05[1]] == b"\n":
            body, binary, eor = body[: g05[1]], piece[g05[1] :], -1
            self._g05 = _position(self._line, body, g05[0])
        self._check(body, label_bytes)
        if 0 <= eor < label_bytes:
            raise self._refusal(piece, eor, "a second % before the first EOB: remove it")
        self._emit(body, label_bytes)
        if eor >= 0:
            self._eor = _position(self._line, piece, eor)
            self._take_after_eor(piece[eor + 1 :])
        self._line += body.count(b"\n")
        return binary

    def take_section(self, binary: bytes, read: Callable[[], bytes]) -> bytes:
        """Let a section pass that begins with `binary`; what was read behind its end."""
        section = Section(self._record_bytes)
        rest = b""
        try:
            while True:
                binary = binary or read()
                mine, rest = section.feed(binary) if binary else section.finish()
                self._line += mine.count(b"\n")
                self._pass(mine)
                if section.ended:
                    break
                binary = b""
        except ProgramError as error:
            why = f"after the block G05 the control reads binary, and {error}; mend it, {_RAW_ADVICE}"
            raise _refusal_at(*self._g05, why) from None
        self._binary.add(section)
        self._last = b"\n"
        return rest

    def finish(self) -> Preparation:
        if not self._begun:
            raise ProgramError("the file is empty: there is nothing to send")
        if not self._block_count:
            raise ProgramError("the file holds no block: there is nothing for the control to execute")
        changes = self._changes()
        if self._eor is None and self._last != b"\n":
            self._put(b"\n")
        self._put(b"%")
        return Preparation(
            byte_count=self._byte_count,
            block_count=self._block_count,
            changes=changes,
            notes=self._binary.notes(),
        )

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
        if (g05 := g05_block(body, label_bytes)) is not None and body[g05[1] - 1 : g05[1]] != b"\n":
            found.append(
                (g05[0], f"after the block G05 the control reads binary, and none follows: add it, {_RAW_ADVICE}")
            )
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

    def _pass(self, binary: bytes) -> None:
        if binary:
            self._byte_count += len(binary)
            self._write(binary)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RawInspection:
    """A file to be sent untouched: how many bytes, and what the operator should know before they go out."""

    byte_count: int
    notes: tuple[str, ...]


def inspect_raw(read: Read, code: DataCode, record_bytes: int | None = None) -> RawInspection:
    """Read a file that is to be sent untouched and say what the control will make of it, in constant memory.

    Nothing is refused but an empty file. Of binary data nothing can be said.
    """
    scanner = TapeScanner(code, record_bytes)
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

    The answer does not depend on how the data is cut. Binary data has no end that could be seen. In a G05 section whose
    records are of `record_bytes` no EOR is looked for. Without that number a section is not seen: in the special
    format it can hold no EOR, in the general format a byte of it may look like one.
    """

    def __init__(self, code: DataCode, record_bytes: int | None = None) -> None:
        self._eob = EOB_CODES[code]
        self._eor = re.compile(b"[" + re.escape(EOR_CODES[code]) + b"]") if EOR_CODES[code] else None
        self._to_ascii = TABLES[code].to_ascii
        self._record_bytes = record_bytes
        self._watch = BlockWatch()
        self._section: ExitFinder | None = None
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
        while True:
            eor = self._eor.search(data, start) if self._section is None else None
            border = self._section_border(data, start, eor.start() if eor else len(data))
            if border is None:
                self.ended = eor is not None
                return eor.end() if eor else None
            start = border

    def _section_border(self, data: bytes, start: int, end: int) -> int | None:
        """Where from `start` on a section begins, before `end`, or ends; None where neither is in sight."""
        if self._record_bytes is None:
            return None
        if self._section is None:
            found = self._watch.feed(data[start:end].translate(self._to_ascii))
            self._section = ExitFinder(self._record_bytes) if found is not None else None
        else:
            found = self._section.feed(data[start:])
            self._section = self._section if found is None else None
        return None if found is None else start + found
