"""Keys of a terminal, one at a time, as long as a `with` lasts."""

from __future__ import annotations

import asyncio
import contextlib
import os
import termios
import tty
from collections.abc import Callable, Iterator
from typing import Final

__all__ = ["keys_of"]

_SWITCHED_OFF: Final = (termios.VSUSP, termios.VSTOP, termios.VSTART, termios.VQUIT)
"""Ctrl-Z, Ctrl-S and Ctrl-\\ would leave a control standing whose line goes on. Ctrl-C stays what it is."""

READ_SIZE: Final = 64

ESCAPE: Final = 0x1B


@contextlib.contextmanager
def keys_of(terminal: int, on_key: Callable[[str], None], on_end: Callable[[], None]) -> Iterator[None]:
    """`on_key` gets every printable key, `on_end` is called when the terminal is gone. Inside a running loop.

    The terminal is put back as it was, however the `with` ends. Raises termios.error for what is no terminal.
    """
    before = termios.tcgetattr(terminal)
    loop = asyncio.get_running_loop()

    def read() -> None:
        try:
            data = os.read(terminal, READ_SIZE)
        except OSError:
            data = b""
        if not data:
            loop.remove_reader(terminal)
            on_end()
        # An arrow or a function key comes as one piece that begins with ESC: no key of it is meant.
        elif data[0] != ESCAPE:
            for key in data.decode("ascii", "ignore"):
                on_key(key)

    try:
        tty.setcbreak(terminal, termios.TCSANOW)
        mode = termios.tcgetattr(terminal)
        for special in _SWITCHED_OFF:
            mode[6][special] = b"\0"
        termios.tcsetattr(terminal, termios.TCSANOW, mode)
        loop.add_reader(terminal, read)
        yield
    finally:
        loop.remove_reader(terminal)
        with contextlib.suppress(termios.error):
            termios.tcsetattr(terminal, termios.TCSANOW, before)
