"""A line over TCP: the serial bytes and nothing else, to a serial server or to another Tapewire.

There are no control lines, so none is ever reported. Nothing that was handed over can be called back once the kernel
has it. What has not been acknowledged counts as in flight: a network that stalls stops the sender within a window
instead of filling the other side's buffers with what would still come out after a stop request.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
import termios
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Closure, Nanos
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.pacing import character_time
from tapewire.line.transport import Closed, StopDistance

__all__ = ["TcpLine", "is_connected_to_itself"]

SIOCOUTQ: Final = termios.TIOCOUTQ
"""Bytes of a socket that the other side has not acknowledged; the same number as its namesake of terminals."""

ACKNOWLEDGED_LATE: Final[Nanos] = 50 * MILLISECOND
"""A receiver may keep its acknowledgement back for 40 ms, to send it along with an answer. What is unacknowledged for
no longer than that has arrived for all we know; what is more has met a network that stalls, and stops us.
"""

DRAIN_BOUND: Final = 64
"""Reads of what nobody wants any more, at closing."""

DRAIN_LIMIT: Final[Nanos] = 500 * MILLISECOND
"""What is not acknowledged so long after the last write waits for a network to recover: at closing it is thrown away,
for it would reach the control after the end of its job has been told."""

DEAD_PEER: Final[Nanos] = 60 * SECOND
"""A peer that answers nothing for so long, or takes nothing for so long, is gone."""

PROBES: Final = 3
"""Unanswered questions, ten seconds apart, after which a silent peer is gone."""

PROBE_INTERVAL_S: Final = 10


class TcpLine(DescriptorLine):
    """One end of an established connection; it owns the socket."""

    def __init__(self, connection: socket.socket, settings: LineSettings) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _watch_over(connection)
        super().__init__(connection.fileno(), settings)
        self._connection = connection
        self._patience = ACKNOWLEDGED_LATE // character_time(settings.baud)
        self._written: Nanos = 0

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(
            characters=self._settings.window + self._patience,
            guaranteed=False,
            how=f"TCP at {self._settings.baud} baud: a window of {self._settings.window}, paced by time, and"
            f" {self._patience} that a stalling network may hold unseen; what lies beyond it cannot be asked",
        )

    def write(self, data: bytes, now: Nanos) -> None:
        self._written = now
        super().write(data, now)

    def close(self, now: Nanos) -> None:
        """What is not acknowledged within DRAIN_LIMIT of its write never arrives: the connection is then reset."""
        self._now = now
        super().close(now)

    def _closed_by(self, error: OSError) -> Closed:
        reason = os.strerror(error.errno or errno.ECONNRESET)
        return Closed(closure=Closure.LOST, reason=f"the connection was lost: {reason}")

    def _closed_at_end(self) -> Closed:
        return Closed(closure=Closure.ORDERLY, reason="the other side closed the connection")

    def _queued(self, fd: int) -> int:
        with contextlib.suppress(OSError):
            return int(struct.unpack("i", fcntl.ioctl(fd, SIOCOUTQ, bytes(4)))[0])
        return 0

    def _release(self, fd: int) -> None:
        """In order, so that what was handed over arrives: closing over unread input would reset the connection."""
        with contextlib.suppress(OSError):
            if self._queued(fd) and self._now - self._written >= DRAIN_LIMIT:
                self._connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            else:
                # The system gives up by itself what cannot leave from now on.
                _limit_unacknowledged(self._connection, DRAIN_LIMIT)
                self._connection.shutdown(socket.SHUT_WR)
            for _ in range(DRAIN_BOUND):
                if not os.read(fd, 65536):
                    break
        self._connection.close()


def _watch_over(connection: socket.socket) -> None:
    """Have the system notice a peer that is gone without a word, within DEAD_PEER, whether or not we have sent."""
    idle_s = DEAD_PEER // SECOND - PROBES * PROBE_INTERVAL_S
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, idle_s)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, PROBE_INTERVAL_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, PROBES)
    _limit_unacknowledged(connection, DEAD_PEER)


def _limit_unacknowledged(connection: socket.socket, limit: Nanos) -> None:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, limit // MILLISECOND)


def is_connected_to_itself(connection: socket.socket) -> bool:
    """A client that tries a free local port often enough is once given that port as its own, and meets itself."""
    return bool(connection.getsockname() == connection.getpeername())
