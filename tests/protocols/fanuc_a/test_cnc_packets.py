"""The control's end of expansion protocol A, clause by clause of B-63322EN-1 chapter 5, without a host."""

from __future__ import annotations

import itertools

import pytest

from tapewire.engine import AfterStop, Outcome
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.cnc_packets import MOST_STALE
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_a.packets import (
    Monitor,
    MonitorCode,
    MonitorSum,
    data_bytes,
    encode_monitor,
    encode_packet,
    packet_bytes,
)
from tapewire.protocols.fanuc_a.params import NakNumber, Params
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_a.cnc_bench import PROGRAM, QUICK, Bench, quick

C = Command
CAN, DC1, DC3 = (encode_monitor(monitor) for monitor in (Monitor.CAN, Monitor.DC1, Monitor.DC3))
END = 0xFF


def nak(number: int) -> bytes:
    return encode_monitor(Monitor.NAK, number=number)


def packets(params: Params = QUICK, n: int = 1) -> Bench:
    """GTD has just been said, packets may come."""
    bench = Bench(params).asked(n=n)
    assert bench.state is State.PACKETS
    return bench


def part(index: int, n: int = 1) -> bytes:
    """The data of the index-th packet of a program; none holds an EOR."""
    return (b"\n" + b"N%d" % index).ljust(data_bytes(n), b"X")


def good(index: int, n: int = 1) -> bytes:
    return encode_packet(0x30 + index % 10, part(index, n), n)


def bad(packet: bytes) -> bytes:
    """A packet with one bit of its data wrong."""
    return packet[:5] + bytes([packet[5] ^ 4]) + packet[6:]


def last(data: bytes = b"\nM30\n%", n: int = 1) -> bytes:
    return encode_packet(END, data.ljust(data_bytes(n), b"\0"), n)


# 5.1, 5.2: the mode, the packets


@pytest.mark.parametrize("n", [1, 2, 4])
def test_5_4_1_effective_packets_and_the_end_packet(n: int) -> None:
    bench = packets(n=n)
    taken = b""
    for index in range(13):
        bench.receive(good(index, n))
        taken += bench.take()
    bench.receive(last(n=n))
    taken += bench.take()
    assert bench.monitors() == b""
    assert taken == b"".join(part(index, n) for index in range(13)) + b"\nM30\n%"
    assert bench.poll().state is BufferState.RESET
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.COMPLETE)
    assert bench.ended.bytes_low == len(taken)


def test_5_2_2_a_lone_packet_is_the_end_packet() -> None:
    bench = packets().receive(last(PROGRAM))
    assert bench.take() == PROGRAM
    assert bench.state is State.RESTING


def test_5_2_2_after_an_end_packet_without_eor_gtd_asks_for_more() -> None:
    bench = packets().receive(good(0)).receive(last(b"G01"))
    assert bench.next() is C.GTD
    bench.receive(good(0))
    assert bench.engine.buffered == 3 * 256, "the numbers begin at 30h again, and the padding is data"


def test_after_an_end_packet_with_eor_no_gtd_follows() -> None:
    bench = packets().receive(last())
    assert bench.next(6) is C.SAT


def test_8_2_packets_after_eor_are_ignored_to_the_end_packet() -> None:
    bench = packets().receive(encode_packet(0x30, PROGRAM.ljust(256, b"%"), 1))
    assert bench.take() == PROGRAM
    assert bench.state is State.PACKETS
    bench.receive(good(1)).receive(last(b"\nO2\n%"))
    assert bench.next(6) is C.SAT
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.COMPLETE)
    assert bench.ended.bytes_high == len(PROGRAM)


def test_4_4_2_conversion_changes_the_data_of_packets_and_nothing_else() -> None:
    bench = Bench().asked(n=1, convert_from=0x3B, convert_to=0x0A)
    bench.receive(last(b"%;O1;M02;%"))
    assert bench.take() == b"%\nO1\nM02\n%"


def test_5_2_2_c_invalid_packets_are_discarded_but_to_begins_anew() -> None:
    bench = packets()
    for number in (0x00, 0x20, 0x3A, 0xFE):
        bench.run(15).receive(encode_packet(number, bytes(256), 1))
    assert bench.engine.buffered == 0
    bench.receive(good(0)).receive(encode_packet(0x00, bytes(256), 1)).receive(good(1))
    assert bench.engine.buffered == 512
    assert (bench.alarms, bench.monitors()) == ([], b"")


# 5.2, 5.4 3): retransmission


def test_5_4_3_i_a_checksum_error_draws_nak_with_the_number_that_is_next() -> None:
    bench = packets().receive(good(0)).receive(bad(good(1)))
    assert bench.monitors() == nak(0x31)
    bench.receive(good(2))
    assert bench.monitors() == b"", "one NAK for one error"
    bench.receive(good(1)).receive(good(2)).receive(last())
    assert bench.take() == part(0) + part(1) + part(2) + b"\nM30\n%"


def test_5_4_3_ii_a_lost_packet_draws_nak_with_the_number_that_is_next() -> None:
    bench = packets().receive(good(0)).receive(good(2))
    assert bench.monitors() == nak(0x31)
    bench.receive(good(1)).receive(good(2))
    assert bench.engine.buffered == 3 * 256


def test_5_4_3_iii_an_errored_end_packet_is_asked_for_by_the_previous_number_plus_1() -> None:
    bench = packets().receive(good(0)).receive(good(1)).receive(bad(last()))
    assert bench.monitors() == nak(0x32)
    bench.receive(last())
    assert bench.take() == part(0) + part(1) + b"\nM30\n%"


def test_5_2_2_b_a_lone_errored_end_packet_is_asked_for_as_30h() -> None:
    bench = packets().receive(bad(last(PROGRAM)))
    assert bench.monitors() == nak(0x30)
    bench.receive(last(PROGRAM))
    assert bench.take() == PROGRAM


def test_behind_an_errored_effective_packet_the_end_packet_is_stale() -> None:
    bench = packets().receive(good(0)).receive(bad(good(1))).receive(last())
    assert bench.monitors() == nak(0x31)
    assert bench.state is State.PACKETS
    bench.receive(good(1)).receive(last())
    assert bench.take() == part(0) + part(1) + b"\nM30\n%"


def test_5_2_2_numbers_go_on_from_39h_to_30h_in_a_nak_too() -> None:
    bench = packets()
    for index in range(10):
        bench.receive(good(index))
        bench.take()
    bench.receive(bad(good(10)))
    assert bench.monitors() == nak(0x30)
    bench.receive(good(10))
    assert bench.take() == part(10)


@pytest.mark.parametrize("at", range(packet_bytes(1)))
def test_the_loss_of_any_byte_of_a_packet_is_made_good(at: int) -> None:
    broken = good(1)[:at] + good(1)[at + 1 :]
    bench = packets().receive(good(0) + broken + good(2))
    assert bench.monitors() == nak(0x31)
    bench.receive(good(1) + good(2) + last())
    assert bench.take() == part(0) + part(1) + part(2) + b"\nM30\n%"


AGAIN = quick(monitors_again=Switch.ON)


def test_15_6_one_nak_for_an_error_and_none_for_the_stale_packets_behind_it() -> None:
    bench = packets().receive(bad(good(0)))
    for index in range(1, 8):
        bench.receive(good(index))
    assert bench.monitors() == nak(0x30)
    bench.receive(bad(good(0)))
    assert bench.silent(0.1), "a character more than a packet holds may have been gained"
    bench.receive(b"\x00")
    assert bench.monitors() == nak(0x30), "one more error"
    assert bench.engine.buffered == 0


def test_5_2_2_a_what_is_here_already_is_in_improper_order() -> None:
    bench = packets().receive(good(0)).receive(good(1)).receive(good(1))
    assert bench.monitors() == nak(0x32)
    bench.receive(good(2))
    assert bench.take() == part(0) + part(1) + part(2)


def test_15_6_behind_a_bad_effective_packet_the_end_packet_is_stale() -> None:
    bench = packets().receive(bad(good(0))).receive(last())
    assert bench.state is State.PACKETS
    bench.receive(good(0)).receive(last())
    assert bench.take() == part(0) + b"\nM30\n%"


@pytest.mark.parametrize(("setting", "number"), [(NakNumber.EXPECTED, 0x31), (NakNumber.RECEIVED, 0x32)])
def test_what_a_nak_names_is_a_setting(setting: NakNumber, number: int) -> None:
    bench = packets(quick(nak_number=setting)).receive(good(0)).receive(good(2))
    assert bench.monitors() == nak(number)
    bench.receive(good(1))
    assert bench.engine.buffered == 512, "what is accepted does not depend on it"


def test_4_6_2_1_more_than_ne_naks_of_one_packet_are_an_alarm_that_stops_the_host() -> None:
    bench = Bench().asked(n=1, ne=2)
    for _ in range(3):
        bench.receive(bad(good(0))).receive(good(1))
    assert bench.monitors() == nak(0x30) * 2 + CAN
    assert bench.alarms == ["SR945"]
    bench.receive(last(b""))
    status = bench.status()
    assert (status.state, status.cause) == (BufferState.ALARM, AlarmCause.CHECKSUM)
    bench.answer(C.SET)
    assert bench.ended_as(Outcome.FAILED, "SR945")


@pytest.mark.parametrize("sum_covers", MonitorSum)
@pytest.mark.parametrize("code", MonitorCode)
def test_5_3_form_and_checksum_of_monitor_packets_are_settings(code: MonitorCode, sum_covers: MonitorSum) -> None:
    bench = packets(quick(monitor=code, monitor_sum=sum_covers)).receive(bad(good(0)))
    assert bench.monitors() == encode_monitor(Monitor.NAK, number=0x30, code=code, sum_covers=sum_covers)


# 5.3 3), 4): interruption and restart


def until_dc3(n: int = 1, params: Params = QUICK) -> tuple[Bench, int]:
    """DC3 has just left; and the index of the next packet."""
    bench = packets(params, n)
    for index in itertools.count():
        bench.receive(good(index, n))
        if said := bench.monitors():
            assert said == DC3
            return bench, index + 1
    raise AssertionError


@pytest.mark.parametrize("n", [1, 2, 4])
def test_5_3_3_dc3_when_2560_are_free(n: int) -> None:
    _, index = until_dc3(n)
    assert 8192 - index * data_bytes(n) <= 2560 < 8192 - (index - 1) * data_bytes(n)


def test_5_3_4_dc1_when_4096_are_free() -> None:
    bench, index = until_dc3()
    bench.take(4096 - 8192 + index * 256 - 1)
    assert bench.monitors() == b""
    bench.take(1)
    assert bench.monitors() == DC1
    bench.receive(good(index))
    assert bench.alarms == []


def test_the_levels_of_dc3_and_dc1_are_settings() -> None:
    bench, index = until_dc3(params=quick(dc3_free=8192 - 512, dc1_free=8192 - 256))
    assert index == 2
    bench.take(256)
    assert bench.monitors() == DC1


def test_what_comes_after_dc3_is_counted() -> None:
    bench, index = until_dc3()
    bench.receive(good(index)).receive(good(index + 1)[:100])
    bench.take()
    assert bench.of(AfterStop) == [AfterStop(count=360, allowed=8192 - index * 256)]


def test_sr856_a_host_that_does_not_stop_at_dc3() -> None:
    bench, index = until_dc3()
    while not bench.alarms:
        bench.receive(good(index))
        index += 1
    assert bench.alarms == ["SR856"]
    assert index == 33
    assert bench.state is State.SYN_WAIT
    assert bench.ended_as(Outcome.FAILED, "SR856")


def test_5_4_6_an_error_in_the_interruption_is_asked_for_when_there_is_room_in_place_of_dc1() -> None:
    bench, index = until_dc3()
    bench.receive(bad(good(index)))
    assert bench.monitors() == b""
    bench.take(4096)
    assert bench.monitors() == nak(0x30 + index % 10)
    bench.receive(good(index))
    assert bench.engine.buffered == (index + 1) * 256 - 4096


def test_a_packet_that_is_found_after_all_in_the_interruption_is_not_asked_for() -> None:
    bench, index = until_dc3()
    bench.receive(b"7" + good(index))
    bench.take()
    assert bench.monitors() == DC1


def test_dc3_that_has_not_begun_to_leave_and_dc1_undo_each_other() -> None:
    bench = packets()
    bench.signals(cts=False)
    bench.pulling = False
    bench.receive(bad(good(0)))
    for index in range(24):
        bench.receive(good(index))
    assert bench.take()
    bench.pulling = True
    bench.signals()
    assert bench.monitors() == nak(0x30)


# 5.4 7): time-out


def test_5_4_7_to_from_gtd_to_the_first_packet() -> None:
    bench = packets()
    bench.run(19.9)
    assert bench.alarms == []
    bench.run(0.2)
    assert bench.alarms == ["SR944"]
    assert bench.state is State.SYN_WAIT
    assert bench.ended_as(Outcome.FAILED, "no packet")


def test_5_4_7_to_from_packet_to_packet() -> None:
    bench = packets().run(15).receive(good(0)).run(15).receive(good(1)[:-1]).run(4.9)
    assert bench.alarms == []
    bench.run(0.2)
    assert bench.alarms == ["SR944"]


def test_5_4_7_a_monitor_packet_does_not_begin_to_anew() -> None:
    bench = packets().signals(cts=False).receive(bad(good(0))).run(15).signals()
    assert bench.monitors() == nak(0x30)
    assert bench.run(5.1).alarms == ["SR944"]


@pytest.mark.parametrize(("in_hold", "alarms"), [(Switch.OFF, []), (Switch.ON, ["SR944"])])
def test_to_stands_still_while_the_control_holds_the_host_or_not(in_hold: Switch, alarms: list[str]) -> None:
    bench, _ = until_dc3(params=quick(time_out_in_hold=in_hold))
    assert bench.run(25).alarms == alarms
    if in_hold is Switch.OFF:
        bench.take()
        assert bench.monitors() == DC1
        assert bench.run(20.1).alarms == ["SR944"]


# 5.3 1): stop


def test_5_4_2_reset_says_can_and_after_the_dummy_end_packet_rst() -> None:
    bench = packets().receive(good(0)).reset()
    assert bench.monitors() == CAN
    bench.receive(good(1)).receive(last())
    assert bench.engine.buffered == 0, "the data of the end packet does not count"
    assert bench.next() is C.RST
    bench.answer(C.ARS)
    assert bench.ended_as(Outcome.CANCELLED)
    assert bench.ended.bytes_high == 256


def test_5_3_1_alarm_says_can_and_then_alm() -> None:
    bench = packets().receive(good(0)).alarm()
    assert bench.monitors() == CAN
    bench.receive(last(b""))
    assert bench.next() is C.ALM


def test_5_4_5_can_goes_out_in_the_interruption_too() -> None:
    bench, _ = until_dc3()
    bench.reset()
    assert bench.monitors() == CAN
    bench.receive(last(b""))
    assert bench.next() is C.RST


def test_to_runs_again_after_can_in_the_interruption() -> None:
    bench, _ = until_dc3()
    assert bench.reset().run(20.1).ended_as(Outcome.CANCELLED)
    assert bench.state is State.SYN_WAIT


def test_a_damaged_dummy_end_packet_is_as_good_as_another() -> None:
    bench = packets().reset().receive(bad(last(b"")))
    assert bench.next() is C.RST


def test_reset_while_gtd_goes_out_says_can_at_once_behind_it() -> None:
    bench = Bench().ready(n=1)
    bench.pulling = False
    bench.engine.cycle_start(bench.now)
    bench.engine.data_sent(3, bench.now)
    bench.reset()
    bench.pulling = True
    bench.pull()
    assert bench.monitors().endswith(b"TD\r" + CAN)
    assert bench.state is State.PACKETS


def test_5_3_1_can_is_said_once() -> None:
    bench = packets().reset()
    for index in range(9):
        bench.receive(good(index))
    assert bench.monitors() == CAN
    bench.receive(last())
    assert bench.next() is C.RST


@pytest.mark.parametrize(("behind", "again"), [(1, b""), (2, CAN)])
def test_5_3_1_reset_says_a_can_again_that_was_not_heard(behind: int, again: bytes) -> None:
    """The packet under way is finished; a second one behind CAN shows that its host did not hear it."""
    bench = packets().receive(good(0)).alarm()
    assert bench.monitors() == CAN
    for index in range(behind):
        bench.receive(good(index + 1))
    assert bench.reset().monitors() == again
    bench.receive(last(b""))
    assert bench.next() is C.RST


def test_a_can_that_was_lost_is_said_again() -> None:
    bench = packets(AGAIN).reset()
    assert bench.monitors() == CAN
    for index in range(MOST_STALE):
        bench.receive(good(index))
    assert bench.monitors() == b""
    bench.receive(good(MOST_STALE))
    assert bench.monitors() == CAN
