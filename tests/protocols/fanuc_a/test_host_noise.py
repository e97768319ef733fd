"""The host of protocol A and expansion A: noise that goes on, words of which every character is damaged, and a control
that is gone.
"""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.engine import SECOND, Ended, Held, LineFault, Notice, Outcome, SignalsIn
from tapewire.protocols.fanuc_a.messages import Command, Message
from tapewire.protocols.fanuc_a.packets import Monitor
from tapewire.protocols.fanuc_a.status import BufferState, Status
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench, Trickle

WAT, SET, SYN = Message(command=Command.WAT), Message(command=Command.SET), Message(command=Command.SYN)
RTY = b"3DRTY1\r"


def faults(bench: Bench, count: int, fault: LineFault = LineFault.PARITY) -> None:
    """`count` characters 10 ms apart, each damaged and none delivered."""
    for _ in range(count):
        bench.host.receive_line_fault(fault, 0x55, bench.now)
        bench.wait(0.01)


def with_a_conversion_of_another_host() -> Bench:
    """A control that has it in force, and a host with a program armed that has seen its SAT."""
    bench = Bench()
    bench.in_force = dataclasses.replace(bench.params.wanted, convert_from=0x3B, convert_to=0x0A)
    bench.answer(Command.SYN)
    bench.answer(Command.RDY)
    bench.arm()
    bench.sat()
    return bench


class TestEveryCharacterDamaged:
    """Nothing of such a word is delivered: the faults alone tell of it."""

    def test_4_6_a_message_is_asked_for_again(self) -> None:
        bench = Bench()
        bench.sending()
        faults(bench, 6)
        assert bench.wait(0.06) == RTY
        assert bench.say(Command.GTD) == b""
        [dat] = bench.messages(bench.wait(1))
        assert dat.data == PROGRAM[3488:6976]
        assert bench.all(Ended) == []

    def test_rty_waits_until_the_last_of_them(self) -> None:
        bench = Bench()
        bench.sending()
        for _ in range(40):
            bench.host.receive_line_fault(LineFault.FRAMING, 0x55, bench.now)
            assert bench.wait(0.03) == b""
        assert bench.wait(0.06) == RTY

    @pytest.mark.parametrize(("count", "fault"), [(5, LineFault.PARITY), (1, LineFault.BREAK)])
    def test_5_3_what_may_have_been_a_monitor_packet_holds_the_transfer(self, count: int, fault: LineFault) -> None:
        """A NAK that goes unheard leaves a hole of ten packets."""
        bench = Bench(True, n="1")
        bench.streaming(limit=50)
        for _ in range(count):
            bench.host.receive_line_fault(fault, None, bench.now)
        assert len(bench.pull()) == 260 - 50
        assert bench.wait(20) == b""
        assert len(bench.all(Held)) == 1
        bench.wait(1.1)
        assert bench.ended.outcome is Outcome.FAILED

    def test_fewer_are_no_word(self) -> None:
        bench = Bench(True, n="1")
        bench.streaming(limit=50)
        for _ in range(3):
            faults(bench, 4)
            bench.wait(1)
        assert bench.all(Held) == []

    def test_one_before_a_good_monitor_packet_damages_nothing_later(self) -> None:
        bench = Bench(True, n="1")
        bench.streaming(limit=50)
        faults(bench, 1)
        bench.monitor(Monitor.DC3)
        assert len(bench.all(Held)) == 1
        assert bench.say(Command.SYN) == b"07SYN\r"


class TestItEnds:
    """No noise keeps a job for ever."""

    @pytest.mark.parametrize("noise", [b"\x55", b"\x55\r"])
    def test_4_6_2_noise_without_end_fails_the_job(self, noise: bytes) -> None:
        bench = Bench(Ne="3")
        bench.sending()
        bench.say_raw(b"\x55\r")
        for _ in range(60 * 33):
            bench.say_raw(noise)
            bench.wait(0.03)
        assert bench.ended.outcome is Outcome.FAILED

    def test_noise_that_never_had_an_end_code_is_silence(self) -> None:
        bench = Bench()
        bench.sending()
        for _ in range(30 * 33):
            bench.say_raw(b"\x55")
            bench.wait(0.03)
        assert bench.ended.outcome is Outcome.FAILED

    def test_among_packets_a_hold_by_noise_does_not_begin_anew(self) -> None:
        bench = Bench(True, n="1")
        bench.streaming(limit=50)
        bench.say_raw(b"\x93\r")
        for _ in range(3):
            bench.wait(6.9)
            bench.say_raw(b"\x93\r")
        bench.wait(1)
        assert bench.ended.outcome is Outcome.FAILED

    def test_a_control_that_asks_for_the_program_and_takes_no_set_is_given_up(self) -> None:
        bench = with_a_conversion_of_another_host()
        for _ in range(61):
            assert bench.answer(Command.GTD) == WAT
            bench.now += SECOND
        [notice] = bench.all(Notice)
        assert "RESET it" in notice.text
        assert bench.all(Ended) == []
        assert bench.answer(Command.GTD) == WAT
        assert bench.ended.reason.startswith("nothing was sent: the control turns 3Bh")
        assert bench.ended.reason.endswith(" for 60 s")

    def test_its_operator_has_as_long_again_after_reset(self) -> None:
        bench = with_a_conversion_of_another_host()
        bench.answer(Command.GTD)
        bench.now += 100 * SECOND
        bench.answer(Command.RST)
        assert bench.answer(Command.GTD) == WAT
        assert bench.all(Ended) == []


class TestEROff:
    """4.6 1): what the control asked before is no question any more."""

    def test_a_late_source_gets_no_dat_to_a_control_that_is_gone(self) -> None:
        bench, source = Bench(), Trickle(b"%\nO1\n")
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.power_on()
        bench.arm(source)
        assert bench.say(Command.GTD) == b""
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        source.data, source.closed = b"M30\n%", True
        assert bench.wait(2) == b""
        bench.host.receive_signals(SignalsIn(), bench.now)
        assert bench.answer(Command.SYN) == SYN
        assert bench.all(Ended) == []

    @pytest.mark.parametrize("crossed", [False, True])
    def test_neither_rty_nor_a_kept_answer_goes_to_it(self, crossed: bool) -> None:
        bench = Bench()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.sending()
        bench.say_raw(b"\x55\r")
        if crossed:
            assert bench.wait(0.06) == RTY
            assert bench.say(Command.GTD) == b""
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        assert bench.wait(2) == b""
        assert bench.ended.outcome is Outcome.FAILED


def test_noise_that_draws_no_rty_leaves_what_waits_for_its_answer() -> None:
    """A control that has said SAT is answered, though something like a monitor packet comes behind it."""
    bench = Bench(True)
    bench.streaming(b"%\nO1\nM30\n%")
    bench.say_raw(b"\x55\r")
    assert bench.wait(0.2) == RTY
    bench.say(Command.SAT, Status(state=BufferState.OPERATING, stored=5, parameters=bench.in_force).encode())
    bench.wait(0.01)
    bench.say_raw(b"\x11\x20\x00\x00\x0d")
    assert bench.messages(bench.wait(1)) == [SET]
