"""Files that a job fills: checked before the line is opened, touched only once there is something to store."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import stat
import threading
from pathlib import Path
from typing import Final

from tapewire.errors import UsageError

__all__ = ["StoredFile", "check_name", "open_part", "open_save", "why"]

_FLAGS: Final = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
"""Without O_NONBLOCK a FIFO that nobody reads would hold the command for ever."""


def check_name(path: Path, *, force: bool) -> None:
    """Raises UsageError for a name that a file could not be given when it is complete. `force` replaces a file or a
    link, and never a device: /dev/null would be an ordinary file from then on.
    """
    if os.path.isdir(path):  # which a name that is too long does not trouble
        raise UsageError(f"{path} is a folder: name a file in it")
    if not os.path.lexists(path):
        return
    if not force:
        raise UsageError(f"{path} exists; name another file, or say --force to replace it")
    mode = path.lstat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
        raise UsageError(f"{path} is no file and is not replaced: name another")


def open_part(path: Path) -> StoredFile:
    """For what is to get its name later: a regular file and no link. Raises UsageError."""
    return StoredFile(path, os.O_NOFOLLOW)


def open_save(path: Path) -> StoredFile:
    """For what a person named: a regular file, a link to one, or a device such as /dev/null. Raises UsageError."""
    return StoredFile(path, 0)


def why(error: Exception) -> str:
    """An error in words."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return "out of memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"


class StoredFile:
    """A file that will be written from its beginning, by this job alone. What it held stays until `begin`.

    Nothing waits in a buffer of this process: `byte_count` and `sha256` are those of what the system took, also when
    the disk is full. Raises UsageError when the file cannot be written, or another job is writing it.
    """

    def __init__(self, path: Path, flags: int) -> None:
        self.path = path
        self.byte_count = 0
        self._digest = hashlib.sha256()
        self._counting = threading.Lock()
        self._is_new = not os.path.lexists(path)
        self._file = os.fdopen(_open_alone(path, flags), "ab", buffering=0)
        self._is_regular = stat.S_ISREG(os.fstat(self._file.fileno()).st_mode)

    def begin(self) -> None:
        """Forget what the file held. Raises OSError."""
        self._is_new = False
        if self._is_regular:
            self._file.truncate(0)

    def write(self, data: bytes) -> None:
        """Raises OSError."""
        rest = memoryview(data)
        while rest:
            count = self._file.write(rest) or 0
            with self._counting:
                self._digest.update(rest[:count])
                self.byte_count += count
            rest = rest[count:]

    @property
    def stored(self) -> tuple[int, str]:
        """How many bytes the system took, and their SHA-256, also while another thread writes."""
        with self._counting:
            return self.byte_count, self._digest.hexdigest()

    def sync(self) -> None:
        """Wait until the disk has it. Raises OSError."""
        if self._is_regular:
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """A file that came into being for nothing goes away again, while it still is ours alone."""
        if self._is_new:
            self._is_new = False
            self.path.unlink(missing_ok=True)
        self._file.close()


def _open_alone(path: Path, flags: int) -> int:
    try:
        while True:
            fd = os.open(path, _FLAGS | flags, 0o666)
            try:
                if _is_ours(fd, path, links=not flags & os.O_NOFOLLOW):
                    return fd
            except BaseException:
                os.close(fd)
                raise
            os.close(fd)
    except UsageError:
        raise
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: {_refusal(path, error)}") from None


def _is_ours(fd: int, path: Path, *, links: bool) -> bool:
    """Locked, and still the file of this name: another job may just have given it another. Raises UsageError."""
    here = os.fstat(fd)
    if not stat.S_ISREG(here.st_mode):
        if links and stat.S_ISCHR(here.st_mode):
            os.set_blocking(fd, True)
            return True
        raise UsageError(f"{path}: is no regular file and cannot be written; remove it, or name another")
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(f"{path}: another job is writing this file; wait for its end, or name another") from None
    try:
        there = os.stat(path, follow_symlinks=links)
    except FileNotFoundError:
        return False
    return (here.st_dev, here.st_ino) == (there.st_dev, there.st_ino)


def _refusal(path: Path, error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
        return f"cannot be written: there is no folder {path.parent}"
    if isinstance(error, OSError) and error.errno in (errno.ENXIO, errno.ELOOP):
        return "is no regular file and cannot be written; remove it, or name another"
    return f"cannot be written ({why(error) if isinstance(error, OSError) else error})"
