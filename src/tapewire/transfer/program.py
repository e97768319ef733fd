"""A program as it goes out: read once, prepared, and kept apart from the file, which may change meanwhile."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Final

from tapewire.errors import ProgramError, UsageError
from tapewire.protocols.text_rules import FanucText, TextRules

__all__ = ["Program"]

IN_MEMORY_BYTES: Final = 16 << 20
"""A larger program waits in a temporary file."""

CHUNK_BYTES: Final = 1 << 16


class Program:
    """What will be sent, byte for byte. `changes` says how it differs from the file, `notes` what to know about it."""

    def __init__(self, name: str, spool: IO[bytes], changes: tuple[str, ...], notes: tuple[str, ...]) -> None:
        self.name = name
        self.changes = changes
        self.notes = notes
        self._spool = spool
        self.byte_count = spool.seek(0, 2)

    @classmethod
    def from_file(cls, path: str | Path, text: TextRules | None = None, *, raw: bool = False) -> Program:
        """The program in the file `path`, prepared by the rules of `text`; untouched when `raw`.

        Without `text` it is for a FANUC control that reads ASCII.

        Raises ProgramError when it cannot be sent as it is, UsageError when the file cannot be read or kept.
        """
        try:
            with open(path, "rb") as file:
                return cls._spooled(Path(path).name, file, text or FanucText(), raw)
        except ProgramError as error:
            raise ProgramError(f"{path}: {error}", line=error.line, column=error.column) from None
        except UsageError:
            raise
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise UsageError(f"{path}: cannot be read ({reason})") from None

    @classmethod
    def _spooled(cls, name: str, file: IO[bytes], text: TextRules, raw: bool) -> Program:
        spool: IO[bytes] = tempfile.SpooledTemporaryFile(IN_MEMORY_BYTES)  # noqa: SIM115 - the program owns it
        try:
            keep = _keeping(spool)
            if raw:
                while chunk := file.read(CHUNK_BYTES):
                    keep(chunk)
                spool.seek(0)
                told = text.inspect_raw(spool.read)
            else:
                told = text.prepare(file.read, keep)
            return cls(name, spool, told.changes, told.notes)
        except BaseException:
            spool.close()
            raise

    def rewind(self) -> None:
        """Begin again at the first byte."""
        self._spool.seek(0)

    def read(self, size: int) -> bytes:
        """The next bytes, at most `size`: the source a host engine sends from."""
        return self._spool.read(size)

    def sha256(self, count: int | None = None) -> str:
        """Of the first `count` bytes; of all of them without it."""
        left = self.byte_count if count is None else count
        digest = hashlib.sha256()
        self.rewind()
        while left and (chunk := self._spool.read(min(left, CHUNK_BYTES))):
            digest.update(chunk)
            left -= len(chunk)
        return digest.hexdigest()

    def close(self) -> None:
        self._spool.close()


def _keeping(spool: IO[bytes]) -> Callable[[bytes], int]:
    """Writes to `spool`, and knows where that is. Raises UsageError when there is no room."""

    def keep(data: bytes) -> int:
        try:
            return spool.write(data)
        except OSError as error:
            raise UsageError(
                f"{tempfile.gettempdir()}: a program this long is kept there while it is sent, and cannot be"
                f" ({error.strerror}); make room, or name another folder in TMPDIR"
            ) from None

    return keep
