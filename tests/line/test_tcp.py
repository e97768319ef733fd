"""How a TCP line ends, and what a network that stalls does to it."""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import termios
import time
from collections.abc import Iterator

import pytest

from tapewire.engine import SECOND, Closure
from tapewire.line.pacing import character_time
from tapewire.line.tcp import ACKNOWLEDGED_LATE, TcpLine
from tapewire.line.transport import Closed
from tests.line.helpers import Clock, Seen, read_until_closed, settings

Ends = tuple[TcpLine, socket.socket]


@pytest.fixture
def ends() -> Iterator[Ends]:
    """A line and a bare socket at its other end."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far, _ = server.accept()
    line = TcpLine(near, settings())
    with far:
        yield line, far
    line.close(0)


def test_an_orderly_end(ends: Ends) -> None:
    line, far = ends
    far.sendall(b"all")
    far.close()
    seen = read_until_closed(line, Clock())
    assert seen.data == b"all"
    assert seen.items[-1] == Closed(closure=Closure.ORDERLY, reason="the other side closed the connection")


def _reset(far: socket.socket) -> None:
    far.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    far.close()


def test_a_reset_is_a_loss(ends: Ends) -> None:
    line, far = ends
    _reset(far)
    (end,) = read_until_closed(line, Clock()).ends
    assert end.closure is Closure.LOST
    assert "reset" in end.reason


def test_a_write_that_finds_the_line_gone_is_a_loss_told_by_the_next_read(ends: Ends) -> None:
    line, far = ends
    clock = Clock()
    line.read(clock.now)
    _reset(far)
    for now in clock.looks():
        if line.room(now):
            line.write(b"into the void", now)
        if line.next_deadline() == now:
            break
    seen = Seen()
    seen.read(line, clock.now)
    assert [end.closure for end in seen.ends] == [Closure.LOST]
    assert line.read(clock.advance()) == []
    deadline = line.next_deadline()
    assert deadline is None or deadline > clock.now


def test_what_was_said_before_a_failed_write_is_still_heard(ends: Ends) -> None:
    line, far = ends
    clock = Clock()
    far.sendall(b"stop")
    far.shutdown(socket.SHUT_WR)
    seen = read_until_closed(line, clock)
    assert seen.data == b"stop"
    assert line.room(clock.now) == 0


def test_handed_over_data_survives_a_close_over_unread_input(ends: Ends) -> None:
    line, far = ends
    far.sendall(b"nobody reads this")
    line.room(SECOND)
    line.write(b"the last words", SECOND)
    line.close(SECOND)
    far.settimeout(5)
    assert far.recv(100) == b"the last words"
    assert far.recv(100) == b""
    # A reset behind it would make other systems throw away what they have not read yet.
    assert far.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0


def test_a_peer_that_takes_nothing_stops_the_line_within_a_window(ends: Ends) -> None:
    """The kernels hold some; from there on nothing is acknowledged, and the clock alone makes no room."""
    line, far = ends
    far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    clock, sent, idle = Clock(), 0, 0
    while idle < 200 and sent < 50_000_000:
        now = clock.advance(SECOND)
        line.read(now)
        room = line.room(now)
        idle = 0 if room else idle + 1
        if room:
            line.write(bytes(room), now)
            sent += room
    assert sent < 50_000_000
    assert line.watched is not None
    (unacknowledged,) = struct.unpack("i", fcntl.ioctl(line.watched, termios.TIOCOUTQ, bytes(4)))
    patience = line.stop_distance.characters - 216
    assert patience == ACKNOWLEDGED_LATE // character_time(86400)
    assert patience < unacknowledged <= 216 + patience
    assert line.in_flight(clock.now) == unacknowledged - patience
    assert line.on_its_way(clock.now) == unacknowledged
    assert line.next_deadline() is not None


def _stalled(line: TcpLine, far: socket.socket) -> tuple[int, int]:
    """Write until nothing is acknowledged any more; the moment and how many characters were handed over."""
    far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
    clock, sent, idle = Clock(), 0, 0
    while idle < 6:
        now = clock.advance(SECOND)
        if room := line.room(now):
            line.write(bytes(room), now)
            sent += room
            idle = 0
        else:
            time.sleep(0.05)  # acknowledgements may take 40 ms
            idle += 1
    return clock.now, sent


def _read_all(far: socket.socket) -> tuple[int, bool]:
    """How many bytes still arrive, and whether the connection was reset behind them."""
    count = 0
    far.settimeout(5)
    try:
        while data := far.recv(65536):
            count += len(data)
    except ConnectionResetError:
        return count, True
    return count, False


def test_what_nobody_acknowledged_never_arrives_after_the_close(ends: Ends) -> None:
    line, far = ends
    now, sent = _stalled(line, far)
    line.close(now)
    arrived, was_reset = _read_all(far)
    assert was_reset
    assert arrived < sent


def test_the_last_words_have_half_a_second_to_arrive(ends: Ends) -> None:
    """They are in order when they were only just written, and acknowledgements may take their time."""
    line, far = ends
    now, sent = _stalled(line, far)
    line._written = now
    line.close(now + SECOND // 4)
    assert _read_all(far) == (sent, False)


def test_a_peer_that_is_gone_without_a_word_is_noticed_within_a_minute(ends: Ends) -> None:
    line, _ = ends
    assert line.watched is not None
    with socket.socket(fileno=os.dup(line.watched)) as same:
        assert same.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        idle, interval, count = (
            same.getsockopt(socket.IPPROTO_TCP, option)
            for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
        )
        assert idle + interval * count == 60
        assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 60_000


def test_there_is_no_delay_for_small_packets_and_no_guarantee(ends: Ends) -> None:
    line, _ = ends
    assert line.watched is not None
    with socket.socket(fileno=os.dup(line.watched)) as same:
        assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
    assert not line.stop_distance.guaranteed
    assert line.stop_distance.characters == 216 + 392, "a window, and what 50 ms of line may leave unacknowledged"
