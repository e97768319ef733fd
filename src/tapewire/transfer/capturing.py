"""The capture of a job: opened before its line, told of when it fails, and kept apart when the job did."""

from __future__ import annotations

import asyncio

from tapewire.engine import Notice
from tapewire.line.captures.file import CaptureFile, CaptureSettings
from tapewire.line.captures.records import Origin, Record
from tapewire.line.driver import monotonic
from tapewire.line.transport import Transport
from tapewire.transfer.reports import Observer

__all__ = ["JobCapture"]


class JobCapture:
    """Does nothing without `settings`. What goes wrong with the disk is told to `observer` and stops nothing.

    Raises UsageError when no capture can be written there.
    """

    def __init__(self, settings: CaptureSettings | None, origin: Origin, observer: Observer) -> None:
        self._file = None if settings is None else CaptureFile(settings, origin)
        self._observer = observer

    def tap(self, line: Transport) -> Transport:
        """`line`, put on record."""
        return line if self._file is None else self._file.tap(line)

    def put(self, record: Record) -> None:
        """One more record, from whoever taps no line of its own."""
        if self._file is not None:
            self._file.put(record)

    def tell(self) -> None:
        """Report what has gone wrong since the last call."""
        for trouble in () if self._file is None else self._file.troubles():
            self._observer(Notice(text=trouble), monotonic())

    async def close(self, *, failed: bool) -> None:
        """Let what waits be written; a job that failed gets a copy of its own."""
        if self._file is not None:
            kept = await asyncio.to_thread(self._file.close, keep=failed)
            self.tell()
            if kept is not None:
                self._observer(Notice(text=f"capture of this failed job: {kept}"), monotonic())
