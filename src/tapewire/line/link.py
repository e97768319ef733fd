"""One engine on one line: the rule that the asyncio driver and the simulated world both run.

Read everything first, then let timers fire, so that a stall of this computer never looks like silence of the other.
Then hand bytes over while the line has room, with no call between look and consume. A loop that stalls therefore
neither sees a stop request nor sends past it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tapewire.engine import Engine, Event, Nanos, SignalsIn, SignalsOut
from tapewire.line.transport import Closed, Fault, LineItem, Transport

__all__ = ["Application", "Link"]


class Application(Protocol):
    """Who works an engine from behind: the control that takes blocks out of the buffer, the disk that stores."""

    def step(self, now: Nanos) -> None: ...

    def next_deadline(self) -> Nanos | None: ...

    def next_event(self) -> Event | None:
        """What it has to tell beside the engine's own events."""
        ...


class Link:
    """An engine, its line, and who stands behind the engine.

    `on_event(event, now)` gets every event; `on_item(item, now)` sees what the line brought before the engine does;
    `on_sent(characters, now)` is told how many have been handed over in all; `on_write(data)` sees what is handed over,
    and `on_recall(count)` how much of the end of it was called back.
    """

    def __init__(
        self,
        engine: Engine,
        transport: Transport,
        *,
        application: Application | None = None,
        on_event: Callable[[Event, Nanos], None] | None = None,
        on_item: Callable[[LineItem, Nanos], None] | None = None,
        on_sent: Callable[[int, Nanos], None] | None = None,
        on_write: Callable[[bytes], None] | None = None,
        on_recall: Callable[[int], None] | None = None,
    ) -> None:
        self.engine = engine
        self.transport = transport
        self.application = application
        self.closed = False
        """The line is gone."""
        self.characters_sent = 0
        """Everything handed over, protocol included, less what was called back."""
        self.on_event = on_event
        self.on_item = on_item
        self.on_sent = on_sent
        self.on_write = on_write
        self.on_recall = on_recall
        self.signals_in: SignalsIn | None = None
        """The control lines as the line last told them; None on a line without any."""
        self._reported_left = 0
        self._signals: SignalsOut | None = None

    def step(self, now: Nanos) -> None:
        """Bring everything up to `now`."""
        # What has left is told before what came in, which may be the answer to it.
        if self._reported_left != self.characters_sent:
            self._report_left(now)
        if not self.closed and (items := self.transport.read(now)):
            self._receive(items, now)
        engine = self.engine
        deadline = engine.next_deadline()
        if deadline is not None and deadline <= now:
            engine.handle_timer(now)
        if self.application is not None:
            self.application.step(now)
        if not self.closed:
            self._drive_signals(now)
        if engine.recall:
            self._recall(now)
        has_room = not self.closed and self._send(now)
        # Asked last of all: what is reported as gone may let the engine say more, and a queue that has emptied since
        # the report above would otherwise have nobody come back for it.
        while self._reported_left != self.characters_sent and self._report_left(now) and has_room:
            has_room = self._send(now)
        self._drain(now)

    def next_deadline(self) -> Nanos | None:
        """The nearest moment at which `step` has something to do by itself."""
        nearest = self.engine.next_deadline()
        if not self.closed:
            moment = self.transport.next_deadline()
            if moment is not None and (nearest is None or moment < nearest):
                nearest = moment
        if self.application is not None:
            moment = self.application.next_deadline()
            if moment is not None and (nearest is None or moment < nearest):
                nearest = moment
        return nearest

    def _receive(self, items: list[LineItem], now: Nanos) -> None:
        engine, on_item = self.engine, self.on_item
        for item in items:
            if on_item is not None:
                on_item(item, now)
            match item:
                case bytes():
                    engine.receive_data(item, now)
                case Fault(fault=fault, byte=byte):
                    engine.receive_line_fault(fault, byte, now)
                case SignalsIn():
                    self.signals_in = item
                    engine.receive_signals(item, now)
                case Closed(closure=closure, reason=reason):
                    self.closed = True
                    engine.receive_closed(closure, reason, now)

    def _report_left(self, now: Nanos) -> bool:
        """True when there was something to report."""
        if self.closed:
            return False
        left = self.characters_sent - self.transport.on_its_way(now)
        if left <= self._reported_left:
            return False
        count, self._reported_left = left - self._reported_left, left
        self.engine.data_left(count, now)
        return True

    def _drive_signals(self, now: Nanos) -> None:
        signals = self.engine.signals
        if signals is not self._signals and signals != self._signals:
            self._signals = signals
            self.transport.set_signals(signals, now)

    def _recall(self, now: Nanos) -> None:
        count = 0 if self.closed else self.transport.discard(now)
        self.characters_sent -= count
        if self.on_recall is not None:
            self.on_recall(count)
        self.engine.data_discarded(count, now)

    def _send(self, now: Nanos) -> bool:
        """True when the line has room left, and the engine nothing to say."""
        engine, transport = self.engine, self.transport
        while room := transport.room(now):
            data = engine.data_to_send(room)
            if not data:
                return True
            transport.write(data, now)
            self.characters_sent += len(data)
            if self.on_write is not None:
                self.on_write(data)
            engine.data_sent(len(data), now)
            if self.on_sent is not None:
                self.on_sent(self.characters_sent, now)
            if len(data) == room:
                break
        return False

    def _drain(self, now: Nanos) -> None:
        """What the application has to tell comes first: an alarm before the end that it makes."""
        if self.application is not None:
            while (event := self.application.next_event()) is not None:
                if self.on_event is not None:
                    self.on_event(event, now)
        while (event := self.engine.next_event()) is not None:
            if self.on_event is not None:
                self.on_event(event, now)
