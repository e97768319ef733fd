"""Watch a line, or stand between a host and a control, and tell in words what is said while it is said."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from tapewire.engine import SECOND, Closure, Nanos, Notice, Outcome, SignalsIn
from tapewire.errors import UsageError
from tapewire.line.alarm import Alarm
from tapewire.line.capture import ALL_ON, FAULTS, FROM_THIS_SIDE, Happening, Lines, Origin, Record, Side
from tapewire.line.capture_file import CaptureSettings, unix_offset
from tapewire.line.descriptor import DescriptorLine
from tapewire.line.driver import monotonic
from tapewire.line.open import LineAddress, TtyAddress, open_line
from tapewire.line.relay import Damaged, Relay
from tapewire.line.transport import Closed, Fault, LineItem
from tapewire.transfer.capturing import JobCapture
from tapewire.transfer.decoding.dialogue import Entry
from tapewire.transfer.decoding.recognise import Asked, Stream
from tapewire.transfer.reports import Observer, Ready, Result, nothing

__all__ = ["MonitorSettings", "OnEntry", "monitor"]

WINDOW_BAUD_PER_CHARACTER: Final = 1000
"""A monitor adds what it holds to what a host has in flight, so it allows itself little: 11 ms of line, and at least
LEAST_WINDOW characters."""

LEAST_WINDOW: Final = 4

TELL_EVERY_S: Final = 1.0
"""A run of program that goes on is told so often."""

_HAPPENING_OF: Final = {fault: happening for happening, fault in FAULTS.items()}

OnEntry = Callable[[Entry], None]


def _nobody(entry: Entry) -> None:
    del entry


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorSettings:
    """What is watched: the line to the host and that to the control, or one of them alone.

    `hears` says who speaks on a single line. Raises UsageError.
    """

    lines: tuple[LineAddress, ...]
    baud: int
    stopbits: int = 1
    data_bits: int = 8
    asked: Asked = field(default_factory=Asked)
    damaged: Damaged = Damaged.STOP
    hears: Side = Side.CONTROL
    capture: CaptureSettings | None = None
    observer: Observer = nothing
    on_entry: OnEntry = _nobody
    stop: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        if len(self.lines) not in (1, 2):
            raise UsageError("a monitor watches one line, or stands between two: the host's and the control's")

    def observed_by(self, observer: Observer, on_entry: OnEntry, stop: asyncio.Event) -> MonitorSettings:
        return replace(self, observer=observer, on_entry=on_entry, stop=stop)

    @property
    def sides(self) -> tuple[Side, ...]:
        """Who is at the other end of each line."""
        return (self.hears,) if len(self.lines) == 1 else (Side.HOST, Side.CONTROL)

    @property
    def window(self) -> int:
        """Characters of each direction that may be on their way from here."""
        return max(LEAST_WINDOW, self.baud // WINDOW_BAUD_PER_CHARACTER)


async def monitor(settings: MonitorSettings) -> Result:
    """Watch until a line is closed, or `stop` is set. Raises LineError, UsageError."""
    return await _Monitor(settings).run()


class _Monitor:
    def __init__(self, settings: MonitorSettings) -> None:
        self._settings = settings
        # The recording is that of the host's end of one cable, wherever we stand.
        self._origin = Origin(
            line=" and ".join(map(str, settings.lines)),
            baud=settings.baud,
            side=Side.HOST,
            protocol=settings.asked.protocol or "",
            settings=settings.asked.settings,
        )
        self._stream = Stream(replace(settings.asked, side=Side.HOST), self._origin, live=True)
        self._known = self._stream.known
        self._unix = unix_offset()
        self._seen = ALL_ON
        self._digest = hashlib.sha256()
        self._began = monotonic()

    async def run(self) -> Result:
        settings = self._settings
        self._capture = JobCapture(settings.capture, self._origin, settings.observer)
        failed = True
        try:
            lines = await self._open()
            if lines is None:
                return self._result(None, 0)
            try:
                relay = Relay(dict(zip(settings.sides, lines, strict=True)), settings.damaged, self._hear)
                self._introduce()
                await self._watch(relay)
            finally:
                for line in lines:
                    line.close(monotonic())
            self._conclude()
            failed = relay.ended is not None and relay.ended.closure is Closure.LOST
            return self._result(relay.ended, relay.characters)
        finally:
            await self._capture.close(failed=failed)

    async def _open(self) -> list[DescriptorLine] | None:
        """Both lines; None when the person has seen enough before they were there."""
        openings = [asyncio.ensure_future(self._open_one(address)) for address in self._settings.lines]
        stopping = asyncio.ensure_future(self._settings.stop.wait())
        try:
            both = asyncio.gather(*openings)
            either: list[asyncio.Future[Any]] = [both, stopping]
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            return list(both.result()) if both.done() else None
        finally:
            stopping.cancel()
            if not all(map(_is_open, openings)):
                await _undo(openings)

    async def _open_one(self, address: LineAddress) -> DescriptorLine:
        settings = self._settings
        return await open_line(
            address,
            baud=settings.baud,
            stopbits=settings.stopbits,
            data_bits=settings.data_bits,
            window=settings.window,
            # A wire brings characters at its own pace; what has none must not be taken faster than it could.
            paced_reception=not isinstance(address, TtyAddress),
            on_ready=lambda line: settings.observer(Ready(line=line), monotonic()),
            on_note=self._note,
        )

    def _introduce(self) -> None:
        if len(self._settings.lines) == 2:
            host, control = self._settings.lines
            self._note(
                f"between {host} (host) and {control} (control): after a stop request up to {self._settings.window}"
                " characters more than without this monitor may reach the control"
            )

    async def _watch(self, relay: Relay) -> None:
        watching = asyncio.ensure_future(_drive(relay))
        stopping = asyncio.ensure_future(self._settings.stop.wait())
        telling = asyncio.ensure_future(self._tell())
        try:
            await asyncio.wait([watching, stopping], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (watching, stopping, telling):
                task.cancel()
            await asyncio.wait([watching, stopping, telling])
        if not watching.cancelled():
            watching.result()

    async def _tell(self) -> None:
        while True:
            await asyncio.sleep(TELL_EVERY_S)
            self._entries(self._stream.dialogue.finish())
            self._capture.tell()

    def _hear(self, side: Side, item: LineItem, now: Nanos) -> None:
        record = self._record(side, item, now)
        if record is None:
            return
        self._digest.update(record.data)
        self._capture.put(record)
        self._entries(self._stream.feed(record))
        if self._known != self._stream.known and self._stream.known is not None:
            self._known = self._stream.known
            self._note(f"this is {self._known}")

    def _record(self, side: Side, item: LineItem, now: Nanos) -> Record | None:
        is_host = side is Side.HOST
        data, remark = b"", ""
        match item:
            case bytes():
                what, data = Happening.SENT if is_host else Happening.RECEIVED, item
            case Fault(fault=fault, byte=byte):
                what, data = _HAPPENING_OF[fault], b"" if byte is None else bytes([byte])
                remark = FROM_THIS_SIDE if is_host else ""
            case SignalsIn():
                lines = _lines(side, item, self._seen)
                if lines == self._seen:
                    return None
                what, self._seen = Happening.STATUS_CHANGE, lines
            case Closed(reason=reason):
                what, remark = Happening.COMPLETE, f"{side}: {reason}"
        return Record(at=now + self._unix, what=what, lines=self._seen, data=data, remark=remark)

    def _entries(self, entries: Iterable[Entry]) -> None:
        for entry in entries:
            self._settings.on_entry(entry)

    def _conclude(self) -> None:
        self._entries(self._stream.finish())
        for line in self._stream.dialogue.summary():
            self._note(line)

    def _note(self, text: str) -> None:
        self._settings.observer(Notice(text=text), monotonic())

    def _result(self, ended: Closed | None, characters: int) -> Result:
        outcome, reason = Outcome.CANCELLED, "ended here"
        if ended is not None:
            outcome = Outcome.COMPLETE if ended.closure is Closure.ORDERLY else Outcome.FAILED
            reason = ended.reason
        return Result(
            outcome=outcome,
            reason=reason,
            bytes=characters,
            bytes_handed=characters,
            sha256=self._digest.hexdigest(),
            seconds=(monotonic() - self._began) / SECOND,
            stops=0,
            utilisation=None,
        )


def _lines(side: Side, signals: SignalsIn, before: Lines) -> Lines:
    """What the host's end of one cable would show: what it drives, and what the control drives."""
    if side is Side.HOST:
        seen = {Lines.RTS: signals.cts, Lines.DTR: signals.dsr}
    else:
        seen = {Lines.CTS: signals.cts, Lines.DSR: signals.dsr, Lines.CD: signals.cd}
    for line, is_on in seen.items():
        before = before | line if is_on else before & ~line
    return before


def _is_open(opening: asyncio.Future[DescriptorLine]) -> bool:
    return opening.done() and not opening.cancelled() and opening.exception() is None


async def _undo(openings: Sequence[asyncio.Future[DescriptorLine]]) -> None:
    """Nobody waits for these any more: close what was opened all the same."""
    for opening in openings:
        opening.cancel()
    await asyncio.wait(openings)
    for opening in openings:
        if _is_open(opening):
            opening.result().close(monotonic())


async def _drive(relay: Relay) -> None:
    """Step when a line has something and when a deadline comes, until it has ended."""
    loop = asyncio.get_running_loop()
    woken = asyncio.Event()
    alarm = Alarm()
    watched: frozenset[int] = frozenset()
    loop.add_reader(alarm.fd, woken.set)
    try:
        while True:
            woken.clear()
            alarm.clear()
            now = monotonic()
            relay.step(now)
            if relay.ended is not None:
                return
            wanted = relay.watched
            for fd in watched - wanted:
                loop.remove_reader(fd)
            for fd in wanted - watched:
                loop.add_reader(fd, woken.set)
            watched = wanted
            deadline = relay.next_deadline()
            if deadline is not None:
                alarm.set(deadline)
            await woken.wait()
    finally:
        for fd in (*watched, alarm.fd):
            loop.remove_reader(fd)
        alarm.close()
