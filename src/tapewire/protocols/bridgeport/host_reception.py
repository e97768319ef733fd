"""What the control sends between our go-ahead and its end code (1.1, 1.2.2): a name, or a program on its way to a sink.

Which of the two is known by the length, so the first characters wait until it is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from tapewire.codes import CR, DEL, LF, NUL
from tapewire.engine import LineFault, Sink
from tapewire.protocols.bridgeport.code_table import CodeTable
from tapewire.protocols.bridgeport.messages import Name, classify

__all__ = ["FEED", "Reception", "marks_of"]

HEAD_BYTES: Final = 64
"""More than this is a program, whatever it says: a name of eight characters with a trailer is far shorter."""


FEED: Final = bytes((NUL, DEL, CR, LF))
"""What is nothing of a program where it stands alone: blank tape and line ends."""


def marks_of(codes: CodeTable) -> re.Pattern[bytes]:
    """What is not text between the go-ahead and the end of what the control sends."""
    marks = codes.upload_ends | codes.ignore_rx | {codes.xon, codes.xoff, codes.cancel, codes.open_write}
    return re.compile(b"[" + re.escape(bytes(sorted(marks))) + b"]")


class Reception:
    """One name or program. `place` is asked for a sink when a program is recognised; None: nobody wants it.

    More than `limit` bytes are not kept: `problem` then says so, and what follows is dropped.
    """

    def __init__(self, place: Callable[[], Sink | None], limit: int, behind: str = "") -> None:
        self._place = place
        self._limit = limit
        self.behind = behind
        """What came before it and has no end: the head of it, if it is a program. A name is said again whole."""
        self._head = bytearray()
        self._sink: Sink | None = None
        self._is_program = False
        self.count = 0
        """Characters that have come in."""
        self._reported = 0
        self.stored = 0
        """Bytes given to the sink."""
        self.damage = ""
        """The first thing that makes it doubtful; empty while there is none."""
        self.problem = ""

    @property
    def kept(self) -> bool:
        """It is a program and somebody wants it."""
        return self._sink is not None

    def take(self, text: bytes) -> None:
        """More of it."""
        self.count += len(text)
        if self._is_program:
            self._store(text)
            return
        self._head += text
        if len(self._head) > HEAD_BYTES:
            self._begin_program()

    def line_fault(self, fault: LineFault, byte: int | None) -> None:
        """A damaged character is kept as it was read, so that the place can be found."""
        self.damage = self.damage or f"{fault} at byte {self.count + 1:,}"
        if byte is not None:
            self.take(bytes([byte]))

    def finish(self) -> Name | None:
        """The end code has come: the name it was, or None for a program, which is with the sink now."""
        if not self._is_program:
            name = classify(bytes(self._head))
            if name is not None:
                return name
            self._begin_program()
        return None

    def break_off(self) -> None:
        """No end of it comes any more: what is longer than a name was a program (1.1)."""
        if not self._is_program and classify(bytes(self._head)) is None:
            self._begin_program()

    @property
    def unended(self) -> str:
        """What the next one comes behind, if no end of this one came; empty while nothing of it has come."""
        if self.behind:
            return self.behind
        if self.count:
            return f"behind {self.count:,} character{'s' * (self.count > 1)} without an end"
        return f"behind damage ({self.damage})" if self.damage else ""

    @property
    def is_feed(self) -> bool:
        """Nothing has come that a program could lack."""
        return not (self._is_program or self.behind or self.damage or self._head.strip(FEED))

    def unreported(self) -> int:
        """Bytes stored since the last call."""
        count = self.stored - self._reported
        self._reported = self.stored
        return count

    def _begin_program(self) -> None:
        self._is_program = True
        if self.behind:
            self.damage = f"begun {self.behind}"
        self._sink = self._place()
        head, self._head = bytes(self._head), bytearray()
        self._store(head)

    def _store(self, text: bytes) -> None:
        if self._sink is None or self.problem:
            return
        if self.stored + len(text) > self._limit:
            self.problem = f"the control sent more than {self._limit:,} bytes; what came before is kept"
            text = text[: self._limit - self.stored]
        self._sink.write(text)
        self.stored += len(text)
