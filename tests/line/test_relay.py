"""What stands between a host and a control changes nothing of what either says, and holds no more than it may."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.captures.records import Side
from tapewire.line.relay import MOST_WAITING, Damaged, Relay
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance

HOST, CONTROL = Side.HOST, Side.CONTROL
HOLD = 40


@dataclass
class Between:
    """A host's end, the relay, a control's end, on simulated cables."""

    has_signals: bool = True
    window: int = 20
    now: Nanos = 0
    heard: list[tuple[Side, LineItem]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.ends: dict[Side, CableEnd] = {}
        lines: dict[Side, CableEnd] = {}
        for side in Side:
            self.ends[side], lines[side] = simulated_cable(
                19200, EndSettings(window=400), EndSettings(window=self.window), has_signals=self.has_signals
            )
        self.relay = Relay(lines, Damaged.STOP, HOLD, lambda side, item, now: self.heard.append((side, item)))
        self.received: dict[Side, list[LineItem]] = {side: [] for side in Side}

    def run(self, span: Nanos) -> None:
        end = self.now + span
        while self.now < end and self.relay.ended is None:
            self.relay.step(self.now)
            for side, line in self.ends.items():
                self.received[side] += line.read(self.now)
            moments = [self.relay.next_deadline(), *(line.next_deadline() for line in self.ends.values())]
            self.now = min([end, *(max(moment, self.now + 1) for moment in moments if moment is not None)])

    def say(self, side: Side, data: bytes) -> None:
        line = self.ends[side]
        line.read(self.now)
        for at in range(0, len(data), 100):
            while not (room := line.room(self.now)) or room < 100:
                self.run(5 * MILLISECOND)
            line.write(data[at : at + 100], self.now)

    def data(self, side: Side) -> bytes:
        return b"".join(item for item in self.received[side] if isinstance(item, bytes))


def on(between: Between) -> Between:
    """Both ends are switched on."""
    for line in between.ends.values():
        line.set_signals(SignalsOut(), between.now)
    between.run(10 * MILLISECOND)
    return between


@given(st.lists(st.tuples(st.sampled_from(Side), st.binary(min_size=1, max_size=300)), max_size=8), st.booleans())
def test_all_that_is_said_arrives_unchanged(said: list[tuple[Side, bytes]], has_signals: bool) -> None:
    between = on(Between(has_signals=has_signals))
    for side, data in said:
        between.say(side, data)
    between.run(3 * SECOND)
    for side in Side:
        whole = b"".join(data for each, data in said if each is side)
        assert between.data(side.other) == whole
        assert b"".join(item for each, item in between.heard if each is side and isinstance(item, bytes)) == whole
    assert between.relay.ended is None
    assert between.relay.characters == sum(len(data) for _, data in said)


def test_control_lines_are_passed_on_both_ways() -> None:
    between = on(Between())
    between.ends[CONTROL].set_signals(SignalsOut(rts=False, dtr=True), between.now)
    between.run(10 * MILLISECOND)
    assert [item for item in between.received[HOST] if isinstance(item, SignalsIn)][-1] == SignalsIn(cts=False)
    between.ends[HOST].set_signals(SignalsOut(rts=True, dtr=False), between.now)
    between.run(10 * MILLISECOND)
    seen = [item for item in between.received[CONTROL] if isinstance(item, SignalsIn)][-1]
    assert seen == SignalsIn(cts=True, dsr=False, cd=False)


def test_a_host_that_obeys_cts_is_held_up_and_loses_nothing() -> None:
    between = on(Between())
    between.ends[CONTROL].set_signals(SignalsOut(rts=False), between.now)
    between.run(10 * MILLISECOND)
    assert between.ends[HOST].room(between.now) == 0
    between.ends[CONTROL].set_signals(SignalsOut(), between.now)
    between.run(10 * MILLISECOND)
    between.say(HOST, bytes(1000))
    between.run(SECOND)
    assert between.data(CONTROL) == bytes(1000)


class Flood:
    """A line that always has more, and takes nothing."""

    def __init__(self, *items: LineItem, size: int = 1000) -> None:
        self.items = list(items)
        self.size = size
        self.taken = bytearray()
        self.open = False
        self.reads = 0

    def read(self, now: Nanos) -> list[LineItem]:
        self.reads += 1
        items, self.items = self.items, []
        return [*items, *([bytes(self.size)] if self.size else [])]

    def room(self, now: Nanos) -> int:
        return 100 if self.open else 0

    def write(self, data: bytes, now: Nanos) -> None:
        self.taken += data

    def in_flight(self, now: Nanos) -> int:
        return 0

    def on_its_way(self, now: Nanos) -> int:
        return 0

    def discard(self, now: Nanos) -> int:
        return 0

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None: ...

    def next_deadline(self) -> Nanos | None:
        return None

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(characters=0, guaranteed=False, how="")

    @property
    def watched(self) -> int:
        return 7 if self.size else 8

    def close(self, now: Nanos) -> None: ...


def nobody(side: Side, item: LineItem, now: Nanos) -> None: ...


def test_a_line_without_control_lines_is_not_read_while_too_much_waits() -> None:
    host, control = Flood(), Flood(size=0)
    relay = Relay({HOST: host, CONTROL: control}, Damaged.STOP, HOLD, nobody)
    for now in range(100):
        relay.step(now)
    assert relay.characters <= HOLD + 1000
    assert relay.most_waiting == {HOST: relay.characters, CONTROL: 0}
    assert relay.watched == {8}
    control.open = True
    host.size = 0
    for now in range(100, 200):
        relay.step(now)
    assert len(control.taken) == relay.characters
    assert relay.ended is None


def test_a_sender_that_ignores_rts_is_told_to_have_lost_characters() -> None:
    host, control = Flood(SignalsIn()), Flood(size=0)
    relay = Relay({HOST: host, CONTROL: control}, Damaged.STOP, HOLD, nobody)
    now = 0
    while relay.ended is None:
        relay.step(now := now + 1)
    assert relay.characters <= MOST_WAITING + 1000
    assert "the control takes nothing" in relay.ended.reason


@pytest.mark.parametrize("fault", LineFault)
def test_a_damaged_character_ends_it(fault: LineFault) -> None:
    host, control = Flood(b"ab", Fault(fault=fault, byte=67), b"d", size=0), Flood(size=0)
    control.open = True
    relay = Relay({HOST: host, CONTROL: control}, Damaged.STOP, HOLD, nobody)
    relay.step(1)
    assert relay.ended is not None
    assert relay.ended.closure is Closure.LOST
    assert f"{fault} from the host" in relay.ended.reason
    assert control.taken == b""


def test_or_it_is_left_out_where_that_is_wanted() -> None:
    host, control = Flood(b"ab", Fault(fault=LineFault.PARITY, byte=67), b"d", size=0), Flood(size=0)
    control.open = True
    relay = Relay({HOST: host, CONTROL: control}, Damaged.DROP, HOLD, nobody)
    relay.step(1)
    assert relay.ended is None
    assert control.taken == b"abd"


def test_what_was_said_before_the_end_is_still_passed_on() -> None:
    between = on(Between())
    between.ends[HOST].read(between.now)
    between.ends[HOST].write(bytes(300), between.now)
    between.ends[HOST].close(between.now)
    between.run(5 * SECOND)
    assert between.data(CONTROL) == bytes(300)
    assert between.relay.ended is not None
    assert between.relay.ended.closure is Closure.ORDERLY


def test_an_end_waits_for_nobody_for_ever() -> None:
    closed = Closed(closure=Closure.ORDERLY, reason="gone")
    relay = Relay({HOST: Flood(b"x", closed, size=0), CONTROL: Flood(size=0)}, Damaged.STOP, HOLD, nobody)
    relay.step(SECOND)
    assert relay.ended is None
    deadline = relay.next_deadline()
    assert deadline is not None
    relay.step(deadline)
    assert relay.ended == closed


def test_one_line_alone_is_only_listened_to() -> None:
    line = Flood(b"\x11", Fault(fault=LineFault.PARITY), SignalsIn(), size=5)
    heard: list[LineItem] = []
    relay = Relay({CONTROL: line}, Damaged.STOP, HOLD, lambda side, item, now: heard.append(item))
    for now in range(20_000):
        relay.step(now)
    assert relay.ended is None
    assert heard[:3] == [b"\x11", Fault(fault=LineFault.PARITY), SignalsIn()]
    assert line.taken == b""
    line.items = [Closed(closure=Closure.ORDERLY, reason="gone")]
    line.size = 0
    relay.step(20_001)
    assert relay.ended is not None
