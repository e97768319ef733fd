"""The host of protocol A, clause by clause; the test plays the control."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import (
    SECOND,
    Ended,
    Held,
    Notice,
    Outcome,
    Requested,
    Resumed,
    SignalsIn,
    Started,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.host import State
from tapewire.protocols.fanuc_a.messages import (
    Command,
    Message,
)
from tapewire.protocols.fanuc_a.packets import Kind
from tapewire.protocols.fanuc_a.status import BufferState, Parameters
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench, Trickle

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)


class Test41:
    """Message format: the end code may not stand in the data."""

    @pytest.mark.parametrize(("end", "byte"), [("cr", b"\r"), ("etx", b"\x03")])
    def test_a_program_with_the_end_code_is_refused_at_start(self, end: str, byte: bytes) -> None:
        bench = Bench(end=end)
        with pytest.raises(UsageError, match=r"byte 4 is 0[D3]h"):
            bench.arm(b"%\nG" + byte + b"1\n%")
        assert bench.host.state is State.IDLE
        bench.arm()

    def test_a_later_chunk_with_the_end_code_is_never_sent(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm(PROGRAM + b"\r" + PROGRAM)
        taken = bytearray()
        while (said := bench.answer(Command.GTD)).command is Command.DAT:
            taken += said.data
        assert said == WAT
        assert bytes(taken) == PROGRAM[: len(taken)]
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.FAILED, len(taken))
        assert f"byte {len(PROGRAM) + 1:,} " in bench.ended.reason
        assert bench.answer(Command.GTD) == WAT

    @pytest.mark.parametrize("code", ["ascii", "iso"])
    @pytest.mark.parametrize("end", ["cr", "etx"])
    def test_every_coding(self, code: str, end: str) -> None:
        bench = Bench(code=code, end=end)
        first = bench.sending()
        assert first.command is Command.DAT
        assert first.data == PROGRAM[: len(first.data)]


class Test43:
    """Communication system: who speaks, and silence."""

    def test_the_host_waits_for_the_control(self) -> None:
        bench = Bench()
        bench.arm()
        assert bench.wait(5) == b""

    def test_the_host_can_speak_first(self) -> None:
        assert Bench(first="host").pull() == b"07SYN\r"

    def test_silence_draws_syn_again_and_again(self) -> None:
        bench = Bench()
        bench.arm()
        assert bench.wait(60) == b"07SYN\r" * 9
        assert [event.what for event in bench.all(Violation)] == ["the control is silent: SYN"]
        assert bench.all(Ended) == []

    def test_silence_is_counted_from_the_last_byte_out(self) -> None:
        """15.13: a DAT takes its time."""
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        dat = bench.host.data_to_send(5000)
        bench.host.data_sent(len(dat), bench.now)
        bench.now += 60 * SECOND
        bench.host.handle_timer(bench.now)
        assert bench.pull() == b""
        bench.host.data_left(len(dat), bench.now)
        assert bench.wait(2.9) == b""
        assert bench.wait(0.2) == b"07SYN\r"

    def test_silence_in_the_middle_fails_the_job(self) -> None:
        bench = Bench()
        first = bench.sending()
        assert bench.wait(10).startswith(b"07SYN\r")
        assert bench.ended.outcome is Outcome.FAILED
        assert "silent" in bench.ended.reason
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (0, len(first.data))

    def test_silence_while_armed_keeps_the_job(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        assert bench.wait(4) == b"07SYN\r"
        bench.power_on()
        assert bench.answer(Command.GTD).command is Command.DAT

    def test_a_message_without_end_is_silence(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.host.receive_data(b"x" * 200, bench.now)
        bench.now += SECOND // 2
        assert bench.wait(0.1) == b""
        assert bench.wait(1.0) == b"3DRTY1\r"

    def test_rs_off_holds(self) -> None:
        """4.3 (5)."""
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.host.receive_data(b"ECGTD\r", bench.now)
        assert len(bench.pull(100)) == 100
        bench.host.receive_signals(SignalsIn(cts=False), bench.now)
        assert bench.pull() == b""
        assert bench.wait(100) == b""
        bench.host.receive_signals(SignalsIn(), bench.now)
        assert len(bench.pull()) > 3000
        assert [event.why for event in bench.all(Held)] == ["the control's RS is OFF"]
        assert len(bench.all(Resumed)) == 1

    def test_stop_distance_is_no(self) -> None:
        assert (Bench().host.needs_stop_distance, Bench(No="50").host.needs_stop_distance) == (512, 50)

    def test_er_off_fails_the_job(self) -> None:
        bench = Bench()
        bench.sending()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.host.receive_signals(SignalsIn(dsr=False), bench.now)
        bench.pull()
        assert (bench.ended.outcome, "ER fell" in bench.ended.reason) == (Outcome.FAILED, True)


class Test441:
    """Command table."""

    def test_power_on(self) -> None:
        bench = Bench()
        bench.power_on()
        assert bench.host.state is State.IDLE

    def test_gtd_before_the_parameters_are_settled_gets_wat(self) -> None:
        """15.9."""
        bench = Bench()
        bench.arm()
        bench.answer(Command.SYN)
        bench.answer(Command.RDY)
        assert bench.answer(Command.GTD) == WAT
        bench.sat()
        assert bench.answer(Command.GTD).command is Command.DAT

    def started_anew(self) -> Bench:
        """A host whose program was started between RST and the next SAT, and a control that goes on with GTD."""
        bench = Bench()
        bench.answer(Command.RST)
        bench.arm()
        for _ in range(60):
            assert bench.answer(Command.GTD) == WAT
            bench.wait(1)
        return bench

    def test_gtd_without_end_before_the_parameters_are_settled_ends_the_job(self) -> None:
        """4.5: Tw is at most Tp, so that no SAT comes between; and a conversion of another host may be in force."""
        bench = self.started_anew()
        assert bench.all(Ended) == []
        assert [notice.text[:30] for notice in bench.all(Notice)] == ["the program waits: the control"]
        bench.wait(1)
        assert bench.answer(Command.GTD) == WAT
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.FAILED, 0)
        assert bench.ended.reason.startswith("nothing was sent: the control asks for the program (GTD) and has not")

    def test_reset_and_a_poll_settle_the_parameters_in_time(self) -> None:
        bench = self.started_anew()
        bench.answer(Command.RST)
        assert bench.answer(Command.GTD) == WAT
        bench.wait(5)
        bench.sat()
        assert bench.answer(Command.GTD).command is Command.DAT

    def test_a_whole_transfer(self) -> None:
        bench = Bench()
        taken = bytearray(bench.sending().data)
        while (said := bench.answer(Command.GTD)).command is Command.DAT:
            taken += said.data
        assert said == EOD
        assert bytes(taken) == PROGRAM
        assert bench.sat(BufferState.OPERATING, 900) == SET
        assert bench.host.state is State.DELIVERED
        assert bench.answer(Command.GTD) == EOD
        assert bench.sat(BufferState.OPERATING, 0) == SET
        assert bench.ended == Ended(
            outcome=Outcome.COMPLETE,
            reason="delivered whole, and the buffer is empty",
            bytes_low=len(PROGRAM),
            bytes_high=len(PROGRAM),
        )
        assert bench.answer(Command.GTD) == EOD
        assert len(bench.all(Started)) == 1
        assert bench.all(Violation) == []

    def test_a_stray_gtd_gets_wat_and_is_reported_once(self) -> None:
        bench = Bench()
        bench.power_on()
        assert [bench.answer(Command.GTD) for _ in range(3)] == [WAT] * 3
        assert bench.all(Requested) == [Requested(served=False)]

    def test_a_job_never_starts_in_the_middle(self) -> None:
        """A computer that was started anew hears GTD of a program it did not begin."""
        bench = Bench()
        bench.arm()
        bench.in_force = bench.params.wanted
        bench.sat(BufferState.OPERATING, 100)
        assert [bench.answer(Command.GTD) for _ in range(3)] == [WAT] * 3
        [notice] = bench.all(Notice)
        assert "RESET" in notice.text
        assert bench.answer(Command.RST) == Message(command=Command.ARS)
        assert bench.answer(Command.GTD).command is Command.DAT

    def test_after_an_abort_the_next_job_waits_for_a_reset(self) -> None:
        bench = Bench()
        bench.sending()
        bench.host.abort(bench.now)
        bench.pull()
        bench.arm()
        assert bench.answer(Command.GTD) == WAT
        bench.answer(Command.RST)
        assert bench.answer(Command.GTD).data == PROGRAM[:3488]

    def test_a_second_job_follows_a_complete_one(self) -> None:
        bench = Bench()
        bench.delivered()
        bench.sat(BufferState.OPERATING, 0)
        bench.arm()
        assert bench.answer(Command.GTD).data == PROGRAM[:3488]

    def test_a_late_source_is_waited_for_and_then_gets_wat(self) -> None:
        source = Trickle()
        bench = Bench()
        bench.power_on()
        bench.arm(source)
        assert bench.say(Command.GTD) == b""
        assert bench.wait(0.9) == b""
        assert bench.messages(bench.wait(0.2)) == [WAT]
        source.data = b"%\nG1\n"
        assert bench.say(Command.GTD) == b""
        assert bench.messages(bench.wait(1.1)) == [Message(command=Command.DAT, data=b"%\nG1\n")]
        assert bench.say(Command.GTD) == b""
        source.data, source.closed = b"%", True
        assert bench.messages(bench.wait(0.1)) == [Message(command=Command.DAT, data=b"%")]
        assert bench.answer(Command.GTD) == EOD

    def test_wat_comes_within_half_of_to(self) -> None:
        bench = Bench(To="1", wat_after="99")
        bench.power_on()
        bench.arm(Trickle())
        assert bench.say(Command.GTD) == b""
        assert bench.messages(bench.wait(0.5)) == [WAT]

    @pytest.mark.parametrize("expansion", [False, True])
    def test_an_empty_program_is_refused(self, expansion: bool) -> None:
        bench = Bench(expansion)
        with pytest.raises(UsageError, match="the program is empty"):
            bench.arm(b"")
        assert bench.host.state is State.IDLE
        bench.arm()

    @pytest.mark.parametrize("expansion", [False, True])
    def test_a_source_that_turns_out_empty_fails(self, expansion: bool) -> None:
        """It had nothing yet when it was armed; EOD, or an end packet, would make it look like a program."""
        source = Trickle()
        bench = Bench(expansion)
        bench.power_on()
        bench.arm(source)
        source.closed = True
        said = bench.say(Command.GTD) + bench.wait(1)
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.FAILED, 0)
        assert "the program is empty" in bench.ended.reason
        assert {packet.kind for packet in bench.packets(said)} <= {Kind.INVALID} if expansion else said == b"F9WAT\r"

    def test_rst_cancels(self) -> None:
        bench = Bench()
        first = bench.sending()
        bench.answer(Command.GTD)
        assert bench.answer(Command.RST) == Message(command=Command.ARS)
        assert bench.ended.outcome is Outcome.CANCELLED
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (len(first.data), 2 * 3488)
        assert bench.answer(Command.GTD) == WAT

    def test_alm_fails(self) -> None:
        bench = Bench()
        bench.sending()
        assert bench.answer(Command.ALM) == Message(command=Command.AAL)
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.FAILED, 0)
        assert bench.answer(Command.GTD) == WAT

    @pytest.mark.parametrize("command", [Command.RST, Command.ALM, Command.SYN, Command.RDY])
    def test_what_has_not_begun_is_left_alone(self, command: Command) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.answer(command)
        bench.sat()
        assert bench.answer(Command.GTD).command is Command.DAT
        assert bench.all(Ended) == []

    def test_syn_in_the_middle_starts_the_handshake_anew(self) -> None:
        bench = Bench()
        bench.sending()
        bench.in_force = Parameters()
        bench.power_on()
        assert bench.ended.outcome is Outcome.FAILED
        assert "SYN" in bench.ended.reason
        assert bench.answer(Command.GTD) == WAT

    @pytest.mark.parametrize(("command", "outcome"), [(Command.RST, Outcome.CANCELLED), (Command.ALM, Outcome.FAILED)])
    def test_delivered_whole_but_not_executed(self, command: Command, outcome: Outcome) -> None:
        bench = Bench()
        bench.delivered()
        bench.sat(BufferState.OPERATING, 500)
        bench.answer(command)
        assert bench.ended.outcome is outcome
        assert bench.ended.reason.startswith("delivered whole, not executed")
        assert bench.ended.bytes_low == bench.ended.bytes_high == len(PROGRAM)

    def test_m30_may_reset_the_cnc(self) -> None:
        bench = Bench(rst_at_end="complete")
        bench.delivered()
        assert bench.answer(Command.RST) == Message(command=Command.ARS)
        assert bench.ended.outcome is Outcome.COMPLETE

    def test_di_and_do_during_a_job(self) -> None:
        bench = Bench()
        bench.sending()
        bench.host.read_di(bench.now)
        bench.host.set_do(0x5A, bench.now)
        assert bench.answer(Command.GTD) == Message(command=Command.RDI)
        assert bench.answer(Command.SDI, b"A5") == Message(command=Command.SDO, data=b"5A")
        assert bench.host.di == 0xA5
        assert bench.answer(Command.GTD).data == PROGRAM[3488:6976]
        bench.host.read_di(bench.now)
        assert bench.sat(BufferState.OPERATING, 10) == Message(command=Command.RDI)
        assert bench.answer(Command.SDI, b"G0") == SET
        assert bench.host.di == 0xA5
        with pytest.raises(UsageError, match="0 to 255"):
            bench.host.set_do(256, bench.now)

    def test_sdi_that_was_not_asked_for(self) -> None:
        bench = Bench()
        bench.power_on()
        assert bench.say(Command.SDI, b"00") == b""
        assert [event.what for event in bench.all(Violation)] == ["SDI while idle"]

    def test_clb_and_syn_are_said_as_told_and_never_during_a_job(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.host.clear_buffer(bench.now)
        assert bench.sat() == Message(command=Command.CLB)
        bench.host.initialise(bench.now)
        assert bench.sat() == Message(command=Command.SYN)
        bench.power_on()
        bench.arm()
        bench.answer(Command.GTD)
        for act in (bench.host.clear_buffer, bench.host.initialise):
            with pytest.raises(UsageError, match="would spoil"):
                act(bench.now)

    def test_protocol_a_has_no_punch_out(self) -> None:
        bench = Bench()
        with pytest.raises(UsageError, match="protocol B"):
            bench.host.receive(BytesIO(), bench.now)
        bench.host.hold_reception(bench.now)
        bench.host.release(bench.now)

    def test_one_job_at_a_time(self) -> None:
        bench = Bench()
        bench.arm()
        with pytest.raises(UsageError, match="under way"):
            bench.arm()
