"""What a recorded dialogue of protocol B breaks, and what it does not."""

from __future__ import annotations

import pytest

from tapewire.protocols.fanuc_b.listener import Listener
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, PROTOCOL_B, Limits, Params
from tapewire.protocols.listening import Word
from tapewire.protocols.settings import End


def hear(listener: Listener, *said: tuple[End, Word]) -> list[str]:
    return [wrong for who, word in said for wrong in listener.heard(who, word, 0, 0)]


def control(*words: Word) -> list[tuple[End, Word]]:
    return [(End.CONTROL, word) for word in words]


def host(*words: Word) -> list[tuple[End, Word]]:
    return [(End.HOST, word) for word in words]


@pytest.mark.parametrize(("limits", "allowed"), [(PROTOCOL_B, 511), (EXPANSION_B, 1280)])
def test_characters_after_dc3_are_counted_to_the_limit(limits: Limits, allowed: int) -> None:
    listener = Listener(Params(limits=limits))
    begin = [*control("DC1"), *host(bytes(9000)), *control("DC3")]
    assert hear(listener, *begin, *host(bytes(allowed - 1), b"x")) == []
    (wrong,) = hear(listener, *host(b"y", b"z"))
    assert f"more than {allowed} characters after DC3" in wrong
    assert hear(listener, *control("DC1"), *host(bytes(9000))) == []
    assert listener.summary() == [f"DC3 once, at most {allowed + 2} characters after it; {allowed} are allowed"]


def test_a_capture_may_begin_in_the_middle() -> None:
    assert hear(Listener(Params()), *host(bytes(9000)), *control("DC3", "DC1")) == []


def test_a_punch_out_and_what_comes_after_its_pause() -> None:
    listener = Listener(Params())
    said = [*control("DC2", bytes(100)), *host("DC3"), *control(bytes(7)), *host("DC1"), *control(bytes(50), "DC4")]
    assert hear(listener, *said) == []
    assert listener.summary() == ["at most 7 characters of the punch-out came after the host's DC3"]
    assert listener.evidence > 0


def test_who_speaks_out_of_turn() -> None:
    listener = Listener(Params())
    (wrong,) = hear(listener, *control(b"G0", b"X1"))
    assert "no codes" in wrong
    (wrong,) = hear(listener, *control("DC4"))
    assert "no DC2 before it" in wrong
    assert listener.evidence < 0
