"""A dialogue as text: one format for the log, the golden test and the page of the manual.

     0.000  cnc   DC1
     0.003  host  23 bytes  "%\\nO0001\\nG91..."
     0.015  host  -- complete: ...

Times are seconds since the beginning; a line that starts with two dashes is an event, not a character on the line.
"""

from __future__ import annotations

from collections import deque
from typing import Final, TypeAlias, assert_never

from tapewire.engine import (
    SECOND,
    AfterStop,
    Alarm,
    Ended,
    Event,
    Held,
    Nanos,
    Notice,
    Received,
    Requested,
    Resumed,
    Started,
    Violation,
)

__all__ = ["Transcript", "Word", "event_text", "quote"]

Word: TypeAlias = str | bytes
"""What one end said: a named code or message, or a run of program bytes."""

SHOWN: Final = 12
"""Program bytes shown of a run before it is cut."""

KEPT_LINES: Final = 10_000
"""Lines a transcript keeps; older ones are forgotten."""


def quote(data: bytes) -> str:
    """Program bytes for people: quoted, escaped, cut."""
    text = "".join(chr(byte) if 32 <= byte < 127 and byte not in b'"\\' else _escape(byte) for byte in data[:SHOWN])
    return f'"{text}{"..." if len(data) > SHOWN else ""}"'


def _escape(byte: int) -> str:
    return {10: "\\n", 13: "\\r", 34: '\\"', 92: "\\\\"}.get(byte, f"\\x{byte:02x}")


def event_text(event: Event) -> str:
    """An event in words; empty for one that a dialogue does not show."""
    match event:
        case Requested(served=True) | Received():
            return ""
        case Requested():
            return "asked for a program, but none is armed: nothing is sent"
        case Started(why=why):
            return f"started: {why}"
        case Held(why=why):
            return f"held: {why}"
        case Resumed(why=why):
            return f"resumed: {why}"
        case AfterStop(count=count, allowed=allowed):
            return f"{count} characters after DC3 ({allowed} allowed)"
        case Alarm(number=number, text=text):
            return f"alarm {number} {text}"
        case Violation(what=what, count=count):
            return f"violation: {what}" + (f" ({count} times)" if count > 1 else "")
        case Notice(text=text):
            return text
        case Ended(outcome=outcome, reason=reason, bytes_low=low, bytes_high=high):
            span = f"{low}" if low == high else f"{low} to {high}"
            return f"{outcome}, {span} bytes: {reason}"
        case _:
            assert_never(event)


class Transcript:
    """Collects a dialogue. Program bytes that follow one another from the same end become one line."""

    def __init__(self, kept_lines: int = KEPT_LINES) -> None:
        self.kept_lines = kept_lines
        """0: nothing is written down, which is what a campaign of a million transfers wants."""
        self._lines: deque[str] = deque(maxlen=kept_lines)
        self._run: tuple[str, Nanos, int, bytes] | None = None

    def said(self, who: str, word: Word, now: Nanos) -> None:
        if isinstance(word, str):
            self._line(who, word, now)
        elif self._run is not None and self._run[0] == who:
            _, began, count, shown = self._run
            self._run = (who, began, count + len(word), (shown + word)[: SHOWN + 1])
        else:
            self._flush()
            self._run = (who, now, len(word), word[: SHOWN + 1])

    def happened(self, who: str, what: str, now: Nanos) -> None:
        self._line(who, f"-- {what}", now)

    def _line(self, who: str, text: str, now: Nanos) -> None:
        self._flush()
        self._lines.append(f"{now / SECOND:9.3f}  {who:4}  {text}")

    def _flush(self) -> None:
        if self._run is not None:
            who, began, count, shown = self._run
            self._run = None
            noun = "byte" if count == 1 else "bytes"
            self._lines.append(f"{began / SECOND:9.3f}  {who:4}  {count} {noun}  {quote(shown)}")

    def __str__(self) -> str:
        self._flush()
        return "".join(f"{line}\n" for line in self._lines)
