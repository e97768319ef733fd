"""A terminal of this computer as a line: a UART, a USB adapter, or the slave of a pseudo terminal.

Software flow control stays off, because DC1 and DC3 are commands of these protocols; hardware flow control stays off,
because RTS belongs to the engine and output held by the kernel blocks a close. Damaged characters come marked in their
place (PARMRK). DTR stays as it is when the port is closed: a control that still executes would raise an alarm.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
import struct
import termios
from typing import Final

from tapewire.engine import MILLISECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.errors import LineBusy, LineError, LineNotFound
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.transport import Closed, Fault, StopDistance

__all__ = ["TtyLine", "decode_marks", "open_tty"]

TERMIOS2: Final = struct.Struct("=4IB19s2I")
"""struct termios2 of Linux: input, output, control, local flags, discipline, characters, both speeds."""
TCGETS2: Final = 0x802C542A
TCSETS2: Final = 0x402C542B
BOTHER: Final = 0o010000
"""The rate stands in the speed fields as a number."""
CBAUD: Final = 0o010017

RATE_TOLERANCE: Final = 0.02
"""A rate this far off damages the last bits of an 11-bit character."""

SLAVE_MAJORS: Final = range(136, 144)
"""Device numbers that Linux gives the slaves of pseudo terminals."""

UART_FIFO: Final = 16
"""Characters in the transmit FIFO of a 16550, which no queue of the kernel counts."""

SIGNALS_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often the control lines are looked at; between two looks at 86400 baud lie 79 characters."""

NO_SIGNALS: Final = frozenset({errno.ENOTTY, errno.EINVAL, errno.ENOSYS})

MARK: Final = 0xFF


def decode_marks(data: bytes, damage: LineFault) -> tuple[list[bytes | Fault], bytes]:
    """Take the marks of PARMRK out of `data`: (what came, the beginning of a mark that is not complete yet).

    FF FF is the character FF, FF 00 00 a break, FF 00 xx the damaged character xx. The rest goes before the next
    piece. A break and a damaged NUL look the same. termios(3)
    """
    if MARK not in data:
        return ([data] if data else []), b""
    items: list[bytes | Fault] = []
    plain = bytearray()
    at = 0
    while (mark := data.find(MARK, at)) >= 0:
        plain += data[at:mark]
        match data[mark : mark + 3]:
            case bytes(sequence) if sequence in (b"\xff", b"\xff\x00"):
                return _with(items, plain), sequence
            case bytes(sequence) if sequence[1] == MARK:
                plain.append(MARK)
                at = mark + 2
            case bytes(sequence) if sequence[1] == 0:
                items = _with(items, plain)
                plain = bytearray()
                byte = sequence[2]
                items.append(Fault(fault=damage, byte=byte) if byte else Fault(fault=LineFault.BREAK))
                at = mark + 3
            case _:
                # Came in before marks were switched on, so it is meant as it is.
                plain.append(MARK)
                at = mark + 1
    plain += data[at:]
    return _with(items, plain), b""


def _with(items: list[bytes | Fault], plain: bytearray) -> list[bytes | Fault]:
    return [*items, bytes(plain)] if plain else items


class TtyLine(DescriptorLine):
    """An open, raw terminal, which it owns.

    A pseudo terminal is paced like any other line, since it swallows what it is given; nothing can be called back from
    it, and it has no control lines.
    """

    def __init__(self, fd: int, settings: LineSettings, *, path: str, is_pseudo: bool) -> None:
        super().__init__(fd, settings)
        self._path = path
        self._is_pseudo = is_pseudo
        self._carry = b""
        # Without parity a damaged character can only be one whose stop bit is missing.
        self._damage = LineFault.PARITY if settings.has_parity else LineFault.FRAMING
        self._has_signals = not is_pseudo and _has_signals(fd)

    @property
    def stop_distance(self) -> StopDistance:
        window, baud = self._settings.window, self._settings.baud
        if self._is_pseudo:
            return StopDistance(
                characters=window, guaranteed=False, how=f"a pseudo terminal, paced by time at {baud} baud"
            )
        return StopDistance(
            characters=window + UART_FIFO,
            guaranteed=False,
            how=f"a window of {window}, kept by the driver's queue, and {UART_FIFO} in the FIFO of the UART;"
            " a USB adapter may hold more",
        )

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        if self._fd is None or not self._has_signals:
            return
        wanted = {termios.TIOCM_RTS: signals.rts, termios.TIOCM_DTR: signals.dtr}
        for request, state in ((termios.TIOCMBIS, True), (termios.TIOCMBIC, False)):
            bits = sum(bit for bit, on in wanted.items() if on is state)
            with contextlib.suppress(OSError):  # a port that is gone says so when it is read
                fcntl.ioctl(self._fd, request, struct.pack("i", bits))

    def _decode(self, data: bytes) -> list[bytes | Fault]:
        items, self._carry = decode_marks(self._carry + data, self._damage)
        return items

    def _closed_by(self, error: OSError) -> Closed:
        if self._is_pseudo and error.errno == errno.EIO:
            return self._closed_at_end()
        reason = os.strerror(error.errno or errno.EIO)
        return Closed(closure=Closure.LOST, reason=f"{self._path} was lost: {reason}")

    def _closed_at_end(self) -> Closed:
        if self._is_pseudo:
            return Closed(closure=Closure.ORDERLY, reason=f"the other side closed {self._path}")
        return Closed(closure=Closure.LOST, reason=f"{self._path} was lost: it hung up or was unplugged")

    def _queued(self, fd: int) -> int:
        with contextlib.suppress(OSError):
            return _ioctl_int(fd, termios.TIOCOUTQ)
        return 0

    def _recall(self, fd: int) -> int:
        """Empty the driver's queue, and count it while nothing moves.

        A driver that still holds characters afterwards did not empty it: then all of them leave, and none counts.
        """
        if self._is_pseudo:
            return 0
        with contextlib.suppress(OSError, termios.error):
            termios.tcflow(fd, termios.TCOOFF)
            try:
                queued = self._queued(fd)
                termios.tcflush(fd, termios.TCOFLUSH)
                return 0 if self._queued(fd) else queued
            finally:
                termios.tcflow(fd, termios.TCOON)
        return 0

    def _ask_signals(self, fd: int) -> SignalsIn | None:
        if not self._has_signals:
            return None
        with contextlib.suppress(OSError):
            bits = _ioctl_int(fd, termios.TIOCMGET)
            return SignalsIn(
                cts=bool(bits & termios.TIOCM_CTS),
                dsr=bool(bits & termios.TIOCM_DSR),
                cd=bool(bits & termios.TIOCM_CD),
            )
        return None

    def _poll_interval(self) -> Nanos | None:
        return SIGNALS_POLL if self._has_signals else None

    def _release(self, fd: int) -> None:
        if not self._is_pseudo:
            with contextlib.suppress(OSError, termios.error):
                # A close would wait up to 30 s for what is still queued, and it would leave after the job's end.
                termios.tcflush(fd, termios.TCOFLUSH)
                fcntl.ioctl(fd, termios.TIOCNXCL)
        os.close(fd)


def open_tty(path: str, settings: LineSettings) -> TtyLine:
    """Open the terminal at `path` for this program alone and set it up. Nothing that has come in is flushed.

    Raises LineNotFound, LineBusy, or LineError with what to do.
    """
    fd = _open(path)
    try:
        is_pseudo = os.major(os.fstat(fd).st_rdev) in SLAVE_MAJORS
        _lock(fd, path, is_pseudo)
        _set_up(fd, path, settings, is_pseudo)
        return TtyLine(fd, settings, path=path, is_pseudo=is_pseudo)
    except BaseException:
        os.close(fd)
        raise


def _open(path: str) -> int:
    try:
        if not stat.S_ISCHR(os.stat(path).st_mode):
            raise LineError(f"{path} is not a serial port")
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except PermissionError as error:
        raise LineError(
            f"no permission to open {path}: join the group dialout (sudo usermod -aG dialout $USER) and log in anew"
        ) from error
    except LineError:
        raise
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise LineBusy(f"{path} is held by another program: close that one first") from error
        raise LineNotFound(f"{path} cannot be opened: {error.strerror}; is it plugged in?") from error
    if not os.isatty(fd):
        os.close(fd)
        raise LineError(f"{path} is not a serial port")
    return fd


def _lock(fd: int, path: str, is_pseudo: bool) -> None:
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LineBusy(f"{path} is held by another program: close that one first") from error
    if not is_pseudo:
        # On a slave it would outlive a killed program for as long as the master lives.
        fcntl.ioctl(fd, termios.TIOCEXCL)


def _set_up(fd: int, path: str, settings: LineSettings, is_pseudo: bool) -> None:
    framing = termios.CS8 if settings.data_bits == 8 else termios.CS7
    framing |= termios.PARENB if settings.has_parity else 0
    framing |= termios.CSTOPB if settings.stopbits == 2 else 0
    try:
        *_, discipline, characters, _, _ = TERMIOS2.unpack(fcntl.ioctl(fd, TCGETS2, bytes(TERMIOS2.size)))
        wanted = bytearray(characters)
        wanted[termios.VMIN], wanted[termios.VTIME] = 1, 0
        flags = (termios.INPCK | termios.PARMRK, 0, framing | termios.CREAD | termios.CLOCAL | BOTHER, 0)
        request = TERMIOS2.pack(*flags, discipline, bytes(wanted), settings.baud, settings.baud)
        fcntl.ioctl(fd, TCSETS2, request)
        _, _, control, *_, baud = TERMIOS2.unpack(fcntl.ioctl(fd, TCGETS2, bytes(TERMIOS2.size)))
    except OSError as error:
        raise LineError(f"{path} cannot be set to {settings.baud} baud: {error.strerror}") from error
    if abs(baud - settings.baud) > RATE_TOLERANCE * settings.baud:
        raise LineError(
            f"{path} cannot run at {settings.baud} baud: the nearest rate of its driver is {baud};"
            " set the control to a rate both have, or use another adapter"
        )
    kept = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB
    if not is_pseudo and control & kept != framing:
        raise LineError(f"{path} cannot run {settings.framing}: its driver refuses it; use another adapter")


def _has_signals(fd: int) -> bool:
    try:
        _ioctl_int(fd, termios.TIOCMGET)
    except OSError as error:
        if error.errno not in NO_SIGNALS:
            raise LineError(f"the control lines cannot be read: {error.strerror}") from error
        return False
    return True


def _ioctl_int(fd: int, request: int) -> int:
    return int(struct.unpack("i", fcntl.ioctl(fd, request, bytes(4)))[0])
