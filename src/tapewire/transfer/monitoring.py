"""Watch a line, or stand between a host and a control, and tell in words what is said while it is said."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

from tapewire.engine import SECOND, Closure, Nanos, Notice, Outcome, SignalsIn
from tapewire.errors import LineError, UsageError
from tapewire.line.alarm import Alarm
from tapewire.line.captures.file import CaptureSettings, unix_offset
from tapewire.line.captures.records import ALL_ON, FAULTS, FROM_THIS_SIDE, Happening, Lines, Origin, Record, Side
from tapewire.line.descriptor import BAUD_LIMITS, DescriptorLine
from tapewire.line.driver import monotonic
from tapewire.line.open import LineAddress, TtyAddress, open_line
from tapewire.line.pacing import default_window
from tapewire.line.relay import Damaged, Relay
from tapewire.line.transport import Closed, Fault, LineItem
from tapewire.transfer.capturing import JobCapture
from tapewire.transfer.decoding.entry import Entry
from tapewire.transfer.decoding.recognise import Asked, Stream
from tapewire.transfer.reopening import Losses, WhenLost, open_when_back
from tapewire.transfer.reports import Observer, Ready, Result, nothing

__all__ = ["MonitorSettings", "OnEntry", "monitor"]

WINDOW_BAUD_PER_CHARACTER: Final = 1000
"""What a monitor has in flight comes on top of what a host has, so it allows itself little where it can: 11 ms of line,
and at least LEAST_WINDOW characters. Towards a serial port that would not do: what comes in from another wire cannot
wait, and a gap on the way out is never made up for, so there it is the window of every line."""

LEAST_WINDOW: Final = 4

CATCH_UP: Final = 2
"""A line that is no wire is passed on to so many times faster than its rate. The host keeps to the rate; what this
computer was late with would otherwise wait here until the host pauses, and come on top of every stop."""

ANY_CONTROL: Final = 512
"""A window for a control whose protocol is not asked: that of protocol B."""

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
    when_lost: WhenLost = WhenLost.END
    """Of either line: both are closed then, and with WAIT opened again when both are there."""
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

    def window(self, address: LineAddress) -> int:
        """Characters that may be on their way from here on the line at `address`."""
        if isinstance(address, TtyAddress):
            return default_window(self.baud, ANY_CONTROL)
        return max(LEAST_WINDOW, self.baud // WINDOW_BAUD_PER_CHARACTER)

    def pace(self, address: LineAddress) -> int:
        """Bits a second at which the line at `address` is passed on to."""
        return self.baud if isinstance(address, TtyAddress) else min(CATCH_UP * self.baud, BAUD_LIMITS[1])

    @property
    def hold(self) -> int:
        """Characters that may wait here before a line without control lines is not read."""
        return max(LEAST_WINDOW, self.baud // WINDOW_BAUD_PER_CHARACTER // 2)


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
        self._listen_anew()
        self._characters = 0
        self._was_open = False
        self._unix = unix_offset()
        self._seen = ALL_ON
        self._digest = hashlib.sha256()
        self._began = monotonic()

    async def run(self) -> Result:
        settings = self._settings
        self._capture = JobCapture(settings.capture, self._origin, settings.observer)
        failed = True
        try:
            ended, losses = await self._watch_once(), Losses()
            while ended is not None and settings.when_lost is WhenLost.WAIT and not settings.stop.is_set():
                if losses.is_news(ended.reason, monotonic()):
                    self._note(f"{ended.reason}; opened again when it is back")
                self._listen_anew()
                ended = await self._watch_once()
            failed = ended is not None and ended.closure is Closure.LOST
            return self._result(ended, self._characters)
        finally:
            await self._capture.close(failed=failed)

    def _listen_anew(self) -> None:
        """What was said before a line was gone explains nothing of what is said on it afterwards."""
        self._stream = Stream(replace(self._settings.asked, side=Side.HOST), self._origin, live=True)
        self._known = self._stream.known

    async def _watch_once(self) -> Closed | None:
        """Open, watch, close. How a line ended; None when the person has seen enough."""
        settings = self._settings
        lines = await self._open()
        if lines is None:
            return None
        self._was_open = True
        try:
            relay = Relay(dict(zip(settings.sides, lines, strict=True)), settings.damaged, settings.hold, self._hear)
            self._introduce()
            await self._watch(relay)
        finally:
            for line in lines:
                line.close(monotonic())
        self._characters += relay.characters
        self._conclude(relay)
        return relay.ended

    async def _open(self) -> list[DescriptorLine] | None:
        """Both lines; None when the person has seen enough before they were there."""
        openings = [asyncio.ensure_future(self._open_one(address)) for address in self._settings.lines]
        stopping = asyncio.ensure_future(self._settings.stop.wait())
        both = asyncio.gather(*openings)
        try:
            either: list[asyncio.Future[Any]] = [both, stopping]
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            return list(both.result()) if both.done() else None
        finally:
            stopping.cancel()
            if not all(map(_is_open, openings)):
                await _undo(openings)
                with suppress(asyncio.CancelledError, LineError):
                    both.result()  # an error of the second line, or our own cancelling, is nobody's news

    async def _open_one(self, address: LineAddress) -> DescriptorLine:
        if self._was_open:
            return await open_when_back(lambda: self._open_now(address), self._note)
        return await self._open_now(address)

    async def _open_now(self, address: LineAddress) -> DescriptorLine:
        settings = self._settings
        return await open_line(
            address,
            baud=settings.pace(address),
            stopbits=settings.stopbits,
            data_bits=settings.data_bits,
            window=settings.window(address),
            on_ready=lambda line: settings.observer(Ready(line=line), monotonic()),
            on_note=self._note,
        )

    def _introduce(self) -> None:
        if len(self._settings.lines) == 2:
            host, control = self._settings.lines
            more = self._settings.window(control) + self._settings.hold
            self._note(
                f"between {host} (host) and {control} (control): after a stop request {more} characters more than"
                " without this monitor may reach the control, and what the host hands over at one time"
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

    def _conclude(self, relay: Relay) -> None:
        self._entries(self._stream.finish())
        for line in self._stream.dialogue.summary():
            self._note(line)
        if len(self._settings.lines) == 2:
            waited = ", ".join(f"{count:,} from the {side}" for side, count in relay.most_waiting.items())
            self._note(f"waited here at most: {waited} (characters)")

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
