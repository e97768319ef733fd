"""The control's end of protocol A when things go wrong: repetitions, alarms, open lines (B-63322EN-1 4.4.1, 4.6,
chapter 11); and what holds whatever the host says.
"""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND, Ended, LineFault, Outcome
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.messages import Command, EndCode, Message, MessageCode, RetryReason
from tapewire.protocols.fanuc_a.params import OpenLine, Retries, SynParameters, TimeOut
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_a.cnc_bench import PROGRAM, Bench, quick

C = Command


# RTY


def test_4_4_1_rty_of_the_host_draws_the_same_message() -> None:
    bench = Bench().asked()
    for _ in range(3):
        bench.answer(C.RTY, b"1")
        assert bench.next() is C.GTD
    bench.answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM


def test_4_4_1_rty_in_the_turn_of_the_control_draws_the_last_message() -> None:
    bench = Bench().ready().answer(C.RTY, b"1")
    assert bench.next() is C.SAT


def test_rty_does_not_draw_a_gtd_that_is_not_meant_any_more() -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM)
    bench.take()
    bench.messages.clear()
    bench.answer(C.EOD).answer(C.RTY, b"1")
    assert bench.next() is C.SAT


def test_4_6_2_1_a_checksum_error_draws_rty_1_and_the_repetition_counts() -> None:
    bench = Bench().asked().spoil(C.DAT, PROGRAM)
    assert bench.silent(0.019)
    bench.run(0.01)
    assert bench.messages.pop() == Message(command=C.RTY, data=RetryReason.CHECKSUM.value)
    bench.answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM


def test_an_rty_that_the_host_could_not_read_is_repeated() -> None:
    bench = Bench().asked().spoil(C.WAT)
    assert bench.next() is C.RTY
    bench.answer(C.RTY, b"1")
    assert bench.next() is C.RTY
    bench.answer(C.WAT)
    assert bench.next(5.2) is C.GTD


def test_rty_waits_until_the_rest_of_a_message_cut_by_noise_has_come() -> None:
    raw = Bench().host(C.DAT, PROGRAM)
    bench = Bench().asked()
    bench.receive(raw[:10] + b"\r")
    for byte in raw[11:]:
        bench.run(0.005)
        bench.receive(bytes([byte]))
    assert not bench.messages
    assert bench.next(0.03) is C.RTY
    bench.answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM


def test_an_answer_that_comes_after_noise_needs_no_rty() -> None:
    bench = Bench().asked().receive(b"\x55\r").answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM
    assert bench.next(1) is C.GTD


def test_what_came_before_the_control_speaks_does_not_spoil_the_answer() -> None:
    bench = Bench().ready().receive(b"\x55\x55").run(5.1)
    bench.messages.clear()
    bench.answer(C.SET)
    assert bench.silent(1)


def test_4_6_2_1_more_than_ne_checksum_errors_are_alarm_state_cause_1() -> None:
    bench = Bench().asked(ne=2)
    for _ in range(2):
        bench.spoil(C.WAT)
        assert bench.next() is C.RTY
    bench.spoil(C.WAT)
    assert bench.alarms == ["SR945"]
    status = bench.status()
    assert (status.state, status.cause) == (BufferState.ALARM, AlarmCause.CHECKSUM)
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.FAILED, "SR945")
    assert bench.next(5.2) is C.SAT


def test_4_6_1_7_more_than_ne_rty_of_the_host_are_an_open_line() -> None:
    bench = Bench().asked(ne=2)
    for _ in range(2):
        bench.answer(C.RTY, b"1")
        assert bench.next() is C.GTD
    bench.answer(C.RTY, b"1")
    assert bench.alarms == ["SR945"]
    assert bench.state is State.SYN_WAIT
    assert bench.ended_as(Outcome.FAILED, "SR945")


def test_4_6_2_1_both_kinds_count_together() -> None:
    bench = Bench().asked(ne=2).answer(C.RTY, b"1").spoil(C.WAT).run(0.1).spoil(C.WAT)
    assert bench.alarms == ["SR945"]


@pytest.mark.parametrize(("retries", "alarms"), [(Retries.EXCHANGE, []), (Retries.JOB, ["SR945"])])
def test_4_6_2_1_the_count_begins_anew_after_a_good_exchange_or_not(retries: Retries, alarms: list[str]) -> None:
    bench = Bench(quick(retries=retries)).asked(ne=1)
    for _ in range(2):
        bench.answer(C.RTY, b"1").answer(C.DAT, b"\nX")
    assert bench.alarms == alarms


def test_ne_zero_allows_no_retry() -> None:
    assert Bench().asked(ne=0).answer(C.RTY, b"1").alarms == ["SR945"]


# 4.6, chapter 11: what a host does wrong


@pytest.mark.parametrize("answer", [C.SET, C.RDY, C.ARS, C.AAL, C.CLB])
def test_sr947_an_answer_that_is_not_in_the_list(answer: Command) -> None:
    bench = Bench().asked().answer(answer)
    assert bench.alarms == ["SR947"]
    status = bench.status()
    assert (status.state, status.cause) == (BufferState.ALARM, AlarmCause.UNEXPECTED)


@pytest.mark.parametrize("answer", [C.GTD, C.SAT, C.RST, C.ALM, C.SDI])
def test_sr948_a_command_of_the_remote_buffers_own(answer: Command) -> None:
    assert Bench().asked().answer(answer).alarms == ["SR948"]


def test_sr948_a_command_while_none_is_expected() -> None:
    assert Bench().ready().answer(C.SET).alarms == ["SR948"]


def test_sr948_an_undefined_command() -> None:
    assert Bench().asked().receive(b"01XYZ\r").next() is C.RTY, "a wrong sum is the line's fault"
    total = sum(b"XYZ\r") & 0xFF
    assert Bench().asked().receive(b"%02XXYZ\r" % total).alarms == ["SR948"]


def test_sr948_an_end_code_in_the_command_name() -> None:
    total = sum(b"SE\r") & 0xFF
    assert Bench().asked().receive(b"%02XSE\r" % total).alarms == ["SR948"]


@pytest.mark.parametrize("raw", [b"\r", b"0\r", b"F9ET\r", b"SET\r"])
def test_a_short_message_with_a_wrong_sum_is_the_lines_fault(raw: bytes) -> None:
    bench = Bench().asked().receive(raw)
    assert bench.alarms == []
    assert bench.next() is C.RTY


def test_sr948_data_longer_than_can_be() -> None:
    bench = Bench().asked(nb=4000, no=2).receive(bench_raw(b"DAT" + b"X" * 4097))
    assert bench.alarms == ["SR948"]


def bench_raw(body: bytes) -> bytes:
    body += b"\r"
    return b"%02X" % (sum(body) & 0xFF) + body


def test_4_6_2_the_job_fails_and_the_state_stays_alarm_until_reset() -> None:
    bench = Bench().asked().answer(C.DAT, b"\nX").answer(C.ARS)
    bench.messages.clear()
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.FAILED, "SR947")
    assert bench.ended.bytes_high == 2
    assert bench.take() == b""
    with pytest.raises(UsageError, match="RESET"):
        bench.engine.cycle_start(bench.now)
    assert bench.poll().state is BufferState.ALARM
    bench.answer(C.SET)
    assert bench.reset().next() is C.RST
    bench.answer(C.ARS)
    assert bench.poll().state is BufferState.RESET


def test_4_6_3_noise_in_the_turn_of_the_control_is_ignored() -> None:
    bench = Bench().ready().receive(b"\x55\xaa\r")
    assert bench.alarms == []
    assert bench.complained("no answer was awaited")
    assert bench.next(5.1) is C.SAT


# 4.6 1): open line


def test_sr944_no_answer_within_to() -> None:
    bench = Bench().asked(to=7)
    bench.run(6.99)
    assert bench.alarms == []
    bench.run(0.02)
    assert bench.alarms == ["SR944"]
    assert bench.state is State.SYN_WAIT
    assert bench.ended_as(Outcome.FAILED, "SR944")


@pytest.mark.parametrize(("time_out", "alarms"), [(TimeOut.BYTES, []), (TimeOut.MESSAGE, ["SR944"])])
def test_sr944_to_runs_between_bytes_or_over_the_whole_answer(time_out: TimeOut, alarms: list[str]) -> None:
    bench = Bench(quick(time_out=time_out)).asked(to=2)
    for byte in bench.host(C.DAT, PROGRAM):
        bench.run(0.5).receive(bytes([byte]))
    assert bench.alarms == alarms


def test_to_begins_when_the_message_has_left() -> None:
    bench = Bench().powered()
    bench.answer(C.SYN).pulling = False
    assert bench.state is State.RDY_SENT
    bench.answer(C.RDY)
    out = bench.engine.data_to_send(100)
    bench.engine.data_sent(len(out), bench.now)
    assert bench.engine.next_deadline() == bench.now + 20 * SECOND
    bench.now += 3 * SECOND
    bench.engine.data_left(len(out), bench.now)
    assert bench.engine.next_deadline() == bench.now + 20 * SECOND


@pytest.mark.parametrize("fault", LineFault)
def test_sr946_a_damaged_character(fault: LineFault) -> None:
    bench = Bench().asked().fault(fault)
    assert bench.alarms == ["SR946"]
    assert bench.state is State.SYN_WAIT
    assert bench.fault(fault).alarms == ["SR946"], "on an open line nothing more is heard"


@pytest.mark.parametrize("signal", ["dsr", "cd"])
def test_sr855_dr_or_cd_off_during_transmission(signal: str) -> None:
    bench = Bench().signals().asked().answer(C.DAT, b"\nX")
    assert bench.next() is C.GTD
    bench.signals(**{signal: False})
    assert bench.alarms == ["SR855"]
    assert bench.ended_as(Outcome.FAILED, "SR855")
    assert bench.silent(60)


@pytest.mark.parametrize(("cd", "alarms"), [(Switch.ON, ["SR855"]), (Switch.OFF, [])])
def test_10_2_5000_4_cd_is_checked_or_not(cd: Switch, alarms: list[str]) -> None:
    bench = Bench(quick(cd=cd)).signals().asked().signals(cd=False)
    assert bench.alarms == alarms


def test_cd_that_was_never_on_has_no_wire() -> None:
    bench = Bench().signals(cd=False).asked()
    bench.signals(cd=False, cts=False)
    assert bench.alarms == []


def test_cd_that_is_off_when_the_line_first_reports_has_no_wire_either() -> None:
    assert Bench().asked().signals(cd=False).alarms == []


def test_dr_off_while_idle_is_no_alarm_but_an_open_line() -> None:
    bench = Bench().ready().signals(dsr=False)
    assert bench.alarms == []
    bench.signals()
    assert bench.state is State.SYN_WAIT


def test_4_6_1_on_an_open_line_the_control_waits_for_the_hosts_syn() -> None:
    bench = Bench().asked().run(21)
    assert bench.silent(600)
    bench.answer(C.SET).answer(C.DAT, b"X").receive(b"\x00\r")
    assert bench.silent(60)
    bench.answer(C.SYN)
    assert bench.next() is C.SYN
    bench.answer(C.SYN)
    assert bench.next() is C.RDY
    bench.answer(C.RDY)
    assert bench.status().state is BufferState.RESET


def test_4_6_1_or_the_control_speaks_first_as_after_power_on() -> None:
    bench = Bench(quick(open_line=OpenLine.SPEAKS)).asked().fault()
    assert bench.alarms == ["SR946"]
    assert bench.answer(C.WAT).complained("has yet to begin, after power-on or an open line: ignored")
    assert bench.silent(1.9)
    assert bench.next(0.2) is C.SYN


@pytest.mark.parametrize(("keeps", "nb"), [(SynParameters.POWER_ON, 2000), (SynParameters.KEPT, 3000)])
@pytest.mark.parametrize("who", OpenLine)
def test_the_parameters_after_an_open_line_whoever_begins(keeps: SynParameters, nb: int, who: OpenLine) -> None:
    bench = Bench(quick(open_line=who, syn_parameters=keeps)).asked(nb=3000).fault()
    if who is OpenLine.WAITS:
        bench.answer(C.SYN)
    assert bench.next(2.1) is C.SYN
    bench.answer(C.SYN)
    assert bench.next() is C.RDY
    assert bench.answer(C.RDY).status().parameters.nb == nb


def test_no_alarm_before_the_line_is_initialised() -> None:
    bench = Bench().powered()
    bench.engine.cycle_start(bench.now)
    bench.run(21)
    assert bench.alarms == []
    assert bench.complained("no answer")
    bench.answer(C.SYN).answer(C.SYN).answer(C.RDY)
    bench.messages.clear()
    bench.answer(C.SET)
    assert bench.next() is C.GTD, "the cycle start was only kept waiting"


def test_4_4_1_syn_of_the_host_begins_anew_at_any_time() -> None:
    for prepare in (Bench.powered, Bench.ready, Bench.asked):
        bench = prepare(Bench())
        bench.messages.clear()
        bench.answer(C.SYN)
        assert bench.next() is (C.RDY if prepare is Bench.powered else C.SYN)


@pytest.mark.parametrize(("setting", "nb"), [(SynParameters.POWER_ON, 2000), (SynParameters.KEPT, 3000)])
def test_syn_resets_the_parameters_or_not(setting: SynParameters, nb: int) -> None:
    bench = Bench(quick(syn_parameters=setting)).ready(nb=3000).answer(C.SYN).answer(C.SYN).answer(C.RDY)
    bench.messages[:-1] = []
    assert bench.status().parameters.nb == nb


def test_syn_in_the_middle_of_a_program_ends_it_as_failed() -> None:
    bench = Bench().asked().answer(C.DAT, b"\nX").answer(C.SYN)
    assert bench.ended_as(Outcome.FAILED, "SYN")
    assert bench.engine.buffered == 0


def test_syn_after_the_first_gtd_ends_the_operation_as_failed() -> None:
    assert Bench().asked().answer(C.SYN).ended_as(Outcome.FAILED, "SYN")


def test_syn_before_the_first_gtd_lets_the_operation_wait() -> None:
    bench = Bench().ready().run(5.1)
    bench.engine.cycle_start(bench.now)
    bench.answer(C.SYN).answer(C.SYN).answer(C.RDY)
    bench.messages.clear()
    bench.answer(C.SET)
    assert bench.next() is C.GTD


def test_syn_when_the_whole_program_is_here_leaves_it_in_the_buffer() -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM).answer(C.SYN)
    assert bench.take() == PROGRAM


def test_a_program_that_is_here_as_a_whole_is_read_whatever_the_line_does() -> None:
    for accident in (Bench.fault, Bench.close, lambda bench: bench.signals(dsr=False), lambda bench: bench.run(21)):
        bench = Bench().asked().answer(C.DAT, PROGRAM)
        assert accident(bench) in (bench, None)
        assert bench.alarms == []
        assert bench.take() == PROGRAM
        assert bench.ended_as(Outcome.COMPLETE)


# every coding, and properties


@pytest.mark.parametrize("code", MessageCode)
@pytest.mark.parametrize("end", EndCode)
def test_4_2_a_whole_program_in_every_coding(code: MessageCode, end: EndCode) -> None:
    bench = Bench(quick(code=code, end=end)).asked().answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM
    assert bench.next() is C.GTD
    bench.answer(C.EOD)
    assert bench.poll().state is BufferState.RESET
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.COMPLETE)


@pytest.mark.parametrize("code", MessageCode)
@pytest.mark.parametrize("end", EndCode)
def test_a_short_message_with_a_right_sum_is_sr948_in_every_coding(code: MessageCode, end: EndCode) -> None:
    coding = quick(code=code, end=end).coding
    body = coding.encode(b"SE") + coding.end_byte
    raw = coding.encode(b"%02X" % (sum(body) & 0xFF)) + body
    assert Bench(quick(code=code, end=end)).asked().receive(raw).alarms == ["SR948"]


def test_the_loss_of_any_byte_of_a_dat_never_harms_the_program() -> None:
    raw = Bench().host(C.DAT, PROGRAM)
    for lost in range(len(raw)):
        bench = Bench().asked().receive(raw[:lost] + raw[lost + 1 :]).run(0.1)
        if bench.messages and bench.messages[-1].command is C.RTY:
            bench.answer(C.DAT, PROGRAM)
            assert bench.take() == PROGRAM
        else:
            bench.run(21)
            assert bench.alarms == ["SR944"], f"byte {lost}"
            assert bench.take() == b""


TALK = st.one_of(
    st.sampled_from([Bench().host(command) for command in Command]),
    st.just(Bench().host(C.DAT, PROGRAM)),
    st.binary(max_size=30),
)


@settings(max_examples=60)
@given(talk=st.lists(st.tuples(TALK, st.sampled_from([0.0, 0.05, 1.0, 6.0, 25.0])), max_size=12))
def test_whatever_the_host_says_the_control_takes_a_prefix_and_comes_to_rest(talk: list[tuple[bytes, float]]) -> None:
    bench = Bench().asked()
    taken = b""
    for said, pause in talk:
        bench.receive(said).run(pause)
        taken += bench.take(10)
        deadline = bench.engine.next_deadline()
        assert deadline is None or deadline > bench.now
    bench.run(60)
    assert bench.state in (State.SYN_WAIT, State.RESTING)
    assert len(bench.of(Ended)) <= 1


@given(talk=st.lists(TALK, max_size=6), cuts=st.lists(st.integers(0, 200), max_size=6))
def test_any_cutting_gives_the_same(talk: list[bytes], cuts: list[int]) -> None:
    data = b"".join(talk)
    whole, cut = Bench().asked(), Bench().asked()
    whole.engine.receive_data(data, whole.now)
    places = sorted({0, len(data), *(min(place, len(data)) for place in cuts)})
    for start, end in itertools.pairwise(places):
        cut.engine.receive_data(data[start:end], cut.now)
    whole.run(3 * 21)
    cut.run(3 * 21)
    assert (whole.out, whole.events, whole.engine.buffered) == (cut.out, cut.events, cut.engine.buffered)
