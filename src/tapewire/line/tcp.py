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

from tapewire.engine import Closure
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.transport import Closed, StopDistance

__all__ = ["TcpLine", "is_connected_to_itself"]

SIOCOUTQ: Final = termios.TIOCOUTQ
"""Bytes of a socket that the other side has not acknowledged; the same number as its namesake of terminals."""

DRAIN_BOUND: Final = 64
"""Reads of what nobody wants any more, at closing."""


class TcpLine(DescriptorLine):
    """One end of an established connection; it owns the socket."""

    def __init__(self, connection: socket.socket, settings: LineSettings) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().__init__(connection.fileno(), settings)
        self._connection = connection

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(
            characters=self._settings.window,
            guaranteed=False,
            how=f"TCP, paced by time at {self._settings.baud} baud; what the other side of the network"
            " holds back cannot be asked",
        )

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
            self._connection.shutdown(socket.SHUT_WR)
            for _ in range(DRAIN_BOUND):
                if not os.read(fd, 65536):
                    break
        self._connection.close()


def is_connected_to_itself(connection: socket.socket) -> bool:
    """A client that tries a free local port often enough is once given that port as its own, and meets itself."""
    return bool(connection.getsockname() == connection.getpeername())
