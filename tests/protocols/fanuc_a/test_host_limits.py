"""The host of protocol A: what it asks for by SET, what it never sends, and what it holds back."""

from __future__ import annotations

import dataclasses
from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.engine import MILLISECOND, SECOND, Held, Outcome, SignalsIn
from tapewire.errors import ProgramError, UsageError
from tapewire.line.pacing import character_time
from tapewire.protocols.fanuc_a import Params, refuse_program
from tapewire.protocols.fanuc_a.host import State
from tapewire.protocols.fanuc_a.messages import Coding, Command, Message, encode_message
from tapewire.protocols.fanuc_a.packets import Kind, Monitor, encode_monitor
from tapewire.protocols.fanuc_a.status import Parameters, Setting, Status
from tapewire.protocols.settings import End
from tapewire.sim.world import World
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench, Trickle

GTD = encode_message(Message(command=Command.GTD), Coding())


class TestSet:
    """4.4.2 2): position 1, and the unit of Tp."""

    @pytest.mark.parametrize(("said", "asked"), [("0", "0"), ("1", "1"), ("5", "5"), (" ", "0"), ("x", "0")])
    def test_position_1_repeats_that_of_sat(self, said: str, asked: str) -> None:
        """Nothing is to be switched; a blank is a position that this control does not use."""
        bench = Bench()
        bench.answer(Command.SYN)
        data = bench.answer(Command.SAT, said.encode() + Status().encode()[1:]).data
        assert Setting.parse(data, Parameters()).switching == asked

    @pytest.mark.parametrize("digit", ["0", "1"])
    def test_or_says_what_it_is_told_to(self, digit: str) -> None:
        bench = Bench(switching=digit)
        bench.answer(Command.SYN)
        assert bench.answer(Command.SAT, b"5" + Status().encode()[1:]).data[:1] == digit.encode()

    def test_tp_in_tenths_of_a_second(self) -> None:
        bench = Bench(P2="1", Tp="10")
        bench.answer(Command.SYN)
        data = bench.sat().data
        assert (data[20:24], data[40:44]) == (b"000A", b"0004")
        bench.power_on()
        assert bench.wait(1.9) == b""
        assert bench.wait(0.2) == b"07SYN\r", "Tp = 1 s, and the margin"

    def test_tw_stays_in_seconds(self) -> None:
        with pytest.raises(UsageError, match="set Tp to 10 or more, or Tw to 0"):
            Params.for_protocol_a({"P2": "1", "Tp": "9"}, End.HOST)
        assert Params.for_protocol_a({"P2": "1", "Tp": "9", "Tw": "0"}, End.HOST).wanted.tp_ms == 900

    def test_other_bits_of_the_unit_mean_nothing(self) -> None:
        """Or the control would be told again and again."""
        bench = Bench()
        bench.power_on()
        status = Status(parameters=bench.params.wanted).encode()
        assert bench.answer(Command.SAT, status[:40] + b"FFFB" + status[44:]) == Message(command=Command.SET)

    @given(digits=st.text("0123456789ABCDEF", min_size=4, max_size=4))
    def test_p2_is_bit_2(self, digits: str) -> None:
        data = Status().encode()
        tp_ms = Status.parse(data[:40] + digits.encode() + data[44:]).parameters.tp_ms
        assert tp_ms == (500 if int(digits, 16) & 4 else 5000)


class TestNoBeforeSat:
    """4.3 (5): the No in force is 50 until a SAT has confirmed the SET."""

    def unconfirmed(self) -> Bench:
        bench = Bench()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.answer(Command.SYN)
        bench.arm()
        bench.sat()
        bench.host.receive_data(GTD, bench.now)
        return bench

    def test_so_much_is_handed_over(self) -> None:
        bench = self.unconfirmed()
        data = bench.host.data_to_send(216)
        assert len(data) == 34, "50 less what may leave before RS OFF is heard of"
        bench.host.data_sent(34, bench.now)
        assert bench.host.data_to_send(216) == b""
        bench.host.data_left(10, bench.now)
        assert len(bench.host.data_to_send(216)) == 10

    def test_it_is_fed_again_before_it_is_empty(self) -> None:
        bench = self.unconfirmed()
        bench.host._outbox.rate = 1000
        bench.host.data_sent(len(bench.host.data_to_send(216)), bench.now)
        assert bench.host.next_deadline() == bench.now + 17 * MILLISECOND
        bench.host.data_left(17, bench.now + 17 * MILLISECOND)
        assert len(bench.host.data_to_send(216)) == 17

    def test_confirmed_it_is_the_lines_affair(self) -> None:
        bench = Bench()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.power_on()
        bench.arm()
        bench.host.receive_data(GTD, bench.now)
        assert len(bench.host.data_to_send(216)) == 216

    def test_a_line_without_rs_is_not_stopped_by_it(self) -> None:
        bench = Bench()
        bench.answer(Command.SYN)
        bench.arm()
        bench.sat()
        bench.host.receive_data(GTD, bench.now)
        assert len(bench.host.data_to_send(216)) == 216

    @pytest.mark.parametrize("baud", [19_200, 86_400])
    @pytest.mark.parametrize("full_at", range(7000, 7150, 21))
    def test_rs_off_in_the_first_dat_never_overruns(self, baud: int, full_at: int) -> None:
        """A control that did not take No, and whose buffer fills from elsewhere: RS OFF at any character."""
        world = World()
        pair = world.pair("fanuc-a", baud=baud, grain=1, blocks_per_second=1)
        pair.host.start(BytesIO(PROGRAM), world.now)
        pair.cnc.cycle_start(world.now)
        buffer = pair.cnc._job._buffer  # type: ignore[attr-defined]
        world.run_until(lambda: pair.host.state is State.SENDING and pair.host.progress > 400)  # type: ignore[attr-defined]
        line = pair.cnc._line  # type: ignore[attr-defined]
        line.parameters = dataclasses.replace(line.parameters, no=50)
        buffer += bytes(full_at)
        world.run_for(SECOND)
        assert pair.cnc.signals.rts is False
        assert not line.room.overran
        assert 0 < line.room._length - line.room._stopped_at <= line.room._allowed == 50


class TestHeldLimit:
    """A feed hold has no end of its own; a person may set one."""

    def held(self, **settings: str) -> Bench:
        bench = Bench(False, **settings)
        bench.power_on()
        bench.arm()
        bench.host.receive_signals(SignalsIn(), bench.now)
        bench.host.receive_data(GTD, bench.now)
        bench.pull(100)
        bench.host.receive_signals(SignalsIn(cts=False), bench.now)
        return bench

    def test_by_default_a_night_is_no_limit(self) -> None:
        bench = self.held()
        assert bench.wait(100_000) == b""
        assert bench.host.state is State.SENDING

    def test_rs_off(self) -> None:
        bench = self.held(held_limit="600")
        bench.wait(599)
        assert bench.host.state is State.SENDING
        bench.wait(2)
        assert bench.ended.outcome is Outcome.FAILED
        assert "held for longer than held_limit=600 s" in bench.ended.reason
        bench.host.receive_signals(SignalsIn(), bench.now)
        assert bench.pull() == b"\r", "nothing of the program goes on, and what is out cannot be taken"

    def test_each_hold_counts_anew(self) -> None:
        bench = self.held(held_limit="600")
        for _ in range(3):
            bench.wait(500)
            bench.host.receive_signals(SignalsIn(), bench.now)
            bench.pull(10)
            bench.host.receive_signals(SignalsIn(cts=False), bench.now)
        assert bench.host.state is State.SENDING

    def test_dc3(self) -> None:
        bench = Bench(expansion=True, n="1", held_limit="60")
        bench.streaming(limit=300)
        bench.monitor(Monitor.DC3)
        assert bench.all(Held)
        bench.wait(61)
        assert bench.ended.outcome is Outcome.FAILED
        said = bench.monitor(Monitor.DC1) + bench.wait(20)
        assert {packet.kind for packet in bench.packets(said)} == {Kind.INVALID}

    def test_what_has_not_begun_is_not_held(self) -> None:
        bench = Bench(held_limit="1")
        bench.power_on()
        bench.arm()
        bench.host.receive_signals(SignalsIn(cts=False), bench.now)
        bench.wait(1.5)
        assert bench.host.state is State.ARMED


G05 = b"%\nO1\n(A)\nN5 G05 (BINARY)\n\x0a\x78\x82\x00\x00\x00M30\n%"
CONVERT = {"convert_from": "59", "convert_to": "10"}


class TestConversion:
    """4.4.2 1) note: a conversion knows nothing of binary records (9.1)."""

    @pytest.mark.parametrize("data", DataCode)
    @pytest.mark.parametrize("expansion", [False, True])
    def test_a_g05_section_is_refused(self, data: DataCode, expansion: bool) -> None:
        make = Params.for_expansion_a if expansion else Params.for_protocol_a
        params = make({"data": data, **CONVERT}, End.HOST)
        program = G05 if data is DataCode.BINARY else encode(G05[:26], data) + G05[26:]
        with pytest.raises(ProgramError, match=r"byte 1[23] begins a G05 section.*3Bh into 0Ah"):
            refuse_program(params, BytesIO(program).read)

    @pytest.mark.parametrize("data", DataCode)
    def test_other_blocks_and_other_jobs_are_not(self, data: DataCode) -> None:
        params = Params.for_protocol_a({"data": data, **CONVERT}, End.HOST)
        refuse_program(params, BytesIO(encode(b"%\nO1\nG05.1 Q1\nG05 P10000\nM30\n%", data)).read)
        refuse_program(Params.for_protocol_a({"data": data}, End.HOST), BytesIO(encode(G05[:26], data)).read)

    def test_the_eob_may_be_what_is_converted(self) -> None:
        """The example of 4.4.2: ";" for LF."""
        params = Params.for_protocol_a(CONVERT, End.HOST)
        with pytest.raises(ProgramError, match="G05 section"):
            refuse_program(params, BytesIO(G05.replace(b"\n", b";")).read)

    @given(cut=st.integers(1, len(G05) - 1))
    def test_in_any_pieces(self, cut: int) -> None:
        pieces = [G05[:cut], G05[cut:], b""]
        with pytest.raises(ProgramError, match=r"byte 1[23] begins"):
            refuse_program(Params.for_protocol_a(CONVERT, End.HOST), lambda _: pieces.pop(0))

    def test_the_engine_refuses_it_too(self) -> None:
        with pytest.raises(UsageError, match="G05 section"):
            Bench(False, **CONVERT).arm(G05)

    @pytest.mark.parametrize("expansion", [False, True])
    def test_nothing_of_a_later_section_is_sent(self, expansion: bool) -> None:
        bench = Bench(expansion, **CONVERT)
        bench.power_on()
        source = Trickle(PROGRAM[:5000] + b"\n" + G05)
        bench.arm(source)
        said = bytearray()
        for _ in range(3):
            said += bench.say(Command.GTD) + bench.wait(0.1)
        assert b"G05" not in said
        assert bench.ended.outcome is Outcome.FAILED
        assert "G05 section" in bench.ended.reason
        assert not bench.wait(60).count(b"%")


class TestLookahead:
    """5.3, 5.2: a packet too many is better than a gap, within bounds."""

    def begun(self, characters: int, **settings: str) -> Bench:
        """The first packet is handed over but for `characters`; the line has been seen to carry 7854 a second."""
        bench = Bench(expansion=True, **settings)
        bench.power_on()
        bench.host._outbox.rate = SECOND // character_time(86_400)
        bench.arm()
        bench.host.receive_data(GTD, bench.now)
        bench.host.data_sent(bench.packet, bench.now)
        bench.host.data_left(bench.packet - characters, bench.now)
        return bench

    @pytest.mark.parametrize(
        ("settings", "lookahead"),
        [({"n": "4"}, 63), ({"n": "1"}, 63), ({"n": "1", "lookahead": "50"}, 65), ({"lookahead": "0"}, 16)],
    )
    def test_how_early(self, settings: dict[str, str], lookahead: int) -> None:
        assert self.begun(lookahead, **settings).host.data_to_send(9) == b""
        assert self.begun(lookahead - 1, **settings).host.data_to_send(1) == b"1"

    def test_it_asks_to_be_woken_then(self) -> None:
        bench = self.begun(200)
        deadline = bench.host.next_deadline()
        assert deadline is not None
        assert 17 * MILLISECOND < deadline - bench.now < 18 * MILLISECOND
        bench.host.data_left(138, deadline)
        bench.host.handle_timer(deadline)
        assert bench.host.data_to_send(1) == b"1"

    def test_no_packet_is_begun_while_a_monitor_packet_comes_in(self) -> None:
        """Without its last character it may have been DC3, or a NAK that must not come a second too late."""
        bench = self.begun(100)
        dc3 = encode_monitor(Monitor.DC3)
        bench.host.receive_data(dc3[:3], bench.now)
        bench.host.data_left(100, bench.now)
        assert bench.pull() == b""
        assert bench.wait(0.9) == b""
        bench.wait(0.2)
        assert [event.why for event in bench.all(Held)] == [
            "what the control sent could not be read; it may have been DC3"
        ]
