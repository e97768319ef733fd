"""A program from one punched-tape code into another, without losing anything, or not at all.

The text of both is the same, character by character. What may differ is stated in the result: the form of the EOB, and
blank tape between blocks, which is dropped; leader and trailer keep their length unless another is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.codes import EIA_SIGNS, NUL, DataCode, EiaSigns, first_outside, name_of, table_of
from tapewire.errors import ProgramError, UsageError
from tapewire.fanuc.punch import PunchReader
from tapewire.fanuc.tape import CHUNK_BYTES, MAX_BLOCK_BYTES, Read, Write
from tapewire.g05.sections import find_g05

__all__ = ["Conversion", "EobForm", "convert", "read_text"]


class EobForm(StrEnum):
    """How an EOB is punched in ISO and ASCII (0000#3, NCR); EIA has one code, CR, for it."""

    LF = "lf"
    LF_CR_CR = "lf-cr-cr"
    CR_LF = "cr-lf"
    """No FANUC punches it; files on other computers have it."""


_EOB_BYTES: Final = {EobForm.LF: b"\n", EobForm.LF_CR_CR: b"\n\r\r", EobForm.CR_LF: b"\r\n"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversion:
    """What became of it. `blocks` counts EOBs; leader and trailer are bytes of blank tape as written."""

    blocks: int
    leader: int
    trailer: int
    byte_count: int


def convert(
    read: Read,
    write: Write,
    source: DataCode,
    target: DataCode,
    *,
    eob: EobForm = EobForm.LF,
    feed: int | None = None,
    signs: EiaSigns = EIA_SIGNS,
    tell_text: Callable[[bytes], object] = lambda text: None,
) -> Conversion:
    """Write the program behind `read`, which is in `source`, in `target`, in constant memory.

    `feed` is the blank tape before and after it, None as it is. `tell_text` gets the text as ASCII with LF, for
    whoever wants to compare. Raises ProgramError with line and column at the first byte that is damaged or no
    character of `source`, that has no code in `target`, and at a block G05, behind which bytes are binary.
    """
    writer = _Writer(write, target, eob, signs)

    def on_text(text: bytes, first_line: int) -> None:
        tell_text(text)
        writer.put(text, first_line)

    blocks = _Blocks(on_text)
    blank = _blank_tape(read, source, signs, blocks, lambda leader: writer.feed(leader if feed is None else feed))
    blocks.finish()
    writer.feed(trailer := blank.trailer if feed is None else feed)
    return Conversion(
        blocks=blocks.blocks,
        leader=blank.leader if feed is None else feed,
        trailer=trailer,
        byte_count=writer.byte_count,
    )


def read_text(read: Read, code: DataCode, tell_text: Callable[[bytes], object], signs: EiaSigns = EIA_SIGNS) -> None:
    """Give the text of a program in `code`, whole blocks at a time. Raises ProgramError where `convert` would."""
    blocks = _Blocks(lambda text, first_line: tell_text(text))
    _blank_tape(read, code, signs, blocks, lambda leader: None)
    blocks.finish()


class _Blank:
    """Blank tape before and after a program."""

    def __init__(self) -> None:
        self.leader = 0
        self.trailer = 0
        self.begun = False

    def count(self, data: bytes) -> bool:
        """True for the piece in which the program begins."""
        inside = data.strip(bytes([NUL]))
        if not inside:
            if self.begun:
                self.trailer += len(data)
            else:
                self.leader += len(data)
            return False
        begins = not self.begun
        if begins:
            self.leader += len(data) - len(data.lstrip(bytes([NUL])))
        self.begun = True
        self.trailer = len(data) - len(data.rstrip(bytes([NUL])))
        return begins


def _blank_tape(
    read: Read, code: DataCode, signs: EiaSigns, blocks: _Blocks, on_begin: Callable[[int], object]
) -> _Blank:
    """Read all of it into `blocks`; how much blank tape is around it. `on_begin` gets the leader before any text."""
    blank = _Blank()
    reader = PunchReader(code, blocks.take, signs)
    offset = eobs = 0
    eob = table_of(code, signs).to_code[ord("\n")]
    while chunk := read(CHUNK_BYTES):
        if blank.count(chunk):
            on_begin(blank.leader)
        reader.feed(chunk)
        if reader.damage:
            damage = reader.damage[0]
            line = 1 + eobs + chunk.count(eob, 0, max(damage.first_offset - offset, 0))
            raise ProgramError(f"line {line}: {damage}", line=line)
        eobs += chunk.count(eob)
        offset += len(chunk)
    if not blank.begun:
        raise ProgramError("the file is empty: there is nothing to convert")
    for damage in reader.finish():
        raise ProgramError(f"line {1 + eobs}: {damage}", line=1 + eobs)
    return blank


class _Blocks:
    """Puts text together to whole blocks, each with its LF; the last may have none."""

    def __init__(self, on_text: Callable[[bytes, int], object]) -> None:
        self._on_text = on_text
        self._pending = bytearray()
        self.blocks = 0

    def take(self, text: bytes) -> None:
        self._pending += text
        if whole := self._pending.rfind(b"\n") + 1:
            self._give(bytes(self._pending[:whole]))
            del self._pending[:whole]
        if len(self._pending) > MAX_BLOCK_BYTES:
            raise ProgramError(
                f"line {self.blocks + 1}: more than 1 MiB without an EOB: this is no NC program", line=self.blocks + 1
            )

    def finish(self) -> None:
        if self._pending:
            self._give(bytes(self._pending))

    def _give(self, text: bytes) -> None:
        first_line = self.blocks + 1
        if (offset := find_g05(text, 0)) is not None:
            raise _refusal(
                first_line, text, offset, "after the block G05 come binary records, which have no other code"
            )
        self.blocks += text.count(b"\n")
        self._on_text(text, first_line)


class _Writer:
    def __init__(self, write: Write, code: DataCode, eob: EobForm, signs: EiaSigns) -> None:
        if code is DataCode.BINARY:
            raise UsageError("binary is no code of characters: convert to iso, eia or ascii")
        if code is DataCode.EIA and eob is not EobForm.LF:
            raise UsageError(f"EIA has one code for EOB: leave {eob} away")
        self._write = write
        self._code = code
        self._table = table_of(code, signs)
        self._eob_text = _EOB_BYTES[eob]
        self.byte_count = 0

    def feed(self, count: int) -> None:
        while count > 0:
            self._put(bytes(min(count, CHUNK_BYTES)))
            count -= CHUNK_BYTES

    def put(self, text: bytes, first_line: int) -> None:
        if (offset := first_outside(text, self._table.characters)) is not None:
            raise _refusal(first_line, text, offset, f"{name_of(text[offset])} has no {self._code.upper()} code")
        body = text if self._eob_text == b"\n" else text.replace(b"\n", self._eob_text)
        self._put(body.translate(self._table.to_code))

    def _put(self, data: bytes) -> None:
        self.byte_count += len(data)
        self._write(data)


def _refusal(first_line: int, text: bytes, offset: int, why: str) -> ProgramError:
    line, column = first_line + text.count(b"\n", 0, offset), offset - text.rfind(b"\n", 0, offset)
    return ProgramError(f"line {line}, column {column}: {why}", line=line, column=column)
