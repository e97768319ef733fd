"""The control's end, saving a program to the remote (1.2.2): clause by clause of the text, without a host."""

from __future__ import annotations

import pytest

from tapewire.engine import Closure, Held, Outcome, Resumed, Started, Violation
from tapewire.protocols.bridgeport.cnc import State
from tapewire.protocols.bridgeport.messages import Mode, Parity
from tapewire.protocols.settings import Switch
from tests.protocols.bridgeport.cnc_bench import (
    CANCEL,
    DC1,
    DC2,
    DC3,
    DC4,
    DLE,
    EOT,
    Bench,
    P,
)


def test_1_2_2_the_example_to_the_byte() -> None:
    bench = Bench().punch(P)
    assert bench.send() == DC2
    assert bench.receive(DC1).send() == bytes.fromhex("31 32 33 34 3B 4C 14 12")
    assert not bench.all(Started)
    bench.receive(DC1)
    assert len(bench.all(Started)) == 1
    assert bench.hand_over() == P + EOT + DC4
    assert (bench.engine.progress, bench.end()) == (18, None)
    bench.left(19)
    assert bench.end() is None
    assert bench.left(2).end() == (Outcome.COMPLETE, 18, 18)
    assert (bench.engine.program_ended, bench.take(), bench.send()) == (False, b"", b"")


@pytest.mark.parametrize("trailer", [EOT + DC4, EOT, DC4, EOT + EOT, b""])
def test_1_2_2_lines_4_and_5_every_save_ending(trailer: bytes) -> None:
    bench = Bench(save_trailer=trailer).opened(P).receive(DC1)
    assert bench.send() == P + trailer
    assert bench.end() == (Outcome.COMPLETE, 18, 18)


def test_1_2_2_the_letter_of_the_name_is_that_of_the_mode() -> None:
    bench = Bench(mode=Mode.LINK, program="77").punch(P)
    bench.send()
    assert bench.receive(DC1).send() == b"77;D" + DC4 + DC2


def test_1_2_2_without_a_name() -> None:
    for settings in ({"program": "-1"}, {"naming": Switch.OFF}):
        bench = Bench(**settings).punch(P)
        assert bench.send() == DC2
        assert bench.receive(DC1).send() == P + EOT + DC4


def test_1_2_2_as_to_a_tape_punch_without_any_handshake() -> None:
    bench = Bench(program="-1", bare_save=Switch.ON).punch(P)
    assert (bench.send(), bench.end()) == (P + EOT + DC4, (Outcome.COMPLETE, 18, 18))
    assert Bench(bare_save=Switch.ON).punch(P).send() == DC2, "a named program is announced"


def test_1_2_2_dc2_again_every_three_seconds_for_the_name_and_for_the_program() -> None:
    bench = Bench().opened(P)
    assert bench.wait(3).send() == DC2
    assert bench.wait(3).send() == DC2
    assert bench.receive(DC1).send() == P + EOT + DC4


def test_1_2_2_a_late_answer_to_the_first_dc2_does_not_let_the_program_go() -> None:
    bench = Bench().punch(P)
    bench.send()
    bench.wait(3).send()
    bench.receive(DC1 + DC1)
    assert bench.send() == b"1234;L" + DC4 + DC2
    assert bench.all(Violation) == []
    assert bench.receive(DC1).send() == P + EOT + DC4


def test_1_2_2_a_second_answer_during_the_program_is_none() -> None:
    bench = Bench().opened(b"0" * 100)
    bench.wait(3).send()
    bench.receive(DC1)
    bench.engine.data_sent(len(bench.engine.data_to_send(5)), bench.now)
    bench.receive(DC1)
    assert bench.all(Violation) == []
    bench.receive(DC1)
    assert len(bench.all(Violation)) == 1
    assert bench.send() == b"0" * 95 + EOT + DC4


def test_2_1_4_parity_in_software_and_never_an_eighth_bit_otherwise() -> None:
    bench = Bench(program="-1", bare_save=Switch.ON, parity=Parity.SOFTWARE).punch(P)
    wire = bytes.fromhex("4E B1 30 47 30 D8 30 59 30 8D 0A 4E B2 30 4D B2 8D 0A 84 14")
    assert bench.send() == wire
    assert Bench(program="-1", bare_save=Switch.ON).punch(wire[:-2]).send() == P + EOT + DC4


@pytest.mark.parametrize("after_stop", range(4))
def test_3_2_at_most_three_characters_after_xoff(after_stop: int) -> None:
    bench = Bench(after_stop=after_stop).saving().receive(DC3)
    assert bench.send() == b"0" * after_stop
    assert (bench.wait(1000).send(), len(bench.all(Held))) == (b"", 1)
    bench.receive(DC1)
    assert len(bench.all(Resumed)) == 1
    assert bench.send() == b"0" * (996 - after_stop) + EOT + DC4
    assert bench.end() == (Outcome.COMPLETE, 1000, 1000)


def test_3_2_the_end_waits_for_the_xon_too() -> None:
    bench = Bench().opened(b"012").receive(DC1).receive(DC3)
    assert bench.send() == b"012"
    assert bench.end() is None
    assert bench.receive(DC1).send() == EOT + DC4


def test_3_2_each_xoff_has_its_three() -> None:
    bench = Bench(after_stop=1).saving()
    for _ in range(5):
        assert bench.receive(DC3).send() == b"0"
        bench.receive(DC1)
    assert bench.send() == b"0" * 991 + EOT + DC4


def test_3_1_a_second_xoff_or_xon_changes_nothing() -> None:
    bench = Bench(after_stop=2).saving().receive(DC1 + DC3 + DC3)
    assert bench.send() == b"00"
    assert len(bench.all(Violation)) == 2
    assert bench.all(Held) == [Held(why="XOFF from the remote")]


@pytest.mark.parametrize("paused", [False, True])
def test_3_2_b_a_cancel_from_the_remote_ends_the_save(paused: bool) -> None:
    bench = Bench().saving().receive(DC3 if paused else b"").receive(DLE)
    assert (bench.send(), bench.end()) == (b"", (Outcome.CANCELLED, 4, 4))
    assert "3.2" in bench.ended().reason


def test_4_3_1_the_operator_cancels_a_save_and_no_end_follows() -> None:
    bench = Bench().saving()
    bench.engine.data_sent(len(bench.engine.data_to_send(6)), bench.now)
    bench.reset()
    assert bench.engine.recall
    assert (bench.hand_over(), bench.end()) == (b"", None)
    bench.engine.data_discarded(5, bench.now)
    assert not bench.engine.recall
    assert bench.send() == CANCEL
    assert bench.end() == (Outcome.CANCELLED, 5, 5)


def test_4_3_1_a_cancel_while_the_last_codes_leave() -> None:
    bench = Bench().opened(P).receive(DC1)
    bench.hand_over()
    bench.reset()
    assert bench.send() == CANCEL
    assert bench.end() == (Outcome.CANCELLED, 18, 18)


def test_1_2_2_what_means_nothing_during_a_save_is_ignored_and_reported() -> None:
    bench = Bench().saving().receive(b"A" + EOT + b"\x06\x15\x17")
    assert [violation.count for violation in bench.all(Violation)] == [5]
    assert bench.send() == b"0" * 996 + EOT + DC4


def test_1_2_2_an_xoff_at_the_end_as_related_links_do_is_no_violation() -> None:
    bench = Bench().opened(P).receive(DC1)
    bench.send()
    bench.receive(DC3)
    assert bench.all(Violation) == []


def test_a_source_that_has_nothing_yet() -> None:
    bench = Bench().opened(b"01", None, None, b"23", None).receive(DC1)
    assert bench.send() == b"01"
    assert bench.wait(0.009).send() == b""
    assert bench.wait(0.011).send() == b"23"
    assert bench.wait(0.02).send() == EOT + DC4
    assert bench.engine.next_deadline() is None


def test_an_empty_program_is_only_its_end() -> None:
    bench = Bench().opened().receive(DC1)
    assert (bench.send(), bench.end()) == (EOT + DC4, (Outcome.COMPLETE, 0, 0))


@pytest.mark.parametrize("closure", list(Closure))
def test_a_closed_line_ends_a_save(closure: Closure) -> None:
    bench = Bench().saving().close(closure)
    assert (bench.end(), bench.state) == ((Outcome.FAILED, 4, 4), State.IDLE)
    closing = Bench().opened(P).receive(DC1)
    closing.hand_over()
    assert closing.close(closure).end() == (Outcome.FAILED, 0, 18)


def test_a_load_after_a_save() -> None:
    bench = Bench().opened(P).receive(DC1)
    bench.send()
    bench.asked().receive(P + EOT)
    assert (bench.take(), bench.engine.progress, bench.engine.program_ended) == (P, 18, True)


@pytest.mark.parametrize(("in_uart", "more"), [(0, 3), (1, 2), (2, 1), (3, 0), (7, 0)])
def test_3_2_what_is_in_the_uart_when_xoff_comes_is_some_of_the_three(in_uart: int, more: int) -> None:
    bench = Bench().saving()
    bench.engine.data_sent(len(bench.engine.data_to_send(in_uart)), bench.now)
    bench.receive(DC3)
    assert bench.engine.data_to_send(100) == b"0" * more
