"""One engine, one line, one job: open, run until the engine says how it ended, close."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

from tapewire.engine import (
    SECOND,
    Alarm,
    Closure,
    Ended,
    Engine,
    Event,
    Held,
    Nanos,
    Notice,
    Outcome,
    Received,
    Resumed,
    Started,
)
from tapewire.line.captures.file import CaptureSettings
from tapewire.line.captures.records import Origin, Side
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.link import Application, Link
from tapewire.line.open import LineAddress, PtyAddress, open_line, parse_line
from tapewire.line.pacing import character_time, default_window
from tapewire.line.transport import Transport
from tapewire.protocols import ProtocolEntry, protocol
from tapewire.protocols.settings import End
from tapewire.transfer.capturing import JobCapture
from tapewire.transfer.meter import Meter
from tapewire.transfer.reopening import Losses, WhenLost, open_when_back
from tapewire.transfer.reports import Observer, Progress, Ready, nothing

__all__ = ["ABORT_LIMIT_S", "JobSettings", "Session", "settings_for", "undo"]

PROGRESS_INTERVAL_S: Final = 0.25
"""With the last one, which comes when it comes, at most five progress reports a second."""

ABORT_LIMIT_S: Final = 1.5
"""An engine that was told to give up ends within a second; after this much the line itself is stuck."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSettings:
    """What a job needs to know of its line and its protocol. `params` is the protocol's own record."""

    line: LineAddress
    protocol: ProtocolEntry
    params: Any
    baud: int
    stopbits: int = 1
    data_bits: int = 8
    timeout_s: float | None = None
    capture: CaptureSettings | None = None
    origin: Origin = field(default_factory=Origin)
    """What a capture says of this job."""
    observer: Observer = nothing
    stop: asyncio.Event = field(default_factory=asyncio.Event)
    """Set it to give the job up in an orderly way: nothing leaves after its end."""
    when_lost: WhenLost = WhenLost.END
    """Of the line, before anything has begun on it; a job that has begun ends with its line."""
    began: Nanos = field(default_factory=monotonic)
    """`timeout_s` counts from here: what is prepared before the line is opened counts too."""

    def observed_by(self, observer: Observer, stop: asyncio.Event) -> JobSettings:
        return replace(self, observer=observer, stop=stop)


def settings_for(
    end: End,
    line: str,
    protocol_name: str,
    *,
    baud: int | None = None,
    stopbits: int | None = None,
    settings: Mapping[str, str],
    timeout_s: float | None = None,
    capture: CaptureSettings | None = None,
) -> JobSettings:
    """A job's settings from words as users type them. Raises UsageError."""
    entry = protocol(protocol_name)
    params = entry.params(settings, end)
    stopbits = stopbits or entry.stopbits
    data_bits = entry.data_bits(params, stopbits)
    baud = baud or entry.baud
    address = parse_line(line)
    return JobSettings(
        line=address,
        protocol=entry,
        params=params,
        baud=baud,
        stopbits=stopbits,
        data_bits=data_bits,
        timeout_s=timeout_s,
        capture=capture,
        origin=Origin(
            line=line,
            baud=baud,
            framing=_framing(address, baud, stopbits, data_bits),
            side=Side.CONTROL if end is End.CONTROL else Side.HOST,
            protocol=entry.name,
            settings=dict(settings),
        ),
    )


def _framing(address: LineAddress, baud: int, stopbits: int, data_bits: int) -> str:
    """In the usual three characters. Raises UsageError for what no line can have."""
    parity = None if isinstance(address, PtyAddress) else address.options.parity
    return LineSettings(baud=baud, stopbits=stopbits, data_bits=data_bits, parity=parity, window=1).framing


class Session:
    """Runs one engine on the line of `job`.

    `give_up(now)` is called when the job is to be ended from here. `tolerated` is what the other side takes after its
    stop request, `total` the size of the job where it is known. After the end the line is kept for `linger_s`, or
    until the other side closes it. `between` may put something between the line, captured as it is, and the engine.
    `heard` gets every event before it is reported. A job that is complete goes on until `at_rest`.
    """

    def __init__(
        self,
        job: JobSettings,
        engine: Engine,
        *,
        tolerated: int,
        give_up: Callable[[Nanos], None],
        bytes_done: Callable[[], int],
        total: int | None = None,
        application: Application | None = None,
        paced_reception: bool = False,
        linger_s: float = 0.0,
        details: Callable[[], dict[str, int]] = dict,
        between: Callable[[Transport], Transport] | None = None,
        heard: Callable[[Event, Nanos], None] = nothing,
        at_rest: Callable[[], bool] = lambda: True,
    ) -> None:
        self.job = job
        self.engine = engine
        self.link: Link
        self._capture: JobCapture
        self.driver: LineDriver
        self.ended: Ended | None = None
        self.stops = 0
        self._all_sent = False
        self._give_up = give_up
        self._bytes_done = bytes_done
        self._total = total
        self._application = application
        self._paced_reception = paced_reception
        self._linger_s = linger_s
        self._details = details
        self._between = between
        self._heard = heard
        self._at_rest = at_rest
        self._window = default_window(job.baud, tolerated)
        self.meter = Meter(character_time(job.baud), self._window)
        self._began = monotonic()
        self._overruled: tuple[Outcome, str] | None = None
        self._was_open = self._has_begun = False

    @property
    def seconds(self) -> float:
        return (monotonic() - self._began) / SECOND

    async def run(self, begin: Callable[[Transport, Nanos], None]) -> Ended:
        """Open, run, close. `begin` is called with the open line. Raises LineError, UsageError."""
        self._capture = JobCapture(self.job.capture, self.job.origin, self.job.observer)
        ended = None
        try:
            ended = await self._run(begin)
            losses = Losses()
            while self._may_wait(ended):
                if losses.is_news(ended.reason, monotonic()):
                    self._note(f"{ended.reason}; nothing had begun, so {self.job.line} is opened again when it is back")
                self.ended = None
                ended = await self._run(begin)
            return ended
        finally:
            await self._capture.close(failed=ended is None or ended.outcome is not Outcome.COMPLETE)

    async def _run(self, begin: Callable[[Transport, Nanos], None]) -> Ended:
        line = await self._open()
        if isinstance(line, Ended):
            return line
        transport = self._capture.tap(line)
        if self._between is not None:
            transport = self._between(transport)
        try:
            self.link = Link(
                self.engine,
                transport,
                application=self._application,
                on_event=self._on_event,
                on_sent=self._count,
            )
            self.driver = LineDriver(self.link)
            begin(transport, monotonic())
            await self._drive()
        finally:
            transport.close(monotonic())
        assert self.ended is not None
        return self.ended

    def _may_wait(self, ended: Ended) -> bool:
        """The line went, and with it nothing that a person would have to look at."""
        lost = self._was_open and self.link.closed and ended.outcome is Outcome.FAILED and self._overruled is None
        waits = self.job.when_lost is WhenLost.WAIT and not self.job.stop.is_set()
        return waits and lost and not self._has_begun and not self._bytes_done()

    async def _open_line(self) -> DescriptorLine:
        return await open_line(
            self.job.line,
            baud=self.job.baud,
            stopbits=self.job.stopbits,
            data_bits=self.job.data_bits,
            window=self._window,
            paced_reception=self._paced_reception,
            on_ready=lambda line: self.job.observer(Ready(line=line), monotonic()),
            on_note=self._note,
        )

    def _note(self, text: str) -> None:
        self.job.observer(Notice(text=text), monotonic())

    async def _open(self) -> Transport | Ended:
        opening = asyncio.ensure_future(
            open_when_back(self._open_line, self._note) if self._was_open else self._open_line()
        )
        try:
            await self._race(opening)
            if opening.done():
                line = opening.result()
                self._was_open = True
                return line
        finally:
            if not opening.done():
                await undo(opening)
        outcome, reason = self._overruled or (Outcome.CANCELLED, "given up here before the line was open")
        return Ended(outcome=outcome, reason=reason, bytes_low=0, bytes_high=0)

    async def _drive(self) -> None:
        driving = asyncio.ensure_future(self.driver.run(lambda: self._is_over))
        ticker = asyncio.ensure_future(self._tick())
        try:
            await self._race(driving)
            if not driving.done():
                await self._end(driving)
        except asyncio.CancelledError:
            await self._end(driving)
            raise
        finally:
            ticker.cancel()
            driving.cancel()
            await asyncio.wait([driving, ticker])
        if driving.cancelled():
            self._give_up_line()
            return
        driving.result()
        if self._linger_s and not self.link.closed:
            with suppress(TimeoutError):
                await asyncio.wait_for(self.driver.run(lambda: self.link.closed), self._linger_s)

    async def _race(self, work: asyncio.Future[Any]) -> None:
        """Until `work` is done, the caller wants to stop, or the time is up."""
        stopping = asyncio.ensure_future(self.job.stop.wait())
        left = None if self.job.timeout_s is None else self.job.timeout_s - (monotonic() - self.job.began) / SECOND
        try:
            await asyncio.wait([work, stopping], timeout=left, return_when=asyncio.FIRST_COMPLETED)
            if not work.done() and not stopping.done():
                self._overruled = Outcome.FAILED, f"not complete within {self.job.timeout_s:g} s"
        finally:
            stopping.cancel()

    async def _end(self, driving: asyncio.Future[None]) -> None:
        self.abort()
        await asyncio.wait([driving], timeout=ABORT_LIMIT_S)

    @property
    def _is_over(self) -> bool:
        return self.ended is not None and (self.ended.outcome is not Outcome.COMPLETE or self._at_rest())

    def abort(self) -> None:
        """Give the job up in an orderly way; `run` returns when the engine has said its last."""
        if not self._is_over:
            self._give_up(monotonic())
            self.driver.wake()
            if self.ended is not None:
                outcome, reason = self._overruled or (Outcome.CANCELLED, "given up here before all was executed")
                self.ended = replace(self.ended, outcome=outcome, reason=reason)

    def _give_up_line(self) -> None:
        """The line does not take the engine's last words: to the engine it is gone."""
        now = monotonic()
        self.engine.receive_closed(Closure.LOST, "it takes nothing any more", now)
        self.link.step(now)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(PROGRESS_INTERVAL_S)
            self.report_progress()
            self._capture.tell()

    def report_progress(self) -> None:
        now = monotonic()
        done, rate = self._bytes_done(), self.meter.rate
        left = self._total - done if self._total is not None else None
        self.job.observer(
            Progress(
                bytes=done,
                total=self._total,
                held=self.meter.held,
                rate=rate,
                share=rate * self.meter.character / SECOND,
                left_s=left / rate if left is not None and rate > 0 else None,
                **self._details(),
            ),
            now,
        )

    def _count(self, characters: int, now: Nanos) -> None:
        """What is said after the whole program has gone, such as answers to polls, is no use of the line."""
        if not self._all_sent:
            self.meter.count(characters, now)
            self._all_sent = self._total is not None and self._bytes_done() >= self._total

    def _on_event(self, event: Event, now: Nanos) -> None:
        self._heard(event, now)
        match event:
            case Held():
                self.stops += 1
                self.meter.hold(self.link.transport.in_flight(now), now)
            case Resumed():
                self.meter.resume(now)
            case Started() | Received():
                self._has_begun = True
            case Ended(bytes_low=low, bytes_high=high) if self.ended is None:
                if self._overruled is not None and event.outcome is Outcome.CANCELLED:
                    outcome, reason = self._overruled
                    event = Ended(outcome=outcome, reason=reason, bytes_low=low, bytes_high=high)
                self.ended = event
                return
            case _:
                pass
        if self.ended is None or isinstance(event, Alarm | Notice):
            self.job.observer(event, now)


async def undo(opening: asyncio.Future[Any]) -> None:
    """Cancel an opening that nobody waits for any more, and close what it has opened all the same."""
    opening.cancel()
    await asyncio.wait([opening])
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close(monotonic())
