"""What every line keeps, whatever it is made of. Moments are handed in; nothing here depends on real speed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, SignalsIn
from tapewire.line.pacing import character_time
from tapewire.line.transport import Closed, Transport
from tests.line.helpers import (
    COUNTING_KINDS,
    KINDS,
    REAL_KINDS,
    Clock,
    Seen,
    hand_over,
    open_pair,
    read_until_closed,
    send_all,
    settle,
)

ALL_BYTES = bytes(range(256))
MEMORY_KINDS = ("simulated", "simulated, faulty")

Pair = tuple[Transport, Transport]


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    assert isinstance(request.param, str)
    return request.param


@pytest.fixture
def pair(kind: str) -> Iterator[Pair]:
    with open_pair(kind) as ends:
        yield ends


def test_all_bytes_arrive_unchanged_both_ways(pair: Pair) -> None:
    near, far = pair
    clock = Clock()
    assert send_all(near, far, ALL_BYTES * 3, clock).data == ALL_BYTES * 3
    assert send_all(far, near, ALL_BYTES[::-1] * 3, clock).data == ALL_BYTES[::-1] * 3


def _chunks_arrive(kind: str, window: int, chunks: list[bytes]) -> None:
    clock, seen = Clock(), Seen()
    with open_pair(kind, window=window, far_window=window) as (near, far):
        for chunk in chunks:
            seen.items += send_all(near, far, chunk, clock).items
        assert seen.data == b"".join(chunks)


Chunks = st.lists(st.binary(min_size=1, max_size=300), max_size=6)
Windows = st.integers(1, 300)


@given(kind=st.sampled_from(MEMORY_KINDS), window=Windows, chunks=Chunks)
def test_chunks_of_any_size_arrive_in_order_on_a_simulated_cable(kind: str, window: int, chunks: list[bytes]) -> None:
    _chunks_arrive(kind, window, chunks)


@pytest.mark.parametrize("kind", REAL_KINDS)
@settings(max_examples=6)
@given(window=Windows, chunks=Chunks)
def test_chunks_of_any_size_arrive_in_order(kind: str, window: int, chunks: list[bytes]) -> None:
    _chunks_arrive(kind, window, chunks)


Steps = st.lists(st.tuples(st.integers(0, 30), st.integers(0, 400)), min_size=1, max_size=40)
"""(milliseconds that pass, characters there are to send)."""


def _keeps_the_window(kind: str, window: int, steps: list[tuple[int, int]]) -> None:
    clock = Clock()
    with open_pair(kind, window=window) as (near, far):
        for passed, wanted in steps:
            now = clock.advance(passed * MILLISECOND)
            near.read(now)
            far.read(now)
            room = near.room(now)
            assert 0 <= room <= window - near.in_flight(now)
            if count := min(room, wanted):
                near.write(bytes(count), now)
                assert near.in_flight(now) >= count
            assert near.in_flight(now) <= window
            for end in (near, far):
                deadline = end.next_deadline()
                assert deadline is None or deadline >= now
        for now in clock.looks():
            far.read(now)
            if not near.in_flight(now):
                break
        near.read(clock.advance(SECOND))
        far.read(clock.now)
        assert near.room(clock.now) == window


@given(kind=st.sampled_from(MEMORY_KINDS), window=Windows, steps=Steps)
def test_window_is_kept_on_a_simulated_cable(kind: str, window: int, steps: list[tuple[int, int]]) -> None:
    _keeps_the_window(kind, window, steps)


@pytest.mark.parametrize("kind", REAL_KINDS)
@settings(max_examples=6)
@given(window=Windows, steps=Steps)
def test_window_is_kept(kind: str, window: int, steps: list[tuple[int, int]]) -> None:
    _keeps_the_window(kind, window, steps)


def test_what_was_handed_over_leaves_no_faster_than_the_line(pair: Pair) -> None:
    near, _ = pair
    near.read(SECOND)
    room = near.room(SECOND)
    near.write(bytes(room), SECOND)
    half = SECOND + room // 2 * character_time(86400)
    assert near.in_flight(half) >= room - room // 2
    assert near.stop_distance.characters >= room


def test_whoever_waits_for_room_is_told_when(pair: Pair) -> None:
    near, far = pair
    clock = Clock()
    near.read(clock.now)
    near.write(bytes(near.room(clock.now)), clock.now)
    assert near.room(clock.now) == 0
    for _ in range(1000):
        deadline = near.next_deadline()
        assert deadline is not None
        clock.now = max(clock.now, deadline)
        near.read(clock.now)
        far.read(clock.now)
        if near.room(clock.now):
            break
    assert near.room(clock.now) > 0


@given(
    kind=st.sampled_from(MEMORY_KINDS),
    window=st.integers(17, 300),
    passed=st.integers(0, 60 * MILLISECOND),
    count=st.integers(1, 300),
)
def test_discard_tells_what_never_arrives_on_a_simulated_cable(kind: str, window: int, passed: int, count: int) -> None:
    clock = Clock()
    data = (ALL_BYTES * 2)[: min(window, count)]
    with open_pair(kind, window=window) as (near, far):
        near.read(clock.now)
        hand_over(near, data, clock.now)
        seen = Seen()
        seen.read(far, clock.advance(passed))
        recalled = near.discard(clock.now)
        seen.read(far, clock.advance(SECOND))
        assert seen.data == data[: len(data) - recalled]
        assert near.in_flight(clock.now) == 0
        assert near.discard(clock.now) == 0


@pytest.mark.parametrize("kind", COUNTING_KINDS)
def test_discard_tells_what_never_arrives_when_the_kernel_took_only_a_part(kind: str) -> None:
    size = 16_000_000 if kind.startswith("tcp") else 100_000
    data = ALL_BYTES * (size // 256)
    clock, seen = Clock(), Seen()
    with open_pair(kind, baud=4_000_000, window=size) as (near, far):
        near.read(clock.now)
        hand_over(near, data, clock.now)
        recalled = near.discard(clock.now)
        assert 0 < recalled < len(data)
        expected = data[: len(data) - recalled]
        for now in clock.looks():
            near.read(now)
            seen.read(far, now)
            if sum(len(item) for item in seen.items if isinstance(item, bytes)) >= len(expected):
                break
        seen.read(far, clock.advance())
        assert seen.data == expected


@pytest.mark.parametrize("kind", COUNTING_KINDS)
def test_what_the_kernel_took_is_not_said_to_be_called_back(kind: str) -> None:
    clock, seen = Clock(), Seen()
    with open_pair(kind) as (near, far):
        near.read(clock.now)
        hand_over(near, ALL_BYTES[:200], clock.now)
        assert near.discard(clock.now) == 0
        for now in clock.looks():
            seen.read(far, now)
            if len(seen.data) == 200:
                break
        assert seen.data == ALL_BYTES[:200]


def test_closing_is_seen_once_and_behind_everything_else(pair: Pair) -> None:
    near, far = pair
    clock = Clock()
    seen = send_all(near, far, b"last words", clock)
    settle(near, clock)
    near.close(clock.now)
    seen.items += read_until_closed(far, clock).items
    assert isinstance(seen.items[-1], Closed)
    assert seen.data == b"last words"
    for _ in range(5):
        assert far.read(clock.advance(SECOND)) == []
    assert far.room(clock.now) == 0


def test_a_closed_end_is_harmless(pair: Pair) -> None:
    near, far = pair
    clock = Clock()
    near.read(clock.now)
    near.close(clock.advance())
    near.close(clock.advance())
    for _ in range(3):
        assert not any(isinstance(item, bytes | Closed) for item in near.read(clock.advance()))
    assert near.room(clock.now) == 0
    assert near.discard(clock.now) == 0
    far.close(clock.advance())


def test_control_lines_are_told_once_or_never(kind: str, pair: Pair) -> None:
    near, far = pair
    clock, seen = Clock(), Seen()
    near_first = near.read(clock.now)
    for _ in range(20):
        seen.read(near, clock.advance(20 * MILLISECOND))
        far.read(clock.now)
    told = [item for item in near_first if isinstance(item, SignalsIn)]
    assert told[-1:] == ([SignalsIn()] if kind.startswith("simulated") else [])
    assert not any(isinstance(item, SignalsIn) for item in seen.items)


@pytest.mark.parametrize("baud", [19200, 86400])
def test_paced_reception_is_never_faster_than_the_line(kind: str, baud: int) -> None:
    character, data = character_time(baud), ALL_BYTES * 8
    clock, seen = Clock(), Seen()
    with open_pair(kind, baud=baud, far_window=len(data), paced=True) as (near, far):
        far.read(clock.now)
        near.read(clock.now)
        begun = clock.now
        hand_over(far, data, begun)
        for now in clock.looks(700_000):
            seen.read(near, now)
            assert len(seen.data) <= (now - begun) // character
            if len(seen.data) == len(data):
                break
        assert seen.data == data
        assert clock.now - begun >= len(data) * character


def test_paced_reception_is_told_when_characters_are_due(kind: str) -> None:
    data = ALL_BYTES * 8
    clock, seen = Clock(), Seen()
    with open_pair(kind, far_window=len(data), paced=True) as (near, far):
        far.read(clock.now)
        near.read(clock.now)
        hand_over(far, data, clock.now)
        for _ in clock.looks(0):
            seen.read(near, clock.now)
            if len(seen.data) == len(data):
                break
            deadline = near.next_deadline()
            if deadline is not None:
                assert deadline >= clock.now
                clock.now = deadline
        assert seen.data == data


@pytest.mark.parametrize("kind", REAL_KINDS)
def test_paced_reception_tells_the_end_behind_the_last_character(kind: str) -> None:
    data = ALL_BYTES * 4
    clock = Clock()
    with open_pair(kind, far_window=len(data), paced=True) as (near, far):
        far.read(clock.now)
        hand_over(far, data, clock.now)
        first = Seen()
        for later, _ in enumerate(clock.looks(0), start=SECOND):
            first.read(near, clock.now)
            if not near.next_deadline():
                continue
            if not far.in_flight(clock.now + later):
                break
        far.close(clock.now)
        seen = read_until_closed(near, clock, 100_000)
        assert isinstance(seen.items[-1], Closed)
        assert first.data + seen.data == data
