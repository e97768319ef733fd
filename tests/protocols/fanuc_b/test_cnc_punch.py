"""The control's end of protocol B, punching out: clause by clause of B-63322EN-1, without a host."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tapewire.engine import MILLISECOND, Alarm, Ended, Held, Outcome, Resumed, Started, Violation
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.messages import AlarmEnds, CodeSystem, Params, Resume
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_b.cnc_bench import DC1, DC2, DC3, DC4, NAK, PROGRAM, SYN, Bench

NOT_POSTING = Params(posting=Switch.OFF)


def test_6_1_1_2_dc2_the_data_dc4() -> None:
    bench = Bench().punch(PROGRAM)
    assert bench.hand_over(7) == DC2 + PROGRAM + DC4
    assert len(bench.all(Started)) == 1
    bench.left(len(PROGRAM) + 1)
    assert bench.end() is None, "the DC4 has not left"
    bench.left(1)
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))
    assert bench.engine.progress == len(PROGRAM)


def test_6_1_1_2_without_posting_er_is_on_for_the_punch_out_only() -> None:
    bench = Bench(NOT_POSTING)
    assert not bench.er
    bench.punch(PROGRAM)
    assert bench.er
    assert bench.send() == DC2 + PROGRAM + DC4
    assert not bench.er
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))


def test_6_1_1_2_dc2_waits_until_dr_and_cs_are_on() -> None:
    bench = Bench().signals(cts=False, dsr=False).punch(PROGRAM)
    assert bench.send() == b""
    assert bench.signals().send() == DC2 + PROGRAM + DC4


def test_a_source_that_has_nothing_yet_is_asked_again() -> None:
    bench = Bench().punch(b"O1\n", None, None, b"%")
    assert bench.send() == DC2 + b"O1\n"
    for _ in range(2):
        deadline = bench.engine.next_deadline()
        assert deadline == bench.now + 10 * MILLISECOND
        bench.engine.handle_timer(deadline - 1)
        assert bench.send() == b""
        bench.now = deadline
        bench.engine.handle_timer(bench.now)
    assert bench.engine.next_deadline() is None
    assert bench.send() == b"%" + DC4


def test_an_empty_source_is_an_empty_punch_out() -> None:
    bench = Bench().punch()
    assert bench.send() == DC2 + DC4
    assert bench.end() == (Outcome.COMPLETE, 0, 0)


def test_6_1_1_2_3_a_cs_off_stops_at_once_and_cs_on_goes_on_with_the_next_character() -> None:
    bench = Bench().punch(PROGRAM)
    assert bench.engine.data_to_send(1) == DC2
    bench.engine.data_sent(1, 0)
    bench.engine.data_sent(len(bench.engine.data_to_send(5)), 0)
    bench.signals(cts=False).signals(cts=False)
    assert bench.send() == b""
    assert bench.signals().send() == PROGRAM[5:] + DC4
    assert [event.why for event in bench.all(Held)] == ["CS is OFF"]
    assert [event.why for event in bench.all(Resumed)] == ["CS is ON"]


def test_6_1_1_2_3_a_cs_off_holds_the_dc4_back_too() -> None:
    bench = Bench().punch(b"%", None)
    assert bench.send() == DC2 + b"%"
    bench.signals(cts=False)
    bench.engine.handle_timer(10 * MILLISECOND)
    assert (bench.send(), bench.end()) == (b"", None)
    assert bench.signals().send() == DC4
    assert len(bench.all(Resumed)) == 1


@pytest.mark.parametrize("dc3", [b"\x13", b"\x93"])
@pytest.mark.parametrize(
    ("posting", "resume", "code", "other"),
    [
        (Switch.ON, Resume.AUTO, DC1, DC2),
        (Switch.OFF, Resume.AUTO, DC2, DC1),
        (Switch.OFF, Resume.DC1, DC1, DC2),
        (Switch.ON, Resume.DC2, DC2, DC1),
    ],
)
def test_6_1_1_2_3_b_dc3_pauses_and_the_code_agreed_on_resumes(
    posting: Switch, resume: Resume, code: bytes, other: bytes, dc3: bytes
) -> None:
    bench = Bench(Params(posting=posting, resume=resume, punch_overrun=16)).punching(4).receive(dc3)
    assert bench.send(5) == bytes(16)
    assert not bench.all(Violation)
    bench.receive(other + dc3)
    assert (bench.send(), sum(event.count for event in bench.all(Violation))) == (b"", 2)
    bench.receive(code)
    assert bench.send() == bytes(1000 - 20) + DC4
    assert (len(bench.all(Held)), len(bench.all(Resumed))) == (1, 1)
    assert bench.end() == (Outcome.COMPLETE, 1000, 1000)


def test_6_3_a_control_that_stops_at_once_after_dc3() -> None:
    bench = Bench(Params(punch_overrun=0)).punching().receive(DC3)
    assert bench.send() == b""


def test_6_1_1_2_3_b_dc4_waits_for_the_host_to_resume() -> None:
    bench = Bench(Params(punch_overrun=2000)).punching().receive(DC3)
    assert (bench.send(), bench.end()) == (bytes(996), None)
    assert bench.receive(DC1).send() == DC4


def test_6_1_1_2_codes_out_of_place_and_what_is_no_code_are_violations() -> None:
    bench = Bench().punching().receive(b"\x11\x12AB\x14")
    assert sum(event.count for event in bench.all(Violation)) == 5
    assert bench.send() == bytes(996) + DC4


# 6.1.2 and 6.4: reset and alarm


@pytest.mark.parametrize("paused", [False, True])
@pytest.mark.parametrize(
    ("act", "code", "outcome"), [(Bench.reset, SYN, Outcome.CANCELLED), (Bench.alarm, NAK, Outcome.FAILED)]
)
def test_6_1_2_2_5_dc4_and_syn_or_nak(
    act: Callable[[Bench], Bench], code: bytes, outcome: Outcome, paused: bool
) -> None:
    bench = Bench().punching(4)
    if paused:
        bench.receive(DC3)
    act(bench)
    assert bench.hand_over() == DC4 + code
    assert bench.end() is None
    bench.left(2)
    assert bench.end() == (outcome, 4, 4)


def test_6_1_2_2_5_the_codes_of_5000_2() -> None:
    assert Bench(Params(code=CodeSystem.ASCII)).punching().reset().send() == b"\x14\x16"


@pytest.mark.parametrize("act", [Bench.reset, Bench.alarm])
def test_6_4_1_without_posting_dc3_then_er_off(act: Callable[[Bench], Bench]) -> None:
    bench = act(Bench(NOT_POSTING).punching(4))
    assert (bench.hand_over(), bench.er) == (DC3, True)
    bench.left(1)
    assert not bench.er


@pytest.mark.parametrize("params", [Params(), NOT_POSTING])
@pytest.mark.parametrize("act", [Bench.reset, Bench.alarm])
def test_6_1_2_note_while_cs_is_off_nothing_is_sent_then_or_later(
    act: Callable[[Bench], Bench], params: Params
) -> None:
    bench = act(Bench(params).punching(4).signals(cts=False))
    assert (bench.send(), bench.end() is not None) == (b"", True)
    assert bench.signals().send() == b""
    assert bench.er is (params.posting is Switch.ON)


def test_6_1_2_no_dc4_without_its_syn() -> None:
    bench = Bench().signals(cd=False).punching(4).reset()
    assert (bench.send(), bench.end()) == (b"", (Outcome.CANCELLED, 4, 4))


@pytest.mark.parametrize("act", [Bench.reset, Bench.alarm])
def test_6_1_2_note_a_dc4_that_cs_holds_back_is_given_up(act: Callable[[Bench], Bench]) -> None:
    bench = Bench().punch(b"%")
    assert bench.engine.data_to_send(1) == DC2
    bench.engine.data_sent(1, 0)
    bench.engine.data_sent(1, 0)
    bench.left(2)
    act(bench.signals(cts=False))
    assert bench.end() is not None
    assert bench.signals().send() == b""


def test_6_4_note_2_reset_calls_back_what_waits_in_the_line() -> None:
    bench = Bench().punch(bytes(100), None)
    assert bench.hand_over() == DC2 + bytes(100)
    bench.left(11)
    bench.reset()
    assert bench.engine.recall
    assert bench.engine.data_to_send(10) == b""
    bench.engine.data_discarded(70, 0)
    assert not bench.engine.recall
    assert bench.send() == DC4 + SYN
    assert bench.end() == (Outcome.CANCELLED, 30, 30)


def test_6_4_note_2_with_cs_off_the_end_comes_with_the_answer_to_the_recall() -> None:
    bench = Bench().punch(bytes(100), None)
    bench.hand_over()
    bench.left(11)
    bench.signals(cts=False).reset()
    assert (bench.engine.recall, bench.end()) == (True, None)
    bench.engine.data_discarded(74, 0)
    bench.drain()
    assert bench.end() == (Outcome.CANCELLED, 10, 26)


def test_6_4_note_2_when_even_dc2_came_back_no_dc4_follows() -> None:
    bench = Bench().punch(bytes(9), None)
    bench.hand_over()
    bench.reset()
    bench.engine.data_discarded(10, 0)
    assert bench.send() == SYN
    assert bench.end() == (Outcome.CANCELLED, 0, 0)


def test_6_4_note_2_without_posting_nothing_is_left_to_say_then() -> None:
    bench = Bench(NOT_POSTING).punch(bytes(9), None)
    bench.hand_over()
    bench.reset()
    bench.engine.data_discarded(10, 0)
    assert (bench.send(), bench.end()) == (b"", (Outcome.CANCELLED, 0, 0))


def test_6_4_note_2_what_cannot_be_called_back_is_not_waited_for_while_cs_is_off() -> None:
    bench = Bench().punch(bytes(9), None)
    bench.hand_over()
    bench.signals(cts=False).reset()
    bench.engine.data_discarded(0, 0)
    bench.drain()
    assert bench.end() == (Outcome.CANCELLED, 0, 9)


def test_6_4_note_2_a_recall_ends_with_the_host() -> None:
    bench = Bench().punch(bytes(9), None)
    bench.hand_over()
    bench.reset().signals(dsr=False)
    assert (bench.engine.recall, bench.end()) == (False, (Outcome.CANCELLED, 0, 9))


def test_6_4_note_2_neither_an_alarm_nor_an_empty_line_calls_back() -> None:
    bench = Bench().punch(bytes(9), None)
    bench.hand_over()
    assert not bench.alarm().engine.recall
    assert not Bench().punching(4).reset().engine.recall


def test_6_4_note_1_at_reset_the_punch_out_outlives_the_alarm() -> None:
    params = Params(alarm=AlarmEnds.AT_RESET)
    bench = Bench(params).punching(4).alarm()
    assert bench.end() is None
    assert len(bench.engine.data_to_send(10)) == 10
    assert bench.reset().send() == DC4 + NAK
    assert bench.end() == (Outcome.FAILED, 4, 4)
    whole = Bench(params).punching(4).alarm()
    assert whole.send() == bytes(996) + DC4
    assert whole.end() == (Outcome.COMPLETE, 1000, 1000)


def test_a_hold_that_ends_with_the_job_is_not_resumed() -> None:
    bench = Bench().punching(4).receive(DC3).reset().signals()
    other = Bench().punching(4).signals(cts=False).reset().signals()
    assert (bench.all(Resumed), other.all(Resumed)) == ([], [])
    last = Bench().punch(b"%")
    last.engine.data_sent(1, 0)
    last.signals(cts=False).engine.data_sent(1, 0)
    assert last.reset().signals().all(Resumed) == []


def test_a_source_is_not_asked_after_the_job() -> None:
    bench = Bench().punch(b"%", None, b"%")
    bench.send()
    bench.reset()
    assert bench.engine.next_deadline() is None


def test_jobs_follow_one_another() -> None:
    bench = Bench().punch(PROGRAM)
    assert bench.send() == DC2 + PROGRAM + DC4
    bench.punch(b"%", None)
    assert bench.send() == DC2 + b"%"
    bench.receive(DC3 + DC1)
    assert bench.send() == b"", "the source is not at its end"
    bench.engine.handle_timer(10 * MILLISECOND)
    assert bench.send() == DC4
    bench.punch(b"%").signals(cts=False).reset()
    assert [(event.bytes_low, event.bytes_high) for event in bench.all(Ended)] == [(23, 23), (1, 1), (0, 0)]
    bench.signals().reading().receive(PROGRAM)
    assert (bench.take(5), bench.engine.progress) == (PROGRAM[:5], 5)


@pytest.mark.parametrize("act", [Bench.reset, Bench.alarm])
def test_6_4_before_dc2_went_out_there_is_nothing_to_end(act: Callable[[Bench], Bench]) -> None:
    bench = act(Bench().punch(PROGRAM))
    assert bench.send() == (SYN if act is Bench.reset else NAK)
    assert bench.end() is not None


# 3.2 and chapter 11: the line


@pytest.mark.parametrize("gone", [Bench.close, lambda bench: bench.signals(dsr=False)])
@pytest.mark.parametrize("paused", [False, True])
def test_11_sr855_the_host_is_gone(gone: Callable[[Bench], object], paused: bool) -> None:
    bench = Bench(NOT_POSTING).punching(4)
    if paused:
        bench.receive(DC3)
    gone(bench)
    assert (bench.send(), bench.er) == (b"", False)
    assert bench.all(Alarm)[0].number == "SR855"
    assert bench.end() == (Outcome.FAILED, 4, 4)


def test_11_sr855_before_the_dc4_has_left_the_punch_out_is_not_complete() -> None:
    bench = Bench().punch(PROGRAM)
    bench.hand_over()
    bench.left(3)
    bench.signals(dsr=False)
    assert bench.end() == (Outcome.FAILED, 2, len(PROGRAM))
    assert len(bench.all(Alarm)) == 1


def test_11_sr946_in_a_punch_out() -> None:
    bench = Bench().punching(4).fault()
    assert bench.send() == DC4 + NAK
    assert "4 characters into the punch-out" in bench.all(Alarm)[0].text
    assert bench.end() == (Outcome.FAILED, 4, 4)


def test_a_host_that_is_late_with_its_codes_breaks_no_rule() -> None:
    bench = Bench().punch(PROGRAM)
    bench.send()
    bench.receive(DC3)
    assert not bench.all(Violation)


def test_a_running_punch_out_is_not_started_again() -> None:
    with pytest.raises(UsageError, match="cannot punch out now: the program goes out"):
        Bench().punching().punch(PROGRAM)
