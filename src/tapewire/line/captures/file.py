"""Captures on disk: a ring of a stated size that goes on from job to job, and a copy for every job that failed.

The ring is two files. FILE grows to half the size, then it becomes FILE.older.pcapng, whose own predecessor goes, and
a new FILE begins. Both are always whole captures: what is written is never touched again, so a power failure costs the
last blocks and nothing before them. Each job begins a section of its own.

A thread of its own writes. Where the disk is slow or full, records are dropped, counted, told, and marked in the file
once it takes something again; the line never waits.
"""

from __future__ import annotations

import errno
import fcntl
import os
import queue
import stat
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import BinaryIO, Final

from tapewire.engine import SECOND, Nanos
from tapewire.errors import UsageError
from tapewire.line.captures.reader import SECTION_MARK
from tapewire.line.captures.records import Encoder, Happening, Origin, Record
from tapewire.line.captures.tap import CapturedLine
from tapewire.line.transport import Transport

__all__ = ["DEFAULT_SIZE", "MEGABYTE", "CaptureFile", "CaptureSettings", "older_of", "unix_offset"]

MEGABYTE: Final = 1_000_000

DEFAULT_SIZE: Final = 100 * MEGABYTE
"""At least an hour of a line that never pauses. A record takes about 60 bytes besides its characters: 9600 baud, two
characters at a time, make 26 kB a second, and 86400 baud in larger pieces 15 kB."""

LEAST_SIZE: Final = 64 * 1024

MAX_WAITING: Final = 100_000
"""Records that may wait for the disk: half a minute of the fastest line, and about 30 MB."""

BATCH_S: Final = 0.02
"""Records are written together that come within this time: at most fifty writes a second, whatever the line does."""

CLOSE_LIMIT_S: Final = 2.0
"""A disk that hangs does not keep a job from ending."""

KEPT_FAILED: Final = 16
"""Captures of failed jobs kept beside a ring; the oldest goes when one more comes."""

COPY_SIZE: Final = 1 << 20

_FLAGS: Final = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
"""Without O_NONBLOCK a FIFO that nobody reads would hold the command for ever."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CaptureSettings:
    """Where captures go. `size` is what FILE and its older half may have together, in bytes. Raises UsageError."""

    path: Path
    size: int = DEFAULT_SIZE

    def __post_init__(self) -> None:
        if self.size < LEAST_SIZE:
            raise UsageError(f"a capture of {self.size} bytes is too small: give at least {LEAST_SIZE}")


def older_of(path: Path) -> Path:
    """Where the older half of the ring at `path` is."""
    return path.with_name(f"{path.name.removesuffix('.pcapng')}.older.pcapng")


class CaptureFile:
    """One job's part in the ring at `settings.path`. Raises UsageError when the file is none, or cannot be written."""

    def __init__(self, settings: CaptureSettings, origin: Origin) -> None:
        # Renaming must move the file and not a link to it.
        self.path = settings.path.resolve()
        self._half = settings.size // 2
        self._encoder = Encoder()
        self._header = self._encoder.header(origin, program=_program())
        self._troubles: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._queue: queue.SimpleQueue[Record | None] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._dropped = 0
        """Records that found no room to wait."""
        self._unwritten = 0
        """Records that the disk did not take."""
        self._marked = 0
        self._is_used = self._is_slow = self._is_failing = False
        self._turns = 0
        self._file: BinaryIO
        self._size = 0
        self._began = self._open()
        self._thread = threading.Thread(target=self._work, name="tapewire-capture", daemon=True)
        self._thread.start()

    def tap(self, line: Transport) -> CapturedLine:
        """`line`, put on record from now on. Its moments are those of the monotonic clock."""
        return CapturedLine(line, self.put, unix_offset())

    def _open(self) -> int:
        """Make the file ready for records; where those of this job begin."""
        try:
            self._file = _open_alone(self.path)
            try:
                self._size = _end_of_blocks(self._file)
                if self._size > self._half or self._size < os.fstat(self._file.fileno()).st_size:
                    self._turn_over()
                    self._turns = 0
                began = self._size
                self._write(self._header)
            except BaseException:
                self._file.close()
                raise
        except BlockingIOError:
            raise UsageError(f"{self.path}: another job writes this capture; give each line its own") from None
        except OSError as error:
            raise UsageError(f"{self.path}: no capture can be written there ({error.strerror})") from error
        return began

    def put(self, record: Record) -> None:
        """Returns at once. What the disk is too slow for is dropped and counted."""
        self._is_used = True
        if self._queue.qsize() < MAX_WAITING:
            self._queue.put(record)
        else:
            self._dropped += 1

    @property
    def lost(self) -> int:
        """Records that are missing from the capture."""
        return self._dropped + self._unwritten

    def troubles(self) -> list[str]:
        """What went wrong with the capture since the last call, for the operator."""
        if self._dropped and not self._is_slow:
            self._is_slow = True
            self._troubles.put(f"capture: the disk is too slow for {self.path}; records are missing")
        said: list[str] = []
        while not self._troubles.empty():
            said.append(self._troubles.get())
        return said

    def close(self, *, keep: bool) -> Path | None:
        """Write what waits. With `keep` this job gets a capture of its own, whose path is returned; blocks for 2 s at
        most, but for that copy.
        """
        self._queue.put(None)
        self._closing.set()
        self._thread.join(CLOSE_LIMIT_S)
        if self._thread.is_alive():
            self._troubles.put(f"capture: the disk is not done with {self.path}; its end is missing")
            return None
        try:
            return self._keep() if keep and self._is_used else None
        except OSError as error:
            self._troubles.put(f"capture: no copy of this failed job could be made ({error.strerror})")
            return None
        finally:
            if self.lost:
                self._troubles.put(f"capture: {self.lost} records are missing from {self.path}")
            self._file.close()

    # In the thread of the writer.

    def _work(self) -> None:
        open_ = True
        while open_:
            records, open_ = self._batch()
            try:
                self._store(records)
                self._is_failing = False
            except OSError as error:
                self._unwritten += len(records)
                if not self._is_failing:
                    self._is_failing = True
                    self._troubles.put(
                        f"capture: {self.path} cannot be written ({error.strerror}); the transfer goes on without it"
                    )
            if open_:
                self._closing.wait(BATCH_S)

    def _batch(self) -> tuple[list[Record], bool]:
        """All that waits, at least one; and whether more can come."""
        records: list[Record] = []
        record = self._queue.get()
        while record is not None:
            records.append(record)
            if self._queue.empty():
                return records, True
            record = self._queue.get()
        return records, False

    def _store(self, records: list[Record]) -> None:
        blocks = bytearray()
        if records and (lost := self.lost) > self._marked:
            mark = Record(at=records[0].at, what=Happening.DATA_LOST, remark=f"{lost - self._marked} records lost")
            blocks += self._encoder.record(mark)
        for record in records:
            block = self._encoder.record(record)
            if self._size + len(blocks) + len(block) > self._half:
                self._write(blocks)
                blocks.clear()
                self._turn_over()
                self._write(self._header)
            blocks += block
        self._write(blocks)
        if records:
            self._marked = max(self._marked, lost)

    def _write(self, blocks: bytes | bytearray) -> None:
        """All of `blocks` or none of it: half a block would spoil all that comes behind."""
        left = memoryview(blocks)
        try:
            while left:
                left = left[os.write(self._file.fileno(), left) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), self._size)
            raise
        finally:
            left.release()
        self._size += len(blocks)

    def _turn_over(self) -> None:
        """FILE becomes the older half, and a new one begins."""
        with suppress(FileNotFoundError):  # half done the last time
            os.replace(self.path, older_of(self.path))
        new = _open_alone(self.path)
        self._file.close()
        self._file, self._size = new, 0
        self._turns += 1

    # At the end of a job that failed.

    def _keep(self) -> Path:
        """A copy of this job alone, as far as the ring still has it."""
        kept = _name_of_failed(self.path)
        with kept.open("xb") as copy:
            if self._turns:
                with older_of(self.path).open("rb") as older:
                    _copy(older, self._began if self._turns == 1 else 0, copy)
            _copy(self._file, 0 if self._turns else self._began, copy)
        if self._turns > 1:
            self._troubles.put(
                "capture: the beginning of this job is not in the ring any more; --capture-size makes it larger"
            )
        self._let_go()
        return kept

    def _let_go(self) -> None:
        captures = sorted(self.path.parent.glob(f"{_glob_safe(_stem(self.path))}.failed-*.pcapng"))
        for oldest in captures[:-KEPT_FAILED]:
            oldest.unlink()
            self._troubles.put(f"capture: {KEPT_FAILED} captures of failed jobs are kept; {oldest.name} was removed")


def unix_offset() -> Nanos:
    """What the monotonic clock must be moved by to be Unix time. Taken once, so that no correction of the clock bends
    a capture."""
    return time.time_ns() - time.monotonic_ns()


def _program() -> str:
    try:
        return f"Tapewire {version('tapewire')}"
    except PackageNotFoundError:
        return "Tapewire"


def _open_alone(path: Path) -> BinaryIO:
    """Raises OSError; BlockingIOError where another job has it."""
    file = os.fdopen(os.open(path, _FLAGS, 0o666), "r+b", buffering=0)
    try:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is no ordinary file")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        file.close()
        raise
    return file


def _end_of_blocks(file: BinaryIO) -> int:
    """How much of an existing file is whole blocks as we write them. Raises OSError for a file that is no capture."""
    size = os.fstat(file.fileno()).st_size
    at = 0
    while at < size:
        file.seek(at)
        head = file.read(8)
        if not at and head[:4] != SECTION_MARK:
            raise OSError(errno.EEXIST, "a file is there that is no capture; give another name")
        length = int.from_bytes(head[4:], "little")
        if len(head) < 8 or length < 12 or length % 4 or at + length > size:
            break
        at += length
    return at


def _copy(source: BinaryIO, offset: int, target: BinaryIO) -> None:
    source.seek(offset)
    while data := source.read(COPY_SIZE):
        target.write(data)


def _stem(path: Path) -> str:
    return path.name.removesuffix(".pcapng")


def _glob_safe(name: str) -> str:
    return "".join(f"[{character}]" if character in "*?[" else character for character in name)


def _name_of_failed(path: Path) -> Path:
    """In the order of time when sorted by name."""
    seconds, rest = divmod(time.time_ns(), SECOND)
    moment = time.strftime("%Y%m%dT%H%M%S", time.gmtime(seconds))
    return path.with_name(f"{_stem(path)}.failed-{moment}.{rest // 1000:06}Z.pcapng")
