"""The control's end, cancels and the contract of an engine: clause by clause of the text, without a host."""

from __future__ import annotations

from typing import Any

import pytest

from tapewire.engine import Closure, Notice, Outcome, SignalsIn, Violation
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.cnc import BridgeportCnc, State
from tapewire.protocols.bridgeport.cnc_output import Output
from tapewire.protocols.bridgeport.messages import Params, Parity
from tapewire.protocols.bridgeport.records import Lrc
from tapewire.protocols.settings import Switch
from tests.protocols.bridgeport.cnc_bench import CANCEL, DC3, DC4, DLE, EOT, NAK, Bench, P

# 4.3: the operator cancels


@pytest.mark.parametrize("pair", [DC3 + DLE, DLE + EOT, DLE + DLE, DLE + DC3, DLE + DC4, DLE, DLE + NAK, DLE + b"\x18"])
def test_4_3_2_cancel_in_every_pair(pair: bytes) -> None:
    bench = Bench(operator_cancel=pair).asked().receive(P)
    bench.take(5)
    bench.reset()
    assert bench.take() == b""
    assert (bench.hand_over(), bench.end()) == (pair, None)
    bench.left(len(pair))
    assert (bench.end(), bench.state) == ((Outcome.CANCELLED, 5, 18), State.IDLE)


@pytest.mark.parametrize(
    "bench",
    [
        pytest.param(lambda: Bench().start(), id="before DC2"),
        pytest.param(lambda: Bench().start().said(), id="after DC2"),
        pytest.param(lambda: Bench().asked(), id="text due"),
        pytest.param(lambda: Bench().stopped(), id="stopped"),
        pytest.param(Bench.linking, id="record due"),
        pytest.param(lambda: Bench.linking().receive(b"N1"), id="record"),
        pytest.param(lambda: Bench.linking().receive(b"N1\x17"), id="check"),
        pytest.param(lambda: Bench.linking().receive(b"N1\x17\x00"), id="answering"),
        pytest.param(lambda: Bench().opened(P), id="save opening"),
        pytest.param(lambda: Bench().saving(), id="saving"),
        pytest.param(lambda: Bench().saving().receive(DC3), id="paused"),
    ],
)
def test_4_3_1_cancel_and_alarm_wherever_it_stands(bench: Any) -> None:
    cancelled, alarmed = bench().reset(), bench().alarm()
    for done, said, outcome in ((cancelled, CANCEL, Outcome.CANCELLED), (alarmed, DLE, Outcome.FAILED)):
        if done.engine.recall:
            done.engine.data_discarded(0, done.now)
        assert done.send() == said
        assert done.ended().outcome is outcome
        assert (done.engine.next_deadline(), done.state) == (None, State.IDLE)


def test_4_3_1_a_second_cancel_says_no_more() -> None:
    bench = Bench().asked().reset().reset().alarm()
    assert bench.send() == CANCEL
    assert bench.ended().outcome is Outcome.CANCELLED


def test_4_3_1_at_rest_the_cancel_is_said_too() -> None:
    assert Bench().reset().reset().send() == CANCEL
    assert Bench(idle_cancel=Switch.OFF).reset().send() == b""
    assert Bench().alarm().send() == b""
    assert Bench().reset().events == []


def test_4_3_1_cancel_when_all_is_in() -> None:
    bench = Bench().asked().receive(P + EOT)
    bench.take(3)
    assert bench.reset().send() == CANCEL
    assert bench.end() == (Outcome.CANCELLED, 3, 18)
    silent = Bench(idle_cancel=Switch.OFF).asked().receive(P + EOT).alarm()
    assert (silent.send(), silent.end()) == (b"", (Outcome.FAILED, 0, 18))


def test_4_3_2_what_comes_before_the_cancel_has_left_and_three_more_are_no_violation() -> None:
    bench = Bench().asked().receive(b"N1").reset().receive(b"0" * 100)
    bench.send()
    bench.receive(b"123")
    assert (bench.all(Violation), len(bench.all(Notice))) == ([], 1)
    bench.receive(b"4")
    assert len(bench.all(Violation)) == 1


# the contract


@pytest.mark.parametrize("closure", list(Closure))
def test_a_closed_line_ends_the_job_and_says_nothing(closure: Closure) -> None:
    bench = Bench().asked().receive(P).close(closure)
    assert (bench.send(), bench.end()) == (b"", (Outcome.FAILED, 0, 18))
    assert bench.ended().reason == f"the line is {closure}: end of file"
    with pytest.raises(UsageError, match="its line is closed"):
        bench.start()
    assert bench.reset().send() == b""


def test_a_closed_line_does_not_matter_when_all_is_in() -> None:
    bench = Bench().asked().receive(P + EOT).close()
    assert (bench.take(), bench.end()) == (P, (Outcome.COMPLETE, 18, 18))


def test_a_closed_line_needs_no_cancel_to_leave() -> None:
    bench = Bench().asked().receive(P + EOT).close().reset()
    assert (bench.send(), bench.end()) == (b"", (Outcome.CANCELLED, 0, 18))
    saving = Bench().saving()
    saving.engine.data_sent(len(saving.engine.data_to_send(6)), saving.now)
    assert saving.reset().engine.recall
    assert (saving.close().engine.recall, saving.end()) == (False, (Outcome.CANCELLED, 4, 10))


def test_what_is_called_back_is_not_waited_for() -> None:
    output = Output(Parity.LINE)
    output.say(CANCEL)
    output.hand_over_code()
    output.hand_over_code()
    assert not output.codes_have_left
    output.call_back(2)
    assert output.codes_have_left


def test_a_running_job_is_not_started_again() -> None:
    bench = Bench().asked()
    with pytest.raises(UsageError, match="cannot load now: the text of a REMOTE LOAD is awaited; wait, or cancel"):
        bench.start()
    with pytest.raises(UsageError, match="cannot save now"):
        bench.punch(P)


def test_modem_lines_say_nothing() -> None:
    bench = Bench().asked()
    bench.engine.receive_signals(SignalsIn(cts=False, dsr=False, cd=False), 0)
    assert (bench.state, bench.engine.signals.dtr, bench.engine.signals.rts) == (State.TEXT_DUE, True, True)


def test_a_control_has_one_lrc() -> None:
    with pytest.raises(UsageError, match="lrc=auto"):
        BridgeportCnc(Params(lrc=Lrc.AUTO))


@pytest.mark.parametrize(("stop", "start", "buffer"), [(40, 40, 1024), (40, 770, 1024), (44, 0, 300)])
def test_thresholds_that_could_never_work_are_refused(stop: int, start: int, buffer: int) -> None:
    with pytest.raises(UsageError, match=f"stop_at_free={stop}"):
        Params(stop_at_free=stop, start_at_free=start, buffer=buffer)
