"""How a person or the system ends a command: Ctrl-C, SIGTERM, a closed terminal."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from typing import Final

__all__ = ["ENDING_SIGNALS", "ignore_signals", "interrupt_on_signals", "stop_on_signals"]

ENDING_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Whatever a person or the system uses to end a command; one that is ignored (nohup) stays so, but for Ctrl-C, which
a shell ignores for whatever runs in its background."""

PATIENCE: Final = 3
"""The third signal of somebody who waits in vain does what it does to any program: it kills."""

PATIENCE_S: Final = 0.5
"""Signals closer together are one: a closing terminal sends several, and fingers hammer."""

_heard: list[int] = []
"""The signals since `interrupt_on_signals`. Python can lose the exception, in a callback of an import for one."""


def interrupt_on_signals() -> None:
    """Ctrl-C and SIGTERM raise KeyboardInterrupt from now on, until a job makes better use of them."""
    _heard.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def _interrupt(number: int, frame: object) -> None:
    _heard.append(number)
    raise KeyboardInterrupt


def stop_on_signals(stop: asyncio.Event) -> None:
    """Ctrl-C, SIGTERM and a closed terminal set `stop` from now on. Called inside a running loop."""
    if _heard:
        stop.set()
    loop = asyncio.get_running_loop()
    patience = _Patience()
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN or number is signal.SIGINT:
            loop.add_signal_handler(number, stop.set)
            # The loop goes on hearing the signal by its own wake-up; this counts also while the loop hangs.
            signal.signal(number, patience.count)


class _Patience:
    """How often somebody has asked for the end."""

    def __init__(self) -> None:
        self._asked = 0
        self._last = -PATIENCE_S

    def count(self, number: int, frame: object) -> None:
        now = time.monotonic()
        if now - self._last >= PATIENCE_S:
            self._asked, self._last = self._asked + 1, now
        if self._asked == PATIENCE:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)


def ignore_signals() -> None:
    """The job is over: a second Ctrl-C would only break into the command's last words and spoil its exit status."""
    loop = asyncio.get_running_loop()
    for number in ENDING_SIGNALS:
        loop.remove_signal_handler(number)
        signal.signal(number, signal.SIG_IGN)
