"""The host of expansion A, clause by clause; the test plays the control."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import (
    SECOND,
    Ended,
    Held,
    LineFault,
    Notice,
    Outcome,
    Requested,
    Resumed,
    Violation,
)
from tapewire.protocols.fanuc_a.host_outbox import Outbox
from tapewire.protocols.fanuc_a.messages import Command, Message
from tapewire.protocols.fanuc_a.packets import Kind, Monitor, MonitorCode, MonitorSum, Packet, encode_monitor
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import BufferState
from tapewire.protocols.settings import End
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench, Trickle

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)
SHORT = b"%\nO1\nM30\n%"


def numbers(packets: list[Packet]) -> str:
    return " ".join(f"{packet.number:02X}" for packet in packets)


def program_of(packets: list[Packet]) -> bytes:
    return b"".join(packet.data for packet in packets if packet.kind is not Kind.INVALID)


def expansion(n: int = 1, **settings: str) -> Bench:
    return Bench(expansion=True, n=str(n), **settings)


def fill(data: bytes, n: int = 1) -> bytes:
    return data + bytes(256 * n - len(data))


class Test51:
    """Communication system."""

    @pytest.mark.parametrize("n", [1, 2, 4])
    @pytest.mark.parametrize("code", ["ascii", "iso"])
    @pytest.mark.parametrize("end", ["cr", "etx"])
    def test_a_whole_transfer(self, n: int, code: str, end: str) -> None:
        bench = expansion(n, code=code, end=end)
        packets = bench.packets(bench.streaming())
        assert program_of(packets).rstrip(b"\0") == PROGRAM
        count = -(-len(PROGRAM) // (256 * n))
        assert numbers(packets) == " ".join([f"3{i % 10}" for i in range(count - 1)] + ["FF"])
        assert bench.host.state.value == "awaiting"
        assert bench.sat(BufferState.OPERATING, 700) == SET
        assert bench.host.state.value == "delivered"
        assert bench.sat(BufferState.OPERATING, 0) == SET
        assert (bench.ended.outcome, bench.ended.bytes_low) == (Outcome.COMPLETE, len(PROGRAM))
        assert bench.all(Violation) == []

    def test_n_is_what_the_control_takes(self) -> None:
        """A control without the expansion goes on in protocol A."""
        bench = Bench(expansion=True)
        bench.answer(Command.SYN)
        for _ in range(4):
            bench.sat()
        bench.arm()
        assert bench.answer(Command.GTD).command is Command.DAT
        assert any("n is 0, not 4" in notice.text for notice in bench.all(Notice))

    def test_gtd_right_after_set_gets_packets(self) -> None:
        bench = expansion()
        bench.answer(Command.SYN)
        bench.sat()
        bench.arm()
        assert bench.packets(bench.say(Command.GTD))[0].number == 0x30

    def test_no_packet_is_begun_before_the_last_one_has_nearly_left(self) -> None:
        bench = expansion()
        bench.streaming(limit=0)
        first = bench.host.data_to_send(10_000)
        assert len(first) == bench.packet
        bench.host.data_sent(len(first), bench.now)
        assert bench.host.data_to_send(10_000) == b""
        bench.host.data_left(244, bench.now)
        assert bench.host.data_to_send(10_000) == b""
        bench.host.data_left(1, bench.now)
        assert bench.host.data_to_send(1) == b"1"

    def test_silence_is_in_order_until_the_end_packet_has_gone(self) -> None:
        bench = expansion()
        source = Trickle(SHORT[:5])
        bench.streaming(source)
        said = bench.packets(bench.wait(100))
        assert {packet.kind for packet in said} == {Kind.INVALID}
        source.data, source.closed = SHORT[5:], True
        assert numbers(bench.packets(bench.wait(2))) == "FF"
        assert bench.wait(3.1) == b"07SYN\r"
        assert bench.all(Ended) == []
        assert bench.wait(3.1) == b"07SYN\r"
        assert bench.ended.outcome is Outcome.FAILED


class Test52:
    """Data packets."""

    def test_a_single_packet_is_the_end_packet(self) -> None:
        bench = expansion()
        assert bench.packets(bench.streaming(SHORT)) == [Packet(number=0xFF, data=fill(SHORT))]

    def test_the_fill_is_a_setting(self) -> None:
        bench = expansion(pad="32")
        assert bench.packets(bench.streaming(SHORT)) == [Packet(number=0xFF, data=SHORT.ljust(256))]

    @pytest.mark.parametrize("length", [255, 256, 257, 511, 512, 513])
    def test_lengths_around_a_packet(self, length: int) -> None:
        program = b"%\n" + b"G1X1\n" * 200
        program = program[: length - 1] + b"%"
        bench = expansion()
        packets = bench.packets(bench.streaming(program))
        assert program_of(packets) == program + bytes(-length % 256)
        assert packets[-1].number == 0xFF

    def test_data_without_eor_must_fill_the_last_packet(self) -> None:
        bench = expansion()
        whole = b"%\n" + b"G1\n" * 170
        packets = bench.packets(bench.streaming(whole[:512]))
        assert numbers(packets) == "30 FF"
        cut = expansion()
        packets = cut.packets(cut.streaming(whole[:300]))
        assert numbers(packets) == "30"
        assert cut.ended.outcome is Outcome.FAILED
        assert "44 of 256" in cut.ended.reason
        assert {packet.kind for packet in cut.packets(cut.wait(30))} == {Kind.INVALID}

    def test_the_end_code_may_stand_in_packets(self) -> None:
        bench = expansion()
        assert program_of(bench.packets(bench.streaming(b"%\n\r\x03%"))) == fill(b"%\n\r\x03%")

    def test_invalid_packets_while_the_source_is_late(self) -> None:
        source = Trickle()
        bench = expansion()
        assert bench.streaming(source) == b""
        assert bench.wait(0.9) == b""
        assert bench.packets(bench.wait(0.2)) == [Packet(number=0, data=bytes(256))]
        assert len(bench.packets(bench.wait(60))) == 5
        source.data = PROGRAM[:300]
        assert numbers(bench.packets(bench.wait(2))) == "30"
        source.data, source.closed = PROGRAM[300:], True
        assert program_of(bench.packets(bench.wait(2))).rstrip(b"\0") == PROGRAM[256:]

    def test_nothing_armed_gets_invalid_packets_until_something_is(self) -> None:
        bench = expansion(invalid="32")
        bench.power_on()
        assert bench.say(Command.GTD) == b""
        assert {packet.number for packet in bench.packets(bench.wait(30))} == {0x20}
        assert bench.all(Requested) == [Requested(served=False)]
        bench.arm(SHORT)
        assert numbers(bench.packets(bench.pull())) == "FF"

    def test_nothing_armed_and_messages_asked_for(self) -> None:
        """14.2."""
        bench = expansion(gtd_answers="messages")
        bench.power_on()
        assert bench.answer(Command.GTD) == WAT
        bench.arm(SHORT)
        assert numbers(bench.packets(bench.say(Command.GTD))) == "FF"
        assert bench.answer(Command.GTD) == EOD

    def test_nothing_left_gets_an_end_packet_with_eor(self) -> None:
        bench = expansion()
        bench.streaming(SHORT)
        end_only = [Packet(number=0xFF, data=fill(b"%"))]
        assert bench.packets(bench.say(Command.GTD)) == end_only
        assert bench.packets(bench.monitor(Monitor.NAK, 0x30)) == end_only
        assert bench.sat(BufferState.OPERATING, 0) == SET
        assert bench.ended.outcome is Outcome.COMPLETE
        assert bench.packets(bench.say(Command.GTD)) == end_only


class Test53:
    """Monitor packets; the examples of 5.4."""

    def test_5_4_2_stop_request(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=bench.packet + 50)
        bench.host.receive_data(encode_monitor(Monitor.CAN), bench.now)
        packets = bench.packets(begun + bench.pull())
        assert numbers(packets) == "30 31 FF"
        assert packets[-1].data == bytes(256)
        assert bench.answer(Command.RST) == Message(command=Command.ARS)
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.CANCELLED, 512)

    def test_can_with_alm_fails(self) -> None:
        bench = expansion()
        bench.streaming(limit=50)
        bench.monitor(Monitor.CAN)
        assert bench.answer(Command.ALM) == Message(command=Command.AAL)
        assert bench.ended.outcome is Outcome.FAILED

    @pytest.mark.parametrize("handed", [0, 1, 259, 260])
    def test_can_while_the_end_packet_is_sent_draws_no_other(self, handed: int) -> None:
        bench = expansion()
        begun = bench.streaming(SHORT, limit=handed)
        bench.host.receive_data(encode_monitor(Monitor.CAN), bench.now)
        assert numbers(bench.packets(begun + bench.pull())) == "FF"
        bench.answer(Command.RST)
        assert bench.ended.outcome is Outcome.CANCELLED

    @pytest.mark.parametrize(
        ("state", "outcome"), [(BufferState.RESET, Outcome.CANCELLED), (BufferState.OPERATING, Outcome.FAILED)]
    )
    def test_can_and_then_only_sat(self, state: BufferState, outcome: Outcome) -> None:
        bench = expansion()
        bench.streaming(SHORT)
        bench.monitor(Monitor.CAN)
        assert bench.sat(state) == SET
        assert bench.ended.outcome is outcome

    def test_5_4_3_i_checksum_error(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=2 * bench.packet + 50)
        bench.host.receive_data(encode_monitor(Monitor.NAK, number=0x31), bench.now)
        packets = bench.packets(begun + bench.pull())
        assert numbers(packets).startswith("30 31 32 31 32 33 34")
        assert program_of([packets[0], *packets[3:]]).rstrip(b"\0") == PROGRAM

    def test_5_4_3_iii_error_in_the_end_packet(self) -> None:
        bench = expansion()
        packets = bench.packets(bench.streaming(PROGRAM[:600] + b"%"))
        assert numbers(packets) == "30 31 FF"
        assert bench.packets(bench.monitor(Monitor.NAK, 0x32)) == packets[-1:]
        assert bench.packets(bench.monitor(Monitor.NAK, 0x31)) == packets[-2:]
        lone = expansion()
        end = lone.packets(lone.streaming(SHORT))
        assert lone.packets(lone.monitor(Monitor.NAK, 0x30)) == end
        assert lone.sat(BufferState.OPERATING, 0) == SET
        assert lone.ended.outcome is Outcome.COMPLETE

    def test_5_4_4_interruption_and_restart(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=bench.packet + 50)
        bench.host.receive_data(encode_monitor(Monitor.DC3), bench.now)
        held = bench.pull()
        assert numbers(bench.packets(begun + held)) == "30 31"
        assert bench.wait(3600) == b""
        rest = bench.monitor(Monitor.DC1)
        assert program_of(bench.packets(begun + held + rest)).rstrip(b"\0") == PROGRAM
        assert (bench.all(Held), bench.all(Resumed)) == ([Held(why="DC3")], [Resumed(why="DC1")])

    def test_5_4_5_interruption_and_stop(self) -> None:
        bench = expansion()
        bench.streaming(limit=50)
        bench.monitor(Monitor.DC3)
        assert numbers(bench.packets(bench.monitor(Monitor.CAN))) == "FF"

    def test_5_4_6_interruption_and_retransmission(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=bench.packet + 50) + bench.monitor(Monitor.DC3)
        assert numbers(bench.packets(begun)) == "30 31"
        assert numbers(bench.packets(bench.monitor(Monitor.NAK, 0x31))).startswith("31 32 33")

    @pytest.mark.parametrize("code", MonitorCode)
    @pytest.mark.parametrize("covers", MonitorSum)
    def test_either_sum_and_code_is_understood_and_reported_once(self, code: MonitorCode, covers: MonitorSum) -> None:
        bench = expansion()
        begun = bench.streaming(limit=50)
        for _ in range(3):
            bench.host.receive_data(encode_monitor(Monitor.DC3, code=code, sum_covers=covers), bench.now)
        assert numbers(bench.packets(begun + bench.pull())) == "30"
        [notice] = bench.all(Notice)
        assert ("13h" if code is MonitorCode.ASCII else "93h") in notice.text
        assert ("end code too" in notice.text) is (covers is MonitorSum.WITH_END)

    @pytest.mark.parametrize(("number", "why"), [(0x38, "was not sent"), (0x00, "no number"), (0x41, "no number")])
    def test_nak_for_what_was_not_sent_fails(self, number: int, why: str) -> None:
        """15.11."""
        bench = expansion()
        begun = bench.streaming(limit=3 * bench.packet + 9)
        bench.host.receive_data(encode_monitor(Monitor.NAK, number=number), bench.now)
        assert numbers(bench.packets(begun + bench.pull())) == "30 31 32 33"
        assert why in bench.ended.reason
        assert {packet.kind for packet in bench.packets(bench.wait(30))} == {Kind.INVALID}

    @pytest.mark.parametrize("sent", [0, 2])
    def test_nak_for_what_comes_behind_a_packet_that_has_not_begun_skips_nothing(self, sent: int) -> None:
        """That packet has been made, and none of it has been handed over: no control can have it."""
        bench = expansion()
        begun = bench.streaming(limit=sent * bench.packet)
        bench.host.receive_data(encode_monitor(Monitor.NAK, number=0x31 + sent), bench.now)
        after = bench.pull()
        assert "was not sent" in bench.ended.reason
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (0, sent * 256)
        assert numbers(bench.packets(begun + after + bench.wait(30))) == " ".join(["30", "31"][:sent] + ["00"] * 2)

    def test_nak_for_the_next_packet_repeats_nothing(self) -> None:
        """What a spoilt invalid packet draws."""
        source = Trickle(PROGRAM[:300])
        bench = expansion()
        bench.streaming(source)
        assert bench.monitor(Monitor.NAK, 0x31) == b""
        assert bench.all(Ended) == []

    def test_more_naks_of_one_packet_than_ne_fail(self) -> None:
        bench = expansion(Ne="2")
        bench.streaming()
        said = [bool(bench.monitor(Monitor.NAK, 0x31)) for _ in range(3)]
        assert said == [True, True, False]
        assert "more than 2 times" in bench.ended.reason

    def test_a_number_means_the_youngest_packet_that_has_it(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=25 * bench.packet)
        first = bench.packets(begun)
        again = bench.packets(bench.monitor(Monitor.NAK, 0x37))
        assert again[0] == first[17]
        assert program_of(first[:17] + again).rstrip(b"\0") == PROGRAM

    def test_bytes_low_is_what_can_no_longer_be_asked_for(self) -> None:
        bench = expansion()
        bench.streaming(limit=25 * bench.packet)
        bench.monitor(Monitor.DC3)
        bench.host.abort(bench.now)
        bench.pull()
        assert (bench.ended.bytes_low, bench.ended.bytes_high) == (16 * 256, 25 * 256)
        deaf = expansion()
        deaf.streaming(limit=25 * deaf.packet)
        deaf.host.abort(deaf.now)
        deaf.pull()
        assert deaf.ended.bytes_low == 0, "4.6 1): a control with an open-line error says nothing, and hears nothing"
        other = expansion()
        other.streaming(limit=5 * other.packet)
        other.host.receive_data(encode_monitor(Monitor.NAK, number=0x33), other.now)
        other.host.abort(other.now)
        other.pull()
        assert other.ended.bytes_low == 3 * 256


class TestDamage:
    """A monitor packet that cannot be read may have been any of them."""

    @pytest.mark.parametrize("said", [b"\x18 34\r", b"\x93 C3\r", b"\x90 B3\r", b"EDGTD\r"])
    def test_the_transfer_is_held_and_fails_when_nothing_follows(self, said: bytes) -> None:
        bench = expansion()
        begun = bench.streaming(limit=50)
        bench.host.receive_data(said, bench.now)
        assert numbers(bench.packets(begun + bench.pull())) == "30"
        assert bench.wait(20) == b""
        assert bench.all(Ended) == []
        bench.wait(1.1)
        assert bench.ended.outcome is Outcome.FAILED

    def test_dc1_goes_on(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=50)
        bench.host.receive_line_fault(LineFault.PARITY, 0x12, bench.now)
        bench.host.receive_data(b" B3\r", bench.now)
        begun += bench.pull()
        rest = bench.monitor(Monitor.DC1)
        assert program_of(bench.packets(begun + rest)).rstrip(b"\0") == PROGRAM
        bench.wait(1)
        assert bench.all(Ended) == []

    def test_a_message_in_the_middle_of_the_packets(self) -> None:
        """After a power failure the control comes back with SYN."""
        bench = expansion()
        bench.streaming(limit=700)
        assert bench.answer(Command.SYN) == Message(command=Command.SYN)
        assert (bench.ended.outcome, "SYN" in bench.ended.reason) == (Outcome.FAILED, True)

    @pytest.mark.parametrize("state", [BufferState.OPERATING, BufferState.ALARM, BufferState.RESET])
    def test_sat_in_the_middle_of_the_packets(self, state: BufferState) -> None:
        bench = expansion()
        bench.streaming(limit=700)
        assert bench.sat(state).command is Command.SET
        assert bench.ended.outcome is (Outcome.CANCELLED if state is BufferState.RESET else Outcome.FAILED)

    def test_gtd_in_the_middle_of_the_packets(self) -> None:
        bench = expansion()
        bench.streaming(limit=700)
        assert bench.say(Command.GTD) == b""
        assert bench.ended.outcome is Outcome.FAILED

    def test_a_damaged_nak_of_the_end_packet_ends_in_silence(self) -> None:
        bench = expansion()
        bench.streaming(SHORT)
        bench.say_raw(b"\x15035\r")
        assert bench.wait(7) == b"07SYN\r" * 2
        assert bench.ended.outcome is Outcome.FAILED

    def test_a_character_of_the_end_packet_was_lost(self) -> None:
        """The SYN that ends the silence completes the packet for a control that waits for its last character."""
        bench = expansion()
        end = bench.packets(bench.streaming(SHORT))
        assert bench.wait(3.1) == b"07SYN\r"
        assert bench.packets(bench.monitor(Monitor.NAK, 0x30)) == end
        bench.sat(BufferState.OPERATING, 0)
        assert bench.ended.outcome is Outcome.COMPLETE

    def test_monitor_packets_outside_of_packets(self) -> None:
        bench = expansion()
        bench.power_on()
        assert bench.monitor(Monitor.DC3) == b""
        assert bench.all(Violation) == [Violation(what="DC3 while no packets are on")]


class TestAbort:
    def test_the_packet_under_way_is_finished(self) -> None:
        bench = expansion()
        begun = bench.streaming(limit=700)
        bench.host.abort(bench.now)
        assert numbers(bench.packets(begun + bench.pull())) == "30 31 32"
        assert bench.ended.outcome is Outcome.CANCELLED
        later = bench.packets(bench.wait(60))
        assert {packet.kind for packet in later} == {Kind.INVALID}
        assert bench.monitor(Monitor.NAK, 0x31) == b"", "nothing of the program is sent again"
        bench.arm(SHORT)
        assert {packet.kind for packet in bench.packets(bench.wait(20))} == {Kind.INVALID}
        assert bench.answer(Command.RST) == Message(command=Command.ARS)
        assert numbers(bench.packets(bench.say(Command.GTD))) == "FF"

    def test_the_end_packet_never_goes_out_after_it(self) -> None:
        bench = expansion()
        begun = bench.streaming(PROGRAM[:300] + b"%", limit=100)
        bench.host.abort(bench.now)
        assert numbers(bench.packets(begun + bench.pull() + bench.wait(30))) == "30 00 00"


MONITORS = [encode_monitor(monitor) for monitor in (Monitor.CAN, Monitor.DC3, Monitor.DC1)]
MONITORS += [encode_monitor(Monitor.NAK, number=number) for number in b"0123456789"] * 2


@given(
    script=st.lists(
        st.tuples(st.sampled_from([*MONITORS, b"ECGTD\r", b"06RST\r", b"?\r"]), st.integers(0, 1500)), max_size=12
    )
)
def test_whatever_monitor_packets_say(script: list[tuple[bytes, int]]) -> None:
    """A packet that bears the number awaited is always the one awaited: a control that follows the numbers gets the
    program's beginning, and never an end packet with data in the wrong place.
    """
    bench = expansion(Ne="100")
    said = bytearray(bench.streaming(limit=0))
    stopped = False
    for words, count in script:
        said += bench.pull(count)
        bench.host.receive_data(words, bench.now)
        if words[:1] in b"E0?" or words in MONITORS[:1]:
            stopped = True
            break
    if not stopped:
        said += bench.pull()
        for packet in bench.packets(bytes(said)):
            at = PROGRAM.find(packet.data.rstrip(b"\0"))
            assert at % 256 == 0
            assert packet.number in (0xFF, 0x30 + at // 256 % 10)
            assert (packet.number == 0xFF) is (at + 256 >= len(PROGRAM))
    bench.now += SECOND
    bench.wait(40)
    for ended in bench.all(Ended):
        assert ended.outcome is not Outcome.COMPLETE
        assert ended.bytes_low <= ended.bytes_high <= len(PROGRAM)


def test_the_rate_of_a_line_behind_a_fifo_is_measured_by_what_is_long() -> None:
    """A FIFO of 128 characters swallows a SET at once; that is no line of a million characters a second."""
    outbox = Outbox(Params.for_protocol_a({}, End.HOST).coding)
    for count, taken in ((62, 62), (1950, 128), (1950, 128)):
        outbox.put(b"x" * count)
        outbox.hand_over(count, SECOND)
        outbox.leave(taken, SECOND + 1)
        outbox.leave(count - taken, SECOND + 1 + (count - taken) * SECOND // 436)
    assert outbox.rate == pytest.approx(436 * 1950 / 1822, rel=0.01)
