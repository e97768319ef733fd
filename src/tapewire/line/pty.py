"""A pseudo terminal as a line: this end makes it, another program opens PATH as if it were a serial port.

A pseudo terminal has no rate, no control lines and no parity, and swallows thousands of characters at once; the model
of the line is all that paces it. Whether the other side has it open shows only in how the master side answers: EIO
while nobody has. That is asked every 20 ms until somebody has opened it.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
import termios
import tty
from typing import Final

from tapewire.engine import MILLISECOND, Closure, Nanos
from tapewire.errors import LineBusy, LineError
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.transport import Closed, StopDistance

__all__ = ["PtyLine", "create_pty"]

SLAVES: Final = "/dev/pts/"

OPEN_POLL: Final[Nanos] = 20 * MILLISECOND
"""How often an unopened pseudo terminal is looked at: a hang-up cannot be waited on, it is always ready."""


class PtyLine(DescriptorLine):
    """The master side. Its link is removed at `close`; what the other side has not read by then is lost."""

    def __init__(self, master: int, settings: LineSettings, *, link: str, slave: str) -> None:
        super().__init__(master, settings)
        self._connected = False
        self._link = link
        self._slave = slave

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(
            characters=self._settings.window,
            guaranteed=False,
            how=f"a pseudo terminal, paced by time at {self._settings.baud} baud",
        )

    def _closed_by(self, error: OSError) -> Closed | None:
        if error.errno != errno.EIO:
            return super()._closed_by(error)
        return self._closed_at_end() if self._connected else None

    def _closed_at_end(self) -> Closed:
        return Closed(closure=Closure.ORDERLY, reason=f"the other side closed {self._link}")

    def _queued(self, fd: int) -> int:
        """What the other side has not read: a close of this end would take it away.

        Only the slave side can be asked. It is opened for the moment of the question (6 µs), since a slave kept open
        here would hide that the other side closed.
        """
        if not self._connected:
            return 0
        with contextlib.suppress(OSError):
            slave = os.open(self._slave, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                return int(struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, bytes(4)))[0])
            finally:
                os.close(slave)
        return 0

    def _poll_interval(self) -> Nanos | None:
        return None if self._connected else OPEN_POLL

    def _release(self, fd: int) -> None:
        with contextlib.suppress(OSError):
            if os.readlink(self._link) == self._slave:
                os.unlink(self._link)
        os.close(fd)


def create_pty(path: str, settings: LineSettings) -> PtyLine:
    """Make a pseudo terminal, its slave raw, and link the slave at `path`. Nothing is ever flushed.

    A link left behind by a run that was killed is replaced; anything else at `path` is refused (LineBusy).
    """
    _remove_leftover(path)
    try:
        master, slave = os.openpty()
    except OSError as error:
        raise LineError(f"no pseudo terminal can be made: {error.strerror}") from error
    try:
        name = os.ttyname(slave)
        # Raw before anybody can find it: an echoing slave would answer the first code with itself.
        tty.setraw(slave, termios.TCSANOW)
        os.set_blocking(master, False)
        _link(name, path)
    except BaseException:
        os.close(master)
        raise
    finally:
        os.close(slave)
    return PtyLine(master, settings, link=path, slave=name)


def _remove_leftover(path: str) -> None:
    if not os.path.lexists(path):
        return
    target = os.readlink(path) if os.path.islink(path) else ""
    if not target.startswith(SLAVES):
        raise LineBusy(f"{path} exists and is no link to a pseudo terminal: give another path")
    if os.path.exists(path):
        raise LineBusy(
            f"{path} leads to {target}, which is in use, perhaps by another pty: line:"
            " give another path, or remove the link"
        )
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)


def _link(name: str, path: str) -> None:
    try:
        os.symlink(name, path)
    except FileExistsError as error:
        raise LineBusy(f"{path} has just been made by another program: give another path") from error
    except OSError as error:
        raise LineError(
            f"{path} cannot be made: {error.strerror}; give a path in a folder that exists and is yours"
        ) from error
