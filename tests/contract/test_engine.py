"""What every engine of every registered protocol owes its driver (architecture: the engine contract)."""

from __future__ import annotations

import gc
import itertools
import random
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import (
    SECOND,
    Closure,
    Ended,
    Engine,
    Event,
    LineFault,
    Nanos,
    Received,
    SignalsIn,
    Violation,
)
from tests.contract.rig import Situation, drain, settle, situations

SITUATIONS = list(situations())

#: What lines bring: mostly the characters that mean something somewhere, and everything else.
TELLING = st.sampled_from(list(b"\x11\x12\x13\x14\x15\x16\x93\x95\x96\x18\x0d\x0a\x03\x8d%SYNRDYGTDSAT0123456789"))
NOISE = st.lists(TELLING | st.integers(0, 255), max_size=60).map(bytes)

in_every_situation = pytest.mark.parametrize("situation", SITUATIONS, ids=lambda situation: situation.name)


@in_every_situation
@given(noise=NOISE, cuts=st.lists(st.integers(0, 60), max_size=8))
def test_any_cutting_of_the_input_gives_the_same_output(situation: Situation, noise: bytes, cuts: list[int]) -> None:
    whole, cut = situation.make(), situation.make()
    first = settle(whole, 0)
    assert settle(cut, 0) == first
    now = 3 * SECOND
    whole.receive_data(noise, now)
    places = sorted({min(place, len(noise)) for place in [0, *cuts, len(noise)]})
    for start, end in itertools.pairwise(places):
        cut.receive_data(noise[start:end], now)
    assert settle(cut, now) == settle(whole, now)
    assert cut.next_deadline() == whole.next_deadline()
    assert cut.signals == whole.signals


CALLS = st.one_of(
    st.tuples(st.just("data"), NOISE),
    st.tuples(st.just("fault"), st.tuples(st.sampled_from(LineFault), st.none() | st.integers(0, 255))),
    st.tuples(st.just("signals"), st.builds(SignalsIn, cts=st.booleans(), dsr=st.booleans(), cd=st.booleans())),
    st.tuples(st.just("wait"), st.integers(0, 100 * SECOND)),
    st.tuples(st.just("abort"), st.none()),
)


@in_every_situation
@given(calls=st.lists(CALLS, max_size=12), closure=st.none() | st.sampled_from(Closure))
def test_no_exception_and_no_deadline_in_the_past(
    situation: Situation, calls: list[tuple[str, object]], closure: Closure | None
) -> None:
    engine, now = situation.make(), 0
    settle(engine, now)
    for what, argument in calls:
        now = play(engine, what, argument, now)
        look_is_a_look(engine)
        settle(engine, now)
        no_deadline_in_the_past(engine, now)
    if closure is not None:
        engine.receive_closed(closure, "test", now)
        settle(engine, now)
        no_deadline_in_the_past(engine, now)


def play(engine: Engine, what: str, argument: object, now: Nanos) -> Nanos:
    match what, argument:
        case "data", bytes(data):
            engine.receive_data(data, now)
        case "fault", (LineFault() as fault, (int() | None) as byte):
            engine.receive_line_fault(fault, byte, now)
        case "signals", SignalsIn() as signals:
            engine.receive_signals(signals, now)
        case "abort", _:
            give_up = getattr(engine, "abort", None) or engine.reset  # type: ignore[attr-defined]
            give_up(now)
        case _:
            assert isinstance(argument, int)
            now += argument
            engine.handle_timer(now)
    return now


def look_is_a_look(engine: Engine) -> None:
    deadline = engine.next_deadline()
    look = engine.data_to_send(16)
    assert len(look) <= 16
    assert engine.data_to_send(16) == look, "looking changed what there is to send"
    assert look.startswith(engine.data_to_send(1)), "a shorter look is not the beginning of a longer one"
    assert engine.next_deadline() == deadline, "looking changed the deadline"


def no_deadline_in_the_past(engine: Engine, now: Nanos) -> None:
    engine.handle_timer(now)
    settle(engine, now)
    deadline = engine.next_deadline()
    assert deadline is None or deadline > now, "a deadline is left in the past"
    engine.handle_timer(now)
    assert engine.next_deadline() == deadline, "an early timer is not harmless"


@in_every_situation
def test_silence_leads_to_rest_or_a_bounded_rhythm(situation: Situation) -> None:
    """Nobody answers for a day: a bounded number of wake-ups, of characters and of events."""
    engine, now = situation.make(), 0
    said, events = settle(engine, now)
    characters, happenings, wakes = len(said), len(events), 0
    while (deadline := engine.next_deadline()) is not None and deadline <= 24 * 3600 * SECOND:
        now, wakes = deadline, wakes + 1
        engine.handle_timer(now)
        said, events = settle(engine, now)
        characters, happenings = characters + len(said), happenings + len(events)
        assert wakes <= 24 * 3600, "it wakes more than once a second for ever"
    assert characters <= 30_000 + 24 * 3600 * 100
    assert happenings <= 24 * 3600


@in_every_situation
def test_memory_is_bounded_whatever_comes(situation: Situation) -> None:
    """96 KB of noise leave no more behind than 32 KB of it did."""
    engine, noise = situation.make(), random.Random(1)
    for _ in range(8):
        engine.receive_data(noise.randbytes(4096), SECOND)
        settle(engine, SECOND)
    before = footprint(engine)
    for _ in range(16):
        engine.receive_data(noise.randbytes(4096), 2 * SECOND)
        settle(engine, 2 * SECOND)
    assert footprint(engine) <= before + 32 * 1024


def footprint(root: object) -> int:
    """Bytes held by everything reachable from an engine that is not a module, a class or a function."""
    seen: set[int] = set()
    total, waiting = 0, [root]
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen or isinstance(thing, type) or callable(thing) or type(thing).__name__ == "module":
            continue
        seen.add(id(thing))
        total += sys.getsizeof(thing)
        waiting.extend(gc.get_referents(thing))
    return total


@in_every_situation
def test_noise_makes_few_events(situation: Situation) -> None:
    """Violations and receptions in a row are merged, so that noise does not flood whoever listens."""
    engine = situation.make()
    drain(engine)
    engine.receive_data(b"\x7e" * 100_000, SECOND)
    events = drain(engine)
    assert len(events) <= 10
    assert sum(weight(event) for event in events) <= 100_000 + 10


def weight(event: Event) -> int:
    match event:
        case Violation(count=count) | Received(count=count):
            return count
        case _:
            return 1


@in_every_situation
def test_a_lost_line_ends_what_is_under_way_and_leaves_rest(situation: Situation) -> None:
    engine = situation.make()
    _, before = settle(engine, 0)
    engine.receive_closed(Closure.LOST, "unplugged", SECOND)
    _, after = settle(engine, SECOND)
    assert sum(isinstance(event, Ended) for event in before + after) == (0 if situation.name.endswith("idle") else 1)
    assert not engine.data_to_send(16)
