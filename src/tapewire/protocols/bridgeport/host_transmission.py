"""A program on its way to the control: as one text (REMOTE LOAD, 2.1) or as records (DNC LINK, 2.2, 4.2).

Both offer the next characters, are told how many were handed over, and know in which state that leaves the host.
"""

from __future__ import annotations

from typing import Final, Protocol

from tapewire.protocols.bridgeport.host_law import State
from tapewire.protocols.bridgeport.host_text import Text
from tapewire.protocols.bridgeport.messages import FirstRecord, Params
from tapewire.protocols.bridgeport.records import (
    LINK_TEXT_BYTES,
    LRC_CANDIDATES,
    DncEnd,
    Lrc,
    cut_length,
    encode_record,
    fitting_length,
    lrc_of,
    tells_candidates_apart,
)
from tapewire.protocols.settings import Switch

__all__ = ["Guess", "LinkRecords", "LoadText", "Transmission"]

RECORD_CODES: Final = 2
"""Behind the text of a record: its end code and its check character (2.2)."""

EMPTY: Final = "the program is empty: nothing was sent"

TRIES_PER_CANDIDATE: Final = 2
"""The second NAK of the first record speaks against the candidate; the first may have been a disturbance."""


class Transmission(Protocol):
    """What the engine needs of either kind. `pump` does what needs the source; `problem` ends the job."""

    state: State
    problem: str
    notices: list[str]

    def pump(self) -> None: ...

    @property
    def starved(self) -> bool:
        """The source had nothing yet: ask again."""
        ...

    def look(self, limit: int) -> bytes:
        """The next characters, without parity."""
        ...

    def hand_over(self, count: int) -> None: ...

    @property
    def position(self) -> int:
        """Bytes of the program handed over."""
        ...

    @property
    def proven(self) -> int | None:
        """Bytes the control has acknowledged; None where it acknowledges nothing."""
        ...


class LoadText:
    """REMOTE LOAD. All of it is read before the first byte goes out, so a text too long sends nothing (2.1.1).

    `guessed`: the name did not say which of the two the control wants, and by DNC LINK it keeps nothing of this.
    """

    def __init__(self, text: Text, params: Params, *, named: bool, guessed: bool = False) -> None:
        self.guessed = guessed
        self.named = named
        self.proven: int | None = 0 if guessed else None
        self._text = text
        self._end_code = bytes([params.text_end])
        self._ends = named or params.dumb_eot is Switch.ON
        self._wire: bytes | None = None
        self._offset = 0
        self.state = State.TEXT
        self.problem = ""
        self.notices: list[str] = []

    def pump(self) -> None:
        if self._wire is not None:
            return
        ready = self._text.fill(LINK_TEXT_BYTES + 1)
        self.problem = self._text.problem
        if not ready:
            return
        if len(self._text.ahead) > LINK_TEXT_BYTES:
            self.problem = (
                f"the program has more than {LINK_TEXT_BYTES:,} bytes, the most that REMOTE LOAD takes (2.1.1); "
                "nothing was sent: ask for it by DNC LINK (;D)"
            )
        elif not self._text.ahead:
            self.problem = EMPTY
        else:
            self._wire = self._text.ahead + (self._end_code if self._ends or self._text.own_end else b"")

    @property
    def starved(self) -> bool:
        return self._wire is None and not self.problem

    def look(self, limit: int) -> bytes:
        return b"" if self._wire is None else self._wire[self._offset : self._offset + limit]

    def hand_over(self, count: int) -> None:
        assert self._wire is not None
        self._offset += count
        if self._offset == len(self._wire):
            self.state = State.TAIL

    @property
    def position(self) -> int:
        return min(self._offset, self._text.count)


class Guess:
    """An unusual name without a letter: 2.1.1 and 2.2.1 say by the length which it must be, once that is known."""

    def __init__(self, text: Text, params: Params) -> None:
        self._text = text
        self._params = params
        self.chosen: LoadText | LinkRecords | None = None
        """What it became. Nothing is sent before."""
        self.state = State.TEXT
        self.problem = ""
        self.notices: list[str] = []
        self.position = 0
        self.proven: int | None = 0

    def pump(self) -> None:
        ready = self._text.fill(LINK_TEXT_BYTES + 1)
        self.problem = self._text.problem
        if ready and len(self._text.ahead) <= LINK_TEXT_BYTES:
            self.chosen = LoadText(self._text, self._params, named=True, guessed=True)
        elif ready:
            self.chosen = LinkRecords(self._text, self._params)

    @property
    def starved(self) -> bool:
        return self.chosen is None and not self.problem

    def look(self, limit: int) -> bytes:
        return b""

    def hand_over(self, count: int) -> None:
        assert not count, "nothing was offered"


class LinkRecords:
    """DNC LINK. Only one record is under way, and the next one goes out when the control has asked for it by ACK."""

    def __init__(self, text: Text, params: Params) -> None:
        self._text = text
        self._params = params
        self._candidate = 0
        self._acked = 0
        self._highest = 0
        self._record = b""
        self._data_bytes = 0
        self._offset = 0
        self._index = 0
        self._naks = 0
        self._asked_again = False
        self._acked_inside = False
        self._copied_unasked = False
        self._wanted = params.first_record is FirstRecord.AT_ONCE
        self._emptied = False
        self.state = State.RECORD if self._wanted else State.WAIT_ACK
        self.problem = ""
        self.notices: list[str] = []
        self._looked_at_length = False

    # what is sent

    def pump(self) -> None:
        self._look_at_length()
        if not self._wanted or self.problem:
            return
        ready = self._text.fill(self._params.record_bytes + 1)
        self.problem = self._text.problem
        if ready and not self._index and not self._text.ahead:
            self.problem = EMPTY
        elif ready:
            self._wanted = False
            self._prepare()

    def _look_at_length(self) -> None:
        """2.2.1 wants more than 12000 bytes; a shorter program is served and the operator told, once that is known."""
        if self._looked_at_length:
            return
        text = self._text
        self._looked_at_length = text.fill(LINK_TEXT_BYTES + 1)
        self.problem = text.problem
        if not self._looked_at_length or not text.exhausted or text.count - text.own_end > LINK_TEXT_BYTES:
            return
        if text.count - text.own_end:
            self.notices.append(f"{text.count:,} bytes by DNC LINK: {LINK_TEXT_BYTES:,} or less are for ;L (2.2.1)")
        else:
            self.problem = EMPTY

    def _prepare(self) -> None:
        ahead = self._text.ahead
        if ahead or (self._params.dnc_end is DncEnd.EMPTY_THEN_EOT and not self._emptied):
            self._emptied = not ahead
            self._prepare_record(ahead)
        else:
            self._record = bytes([self._params.text_end])
            self._data_bytes = 0
            self.state = State.TAIL
        self._offset = 0

    def _prepare_record(self, ahead: bytes) -> None:
        params = self._params
        length = cut_length(ahead, params.record_bytes, params.record_cut, whole=self._text.exhausted)
        assert length is not None, "pump sees to it that enough is known"
        if params.lrc is Lrc.AUTO and not self._index:
            length = fitting_length(ahead, length, lambda data: tells_candidates_apart(data, self._end_code(data)))
        elif params.avoid_lrc_codes is Switch.ON:
            length = fitting_length(ahead, length, self._harmless)
        self._data_bytes = length
        self._encode()
        self.state = State.RECORD

    def _encode(self) -> None:
        data = self._text.ahead[: self._data_bytes]
        self._record = encode_record(data, self._end_code(data), self._lrc)
        if self._is_last(data) and self._params.dnc_end is DncEnd.EOT_AFTER_LRC:
            self._record += bytes([self._params.text_end])

    def _is_last(self, data: bytes) -> bool:
        return self._text.exhausted and len(data) == len(self._text.ahead)

    def _end_code(self, data: bytes) -> int:
        by_etx = self._params.dnc_end is DncEnd.ETX_LAST and self._is_last(data)
        return self._params.rec_end_last if by_etx else self._params.rec_end

    @property
    def _lrc(self) -> Lrc:
        return LRC_CANDIDATES[self._candidate] if self._params.lrc is Lrc.AUTO else self._params.lrc

    def _harmless(self, data: bytes) -> bool:
        params = self._params
        codes = {params.text_end, params.ack, params.nak, params.cancel, params.xon, params.xoff, params.rec_end}
        codes |= {params.open_write, params.write_ready, params.write_close, params.read_request}
        return lrc_of(data, self._end_code(data), self._lrc) not in codes

    @property
    def starved(self) -> bool:
        return self._wanted and not self.problem

    def look(self, limit: int) -> bytes:
        if self._wanted or self.state not in (State.RECORD, State.TAIL):
            return b""
        return self._record[self._offset : self._offset + limit]

    def hand_over(self, count: int) -> None:
        self._offset += count
        self._highest = max(self._highest, self._acked + min(self._offset, self._data_bytes))
        if self._offset < len(self._record):
            return
        if self.state is State.TAIL:
            self._acked += self._text.own_end
            self._highest = self._acked
        elif self._asked_again:
            self._copied_unasked = True
            self._send_again()
        else:
            self.state = State.WAIT_ACK

    # what the control answers

    def ack(self) -> None:
        """4.2.1: the next record, please. What was sent is proven."""
        if self.only_end_is_left:
            self._prove()
            self._record, self._offset, self._data_bytes = self._record[-1:], 0, 0
            self.state = State.TAIL
            return
        if self.state is not State.WAIT_ACK:
            return
        if self._record:
            self._prove()
        if self._record and self._params.dnc_end is DncEnd.EOT_AFTER_LRC and self._finished:
            self._end_here()
            return
        self._wanted = True
        self.state = State.RECORD
        self.pump()

    @property
    def only_end_is_left(self) -> bool:
        """The check character is out, and the end code that goes with it is not: the record may be answered already."""
        return self.state is State.RECORD and self._data_bytes + RECORD_CODES == self._offset < len(self._record)

    def _prove(self) -> None:
        if not self._index and self._params.lrc is Lrc.AUTO:
            self.notices.append(f"the control takes lrc={self._lrc}")
        self._text.take(self._data_bytes)
        self._acked += self._data_bytes
        self._index += 1
        self._naks = 0
        self._acked_inside = False

    @property
    def _finished(self) -> bool:
        return self._text.exhausted and not self._text.ahead

    def _end_here(self) -> None:
        """The end code has gone out behind the last check character."""
        self._acked += self._text.own_end
        self._record, self._offset, self._data_bytes = b"", 0, 0
        self.state = State.TAIL

    def ack_inside(self) -> None:
        """An ACK before the record is complete answers no record of ours, and inside a copy it answers the one before.

        The control then takes the rest of the copy for more of the program.
        """
        self._acked_inside = True
        if self._naks:
            self.problem = f"an ACK came inside a copy of record {self._index + 1}, which the control takes for another"
        elif self._copied_unasked:
            where = "at the end" if self.state is State.TAIL else f"inside record {self._index + 1}"
            self.problem = f"an ACK came {where}, one too many: the control may have taken a record twice"

    def nak(self) -> None:
        """4.2.1: the same record again."""
        if self._acked_inside:
            self.problem = (
                f"an ACK came inside record {self._index + 1} and a NAK behind it: the control may have taken a part "
                "for the whole"
            )
        elif self.state is State.TAIL or (self.state is State.RECORD and (self._wanted or not self._offset)):
            self._refused_before_it_began()
        elif self.state is State.RECORD:
            self._asked_again = True
        elif not self._record:
            self.ack()
        else:
            self._send_again()

    def _refused_before_it_began(self) -> None:
        """A copy that has not begun answers every NAK until then; a second copy would be taken for another record."""
        if self._index and not self._naks:
            self.problem = (
                f"the control answered record {self._index} by ACK and then by NAK: it cannot be told whether it has it"
            )

    def _send_again(self) -> None:
        self._asked_again = False
        self._naks += 1
        if self._naks == self._params.nak_warning and not self._searching:
            doubt = "; the setting of lrc is doubtful" if self._index else ""
            self.notices.append(f"record {self._index + 1} was refused {self._naks} times{doubt}")
        if self._searching and not self._naks % TRIES_PER_CANDIDATE:
            self._try_next_candidate()
        self._offset = 0
        self.state = State.RECORD

    @property
    def _searching(self) -> bool:
        """Which way the control computes is not known before its first ACK, and is never changed after it."""
        return self._params.lrc is Lrc.AUTO and not self._index

    def _try_next_candidate(self) -> None:
        self._candidate += 1
        if self._candidate == len(LRC_CANDIDATES):
            self._candidate = 0
            self.notices.append("the control refuses the first record whatever its check character is; trying again")
        self._encode()

    @property
    def position(self) -> int:
        return self._highest

    @property
    def proven(self) -> int | None:
        return self._acked
