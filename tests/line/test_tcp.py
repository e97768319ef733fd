"""How a TCP line ends, and what a network that stalls does to it."""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import termios
from collections.abc import Iterator

import pytest

from tapewire.engine import SECOND, Closure
from tapewire.line.tcp import TcpLine
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
    assert 108 < unacknowledged <= 216
    assert line.in_flight(clock.now) == unacknowledged
    assert line.next_deadline() is not None


def test_there_is_no_delay_for_small_packets_and_no_guarantee(ends: Ends) -> None:
    line, _ = ends
    assert line.watched is not None
    with socket.socket(fileno=os.dup(line.watched)) as same:
        assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 1
    assert not line.stop_distance.guaranteed
    assert line.stop_distance.characters == 216
