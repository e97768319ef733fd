"""Both ends of RFC 2217 without a line: what they agree on, what they refuse, and what they say of the port."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import LineFault, SignalsIn, SignalsOut
from tapewire.line.rfc2217.ends import Client, Heard, PortSettings, Purged, Server
from tapewire.line.rfc2217.telnet import Option, Verb, ask, sub
from tapewire.line.transport import Fault

PORT = PortSettings(baud=9600, data_bits=8, parity=1, stopbits=2)
COM = Option.COM_PORT
ON = SignalsIn(cts=True, dsr=True, cd=True)


def talk(client: Client, server: Server) -> tuple[list[Heard], list[Heard]]:
    """Until both are silent: what each has heard."""
    at_client: list[Heard] = []
    at_server: list[Heard] = []
    for _ in range(20):
        to_server, to_client = client.take_outgoing(), server.take_outgoing()
        if not to_server and not to_client:
            return at_client, at_server
        at_server += server.hear(to_server)
        at_client += client.hear(to_client)
    raise AssertionError("they never stop")


def agreed(client: PortSettings = PORT, server: PortSettings = PORT) -> tuple[Client, Server]:
    ends = Client(client), Server(server)
    for end in ends:
        end.start()
    talk(*ends)
    return ends


def test_two_ends_agree() -> None:
    client, server = agreed()
    assert (client.is_ready, server.is_ready, client.trouble) == (True, True, None)


@pytest.mark.parametrize(
    ("has", "said"),
    [
        (PortSettings(baud=115200, data_bits=8, parity=1, stopbits=2), "asked for 9600 baud it says 115200"),
        (PortSettings(baud=9600, data_bits=7, parity=1, stopbits=2), "asked for 8 data bits it says 7 data bits"),
        (PortSettings(baud=9600, data_bits=8, parity=3, stopbits=2), "asked for no parity it says even parity"),
        (PortSettings(baud=9600, data_bits=8, parity=1, stopbits=1), "asked for 2 stop bits it says 1 stop bits"),
    ],
)
def test_what_reads_back_differently_is_named(has: PortSettings, said: str) -> None:
    client, _ = agreed(server=has)
    assert not client.is_ready
    assert client.trouble is not None
    assert said in client.trouble


def test_a_rate_within_two_percent_is_the_rate() -> None:
    client, _ = agreed(server=PortSettings(baud=9615, data_bits=8, parity=1, stopbits=2))
    assert client.is_ready


def test_control_lines_both_ways() -> None:
    client, server = agreed()
    client.drive(None, SignalsOut(rts=True, dtr=True))
    server.drive(SignalsOut(rts=False, dtr=True))
    assert talk(client, server) == ([SignalsIn(cts=False, dsr=True, cd=True)], [ON])
    client.drive(SignalsOut(rts=True, dtr=True), SignalsOut(rts=True, dtr=False))
    assert talk(client, server) == ([], [SignalsIn(cts=True, dsr=False, cd=False)])


def test_control_lines_set_before_anybody_came_are_told_then() -> None:
    client, server = Client(PORT), Server(PORT)
    server.drive(SignalsOut(rts=True, dtr=False))
    client.start()
    server.start()
    at_client, _ = talk(client, server)
    assert at_client[-1] == SignalsIn(cts=True, dsr=False, cd=False)


@pytest.mark.parametrize("fault", list(LineFault))
def test_damage_at_the_port_is_told(fault: LineFault) -> None:
    client, server = agreed()
    server.say_fault(fault)
    assert talk(client, server) == ([Fault(fault=fault)], [])


def test_a_break_is_told_once_and_by_either_word() -> None:
    _, server = agreed()
    broken = [Fault(fault=LineFault.BREAK)]
    assert server.hear(sub(COM, b"\x05\x05")) == broken
    assert server.hear(sub(COM, b"\x05\x05")) == []
    assert server.hear(sub(COM, b"\x05\x06") + sub(COM, b"\x05\x05")) == broken
    assert server.hear(b"\xff\xf3") == broken


def test_purging_and_suspending() -> None:
    client, server = agreed()
    client.purge()
    assert talk(client, server) == ([], [Purged()])
    client.hear(sub(COM, b"\x6c"))
    assert client.is_suspended
    client.hear(sub(COM, b"\x6d"))
    assert not client.is_suspended
    server.hear(sub(COM, b"\x08"))
    assert server.is_suspended


def test_a_probe_is_answered() -> None:
    client, server = agreed()
    client.probe()
    server.hear(client.take_outgoing())
    assert server.take_outgoing() == sub(COM, b"\x65" + (9600).to_bytes(4, "big"))


def test_who_does_not_speak_of_serial_ports() -> None:
    client = Client(PORT)
    client.start()
    assert "does not speak RFC 2217" in client.missing
    client.hear(ask(Verb.DONT, COM))
    assert client.trouble is not None
    half = Client(PORT)
    half.start()
    half.hear(ask(Verb.DO, COM))
    assert "SET-BAUDRATE" in half.missing
    assert not half.is_ready


@pytest.mark.parametrize("verb", [Verb.DONT, Verb.WONT])
def test_binary_refused_is_no_serial_line(verb: Verb) -> None:
    client = Client(PORT)
    client.start()
    client.hear(ask(verb, Option.BINARY))
    assert client.trouble is not None
    assert "binary" in client.trouble


@given(data=st.binary(max_size=200), cuts=st.lists(st.integers(0, 400)))
def test_characters_come_through_however_they_are_cut(data: bytes, cuts: list[int]) -> None:
    client, server = agreed()
    stream = client.encode(data)
    places = sorted({0, len(stream), *(min(cut, len(stream)) for cut in cuts)})
    heard = [item for start, end in pairwise(places) for item in server.hear(stream[start:end])]
    assert b"".join(item for item in heard if isinstance(item, bytes)) == data


@given(st.lists(st.binary(max_size=60), max_size=30))
def test_any_stream_is_survived_by_both_ends(pieces: list[bytes]) -> None:
    for end in (*agreed(), Client(PORT), Server(PORT)):
        for piece in pieces:
            end.hear(piece)
        assert len(end.take_outgoing()) <= 8192


def test_who_asks_without_end_is_given_up() -> None:
    _, server = agreed()
    server.hear(sub(COM, b"\x01\0\0\0\0") * 2000)
    assert server.trouble is not None
    assert len(server.take_outgoing()) <= 8192


@given(st.lists(st.tuples(st.sampled_from(Verb), st.integers(0, 255)), max_size=30))
def test_two_ends_never_thank_each_other_for_ever(asked: list[tuple[Verb, int]]) -> None:
    client, server = agreed()
    server.hear(b"".join(ask(verb, option) for verb, option in asked))
    talk(client, server)


def test_other_words_are_answered_or_ignored() -> None:
    client, server = agreed()
    assert server.hear(sub(COM, b"\x00")) == []
    assert b"Tapewire" in server.take_outgoing()
    for value, answer in ((0, 1), (4, 6), (7, 8), (10, 11), (1, 1), (3, 1), (200, 1)):
        server.hear(sub(COM, bytes((5, value))))
        assert server.take_outgoing() == sub(COM, bytes((105, answer)))
    server.hear(sub(COM, b"\x0a\x1e") + sub(COM, b"\x63x") + b"\xff\xf6")
    assert server.take_outgoing() == sub(COM, b"\x6e\x1e") + b"\xff\xf1"
    assert client.hear(sub(COM, b"\xc8x") + sub(99, b"x") + sub(COM, b"")) == []


def test_a_client_that_takes_its_offer_for_granted_is_served_all_the_same() -> None:
    """pyserial never says WILL COM-PORT when our DO comes before it has said so."""
    server = Server(PortSettings(baud=9600, data_bits=8, parity=1, stopbits=2))
    server.start()
    server.drive(SignalsOut())
    assert not server.is_ready
    server.hear(sub(44, b"\x01\x00\x00\x25\x80"))
    assert server.is_ready
    assert sub(44, b"\x6b\xb0") in server.take_outgoing()
