"""The frame of Telnet: any data comes through, cut anywhere, and no stream makes it grow."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import example, given
from hypothesis import strategies as st

from tapewire.line.rfc2217.telnet import Asked, Other, Sub, TelnetDecoder, TelnetItem, Verb, ask, escape, sub

Items = st.lists(
    st.one_of(
        st.binary(min_size=1, max_size=20),
        st.builds(Asked, verb=st.sampled_from(Verb), option=st.integers(0, 255)),
        st.builds(Sub, option=st.integers(0, 254), payload=st.binary(max_size=30)),
        st.builds(Other, command=st.integers(241, 249)),
    ),
    max_size=12,
)


def encoded(item: TelnetItem) -> bytes:
    match item:
        case bytes():
            return escape(item)
        case Asked(verb=verb, option=option):
            return ask(verb, option)
        case Sub(option=option, payload=payload):
            return sub(option, payload)
        case Other(command=command):
            return bytes((0xFF, command))


def joined(items: list[TelnetItem]) -> list[TelnetItem]:
    """With plain data next to each other made one."""
    result: list[TelnetItem] = []
    for item in items:
        last = result[-1] if result else None
        if isinstance(item, bytes) and isinstance(last, bytes):
            result[-1] = last + item
        else:
            result.append(item)
    return result


def decoded(pieces: list[bytes]) -> list[TelnetItem]:
    decoder = TelnetDecoder()
    return joined([item for piece in pieces for item in decoder.feed(piece)])


@given(items=Items, cuts=st.lists(st.integers(0, 400)))
@example(items=[b"\xff\xff", Sub(option=44, payload=b"\xff\x01\xff"), b"\xff"], cuts=list(range(40)))
def test_what_is_said_is_understood_however_it_is_cut(items: list[TelnetItem], cuts: list[int]) -> None:
    stream = b"".join(encoded(item) for item in items)
    places = sorted({0, len(stream), *(min(cut, len(stream)) for cut in cuts)})
    assert decoded([stream[start:end] for start, end in pairwise(places)]) == joined(items)


@given(st.lists(st.binary(max_size=50), max_size=20))
def test_any_stream_is_survived(pieces: list[bytes]) -> None:
    decoder = TelnetDecoder()
    for piece in pieces:
        assert all(item != b"" for item in decoder.feed(piece))
    assert len(decoder._sub) <= 256


def test_a_subnegotiation_without_end_is_dropped_and_counted() -> None:
    decoder = TelnetDecoder()
    decoder.feed(b"\xff\xfa\x2c")
    for _ in range(100):
        assert decoder.feed(b"x" * 10_000) == []
    assert len(decoder._sub) <= 256
    assert decoder.feed(b"\xff\xf0N1") == [b"N1"]
    assert decoder.dropped == 1


def test_an_empty_subnegotiation_says_nothing() -> None:
    assert TelnetDecoder().feed(b"\xff\xfa\xff\xf0N1") == [b"N1"]
