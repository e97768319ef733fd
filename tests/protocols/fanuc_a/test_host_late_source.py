"""The host of protocol A while a GTD waits for a source that has nothing yet: noise, RTY, and the beginning again."""

from __future__ import annotations

import pytest

from tapewire.engine import Outcome
from tapewire.protocols.fanuc_a.messages import Command, Message
from tapewire.protocols.fanuc_a.status import BufferState
from tests.protocols.fanuc_a.host_bench import Bench, Trickle

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)
RTY = b"3DRTY1\r"
HEAD, REST = b"%\nO1\nG91X1.\n", b"X2.\n" * 5 + b"M30\n%"


def waiting() -> tuple[Bench, Trickle]:
    """HEAD has been sent and taken; the next GTD waits."""
    bench, source = Bench(), Trickle(HEAD)
    bench.power_on()
    bench.arm(source)
    assert bench.say(Command.GTD) == b""
    assert [message.data for message in bench.messages(bench.wait(1.1))] == [HEAD]
    assert bench.say(Command.GTD) == b""
    return bench, source


@pytest.mark.parametrize("noise_at", [0.1, 0.5, 0.6, 0.85, 0.93, 0.99])
@pytest.mark.parametrize("heard_after", [0.01, 0.1])
def test_4_6_3_no_dat_and_no_wat_follows_our_rty(noise_at: float, heard_after: float) -> None:
    """The control repeats GTD meanwhile and hears nothing; that GTD would prove a DAT that it has not."""
    bench, source = waiting()
    bench.wait(noise_at)
    assert bench.say_raw(b"\x55\r") == b""
    source.data, source.closed = REST, True
    assert bench.wait(0.06) == RTY
    assert bench.wait(heard_after) == b""
    assert bench.say(Command.GTD) == b""
    [dat] = bench.messages(bench.wait(1))
    assert dat.data == REST
    assert bench.answer(Command.GTD) == EOD


def test_4_6_the_answer_waits_while_what_could_not_be_read_goes_on() -> None:
    bench, source = waiting()
    bench.say_raw(b"\x55\r")
    source.data, source.closed = REST, True
    for _ in range(60):
        assert bench.wait(0.03) == b""
        bench.say_raw(b"\x55")
    assert bench.wait(0.06) == RTY


def test_4_6_2_asked_too_often_the_waiting_control_gets_wat() -> None:
    bench = Bench(Ne="0")
    bench.power_on()
    bench.arm(Trickle(HEAD))
    bench.say(Command.GTD)
    bench.wait(1.1)
    bench.say(Command.GTD)
    bench.say_raw(b"\x55\r")
    assert bench.messages(bench.wait(0.06)) == [WAT]
    assert bench.ended.outcome is Outcome.FAILED


def test_4_4_1_rty_after_a_gtd_does_not_draw_the_dat_before_it() -> None:
    """That GTD has said that the DAT was taken: its blocks would be executed twice."""
    bench, source = waiting()
    assert bench.answer(Command.RTY, b"1") == WAT
    assert bench.wait(0.9) == b""
    source.data, source.closed = REST, True
    assert bench.answer(Command.GTD).data == REST
    assert bench.answer(Command.GTD) == EOD
    assert bench.sat(BufferState.OPERATING) == SET
    assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.COMPLETE, len(HEAD + REST))


def test_4_4_1_rty_after_the_first_gtd_does_not_draw_the_set_before_it() -> None:
    bench = Bench()
    bench.power_on()
    bench.arm(Trickle(HEAD))
    assert bench.say(Command.GTD) == b""
    assert bench.answer(Command.RTY, b"1") == WAT


def test_a_message_kept_for_our_rty_gives_way_to_one_that_is_obeyed() -> None:
    """The control asks for the RTY again, and repeats the GTD after it: one answer, not two."""
    bench = Bench()
    bench.sending()
    bench.say_raw(b"\x55\r")
    assert bench.wait(0.06) == RTY
    assert bench.say(Command.GTD) == b""
    assert bench.say(Command.RTY, b"1") == RTY
    assert bench.wait(1) == b""
    assert bench.say(Command.GTD) == b""
    [dat] = bench.messages(bench.wait(1))
    assert dat.command is Command.DAT


class TestTheSameReading:
    """8.2: what ends a reading is EOR, and not that the buffer is empty."""

    @pytest.mark.parametrize("expansion", [False, True])
    def test_after_a_program_without_eor_the_next_one_waits_for_a_beginning(self, expansion: bool) -> None:
        """Its own EOR would end the first reading, and the control would take it for the end of the first program."""
        bench = Bench(expansion, n="1") if expansion else Bench()
        first = b"%\n" + b"X2.\n" * 63 + b"M0" if expansion else b"%\nO1\nM30\n"
        if expansion:
            bench.streaming(first)
        else:
            bench.sending(first)
            assert bench.answer(Command.GTD) == EOD
        assert bench.sat(BufferState.OPERATING) == SET
        assert bench.ended.outcome is Outcome.COMPLETE
        bench.arm(b"%\nO2\nM30\n%")
        if not expansion:
            assert bench.answer(Command.GTD) == WAT
            assert bench.sat(BufferState.RESET) == SET
            assert bench.answer(Command.GTD).data == b"%\nO2\nM30\n%"
        else:
            bench.host.receive_data(b"ECGTD\r", bench.now)
            assert bench.pull(260) == b""
            assert bench.packets(bench.wait(2))[0].number == 0

    def test_after_an_end_packet_that_holds_eor_the_next_one_begins(self) -> None:
        bench = Bench(expansion=True, n="1")
        bench.streaming(b"%\nO1\nM30\n%")
        assert bench.sat(BufferState.OPERATING) == SET
        assert bench.ended.outcome is Outcome.COMPLETE
        bench.arm(b"%\nO2\nM30\n%")
        assert bench.packets(bench.say(Command.GTD))[0].data.startswith(b"%\nO2\nM30\n%")
