"""Files that a job fills: checked before the line is opened, touched only once there is something to store."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from tapewire.errors import UsageError

__all__ = ["StoredFile"]


class StoredFile:
    """A file that will be written from its beginning. What it held stays until `begin`.

    Nothing waits in a buffer of this process: `byte_count` and `sha256` are those of what the system took, also when
    the disk is full. Raises UsageError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.byte_count = 0
        self._digest = hashlib.sha256()
        try:
            self._is_new = not os.path.lexists(path)
            self._file = open(path, "ab", buffering=0)  # noqa: SIM115 - closed by close
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise UsageError(f"{path}: cannot be written ({reason})") from None

    def begin(self) -> None:
        """Forget what the file held. Raises OSError."""
        self._is_new = False
        if self.path.is_file():
            self._file.truncate(0)

    def write(self, data: bytes) -> None:
        """Raises OSError."""
        rest = memoryview(data)
        while rest:
            count = self._file.write(rest) or 0
            self._digest.update(rest[:count])
            self.byte_count += count
            rest = rest[count:]

    @property
    def sha256(self) -> str:
        return self._digest.hexdigest()

    def sync(self) -> None:
        """Wait until the disk has it. Raises OSError."""
        if self.path.is_file():
            os.fsync(self._file.fileno())

    @property
    def closed(self) -> bool:
        return self._file.closed

    def close(self) -> None:
        """A file that came into being for nothing goes away again."""
        self._file.close()
        if self._is_new:
            self.path.unlink(missing_ok=True)
