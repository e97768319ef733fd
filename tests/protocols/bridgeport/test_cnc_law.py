"""What holds for the control's end of REMOTE LOAD and DNC LINK whatever happens: its law, and an engine's contract."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND, Ended, Event, Events, LineFault, Received, Violation
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.cnc import LAW, Act, State
from tapewire.protocols.bridgeport.cnc_law import Cause, Word, vocabulary
from tapewire.protocols.bridgeport.messages import (
    FirstRecord,
    Hold,
    Mode,
    Params,
    Parity,
    StopBreach,
    TapeEnd,
)
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tapewire.protocols.settings import End, Switch
from tests.protocols.bridgeport.cnc_bench import DC1, DC2, DC3, DLE, EOT, ETB, ETX, Bench, P, record

GOOD, BAD = record(P), P + ETB + b"\x00"


def held(part: bytes, **fields: Any) -> Bench:
    """Stopped by XOFF within a record that is `part` so far."""
    bench = Bench.linking(hold=Hold.XOFF, buffer=300, **fields).receive(record(b"0" * 250)).said()
    return bench.receive(part).said()


def whole_save_leaving() -> Bench:
    bench = Bench().opened(P).receive(DC1)
    bench.hand_over()
    return bench


SITUATIONS: dict[str, Callable[[], Bench]] = {
    "at rest": Bench,
    "name opening, DC2 waits": lambda: Bench().start(),
    "name opening": lambda: Bench().start().said(),
    "name opening for a link": lambda: Bench(mode=Mode.LINK).start().said(),
    "name opening for a save": lambda: Bench().punch(P).said(),
    "name opening, DC2 said twice": lambda: Bench().start().said().wait(3).said(),
    "name opening, answers limited": lambda: Bench(answer_limit=2.0).start().said(),
    "asking": lambda: Bench().start().said().receive(DC1),
    "asking, a second answer to come": lambda: Bench().start().said().wait(3).said().receive(DC1),
    "asking without a name": lambda: Bench(program="-1").start(),
    "text due": lambda: Bench().asked(),
    "text due, a second answer to come": lambda: Bench().start().said().wait(3).said().receive(DC1).said(),
    "text due, answers limited": lambda: Bench(answer_limit=5.0).asked(),
    "loading": lambda: Bench().asked().receive(P),
    "loading, silence limited": lambda: Bench(load_timeout=5.0).asked().receive(P),
    "loading a tape": lambda: Bench(program="-1", tape_end=TapeEnd.PERCENT).start().said().receive(b"%"),
    "stopped": lambda: Bench(buffer=400).stopped(),
    "stopped, DC3 waits": lambda: Bench(buffer=400).asked().receive(b"0" * 368),
    "stopped, strict": lambda: Bench(stop_breach=StopBreach.CANCEL, buffer=400).stopped(),
    "record due": Bench.linking,
    "record due, a second answer to come": lambda: (
        Bench(mode=Mode.LINK).start().said().wait(3).said().receive(DC1).said()
    ),
    "record due, one in": lambda: Bench.linking().receive(GOOD).said(),
    "record due, one refused": lambda: Bench.linking(nak_quiet=0.0).receive(BAD).said(),
    "record due, one refused, EOT behind": lambda: (
        Bench.linking(nak_quiet=0.0, dnc_end=DncEnd.EOT_AFTER_LRC).receive(BAD).said()
    ),
    "record due, answers limited": lambda: Bench.linking(answer_limit=5.0),
    "record": lambda: Bench.linking().receive(P),
    "record, stopped": lambda: held(b"0" * 20),
    "record, stopped, strict": lambda: held(b"0" * 20, stop_breach=StopBreach.CANCEL).receive(b"000"),
    "check": lambda: Bench.linking().receive(P + ETB),
    "check, stopped": lambda: held(b"0" * 20).receive(ETB),
    "check, stopped, strict": lambda: held(b"0" * 20, stop_breach=StopBreach.CANCEL).receive(b"00" + ETB),
    "answering": lambda: Bench.linking().receive(GOOD),
    "answering, held": lambda: Bench.linking(buffer=300).receive(record(b"7" * 200)),
    "answering, stopped": lambda: held(b"0" * 20).receive(record(b"0" * 20)[-2:]),
    "answering, nothing in": lambda: Bench.linking().receive(record(b"")),
    "answering, NAK waits for quiet": lambda: Bench.linking().receive(BAD),
    "answering, last": lambda: Bench.linking(dnc_end=DncEnd.ETX_LAST).receive(GOOD),
    "answering, limited": lambda: Bench.linking(nak_limit=1).receive(BAD).quiet().said().receive(P + ETB),
    "received": lambda: Bench().asked().receive(P + EOT),
    "received, XON owed": lambda: Bench(late_xon=Switch.ON, buffer=400).stopped().receive(EOT),
    "save opening": lambda: Bench().opened(P),
    "save opening, DC2 waits": lambda: Bench().punch(P).said().wait(3).said().receive(DC1),
    "save opening without a name": lambda: Bench(program="-1").punch(P).said(),
    "save opening, answers limited": lambda: Bench(answer_limit=2.0).opened(P),
    "saving": lambda: Bench().saving(),
    "saving, a second answer to come": lambda: Bench().opened(P).wait(3).said().receive(DC1),
    "saving, source waits": lambda: Bench().opened(P, None).receive(DC1),
    "paused": lambda: Bench().saving().receive(DC3),
    "bare save to come": lambda: Bench(program="-1", bare_save=Switch.ON),
    "closing a load": lambda: Bench().asked().reset(),
    "closing a save": lambda: Bench().saving().reset(),
    "closing a whole save": whole_save_leaving,
}

DEEDS: dict[str, Callable[[Bench], object]] = {
    "cycle start": Bench.start,
    "save": lambda bench: bench.punch(P),
    "save, source waits": lambda bench: bench.punch(b"%", None, b"%"),
    "cancel": Bench.reset,
    "alarm": Bench.alarm,
    "all leaves": Bench.send,
    "all is handed over": Bench.hand_over,
    "time": lambda bench: bench.wait(20),
    "a character": lambda bench: bench.receive(b"x"),
    "a chunk": lambda bench: bench.receive(b"0" * 255),
    "a program": lambda bench: bench.receive(P + EOT),
    "a record": lambda bench: bench.receive(GOOD),
    "a bad record": lambda bench: bench.receive(BAD),
    "too much": lambda bench: bench.receive(b"0" * 400),
    "DC1": lambda bench: bench.receive(DC1),
    "DC2": lambda bench: bench.receive(DC2),
    "DC3": lambda bench: bench.receive(DC3),
    "DLE": lambda bench: bench.receive(DLE),
    "ETB": lambda bench: bench.receive(ETB),
    "EOT": lambda bench: bench.receive(EOT),
    "NUL": lambda bench: bench.receive(b"\x00"),
    "take a little": lambda bench: bench.take(1),
    "take": Bench.take,
    "a fault": Bench.fault,
    "a lost character": lambda bench: bench.fault(LineFault.UART_OVERRUN, None),
    "closed": Bench.close,
    "called back": lambda bench: bench.engine.data_discarded(3, bench.now),
}
STARTS = (DEEDS["cycle start"], DEEDS["save"], DEEDS["save, source waits"])


def do(bench: Bench, deed: Callable[[Bench], object]) -> int:
    """How many jobs that began: a start in the middle of another is refused; nothing else ever raises."""
    try:
        deed(bench)
    except UsageError:
        assert deed in STARTS
        return 0
    return int(deed in STARTS)


def moves_after(situation: str, deed: str) -> set[tuple[State, Cause, State]]:
    bench = SITUATIONS[situation]()
    do(bench, DEEDS[deed])
    return bench.engine.moves


def test_every_row_of_the_law_is_exercised_and_no_other() -> None:
    moves = set()
    for situation in SITUATIONS:
        for deed in DEEDS:
            moves |= moves_after(situation, deed)
    law = {(state, cause, to) for (state, cause), states in LAW.items() for to in states}
    assert moves == law


def test_the_law_leads_everywhere_and_back_to_rest() -> None:
    assert {state for state, _ in LAW} == set(State)
    assert {cause for _, cause in LAW} == {*Act, *Word}
    reached = {State.IDLE}
    for _ in State:
        reached |= {state for (state, _), states in LAW.items() if states & reached}
    assert reached == set(State)


@pytest.mark.parametrize("situation", SITUATIONS)
def test_every_code_in_every_state_has_a_row_or_is_uninvited(situation: str) -> None:
    """4.3.2 and 3.2 name what is obeyed; for all the rest there is one policy."""
    for code in range(128):
        bench = SITUATIONS[situation]()
        state, moves = bench.state, set(bench.engine.moves)
        offered = bench.engine.data_to_send(999)
        word = vocabulary(bench.params)[state][code]
        assert word is None or (state, word) in LAW
        before = len(bench.events)
        bench.receive(bytes([code]))
        if word is None:
            assert (bench.state, bench.engine.moves, bench.engine.data_to_send(999)) == (state, moves, offered)
            blank = state is State.RECEIVED and code in bench.params.ignore_rx
            assert len(bench.events) - before == (0 if blank else 1), "reported, once"


def merged(events: list[Event]) -> list[Event]:
    """As a driver sees them that drains once."""
    queue = Events()
    for event in events:
        queue.put(event)
    drained = [queue.get() for _ in range(len(queue))]
    return [event for event in drained if event is not None]


TEXT = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([P, GOOD, BAD, EOT, ETB, ETX, DC1, DC2, DC3, DLE, b"\x00", b"0" * 250, b"0" * 991, record(b"")]),
)


@pytest.mark.parametrize("situation", SITUATIONS)
@settings(max_examples=30)
@given(pieces=st.lists(TEXT, max_size=6), cuts=st.lists(st.integers(0, 2000), max_size=6))
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


SETTINGS = st.fixed_dictionaries(
    {
        "program": st.sampled_from(["-1", "7", "999999"]),
        "mode": st.sampled_from(Mode),
        "parity": st.sampled_from(Parity),
        "lrc": st.sampled_from(LRC_CANDIDATES),
        "dnc_end": st.sampled_from(DncEnd),
        "first_record": st.sampled_from(FirstRecord),
        "naming": st.sampled_from(Switch),
        "hold": st.sampled_from(Hold),
        "stop_breach": st.sampled_from(StopBreach),
        "late_xon": st.sampled_from(Switch),
        "tape_end": st.sampled_from(TapeEnd),
        "bare_save": st.sampled_from(Switch),
        "idle_cancel": st.sampled_from(Switch),
        "buffer": st.integers(300, 3000),
        "nak_limit": st.integers(0, 3),
        "after_stop": st.integers(0, 3),
        "repeat": st.sampled_from([0.0, 0.5, 3.0]),
        "record_timeout": st.sampled_from([0.0, 5.0]),
        "nak_quiet": st.sampled_from([0.0, 0.2]),
        "load_timeout": st.sampled_from([0.0, 5.0]),
        "answer_limit": st.sampled_from([0.0, 5.0]),
        "request_repeat": st.sampled_from([0.0, 3.0]),
        "operator_cancel": st.sampled_from([DC3 + DLE, DLE, DLE + EOT, b""]),
    }
)
DEED = st.one_of(
    st.sampled_from(sorted(DEEDS)).map(lambda name: DEEDS[name]),
    st.binary(max_size=300).map(lambda data: lambda bench: bench.receive(data)),
    st.integers(0, 1500).map(lambda count: lambda bench: bench.take(count)),
    st.integers(0, 30).map(lambda count: lambda bench: bench.left(count)),
    st.integers(0, 6000).map(lambda count: lambda bench: bench.wait(count / 1000)),
    st.just(lambda bench: bench.engine.handle_timer(bench.now)),
)


@given(fields=SETTINGS, deeds=st.lists(DEED, max_size=50))
def test_whatever_happens(fields: dict[str, Any], deeds: list[Callable[[Bench], object]]) -> None:
    bench = Bench(**fields)
    jobs = 0
    for deed in deeds:
        jobs += do(bench, deed)
        check(bench)
    bench.reset()
    bench.engine.data_discarded(0, bench.now)
    bench.send()
    assert len(bench.all(Ended)) == jobs, "a cancel brings the last one to its end too, and each ends once"
    assert (bench.engine.next_deadline(), bench.state, bench.engine.buffered) == (None, State.IDLE, 0)


def check(bench: Bench) -> None:
    engine = bench.engine
    assert 0 <= engine.buffered <= bench.params.buffer
    offered = engine.data_to_send(8)
    assert len(offered) <= 8
    assert offered.startswith(engine.data_to_send(1))
    assert not (offered and engine.recall)
    engine.handle_timer(bench.now)
    deadline = engine.next_deadline()
    assert deadline is None or deadline > bench.now
    engine.handle_timer(bench.now)
    assert engine.next_deadline() == deadline
    bench.drain()
    for event in bench.events:
        match event:
            case Ended(bytes_low=low, bytes_high=high):
                assert 0 <= low <= high
            case Violation(count=count) | Received(count=count):
                assert count > 0


@pytest.mark.parametrize("fields", [{}, {"mode": Mode.LINK}, {"program": "-1"}])
def test_a_silent_remote_for_a_day_costs_little(fields: dict[str, Any]) -> None:
    bench = Bench(**fields).start()
    said, wakes = len(bench.send()), 0
    while (deadline := bench.engine.next_deadline()) is not None and deadline <= 24 * 3600 * SECOND:
        bench.now, wakes = deadline, wakes + 1
        bench.engine.handle_timer(bench.now)
        said += len(bench.send())
    assert max(said, wakes) <= 24 * 3600 // 3 + 1
    assert len(bench.drain().events) <= 1


def test_a_long_link_is_not_kept() -> None:
    bench = Bench.linking()
    for number in range(500):
        text = b"%0256d" % number
        bench.receive(record(text))
        assert (bench.take(), bench.send()) == (text, b"\x06")
    assert (bench.engine.progress, bench.engine.buffered) == (128_000, 0)


def test_params_as_words() -> None:
    words = {"program": "-1", "hold": "xoff", "stop_breach": "cancel", "tape_end": "m30", "nak_quiet": "0"}
    params = Params.for_bridgeport(words, End.CONTROL)
    assert (params.hold, params.stop_breach, params.tape_end) == (Hold.XOFF, StopBreach.CANCEL, TapeEnd.M30)
    with pytest.raises(UsageError, match="of the control, not of the host"):
        Params.for_bridgeport({"hold": "xoff"}, End.HOST)
