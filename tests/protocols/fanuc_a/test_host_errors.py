"""The host of protocol A: repetition, giving up, and whatever else may come (4.6)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import (
    SECOND,
    Closure,
    Ended,
    LineFault,
    Outcome,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.host import State
from tapewire.protocols.fanuc_a.host_law import LAW
from tapewire.protocols.fanuc_a.messages import (
    ANSWERS,
    ORIGINS,
    Coding,
    Command,
    Error,
    Message,
    MessageReader,
    Origin,
    Unreadable,
    encode_message,
)
from tests.protocols.fanuc_a.host_bench import PROGRAM, Bench, Trickle

WAT, EOD, SET = Message(command=Command.WAT), Message(command=Command.EOD), Message(command=Command.SET)


def readings(said: bytes) -> list[Command | Error]:
    """What a control makes of it."""
    reader, position, found = MessageReader(Coding()), 0, []
    while position < len(said):
        position, reading = reader.read(said, position)
        assert reading is not None
        found.append(reading.error if isinstance(reading, Unreadable) else reading.command)
    return found


class Test46:
    """Error process: RTY both ways."""

    def test_rty_draws_the_message_before(self) -> None:
        bench = Bench()
        first = bench.sending()
        assert bench.answer(Command.RTY, b"1") == first
        assert bench.host.progress == len(first.data)
        assert bench.answer(Command.GTD).data == PROGRAM[3488:6976]

    def test_what_cannot_be_read_draws_rty_once_it_is_over(self) -> None:
        bench = Bench()
        bench.power_on()
        assert bench.say_raw(b"EDGTD\r") == b""
        assert bench.wait(0.04) == b""
        assert bench.say_raw(b"..") == b""
        assert bench.wait(0.04) == b""
        assert bench.wait(0.02) == b"3DRTY1\r"
        assert bench.say(Command.GTD) == b"", "the answer waits in case the RTY has crossed a message"
        assert bench.messages(bench.wait(1)) == [WAT]

    def test_a_message_that_crossed_our_rty_is_answered_once(self) -> None:
        """Two GTDs for one DAT would prove a DAT that never arrived."""
        bench = Bench()
        bench.sending()
        bench.say_raw(b"#\r")
        assert bench.wait(0.06) == b"3DRTY1\r"
        assert bench.say(Command.GTD) == b""
        bench.wait(0.05)
        assert bench.say(Command.GTD) == b""
        [second] = bench.messages(bench.wait(1))
        assert second.data == PROGRAM[3488:6976]

    def test_rty_after_our_rty_draws_rty(self) -> None:
        """Going back to the DAT before it could bring that twice."""
        bench = Bench()
        bench.sending()
        bench.say_raw(b"#\r")
        bench.wait(0.06)
        assert bench.answer(Command.RTY, b"1") == Message(command=Command.RTY, data=b"1")

    def test_a_message_that_stops_in_the_middle_draws_rty(self) -> None:
        """15.10."""
        bench = Bench()
        bench.power_on()
        bench.say_raw(b"ECGT")
        assert bench.wait(0.99) == b""
        assert bench.wait(0.1) == b"3DRTY1\r"

    def test_a_damaged_character_draws_rty(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.say_raw(b"ECG")
        bench.host.receive_line_fault(LineFault.PARITY, 0x54, bench.now)
        bench.say_raw(b"D\r")
        assert bench.wait(0.1) == b"3DRTY1\r"
        assert Violation(what="parity error in what the control sent") in bench.events

    def test_more_retries_than_ne_fail_the_job(self) -> None:
        bench = Bench(Ne="2")
        first = bench.sending()
        assert [bench.answer(Command.RTY, b"1") for _ in range(2)] == [first, first]
        assert bench.say(Command.RTY, b"1") == b""
        assert (bench.ended.outcome, "Ne" in bench.ended.reason) == (Outcome.FAILED, True)

    def test_more_own_rty_than_ne_fails_the_job(self) -> None:
        bench = Bench(Ne="2")
        bench.sending()
        for expected in (b"3DRTY1\r", b"3DRTY1\r", b""):
            bench.say_raw(b"#\r")
            assert bench.wait(0.1) == expected
        assert "Ne" in bench.ended.reason

    @pytest.mark.parametrize(("retries", "alive"), [("exchange", True), ("job", False)])
    def test_the_count_starts_again_after_a_good_exchange(self, retries: str, alive: bool) -> None:
        bench = Bench(Ne="2", retries=retries)
        bench.sending()
        for _ in range(3):
            bench.say(Command.RTY, b"1")
            bench.say(Command.GTD)
        assert (bench.all(Ended) == []) is alive

    def test_a_dat_is_not_proven_by_what_comes_before_its_end(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        said = bench.pull(100) + bench.say(Command.GTD)
        assert readings(said) == [Error.CHECKSUM, Command.WAT]
        assert (bench.ended.outcome, bench.ended.bytes_low, bench.ended.bytes_high) == (Outcome.FAILED, 0, 95)


class TestHeardInTheMiddleOfADat:
    """A control that hears an end code in the noise asks for a repetition while we still speak (4.4.1 RTY)."""

    def begun(self) -> tuple[Bench, bytes]:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        return bench, bench.pull(100)

    def test_rty_never_replaces_the_rest(self) -> None:
        """What follows would count as the rest of the DAT, with nothing but the sum to tell them apart."""
        bench, said = self.begun()
        dat = (said + bench.say(Command.RTY, b"1")).split(b"\r")
        assert [len(part) for part in dat] == [5 + 3488, 0]
        assert bench.say(Command.RTY, b"1") == dat[0] + b"\r", "the control has heard the rest and asks once more"

    def test_a_control_that_heard_no_rest_gets_the_repetition(self) -> None:
        bench, said = self.begun()
        said += bench.say(Command.RTY, b"1")
        assert bench.wait(0.14) == b""
        assert bench.wait(0.1) == said
        assert len(bench.all(Violation)) == 1

    def test_a_control_that_goes_on_gets_its_answer(self) -> None:
        bench, _ = self.begun()
        bench.say(Command.RTY, b"1")
        assert bench.answer(Command.GTD).data == PROGRAM[3488:6976]
        assert bench.wait(0.5) == b""

    def test_noise_draws_no_rty_before_the_end(self) -> None:
        bench, _ = self.begun()
        bench.host.receive_data(b"\x7f\r", bench.now)
        said = bytearray()
        for _ in range(10):
            said += bench.pull(100)
            bench.now += SECOND // 10
            bench.host.handle_timer(bench.now)
        assert b"RTY" not in said
        rest = bytes(said) + bench.pull()
        assert rest.endswith(b"\r")
        assert bench.wait(0.1) == b""
        assert bench.wait(0.1) == b"3DRTY1\r"

    @pytest.mark.parametrize("handed", range(1, 12))
    @pytest.mark.parametrize("said", [Command.RST, Command.ALM, Command.SYN, Command.SAT])
    def test_an_answer_never_counts_as_the_rest(self, said: Command, handed: int) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        data = b"02000000" if said is Command.SAT else b""
        heard = readings(bench.pull(handed) + bench.say(said, data))
        assert (heard[0], len(heard)) == (Error.CHECKSUM, 2)
        assert heard[1] in ANSWERS[said]

    def test_a_set_that_is_interrupted(self) -> None:
        bench = Bench()
        bench.answer(Command.SYN)
        bench.host.receive_data(encode_message(Message(command=Command.SAT, data=b"01000000"), Coding()), bench.now)
        assert readings(bench.pull(20) + bench.say(Command.SYN)) == [Error.CHECKSUM, Command.SYN]

    def test_an_interrupted_interruption(self) -> None:
        bench, said = self.begun()
        bench.host.receive_data(b"06RST\r", bench.now)
        said += bench.pull(3)
        bench.host.receive_data(b"E7ALM\r", bench.now)
        said += bench.pull()
        assert readings(said) == [Error.CHECKSUM, Error.CHECKSUM, Command.AAL]

    @pytest.mark.parametrize("recalled", range(101))
    def test_what_is_called_back_then(self, recalled: int) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm(PROGRAM[:89])
        bench.host.receive_data(b"ECGTD\r", bench.now)
        dat = bench.host.data_to_send(100)
        bench.host.data_sent(min(len(dat), 100), bench.now)
        bench.host.receive_data(b"06RST\r", bench.now)
        assert bench.host.recall
        count = min(recalled, len(dat))
        bench.host.data_discarded(count, bench.now)
        heard = readings(dat[: len(dat) - count] + bench.pull())
        partly = [] if count == len(dat) else [Command.DAT if not count else Error.CHECKSUM]
        assert heard == [*partly, Command.ARS]


class TestAbort:
    """A job that is given up here never looks whole (8.2)."""

    @pytest.mark.parametrize("handed", [1, 2, 5, 6, 7, 100, 3490, 3493])
    def test_a_dat_under_way_is_cut_so_that_it_cannot_be_taken(self, handed: int) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        begun = bench.pull(handed)
        bench.host.abort(bench.now)
        said = begun + bench.pull()
        reader = MessageReader(Coding())
        position, reading = reader.read(said)
        assert isinstance(reading, Unreadable)
        assert position == len(said) <= max(handed + 2, 9)
        assert bench.ended.outcome is Outcome.CANCELLED
        assert bench.answer(Command.RTY, b"1") == WAT
        assert bench.answer(Command.GTD) == WAT

    def test_a_cut_that_would_have_the_right_sum_gets_another_byte(self) -> None:
        """DAT with data whose sum is 0 modulo 256 is cut after all of it but the last NUL."""
        bench = Bench()
        bench.power_on()
        bench.arm(b"A" + bytes(50))
        bench.host.receive_data(b"ECGTD\r", bench.now)
        begun = bench.pull(30)
        bench.host.abort(bench.now)
        _, reading = MessageReader(Coding()).read(begun + bench.pull())
        assert isinstance(reading, Unreadable)

    def test_what_has_not_left_is_called_back(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.receive_data(b"ECGTD\r", bench.now)
        data = bench.host.data_to_send(40)
        bench.host.data_sent(len(data), bench.now)
        bench.host.abort(bench.now)
        assert bench.host.recall
        assert bench.host.data_to_send(10) == b""
        bench.host.data_discarded(40, bench.now)
        assert not bench.host.recall
        assert bench.messages(bench.pull()) == [WAT]

    def test_an_armed_job(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm()
        bench.host.abort(bench.now)
        bench.pull()
        assert (bench.ended.outcome, bench.ended.bytes_high) == (Outcome.CANCELLED, 0)
        bench.host.abort(bench.now)
        assert len(bench.all(Ended)) == 1

    def test_while_the_source_is_late(self) -> None:
        bench = Bench()
        bench.power_on()
        bench.arm(Trickle())
        assert bench.say(Command.GTD) == b""
        bench.host.abort(bench.now)
        assert bench.messages(bench.pull()) == [WAT]

    def test_the_line_is_lost(self) -> None:
        bench = Bench()
        bench.sending()
        bench.host.receive_closed(Closure.LOST, "unplugged", bench.now)
        bench.drain()
        assert bench.ended.outcome is Outcome.FAILED
        assert (bench.host.next_deadline(), bench.host.data_to_send(10)) == (None, b"")
        with pytest.raises(UsageError, match="line is gone"):
            bench.arm()

    def test_the_end_waits_for_the_last_answer_to_leave(self) -> None:
        bench = Bench()
        bench.sending()
        bench.host.receive_data(b"06RST\r", bench.now)
        said = bench.host.data_to_send(10)
        bench.host.data_sent(len(said), bench.now)
        bench.drain()
        assert bench.all(Ended) == []
        bench.host.data_left(len(said), bench.now)
        bench.drain()
        assert bench.ended.outcome is Outcome.CANCELLED


def test_every_state_and_command_has_a_row_or_falls_to_the_policy() -> None:
    """Run with -rA to read the table."""
    policy = []
    for state in State:
        for command in Command:
            row = LAW.get((state, command))
            if row is None:
                policy.append((state, command))
                print(f"{state.value:10} {command.value}  violation, no answer")
                continue
            answers = " ".join(sorted(answer.value for answer in row.answers))
            print(f"{state.value:10} {command.value}  {answers}  -> {', '.join(sorted(s.value for s in row.states))}")
            assert command is Command.RTY or row.answers <= ANSWERS[command]
    by_host = {command for command in Command if ORIGINS[command] is Origin.HOST}
    packets = {(s, c) for s in (State.STREAMING, State.AWAITING) for c in (Command.SDI, Command.RTY)}
    assert set(policy) == {(state, command) for state in State for command in by_host} | packets


@pytest.mark.parametrize("command", [command for command in Command if ORIGINS[command] is Origin.HOST])
def test_a_hosts_command_from_the_control_changes_nothing(command: Command) -> None:
    bench = Bench()
    bench.sending()
    assert bench.say(command) == b""
    assert bench.host.state is State.SENDING
    assert bench.all(Violation) == [Violation(what=f"{command.value} while sending")]


def test_4_6_a_program_armed_among_packets_of_none_does_not_wait_for_a_control_that_has_left_them() -> None:
    """The control gave the line up while what it said last could not be read; now it hears nothing but SYN."""
    bench = Bench(expansion=True, n="1")
    bench.streaming(Trickle(PROGRAM[:100]))
    bench.say_raw(b"\x13 ")
    bench.wait(60)
    assert bench.all(Ended)[-1].reason == "a monitor packet could not be read and nothing came after it"
    assert bench.wait(60) == b""
    bench.arm()
    assert Message(command=Command.SYN) in bench.messages(bench.wait(25))
    bench.power_on()
    assert bench.packets(bench.say(Command.GTD))[0].number == 0x30


@pytest.mark.parametrize("after", [1, 60])
def test_4_6_a_program_armed_while_packets_of_none_are_held_is_asked_for_anew(after: int) -> None:
    """Nothing was armed when what the control said could not be read, and nothing says that it is still there."""
    bench = Bench(expansion=True, n="1")
    bench.power_on()
    assert bench.say(Command.GTD) == b"", "there is no program"
    bench.say_raw(b"\x13 ")
    bench.wait(after)
    bench.arm()
    heard = bench.wait(25)
    assert PROGRAM[:20] not in heard, "nothing says that it asks for this one"
    assert Message(command=Command.SYN) in bench.messages(heard)
    bench.power_on()
    assert bench.packets(bench.say(Command.GTD))[0].number == 0x30


SAYINGS = [b"07SYN\r", b"FCRDY\r", b"ECGTD\r", b"06RST\r", b"E7ALM\r", b"3DRTY1\r", b"63SDIA5\r", b"#\r", b"ECG"]
STATUSES = [b"01000000", b"02000000", b"02000009", b"03000000", b"04000000"]
SAYINGS += [encode_message(Message(command=Command.SAT, data=data), Coding()) for data in STATUSES]
SCRIPT = st.lists(st.sampled_from(SAYINGS + [b"ECGTD\r"] * 10), max_size=12)


@given(script=SCRIPT, waits=st.lists(st.floats(0, 3), min_size=12, max_size=12))
def test_never_more_of_the_program_than_in_order(script: list[bytes], waits: list[float]) -> None:
    """Whatever the control says: what DATs carry is the program's beginning, EOD comes after all of it, and
    COMPLETE means that all of it was taken.
    """
    bench = Bench(Ne="3", wat_after="0.1")
    bench.power_on()
    bench.arm()
    said = bytearray()
    for words, seconds in zip(script, waits, strict=False):
        said += bench.say_raw(words)
        said += bench.wait(seconds)
    taken = b""
    for message in bench.messages(bytes(said)):
        if message.command is Command.DAT:
            assert PROGRAM.startswith(taken + message.data) or taken.endswith(message.data)
            taken = taken if taken.endswith(message.data) else taken + message.data
        if message.command is Command.EOD:
            assert taken == PROGRAM
    for ended in bench.all(Ended):
        assert ended.bytes_low <= ended.bytes_high == len(taken)
        assert ended.outcome is not Outcome.COMPLETE or taken == PROGRAM
