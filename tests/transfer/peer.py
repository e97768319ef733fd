"""A control played by the test: it says what the test says, and counts what it gets."""

from __future__ import annotations

import asyncio
import os
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from tapewire.engine import Nanos
from tapewire.transfer.api import receive, send
from tapewire.transfer.reports import Ready, Report, Result

DC1, DC2, DC3, DC4, NAK, SYN = b"\x11", b"\x12", b"\x93", b"\x14", b"\x95", b"\x96"

HOW: Final[dict[str, Any]] = {"line": "listen://127.0.0.1:0", "protocol": "fanuc-b", "baud": 230400}

IMPATIENT: Final = {"notice_time": "0.1"}

DEADLINE_S: Final = 30.0
QUIET_S: Final = 0.15
"""Nothing for so long: the host has stopped. Its last characters are on a line of this computer."""


class Peer:
    """One end of a TCP line. It reads all the time, as a control does."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self.got = bytearray()
        self.closed = asyncio.Event()
        self._news = asyncio.Event()
        self._reading = asyncio.ensure_future(self._read())

    async def _read(self) -> None:
        with suppress(OSError):
            while data := await self._reader.read(4096):
                self.got += data
                self._news.set()
        self.closed.set()
        self._news.set()

    def say(self, data: bytes) -> None:
        self._writer.write(data)

    async def read(self, count: int) -> None:
        """Until it has got `count` bytes in all."""
        async with asyncio.timeout(DEADLINE_S):
            while len(self.got) < count:
                assert not self.closed.is_set(), f"closed after {len(self.got)} bytes of {count}"
                self._news.clear()
                await self._news.wait()

    async def quiet(self) -> int:
        """Until nothing comes any more; how much it has got then."""
        async with asyncio.timeout(DEADLINE_S):
            while True:
                count = len(self.got)
                await asyncio.sleep(QUIET_S)
                if len(self.got) == count:
                    return count

    async def read_to_end(self) -> bytes:
        """Until the host has closed."""
        await asyncio.wait_for(self.closed.wait(), DEADLINE_S)
        return bytes(self.got)

    def hang_up(self) -> None:
        """Close in order: whatever was said arrives, then the end. It can still read."""
        self._writer.write_eof()

    async def vanish(self) -> None:
        """Close as a computer that crashes: the connection is reset. What had come to it counts."""
        transport = cast(asyncio.Transport, self._writer.transport)
        transport.pause_reading()
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with suppress(BlockingIOError), socket.socket(fileno=os.dup(connection.fileno())) as same:
            while data := same.recv(4096):
                self._reader.feed_data(data)
        self._reader.feed_eof()
        await self.close()

    async def close(self) -> None:
        self._writer.close()
        await asyncio.wait([self._reading])
        with suppress(OSError):
            await self._writer.wait_closed()


async def connect(line: str) -> Peer:
    host, _, port = line.removeprefix("listen://").rpartition(":")
    return Peer(*await asyncio.open_connection(host, int(port)))


@dataclass
class Job:
    """A job of ours, and who is at the other end of its line."""

    work: asyncio.Task[Result]
    peer: Peer
    stop: asyncio.Event
    reports: list[Report] = field(default_factory=list)

    def named(self, kind: type) -> list[Any]:
        return [report for report in self.reports if isinstance(report, kind)]

    async def result(self) -> Result:
        return await asyncio.wait_for(self.work, DEADLINE_S)


@asynccontextmanager
async def feeding(folder: Path, text: bytes, **how: Any) -> AsyncIterator[Job]:
    """`send` of `text` to a peer; `how` goes to `send`, whose patience at the end is short."""
    file = folder / "in.nc"
    file.write_bytes(text)
    how = {**HOW, **how, "settings": {**IMPATIENT, "closing_time": "0.3", **how.get("settings", {})}}
    async with working(lambda observe, stop: send(file, observer=observe, stop=stop, **how)) as job:
        yield job


@asynccontextmanager
async def receiving(file: Path, **how: Any) -> AsyncIterator[Job]:
    """`receive` into `file` from a peer; `how` goes to `receive`."""
    how = {**HOW, **how, "settings": {**IMPATIENT, **how.get("settings", {})}}
    async with working(lambda observe, stop: receive(file, observer=observe, stop=stop, **how)) as job:
        yield job


@asynccontextmanager
async def working(begin: Any) -> AsyncIterator[Job]:
    """Whatever `begin(observer, stop)` does on a line that it listens on."""
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    reports: list[Report] = []
    stop = asyncio.Event()

    def observe(report: Report, now: Nanos) -> None:
        reports.append(report)
        if isinstance(report, Ready):
            ready.set_result(report.line)

    work = asyncio.ensure_future(begin(observe, stop))
    job = Job(work, await connect(await asyncio.wait_for(ready, DEADLINE_S)), stop, reports)
    try:
        yield job
    finally:
        work.cancel()
        await asyncio.wait([work])
        await job.peer.close()
