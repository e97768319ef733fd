"""`tapewire` in a process forked off this one: it need not load everything anew, and is otherwise a process of its own.

Where the start itself is the matter, tests run `python -m tapewire`.
"""

from __future__ import annotations

import fcntl
import gc
import os
import resource
import select
import signal
import sys
import termios
import traceback
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

# What a transfer needs, loaded once here and not once a process.
import tapewire.cli.cnc
import tapewire.cli.send
import tapewire.transfer.receiving
import tapewire.transfer.sending  # noqa: F401
from tapewire.cli import main

_NOT_A_STATUS: Final = 99


class Forked:
    """A running `tapewire`, with three descriptors as its streams."""

    def __init__(
        self, words: Sequence[str], streams: tuple[int, int, int], *, largest_file: int = resource.RLIM_INFINITY
    ) -> None:
        self.status: int | None = None
        """Its exit status, once it has ended; -N where signal N ended it."""
        self.pid = os.fork()
        if self.pid == 0:
            _become_tapewire(words, streams, largest_file)
        self._end = os.pidfd_open(self.pid)

    @property
    def has_ended(self) -> bool:
        return self.wait(0.0) is not None

    def wait(self, seconds: float) -> int | None:
        """Its exit status if it ends within `seconds`."""
        if self.status is None and select.select([self._end], [], [], seconds)[0]:
            self.status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
            os.close(self._end)
        return self.status

    def send_signal(self, number: signal.Signals) -> None:
        if not self.has_ended:
            os.kill(self.pid, number)

    def kill(self, within_s: float) -> None:
        self.send_signal(signal.SIGKILL)
        assert self.wait(within_s) is not None, f"{self.pid} survives being killed"


def _become_tapewire(words: Sequence[str], streams: tuple[int, int, int], largest_file: int) -> None:
    """In the child: leave pytest behind, and never come back."""
    status = _NOT_A_STATUS
    try:
        gc.freeze()  # what the parent had open must not be closed by a collection here: its numbers are given anew
        os.setsid()
        for number, stream in enumerate(os.dup(stream) for stream in streams):
            os.dup2(stream, number)
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        if os.isatty(0):
            _take_terminal()
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))
        sys.stdin = open(0)  # noqa: SIM115
        sys.stdout = open(1, "w", buffering=1)  # noqa: SIM115
        sys.stderr = open(2, "w", buffering=1)  # noqa: SIM115
        main(list(words), prog_name="tapewire")
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else _NOT_A_STATUS
    except BaseException:
        traceback.print_exc()
    finally:
        _flush()
        os._exit(status)


def _take_terminal() -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.environ["TERM"] = "xterm-256color"
    for name in ("COLUMNS", "LINES", "NO_COLOR"):
        os.environ.pop(name, None)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
