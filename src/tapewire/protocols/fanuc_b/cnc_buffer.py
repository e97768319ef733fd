"""What the remote buffer holds, in each direction (B-63322EN-1 6.3, 8.2, 12.2)."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from typing import Final

from tapewire.codes import DataCode
from tapewire.fanuc.tape import TapeScanner
from tapewire.protocols.fanuc_b.messages import BUFFER_BYTES, CodeSystem, ControlCode, code_of, encode

__all__ = ["Latecomers", "Output", "ReceiveBuffer", "StopCount", "codes_in"]

_HOST_CODES: Final = re.compile(rb"[\x11-\x13\x93]")


class ReceiveBuffer:
    """One program on its way from the line to the control. It ends at EOR; what follows is ignored (8.2)."""

    def __init__(self, code: DataCode, record_bytes: int | None = None) -> None:
        self._scanner = TapeScanner(code, record_bytes)
        self._data = bytearray()
        self.received = 0
        """Characters of program that came in, EOR included."""
        self.taken = 0
        """Those that the control has taken out."""
        self.ignored = 0
        """Characters that came after EOR."""

    def __len__(self) -> int:
        return len(self._data)

    @property
    def held(self) -> bytes:
        return bytes(self._data)

    @property
    def free(self) -> int:
        return BUFFER_BYTES - len(self._data)

    def room(self, count: int) -> int:
        """How many of `count` characters it bears: all of them when they will be ignored."""
        return count if self.eor_in else min(count, self.free)

    @property
    def eor_in(self) -> bool:
        return self._scanner.ended

    @property
    def eor_taken(self) -> bool:
        return self.eor_in and self.taken == self.received

    def receive(self, data: bytes) -> int:
        """Take characters up to EOR in, or ignore all after it; how many of `data` that was."""
        if self.eor_in:
            self.ignored += len(data)
            return len(data)
        program = data[: self._scanner.feed(data)]
        self._data += program
        self.received += len(program)
        return len(program)

    def take(self, count: int) -> bytes:
        data = bytes(self._data[:count])
        del self._data[:count]
        self.taken += len(data)
        return data

    def clear(self) -> None:
        self._data.clear()


class StopCount:
    """Characters that come after the DC3 of one stop has left completely (6.3)."""

    def __init__(self, allowed: int) -> None:
        self.count = 0
        self._allowed = allowed
        self._dc3_at: int | None = None

    def dc3_handed_over(self, position: int) -> None:
        self._dc3_at = position

    def counting(self, left: int) -> bool:
        """`left` characters have left the line: is the DC3 one of them?"""
        return self._dc3_at is not None and left >= self._dc3_at

    def room(self, count: int, left: int) -> int:
        """How many of `count` characters are tolerated."""
        return min(count, self._allowed - self.count) if self.counting(left) else count

    def add(self, count: int, left: int) -> None:
        if self.counting(left):
            self.count += count

    def overflow(self) -> str | None:
        """One more character came. Says so if that is more than is tolerated."""
        if self.count < self._allowed:
            return None
        self.count += 1
        return f"more than {self._allowed} characters came after DC3"


class Latecomers:
    """Characters that nobody reads. `allowed` of them may come: they were on their way when a job ended."""

    def __init__(self, allowed: int = 0) -> None:
        self._allowed = allowed
        self.seen = False

    def split(self, count: int, *, job_over: bool) -> tuple[int, int]:
        """How many of `count` come late, and how many are a violation. Before the job is over all are late."""
        late = min(count, self._allowed) if job_over else count
        if job_over:
            self._allowed -= late
        return late, count - late


def codes_in(data: bytes) -> Iterator[tuple[ControlCode | None, int, int]]:
    """What a host says during a punch-out: (code, or None for what is none; how many characters; where they end)."""
    at = 0
    for found in _HOST_CODES.finditer(data):
        if found.start() > at:
            yield None, found.start() - at, found.start()
        at = found.end()
        yield code_of(data[at - 1]), 1, at
    if at < len(data):
        yield None, len(data) - at, len(data)


class Output:
    """What goes to the line, codes before the punched program, and how much of it has left.

    Positions count every character handed over since the line was opened.
    """

    def __init__(self, system: CodeSystem) -> None:
        self._system = system
        self.codes: deque[ControlCode] = deque()
        """Not handed over yet."""
        self.chunk = b""
        """Program read from the source, not handed over yet."""
        self.punched = 0
        """Characters of this program handed over."""
        self.handed = 0
        self.left = 0
        self._code_at = 0
        self._program_at = 0

    def begin_program(self) -> None:
        """The DC2 has been handed over: from here on characters are program."""
        self.punched = 0
        self._program_at = self.handed

    @property
    def punched_left(self) -> int:
        """Characters of this program that have left."""
        return min(max(self.left - self._program_at, 0), self.punched)

    @property
    def program_in_flight(self) -> bool:
        return self.punched_left < self.punched

    @property
    def codes_have_left(self) -> bool:
        return not self.codes and self.left >= self._code_at

    def look(self, limit: int, program: int) -> bytes:
        """The next characters: the codes, or at most `program` characters of program."""
        if self.codes:
            return b"".join(encode(code, self._system) for code in self.codes)[:limit]
        return self.chunk[: min(limit, program)]

    def hand_over_code(self) -> ControlCode:
        self.handed += 1
        self._code_at = self.handed
        return self.codes.popleft()

    def hand_over_program(self, count: int) -> None:
        assert count <= len(self.chunk)
        self.chunk = self.chunk[count:]
        self.handed += count
        self.punched += count

    def leave(self, count: int) -> None:
        self.left = min(self.left + count, self.handed)

    def call_back(self, count: int) -> bool:
        """The last `count` characters never leave. False if even the DC2 was among them."""
        self.handed = max(self.left, self.handed - count)
        self.punched = min(self.punched, max(self.handed - self._program_at, 0))
        self._code_at = min(self._code_at, self.handed)
        return self.handed >= self._program_at

    def abandon(self) -> None:
        """Codes that wait are not sent, and those handed over are not waited for."""
        self.codes.clear()
        self._code_at = 0
