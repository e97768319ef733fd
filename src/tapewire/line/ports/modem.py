"""Waits for the control lines to change, where the driver can wait (TIOCMIWAIT): no polling, and no edge missed by it.

The wait blocks a thread of its own, which holds the terminal open with it. So the end interrupts it by a signal: what
was let go of is free for the next program at once.
"""

from __future__ import annotations

import os
import signal
import termios
import threading
from contextlib import suppress
from typing import Final

from tapewire.line.ports.kernel import TtyKernel

__all__ = ["SignalWatch", "can_interrupt"]

WATCHED: Final = termios.TIOCM_CTS | termios.TIOCM_DSR | termios.TIOCM_CD | termios.TIOCM_RI

INTERRUPT: Final = signal.SIGRTMIN + 5
"""Nothing else uses it; glibc keeps the first two real-time signals to itself."""

INTERRUPT_TRIES: Final = 50
INTERRUPT_PAUSE_S: Final = 0.01
"""A signal that comes just before the thread waits is lost, so it is sent again."""


class SignalWatch:
    """A thread that says by `fd` becoming readable that a control line has changed. `can_interrupt` comes first."""

    def __init__(self, fd: int, kernel: TtyKernel) -> None:
        self.fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.failed = False
        """The driver cannot wait, or the port is gone: look at the lines by the clock."""
        self._port = fd
        self._kernel = kernel
        self._closing = False
        self._lock = threading.Lock()
        self._waits = True
        self._thread = threading.Thread(target=self._run, name="control lines", daemon=True)
        self._thread.start()

    def changed(self) -> bool:
        """A line has changed since the last call."""
        with suppress(BlockingIOError):
            return os.eventfd_read(self.fd) > 0
        return False

    def close(self) -> None:
        """Returns when the thread is gone. The port must still be open."""
        self._closing = True
        for _ in range(INTERRUPT_TRIES):
            with self._lock:  # the thread does not end while it is sent a signal
                if self._waits and self._thread.ident is not None:
                    signal.pthread_kill(self._thread.ident, INTERRUPT)
            self._thread.join(INTERRUPT_PAUSE_S)
            if not self._thread.is_alive():
                os.close(self.fd)
                return

    def _run(self) -> None:
        while not (self._closing or self.failed):
            try:
                self._kernel.wait_for_signals(self._port, WATCHED)
            except InterruptedError:
                continue
            except OSError:
                self.failed = True
            os.eventfd_write(self.fd, 1)
        with self._lock:
            self._waits = False


def can_interrupt() -> bool:
    """The signal that ends a wait has a handler. Only the main thread of a program may give it one."""
    if signal.getsignal(INTERRUPT) not in (signal.SIG_DFL, signal.SIG_IGN, None):
        return True
    if threading.current_thread() is not threading.main_thread():
        return False
    signal.signal(INTERRUPT, _nothing)
    return True


def _nothing(number: int, frame: object) -> None:
    """A handler at all is what makes a blocked call return."""
