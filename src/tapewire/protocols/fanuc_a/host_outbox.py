"""What the host of protocol A is saying: one message or one packet at a time, handed over piece by piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.protocols.fanuc_a.messages import Coding, checksum

__all__ = ["Outbox", "Span"]

_MEASURED_BYTES: Final = 20
"""Less than this says little about the rate of the line."""

_HEADER: Final = 5
"""Sum and command stand before the data of a message."""

_MUCH_LONGER: Final = 4
"""Times as long as what the rate was measured by: then it is measured anew."""

QUIET: Final[Nanos] = 50 * MILLISECOND
"""What has come, or what has been said, is over when nothing has followed for so long."""

_QUIET_CHARACTERS: Final = 12
"""On a slow line it takes longer: twice the shortest message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """The part of an utterance that is program: `length` bytes behind `header`, from byte `base` of the program on."""

    base: int
    header: int
    length: int


class Outbox:
    """The current utterance, what of it is on its way, and when the last of it left."""

    def __init__(self, coding: Coding) -> None:
        self._coding = coding
        self._data = b""
        self._offset = 0
        self._span: Span | None = None
        self._is_message = False
        self._broken: _Broken | None = None
        self._abandoned: _Broken | None = None
        self._begun_at: Nanos = 0
        self._begun_count = 0
        self.in_flight = 0
        self.left_at: Nanos | None = None
        self._measured_count = 0
        self.rate = 0
        """Characters a second that this line has been seen to carry; 0 while unknown."""

    def put(self, data: bytes, span: Span | None = None) -> None:
        """Say this now. What is left of an utterance before it is not said any more."""
        self._data = data
        self._offset = 0
        self._span = span
        self._is_message = False
        self._broken = None

    def say(self, message: bytes, span: Span | None = None) -> None:
        """Say this message now. One of which a part is out is ended first, and so that the control can take nothing of
        it: what follows would otherwise count as the rest of it, with nothing but the sum to tell them apart.
        """
        broken = self._part_out() or self._abandoned
        self._abandoned = None
        self.put(message, span)
        self._is_message = True
        self._broken = broken

    def break_off(self) -> None:
        """End a message of which a part is out, and say nothing more."""
        broken = self._part_out()
        self.put(b"")
        self._broken = broken

    def abandon(self) -> None:
        """Say nothing more. A message of which a part is out is ended when something is said again."""
        self._abandoned = self._part_out() or self._abandoned
        self.put(b"")

    def begin_anew(self) -> None:
        """The control has been initialised, or waits for packets: it waits for the rest of no message."""
        self._abandoned = None

    def _part_out(self) -> _Broken | None:
        broken = self._broken
        if broken is not None and self._offset < len(broken.ending):
            return _Broken(self._coding, broken.message, broken.out + self._offset)
        out = self._offset - (len(broken.ending) if broken is not None else 0)
        # All of it may be out and still be called back.
        begun = 0 < out < len(self._data) + bool(self.in_flight)
        return _Broken(self._coding, self._data, out) if self._is_message and begun else None

    @property
    def _all(self) -> bytes:
        return self._data if self._broken is None else self._broken.ending + self._data

    @property
    def empty(self) -> bool:
        """All of it has been handed over."""
        return self._offset >= len(self._all)

    @property
    def untouched(self) -> bool:
        """There is something to say, and nothing of it has been handed over."""
        ending = self._broken.ending if self._broken is not None else b""
        return self._offset == 0 and bool(self._data) and not ending

    @property
    def idle(self) -> bool:
        """All of it has left."""
        return self.empty and not self.in_flight

    def look(self, limit: int) -> bytes:
        return self._all[self._offset : self._offset + limit]

    @property
    def reached(self) -> int:
        """Bytes of the program up to the last one handed over; 0 when this is no program."""
        if self._span is None:
            return 0
        handed = self._offset - self._span.header - len(self._all) + len(self._data)
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
            measured = self._begun_count * SECOND // elapsed
            # What a FIFO or an adapter took at once counts as gone, so a short message says too much of the rate.
            longer = self._begun_count >= _MUCH_LONGER * self._measured_count
            self.rate = measured if longer else max(self.rate, measured)
            self._measured_count = self._begun_count if longer else self._measured_count

    def call_back(self, count: int) -> None:
        """The last `count` characters handed over never leave."""
        self.in_flight = max(0, self.in_flight - count)
        before = count - self._offset
        self._offset = max(0, -before)
        if before > 0:
            self._broken = _shortened(self._broken, before)
            self._abandoned = _shortened(self._abandoned, before)

    @property
    def quiet_time(self) -> Nanos:
        """After so long without a character what has been said is over."""
        return QUIET + (_QUIET_CHARACTERS * SECOND // self.rate if self.rate else 0)


class _Broken:
    """A message of which `out` characters are out, and no more shall be (fewer, when some are called back).

    `ending` makes it one that nobody can take: the end code comes early, behind a sum that is sure to be wrong and not
    inside the command, which would be a command error (4.6 2) (2)). The control asks for a repetition and gets
    something else.
    """

    __slots__ = ("coding", "ending", "message", "out")

    def __init__(self, coding: Coding, message: bytes, out: int) -> None:
        self.coding = coding
        self.message = message
        self.out = out
        if out == len(message):
            self.ending = b""
            return
        body = message[:-1][: max(out, _HEADER + 1)].ljust(_HEADER + 1, b"0")
        if coding.encode(checksum(body[2:] + coding.end_byte)) == body[:2]:
            body += b"0"
        self.ending = body[out:] + coding.end_byte


def _shortened(broken: _Broken | None, count: int) -> _Broken | None:
    """`count` characters of it were called back."""
    if broken is None or broken.out <= count:
        return None
    return _Broken(broken.coding, broken.message, broken.out - count)
