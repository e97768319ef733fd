"""The records of DNC LINK as the control takes them in: which is good, which is asked for again, which is the last.

No rule of the text tells a record from its copy, so the control may ask again only where it knows what it will get.
"""

from __future__ import annotations

from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.records import RECORD_BYTES, DncEnd, lrc_of

__all__ = ["Record", "Records"]


class Record:
    """One record on its way in (2.2), at most 256 characters of text."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._characters = bytearray()
        self._end_code = params.rec_end
        self._incomplete = False
        self.damaged = False
        """A character of it came with a wrong parity bit, or is missing (2.2.4)."""

    def __len__(self) -> int:
        return len(self._characters)

    @property
    def text(self) -> bytes:
        """Without blank and rubbed-out tape, which the LRC counts."""
        return bytes(self._characters).translate(None, bytes(self._params.ignore_rx))

    @property
    def is_last(self) -> bool:
        """It ended with the code of a last record."""
        return self._end_code != self._params.rec_end

    def add(self, character: int, *, room: int) -> None:
        """Without room for it, or behind 256 others, the character is lost and the record is bad."""
        if room > 0 and len(self._characters) < RECORD_BYTES:
            self._characters.append(character)
        else:
            self._incomplete = True

    def end(self, code: int) -> None:
        self._end_code = code

    def is_good(self, check: int) -> bool:
        """2.2.4: no character was damaged, and the check character fits."""
        if self.damaged or self._incomplete:
            return False
        return check == lrc_of(bytes(self._characters), self._end_code, self._params.lrc)

    def clear(self) -> None:
        self._characters.clear()
        self._end_code = self._params.rec_end
        self._incomplete = self.damaged = False


class Records:
    """The record that comes in, and what must be known of those before it."""

    def __init__(self, params: Params) -> None:
        self._dnc_end = params.dnc_end
        self.record = Record(params)
        self.refused = 0
        """How often the record now due was refused."""
        self.doubt: str | None = None
        """Why no ACK or NAK would be right any more: the control has to cancel."""
        self._previous: bytes | None = None
        self._previous_was_last = False
        self._asked_after_silence = False

    def judge(self, check: int) -> bytes | None:
        """The text of a good record (4.2.1: ACK); None for a bad one (NAK)."""
        record = self.record
        good = record.is_good(check)
        text = record.text if good else None
        if self._asked_after_silence:
            self.doubt = self._doubt_after_silence(text)
        if text is None:
            self.refused += 1
        else:
            self.refused = 0
            self._previous, self._previous_was_last = text, record.is_last
            self._asked_after_silence = False
        record.clear()
        return text

    def _doubt_after_silence(self, text: bytes | None) -> str | None:
        """A remote that had only paused has two NAKs to come, or had not seen the last ACK: both double a record."""
        if text is None and not self.record.damaged:
            return "the record asked for after a silence is bad too, so where records begin is not known any more"
        if text and text == self._previous:
            return "the record asked for after a silence is the one before it, so an ACK was lost"
        return None

    def refuse_after_silence(self) -> None:
        """The record stopped in the middle: its end was damaged, or the remote has paused."""
        if self._asked_after_silence and not self.record.damaged:
            self.doubt = "the record asked for after a silence stopped in the middle too, so its end is not known here"
        self.record.clear()
        self.refused += 1
        self._asked_after_silence = True

    def complaint_at_end(self) -> str | None:
        """Why EOT cannot be the end of the program here; None if it is."""
        if self.refused:
            return "EOT came in place of the record that was refused"
        if self._dnc_end is DncEnd.ETX_LAST and self._previous is not None and not self._previous_was_last:
            return "EOT came, but the record before it did not end as a last one (dnc_end=etx_last)"
        if self._dnc_end is DncEnd.EMPTY_THEN_EOT and self._previous:
            return "EOT came without the empty record before it (dnc_end=empty_then_eot)"
        return None
