"""What a recorded dialogue of REMOTE LOAD or DNC LINK breaks, and what it does not."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.protocols.bridgeport.listener import Listener
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Lrc, lrc_of
from tapewire.protocols.listening import Word
from tapewire.protocols.settings import End

ETB = 0x17


def hear(listener: Listener, who: End, *words: Word) -> list[str]:
    return [wrong for word in words for wrong in listener.heard(who, word, 0, 0)]


def record(text: bytes, lrc: Lrc, *, off_by: int = 0) -> tuple[Word, ...]:
    return text, "ETB", f"LRC={(lrc_of(text, ETB, lrc) + off_by) & 0x7F:02X}"


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
def test_the_way_the_check_characters_fit_is_found(lrc: Lrc) -> None:
    listener = Listener(Params())
    for number in range(5):
        assert hear(listener, End.HOST, *record(b"N%d G1 X%d.25\r\n" % (number, 7 * number), lrc)) == []
        hear(listener, End.CONTROL, "ACK")
    assert listener.summary() == [f"5 records, 0 refused by NAK; lrc={lrc} fits 5 of them"]
    assert listener.evidence >= 20


@given(st.sampled_from(LRC_CANDIDATES), st.integers(1, 0x7F))
def test_a_wrong_check_character_is_found(lrc: Lrc, off_by: int) -> None:
    listener = Listener(Params())
    for number in range(6):
        hear(listener, End.HOST, *record(b"N%d G1 X%d.25\r\n" % (number, 9 * number), lrc))
    (wrong,) = hear(listener, End.HOST, *record(b"N9 X1\r\n", lrc, off_by=off_by))
    assert "does not fit its record" in wrong or "by no known way" in wrong


def test_xoff_is_obeyed_within_three_characters() -> None:
    listener = Listener(Params())
    hear(listener, End.CONTROL, "DC1")
    assert hear(listener, End.HOST, b"G0") == []
    hear(listener, End.CONTROL, "DC3")
    assert hear(listener, End.HOST, b"X1", b"Y") == []
    assert hear(listener, End.HOST, b"Z", b"Z") == ["more than 3 characters after XOFF (3.2)"]
    hear(listener, End.CONTROL, "DC1")
    assert hear(listener, End.HOST, bytes(50)) == []
    assert listener.summary() == ["at most 5 characters after XOFF, 3 are allowed (3.2)"]


def test_texts_and_records_that_are_too_long() -> None:
    listener = Listener(Params())
    assert hear(listener, End.HOST, bytes(12000), "EOT") == []
    assert hear(listener, End.HOST, bytes(12001), "EOT") == [
        "a text of more than 12000 characters in REMOTE LOAD (2.1.1)"
    ]
    assert "a record of more than 256 characters (2.2.3)" in hear(listener, End.HOST, *record(bytes(257), Lrc.XOR7))


def test_a_name_speaks_for_it() -> None:
    listener = Listener(Params())
    hear(listener, End.CONTROL, "DC2", b"12", b"34;L", "DC4")
    assert listener.evidence == 3
    hear(listener, End.CONTROL, "DC2", b"a program is longer", "DC4")
    assert listener.evidence == 3
