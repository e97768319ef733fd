"""The control's end of protocol A, clause by clause of B-63322EN-1 chapter 4, without a host."""

from __future__ import annotations

import pytest

from tapewire.codes import DataCode
from tapewire.engine import MILLISECOND, Notice, Outcome, Started
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.cnc_law import AWAITED, DEAF, LAW, Refusal, State, refusal
from tapewire.protocols.fanuc_a.messages import ANSWERS, Command, Message
from tapewire.protocols.fanuc_a.params import (
    AfterEnd,
    DataLength,
    Unready,
)
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState, Filler, Setting
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_a.cnc_bench import PROGRAM, QUICK, SLOW, Bench, commands, quick

C = Command


# the law


def test_every_pair_has_a_row_or_falls_to_the_reception_error() -> None:
    """4.4.1 and 4.6 2) (2). Run with -s to see the table."""
    for state in State:
        for command in Command:
            act = LAW.get((state, command))
            print(f"{state.name:12} {command.name}  {act or f'reception error, {refusal(state, command).value}'}")
    without = {pair for pair in ((state, command) for state in State for command in Command) if pair not in LAW}
    assert {state for state, _ in without} == set(State) - DEAF - {State.SYN_WAIT}
    assert all(isinstance(refusal(*pair), Refusal) for pair in without)


def test_the_law_accepts_the_answers_of_the_command_table_and_beyond_them_syn_and_rty() -> None:
    """Two readings of 4.4.1: the table that both ends share, and this end's own."""
    for command, state in AWAITED.items():
        own = {answer for answer in Command if (state, answer) in LAW}
        assert own - {C.RTY, C.SYN} == ANSWERS[command] - {C.SYN}
    for command, state in ((C.SAT, State.SDI_FOR_SAT), (C.GTD, State.SDI_FOR_GTD)):
        own = {answer for answer in Command if (state, answer) in LAW}
        assert own - {C.RTY, C.SYN} == ANSWERS[command] - {C.SYN, C.RDI}


# 4.3 (1): power-on


def test_4_3_1_the_first_message_is_syn_two_seconds_after_both_are_ready() -> None:
    bench = Bench()
    assert bench.run(1.99).messages == []
    assert bench.next(0.02) is C.SYN


def test_4_3_1_both_ready_means_dr_on() -> None:
    bench = Bench().signals(dsr=False).run(60)
    assert bench.silent(60)
    bench.signals()
    assert bench.silent(1.9)
    assert bench.next(0.2) is C.SYN


def test_4_3_1_with_cs_off_the_first_message_waits_for_cs_on() -> None:
    bench = Bench().signals(cts=False).run(60)
    assert not bench.out
    bench.signals()
    assert commands(bench.messages) == [C.SYN]


def test_4_3_1_the_two_seconds_are_a_setting() -> None:
    bench = Bench(quick(start_time=0.5))
    assert bench.next(0.6) is C.SYN


def test_4_4_1_syn_rdy_then_sat_with_state_1() -> None:
    bench = Bench().powered().answer(C.SYN)
    assert bench.next() is C.RDY
    bench.answer(C.RDY)
    assert bench.status().state is BufferState.RESET
    bench.answer(C.SET)
    assert bench.silent(4.9)
    assert bench.next(0.2) is C.SAT


@pytest.mark.parametrize(("unready", "polled_with"), [(Unready.SYN, C.SYN), (Unready.RDY, C.RDY)])
def test_4_4_1_a_host_that_answers_rdy_with_syn_is_polled_every_tp(unready: Unready, polled_with: Command) -> None:
    bench = Bench(quick(unready=unready)).powered().answer(C.SYN)
    assert bench.next() is C.RDY
    bench.answer(C.SYN)
    assert bench.silent(4.9)
    assert bench.next(0.2) is polled_with


def test_4_4_1_rdy_is_no_answer_to_syn() -> None:
    bench = Bench().powered().answer(C.RDY)
    assert bench.alarms == ["SR947"]
    assert bench.status().cause is AlarmCause.UNEXPECTED


# 4.3 (2) to (4), (6): timers and CS


def test_4_3_2_characters_leave_with_gaps_of_ti() -> None:
    bench = Bench(SLOW)
    bench.pulling = False
    bench.run(2.1)
    engine, now = bench.engine, bench.now
    assert engine.data_to_send(64) == b"0"
    engine.data_sent(1, now)
    assert engine.data_to_send(64) == b""
    now += 3 * MILLISECOND
    engine.data_left(1, now)
    assert engine.data_to_send(64) == b""
    assert engine.next_deadline() == now + 10 * MILLISECOND
    engine.handle_timer(now + 10 * MILLISECOND - 1)
    assert engine.data_to_send(64) == b""
    engine.handle_timer(now + 10 * MILLISECOND)
    assert engine.data_to_send(64) == b"7"


def test_4_3_2_without_ti_all_may_go_at_once() -> None:
    bench = Bench()
    bench.pulling = False
    bench.run(2.1)
    assert bench.engine.data_to_send(64) == b"07SYN\r"


def test_4_3_4_a_message_waits_for_tx_after_reception() -> None:
    bench = Bench(quick(tx=100)).powered().answer(C.SYN)
    heard = bench.now
    assert bench.silent(0.0999)
    bench.run(0.001)
    assert bench.times == [heard + 100 * MILLISECOND]


def test_4_3_6_cs_off_pauses_the_transmission_at_once() -> None:
    bench = Bench()
    bench.pulling = False
    bench.run(2.1)
    bench.engine.data_sent(2, bench.now)
    bench.signals(cts=False)
    assert bench.engine.data_to_send(64) == b""
    bench.signals()
    assert bench.engine.data_to_send(64) == b"SYN\r"


def test_4_6_3_what_comes_in_while_the_control_transmits_is_ignored() -> None:
    bench = Bench()
    bench.pulling = False
    bench.run(2.1)
    bench.engine.data_sent(3, bench.now)
    bench.engine.receive_data(bench.host(C.SYN), bench.now)
    bench.engine.data_sent(3, bench.now)
    assert bench.state is State.SYN_SENT
    bench.drain()
    assert bench.complained("on its way out")


# 4.4.2: SAT and SET


def test_4_4_2_sat_carries_what_is_stored_and_the_parameters_in_force() -> None:
    bench = Bench().asked(nb=3000, no=100, tw=3).answer(C.DAT, b"%\n" + b"X" * 1000)
    bench.messages.clear()
    bench.answer(C.WAT)
    bench.run(3.5)
    status = bench.engine._line._status_data()
    assert status[4:8] == b"03EA"
    assert status[8:16] == b"0BB80064"
    assert status[1:2] == b"2"


@pytest.mark.parametrize(("length", "count"), [(DataLength.USED, 56), (DataLength.ALL, 72)])
@pytest.mark.parametrize(("filler", "unused"), [(Filler.ZERO, b"0"), (Filler.BLANK, b" ")])
def test_4_4_2_length_and_filler_of_sat_are_settings(
    length: DataLength, count: int, filler: Filler, unused: bytes
) -> None:
    bench = Bench(quick(sat_length=length, filler=filler)).powered().answer(C.SYN).answer(C.RDY)
    data = bench.messages[-1].data
    assert (len(data), data[3:4], data[48:54]) == (count, unused, unused * 6)


@pytest.mark.parametrize("length", [48, 56, 72])
def test_4_4_2_set_changes_the_parameters(length: int) -> None:
    bench = Bench().ready(nb=3000, no=200, ne=3, tp=7, to=30, ti=2, tx=20, tw=4)
    sat = bench.poll()
    bench.answer(C.SET, Setting(parameters=sat.parameters).encode(max(length, 56))[:length])
    parameters = bench.poll().parameters
    assert (parameters.nb, parameters.no, parameters.ne, parameters.tp) == (3000, 200, 3, 7)
    assert (parameters.to, parameters.ti, parameters.tx, parameters.tw) == (30, 2, 20, 4)


def test_4_4_2_set_without_data_changes_nothing() -> None:
    bench = Bench().ready(nb=3000)
    assert bench.poll().parameters.nb == 3000
    bench.answer(C.SET)
    assert bench.poll().parameters.nb == 3000


def test_4_4_2_p2_makes_the_unit_of_tp_a_tenth_of_a_second() -> None:
    bench = Bench().ready(unit=4)
    assert bench.silent(0.49)
    assert bench.next(0.02) is C.SAT


@pytest.mark.parametrize("values", [{"ti": 11}, {"ti": 3}, {"tp": 0}, {"nb": 4001}, {"nb": 60, "no": 60}, {"tw": 9}])
def test_4_5_values_outside_the_table_are_not_taken(values: dict[str, int]) -> None:
    bench = Bench().ready(**values)
    assert bench.complained("parameters stay")
    assert bench.poll().parameters == QUICK.wanted


def test_4_4_2_a_set_that_is_no_number_is_a_format_error() -> None:
    bench = Bench().ready().run(5.1)
    bench.messages.clear()
    bench.answer(C.SET, b"00000000ZZZZ")
    assert bench.alarms == ["SR948"]


@pytest.mark.parametrize(("n", "taken"), [(0, 0), (1, 1), (2, 2), (3, 0), (4, 4), (5, 0), (255, 0)])
def test_5_2_1_n_is_zero_when_it_is_none_of_1_2_and_4(n: int, taken: int) -> None:
    assert Bench().ready(n=n).poll().parameters.n == taken


@pytest.mark.parametrize(("echo", "seen"), [(Switch.OFF, "0"), (Switch.ON, "1")])
def test_5000_1_sat_echoes_the_switching_byte_of_set_or_says_0(echo: Switch, seen: str) -> None:
    bench = Bench(quick(echo=echo)).ready()
    assert bench.poll().switching == "0"
    bench.answer(C.SET, Setting(switching="1", parameters=QUICK.wanted).encode())
    assert bench.poll().switching == seen
    assert bench.of(Notice)


# GTD and its answers


def test_4_4_1_gtd_goes_out_in_operation_when_more_than_nb_is_free() -> None:
    bench = Bench().asked(nb=4000, no=2)
    assert bench.of(Started)
    bench.answer(C.DAT, b"\n" + b"X" * 2095)
    assert bench.next() is C.GTD
    bench.answer(C.DAT, b"X" * 2096)
    assert bench.silent(4), "4000 are free, and that is not more than Nb"
    assert bench.take(1) == b"\n"
    assert commands(bench.messages) == [C.GTD]


def test_4_4_1_with_little_free_sat_goes_on_every_tp() -> None:
    bench = Bench().asked(nb=4000, no=2).answer(C.DAT, b"\n" + b"X" * 3997).answer(C.DAT, b"X" * 500)
    bench.messages.clear()
    for _ in range(3):
        status = bench.poll()
        assert (status.state, status.stored) == (BufferState.OPERATING, 4498)
        bench.answer(C.SET)


def test_4_4_1_wat_makes_gtd_come_again_after_tw() -> None:
    bench = Bench().asked(tw=3).answer(C.WAT)
    assert bench.silent(2.99)
    assert bench.next(0.02) is C.GTD


def test_4_4_1_eod_after_eor_ends_the_asking_and_sat_reports_state_1() -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM
    assert bench.engine.program_ended
    assert bench.next() is C.GTD
    bench.answer(C.EOD)
    assert bench.of(Started)
    status = bench.poll()
    assert (status.state, status.stored) == (BufferState.RESET, 0)
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.COMPLETE)
    assert bench.ended.bytes_low == bench.ended.bytes_high == len(PROGRAM)


@pytest.mark.parametrize(
    ("after_end", "state"), [(AfterEnd.RESET, BufferState.RESET), (AfterEnd.OPERATING, BufferState.OPERATING)]
)
def test_4_7_the_state_after_the_end_is_a_setting(after_end: AfterEnd, state: BufferState) -> None:
    bench = Bench(quick(after_end=after_end)).asked().answer(C.DAT, PROGRAM)
    bench.take()
    bench.messages.clear()
    bench.answer(C.EOD)
    assert bench.poll().state is state
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.COMPLETE)
    assert bench.poll().state is state


@pytest.mark.parametrize("answer", [C.WAT, C.EOD])
def test_one_gtd_after_eor_is_enough_whatever_answers_it(answer: Command) -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM)
    bench.take()
    bench.messages.clear()
    bench.answer(answer)
    assert bench.next(6) is C.SAT


def test_eod_before_eor_makes_the_control_ask_again_after_the_next_sat() -> None:
    bench = Bench().asked().answer(C.EOD)
    assert bench.poll().state is BufferState.OPERATING
    bench.answer(C.SET)
    assert bench.next() is C.GTD


def test_8_2_data_after_eor_in_the_same_dat_is_ignored() -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM + b"\nO0002\n%")
    assert bench.take() == PROGRAM
    assert [notice.text for notice in bench.of(Notice)] == ["8 characters after EOR were ignored (8.2)"]


def test_8_2_a_dat_after_eor_is_ignored_and_no_other_is_asked_for() -> None:
    bench = Bench().asked().answer(C.DAT, PROGRAM)
    assert bench.next() is C.GTD
    bench.answer(C.DAT, b"%\nO0002\n%")
    assert bench.take() == PROGRAM
    assert bench.next(6) is C.SAT


def test_8_1_label_skip_passes_over_the_leading_eor() -> None:
    bench = Bench().asked().answer(C.DAT, b"TITLE % MORE\nM02\n").answer(C.DAT, b"%")
    assert bench.take() == b"TITLE % MORE\nM02\n%"
    assert bench.engine.program_ended


@pytest.mark.parametrize("code", [DataCode.ISO, DataCode.EIA])
def test_8_2_eor_of_the_other_codes(code: DataCode) -> None:
    eob, eor = (b"\x80", b"\x0b") if code is DataCode.EIA else (b"\x0a", b"\xa5")
    bench = Bench(quick(data=code)).asked().answer(C.DAT, eor + eob + b"\x61" + eob + eor)
    assert bench.take() == eor + eob + b"\x61" + eob + eor
    assert bench.engine.program_ended


def test_4_4_2_conversion_changes_the_data_of_dat_and_nothing_else() -> None:
    bench = Bench().asked(convert_from=0x3B, convert_to=0x0A).answer(C.DAT, b"%;O1;M02;%")
    assert bench.take() == b"%\nO1\nM02\n%"
    bench = Bench().asked(convert_from=0x44, convert_to=0x0A).answer(C.DAT, b"D%")
    assert bench.take() == b"\n%", "the D of DAT stays, the checksum is that of what was transmitted"


def test_4_4_1_clb_clears_the_buffer() -> None:
    bench = Bench().asked(nb=4000, no=2).answer(C.DAT, b"%\n" + b"X" * 3000).answer(C.DAT, b"X" * 1500 + b"%")
    bench.messages.clear()
    assert bench.poll().stored == 4503
    bench.answer(C.CLB)
    assert bench.engine.buffered == 0
    assert bench.next() is C.GTD, "EOR went with it"
    bench.answer(C.DAT, b"M30%")
    assert bench.take() == b"M30%"


@pytest.mark.parametrize("owed", [C.SAT, C.GTD])
def test_4_4_1_rdi_draws_sdi_and_the_answer_is_still_owed(owed: Command) -> None:
    bench = Bench(quick(di=0xA5)).ready()
    if owed is C.GTD:
        bench.start()
    else:
        bench.poll()
    bench.answer(C.RDI)
    assert bench.messages.pop() == Message(command=C.SDI, data=b"A5")
    bench.answer(*((C.SET, b"") if owed is C.SAT else (C.DAT, PROGRAM)))
    assert bench.alarms == []
    assert bench.engine.buffered == (0 if owed is C.SAT else len(PROGRAM))


def test_4_4_1_sdi_carries_the_image_of_that_moment() -> None:
    bench = Bench().asked()
    bench.engine.di = 0x3C
    assert bench.answer(C.RDI).messages.pop().data == b"3C"
    with pytest.raises(UsageError):
        bench.engine.di = 256


def test_4_4_1_after_sdi_the_answer_of_the_other_command_is_not_expected() -> None:
    bench = Bench().asked().answer(C.RDI)
    bench.messages.clear()
    bench.answer(C.SET)
    assert bench.alarms == ["SR947"]


def test_4_4_1_sdo_goes_to_do_and_gtd_is_asked_again() -> None:
    bench = Bench().asked().answer(C.SDO, b"7F")
    assert bench.engine.do == 0x7F
    assert bench.next() is C.GTD
    bench.answer(C.RDI)
    bench.messages.clear()
    bench.answer(C.SDO, b"01" + b" " * 70)
    assert bench.engine.do == 1
    assert bench.next() is C.GTD


def test_4_4_1_sdo_as_answer_to_sat_is_an_answer() -> None:
    bench = Bench().ready()
    bench.poll()
    bench.answer(C.SDO, b"10")
    assert bench.engine.do == 0x10
    assert bench.next(5.1) is C.SAT
