"""A terminal with somebody in front of it: a pseudo terminal, its screen as text, and keys."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Final

from tests.cli.forked import Forked
from tests.cli.helpers import DEADLINE_S

_SEQUENCE: Final = re.compile(r"\x1b\[(\??)([\d;]*)([A-Za-z])|\x1b[()][A-Z0-9]|\x1b[=>]")
_PICTURE: Final = re.compile(r"(?=\x1b\[H)")
_BEGUN: Final = re.compile(r"\x1b(\[\??[\d;]*)?$")

MAIN_AND_OTHER: Final = {"1049h": "other", "1049l": "main"}


class Screen:
    """What a terminal makes of the little that a program of ours sends. Raises for what it does not know."""

    def __init__(self, columns: int, lines: int) -> None:
        self.columns, self.lines = columns, lines
        self.which = "main"
        self.cursor = "shown"
        self._rest = ""
        self._clear()

    def _clear(self) -> None:
        self._rows = [[" "] * self.columns for _ in range(self.lines)]
        self._x = self._y = 0

    @property
    def text(self) -> str:
        return "\n".join("".join(row).rstrip() for row in self._rows)

    def resize(self, columns: int, lines: int) -> None:
        self.columns, self.lines = columns, lines
        self._clear()

    def feed(self, text: str) -> None:
        text = self._rest + text
        begun = _BEGUN.search(text)
        text, self._rest = (text[: begun.start()], begun[0]) if begun else (text, "")
        at = 0
        while at < len(text):
            found = _SEQUENCE.match(text, at)
            if found is not None:
                self._obey(found)
                at = found.end()
            else:
                self._put(text[at])
                at += 1

    def _obey(self, found: re.Match[str]) -> None:
        private, numbers, verb = found[1], found[2], found[3]
        if private:
            if numbers + verb in MAIN_AND_OTHER:
                self.which = MAIN_AND_OTHER[numbers + verb]
                self._clear()
            self.cursor = {"25h": "shown", "25l": "hidden"}.get(numbers + verb, self.cursor)
            return
        match verb:
            case "m" | None:
                pass
            case "H":
                row, column = ([int(n or 1) for n in numbers.split(";")] + [1, 1])[:2]
                self._y, self._x = row - 1, column - 1
            case "J":
                self._clear()
            case "K":
                self._rows[self._y] = [" "] * self.columns
            case "A":
                self._y = max(0, self._y - int(numbers or 1))
            case _:
                raise AssertionError(f"a sequence this reader does not know: {found[0]!r}")

    def _put(self, sign: str) -> None:
        if sign == "\r":
            self._x = 0
        elif sign == "\n":
            self._next_line()
        else:
            assert sign >= " ", f"a control character on the screen: {sign!r}"
            if self._x == self.columns:
                self._next_line()
                self._x = 0
            self._rows[self._y][self._x] = sign
            self._x += 1

    def _next_line(self) -> None:
        if self._y + 1 == self.lines:
            self._rows = [*self._rows[1:], [" "] * self.columns]
        else:
            self._y += 1


class Terminal:
    """`tapewire` in a terminal of its own: a process forked off this one, so that it need not load everything anew."""

    def __init__(self, *words: object, columns: int = 80, lines: int = 24) -> None:
        self.screen = Screen(columns, lines)
        self.master, slave = pty.openpty()
        self._set_size(columns, lines)
        self.modes_before = termios.tcgetattr(slave)
        self._slave = slave
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._pictures: deque[str] = deque()
        self._process = Forked([str(word) for word in words], (slave, slave, slave))

    def __enter__(self) -> Terminal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill(DEADLINE_S)
        for descriptor in (self.master, self._slave):
            os.close(descriptor)

    @property
    def has_ended(self) -> bool:
        return self._process.has_ended

    @property
    def modes(self) -> list[object]:
        """Of the terminal, as they are now."""
        return termios.tcgetattr(self._slave)

    def _set_size(self, columns: int, lines: int) -> None:
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    def resize(self, columns: int, lines: int) -> None:
        self.screen.resize(columns, lines)
        self._set_size(columns, lines)

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def send_signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def read(self, seconds: float = 0.05) -> None:
        """Take in what comes within `seconds`."""
        while self._next_picture(seconds):
            seconds = 0

    def _next_picture(self, seconds: float) -> bool:
        """One picture at a time, so that a test that sleeps sees each; False when none comes within `seconds`."""
        if not self._pictures and select.select([self.master], [], [], seconds)[0]:
            with suppress(OSError):
                text = self._decoder.decode(os.read(self.master, 1 << 16))
                self._pictures.extend(_PICTURE.split(text))
        if not self._pictures:
            return False
        self.screen.feed(self._pictures.popleft())
        return True

    def wait(self, until: Callable[[str], object]) -> str:
        """Until the screen is as `until` wants it; what it shows then."""
        deadline = time.monotonic() + DEADLINE_S
        while not until(self.screen.text):
            assert not self.has_ended, f"it has ended with {self._process.status}:\n{self.screen.text}"
            assert time.monotonic() < deadline, f"the screen never came to it:\n{self.screen.text}"
            self._next_picture(0.05)
        return self.screen.text

    def wait_for(self, *words: str) -> str:
        """Until all of `words` are on the screen."""
        return self.wait(lambda text: all(word in text for word in words))

    def end(self) -> int:
        """The exit status."""
        deadline = time.monotonic() + DEADLINE_S
        while not self.has_ended:
            assert time.monotonic() < deadline, f"it does not end:\n{self.screen.text}"
            self.read()
        self.read()
        assert self._process.status is not None
        assert "Traceback" not in self.screen.text
        return self._process.status
