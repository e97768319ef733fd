"""The host of protocol A: SAT, SET and the parameters (4.4.2, 4.5)."""

from __future__ import annotations

import pytest

from tapewire.engine import (
    SECOND,
    Ended,
    Notice,
    Outcome,
    Violation,
)
from tapewire.protocols.fanuc_a.host import State
from tapewire.protocols.fanuc_a.messages import (
    Coding,
    Command,
    Message,
    encode_message,
)
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState, Parameters, Setting, Status
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)


class Test442:
    """Data parts: SAT and SET."""

    def test_set_asks_for_what_this_host_wants(self) -> None:
        bench = Bench()
        bench.answer(Command.SYN)
        asked = Setting.parse(bench.sat().data, Parameters())
        assert asked.parameters == Parameters(nb=4000, no=512, tp=2, ti=0, tx=0, tw=1)
        bench.in_force = asked.parameters
        assert bench.sat() == SET

    @pytest.mark.parametrize(("length", "positions"), [("56", 56), ("72", 72)])
    def test_length_and_switching(self, length: str, positions: int) -> None:
        bench = Bench(set_length=length, switching="1", set_data="always")
        bench.answer(Command.SYN)
        for _ in range(5):
            data = bench.sat().data
            assert (len(data), data[:1]) == (positions, b"1")

    def test_the_conversion_is_the_jobs_own(self) -> None:
        """An earlier host's is not echoed."""
        bench = Bench(convert_from="59", convert_to="10")
        bench.in_force = Parameters(convert_from=0x41, convert_to=0x42)
        bench.answer(Command.SYN)
        asked = Setting.parse(bench.sat().data, Parameters()).parameters
        assert (asked.convert_from, asked.convert_to) == (0x3B, 0x0A)
        plain = Bench()
        plain.in_force = Parameters(convert_from=0x41, convert_to=0x42, n=4)
        plain.answer(Command.SYN)
        asked = Setting.parse(plain.sat().data, Parameters()).parameters
        assert (asked.convert_from, asked.convert_to, asked.n) == (0, 0, 0)

    def test_a_control_that_keeps_its_own_is_told_three_times(self) -> None:
        bench = Bench()
        bench.answer(Command.SYN)
        assert [bool(bench.sat().data) for _ in range(6)] == [True] * 3 + [False] * 3
        [notice] = bench.all(Notice)
        assert "nb is 2000, not 4000" in notice.text
        bench.arm()
        assert len(bench.answer(Command.GTD).data) == 1950

    def test_dat_is_as_long_as_both_agree(self) -> None:
        """15.1, 15.9: a SET that no SAT has confirmed may be in force or not."""
        bench = Bench()
        bench.answer(Command.SYN)
        bench.arm()
        bench.sat()
        assert len(bench.answer(Command.GTD).data) == 1950
        bench.in_force = bench.params.wanted
        bench.sat(BufferState.OPERATING, 1950)
        assert len(bench.answer(Command.GTD).data) == 3488
        assert len(Bench(longest_dat="100").sending().data) == 100

    def test_dat_is_what_the_line_carries_in_half_of_to(self) -> None:
        """15.13: 62 characters in 0.62 s are 100 a second, and To is 20 s."""
        bench = Bench()
        bench.answer(Command.SYN)
        bench.arm()
        bench.in_force = bench.params.wanted
        bench.host.receive_data(encode_message(Message(command=Command.SAT, data=b"01000000"), Coding()), bench.now)
        said = bench.host.data_to_send(100)
        bench.host.data_sent(len(said), bench.now)
        bench.now += SECOND * len(said) // 100
        bench.host.data_left(len(said), bench.now)
        assert len(bench.answer(Command.GTD).data) == 1000

    def test_no_room_at_all(self) -> None:
        bench = Bench()
        bench.answer(Command.SYN)
        bench.in_force = Parameters(nb=10, no=50)
        for _ in range(4):
            bench.sat()
        bench.arm()
        assert bench.answer(Command.GTD) == WAT
        assert "no room" in bench.all(Violation)[-1].what

    def test_reset_state_in_the_middle_cancels(self) -> None:
        bench = Bench()
        first = bench.sending()
        assert bench.sat(BufferState.RESET) == SET
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.CANCELLED, len(first.data))

    def test_reset_state_after_the_end_completes(self) -> None:
        bench = Bench()
        bench.delivered()
        assert bench.sat(BufferState.RESET, 0) == SET
        assert bench.ended.outcome is Outcome.COMPLETE
        assert bench.answer(Command.GTD) == WAT

    def test_operating_after_the_last_dat_proves_it(self) -> None:
        bench = Bench()
        bench.sending(PROGRAM[:100])
        bench.sat(BufferState.OPERATING, 100)
        assert bench.host.state is State.DELIVERED

    @pytest.mark.parametrize(
        ("state", "cause", "why"),
        [
            (BufferState.ALARM, AlarmCause.CHECKSUM, "checksum"),
            (BufferState.ALARM, AlarmCause.NC_ALARM, "NC alarm"),
            (BufferState.OPEN_LINE, AlarmCause.NC_ALARM, "open_line"),
            (BufferState.NOT_READY, AlarmCause.NC_ALARM, "not_ready"),
        ],
    )
    def test_a_last_dat_is_not_proven_by_these(self, state: BufferState, cause: AlarmCause, why: str) -> None:
        """After dropped data the remote buffer goes on with SAT in state 3."""
        bench = Bench()
        bench.sending(PROGRAM[:100])
        assert bench.sat(state, cause=cause) == SET
        assert bench.ended.outcome is Outcome.FAILED
        assert why in bench.ended.reason
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (0, 100)


SHIFTED = Parameters(nb=250, no=32, ne=0, tp=40960, to=8193, ti=16384, tx=0, tw=0)
RTY, FEW = Command.RTY, {"10": 3, "1": 1, "0": 0}


def hear(
    bench: Bench,
    state: BufferState = BufferState.RESET,
    stored: int = 0,
    *,
    says: Parameters | None = SHIFTED,
    cause: AlarmCause = AlarmCause.NC_ALARM,
) -> list[Command]:
    """What draws a SAT that has these parameters, or those in force."""
    status = Status(state=state, stored=stored, parameters=says or bench.in_force, cause=cause)
    return [message.command for message in drawn(bench, status.encode())]


def drawn(bench: Bench, data: bytes = Status(state=BufferState.RESET, parameters=SHIFTED).encode()) -> list[Message]:
    """What a SAT with these data draws."""
    return bench.messages(bench.say(Command.SAT, data) + bench.wait(0.5))


def set_of_all(bench: Bench) -> Message:
    """The SET that says every parameter."""
    return Message(command=Command.SET, data=Setting(parameters=bench.params.wanted).encode())


class TestSatThatCannotBe:
    """4.5: the sum of 4.1 does not see a 0 lost and another doubled: all between them is shifted."""

    def test_4_5_what_no_control_can_have_is_not_believed(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        assert hear(bench) == [RTY]
        assert "Tp = 40960" in bench.all(Violation)[-1].what
        assert hear(bench, says=None) == [Command.SET]
        silence = bench.host.next_deadline()
        assert silence is not None
        assert silence - bench.now < 10 * SECOND
        assert bench.answer(Command.GTD).command is Command.DAT

    @pytest.mark.parametrize(("state", "stored"), [(BufferState.RESET, 0), (BufferState.OPERATING, 0)])
    def test_4_5_its_state_does_not_prove_the_last_dat(self, state: BufferState, stored: int) -> None:
        """The DAT was refused (state 3, cause 1), and that came shifted."""
        bench = Bench()
        bench.sending(PROGRAM[:100])
        assert hear(bench, state, stored) == [RTY]
        assert (bench.host.state, bench.all(Ended)) == (State.SENDING, [])
        assert hear(bench, BufferState.ALARM, says=None, cause=AlarmCause.CHECKSUM) == [Command.SET]
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.FAILED, 0)
        assert "checksum" in bench.ended.reason

    def test_4_5_its_stored_bytes_do_not_complete(self) -> None:
        bench = Bench()
        bench.delivered()
        assert hear(bench, BufferState.OPERATING, 0) == [RTY]
        assert bench.all(Ended) == []
        assert hear(bench, BufferState.OPERATING, 10, says=None) == [Command.SET]
        assert bench.all(Ended) == []
        assert hear(bench, BufferState.OPERATING, 0, says=None) == [Command.SET]
        assert bench.ended.outcome is Outcome.COMPLETE

    @pytest.mark.parametrize("most", FEW)
    def test_4_5_a_control_that_always_says_so_makes_the_job_failed(self, most: str) -> None:
        """Not for ever, and with the value in the reason; a SET of all may mend it for the next job."""
        bench = Bench(Ne=most)
        bench.delivered()
        assert [hear(bench, BufferState.OPERATING, 0) for _ in range(FEW[most])] == [[RTY]] * FEW[most]
        assert drawn(bench) == [set_of_all(bench)]
        assert bench.ended.outcome is Outcome.FAILED
        assert "delivered whole, not executed: nothing that" in bench.ended.reason
        assert "SAT with Tp = 40960 s: 1 to 99 is possible" in bench.ended.reason
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (len(PROGRAM), len(PROGRAM))
        assert drawn(bench) == [SET], "and it is asked no more"

    def test_4_5_the_next_job_is_served_when_that_set_has_mended_it(self) -> None:
        bench = Bench()
        bench.delivered()
        for _ in range(4):
            hear(bench, BufferState.OPERATING)
        assert hear(bench, says=None) == [Command.SET]
        bench.arm()
        assert bench.answer(Command.GTD).command is Command.DAT

    def test_4_5_and_where_it_has_not_each_job_has_its_own(self) -> None:
        """The parameters that were last believed are those wanted, so that nothing looks as if it had to be changed."""
        bench = Bench()
        bench.delivered()
        for _ in range(4):
            hear(bench, BufferState.OPERATING)
        for jobs in range(2, 4):
            bench.arm()
            assert [hear(bench) for _ in range(3)] == [[RTY]] * 3
            assert drawn(bench) == [set_of_all(bench)]
            assert len(bench.all(Ended)) == jobs - 1
            assert [hear(bench) for _ in range(4)] == [[RTY]] * 3 + [[Command.SET]]
            assert len(bench.all(Ended)) == jobs
            assert bench.all(Ended)[-1].reason.startswith("nothing was sent: ")

    def test_4_5_what_it_held_before_our_first_set_may_be_mended_by_that(self) -> None:
        bench = Bench()
        bench.arm()
        assert bench.answer(Command.SYN).command is Command.SYN
        assert [hear(bench) for _ in range(3)] == [[RTY]] * 3
        assert drawn(bench) == [set_of_all(bench)]
        assert hear(bench) == [RTY], "one more may have crossed that SET, or be damage"
        bench.in_force = bench.params.wanted
        assert hear(bench, says=None) == [Command.SET]
        assert bench.answer(Command.GTD).command is Command.DAT

    @pytest.mark.parametrize("hears", range(1, 4))
    def test_4_5_or_not_and_then_an_armed_program_is_not_armed_for_ever(self, hears: int) -> None:
        """Also where the control gives up at so few RTY, and begins anew after each time."""
        bench = Bench()
        bench.arm()
        for _ in range(10):
            bench.say(Command.SYN)
            for _ in range(hears + 1):
                if bench.all(Ended):
                    break
                hear(bench)
        assert bench.ended.outcome is Outcome.FAILED
        assert bench.ended.reason.startswith("nothing was sent: ")
        assert "SAT with Tp = 40960 s" in bench.ended.reason
        assert bench.ended.bytes_high == 0

    def test_4_5_each_job_asks_anew(self) -> None:
        bench = Bench()
        bench.delivered()
        for _ in range(4):
            hear(bench, BufferState.OPERATING)
        bench.arm()
        assert hear(bench) == [RTY]

    def test_4_5_after_the_end_packet_it_is_asked_for_again(self) -> None:
        bench = Bench(expansion=True, n="1")
        bench.streaming()
        assert bench.host.state is State.AWAITING
        assert hear(bench, BufferState.OPERATING, 0) == [RTY]
        assert bench.all(Ended) == []
        assert hear(bench, BufferState.OPERATING, 0, says=None) == [Command.SET]
        assert bench.ended.outcome is Outcome.COMPLETE

    def test_4_5_inside_the_packets_it_says_that_the_control_has_left_them(self) -> None:
        bench = Bench(expansion=True, n="1")
        bench.streaming(limit=300)
        bench.say(Command.SAT, Status(state=BufferState.RESET, parameters=SHIFTED).encode())
        assert bench.ended.outcome is Outcome.FAILED
        assert "before the end packet" in bench.ended.reason

    @pytest.mark.parametrize("data", [b"09000000", b"0100000", b"0100XYZ0", b"03500000", b"0100000000FG"])
    def test_4_4_2_nor_is_one_that_cannot_be_read(self, data: bytes) -> None:
        bench = Bench()
        bench.sending(PROGRAM[:100])
        said = [bench.messages(bench.say(Command.SAT, data) + bench.wait(0.5)) for _ in range(4)]
        assert [[message.command for message in each] for each in said] == [[RTY]] * 3 + [[Command.SET]]
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.FAILED, 0)
        assert "nothing that the control says of its state can be believed: " in bench.ended.reason

    @pytest.mark.parametrize("data", [b"032" + Status().encode()[3:], b"09000000"])
    def test_4_4_2_what_is_not_documented_does_not_disarm(self, data: bytes) -> None:
        """A control may know other causes of an alarm, and be reset: no value that it holds stands in the way."""
        bench = Bench()
        bench.power_on()
        bench.arm()
        for _ in range(20):
            drawn(bench, data)
        assert (bench.host.state, bench.all(Ended)) == (State.ARMED, [])
        bench.answer(Command.RST)
        assert hear(bench, says=None) == [Command.SET]
        assert bench.answer(Command.GTD).command is Command.DAT
