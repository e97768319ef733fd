"""What holds for the control's end of protocol B whatever happens: its law, and the contract of an engine."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode
from tapewire.engine import MILLISECOND, Ended, Event, Events, Received, Violation
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.cnc import LAW, Act, State
from tapewire.protocols.fanuc_b.cnc_law import Cause
from tapewire.protocols.fanuc_b.messages import (
    BUFFER_BYTES,
    EXPANSION_B,
    AlarmEnds,
    ClosingAt,
    ControlCode,
    Params,
    Resume,
)
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_b.cnc_bench import DC1, DC2, DC3, PROGRAM, Bench

AT_RESET = Params(alarm=AlarmEnds.AT_RESET)
AT_RECEIVED = Params(closing=ClosingAt.RECEIVED)

SITUATIONS: dict[str, Callable[[], Bench]] = {
    "at rest": Bench,
    "starting": lambda: Bench().start(),
    "reading": lambda: Bench().reading(),
    "reading, some in": lambda: Bench().reading().receive(PROGRAM[:9]),
    "reading, EOR in": lambda: Bench().reading().receive(PROGRAM),
    "reading, alarm waits for RESET": lambda: Bench(AT_RESET).reading(),
    "reading until EOR comes in": lambda: Bench(AT_RECEIVED).reading(),
    "stopped": lambda: Bench().stopped(),
    "stopped, EOR in": lambda: Bench().stopped().receive(PROGRAM),
    "stopped, alarm waits for RESET": lambda: Bench(AT_RESET).stopped(),
    "stopped until EOR comes in": lambda: Bench(AT_RECEIVED).stopped(),
    "received": lambda: Bench(AT_RECEIVED).reading().receive(PROGRAM),
    "opening": lambda: Bench().punch(bytes(1000)),
    "punching": lambda: Bench().punching(),
    "punching, resumed by DC2": lambda: Bench(Params(resume=Resume.DC2)).punching(),
    "punching, alarm waits for RESET": lambda: Bench(AT_RESET).punching(),
    "punching, source waits": lambda: Bench().punch(b"%", None),
    "paused": lambda: Bench().punching().receive(DC3),
    "paused, resumed by DC2": lambda: Bench(Params(resume=Resume.DC2)).punching().receive(DC3),
    "paused, alarm waits for RESET": lambda: Bench(AT_RESET).punching().receive(DC3),
    "closing a read": lambda: Bench().reading().reset(),
    "closing a punch-out": lambda: Bench().punching().reset(),
    "closing, held back by CS": lambda: Bench().reading().signals(cts=False).reset(),
}

DEEDS: dict[str, Callable[[Bench], object]] = {
    "cycle start": Bench.start,
    "punch-out": lambda bench: bench.punch(PROGRAM),
    "punch-out, source waits": lambda bench: bench.punch(b"%", None, b"%"),
    "RESET": Bench.reset,
    "alarm": Bench.alarm,
    "all leaves": Bench.send,
    "a character": lambda bench: bench.receive(b"x"),
    "a chunk": lambda bench: bench.receive(bytes(7680)),
    "program": lambda bench: bench.receive(PROGRAM),
    "too much": lambda bench: bench.receive(bytes(9000)),
    "DC1": lambda bench: bench.receive(DC1),
    "DC2": lambda bench: bench.receive(DC2),
    "DC3": lambda bench: bench.receive(DC3),
    "take a little": lambda bench: bench.take(1),
    "take": Bench.take,
    "a fault": Bench.fault,
    "CS OFF": lambda bench: bench.signals(cts=False),
    "DR OFF": lambda bench: bench.signals(dsr=False),
    "all ON": Bench.signals,
    "closed": Bench.close,
    "called back": lambda bench: bench.engine.data_discarded(3, bench.now),
}
STARTS = (DEEDS["cycle start"], DEEDS["punch-out"], DEEDS["punch-out, source waits"])


def do(bench: Bench, deed: Callable[[Bench], object]) -> int:
    """How many jobs that began: a start in the middle of another is refused; nothing else ever raises."""
    try:
        deed(bench)
    except UsageError:
        assert deed in STARTS
        return 0
    return int(deed in STARTS)


def moves_after(deeds: tuple[str, ...]) -> set[tuple[State, Cause, State]]:
    moves = set()
    for situation in SITUATIONS.values():
        bench = situation()
        for deed in deeds:
            do(bench, DEEDS[deed])
        moves |= bench.engine.moves
    return moves


def test_every_row_of_the_law_is_exercised_and_no_other() -> None:
    moves = set()
    for first in DEEDS:
        for second in DEEDS:
            moves |= moves_after((first, second))
    law = {(state, cause, to) for (state, cause), states in LAW.items() for to in states}
    assert moves == law


def test_the_law_leads_everywhere_and_back_to_rest() -> None:
    assert {state for state, _ in LAW} == set(State)
    assert {cause for _, cause in LAW} == {*Act, ControlCode.DC1, ControlCode.DC2, ControlCode.DC3}
    reached = {State.IDLE}
    for _ in State:
        reached |= {state for (state, _), states in LAW.items() if states & reached}
    assert reached == set(State)


def merged(events: list[Event]) -> list[Event]:
    """As a driver sees them that drains once."""
    queue = Events()
    for event in events:
        queue.put(event)
    drained = [queue.get() for _ in range(len(queue))]
    return [event for event in drained if event is not None]


TEXT = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([PROGRAM, PROGRAM[:-1], b"%", b"\n", DC1, DC2, DC3, bytes(600), bytes(7679), bytes(9000)]),
)


@pytest.mark.parametrize("situation", SITUATIONS)
@given(pieces=st.lists(TEXT, max_size=6), cuts=st.lists(st.integers(0, 9000), max_size=6))
def test_any_cutting_of_what_comes_at_one_moment_is_the_same(
    situation: str, pieces: list[bytes], cuts: list[int]
) -> None:
    data = b"".join(pieces)
    whole, cut = SITUATIONS[situation](), SITUATIONS[situation]()
    whole.receive(data)
    edges = [0, *sorted(min(edge, len(data)) for edge in cuts), len(data)]
    for first, last in pairwise(edges):
        cut.receive(data[first:last])
    assert whole.send() == cut.send()
    assert whole.take() == cut.take()
    assert whole.send() == cut.send()
    assert merged(whole.events) == merged(cut.events)
    assert whole.engine.next_deadline() == cut.engine.next_deadline()


PARAMS = st.builds(
    Params,
    limits=st.sampled_from([Params().limits, EXPANSION_B]),
    posting=st.sampled_from(Switch),
    resume=st.sampled_from(Resume),
    data=st.sampled_from(DataCode),
    closing=st.sampled_from(ClosingAt),
    alarm=st.sampled_from(AlarmEnds),
    idle_posting=st.sampled_from(Switch),
    punch_overrun=st.integers(0, 600),
    overrun=st.integers(0, 2560),
)
DEED = st.one_of(
    st.sampled_from(sorted(DEEDS)).map(lambda name: DEEDS[name]),
    st.binary(max_size=300).map(lambda data: lambda bench: bench.receive(data)),
    st.integers(0, 5000).map(lambda count: lambda bench: bench.take(count)),
    st.integers(0, 30).map(lambda count: lambda bench: bench.left(count)),
    st.just(lambda bench: bench.hand_over()),
    st.just(lambda bench: bench.engine.handle_timer(bench.now)),
)


@given(params=PARAMS, deeds=st.lists(st.tuples(DEED, st.integers(0, 11)), max_size=60))
def test_whatever_happens(params: Params, deeds: list[tuple[Callable[[Bench], object], int]]) -> None:
    bench = Bench(params)
    jobs = 0
    for deed, milliseconds in deeds:
        bench.now += milliseconds * MILLISECOND
        jobs += do(bench, deed)
        check(bench)
    bench.signals().reset()
    bench.engine.data_discarded(0, bench.now)
    bench.send()
    assert len(bench.all(Ended)) == jobs, "RESET brings the last one to its end too, and each ends once"
    assert bench.engine.next_deadline() is None


def check(bench: Bench) -> None:
    engine = bench.engine
    assert 0 <= engine.buffered <= BUFFER_BYTES
    offered = engine.data_to_send(8)
    assert len(offered) <= 8
    assert not (offered and engine.recall)
    assert not (offered and not (bench.seen.cts and bench.seen.dsr)), "3.2"
    engine.handle_timer(bench.now)
    deadline = engine.next_deadline()
    assert deadline is None or deadline > bench.now
    bench.drain()
    for event in bench.events:
        match event:
            case Ended(bytes_low=low, bytes_high=high):
                assert 0 <= low <= high
            case Violation(count=count) | Received(count=count):
                assert count > 0


def test_a_long_program_is_not_kept() -> None:
    bench = Bench().reading()
    for _ in range(2000):
        bench.receive(bytes(216))
        assert bench.take() == bytes(216)
    assert (bench.engine.progress, bench.engine.buffered) == (432_000, 0)
