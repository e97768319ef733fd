"""Holds a recorded dialogue of REMOTE LOAD or DNC LINK against its text, as far as that is known."""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

from tapewire.codes import name_of
from tapewire.engine import Nanos
from tapewire.protocols.bridgeport.messages import NAME_BYTES, STOP_CHARACTERS, Params, classify
from tapewire.protocols.bridgeport.records import (
    LINK_TEXT_BYTES,
    LRC_CANDIDATES,
    RECORD_BYTES,
    Lrc,
    lrc_of,
    record_end_codes,
)
from tapewire.protocols.listening import Word
from tapewire.protocols.settings import End

__all__ = ["Listener"]

_CHECK: Final = re.compile(r"LRC=([0-9A-F]{2})")
KEPT: Final = LINK_TEXT_BYTES + 1
"""Characters of a text that are kept: one more than it may have."""


def _name(code: int) -> str:
    return name_of(code).split()[0]


class Listener:
    """Does every check character fit, by which way of computing it, and was XOFF obeyed."""

    def __init__(self, params: Params) -> None:
        self._lrc = params.lrc
        self._ends = {_name(code): code for code in record_end_codes(params, params.dnc_end)}
        self._open_write, self._cancel = _name(params.open_write), _name(params.cancel)
        self._upload_ends = frozenset(map(_name, params.upload_ends))
        self._xoff, self._xon, self._text_end = _name(params.xoff), _name(params.xon), _name(params.text_end)
        self._ack, self._nak = _name(params.ack), _name(params.nak)
        self._text = bytearray()
        self._said = bytearray()
        self._end: int | None = None
        self._after: int | None = None
        self._votes: Counter[Lrc] = Counter()
        self._records = self._refused = self._most_after = 0
        self.evidence = 0

    def heard(self, who: End, word: Word, began: Nanos, ended: Nanos) -> list[str]:
        if who is End.HOST:
            return self._host_says(word)
        if isinstance(word, bytes):
            self._said += word[: NAME_BYTES + 1]
            del self._said[NAME_BYTES + 1 :]
        else:
            self._control_says(word)
        return []

    def _control_says(self, word: str) -> None:
        if word in self._upload_ends:
            name = classify(bytes(self._said)) if self._said else None
            self.evidence += 3 if name is not None and name.usual else 0
        if word == self._xoff:
            self._after = 0
        elif word in (self._xon, self._cancel):
            self._after = None
        if word in (self._ack, self._nak) and self._records:
            self.evidence += 1
            self._refused += word == self._nak
        self._said.clear()

    def _host_says(self, word: Word) -> list[str]:
        wrong = self._after_xoff(len(word) if isinstance(word, bytes) else 1)
        if isinstance(word, bytes):
            self._text += word[: KEPT - len(self._text)]
        elif check := _CHECK.fullmatch(word):
            wrong += self._record(int(check[1], 16))
        elif word in self._ends:
            self._end = self._ends[word]
        elif word == self._text_end:
            if self._text:
                # REMOTE LOAD: no record before it has taken the text.
                self.evidence += 2
                if len(self._text) > LINK_TEXT_BYTES:
                    wrong.append(f"a text of more than {LINK_TEXT_BYTES} characters in REMOTE LOAD (2.1.1)")
            self._text.clear()
        elif word != self._xon:
            self.evidence -= 2
        return wrong

    def _record(self, check: int) -> list[str]:
        data, end = bytes(self._text), self._end
        self._text.clear()
        self._end = None
        if end is None:
            return []
        self._records += 1
        fitting = [lrc for lrc in LRC_CANDIDATES if lrc_of(data, end, lrc) == check]
        leader = self._leader()
        self._votes.update(fitting)
        self.evidence += 3 if fitting else -1
        wrong = [f"a record of more than {RECORD_BYTES} characters (2.2.3)"] if len(data) > RECORD_BYTES else []
        if not fitting:
            wrong.append(f"check character {check:02X} fits its record by no known way")
        elif leader is not None and leader not in fitting:
            wrong.append(f"check character {check:02X} does not fit its record by {leader}, as those before did")
        return wrong

    def _leader(self) -> Lrc | None:
        """What fitted most records so far; the set one where it is among those."""
        if not self._votes:
            return None
        most = max(self._votes.values())
        best = [lrc for lrc in LRC_CANDIDATES if self._votes[lrc] == most]
        return self._lrc if self._lrc in best else best[0]

    def _after_xoff(self, count: int) -> list[str]:
        if self._after is None:
            return []
        before, self._after = self._after, self._after + count
        self._most_after = max(self._most_after, self._after)
        if before <= STOP_CHARACTERS < self._after:
            return [f"more than {STOP_CHARACTERS} characters after XOFF (3.2)"]
        return []

    def summary(self) -> list[str]:
        said = []
        if self._records:
            leader = self._leader()
            fits = f"lrc={leader} fits {self._votes[leader]} of them" if leader is not None else "none fits any way"
            said.append(f"{self._records} records, {self._refused} refused by NAK; {fits}")
        if self._most_after:
            said.append(f"at most {self._most_after} characters after XOFF, {STOP_CHARACTERS} are allowed (3.2)")
        return said
