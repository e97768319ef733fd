"""The text of a program on its way out: read ahead from its source, and looked at before it is sent."""

from __future__ import annotations

from typing import Final

from tapewire.codes import first_outside, name_of
from tapewire.engine import Source
from tapewire.protocols.bridgeport.code_table import CodeTable
from tapewire.protocols.bridgeport.text import TEXT

__all__ = ["Text"]

READ_BYTES: Final = 4096
"""Bytes asked of the source at once."""


class Text:
    """A program's bytes in order. What would forge a code of the protocol is never handed out.

    One end code as the very last byte is the program's own end, as on a tape: it is sent as the end code.
    """

    def __init__(self, source: Source, codes: CodeTable) -> None:
        self._source = source
        self._end_code = bytes([codes.text_end])
        self.ahead = b""
        """What has been read and not taken."""
        self.count = 0
        """Bytes read so far."""
        self.exhausted = False
        self.own_end = False
        self.problem = ""
        """Why no more of it may be sent; empty while there is no reason."""

    def fill(self, least: int) -> bool:
        """Have at least `least` bytes ahead, or all there are. False: the source has nothing yet, or nothing fit."""
        while not self.exhausted and len(self.ahead) < least:
            data = self._source.read(max(least - len(self.ahead), READ_BYTES))
            if data is None:
                return False
            if data and self.own_end:
                self._refuse(self._end_code[0], self.count)
            if self.problem:
                return False
            self._append(data)
        return not self.problem

    def take(self, count: int) -> None:
        """The next `count` bytes are done with."""
        self.ahead = self.ahead[count:]

    def _append(self, data: bytes) -> None:
        self.exhausted = not data
        offset = first_outside(data, TEXT)
        if offset is not None and offset == len(data) - 1 and data[offset:] == self._end_code:
            self.own_end = True
        elif offset is not None:
            self._refuse(data[offset], self.count + offset + 1)
            return
        self.count += len(data)
        self.ahead += data[:-1] if self.own_end else data

    def _refuse(self, byte: int, position: int) -> None:
        self.problem = (
            f"byte {position:,} of the program is {name_of(byte)}, which the control could take for a code: remove it"
        )
