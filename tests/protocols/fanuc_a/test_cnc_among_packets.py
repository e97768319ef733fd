"""The control's end of expansion protocol A: messages where packets are awaited. Chapter 5 has none."""

from __future__ import annotations

import pytest

from tapewire.engine import Outcome
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_a.packets import encode_packet
from tapewire.protocols.fanuc_a.params import AmongPackets, GtdAnswers, Params
from tests.protocols.fanuc_a.cnc_bench import PROGRAM, quick
from tests.protocols.fanuc_a.test_cnc_packets import C, good, last, packets

HEARS_RTY, HEARS_SYN = (quick(among_packets=among) for among in (AmongPackets.RTY, AmongPackets.SYN))


@pytest.mark.parametrize("command", Command)
def test_5_1_nothing_but_packets_counts_between_gtd_and_the_end_packet(command: Command) -> None:
    for begun in (b"", good(0)):
        bench = packets().receive(begun).answer(command)
        assert bench.silent(1)
        assert bench.state is State.PACKETS
        assert bench.run(20).alarms == ["SR944"]


@pytest.mark.parametrize("params", [HEARS_RTY, HEARS_SYN])
def test_a_host_that_did_not_get_the_gtd_may_say_rty(params: Params) -> None:
    bench = packets(params).answer(C.RTY, b"1")
    assert bench.next() is C.GTD
    bench.receive(good(0))
    assert bench.engine.buffered == 256


def test_rty_behind_the_first_packet_is_not_understood() -> None:
    bench = packets(HEARS_SYN).receive(good(0)).answer(C.RTY, b"1")
    assert bench.silent(1)


def test_syn_at_the_place_of_a_packet_begins_anew() -> None:
    bench = packets(HEARS_SYN).receive(good(0)).answer(C.SYN)
    assert bench.next() is C.SYN
    assert bench.ended_as(Outcome.FAILED, "SYN")
    assert packets(HEARS_RTY).receive(good(0)).answer(C.SYN).silent(1)


def test_by_default_a_message_in_place_of_packets_is_not_understood() -> None:
    bench = packets().answer(C.WAT)
    assert bench.run(20.1).alarms == ["SR944"]


MESSAGES = quick(gtd_answers=GtdAnswers.MESSAGES)


def test_with_messages_wat_makes_gtd_come_again() -> None:
    bench = packets(MESSAGES).answer(C.WAT)
    assert bench.silent(4.9)
    assert bench.next(0.2) is C.GTD
    bench.receive(last(PROGRAM))
    assert bench.take() == PROGRAM


def test_with_messages_eod_rdi_and_sdo_are_understood() -> None:
    bench = packets(MESSAGES).answer(C.SDO, b"11")
    assert bench.engine.do == 0x11
    assert bench.next() is C.GTD
    bench.answer(C.RDI)
    assert bench.next() is C.SDI
    bench.receive(good(0))
    assert bench.engine.buffered == 256, "the packets are the answer that is still owed"
    bench = packets(MESSAGES).answer(C.EOD)
    assert bench.next(6) is C.SAT


def test_a_packet_that_begins_like_a_message_is_a_packet() -> None:
    data = (b"\nCGTD\r" + b"X" * 300)[:256]
    bench = packets(MESSAGES).receive(encode_packet(0x30, data, 1))
    assert bench.take() == data
