"""The host of protocol A: what must not happen around the end of a job and the beginning of the next."""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.engine import (
    SECOND,
    Ended,
    Notice,
    Outcome,
    SignalsIn,
)
from tapewire.protocols.fanuc_a.messages import (
    Coding,
    Command,
    Message,
    MessageReader,
    Unreadable,
    encode_message,
)
from tapewire.protocols.fanuc_a.packets import Kind, Monitor
from tapewire.protocols.fanuc_a.status import BufferState, Status
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)


def begun(handed: int, most: str = "10") -> tuple[Bench, bytes]:
    """A first DAT of which `handed` characters are out."""
    bench = Bench(Ne=most)
    bench.power_on()
    bench.arm()
    bench.host.receive_signals(SignalsIn(), bench.now)
    bench.host.receive_data(b"ECGTD\r", bench.now)
    return bench, bench.pull(handed)


class TestADatThatHasNotLeft:
    """Nothing of a job goes on after its end was told."""

    def test_er_off_ends_it(self) -> None:
        bench, _ = begun(6)
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        assert bench.host.recall
        assert bench.pull() == b""
        assert (bench.ended.outcome, bench.ended.bytes_low, bench.ended.bytes_high) == (Outcome.FAILED, 0, 1)
        assert bench.wait(1.5) == b""
        assert bench.host.progress == 1

    @pytest.mark.parametrize("recalled", [0, 7, 100])
    def test_4_1_after_er_off_what_is_out_of_a_dat_is_ended_before_anything_else_is_said(self, recalled: int) -> None:
        """There is no mark where a message begins: SYN would be the end of the DAT, if the sum happens to fit."""
        bench, _ = begun(0)
        said = bench.host.data_to_send(100)
        bench.host.data_sent(len(said), bench.now)
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        bench.host.data_discarded(recalled, bench.now)
        bench.host.data_left(len(said) - recalled, bench.now)
        said = said[: len(said) - recalled] + bench.wait(8)
        assert said.count(b"07SYN") == 1
        reader = MessageReader(Coding())
        position, reading = reader.read(said)
        assert isinstance(reading, Unreadable) is (recalled < 100)
        if recalled < 100:
            position, reading = reader.read(said, position)
        assert reading == Message(command=Command.SYN)

    def test_4_3_1_a_control_that_comes_back_by_syn_waits_for_no_rest(self) -> None:
        bench, _ = begun(100)
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        bench.pull()
        bench.host.receive_signals(SignalsIn(), bench.now)
        assert bench.answer(Command.SYN) == Message(command=Command.SYN)

    def test_5_1_after_packets_nothing_of_it_is_ended_any_more(self) -> None:
        bench = Bench(expansion=True, n="1")
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.power_on()
        bench.arm()
        sat = Status(parameters=bench.in_force, state=BufferState.RESET).encode()
        bench.host.receive_data(encode_message(Message(command=Command.SAT, data=sat), Coding()), bench.now)
        assert len(bench.pull(3)) == 3
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        bench.host.receive_signals(SignalsIn(), bench.now)
        assert bench.packets(bench.say(Command.GTD))[-1].kind is Kind.END
        assert bench.sat(BufferState.OPERATING, 0) == SET
        assert bench.ended.outcome is Outcome.COMPLETE

    def test_er_off_ends_a_packet(self) -> None:
        bench = Bench(expansion=True, n="1")
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.streaming(limit=300)
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        assert bench.pull() == b""
        assert bench.ended.bytes_high == bench.host.progress

    def test_too_many_rty_break_it_off(self) -> None:
        bench, said = begun(100, most="0")
        bench.host.receive_data(b"3DRTY1\r", bench.now)
        said += bench.pull()
        position, reading = MessageReader(Coding()).read(said)
        assert isinstance(reading, Unreadable)
        assert position == len(said) <= 102
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.FAILED, 95)

    def test_an_answer_said_meanwhile_is_kept(self) -> None:
        bench, said = begun(100)
        bench.host.abort(bench.now)
        bench.host.receive_data(b"06RST\r", bench.now)
        assert bench.messages((said + bench.pull()).split(b"\r", 1)[1]) == [Message(command=Command.ARS)]

    def test_a_packet_that_goes_on_is_counted(self) -> None:
        """It is finished, since the control counts its characters; the end may be told before."""
        bench = Bench(expansion=True, n="4")
        bench.streaming(limit=100)
        bench.host.abort(bench.now)
        bench.host.handle_timer(bench.host.next_deadline() or 0)
        bench.now += 1_100_000_000
        bench.host.handle_timer(bench.now)
        bench.drain()
        [ended] = bench.all(Ended)
        bench.pull()
        assert ended.bytes_high == bench.host.progress == 1024


class TestWishes:
    """CLB and SYN belong between jobs."""

    @pytest.mark.parametrize("command", [Command.CLB, Command.SYN])
    @pytest.mark.parametrize("when", ["before start", "armed"])
    def test_they_are_never_said_in_a_job(self, command: Command, when: str) -> None:
        bench = Bench()
        bench.power_on()
        wish = bench.host.clear_buffer if command is Command.CLB else bench.host.initialise
        if when == "armed":
            bench.arm()
        wish(bench.now)
        if when == "before start":
            bench.arm()
        assert bench.answer(Command.GTD).command is Command.DAT
        assert bench.sat(BufferState.OPERATING, 100) == SET
        [notice] = bench.all(Notice)
        assert notice.text == f"{command.value} was not said any more: a job has begun"


class TestObstacle:
    """A control that does not take what SET asks for."""

    @pytest.mark.parametrize(
        ("kept", "reason"),
        [
            ({"convert_from": 0x58, "convert_to": 0x59}, "turns 58h of the program into 59h"),
            ({"n": 4}, r"n=4"),
        ],
    )
    def test_no_program_is_sent_to_it(self, kept: dict[str, int], reason: str) -> None:
        bench = Bench()
        bench.in_force = dataclasses.replace(bench.params.wanted, **kept)
        bench.answer(Command.SYN)
        bench.answer(Command.RDY)
        bench.arm()
        for _ in range(2):
            bench.sat()
        assert bench.answer(Command.GTD) == WAT
        assert bench.answer(Command.GTD) == WAT
        [notice] = bench.all(Notice)
        assert notice.text.startswith("the program waits: ")
        assert bench.all(Ended) == []
        bench.sat()
        bench.sat()
        assert bench.answer(Command.GTD) == WAT
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.FAILED, 0)
        assert reason in bench.ended.reason
        assert bench.answer(Command.GTD) == WAT

    def test_one_that_takes_it_late_gets_the_program(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.in_force = dataclasses.replace(bench.params.wanted, convert_from=0x58, convert_to=0x59)
        bench.sat()
        bench.arm()
        assert bench.answer(Command.GTD) == WAT
        bench.in_force = bench.params.wanted
        bench.sat()
        assert bench.answer(Command.GTD).command is Command.DAT

    def test_a_conversion_into_the_same_byte_is_none(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.in_force = dataclasses.replace(bench.params.wanted, convert_from=0x58, convert_to=0x58)
        bench.sat()
        bench.arm()
        assert bench.answer(Command.GTD).command is Command.DAT


def test_what_packets_of_one_job_have_proven_is_not_credited_to_the_next() -> None:
    bench = Bench(expansion=True, n="1")
    bench.streaming(limit=3500)
    bench.monitor(Monitor.DC3)
    bench.host.abort(bench.now)
    bench.wait(1.5)
    assert bench.ended.bytes_low > 295
    bench.arm()
    bench.say(Command.RST)
    bench.sat()
    bench.host.receive_data(b"ECGTD\r", bench.now)
    bench.pull(300)
    bench.say(Command.ALM)
    second = bench.all(Ended)[1]
    assert (second.outcome, second.bytes_low, second.bytes_high) == (Outcome.FAILED, 0, 295)


def test_the_rest_of_a_packet_is_not_counted_for_the_next_job() -> None:
    bench = Bench(expansion=True, n="4")
    bench.streaming(limit=1028 + 100)
    bench.host.abort(bench.now)
    bench.now += 2 * SECOND
    bench.host.handle_timer(bench.now)
    bench.arm()
    bench.pull()
    assert bench.host.progress == 0


def test_an_sdi_that_came_damaged_is_asked_for_again() -> None:
    bench = Bench()
    bench.sending()
    bench.host.read_di(bench.now)
    assert bench.answer(Command.GTD) == Message(command=Command.RDI)
    assert bench.say_raw(b"62SDIA5\r") == b""
    assert bench.wait(0.1) == b"3DRTY1\r"
    assert bench.say(Command.SDI, b"A5") == b""
    [answer] = bench.messages(bench.wait(1))
    assert answer.data == PROGRAM[3488:6976]
    assert bench.host.di == 0xA5
    assert bench.all(Ended) == []


class TestNotExecuted:
    """COMPLETE needs an empty buffer."""

    def test_reset_with_bytes_in_the_buffer(self) -> None:
        bench = Bench()
        bench.delivered()
        bench.sat(BufferState.OPERATING, 12)
        bench.sat(BufferState.RESET, 12)
        assert bench.ended.outcome is Outcome.CANCELLED
        assert bench.ended.reason.startswith("delivered whole, not executed")

    def test_rst_before_eod(self) -> None:
        bench = Bench(rst_at_end="complete")
        bench.sending(b"%\nM30\n%")
        bench.sat(BufferState.OPERATING, 7)
        bench.answer(Command.RST)
        assert bench.ended.outcome is Outcome.CANCELLED

    def test_rst_after_eod_with_bytes_in_the_buffer(self) -> None:
        bench = Bench(rst_at_end="complete")
        bench.delivered()
        bench.sat(BufferState.OPERATING, 12)
        bench.answer(Command.RST)
        assert bench.ended.outcome is Outcome.CANCELLED


def test_rst_in_the_middle_of_a_dat_cancels() -> None:
    bench, said = begun(100)
    dat, rest = (said + bench.say(Command.RST)).split(b"\r", 1)
    assert isinstance(MessageReader(Coding()).read(dat + b"\r")[1], Unreadable)
    assert bench.messages(rest) == [Message(command=Command.ARS)]
    assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.CANCELLED, 95)


def test_to_give_up_what_has_not_begun_needs_no_reset() -> None:
    bench = Bench()
    bench.power_on()
    bench.arm()
    bench.host.abort(bench.now)
    bench.drain()
    assert bench.ended.reason == "given up here; nothing of it was sent"
