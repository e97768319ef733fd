"""The program a host of protocol A is to deliver: read ahead by what one DAT or packet holds, and never more."""

from __future__ import annotations

from enum import Enum

from tapewire.codes import EOR_CODES, DataCode
from tapewire.engine import Source
from tapewire.fanuc.tape import TapeScanner
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.program import EMPTY, Scrutiny

__all__ = ["Job", "Supply", "end_of_record"]


class Supply(Enum):
    """What the source has for the next DAT or packet."""

    FULL = "full"
    """As much as it holds, and more behind it."""
    LAST = "last"
    """The rest of the program, which fits."""
    LATE = "late"
    """Not yet as much as it holds, and not the end."""


class Job:
    """One program on its way. `taken` bytes of it have been put into DATs or packets."""

    def __init__(self, source: Source, params: Params) -> None:
        self._source = source
        self._ahead = bytearray()
        self._exhausted = False
        self._tape = TapeScanner(params.data, params.g05.record_bytes)
        self._scrutiny = Scrutiny(params)
        self.taken = 0
        self.refusal = ""
        """Why nothing of what has been read ahead may be sent; empty while it may."""

    def supply(self, size: int) -> Supply:
        """Read ahead until `size` bytes and one more are at hand, or the source has no more for now."""
        while not self._exhausted and len(self._ahead) <= size:
            chunk = self._source.read(size + 1 - len(self._ahead))
            if chunk is None:
                return Supply.LATE
            self._exhausted = not chunk
            self._ahead += chunk
            self.refusal = self.refusal or self._scrutiny.look(chunk)
        if self._exhausted and not self.taken and not self._ahead:
            self.refusal = EMPTY
        return Supply.LAST if len(self._ahead) <= size else Supply.FULL

    @property
    def at_hand(self) -> int:
        """Bytes read and not taken."""
        return len(self._ahead)

    @property
    def all_taken(self) -> bool:
        """The source has ended and nothing is left of it."""
        return self._exhausted and not self._ahead

    def take(self, size: int) -> bytes:
        """The next bytes, at most `size`."""
        data = bytes(self._ahead[:size])
        del self._ahead[:size]
        self.taken += len(data)
        self._tape.feed(data)
        return data

    @property
    def has_ended_the_tape(self) -> bool:
        """EOR is among what has been taken: the control looks at nothing behind it (8.2)."""
        return self._tape.ended


def end_of_record(data: DataCode) -> bytes:
    """The byte that ends a program; binary data has none."""
    return EOR_CODES[data][:1]
