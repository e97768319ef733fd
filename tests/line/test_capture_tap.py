"""A line that is put on record behaves like the line, and the record says what passed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.captures.records import ALL_ON, Happening, Lines, Record, called_back
from tapewire.line.captures.tap import CapturedLine
from tapewire.line.simulated import EndSettings, simulated_cable
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance, Transport, watched_of
from tests.line.helpers import KINDS, Clock, open_pair, read_until_closed, send_all

UNIX = 1_000_000 * SECOND


class ScriptedLine:
    """A line whose next reading a test writes."""

    def __init__(self, *items: LineItem) -> None:
        self.items = list(items)
        self.signals: list[SignalsOut] = []
        self.watched = 17

    def read(self, now: Nanos) -> list[LineItem]:
        items, self.items = self.items, []
        return items

    def room(self, now: Nanos) -> int:
        return 5

    def write(self, data: bytes, now: Nanos) -> None: ...

    def in_flight(self, now: Nanos) -> int:
        return 3

    def on_its_way(self, now: Nanos) -> int:
        return 2

    def discard(self, now: Nanos) -> int:
        return 4

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        self.signals.append(signals)

    def next_deadline(self) -> Nanos | None:
        return 99

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(characters=7, guaranteed=True, how="scripted")

    def close(self, now: Nanos) -> None: ...


def put_on_record(line: Transport) -> tuple[CapturedLine, list[Record]]:
    said: list[Record] = []
    return CapturedLine(line, said.append, UNIX), said


@pytest.fixture(params=KINDS)
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[CapturedLine, Transport, list[Record]]]:
    with open_pair(request.param) as (near, far):
        line, said = put_on_record(near)
        yield line, far, said


def spoken(said: list[Record], what: Happening) -> bytes:
    return b"".join(record.data for record in said if record.what is what)


def test_both_directions_are_on_record_whatever_the_line(ends: tuple[CapturedLine, Transport, list[Record]]) -> None:
    line, far, said = ends
    clock = Clock()
    data = bytes(range(256)) * 3
    assert send_all(line, far, data, clock).data == data
    assert send_all(far, line, data[::-1], clock).data == data[::-1]
    assert spoken(said, Happening.SENT) == data
    assert spoken(said, Happening.RECEIVED) == data[::-1]
    moments = [record.at for record in said]
    assert moments == sorted(moments)
    assert all(UNIX < moment <= clock.now + UNIX for moment in moments)


def test_the_end_is_on_record_once(ends: tuple[CapturedLine, Transport, list[Record]]) -> None:
    line, far, said = ends
    line.read(SECOND)
    far.close(SECOND)
    (closed,) = read_until_closed(line, Clock()).ends
    line.close(2 * SECOND)
    line.close(2 * SECOND)
    assert [record.remark for record in said if record.what is Happening.COMPLETE] == [closed.reason]


def test_an_end_of_our_own_is_on_record_once() -> None:
    line, said = put_on_record(ScriptedLine())
    line.close(SECOND)
    line.close(SECOND)
    assert said == [Record(at=UNIX + SECOND, what=Happening.COMPLETE, remark="closed here")]


def test_control_lines_are_on_record_when_they_change_and_with_all_that_follows() -> None:
    near, far = simulated_cable(9600, EndSettings(window=20), EndSettings(window=20))
    line, said = put_on_record(near)
    far.set_signals(SignalsOut(rts=True, dtr=False), MILLISECOND)
    line.read(2 * MILLISECOND)
    line.set_signals(SignalsOut(rts=True, dtr=True), 2 * MILLISECOND)
    line.set_signals(SignalsOut(rts=False, dtr=True), 3 * MILLISECOND)
    line.set_signals(SignalsOut(rts=False, dtr=True), 4 * MILLISECOND)
    line.write(b"x", 5 * MILLISECOND)
    assert [record.what for record in said[:-1]] == [Happening.STATUS_CHANGE] * 3
    assert [record.lines for record in said] == [
        Lines.RTS | Lines.DTR,
        Lines.CTS | Lines.RTS | Lines.DTR,
        Lines.CTS | Lines.DTR,
        Lines.CTS | Lines.DTR,
    ]


def test_faults_stand_in_their_place() -> None:
    items: list[LineItem] = [b"a", *(Fault(fault=fault, byte=66) for fault in LineFault), Fault(fault=LineFault.BREAK)]
    line, said = put_on_record(ScriptedLine(*items, b"c"))
    assert line.read(1)[:2] == items[:2]
    assert [(record.what, record.data) for record in said] == [
        (Happening.RECEIVED, b"a"),
        (Happening.PARITY_ERROR, b"B"),
        (Happening.FRAMING_ERROR, b"B"),
        (Happening.UART_OVERRUN, b"B"),
        (Happening.BREAK, b"B"),
        (Happening.BREAK, b""),
        (Happening.RECEIVED, b"c"),
    ]


def test_what_was_called_back_is_on_record() -> None:
    line, said = put_on_record(ScriptedLine())
    assert line.discard(1) == 4
    assert [record.remark for record in said] == [called_back(4)]


def test_everything_else_is_what_the_line_says() -> None:
    scripted = ScriptedLine(SignalsIn(cts=False), Closed(closure=Closure.LOST, reason="gone"))
    line, said = put_on_record(scripted)
    assert (line.room(0), line.in_flight(0), line.on_its_way(0), line.next_deadline()) == (5, 3, 2, 99)
    assert line.stop_distance.how == "scripted"
    assert watched_of(line) == watched_of(scripted) == 17
    line.set_signals(SignalsOut(rts=False), 0)
    assert scripted.signals == [SignalsOut(rts=False)]
    line.read(0)
    assert said[-1].lines == ALL_ON & ~Lines.CTS & ~Lines.RTS


def test_a_line_in_memory_is_waited_on_by_nobody() -> None:
    near, _ = simulated_cable(9600, EndSettings(window=20), EndSettings(window=20))
    assert watched_of(put_on_record(near)[0]) is None
