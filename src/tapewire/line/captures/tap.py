"""A line that is listened to: a Transport around another, which puts on record all that passes through it.

It changes nothing and waits for nothing. What is handed over is recorded at that moment, up to a window before its
last character is on the wire; what comes in, when this computer got to see it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from tapewire.engine import LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.captures.records import ALL_ON, FAULTS, Happening, Lines, Record, called_back
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance, Transport, slack_of, watched_of

__all__ = ["CapturedLine", "TakesRecords"]

TakesRecords: TypeAlias = Callable[[Record], object]
"""Where records go. Returns at once."""

_HAPPENING_OF: Final = {fault: happening for happening, fault in FAULTS.items()}

_IN: Final = Lines.CTS | Lines.DSR | Lines.CD
_OUT: Final = Lines.RTS | Lines.DTR


class CapturedLine:
    """`line`, of which `put` gets every record. `unix` moves the clock of `now` to Unix time."""

    def __init__(self, line: Transport, put: TakesRecords, unix: Nanos) -> None:
        self._line = line
        self._put = put
        self._unix = unix
        self._lines = ALL_ON
        self._ended = False

    @property
    def watched(self) -> int | None:
        """What the line itself says."""
        return watched_of(self._line)

    @property
    def slack(self) -> Nanos:
        """What the line itself says."""
        return slack_of(self._line)

    @property
    def stop_distance(self) -> StopDistance:
        return self._line.stop_distance

    def read(self, now: Nanos) -> list[LineItem]:
        items = self._line.read(now)
        for item in items:
            self._record_item(item, now)
        return items

    def room(self, now: Nanos) -> int:
        return self._line.room(now)

    def write(self, data: bytes, now: Nanos) -> None:
        self._line.write(data, now)
        self._record(Happening.SENT, now, data)

    def in_flight(self, now: Nanos) -> int:
        return self._line.in_flight(now)

    def on_its_way(self, now: Nanos) -> int:
        return self._line.on_its_way(now)

    def discard(self, now: Nanos) -> int:
        count = self._line.discard(now)
        if count:
            self._record(Happening.STATUS_CHANGE, now, remark=called_back(count))
        return count

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        self._line.set_signals(signals, now)
        on = (Lines.RTS if signals.rts else Lines(0)) | (Lines.DTR if signals.dtr else Lines(0))
        self._turn(self._lines & ~_OUT | on, now)

    def next_deadline(self) -> Nanos | None:
        return self._line.next_deadline()

    def close(self, now: Nanos) -> None:
        self._line.close(now)
        if not self._ended:
            self._ended = True
            self._record(Happening.COMPLETE, now, remark="closed here")

    def _record_item(self, item: LineItem, now: Nanos) -> None:
        match item:
            case bytes():
                self._record(Happening.RECEIVED, now, item)
            case Fault(fault=fault, byte=byte):
                self._record(_HAPPENING_OF[fault], now, b"" if byte is None else bytes([byte]))
            case SignalsIn(cts=cts, dsr=dsr, cd=cd):
                on = (
                    (Lines.CTS if cts else Lines(0)) | (Lines.DSR if dsr else Lines(0)) | (Lines.CD if cd else Lines(0))
                )
                self._turn(self._lines & ~_IN | on, now)
            case Closed(reason=reason):
                self._ended = True
                self._record(Happening.COMPLETE, now, remark=reason)

    def _turn(self, lines: Lines, now: Nanos) -> None:
        if lines != self._lines:
            self._lines = lines
            self._record(Happening.STATUS_CHANGE, now)

    def _record(self, what: Happening, now: Nanos, data: bytes = b"", remark: str = "") -> None:
        self._put(Record(at=now + self._unix, what=what, lines=self._lines, data=data, remark=remark))


assert frozenset(_HAPPENING_OF) == frozenset(LineFault), "a fault without a place in captures"
