"""What a serial port is asked of the kernel: one method for each ioctl, and nothing decided here.

A `TtyLine` gets one of these and calls no ioctl itself, so that a test can put a driver in its place that answers as
the real ones do. Numbers and structures are those of Linux on every architecture with the generic ioctl encoding.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import struct
import termios
from dataclasses import dataclass, fields
from typing import Final

__all__ = ["Counters", "SerialInfo", "Settings", "TtyKernel"]

_TERMIOS2: Final = struct.Struct("=4IB19s2I")
"""struct termios2: input, output, control and local flags, discipline, characters, both speeds."""
_TCGETS2: Final = 0x802C542A
_TCSETS2: Final = 0x402C542B

_TIOCSERGETLSR: Final = 0x5459
_TIOCSER_TEMT: Final = 0x01
_TIOCGICOUNT: Final = 0x545D
_TIOCMIWAIT: Final = 0x545C
_ICOUNT: Final = struct.Struct("=11i36x")
"""struct serial_icounter_struct: cts dsr rng dcd rx tx frame overrun parity brk buf_overrun."""

_TIOCSBRK: Final = 0x5427
_TIOCCBRK: Final = 0x5428
_TCXONC: Final = 0x540A
_TCFLSH: Final = 0x540B

_ASYNC_LOW_LATENCY: Final = 1 << 13

_SLAVE_MAJORS: Final = range(136, 144)
"""Device numbers that Linux gives the slaves of pseudo terminals."""


_libc: Final = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """struct termios2, as numbers."""

    input_flags: int
    output_flags: int
    control_flags: int
    local_flags: int
    discipline: int
    characters: bytes
    input_baud: int
    output_baud: int


class _SerialStruct(ctypes.Structure):
    """struct serial_struct of linux/serial.h."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("line", ctypes.c_int),
        ("port", ctypes.c_uint),
        ("irq", ctypes.c_int),
        ("flags", ctypes.c_int),
        ("xmit_fifo_size", ctypes.c_int),
        ("custom_divisor", ctypes.c_int),
        ("baud_base", ctypes.c_int),
        ("close_delay", ctypes.c_ushort),
        ("io_type", ctypes.c_char),
        ("reserved_char", ctypes.c_char * 1),
        ("hub6", ctypes.c_int),
        ("closing_wait", ctypes.c_ushort),
        ("closing_wait2", ctypes.c_ushort),
        ("iomem_base", ctypes.c_void_p),
        ("iomem_reg_shift", ctypes.c_ushort),
        ("port_high", ctypes.c_uint),
        ("iomap_base", ctypes.c_ulong),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialInfo:
    """What TIOCGSERIAL tells of a UART; 0 where the driver leaves it out."""

    type: int
    """The number of linux/serial_core.h; 4 is a 16550A."""
    baud_base: int
    """The rate at divisor 1, in bits a second."""
    fifo: int
    """Characters in the transmit FIFO."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counters:
    """TIOCGICOUNT: how often each has happened since the driver was loaded. They run over at 2^32."""

    cts: int = 0
    dsr: int = 0
    ri: int = 0
    cd: int = 0
    received: int = 0
    sent: int = 0
    framing: int = 0
    uart_overrun: int = 0
    parity: int = 0
    breaks: int = 0
    queue_overrun: int = 0
    """Characters that this computer was too slow to take out of the driver's queue."""

    def since(self, before: Counters) -> Counters:
        """What has been added since `before`."""
        return Counters(
            **{
                field.name: (getattr(self, field.name) - getattr(before, field.name)) % (1 << 32)
                for field in fields(self)
            }
        )


class TtyKernel:
    """The kernel of this computer. Every method raises OSError where the driver does not have it, or is gone."""

    def settings(self, fd: int) -> Settings:
        values = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))
        return Settings(**dict(zip((field.name for field in fields(Settings)), values, strict=True)))

    def set(self, fd: int, wanted: Settings) -> None:
        """At once, whatever is queued; nothing is flushed."""
        values = (getattr(wanted, field.name) for field in fields(Settings))
        fcntl.ioctl(fd, _TCSETS2, _TERMIOS2.pack(*values))

    def signals(self, fd: int) -> int:
        """The TIOCM bits of the control lines, both directions."""
        return _int(fd, termios.TIOCMGET)

    def set_signals(self, fd: int, on: int, off: int) -> None:
        for request, bits in ((termios.TIOCMBIS, on), (termios.TIOCMBIC, off)):
            fcntl.ioctl(fd, request, struct.pack("i", bits))

    def wait_for_signals(self, fd: int, bits: int) -> None:
        """Block until one of the control lines of `bits` changes. A signal to the thread raises InterruptedError.

        By the C library, because Python's own calls begin again when a signal has interrupted them.
        """
        if _libc.ioctl(fd, ctypes.c_ulong(_TIOCMIWAIT), ctypes.c_ulong(bits)) < 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))

    def counters(self, fd: int) -> Counters:
        values = _ICOUNT.unpack(fcntl.ioctl(fd, _TIOCGICOUNT, bytes(_ICOUNT.size)))
        cts, dsr, ri, cd, received, sent, framing, overrun, parity, breaks, queue = (v % (1 << 32) for v in values)
        return Counters(
            cts=cts, dsr=dsr, ri=ri, cd=cd, received=received, sent=sent, framing=framing,
            uart_overrun=overrun, parity=parity, breaks=breaks, queue_overrun=queue,
        )  # fmt: skip

    def transmitter_is_empty(self, fd: int) -> bool:
        """The last stop bit has left, FIFO and shift register included."""
        return bool(_int(fd, _TIOCSERGETLSR) & _TIOCSER_TEMT)

    def queued(self, fd: int) -> int:
        """Characters in the driver's queue; a FIFO behind it is not counted."""
        return _int(fd, termios.TIOCOUTQ)

    def info(self, fd: int) -> SerialInfo:
        serial = _SerialStruct()
        fcntl.ioctl(fd, termios.TIOCGSERIAL, serial)
        return SerialInfo(type=serial.type, baud_base=serial.baud_base, fifo=serial.xmit_fifo_size)

    def ask_low_latency(self, fd: int) -> None:
        """ASYNC_LOW_LATENCY: an FTDI adapter then reports every millisecond instead of every sixteen."""
        serial = _SerialStruct()
        fcntl.ioctl(fd, termios.TIOCGSERIAL, serial)
        serial.flags |= _ASYNC_LOW_LATENCY
        fcntl.ioctl(fd, termios.TIOCSSERIAL, serial)

    def hold_output(self, fd: int) -> None:
        fcntl.ioctl(fd, _TCXONC, termios.TCOOFF)

    def release_output(self, fd: int) -> None:
        fcntl.ioctl(fd, _TCXONC, termios.TCOON)

    def flush_output(self, fd: int) -> None:
        fcntl.ioctl(fd, _TCFLSH, termios.TCOFLUSH)

    def begin_break(self, fd: int) -> None:
        fcntl.ioctl(fd, _TIOCSBRK)

    def end_break(self, fd: int) -> None:
        fcntl.ioctl(fd, _TIOCCBRK)

    def is_pseudo(self, fd: int) -> bool:
        """It is the slave of a pseudo terminal: no rate, no control lines, nothing that paces it."""
        return os.major(os.fstat(fd).st_rdev) in _SLAVE_MAJORS

    def claim(self, fd: int) -> None:
        """No other program may open the terminal until `disclaim`, or the last close."""
        fcntl.ioctl(fd, termios.TIOCEXCL)

    def disclaim(self, fd: int) -> None:
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCNXCL)


def _int(fd: int, request: int) -> int:
    return int(struct.unpack("i", fcntl.ioctl(fd, request, bytes(4)))[0])
