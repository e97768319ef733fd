"""How a protocol's programs are text on its line: what is done to a file before it is sent, and to what is received.

What a control reads wrongly is refused before anything is sent, and every change is told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from tapewire.codes import EOB_CODES, DataCode
from tapewire.fanuc import punch, tape

__all__ = ["FanucText", "Read", "TextReader", "TextRules", "Told", "Write"]

Read: TypeAlias = Callable[[int], bytes]
"""Gives at most so many bytes of the file, and b"" only at its end."""
Write: TypeAlias = Callable[[bytes], object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """What the operator is told of a program before it is sent: how it differs from the file, and what to know."""

    changes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class TextReader(Protocol):
    """Turns what a control sends into a text file with LF line ends, however it is cut."""

    def feed(self, data: bytes) -> None: ...

    def finish(self) -> Sequence[object]:
        """The end of it. What is wrong with it, each a sentence by `str`; nothing is repaired."""
        ...


class TextRules(Protocol):
    """The rules of one line."""

    @property
    def eob(self) -> bytes:
        """What ends a block in a program as the control takes it."""
        ...

    def prepare(self, read: Read, write: Write) -> Told:
        """Write the file behind `read` as it will be sent. Raises ProgramError at the first thing that cannot be."""
        ...

    def inspect_raw(self, read: Read) -> Told:
        """Of a file to be sent untouched. Raises ProgramError where the protocol cannot carry it."""
        ...

    def reader(self, write: Write) -> TextReader | None:
        """A reader that writes text; None where what comes is no text and is stored as it is."""
        ...


@dataclass(frozen=True, slots=True)
class FanucText:
    """The rules of FANUC controls (`fanuc/tape.py`)."""

    code: DataCode = DataCode.ASCII
    record_bytes: int | None = None
    """Of the records in a G05 section; None: found by their check bytes."""

    @property
    def eob(self) -> bytes:
        return EOB_CODES[self.code] or b"\n"

    def prepare(self, read: Read, write: Write) -> Told:
        preparation = tape.prepare(read, write, self.code, self.record_bytes)
        return Told(changes=preparation.changes, notes=preparation.notes)

    def inspect_raw(self, read: Read) -> Told:
        return Told(notes=tape.inspect_raw(read, self.code, self.record_bytes).notes)

    def reader(self, write: Write) -> TextReader | None:
        return None if self.code is DataCode.BINARY else punch.PunchReader(self.code, write)
