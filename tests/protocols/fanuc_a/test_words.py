"""Transcripts of protocol A and expansion A, read from the characters alone."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.protocols.fanuc_a.messages import Coding, Command, Message, encode_message
from tapewire.protocols.fanuc_a.packets import Monitor, encode_monitor, encode_packet
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import Parameters, Setting, Status
from tapewire.protocols.fanuc_a.words import Words

DATA = b"G01 X1.5\n".ljust(256, b"X")
WANTED = Parameters(nb=4000, no=512, n=1)


def said(command: Command, data: bytes = b"") -> bytes:
    return encode_message(Message(command=command, data=data), Coding())


SYN, GTD = said(Command.SYN), said(Command.GTD)
SET = said(Command.SET, Setting(parameters=WANTED).encode())


def sat(parameters: Parameters) -> bytes:
    return said(Command.SAT, Status(parameters=parameters).encode())


def among_packets() -> Words:
    words = Words(Params())
    words.control(sat(Parameters()))
    words.host(SET)
    assert words.control(GTD) == ["GTD"]
    return words


def packet(number: int) -> bytes:
    return encode_packet(number, DATA, 1)


def test_set_is_shown_against_the_last_sat() -> None:
    words = Words(Params())
    words.control(sat(Parameters()))
    assert words.host(SET) == ["SET Nb=4000 No=512 n=1"]
    words.control(sat(Parameters(nb=4000)))
    assert words.host(SET) == ["SET No=512 n=1"], "the control has not taken it"
    words.control(sat(WANTED))
    assert words.host(SET) == ["SET"]
    words.control(sat(Parameters()))
    assert words.host(SET) == ["SET Nb=4000 No=512 n=1"], "it has been initialised anew"


def test_a_control_that_does_not_take_n_gets_no_packets() -> None:
    words = Words(Params())
    words.host(SET)
    words.control(sat(Parameters()) + GTD)
    assert words.host(said(Command.DAT, b"X")) == ["DAT", b"X"]


def test_packets_go_on_behind_the_end_packet() -> None:
    words = among_packets()
    assert words.host(packet(0x30) + packet(0xFF)) == ["packet 30", DATA, "packet FF", DATA]
    assert words.control(encode_monitor(Monitor.NAK, number=0x31)) == ["NAK 31"]
    assert words.host(packet(0xFF)) == ["packet FF", DATA]
    assert words.control(sat(WANTED))[0]
    assert words.host(said(Command.SET)) == ["SET"]


@pytest.mark.parametrize("before", range(0, 260, 13))
@given(cuts=st.lists(st.integers(0, 270), max_size=3))
def test_syn_of_the_host_among_packets(before: int, cuts: list[int]) -> None:
    """To a control that lost a character of the end packet, or from a host that begins anew."""
    words, stream = among_packets(), packet(0xFF)[:before] + SYN + packet(0xFF)
    places = sorted({0, len(stream), *cuts})
    heard = [word for start, end in itertools.pairwise(places) for word in words.host(stream[start:end])]
    cut_off = [f"({before} characters of a packet)"] if before else []
    assert heard[-3 - bool(cut_off) :] == [*cut_off, "SYN", "packet FF", DATA]


@given(
    st.lists(st.tuples(st.booleans(), st.sampled_from([SYN, GTD, SET, packet(0x30), packet(0xFF), b"\x15", b"\r"]))),
    st.binary(max_size=20),
)
def test_anything_can_be_put_into_words(stream: list[tuple[bool, bytes]], noise: bytes) -> None:
    words = Words(Params())
    for by_host, data in [*stream, (True, noise), (False, noise)]:
        (words.host if by_host else words.control)(data)
