"""Wakes a loop at a moment, to a twentieth of a millisecond.

The loop of asyncio rounds its own timers up to whole milliseconds, which is a character at 9600 baud. A timer of the
kernel that can be waited on like a line (timerfd) is not rounded, and costs no processor time until it is due.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from tapewire.engine import SECOND, Nanos

__all__ = ["Alarm"]

_CLOCK_MONOTONIC: Final = 1
_TFD_TIMER_ABSTIME: Final = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanos", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("interval", _Timespec), ("value", _Timespec))


_libc: Final = ctypes.CDLL(None, use_errno=True)


class Alarm:
    """One moment of the monotonic clock, set anew as often as wanted. `fd` is readable once it has come."""

    def __init__(self) -> None:
        self.fd: int = _checked(_libc.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))
        self._spec = _Itimerspec()
        self._settime: Callable[..., int] = _libc.timerfd_settime

    def set(self, at: Nanos) -> None:
        """Wake at `at`, and not at the moment set before. One that has passed wakes at once."""
        value = self._spec.value
        value.seconds, value.nanos = divmod(max(at, 1), SECOND)
        _checked(self._settime(self.fd, _TFD_TIMER_ABSTIME, ctypes.byref(self._spec), None))

    def clear(self) -> None:
        """The moment has been noticed: `fd` is quiet until the next `set`."""
        with suppress(BlockingIOError):
            os.read(self.fd, 8)

    def close(self) -> None:
        os.close(self.fd)


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result
