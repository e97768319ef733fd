"""What the host of protocol A is saying: one message or one packet at a time, handed over piece by piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tapewire.engine import SECOND, Nanos
from tapewire.protocols.fanuc_a.messages import Coding, checksum

__all__ = ["Outbox", "Span"]

_MEASURED_BYTES: Final = 20
"""Less than this says little about the rate of the line."""

_HEADER: Final = 5
"""Sum and command stand before the data of a message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """The part of an utterance that is program: `length` bytes behind `header`, from byte `base` of the program on."""

    base: int
    header: int
    length: int


class Outbox:
    """The current utterance, what of it is on its way, and when the last of it left."""

    def __init__(self) -> None:
        self._data = b""
        self._offset = 0
        self._span: Span | None = None
        self._begun_at: Nanos = 0
        self._begun_count = 0
        self.in_flight = 0
        self.left_at: Nanos | None = None
        self.rate = 0
        """Characters a second that this line has been seen to carry; 0 while unknown."""

    def put(self, data: bytes, span: Span | None = None) -> None:
        """Say this now. What is left of an utterance before it is not said any more."""
        self._data = data
        self._offset = 0
        self._span = span

    @property
    def empty(self) -> bool:
        """All of it has been handed over."""
        return self._offset >= len(self._data)

    @property
    def untouched(self) -> bool:
        """There is something to say, and nothing of it has been handed over."""
        return self._offset == 0 and bool(self._data)

    @property
    def idle(self) -> bool:
        """All of it has left."""
        return self.empty and not self.in_flight

    def look(self, limit: int) -> bytes:
        return self._data[self._offset : self._offset + limit]

    @property
    def reached(self) -> int:
        """Bytes of the program up to the last one handed over; 0 when this is no program."""
        if self._span is None:
            return 0
        handed = self._offset - self._span.header
        return self._span.base + min(handed, self._span.length) if handed > 0 else 0

    @property
    def holds_program(self) -> bool:
        return self._span is not None

    @property
    def will_reach(self) -> int:
        """What `reached` is when all of it has been handed over."""
        return self._span.base + self._span.length if self._span is not None else 0

    def forget_program(self) -> None:
        """What is left of an utterance is none of the next program's bytes."""
        self._span = None

    def hand_over(self, count: int, now: Nanos) -> None:
        if not self.in_flight:
            self._begun_at = now
            self._begun_count = 0
        self._begun_count += count
        self._offset += count
        self.in_flight += count

    def leave(self, count: int, now: Nanos) -> None:
        self.in_flight = max(0, self.in_flight - count)
        self.left_at = now
        elapsed = now - self._begun_at
        if not self.in_flight and elapsed > 0 and self._begun_count >= _MEASURED_BYTES:
            self.rate = max(self.rate, self._begun_count * SECOND // elapsed)

    def call_back(self, count: int) -> None:
        """The last `count` characters handed over never leave."""
        self.in_flight = max(0, self.in_flight - count)
        self._offset = max(0, self._offset - count)

    def break_off(self, coding: Coding) -> None:
        """End a message before its data is complete, so that the control cannot take what it has of it: the end code
        comes early and the sum is made sure to be wrong. The control asks for a repetition and gets something else.
        """
        body = self._data[: max(self._offset, _HEADER + 1)]
        end = coding.end_byte
        if coding.encode(checksum(body[2:] + end)) == body[:2]:
            body += b"0"
        self.put(body[self._offset :] + end)
