"""A driver with a UART behind it, played on a pseudo terminal in the test's own time.

It answers every question a real driver answers, and what leaves the UART leaves it at the true rate of the line, which
need not be the one it was set to.
"""

from __future__ import annotations

import errno
import os
import termios
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from tapewire.engine import Nanos
from tapewire.line.descriptor import LineSettings
from tapewire.line.ports.files import PortFiles
from tapewire.line.ports.kernel import Counters, SerialInfo, Settings, TtyKernel
from tapewire.line.ports.serial_port import TtyLine, open_tty
from tests.line.helpers import Clock


class FakeUart(TtyKernel):
    """`character` is how long one really takes; `fifo` how many the queue does not count any more."""

    def __init__(self, master: int, clock: Clock, character: Nanos = 0, fifo: int = 16) -> None:
        self.master = master
        self.clock = clock
        self.character = character
        self.fifo = fifo
        self.left: list[tuple[Nanos, int]] = []
        """Each character on the wire, with the moment of its last stop bit."""
        self.lines = 0
        self.driven: list[tuple[int, int]] = []
        self.count = Counters()
        self.answers_empty = True
        self.flushes = True
        self.can_wait = False
        self.speed: Callable[[int], int] = lambda baud: baud
        self.framing: Callable[[int], int] = lambda flags: flags
        self.uart = SerialInfo(type=4, baud_base=0, fifo=16)
        self.low_latency = False
        self.claimed = False
        self.changed = threading.Semaphore(0)
        self._set: Settings | None = None
        self._inside: deque[int] = deque()
        self._free: Nanos = 0

    def run(self) -> None:
        """Take what was written, and let leave what has left by now."""
        try:
            written = os.read(self.master, 4096)
        except BlockingIOError:
            written = b""
        now = self.clock.now
        if written and not self._inside:
            self._free = max(self._free, now)
        self._inside += written
        while self._inside and self._free + self.character <= now:
            self._free += self.character
            self.left.append((self._free, self._inside.popleft()))

    @property
    def inside(self) -> int:
        """Characters in the queue and the FIFO."""
        self.run()
        return len(self._inside)

    # What the driver answers.

    def is_pseudo(self, fd: int) -> bool:
        return False

    def settings(self, fd: int) -> Settings:
        if self._set is None:
            return super().settings(fd)
        return replace(
            self._set,
            output_baud=self.speed(self._set.output_baud),
            control_flags=self.framing(self._set.control_flags),
        )

    def set(self, fd: int, wanted: Settings) -> None:
        self._set = wanted
        super().set(fd, wanted)

    def signals(self, fd: int) -> int:
        return self.lines

    def set_signals(self, fd: int, on: int, off: int) -> None:
        self.driven.append((on, off))

    def wait_for_signals(self, fd: int, bits: int) -> None:
        if not self.can_wait:
            raise OSError(errno.ENOTTY, "not offered")
        assert bits & termios.TIOCM_CTS
        if not self.changed.acquire(timeout=0.02):
            raise InterruptedError

    def turn(self, lines: int) -> None:
        """The other end changes its control lines."""
        self.lines = lines
        self.changed.release()

    def counters(self, fd: int) -> Counters:
        return self.count

    def transmitter_is_empty(self, fd: int) -> bool:
        if not self.answers_empty:
            raise OSError(errno.ENOTTY, "not offered")
        return self.inside == 0

    def queued(self, fd: int) -> int:
        return max(0, self.inside - self.fifo)

    def info(self, fd: int) -> SerialInfo:
        return self.uart

    def ask_low_latency(self, fd: int) -> None:
        self.low_latency = True

    def hold_output(self, fd: int) -> None:
        self.run()

    def release_output(self, fd: int) -> None:
        self.run()

    def flush_output(self, fd: int) -> None:
        self.run()
        while self.flushes and len(self._inside) > self.fifo:
            self._inside.pop()

    def claim(self, fd: int) -> None:
        self.claimed = True

    def disclaim(self, fd: int) -> None:
        self.claimed = False


@dataclass
class Bench:
    """A fake UART, and how to open it."""

    uart: FakeUart
    path: str
    files: PortFiles

    def open(self, settings: LineSettings, on_note: Callable[[str], None] | None = None) -> TtyLine:
        return open_tty(self.path, settings, kernel=self.uart, files=self.files, on_note=on_note)


@contextmanager
def bench(folder: Path, character: Nanos = 0, fifo: int = 16) -> Iterator[Bench]:
    """A UART that nothing is known of but what its driver says: `folder` is an empty /sys."""
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    os.set_blocking(master, False)
    try:
        yield Bench(FakeUart(master, Clock(), character, fifo), path, PortFiles(sys=folder, dev=folder, proc=folder))
    finally:
        os.close(master)
