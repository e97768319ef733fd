"""The control's end of protocol A: busy control by RS, RESET, alarms (B-63322EN-1 4.3 (5), 4.4.1, 8.2)."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import AfterStop, Ended, Outcome
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.messages import Command, Message, RetryReason
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState
from tests.protocols.fanuc_a.cnc_bench import PROGRAM, Bench

C = Command


# 4.3 (5): RS


def nearly_full() -> Bench:
    """GTD has just been said with 2342 bytes free: with No = 50 RS goes OFF at 2292 bytes of a DAT that is too long."""
    bench = Bench().asked()
    for _ in range(3):
        bench.answer(C.DAT, b"\n" + b"X" * 1949)
    bench.run(0.1)
    bench.messages.clear()
    return bench


LONG = Bench().host(C.DAT, b"X" * 2500)
RS_OFF_AT = 5 + 2292


def test_4_3_5_rs_is_on_for_every_legal_dat() -> None:
    bench = nearly_full()
    for byte in Bench().host(C.DAT, b"X" * 1950):
        bench.receive(bytes([byte]))
        assert bench.engine.signals.rts
    assert bench.engine.buffered == 4 * 1950


def test_4_3_5_rs_goes_off_when_only_no_bytes_still_fit() -> None:
    bench = nearly_full().receive(LONG[: RS_OFF_AT - 1])
    assert bench.engine.signals.rts
    bench.receive(LONG[RS_OFF_AT - 1 : RS_OFF_AT])
    assert not bench.engine.signals.rts
    assert bench.silent(600)
    assert bench.alarms == [], "To does not run while the control holds the host"


def test_4_3_5_rs_goes_on_when_more_than_nb_is_free_again() -> None:
    bench = nearly_full().receive(LONG[:RS_OFF_AT])
    bench.receive(LONG[RS_OFF_AT : RS_OFF_AT + 50])
    while not bench.engine.signals.rts:
        assert bench.take(1)
    assert bench.engine.buffered == 8192 - RS_OFF_AT + 5 - 50 - 2001
    assert bench.of(AfterStop) == [AfterStop(count=50, allowed=50)]
    bench.receive(LONG[RS_OFF_AT + 50 :])
    assert bench.alarms == []
    assert len(bench.take()) == 8192 - 2001 - 2342 + 2500


def test_4_4_2_6_more_than_no_bytes_after_rs_off_draw_rty_3() -> None:
    bench = nearly_full().receive(LONG[: RS_OFF_AT + 51])
    assert bench.engine.signals.rts, "the message is lost, its rest may come"
    bench.receive(LONG[RS_OFF_AT + 51 :])
    assert bench.of(AfterStop) == [AfterStop(count=51, allowed=50)]
    bench.run(0.1)
    assert bench.messages.pop() == Message(command=C.RTY, data=RetryReason.OVERRUN.value)
    bench.answer(C.DAT, b"X" * 1950)
    assert bench.engine.buffered == 4 * 1950


def test_4_6_2_3_more_than_ne_overruns_are_alarm_state_cause_a() -> None:
    bench = nearly_full()
    for _ in range(11):
        bench.receive(LONG).run(0.1)
    assert bench.alarms == ["SR945"]
    assert bench.messages[-1].data[1:3] == b"3A"


def test_rs_goes_on_when_the_operation_is_over() -> None:
    bench = nearly_full().receive(LONG[:RS_OFF_AT]).alarm()
    assert bench.engine.signals.rts
    assert bench.receive(LONG[RS_OFF_AT:]).next() is C.ALM


# RESET, alarms, the operator


def test_8_2_reset_loses_the_buffer_and_rst_waits_for_the_answer_still_owed() -> None:
    bench = Bench().asked().answer(C.DAT, b"%\nO0001\n" + b"X" * 100)
    assert bench.take(5) == b"%\nO00"
    bench.run(0.1)
    bench.messages.clear()
    bench.reset()
    assert bench.engine.buffered == 0
    assert bench.silent(1)
    bench.answer(C.DAT, b"X" * 100)
    assert bench.engine.buffered == 0
    assert bench.next() is C.RST
    assert not bench.of(Ended), "the host is still to hear of it"
    bench.answer(C.ARS)
    assert bench.ended_as(Outcome.CANCELLED, "RESET")
    assert (bench.ended.bytes_low, bench.ended.bytes_high) == (5, 108)
    assert bench.poll().state is BufferState.RESET


def test_4_4_1_alm_then_state_3_cause_0_until_reset() -> None:
    bench = Bench().asked().alarm().answer(C.WAT)
    assert bench.next() is C.ALM
    bench.answer(C.AAL)
    assert bench.ended_as(Outcome.FAILED, "alarm of the CNC")
    status = bench.poll()
    assert (status.state, status.cause) == (BufferState.ALARM, AlarmCause.NC_ALARM)
    bench.answer(C.SET)
    assert bench.reset().next() is C.RST
    bench.answer(C.ARS)
    assert bench.poll().state is BufferState.RESET


def test_reset_while_idle_is_told_too() -> None:
    assert Bench().ready().reset().next() is C.RST


def test_reset_takes_the_place_of_an_alarm_not_yet_told() -> None:
    bench = Bench().asked().alarm().reset().answer(C.WAT)
    assert bench.next() is C.RST
    bench.answer(C.ARS)
    assert bench.ended_as(Outcome.FAILED)
    assert bench.next(5.2) is C.SAT


def test_reset_before_the_line_is_up_ends_the_operation_at_once() -> None:
    bench = Bench().powered()
    bench.engine.cycle_start(bench.now)
    bench.reset()
    assert bench.ended_as(Outcome.CANCELLED)
    bench.answer(C.SYN).answer(C.RDY)
    assert bench.messages[-1].command is C.SAT


def test_an_alarm_before_the_line_is_up_is_told_when_it_is() -> None:
    bench = Bench().powered().alarm().answer(C.SYN).answer(C.RDY)
    assert bench.messages[-1].command is C.ALM


def test_an_answer_that_does_not_come_after_reset_ends_the_operation_all_the_same() -> None:
    bench = Bench().asked().reset().run(21)
    assert bench.ended_as(Outcome.CANCELLED)
    assert bench.state is State.SYN_WAIT


def test_the_next_operation_can_begin_when_the_last_has_ended() -> None:
    bench = Bench().asked()
    with pytest.raises(UsageError, match="press RESET"):
        bench.engine.cycle_start(bench.now)
    bench.reset().answer(C.WAT).answer(C.ARS)
    bench.events.clear()
    bench.messages.clear()
    bench.start().answer(C.DAT, PROGRAM)
    assert bench.take() == PROGRAM


def test_protocol_a_has_no_punch_out() -> None:
    with pytest.raises(UsageError, match="protocol B"):
        Bench().engine.punch(BytesIO(), 0)


def test_a_closed_line_ends_everything() -> None:
    bench = Bench().asked().answer(C.DAT, b"\nX")
    bench.close()
    assert bench.ended_as(Outcome.FAILED, "SR855")
    assert bench.engine.next_deadline() is None
    with pytest.raises(UsageError, match="closed"):
        bench.engine.cycle_start(bench.now)
