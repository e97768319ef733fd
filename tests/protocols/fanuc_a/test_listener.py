"""What a recorded dialogue of protocol A breaks, and what it does not."""

from __future__ import annotations

from tapewire.engine import SECOND
from tapewire.protocols.fanuc_a.listener import Listener
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.listening import Word
from tapewire.protocols.settings import End

HOST, CONTROL = End.HOST, End.CONTROL


def hear(*said: tuple[End, Word, float], listener: Listener | None = None) -> list[str]:
    listener = listener or Listener(Params.for_protocol_a({}, HOST))
    wrong = []
    for who, word, at_s in said:
        wrong += listener.heard(who, word, round(at_s * SECOND), round(at_s * SECOND))
    return wrong


def test_a_usual_dialogue_breaks_nothing() -> None:
    said: list[tuple[End, Word, float]] = [
        *((CONTROL, "SYN", 0), (HOST, "SYN", 0), (CONTROL, "RDY", 1), (HOST, "RDY", 1)),
        *((CONTROL, "SAT reset, 0 stored", 2), (HOST, "SET Nb=4000 To=30", 2), (CONTROL, "GTD", 3)),
        *((HOST, "RDI", 3), (CONTROL, "SDI 00", 4), (HOST, "DAT", 33), (HOST, b"G0", 33), (CONTROL, "GTD", 34)),
        *((HOST, "RTY 1", 35), (CONTROL, "GTD", 36), (HOST, "EOD", 36), (CONTROL, "RST", 37), (HOST, "ARS", 37)),
    ]
    listener = Listener(Params.for_protocol_a({}, HOST))
    assert hear(*said, listener=listener) == []
    assert listener.summary()[0] == "16 messages and packets with a right sum, 0 unreadable"
    assert listener.evidence > 10


def test_an_answer_that_is_none() -> None:
    assert hear((CONTROL, "SAT", 0), (HOST, "DAT", 0)) == ["DAT is no answer to SAT (4.4.1)"]
    assert hear((CONTROL, "DAT", 0)) == ["DAT is a word of the host (4.4.1)"]
    assert hear((HOST, "GTD", 0)) == ["GTD is a word of the control (4.4.1)"]


def test_an_answer_that_is_late_or_missing() -> None:
    assert hear((CONTROL, "GTD", 0), (HOST, "DAT", 20.5)) == ["the answer to GTD came after 20.5 s, To is 20 s"]
    later: list[tuple[End, Word, float]] = [(CONTROL, "SAT", 0), (HOST, "SET To=3", 0), (CONTROL, "GTD", 1)]
    assert hear(*later, (HOST, "DAT", 4.5)) == ["the answer to GTD came after 3.5 s, To is 3 s"]
    assert hear(*later, (CONTROL, "SAT", 9)) == ["GTD got no answer in 8.0 s (To is 3 s)"]


def test_what_is_unreadable_is_told_and_asked_again() -> None:
    listener = Listener(Params.for_protocol_a({}, HOST))
    wrong = hear((CONTROL, "GTD", 0), (HOST, "(checksum error)", 1), (CONTROL, "RTY 1", 1), listener=listener)
    assert wrong == ["the host said something unreadable: checksum error"]
    assert hear((HOST, "DAT", 2), listener=listener) == []


def test_packets_speak_for_the_expansion() -> None:
    said: list[tuple[End, Word, float]] = [(CONTROL, "GTD", 0), (HOST, "packet 30", 0), (CONTROL, "NAK 30", 1)]
    evidence = []
    for params in (Params.for_protocol_a({}, HOST), Params.for_expansion_a({}, HOST)):
        listener = Listener(params)
        assert hear(*said, listener=listener) == []
        evidence.append(listener.evidence)
    assert evidence[1] > evidence[0]
