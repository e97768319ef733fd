"""The simulated cable and what stands before it: no cut of time changes anything, and nothing is lost unnoticed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.errors import UsageError
from tapewire.line.faults.chance import derive
from tapewire.line.faults.damage import Parity, truncated
from tapewire.line.faults.injector import Injectors, injectors
from tapewire.line.faults.plan import Extent, FaultPlan, Framing, LateStop, LineEnd, LinePlan, Nth, Wire
from tapewire.line.faults.presets import PRESETS, preset
from tapewire.line.faults.when import end_schedule
from tapewire.line.pacing import Pacing, character_time
from tapewire.line.paths import PATHS, PathKind
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable
from tapewire.line.transport import Closed, Fault, LineItem

BAUD = 9600
CHARACTER = character_time(BAUD)
KINDS: Sequence[PathKind | None] = (None, *PATHS.values())
PLANS = [plan for plan in PRESETS.values() if plan.line_faults]
WINDOW = 4000
EXTENT = Extent(characters=200, span=SECOND // 4)

Paths = st.sampled_from(KINDS)
Steps = st.lists(st.tuples(st.integers(0, 40 * MILLISECOND), st.integers(0, 60)), max_size=12)
"""(what passes, ns; characters handed over then, or 0 for a change of RTS)."""
Cuts = st.lists(st.integers(1, 60 * MILLISECOND), max_size=12)


def faults_of(plan: FaultPlan, seed: int) -> Injectors:
    return injectors(plan, lambda name: derive(seed, name), extent=EXTENT, character=CHARACTER)


def cable(
    near: PathKind | None, far: PathKind | None = None, faults: Injectors | None = None, window: int = WINDOW
) -> tuple[CableEnd, CableEnd]:
    ends = simulated_cable(
        BAUD, EndSettings(window=window, path=near), EndSettings(window=window, path=far), faults=faults
    )
    for end in ends:
        end.set_signals(SignalsOut(), 0)
        end.read(0)
    return ends


def singly(items: Sequence[LineItem]) -> list[LineItem]:
    """Bytes character by character."""
    return [one for item in items for one in ([bytes((b,)) for b in item] if isinstance(item, bytes) else [item])]


def run(
    paths: tuple[PathKind | None, PathKind | None],
    plan: FaultPlan,
    seed: int,
    steps: list[tuple[int, int]],
    cuts: list[int] | None,
) -> tuple[list[LineItem], Injectors, int]:
    """What the far end reads, told by its deadlines, or looked for after each of `cuts`; and how much was sent."""
    line = faults_of(plan, seed)
    near, far = cable(*paths, line)
    acts = list(zip(itertools.accumulate(span for span, _ in steps), (count for _, count in steps), strict=True))
    looks = None if cuts is None else list(itertools.accumulate(cuts))
    end = (acts[-1][0] if acts else 0) + 20 * SECOND
    now: Nanos = 0
    sent = 0
    rts = True
    seen: list[LineItem] = []
    while now < end:
        deadline = far.next_deadline() if looks is None else next((look for look in looks if look > now), end)
        now = min(moment for moment in (deadline, acts[0][0] if acts else end, end) if moment is not None)
        if acts and acts[0][0] == now:
            count = acts.pop(0)[1]
            if count:
                near.write(bytes((sent + place) % 251 for place in range(count)), now)
                sent += count
            else:
                rts = not rts
                near.set_signals(SignalsOut(rts=rts), now)
            if looks is not None:
                continue
        seen += far.read(now)
        moved = far.next_deadline()
        assert moved is None or moved > now, "a deadline that does not move"
    return singly(seen), line, sent


@settings(max_examples=150)
@given(near=Paths, far=Paths, plan=st.sampled_from(PLANS), seed=st.integers(0, 200), steps=Steps, cuts=Cuts)
def test_any_cut_of_time_brings_the_same(
    near: PathKind | None,
    far: PathKind | None,
    plan: FaultPlan,
    seed: int,
    steps: list[tuple[int, int]],
    cuts: list[int],
) -> None:
    told, line, sent = run((near, far), plan, seed, steps, None)
    looked, again, _ = run((near, far), plan, seed, steps, cuts)
    assert told == looked
    assert list(line.log.entries) == list(again.log.entries)
    wire = line.from_host
    came = [item for item in told if not isinstance(item, SignalsIn)]
    assert wire.seen == sent
    assert len(came) == sent - wire.lost + wire.added


@given(near=Paths, far=Paths, steps=Steps)
def test_without_faults_every_path_brings_every_character_and_the_last_signals(
    near: PathKind | None, far: PathKind | None, steps: list[tuple[int, int]]
) -> None:
    told, _, sent = run((near, far), PRESETS["clean"], 0, steps, None)
    assert [item for item in told if isinstance(item, bytes)] == [bytes((n % 251,)) for n in range(sent)]
    carried = all(path is None or path.signal_delay is not None for path in (near, far))
    signals = [item for item in told if isinstance(item, SignalsIn)]
    assert len(signals) == (sum(count == 0 for _, count in steps) if carried else 0)


@given(
    path=Paths,
    loop=st.booleans(),
    writes=st.lists(st.tuples(st.integers(0, 30 * MILLISECOND), st.integers(1, 300)), min_size=1, max_size=6),
    passed=st.integers(0, 100 * MILLISECOND),
)
def test_discard_counts_exactly(path: PathKind | None, loop: bool, writes: list[tuple[int, int]], passed: int) -> None:
    shallow = None if path is None else replace(path, buffer=0)
    closed = loop and (path is None or "uart" in path.name)
    pacing = Pacing.CLOSED_LOOP if closed else Pacing.WINDOW
    near, far = simulated_cable(BAUD, EndSettings(window=WINDOW, path=shallow, pacing=pacing), EndSettings(window=2))
    near.set_signals(SignalsOut(), 0)
    far.set_signals(SignalsOut(), 0)
    now, sent, came = 0, b"", b""
    for span, count in writes:
        now += span
        near.read(now)
        data = bytes((len(sent) + place) % 256 for place in range(min(count, near.room(now))))
        if data:
            near.write(data, now)
        sent += data
        came += b"".join(item for item in far.read(now) if isinstance(item, bytes))
    now += passed
    came += b"".join(item for item in far.read(now) if isinstance(item, bytes))
    recalled = near.discard(now)
    came += b"".join(item for item in far.read(now + 10 * SECOND) if isinstance(item, bytes))
    assert came == sent[: len(sent) - recalled]
    assert near.discard(now) == 0
    near.read(now + 10 * SECOND)
    assert near.room(now + 10 * SECOND) == WINDOW


def reads(far: CableEnd, until: Nanos) -> list[tuple[Nanos, LineItem]]:
    """What comes and when, by the deadlines alone."""
    seen: list[tuple[Nanos, LineItem]] = []
    while (deadline := far.next_deadline()) is not None and deadline <= until:
        seen += ((deadline, item) for item in far.read(deadline))
    return seen


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # 20 characters and then silence: eight, eight, and four that wait for the time-out.
        ("uart-16550", [(8, 8), (16, 8), (24, 4)]),
        ("uart-deep", [(24, 20)]),
    ],
)
def test_a_receive_fifo_tells_at_its_trigger_and_at_its_time_out(name: str, expected: list[tuple[int, int]]) -> None:
    near, far = cable(None, PATHS[name])
    near.write(bytes(20), 0)
    assert [(at // CHARACTER, len(data)) for at, data in reads(far, SECOND) if isinstance(data, bytes)] == expected


def scripted(*faults: LinePlan) -> Injectors:
    plan = FaultPlan(name="scripted", why="a test", faults=faults)
    return injectors(plan, lambda name: derive(0, name), character=CHARACTER)


def test_a_damaged_character_is_told_at_once_with_all_before_it() -> None:
    near, far = cable(None, PATHS["uart-16550"], scripted(Framing(when=Nth(3), wire=Wire.FROM_HOST)))
    near.write(b"ABCDE", 0)
    framing = Fault(fault=LineFault.FRAMING, byte=0x43)
    assert reads(far, SECOND) == [(3 * CHARACTER, b"AB"), (3 * CHARACTER, framing), (9 * CHARACTER, b"DE")]


def test_a_late_stop_brings_with_it_what_came_meanwhile() -> None:
    near, far = cable(None, None, scripted(LateStop(when=Nth(1), wire=Wire.FROM_HOST, characters=10)))
    near.write(b"AB\x13CD", 0)
    near.write(b"EFGHIJKLMNOP", 0)
    seen = [(at // CHARACTER, item) for at, item in reads(far, SECOND)]
    assert b"".join(item for at, item in seen if at < 13 and isinstance(item, bytes)) == b"AB"
    assert [item for at, item in seen if at == 13] == [b"\x13CDEFGHIJKL"]


@pytest.mark.parametrize("name", ["usb-1ms", "usb-16ms"])
def test_a_usb_adapter_tells_only_when_it_is_asked(name: str) -> None:
    poll = PATHS[name].poll
    near, far = cable(None, PATHS[name])
    near.write(bytes(50), 1)
    near.set_signals(SignalsOut(rts=False), 2 * MILLISECOND)
    seen = reads(far, SECOND)
    assert all(at % poll == 0 for at, _ in seen)
    assert (-(-2 * MILLISECOND // poll) * poll, SignalsIn(cts=False)) in seen


def test_a_serial_server_is_late_by_its_network_and_has_no_signals() -> None:
    server = PATHS["serial-server"]
    near, far = cable(server)
    far.set_signals(SignalsOut(rts=False), 5)
    near.write(b"A", 10)
    far.write(b"B", 10)
    assert reads(far, SECOND) == [(10 + server.latency + CHARACTER, b"A")]
    assert reads(near, SECOND) == [(10 + 5 * CHARACTER + server.latency, b"B")]
    assert near.room(SECOND) == WINDOW


@pytest.mark.parametrize("path", PATHS.values(), ids=lambda path: path.name)
def test_what_a_driver_has_given_away_is_out_of_reach(path: PathKind) -> None:
    near, _ = cable(path)
    near.write(bytes(path.out_of_reach), 0)
    assert near.on_its_way(0) == 0
    assert near.discard(0) == 0
    near.write(bytes(50), 0)
    assert near.on_its_way(0) == 50
    assert near.discard(0) == 50


@pytest.mark.parametrize(
    "path", [path for path in PATHS.values() if "uart" not in path.name], ids=lambda path: path.name
)
def test_a_closed_loop_wants_a_transmitter_that_can_be_asked(path: PathKind) -> None:
    with pytest.raises(UsageError, match=path.name):
        EndSettings(window=2, path=path, pacing=Pacing.CLOSED_LOOP)


# ends that lose their power or their program


@pytest.mark.parametrize("parity", Parity)
def test_a_character_cut_off_reads_as_ones_from_there(parity: Parity) -> None:
    assert truncated(0x41, 0, parity) is None
    assert truncated(0x41, 11, parity) == b"\x41"
    assert truncated(0x00, 5, parity) == (
        b"\xf0" if parity is Parity.NONE else Fault(fault=LineFault.PARITY, byte=0xF0)
    )


@given(at=st.integers(0, 12 * CHARACTER))
def test_a_power_cut_ends_in_the_middle_of_a_character(at: Nanos) -> None:
    near, far = cable(None)
    data = bytes(range(0x30, 0x3A))
    near.write(data, 0)
    near.cut_power(at)
    assert near.room(at) == 0
    seen = reads(far, SECOND)
    assert (at, SignalsIn(cts=False, dsr=False, cd=False)) in seen
    whole = min(10, at // CHARACTER)
    came = singly([item for _, item in seen if not isinstance(item, SignalsIn)])
    assert came[:whole] == singly([data[:whole]])
    assert len(came) <= whole + 1
    assert all(moment <= at + CHARACTER for moment, _ in seen)
    near.restore(SECOND)
    near.set_signals(SignalsOut(), SECOND)
    assert near.read(SECOND) == [SignalsIn()]
    assert near.room(SECOND) == WINDOW
    near.write(b"back", SECOND)
    assert [item for _, item in reads(far, 2 * SECOND) if isinstance(item, bytes)][-1] == b"k"


def test_what_comes_to_an_end_without_power_or_program_is_lost() -> None:
    for leave in (CableEnd.cut_power, CableEnd.abandon):
        near, far = cable(PATHS["uart-16550"])
        leave(near, 1000)
        far.write(b"lost", 2000)
        assert near.next_deadline() is None
        assert near.read(SECOND) == []
        near.restore(SECOND)
        far.write(b"heard", SECOND)
        assert [item for item in near.read(2 * SECOND) if isinstance(item, bytes)] == [b"heard"]


def test_what_a_killed_program_handed_over_still_leaves_and_its_signals_stay() -> None:
    near, far = cable(PATHS["usb-1ms"])
    near.write(b"on its way", 0)
    near.abandon(1)
    assert b"".join(item for item in far.read(SECOND) if isinstance(item, bytes)) == b"on its way"
    near.restore(SECOND)
    assert near.read(SECOND) == [SignalsIn()]


def test_an_end_that_comes_back_after_the_other_has_closed_is_told_so() -> None:
    near, far = cable(None)
    near.abandon(1)
    far.close(2)
    near.restore(SECOND)
    told = near.read(SECOND)
    assert isinstance(told[-1], Closed)
    assert told[-1].closure is Closure.ORDERLY


def test_what_happens_to_the_ends_is_planned_and_bounded() -> None:
    plan = preset("power-cut")
    schedules = [end_schedule(plan, derive(seed, "ends"), Extent(span=10 * SECOND)) for seed in range(300)]
    moments = [moment for schedule in schedules for moment, _ in schedule]
    assert all(list(schedule) == sorted(schedule, key=lambda entry: entry[0]) for schedule in schedules)
    assert {fault.end for schedule in schedules for _, fault in schedule} == set(LineEnd)
    assert 180 < sum(moment <= 10 * SECOND for moment in moments) < 300
    assert max(moments) <= 40 * SECOND
