"""The control's end, asking and REMOTE LOAD: clause by clause of the text, without a host."""

from __future__ import annotations

from typing import Any

import pytest

from tapewire.engine import AfterStop, Alarm, LineFault, Notice, Outcome, Started, Violation
from tapewire.protocols.bridgeport.cnc import State
from tapewire.protocols.bridgeport.messages import Mode, Parity, StopBreach, TapeEnd
from tapewire.protocols.settings import Switch
from tests.protocols.bridgeport.cnc_bench import ACK, CANCEL, DC1, DC2, DC3, DC4, DLE, EOT, NAK, Bench, P

# 1.1: the name


def test_1_1_a_named_load_to_the_byte() -> None:
    bench = Bench().start()
    assert bench.send() == DC2
    assert bench.receive(DC1).send() == bytes.fromhex("31 32 33 34 3B 4C 14 11")
    assert bench.receive(P + EOT).take() == P
    assert bench.end() == (Outcome.COMPLETE, 18, 18)
    assert bench.send() == b""
    assert (bench.engine.program_ended, bench.engine.progress, bench.engine.buffered) == (True, 18, 0)


@pytest.mark.parametrize("program", ["1", "0007", "999999"])
@pytest.mark.parametrize("mode", list(Mode))
def test_1_1_the_name_is_the_number_and_its_letter(program: str, mode: Mode) -> None:
    bench = Bench(program=program, mode=mode).asked()
    assert len(bench.all(Started)) == 1


@pytest.mark.parametrize("trailer", [DC4, EOT, b"\r" + DC4, b"\r\n" + EOT, EOT + DC4])
def test_1_1_line_4_every_name_ending(trailer: bytes) -> None:
    Bench(name_trailer=trailer).asked()


def test_1_1_nothing_is_asked_before_the_remote_is_ready() -> None:
    bench = Bench().start()
    bench.send()
    bench.receive(b"A" + DC3 + EOT)
    assert (bench.send(), bench.state) == (b"", State.NAME_OPENING)
    assert sum(violation.count for violation in bench.all(Violation)) == 3
    assert not bench.all(Started)


def test_1_1_a_ready_before_dc2_has_gone_out_answers_nothing() -> None:
    bench = Bench().start().receive(DC1)
    assert (bench.send(), len(bench.all(Violation))) == (DC2, 1)


def test_1_1_dc2_again_every_three_seconds() -> None:
    bench = Bench().start()
    bench.send()
    assert bench.wait(2.9).send() == b""
    assert bench.wait(0.1).send() == DC2
    assert bench.wait(9).send() == DC2, "the next three seconds begin when it was said"
    assert Bench(repeat=0.0).start().hand_over() == DC2


def test_1_1_a_dc2_that_waits_for_the_line_is_not_repeated_and_not_said_after_the_answer() -> None:
    bench = Bench().start()
    bench.wait(20)
    assert bench.send() == DC2
    bench.wait(3).receive(DC1)
    assert bench.send() == b"1234;L" + DC4 + DC1


@pytest.mark.parametrize("late", ["before the request", "before the text"])
def test_1_1_two_dc2_may_draw_two_answers(late: str) -> None:
    bench = Bench().start()
    bench.send()
    bench.wait(3).send()
    bench.receive(DC1)
    if late == "before the text":
        bench.send()
    bench.receive(DC1)
    bench.send()
    bench.receive(P + EOT)
    assert (bench.take(), bench.all(Violation)) == (P, [])


def test_1_1_an_answer_owed_to_a_job_before_is_none() -> None:
    bench = Bench().start().said().wait(3).said().receive(DC1).reset().said()
    bench.start().receive(DC1)
    assert (bench.send(), len(bench.all(Violation))) == (DC2, 1)


def test_1_1_an_answer_nobody_asked_for_is_not_taken_for_one() -> None:
    bench = Bench().start()
    bench.send()
    bench.receive(DC1 + DC1)
    assert len(bench.all(Violation)) == 1
    bench.send()
    bench.receive(DC1 + P + EOT)
    assert bench.take() == DC1 + P, "text by its place, and reported"
    assert len(bench.all(Violation)) == 2


def test_1_1_codes_of_its_own_profile() -> None:
    bench = Bench(open_write=0x05, write_ready=0x06, text_end=0x03, rec_end_last=0x19, read_request=0x07).start()
    assert bench.send() == b"\x05"
    assert bench.receive(b"\x06").send() == b"1234;L" + DC4 + b"\x07"
    assert bench.receive(P + b"\x03").take() == P


# 1.2 and the dumb subset: requests without a name


@pytest.mark.parametrize("settings", [{"program": "-1"}, {"program": "-1", "mode": Mode.LINK}, {"naming": Switch.OFF}])
def test_1_2_a_request_without_a_name_is_dc1_alone(settings: dict[str, Any]) -> None:
    bench = Bench(**settings).start()
    assert bench.send() == DC1
    assert bench.receive(P + EOT).take() == P
    assert bench.end() == (Outcome.COMPLETE, 18, 18)


@pytest.mark.parametrize(
    ("tape_end", "text"),
    [(TapeEnd.PERCENT, b"\r\n%\r\n" + P + b"%"), (TapeEnd.M30, b"M300\r\n(M2)X" + b"9" * 300 + b"\r\nN20M02\r\n")],
)
def test_dumb_subset_what_ends_a_bare_tape(tape_end: TapeEnd, text: bytes) -> None:
    bench = Bench(program="-1", tape_end=tape_end).start()
    bench.send()
    if tape_end is TapeEnd.M30:
        text = text.replace(b"(M2)", b"(MM)")
    bench.receive(text + bytes(50) + b"\r\n" + EOT)
    assert bench.take() == text
    assert bench.end() == (Outcome.COMPLETE, len(text), len(text))
    assert bench.all(Violation) == []
    named = Bench(tape_end=tape_end).asked().receive(text)
    assert (named.take(), named.end()) == (text, None), "a named program ends with EOT only"


def test_dumb_subset_leader_and_rubouts_are_left_out() -> None:
    bench = Bench(program="-1").start()
    bench.send()
    bench.receive(bytes(100) + b"\x7f" + P[:5] + b"\x00\x7f" + P[5:] + bytes(20) + EOT)
    assert bench.take() == P


def test_dumb_subset_no_answer_leaves_the_control_waiting() -> None:
    bench = Bench(program="-1").start()
    bench.send()
    assert bench.engine.next_deadline() is None
    assert (bench.wait(100_000).send(), bench.end()) == (b"", None)


def test_a_request_said_again_as_a_setting() -> None:
    bench = Bench(request_repeat=10.0).asked()
    assert bench.wait(10).send() == DC1
    assert bench.wait(10).send() == DC1
    assert bench.receive(b"N").wait(100).send() == b""


@pytest.mark.parametrize("settings", [{}, {"program": "-1"}, {"mode": Mode.LINK}])
def test_no_answer_as_a_setting_makes_the_control_give_up(settings: dict[str, Any]) -> None:
    bench = Bench(answer_limit=7.5, **settings).start()
    bench.send()
    if bench.wait(7.4).state is State.NAME_OPENING:
        assert bench.send() == DC2
        bench.receive(DC1)
        bench.send()
        bench.wait(7.4)
    assert bench.send() == b""
    assert bench.wait(0.2).send() == DLE
    assert bench.end() == (Outcome.FAILED, 0, 0)
    assert "no answer for 7.5 s" in bench.ended().reason


def test_dc2_said_again_does_not_put_off_the_giving_up() -> None:
    bench = Bench(answer_limit=7.5).start()
    said = b"".join(bench.wait(1).send() for _ in range(9))
    assert said == DC2 * 3 + DLE


# 2.1: one record of at most 12000 characters


def test_2_1_1_and_2_1_3_twelve_thousand_characters() -> None:
    text = b"N10G1X1\r\n" * 1333 + b"X1\n"
    assert len(text) == 12000
    bench = Bench(buffer=20_000).asked().receive(text + EOT)
    assert bench.take() == text
    assert bench.end() == (Outcome.COMPLETE, 12000, 12000)


def test_2_1_1_one_more_is_cancelled() -> None:
    bench = Bench(buffer=20_000).asked().receive(b"0" * 12000)
    assert bench.end() is None
    bench.receive(b"0")
    assert bench.send() == DLE
    assert bench.end() == (Outcome.FAILED, 0, 12000)
    assert "2.1.1" in bench.all(Alarm)[0].text


def test_2_1_the_figure_eot_ends_the_record_wherever_it_stands() -> None:
    bench = Bench().asked().receive(P[:1] + EOT + P)
    assert (bench.take(), bench.end()) == (P[:1], (Outcome.COMPLETE, 1, 1))
    assert "shorter than nine (1.1)" in bench.all(Notice)[0].text


@pytest.mark.parametrize(("length", "notices"), [(8, 1), (9, 0)])
def test_1_1_a_program_has_nine_characters_at_least(length: int, notices: int) -> None:
    bench = Bench().asked().receive(b"0" * length + EOT)
    assert (len(bench.take()), len(bench.all(Notice))) == (length, notices)


def test_1_2_1_a_lone_eot_is_no_program() -> None:
    bench = Bench().asked().receive(EOT)
    assert (bench.send(), bench.end()) == (b"", (Outcome.FAILED, 0, 0))
    assert "no such program" in bench.ended().reason
    assert not bench.engine.program_ended


def test_2_1_what_is_no_program_is_stored_and_reported() -> None:
    text = b"N10" + ACK + DC3 + NAK + b"\x1a\r\n\tX\x1b"
    bench = Bench().asked().receive(text + EOT)
    assert bench.take() == text
    assert [violation.count for violation in bench.all(Violation)] == [5]


def test_the_program_has_not_ended_before_all_of_it_is_taken() -> None:
    bench = Bench().asked().receive(P + EOT)
    assert bench.take(17) == P[:17]
    assert (bench.engine.program_ended, bench.end(), bench.engine.buffered) == (False, None, 1)
    assert bench.take(0) == bench.take(-1) == b""
    assert bench.take() == P[17:]
    assert (bench.engine.program_ended, bench.end()) == (True, (Outcome.COMPLETE, 18, 18))


def test_a_second_program_is_loaded_after_the_first() -> None:
    bench = Bench().asked().receive(P + EOT)
    bench.take()
    bench.asked()
    assert not bench.engine.program_ended
    assert bench.receive(b"M30\r\nM30\r\n" + EOT).take() == b"M30\r\nM30\r\n"


def test_what_comes_after_the_end_is_late_within_three_characters() -> None:
    bench = Bench().asked().receive(P + EOT + b"abc")
    assert (len(bench.all(Notice)), bench.all(Violation)) == (1, [])
    bench.receive(b"d")
    bench.take()
    bench.receive(b"ef")
    assert sum(violation.count for violation in bench.all(Violation)) == 3
    assert bench.end() == (Outcome.COMPLETE, 18, 18)


def test_at_rest_nobody_asked_for_anything() -> None:
    bench = Bench().receive(P)
    assert [violation.count for violation in bench.all(Violation)] == [18]
    assert (bench.send(), bench.state) == (b"", State.IDLE)


# 2.1.4: parity, by the UART or in software


def test_2_1_4_parity_in_software_both_ways() -> None:
    bench = Bench(parity=Parity.SOFTWARE).start()
    assert bench.send() == b"\x12"
    bench.engine.receive_data(b"\x11", 0)
    assert bench.send() == bytes.fromhex("B1 B2 33 B4 BB CC 14 11")
    bench.receive(bytes.fromhex("4E B1 30 47 30 D8 30 59 30 8D 0A 4E B2 30 4D B2 8D 0A 84"))
    assert bench.take() == P


def test_2_1_4_software_finds_every_wrong_bit() -> None:
    for bit in range(8):
        bench = Bench(parity=Parity.SOFTWARE, program="-1").start().said().receive(bytes([0x4E ^ 1 << bit]))
        assert bench.send() == b"\x90"
        assert bench.end() == (Outcome.FAILED, 0, 0)


def test_2_1_4_with_parity_on_the_line_bit_8_is_not_looked_at() -> None:
    bench = Bench().asked().receive(bytes(byte | 0x80 for byte in P + EOT))
    assert bench.take() == P


@pytest.mark.parametrize("fault", list(LineFault))
@pytest.mark.parametrize("text", [b"", b"N10G0"])
def test_4_1_1_a_damaged_character_is_fatal_to_remote_load(fault: LineFault, text: bytes) -> None:
    bench = Bench().asked().receive(text).fault(fault, None if fault is LineFault.BREAK else 0x04)
    assert bench.send() == DLE
    assert bench.end() == (Outcome.FAILED, 0, len(text))
    assert f"{fault}" in bench.all(Alarm)[0].text
    assert f"after {len(text)} characters of text" in bench.ended().reason
    assert bench.receive(b"X0Y").take() == b"", "4.3.2: what was received is of no use"


def test_4_1_1_the_code_of_a_cancel_is_a_setting() -> None:
    assert Bench(parity_cancel=DC3 + DLE).asked().fault().send() == CANCEL


@pytest.mark.parametrize("fault", list(LineFault))
def test_4_1_1_elsewhere_a_damaged_character_is_obeyed_as_nothing(fault: LineFault) -> None:
    for bench in (Bench(), Bench().start(), Bench().opened(P), Bench().saving(), Bench().asked().receive(P + EOT)):
        before = bench.state
        bench.fault(fault, 0x11)
        assert (bench.state, len(bench.all(Violation))) == (before, 1)


# 3: XOFF and XON from the buffer


def test_3_1_a_single_dc3_at_the_level_and_a_single_dc1() -> None:
    bench = Bench(buffer=400, stop_at_free=10, start_at_free=100).asked().receive(b"0" * 389)
    assert bench.send() == b""
    assert bench.receive(b"0").send() == DC3
    assert bench.receive(b"123").send() == b""
    assert bench.take(92) == b"0" * 92
    assert bench.send() == b""
    bench.take(1)
    assert bench.send() == DC1
    assert bench.all(AfterStop) == [AfterStop(count=3, allowed=3)]
    assert bench.receive(b"!" + EOT).take() == b"0" * 297 + b"123!"
    assert bench.all(Violation) == []


def test_3_2_three_characters_count_from_when_the_dc3_has_left() -> None:
    bench = Bench(buffer=400).asked().receive(b"0" * 368)
    bench.receive(b"ab")
    assert bench.hand_over() == DC3
    bench.receive(b"cd")
    bench.left(1).receive(b"efg")
    bench.take()
    assert bench.send() == DC1
    assert (bench.all(AfterStop), bench.all(Violation)) == ([AfterStop(count=3, allowed=3)], [])


def test_3_2_a_fourth_character_is_a_violation() -> None:
    bench = Bench().stopped().receive(b"1234" + b"56")
    assert [violation.count for violation in bench.all(Violation)] == [3]
    bench.take()
    assert (bench.all(AfterStop), bench.end()) == ([AfterStop(count=6, allowed=3)], None)
    bench.receive(b"7" + EOT)
    assert bench.take() == b"7"


def test_3_2_a_fourth_character_ends_the_load_as_a_setting() -> None:
    bench = Bench(stop_breach=StopBreach.CANCEL).stopped().receive(b"123")
    assert bench.end() is None
    bench.receive(b"4")
    assert bench.send() == DLE
    assert bench.all(AfterStop) == [AfterStop(count=4, allowed=3)]
    assert bench.end() == (Outcome.FAILED, 0, 992 + 3)
    assert "3.2" in bench.ended().reason


@pytest.mark.parametrize("end", [EOT, b"\xff"])
def test_3_2_damaged_characters_and_the_end_count_too(end: bytes) -> None:
    bench = Bench(stop_breach=StopBreach.CANCEL).stopped().receive(b"123")
    if end == EOT:
        bench.receive(end)
    else:
        bench.fault()
    assert (bench.send(), len(bench.all(Violation))) == (DLE, 1)


def test_3_2_the_buffer_bears_no_more_than_it_has() -> None:
    bench = Bench(buffer=300, stop_at_free=4).stopped().receive(b"1234")
    assert bench.end() is None
    bench.receive(b"5")
    assert bench.send() == DLE
    assert "buffer of 300 characters is full" in bench.ended().reason


def test_3_1_a_dc3_that_waits_for_the_line_is_taken_back() -> None:
    bench = Bench().asked().receive(b"0" * 992)
    bench.take()
    assert (bench.send(), bench.all(AfterStop)) == (b"", [])


def test_3_1_the_end_came_before_the_stop_worked() -> None:
    bench = Bench().stopped().receive(EOT)
    assert bench.all(AfterStop) == [AfterStop(count=1, allowed=3)]
    bench.take()
    assert (bench.send(), bench.end()) == (b"", (Outcome.COMPLETE, 992, 992))


def test_3_1_a_late_xon_as_a_setting() -> None:
    bench = Bench(late_xon=Switch.ON).stopped().receive(EOT)
    bench.take(300)
    assert bench.send() == b""
    bench.take(100)
    assert bench.send() == DC1
    bench.take()
    assert bench.end() == (Outcome.COMPLETE, 992, 992)


def test_3_1_the_end_waits_for_a_late_xon_to_leave_but_not_on_a_closed_line() -> None:
    bench = Bench(late_xon=Switch.ON).stopped().receive(EOT)
    bench.take()
    assert (bench.hand_over(), bench.end()) == (DC1, None)
    assert bench.left(1).end() == (Outcome.COMPLETE, 992, 992)
    closed = Bench(late_xon=Switch.ON).stopped().receive(EOT).close()
    assert (len(closed.take()), closed.end()) == (992, (Outcome.COMPLETE, 992, 992))


def test_silence_inside_the_text_as_a_setting() -> None:
    bench = Bench(load_timeout=2.0, buffer=300).asked().wait(100).receive(b"N1").wait(1.9).receive(b"0").wait(1.9)
    assert bench.end() is None
    assert bench.wait(0.1).send() == DLE
    assert "nothing came for 2 s after 3 characters" in bench.ended().reason
    stopped = Bench(load_timeout=2.0).stopped().wait(100)
    assert stopped.end() is None, "it is we who hold the remote"
    stopped.take()
    stopped.wait(100)
    assert stopped.end() is None, "the XON has not left us yet"
    assert stopped.send() == DC1
    assert stopped.wait(2).send() == DLE
    withdrawn = Bench(load_timeout=2.0).asked().receive(b"0" * 992)
    withdrawn.take()
    assert withdrawn.wait(2).send() == DLE
