"""The control's end of protocol B, reading: clause by clause of B-63322EN-1, without a host."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode
from tapewire.engine import AfterStop, Alarm, Closure, LineFault, Notice, Outcome, Started, Violation
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.messages import (
    EXPANSION_B,
    PROTOCOL_B,
    AlarmEnds,
    ClosingAt,
    CodeSystem,
    Limits,
    Params,
)
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_b.cnc_bench import DC1, DC3, NAK, PROGRAM, SYN, Bench, Tape

NOT_POSTING = Params(posting=Switch.OFF)
AT_RESET = Params(alarm=AlarmEnds.AT_RESET)
AT_RECEIVED = Params(closing=ClosingAt.RECEIVED)


# 6.1.1 1): the remote buffer receives, nothing is posted


def test_6_1_1_er_comes_on_with_the_read_and_dc1_asks_for_data() -> None:
    bench = Bench(NOT_POSTING)
    assert not bench.er
    bench.start()
    assert bench.er
    assert bench.send() == DC1
    assert len(bench.all(Started)) == 1


def test_6_1_1_7_dc3_ends_a_whole_read_and_er_goes_off_when_it_has_left() -> None:
    bench = Bench(NOT_POSTING).reading().receive(PROGRAM)
    assert bench.engine.buffered == len(PROGRAM)
    assert bench.take() == PROGRAM
    assert bench.engine.program_ended
    assert bench.hand_over() == DC3
    assert (bench.er, bench.end()) == (True, None)
    bench.left(1)
    assert (bench.er, bench.end()) == (False, (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM)))
    assert bench.engine.progress == len(PROGRAM)


def test_6_1_1_7_the_program_has_not_ended_before_its_eor_is_taken() -> None:
    bench = Bench().reading().receive(PROGRAM)
    assert bench.take(len(PROGRAM) - 1) == PROGRAM[:-1]
    assert (bench.engine.program_ended, bench.send(), bench.end()) == (False, b"", None)
    assert bench.take() == b"%"
    assert (bench.engine.program_ended, bench.send()) == (True, DC3)


def test_6_1_1_a_second_program_is_read_after_the_first() -> None:
    bench = Bench().reading().receive(PROGRAM)
    bench.take()
    bench.send()
    bench.events.clear()
    bench.reading()
    assert not bench.engine.program_ended
    bench.receive(PROGRAM[:9])
    assert bench.take() == PROGRAM[:9]


def test_8_2_closing_received_dc3_as_soon_as_eor_is_in_and_the_rest_is_read_afterwards() -> None:
    bench = Bench(Params(closing=ClosingAt.RECEIVED, posting=Switch.OFF)).reading().receive(PROGRAM)
    assert bench.send() == DC3
    assert (bench.er, bench.end(), bench.engine.program_ended) == (False, None, False)
    assert bench.take() == PROGRAM
    assert bench.send() == b""
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))


def test_8_2_closing_received_er_waits_for_the_dc3_and_not_for_the_dc1() -> None:
    bench = Bench(Params(closing=ClosingAt.RECEIVED, posting=Switch.OFF)).start()
    assert bench.hand_over() == DC1
    bench.receive(PROGRAM)
    bench.left(1)
    assert bench.er
    assert bench.send() == DC3
    assert not bench.er


def test_8_2_closing_received_the_end_waits_for_its_dc3_to_leave() -> None:
    bench = Bench(AT_RECEIVED).reading().receive(PROGRAM)
    bench.take()
    assert bench.hand_over() == DC3
    assert bench.end() is None
    bench.left(1)
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))


@pytest.mark.parametrize("params", [Params(), AT_RECEIVED])
def test_8_2_what_follows_eor_is_ignored_and_told_once(params: Params) -> None:
    bench = Bench(params).reading().receive(PROGRAM + b"\n\n").receive(b"O0002\n%")
    assert bench.engine.buffered == len(PROGRAM)
    assert bench.take() == PROGRAM
    bench.receive(b"\x1a")
    bench.send()
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))
    assert [notice.text for notice in bench.all(Notice)] == ["10 characters after EOR were ignored (8.2)"]


def test_8_2_label_skip_the_leading_percent_is_no_end_and_binary_has_none() -> None:
    bench = Bench(Params(data=DataCode.BINARY)).reading().receive(PROGRAM)
    assert bench.take() == PROGRAM
    assert (bench.engine.program_ended, bench.send()) == (False, b"")


def test_3_2_the_first_code_waits_until_dr_and_cs_are_on() -> None:
    bench = Bench().signals(cts=False, dsr=False, cd=False).start()
    assert bench.send() == b""
    assert "DR is OFF" in bench.all(Notice)[0].text
    assert bench.signals(cts=False).send() == b""
    assert bench.signals().send() == DC1
    assert bench.end() is None


# 6.3: buffer control


@pytest.mark.parametrize("limits", [PROTOCOL_B, EXPANSION_B])
@given(cuts=st.lists(st.integers(1, 216), max_size=80))
def test_6_3_dc3_at_the_level_and_dc1_at_the_level(limits: Limits, cuts: list[int]) -> None:
    bench = Bench(Params(limits=limits)).reading()
    first_stop = 8192 - limits.stop_at_free
    for cut in [*cuts, *[216] * 40]:
        count = min(cut, first_stop - 1 - bench.engine.buffered)
        bench.receive(bytes(count))
    assert (bench.engine.buffered, bench.send()) == (first_stop - 1, b"")
    bench.receive(b"X")
    assert bench.send() == DC3
    assert bench.take(first_stop - 4097) == bytes(first_stop - 4097)
    assert (8192 - bench.engine.buffered, bench.send()) == (4095, b"")
    bench.take(1)
    assert bench.send() == DC1
    assert bench.all(AfterStop) == [AfterStop(count=0, allowed=limits.overrun)]


def test_6_3_characters_count_as_overrun_once_dc3_has_left_completely() -> None:
    bench = Bench().reading().receive(bytes(7680))
    bench.receive(b"a")
    assert bench.hand_over() == DC3
    bench.receive(b"b")
    bench.left(1)
    bench.receive(b"cde")
    bench.take(4000)
    bench.take(4000)
    assert bench.send() == DC1
    assert bench.all(AfterStop) == [AfterStop(count=3, allowed=511)]
    bench.receive(PROGRAM)
    assert not bench.all(Violation)


def test_6_3_after_stop_is_told_at_the_end_too() -> None:
    bench = Bench().stopped().receive(b"12345").reset()
    assert bench.all(AfterStop) == [AfterStop(count=5, allowed=511)]


@pytest.mark.parametrize(("limits", "overrun", "allowed"), [(PROTOCOL_B, 0, 511), (EXPANSION_B, 0, 1280)])
def test_6_3_and_7_overrun_as_allowed_is_borne(limits: Limits, overrun: int, allowed: int) -> None:
    bench = Bench(Params(limits=limits, overrun=overrun)).stopped().receive(bytes(allowed))
    assert bench.end() is None
    bench.receive(b"X")
    bench.send()
    assert bench.all(AfterStop) == [AfterStop(count=allowed + 1, allowed=allowed)]
    assert bench.all(Alarm)[0].number == "SR856"
    stored = 8192 - limits.stop_at_free + allowed
    assert bench.end() == (Outcome.FAILED, 0, stored)


def test_11_sr856_when_the_buffer_is_full_whatever_overrun_is_allowed() -> None:
    bench = Bench(Params(overrun=2000)).stopped().receive(bytes(512))
    assert (bench.engine.buffered, bench.end()) == (8192, None)
    bench.receive(b"X")
    assert bench.send() == DC3 + NAK
    assert "8192" in bench.all(Alarm)[0].text
    assert bench.end() == (Outcome.FAILED, 0, 8192)
    assert (bench.take(), bench.engine.program_ended) == (b"", False)


def test_11_sr856_also_when_the_dc3_never_left_and_the_alarm_overtakes_it() -> None:
    bench = Bench().reading().receive(bytes(9000))
    assert bench.all(AfterStop) == [AfterStop(count=0, allowed=511)]
    assert bench.send() == DC3 + NAK
    assert bench.end() == (Outcome.FAILED, 0, 8192)


def test_6_3_codes_that_cs_holds_back_do_not_pile_up() -> None:
    bench = Bench().reading().signals(cts=False)
    for _ in range(50):
        bench.receive(bytes(7680))
        bench.take()
    assert bench.send() == b""
    assert bench.signals().send() == DC3 + DC1
    assert (bench.end(), len(bench.all(AfterStop))) == (None, 50)
    bench.receive(bytes(7680))
    assert bench.send() == DC3
    bench.signals(cts=False)
    bench.take()
    bench.receive(bytes(7680))
    assert bench.signals().send() == DC1 + DC3


def test_6_3_the_levels_rule_on_after_eor_is_in() -> None:
    bench = Bench().stopped().receive(PROGRAM)
    bench.take(5000)
    assert bench.send() == DC1
    bench.take()
    assert bench.send() == DC3
    assert bench.end() == (Outcome.COMPLETE, 7680 + len(PROGRAM), 7680 + len(PROGRAM))


def test_6_2_the_codes_of_5000_2() -> None:
    bench = Bench(Params(code=CodeSystem.ASCII)).reading().reset()
    assert bench.send() == b"\x13\x16"
    assert Bench(Params(code=CodeSystem.ASCII)).alarm().send() == b"\x15"


# 6.1.2 and 6.4: reset and alarm


def test_6_1_2_er_is_on_from_power_up() -> None:
    bench = Bench()
    assert bench.er
    bench.reading().reset().send()
    assert bench.er


@pytest.mark.parametrize("stopped", [False, True])
@pytest.mark.parametrize(("posting", "codes"), [(Switch.ON, (DC3 + SYN, DC3 + NAK)), (Switch.OFF, (DC3, DC3))])
def test_6_4_a_read_cut_short(posting: Switch, codes: tuple[bytes, bytes], stopped: bool) -> None:
    acts = ((Bench.reset, Outcome.CANCELLED), (Bench.alarm, Outcome.FAILED))
    for (act, outcome), said in zip(acts, codes, strict=True):
        bench = Bench(Params(posting=posting))
        bench = bench.stopped() if stopped else bench.reading().receive(PROGRAM[:-1])
        received = bench.engine.buffered
        bench.take(5)
        act(bench)
        assert (bench.engine.buffered, bench.take()) == (0, b""), "8.2: what was received is lost"
        assert bench.hand_over() == said
        assert (bench.er, bench.end()) == (True, None)
        bench.left(2)
        assert (bench.er, bench.end()) == (posting is Switch.ON, (outcome, 5, received))


def test_6_4_what_was_on_its_way_when_a_read_was_cut_short_is_no_violation_within_the_overrun() -> None:
    bench = Bench().reading().reset().receive(b"ab")
    bench.send()
    bench.receive(bytes(511))
    assert not bench.all(Violation)
    assert len(bench.all(Notice)) == 1
    bench.receive(bytes(7))
    assert bench.all(Violation)[0].count == 7


@pytest.mark.parametrize("signals", [{"cts": False}, {"dsr": False}, {"cd": False}])
def test_6_1_2_at_rest_syn_and_nak_go_out_while_dr_cd_and_cs_are_on(signals: dict[str, bool]) -> None:
    assert Bench().reset().send() == SYN
    assert Bench().alarm().send() == NAK
    bench = Bench().signals(**signals).reset().alarm()
    assert bench.send() == b""
    assert bench.signals().send() == b"", "nor later"
    assert not bench.events


def test_6_1_2_at_rest_silent_without_posting_or_outside_the_valid_period() -> None:
    assert Bench(NOT_POSTING).reset().alarm().send() == b""
    assert Bench(Params(idle_posting=Switch.OFF)).reset().alarm().send() == b""


def test_6_1_2_an_unsent_code_at_rest_is_not_repeated_and_dies_with_dr() -> None:
    assert Bench().reset().reset().reset().send() == SYN
    assert Bench().reset().signals(dsr=False).signals().send() == b""


@pytest.mark.parametrize("begin", [Bench.start, Bench.punch])
def test_6_4_a_job_ends_by_reset_though_the_line_takes_nothing(begin: Callable[[Bench], Bench]) -> None:
    """Nothing was said to the host yet; the SYN goes out as at rest."""
    bench = Bench()
    for _ in range(2):
        assert begin(bench).reset().end() == (Outcome.CANCELLED, 0, 0)
        bench.events.clear()
    assert bench.send() == SYN


def test_3_3_expansion_b_knows_no_cd() -> None:
    bench = Bench(Params(limits=EXPANSION_B)).signals(cd=False).reset()
    assert bench.send() == SYN


def test_6_1_2_cs_off_in_a_read_lets_only_dc3_follow() -> None:
    bench = Bench().reading().signals(cts=False).reset()
    assert (bench.send(), bench.end()) == (b"", None)
    assert bench.signals().send() == DC3
    assert bench.end() == (Outcome.CANCELLED, 0, 0)


def test_6_4_a_second_reset_gives_up_what_cs_holds_back() -> None:
    bench = Bench().reading().signals(cts=False).reset().reset()
    assert bench.end() == (Outcome.CANCELLED, 0, 0)
    assert bench.signals().send() == b""


@pytest.mark.parametrize(
    ("act", "said", "outcome"), [(Bench.reset, SYN, Outcome.CANCELLED), (Bench.alarm, NAK, Outcome.FAILED)]
)
def test_6_4_before_the_last_dc3_has_left_a_read_can_still_be_cut_short(
    act: Callable[[Bench], Bench], said: bytes, outcome: Outcome
) -> None:
    bench = Bench().reading().receive(PROGRAM)
    bench.take()
    act(bench)
    act(bench)
    assert bench.send() == DC3 + said
    assert bench.end() == (outcome, len(PROGRAM), len(PROGRAM))


def test_8_2_reset_while_the_rest_is_read() -> None:
    bench = Bench(AT_RECEIVED).reading().receive(PROGRAM)
    assert bench.send() == DC3
    bench.take(3)
    assert bench.reset().send() == SYN
    assert bench.end() == (Outcome.CANCELLED, 3, len(PROGRAM))


def test_6_4_note_1_at_reset_the_communication_outlives_the_alarm() -> None:
    bench = Bench(AT_RESET).reading().receive(PROGRAM[:10])
    bench.take(4)
    bench.alarm().alarm()
    assert (bench.take(), bench.send(), len(bench.all(Notice))) == (b"", b"", 1)
    bench.receive(bytes(7680 - 6))
    assert bench.send() == DC3
    assert (bench.take(), bench.end()) == (b"", None)
    assert bench.reset().send() == DC3 + NAK
    assert bench.end() == (Outcome.FAILED, 4, 7684)
    assert bench.reset().send() == SYN, "the alarm is over"


def test_8_2_reset_before_the_dc3_of_a_received_program_went_out() -> None:
    bench = Bench(AT_RECEIVED).reading().receive(PROGRAM).reset()
    assert bench.send() == DC3 + SYN


def test_6_4_note_1_at_rest_an_alarm_is_posted_at_once() -> None:
    bench = Bench(AT_RESET).alarm()
    assert (bench.send(), bench.reset().send()) == (NAK, SYN)


def test_6_4_note_1_holds_with_posting_only() -> None:
    bench = Bench(Params(alarm=AlarmEnds.AT_RESET, posting=Switch.OFF)).reading().alarm()
    assert bench.send() == DC3
    assert bench.end() == (Outcome.FAILED, 0, 0)


# 3.2 and chapter 11: the line


@pytest.mark.parametrize("posting", list(Switch))
@pytest.mark.parametrize("stopped", [False, True])
def test_11_sr855_dr_off_during_transmission(posting: Switch, stopped: bool) -> None:
    bench = Bench(Params(posting=posting))
    bench = bench.stopped() if stopped else bench.reading().receive(PROGRAM[:4])
    received = bench.engine.buffered
    bench.signals(dsr=False)
    assert bench.all(Alarm)[0].number == "SR855"
    assert bench.end() == (Outcome.FAILED, 0, received)
    assert bench.er is (posting is Switch.ON)
    assert bench.signals().send() == b"", "there was nobody to tell"


@pytest.mark.parametrize(("cd", "alarms"), [(Switch.ON, ["SR855"]), (Switch.OFF, [])])
def test_10_2_5000_4_cd_is_checked_or_not(cd: Switch, alarms: list[str]) -> None:
    bench = Bench(Params(cd=cd)).reading().signals(cd=False)
    assert [alarm.number for alarm in bench.all(Alarm)] == alarms


def test_11_sr855_at_once_whatever_6_4_note_1_says_of_other_alarms() -> None:
    assert Bench(AT_RESET).reading().signals(dsr=False).end() == (Outcome.FAILED, 0, 0)


def test_11_sr855_cd_that_turns_off() -> None:
    assert Bench().reading().signals(cd=False).end() == (Outcome.FAILED, 0, 0)
    assert Bench().signals(cd=False).reading().signals(cd=False).end() is None
    assert Bench(Params(limits=EXPANSION_B)).reading().signals(cd=False).end() is None


@pytest.mark.parametrize("closure", list(Closure))
def test_11_sr855_a_closed_line_counts_as_dr_off(closure: Closure) -> None:
    bench = Bench().reading().receive(PROGRAM[:-1])
    bench.close(closure)
    assert bench.all(Alarm)[0].text == f"DATA SET READY DOWN (RMT-BUF): the line is {closure}: end of file"
    assert bench.end() == (Outcome.FAILED, 0, len(PROGRAM) - 1)
    with pytest.raises(UsageError, match="its line is closed"):
        bench.start()


def test_11_sr855_a_line_closed_before_dc1_went_out() -> None:
    bench = Bench().start()
    bench.close()
    assert bench.end() == (Outcome.FAILED, 0, 0)


@pytest.mark.parametrize("params", [Params(), NOT_POSTING, AT_RECEIVED])
@pytest.mark.parametrize("gone", [Bench.close, lambda bench: bench.signals(dsr=False)])
def test_3_2_after_eor_the_control_needs_no_host(params: Params, gone: Callable[[Bench], object]) -> None:
    bench = Bench(params).reading().receive(PROGRAM)
    bench.take(3)
    gone(bench)
    gone(bench)
    assert (bench.end(), bench.all(Alarm)) == (None, [])
    assert bench.take() == PROGRAM[3:]
    assert bench.send() == b""
    assert bench.end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))


def test_3_2_er_goes_off_with_the_host_after_eor() -> None:
    bench = Bench(NOT_POSTING).reading().receive(PROGRAM)
    assert not bench.signals(dsr=False).er


def test_11_sr855_does_not_wait_for_a_dc3_on_its_way() -> None:
    bench = Bench().reading().receive(bytes(7680))
    assert bench.hand_over() == DC3
    assert bench.signals(dsr=False).end() == (Outcome.FAILED, 0, 7680)


def test_3_2_the_host_gone_while_the_last_dc3_leaves() -> None:
    bench = Bench().reading().receive(PROGRAM)
    bench.take()
    assert bench.signals(dsr=False).end() == (Outcome.COMPLETE, len(PROGRAM), len(PROGRAM))


@pytest.mark.parametrize("fault", list(LineFault))
@pytest.mark.parametrize("stopped", [False, True])
def test_11_sr946_says_what_and_where(fault: LineFault, stopped: bool) -> None:
    bench = Bench().stopped() if stopped else Bench().reading().receive(PROGRAM[:7])
    received = bench.engine.buffered
    bench.fault(fault, 0x41)
    assert bench.all(Alarm)[0].number == "SR946"
    assert f"{fault} (41h) after {received} characters of program" in bench.all(Alarm)[0].text
    assert bench.send() == DC3 + NAK
    assert bench.end() == (Outcome.FAILED, 0, received)


def test_11_a_fault_where_nothing_is_received_is_a_violation() -> None:
    bench = Bench().fault(LineFault.BREAK, None).reading().receive(PROGRAM).fault()
    assert len(bench.all(Violation)) == 2
    assert bench.take() == PROGRAM


def test_8_2_characters_that_nobody_asked_for_are_ignored_and_reported() -> None:
    bench = Bench().receive(PROGRAM).signals(cts=False).start().receive(b"ab")
    assert [violation.count for violation in bench.all(Violation)] == [len(PROGRAM), 2]
    assert bench.signals().send() == DC1
    assert bench.engine.buffered == 0


def test_8_2_what_comes_after_a_whole_read_or_into_the_next_was_not_on_its_way() -> None:
    bench = Bench().reading().receive(PROGRAM)
    bench.take()
    bench.send()
    bench.receive(b"a")
    assert len(bench.all(Violation)) == 1
    bench.reading().reset()
    bench.send()
    bench.signals(cts=False).start().receive(b"b")
    assert len(bench.all(Violation)) == 2


# the contract


def test_a_running_job_is_not_started_again() -> None:
    bench = Bench().reading()
    with pytest.raises(UsageError, match=r"cannot read now: the host may send; wait, or press RESET"):
        bench.start()
    with pytest.raises(UsageError, match="cannot punch out now"):
        bench.engine.punch(Tape(), 0)


def test_take_asks_for_nothing_it_may_not() -> None:
    bench = Bench().reading().receive(PROGRAM)
    assert (bench.take(0), bench.take(-1), bench.engine.buffered) == (b"", b"", len(PROGRAM))
