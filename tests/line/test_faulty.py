"""A fault plan around a line as it is: what comes in, what goes out, and what is called back of it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.faults.chance import derive
from tapewire.line.faults.injector import Injectors, injectors
from tapewire.line.faults.plan import (
    At,
    Break,
    DoubleCharacter,
    Every,
    FaultPlan,
    FlipBits,
    Framing,
    HoldSignal,
    LateStop,
    LineEnd,
    Lose,
    Noise,
    Nth,
    PlannedFault,
    PullCable,
    Rate,
    Sight,
    Signal,
    Wire,
)
from tapewire.line.faults.presets import PRESETS
from tapewire.line.faulty import FaultyTransport, made_on_a_line
from tapewire.line.pacing import character_time
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable
from tapewire.line.transport import Closed, Fault, LineItem, Transport

BAUD = 9600
CHARACTER = character_time(BAUD)
START = 5 * SECOND
DATA = bytes(range(65, 91))


def faults_of(*faults: PlannedFault, seed: int = 1) -> Injectors:
    plan = FaultPlan(name="scripted", why="a test", faults=faults)
    return injectors(plan, lambda name: derive(seed, name), character=CHARACTER)


def wrapped(line: Injectors, window: int = 100, fifo: int = 16) -> tuple[FaultyTransport, CableEnd]:
    """The host's end with faults, and the control's end of the same cable."""
    near, far = simulated_cable(BAUD, EndSettings(window=window, fifo=fifo), EndSettings(window=window))
    faulty = FaultyTransport(near, line, LineEnd.HOST, character=CHARACTER)
    for end in (faulty, far):
        end.set_signals(SignalsOut(), START)
    for end in (faulty, far):
        end.read(START)
    return faulty, far


def data_of(items: list[LineItem]) -> bytes:
    return b"".join(item for item in items if isinstance(item, bytes))


def exchange(sender: Transport, receiver: Transport, data: bytes, until: Nanos = 60 * SECOND) -> list[LineItem]:
    """Both ends kept to their deadlines, until the receiver has what there is."""
    now, at = START, 0
    seen: list[LineItem] = []
    while now < until:
        sender.read(now)
        if at < len(data) and (room := sender.room(now)):
            sender.write(data[at : at + room], now)
            at += min(room, len(data) - at)
        seen += receiver.read(now)
        moments = [moment for end in (sender, receiver) if (moment := end.next_deadline()) is not None]
        if not moments and at == len(data):
            break
        now = max(now + 1, min(moments, default=until))
    return seen


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (Lose(when=Nth(3)), DATA[:2] + DATA[3:]),
        (DoubleCharacter(when=Nth(26)), DATA + b"Z"),
        (DoubleCharacter(when=Nth(1)), b"A" + DATA),
    ],
)
@pytest.mark.parametrize("wire", [Wire.FROM_HOST, Wire.FROM_CONTROL])
def test_either_direction_is_hit_where_it_is_named(fault: Lose | DoubleCharacter, expected: bytes, wire: Wire) -> None:
    for named in Wire:
        if named is Wire.BOTH:
            continue
        kind = type(fault)
        faulty, far = wrapped(faults_of(kind(when=fault.when, wire=named)))
        seen = exchange(faulty, far, DATA) if wire is Wire.FROM_HOST else exchange(far, faulty, DATA)
        assert data_of(seen) == (expected if named is wire else DATA)


def test_what_comes_in_damaged_is_marked_and_what_goes_out_is_another_character() -> None:
    faulty, far = wrapped(faults_of(FlipBits(when=Nth(2))))
    (fault,) = (item for item in exchange(far, faulty, DATA) if isinstance(item, Fault))
    assert fault.fault is LineFault.PARITY
    faulty, far = wrapped(faults_of(FlipBits(when=Nth(2), bits=2)))
    went = data_of(exchange(faulty, far, DATA))
    assert went[:1] + went[2:] == DATA[:1] + DATA[2:]
    assert went[1] != DATA[1]


Rules = st.lists(
    st.builds(
        lambda make, when: make(when=when, wire=Wire.FROM_HOST),
        st.sampled_from([Lose, DoubleCharacter, Noise]),
        st.one_of(st.builds(Nth, st.integers(1, 60)), st.builds(Rate, st.sampled_from([0.05, 0.3]))),
    ),
    max_size=3,
)


@given(
    rules=Rules,
    seed=st.integers(0, 100),
    steps=st.lists(st.tuples(st.integers(0, 30 * MILLISECOND), st.integers(1, 60)), min_size=1, max_size=8),
    passed=st.integers(0, 60 * MILLISECOND),
)
def test_what_is_called_back_is_counted_as_it_was_handed_over(
    rules: list[PlannedFault], seed: int, steps: list[tuple[int, int]], passed: int
) -> None:
    faulty, far = wrapped(faults_of(*rules, seed=seed), window=80, fifo=2)
    now, handed, came = START, b"", b""
    for span, wanted in steps:
        now += span
        faulty.read(now)
        came += data_of(far.read(now))
        if count := min(faulty.room(now), wanted):
            data = bytes((len(handed) + place) % 256 for place in range(count))
            faulty.write(data, now)
            handed += data
        assert faulty.in_flight(now) >= faulty.on_its_way(now) >= 0
    now += passed
    faulty.read(now)
    recalled = faulty.discard(now)
    came += data_of(far.read(now + 10 * SECOND))
    left = handed[: len(handed) - recalled]
    again = faults_of(*rules, seed=seed).from_host
    arrived = b"".join(
        bytes((item.byte or 0,)) if isinstance(item, Fault) else item
        for _, item in again.characters(left, 0, 0)
        if isinstance(item, bytes | Fault)
    )
    # Of a character written twice one copy may have left and the other not.
    assert came in (arrived, arrived[:-1])
    assert faulty.discard(now) == 0


@pytest.mark.parametrize("sight", Sight)
def test_a_pulled_cable_swallows_both_ways_at_the_pace_of_the_line(sight: Sight) -> None:
    line = faults_of(PullCable(when=At(SECOND), span=SECOND, sight=sight))
    faulty, far = wrapped(line)
    pulled = START + SECOND + 1
    far.write(b"lost", pulled)
    told = faulty.read(pulled + 10 * CHARACTER)
    now = pulled + 10 * CHARACTER
    if sight is Sight.SEEN:
        assert told == [SignalsIn(cts=False, dsr=False, cd=False)]
        assert far.read(now) == [SignalsIn(cts=False, dsr=False, cd=False)]
        assert faulty.room(now) == 0
    else:
        assert told == []
        sent = 0
        while now < pulled + SECOND // 2:
            faulty.read(now)
            if room := faulty.room(now):
                faulty.write(bytes(room), now)
                sent += room
            deadline = faulty.next_deadline()
            assert deadline is not None
            assert deadline > now
            now = deadline
        assert 0.9 * (SECOND // 2) < sent * CHARACTER < 1.1 * (SECOND // 2)
        assert far.read(now) == []
    faulty.read(START + 3 * SECOND)
    assert faulty.room(START + 3 * SECOND) == 100


def test_noise_goes_out_and_comes_in() -> None:
    faulty, far = wrapped(faults_of(Noise(when=At(SECOND))))
    assert faulty.next_deadline() == START + SECOND
    assert len(faulty.read(START + SECOND)) == 1
    assert len(far.read(START + 2 * SECOND)) == 1


def test_a_held_line_is_seen_by_either_end() -> None:
    hold = HoldSignal(when=At(SECOND), signal=Signal.CTS, span=SECOND, wire=Wire.BOTH)
    faulty, far = wrapped(faults_of(hold))
    assert faulty.read(START + SECOND) == far.read(START + SECOND) == [SignalsIn(cts=False)]
    assert faulty.room(START + SECOND) == 0
    assert faulty.read(START + 2 * SECOND) == far.read(START + 2 * SECOND) == [SignalsIn()]
    assert faulty.room(START + 2 * SECOND) == 100


def test_a_late_stop_comes_late_and_at_once_when_the_line_ends() -> None:
    for closes in (False, True):
        faulty, far = wrapped(faults_of(LateStop(when=Nth(1), characters=20)))
        far.write(b"A\x13B", START)
        if closes:
            far.close(START)
        now = START + 5 * CHARACTER
        seen = faulty.read(now)
        assert data_of(seen) == (b"A\x13B" if closes else b"A")
        assert isinstance(seen[-1], Closed) is closes
        if not closes:
            deadline = faulty.next_deadline()
            assert deadline == now + 20 * CHARACTER
            assert data_of(faulty.read(deadline)) == b"\x13B"


def test_nothing_goes_wrong_any_more_once_it_is_closed() -> None:
    faults = (LateStop(when=Nth(1), characters=20), Noise(when=Every(MILLISECOND)))
    faulty, far = wrapped(faults_of(*faults))
    far.write(b"\x13B", START)
    faulty.read(START + 3 * CHARACTER)
    faulty.close(START + 3 * CHARACTER)
    assert faulty.read(START + SECOND) == []
    assert faulty.next_deadline() is None
    assert faulty.room(START + SECOND) == 0


@pytest.mark.parametrize("end", LineEnd)
@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_says_what_a_real_line_cannot_show(name: str, end: LineEnd) -> None:
    plan, missing = made_on_a_line(PRESETS[name], end)
    again, nothing = made_on_a_line(plan, end)
    assert (again, nothing) == (plan, ())
    assert plan.path is None
    assert missing or plan == PRESETS[name]
    whole = {"clean", "doubtful-driver", "no-parity", "loose-dsr", "stuck-cts", "pulled-cable"}
    assert (not missing) is (name in whole or (end is LineEnd.HOST and name == "late-xoff"))


def test_what_cannot_be_made_is_named() -> None:
    plan = FaultPlan(name="x", why="", faults=(*PRESETS["power-cut"].faults, *PRESETS["wrong-baud"].faults))
    _, missing = made_on_a_line(plan, LineEnd.CONTROL)
    assert [text.split(":")[0] for text in missing] == [
        "power cut of the host",
        "power cut of the control",
        "baud mismatch from the host",
        "baud mismatch from the control",
    ]
    both = FaultPlan(name="x", why="", faults=(Framing(when=Nth(1)), Break(when=Nth(1), wire=Wire.FROM_CONTROL)))
    made, missing = made_on_a_line(both, LineEnd.CONTROL)
    assert made.faults == (Framing(when=Nth(1), wire=Wire.FROM_HOST),)
    assert len(missing) == 2
