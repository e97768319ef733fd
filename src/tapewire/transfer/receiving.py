"""Take what one control punches out and store it, whole or visibly not whole."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import os
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final

from tapewire.engine import Ended, Event, HostEngine, Nanos, Notice, Outcome
from tapewire.errors import UsageError
from tapewire.line.driver import monotonic
from tapewire.line.transport import Transport
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.protocols.text_rules import TextRules
from tapewire.transfer.files import check_name, open_part, why
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.numbered import numbered_host
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, Session

__all__ = ["receive_by_number", "receive_program"]

PAUSE_AT_BYTES: Final = 64 * 1024
"""So many bytes waiting for the disk pause the punch-out."""

RELEASE_AT_BYTES: Final = 16 * 1024
"""It goes on when the disk has caught up to this."""

GIVE_UP_AT_BYTES: Final = 1024 * 1024
"""A control that does not heed the pause ends the job here, before the memory does."""

DISK_LIMIT_S: Final = 30.0
"""So long after the end of a punch-out the disk may take to confirm it. Then the job fails, whatever it still does."""

NO_LINKS: Final = frozenset({errno.EPERM, errno.ENOTSUP, errno.ENOSYS})


async def receive_program(path: Path, job: JobSettings, *, raw: bool = False, force: bool = False) -> Result:
    """Store the next punch-out in `path`: text with LF line ends, without leader and trailer; untouched when `raw`.

    It grows in `path`.part and gets its name when it is complete; otherwise it stays there. An existing `path` is
    only replaced with `force`. Raises UsageError for a path that cannot be written, LineError for a line that cannot
    be opened.
    """
    if not job.protocol.punches_out:
        raise UsageError(f"{job.protocol.name} has no punch-out: nothing can be received by it")
    host = job.protocol.host(job.params)
    store = _Store(path, None if raw else job.protocol.text(job.params), force)
    return await _receive(host, job, lambda: store, lambda now: host.receive(store, now))


async def receive_by_number(
    folder: ProgramFolder, job: JobSettings, *, raw: bool = False, force: bool = False
) -> Result:
    """Store the next program one control sends in `folder`, by the number it sends it under.

    A program of that number that is there already is only replaced with `force`; otherwise the new one stands beside
    it. Raises UsageError for a protocol without program numbers, LineError.
    """
    host = numbered_host(job)
    places = _Places(folder, job, raw=raw, force=force)
    arm = partial(host.serve, None, shelf=places, policy=Policy.ONCE)
    return await _receive(host, job, lambda: places.store, arm)


async def _receive(
    host: HostEngine, job: JobSettings, stored: Callable[[], _Store | None], arm: Callable[[Nanos], None]
) -> Result:
    """Run the job; `stored` says where what comes in goes, once that is known."""
    backlog = _Backlog(host, stored)
    session = Session(
        job,
        host,
        tolerated=host.needs_stop_distance,
        give_up=host.abort,
        bytes_done=lambda: host.progress,
        application=backlog,
    )

    def begin(transport: Transport, now: Nanos) -> None:
        loop = asyncio.get_running_loop()
        backlog.on_progress = lambda: loop.call_soon_threadsafe(session.driver.wake)
        arm(now)

    try:
        try:
            ended = await session.run(begin)
            if (store := stored()) is not None:
                store.is_whole = ended.outcome is Outcome.COMPLETE
        finally:
            if (store := stored()) is not None:
                await store.finish()
        session.report_progress()
        if store is None:
            return _nothing_stored(ended, session)
        return store.result(_verdict(ended, store, backlog), session)
    finally:
        if (store := stored()) is not None:
            store.close()


def _nothing_stored(ended: Ended, session: Session) -> Result:
    return Result(
        outcome=ended.outcome,
        reason=ended.reason,
        bytes=0,
        bytes_handed=0,
        sha256=hashlib.sha256().hexdigest(),
        seconds=session.seconds,
        stops=session.stops,
        utilisation=None,
    )


class _Places:
    """Where a program goes, by its number. A Shelf of the host."""

    def __init__(self, folder: ProgramFolder, job: JobSettings, *, raw: bool, force: bool) -> None:
        self._folder = folder
        self._job = job
        self._text = None if raw else job.protocol.text(job.params)
        self._force = force
        self.store: _Store | None = None

    def place(self, number: str | None) -> _Store | None:
        try:
            path = self._folder.place_for(number, force=self._force)
            self.store = _Store(path, self._text, self._force)
        except UsageError as error:
            self._job.observer(Notice(text=str(error)), monotonic())
            return None
        self._job.observer(Notice(text=f"stored as {path}"), monotonic())
        return self.store


def _verdict(ended: Ended, store: _Store, backlog: _Backlog) -> tuple[Outcome, str]:
    """What the engine says of the line and what the store says of the text make one outcome."""
    if backlog.overflowed:
        return Outcome.FAILED, "the disk could not keep up and the control did not heed the pause"
    if store.error is not None:
        return Outcome.FAILED, f"{store.path}: cannot be stored ({why(store.error)})"
    missing = f"the last {store.waiting:,} of {store.taken:,} bytes that came are not stored"
    if store.is_abandoned:
        lost = missing if store.waiting else "what was written last may not survive a power failure"
        return Outcome.FAILED, f"{store.part}: the disk was not done after {DISK_LIMIT_S:g} s; {lost}"
    if store.waiting:
        return Outcome.FAILED, f"{store.part}: {missing}"
    if ended.outcome is Outcome.COMPLETE and store.damage:
        return Outcome.FAILED, "received to its end, but damaged: " + "; ".join(map(str, store.damage))
    return ended.outcome, ended.reason


class _Backlog:
    """Pauses the punch-out while too much waits for the disk. A Link's application."""

    def __init__(self, host: HostEngine, stored: Callable[[], _Store | None]) -> None:
        self._host = host
        self._stored = stored
        self.on_progress: Callable[[], object] = lambda: None
        self.overflowed = False

    def step(self, now: Nanos) -> None:
        store = self._stored()
        if store is None:
            return
        store.on_progress = self.on_progress
        waiting = store.waiting
        if (waiting >= GIVE_UP_AT_BYTES or store.error is not None) and not self.overflowed:
            self.overflowed = store.error is None
            self._host.abort(now)
        elif waiting >= PAUSE_AT_BYTES:
            self._host.hold_reception(now)
        elif waiting <= RELEASE_AT_BYTES:
            self._host.release(now)

    def next_deadline(self) -> Nanos | None:
        return None

    def next_event(self) -> Event | None:
        return None


class _Store:
    """A sink that a thread empties into a file, so that a slow disk never stops the line's loop."""

    def __init__(self, path: Path, text: TextRules | None, force: bool) -> None:
        check_name(path, force=force)
        self.path = path
        self.part = path.parent / (path.name + ".part")
        self.error: Exception | None = None
        self.damage: Sequence[object] = ()
        self.taken = 0
        """Bytes that came."""
        self.is_whole = False
        """The punch-out came to its proper end: it makes a file, even of no bytes."""
        self.is_abandoned = False
        self.on_progress: Callable[[], object] = lambda: None
        self._force = force
        self._file = open_part(self.part)
        self._reader = None if text is None else text.reader(self._put)
        self._written = 0
        self._is_done = False
        self._ending = threading.Lock()
        """Decides who closes the file: this thread while it is awaited, the storing one when it has been abandoned."""
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="tapewire-store", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Bytes received and not yet given to the file system."""
        return self.taken - self._written

    def write(self, data: bytes) -> None:
        self.taken += len(data)
        self._queue.put(data)

    def _work(self) -> None:
        try:
            while (data := self._queue.get()) is not None:
                self._reader.feed(data) if self._reader is not None else self._put(data)
                self._written += len(data)
                self.on_progress()
            self._finish_text()
        except Exception as error:
            self.error = error
        finally:
            with self._ending:
                self._is_done = True
                if self.is_abandoned:
                    self._file.close()
            self.on_progress()

    def _put(self, data: bytes) -> None:
        if self.is_abandoned:
            return
        if not self._file.byte_count:
            self._file.begin()
        self._file.write(data)

    async def finish(self) -> None:
        """Wait for the disk, at most DISK_LIMIT_S. One that hangs is abandoned: the thread then writes nothing more."""
        loop = asyncio.get_running_loop()
        finished = asyncio.Event()

        def tell() -> None:
            with suppress(RuntimeError):  # nobody waits any more, and the loop has ended
                loop.call_soon_threadsafe(finished.set)

        self.on_progress = tell
        self._queue.put(None)
        try:
            with suppress(TimeoutError):
                async with asyncio.timeout(DISK_LIMIT_S):
                    while not self._is_done:
                        await finished.wait()
                        finished.clear()
        finally:
            with self._ending:
                self.is_abandoned = not self._is_done
        if not self.is_abandoned:
            self._thread.join()

    def close(self) -> None:
        with self._ending:
            if not self.is_abandoned:
                self._file.close()

    def _finish_text(self) -> None:
        if self._reader is not None:
            self.damage = self._reader.finish()
        if self.is_whole and not self._file.byte_count:
            self._file.begin()
        self._file.sync()

    def result(self, verdict: tuple[Outcome, str], session: Session) -> Result:
        """Give the file its name when it is complete, and let go of it."""
        outcome, reason = verdict
        count, sha256 = self._file.stored
        try:
            if outcome is Outcome.COMPLETE:
                self._name()
            elif count:
                reason += f"; what came is in {self.part}"
        except OSError as error:
            outcome = Outcome.FAILED
            reason = f"{self.path}: cannot be named so ({error.strerror}); it is in {self.part}"
        finally:
            self.close()
        return Result(
            outcome=outcome,
            reason=reason,
            bytes=count,
            bytes_handed=count,
            sha256=sha256,
            seconds=session.seconds,
            stops=session.stops,
            utilisation=None,
        )

    def _name(self) -> None:
        """Without force the name is linked, which fails when it has come into being meanwhile. A disk without links
        (FAT) leaves a moment in which it can.
        """
        if self._force:
            self.part.replace(self.path)
            return
        try:
            self.path.hardlink_to(self.part)
        except OSError as error:
            if error.errno not in NO_LINKS:
                raise
            if os.path.lexists(self.path):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
            self.part.rename(self.path)
        else:
            self.part.unlink()
