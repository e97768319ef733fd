"""How the control takes a program in: its text, its records, and what holds the remote (clauses 1.2.1, 2, 3 and 4)."""

from __future__ import annotations

from tapewire.engine import AfterStop, Nanos, Outcome, Source, Violation
from tapewire.protocols.bridgeport.cnc_buffer import Latecomers, StopCount, TapeEndFinder, strange_characters
from tapewire.protocols.bridgeport.cnc_core import Core, Timer
from tapewire.protocols.bridgeport.cnc_law import Act, Cause, State, Word
from tapewire.protocols.bridgeport.cnc_output import Mark
from tapewire.protocols.bridgeport.cnc_records import Records
from tapewire.protocols.bridgeport.messages import (
    DUMB,
    NAME_BYTES,
    STOP_CHARACTERS,
    Hold,
    Mode,
    Params,
    StopBreach,
    TapeEnd,
)
from tapewire.protocols.bridgeport.records import LINK_TEXT_BYTES, RECORD_BYTES, DncEnd
from tapewire.protocols.settings import Switch

__all__ = ["Reading"]


class Reading(Core):
    """REMOTE LOAD and DNC LINK behind the request."""

    def __init__(self, params: Params) -> None:
        super().__init__(params)
        self._linked = False
        self._records = Records(params)
        self._tape_end = TapeEndFinder(TapeEnd.EOT)
        self._stop = StopCount()
        self._owes_xon = False

    def _begin(self, source: Source | None) -> None:
        super()._begin(source)
        dumb = self._params.program == DUMB
        self._linked = self._params.mode is Mode.LINK and not dumb
        self._records = Records(self._params)
        self._tape_end = TapeEndFinder(self._params.tape_end if dumb else TapeEnd.EOT)
        self._owes_xon = False

    def _close(self, cause: Cause, outcome: Outcome, reason: str, codes: bytes) -> None:
        if self._stop.active:
            self._end_stop()
        self._owes_xon = False
        super()._close(cause, outcome, reason, codes)

    # text, and records of it

    def take(self, count: int, now: Nanos) -> bytes:
        """At most `count` bytes out of the buffer; of DNC LINK only good records are in it."""
        text = self._text.take(max(count, 0))
        if text:
            self._resume_if_low(now)
            self._answer_if_possible()
            self._end_if_taken()
        return text

    def _on_text(self, character: int, now: Nanos) -> None:
        if self._linked:
            self._add_to_record(character, now)
        elif self._text.received == LINK_TEXT_BYTES:
            self._fault(f"more than {LINK_TEXT_BYTES} characters, which is too long for REMOTE LOAD (2.1.1)")
        elif not self._free:
            self._fault(f"the buffer of {self._params.buffer} characters is full, and still the remote sends")
        else:
            self._move(Word.TEXT, State.LOADING)
            self._answer_has_begun()
            self._store(bytes([character]))
            self._start_silence(now)
            if self._tape_end.is_last(character):
                self._end_reception()
            else:
                self._stop_if_full()

    def _add_to_record(self, character: int, now: Nanos) -> None:
        self._move(Word.TEXT, State.RECORD)
        self._answer_has_begun()
        self._records.record.add(character, room=self._free)
        self._start_silence(now)
        self._stop_if_full()

    def _on_record_end(self, code: int, now: Nanos) -> None:
        self._move(Word.RECORD_END, State.CHECK)
        self._answer_has_begun()
        self._records.record.end(code)
        self._start_silence(now)

    def _damage_record(self, byte: int | None, now: Nanos) -> None:
        """2.2.4: the record is bad. Where nothing was read, a character may be missing, so none is counted."""
        self._records.record.damaged = True
        if self._state is not State.CHECK:
            self._add_to_record(byte or 0, now)
        elif byte is not None:
            self._on_lrc(byte, now)

    def _store(self, text: bytes) -> None:
        self._text.store(text)
        if strange := strange_characters(text):
            what = "characters of the text belong to no program: stored as they are"
            self._events.put(Violation(what=what, count=strange))

    def _on_text_end(self, now: Nanos) -> None:
        records = self._records
        if self._state is State.ANSWERING and records.refused:
            # The bad copy of a last record brings its EOT with it (dnc_end=eot_after_lrc).
            self._move(Word.TEXT_END, State.ANSWERING)
            self._restart_quiet(now)
        elif self._state is State.RECORD_DUE and records.refused and self._params.dnc_end is DncEnd.EOT_AFTER_LRC:
            self._move(Word.TEXT_END, State.RECORD_DUE)
        elif complaint := records.complaint_at_end() if self._linked else None:
            self._fault(complaint)
        elif not self._text.received:
            why = "EOT without any text before it: the remote has no such program"
            self._cut_off(Word.TEXT_END, Outcome.FAILED, why, b"")
        else:
            self._end_reception()

    def _end_reception(self) -> None:
        """1.2.1 line 3: the program is in, and the remote is done with."""
        self._timers.stop_all()
        self._out.withdraw(Mark.ANSWER)
        if self._state is State.ANSWERING and self._params.dnc_end is DncEnd.EOT_AFTER_LRC:
            # The EOT that came with the last record is no answer to our ACK: the remote still waits for it, and it
            # asks for nothing that would need room.
            self._out.say(bytes([self._params.ack]))
        self._move(Word.TEXT_END, State.RECEIVED)
        self._latecomers = Latecomers(STOP_CHARACTERS)
        if self._stop.active:
            self._end_stop()
            withdrawn = self._out.withdraw(Mark.STOP)
            self._owes_xon = self._params.late_xon is Switch.ON and not withdrawn
        received = self._text.received
        if received <= NAME_BYTES:
            self._notice(f"a program of {received} characters is shorter than nine (1.1)")
        if self._linked and received <= LINK_TEXT_BYTES:
            self._notice(f"DNC LINK is for more than {LINK_TEXT_BYTES} characters (2.2.1), and this has {received}")
        self._end_if_taken()

    def _end_if_taken(self) -> None:
        if self._state is State.RECEIVED and not self._text:
            self._close(Act.TAKEN, Outcome.COMPLETE, "the program has been read to its end", b"")

    def _answer_has_begun(self) -> None:
        self._timers.stop(Timer.ANSWER)
        self._timers.stop(Timer.REPEAT)

    def _start_silence(self, now: Nanos) -> None:
        in_text = self._state in (State.LOADING, State.RECORD, State.CHECK)
        if in_text and not self._stop.active:
            limit = self._params.record_timeout if self._linked else self._params.load_timeout
            self._start(Timer.SILENCE, limit, now)

    def _on_silence(self, now: Nanos) -> None:
        if self._state is State.LOADING:
            after = f"after {self._text.received} characters of text"
            self._fault(f"nothing came for {self._params.load_timeout:g} s {after}")
            return
        self._move(Act.SILENCE, State.ANSWERING)
        self._records.refuse_after_silence()
        self._answer(now)

    # 4.2: records are answered

    def _on_lrc(self, check: int, now: Nanos) -> None:
        self._move(Word.LRC, State.ANSWERING)
        self._timers.stop(Timer.SILENCE)
        text = self._records.judge(check)
        if text is None:
            self._start(Timer.QUIET, self._params.nak_quiet, now)
        elif self._records.doubt is None:
            self._store(text)
        self._answer(now)

    def _answer(self, now: Nanos) -> None:
        refused = self._records.refused
        if self._records.doubt is not None:
            self._fault(self._records.doubt)
        elif 0 < self._params.nak_limit < refused:
            self._fault(f"a record was bad {refused} times running (nak_limit)")
        else:
            self._resume_if_low(now)
            self._answer_if_possible()

    def _answer_if_possible(self) -> None:
        """ACK when the next record may come, NAK when the line is quiet; neither while XOFF holds the remote."""
        if self._state is not State.ANSWERING or self._out.waits(Mark.ANSWER) or self._stop.active:
            return
        if self._records.refused:
            if not self._timers.running(Timer.QUIET):
                self._say_code(self._params.nak, Mark.ANSWER)
        elif self._params.hold is Hold.XOFF or self._free >= RECORD_BYTES:
            self._say_code(self._params.ack, Mark.ANSWER)

    # 3: the buffer holds the remote

    @property
    def _free(self) -> int:
        return self._text.free - len(self._records.record)

    def _stop_if_full(self) -> None:
        """3.1: XOFF in the data of a record, be it the one record of REMOTE LOAD."""
        if self._linked and self._params.hold is Hold.ACK:
            return
        if not self._stop.active and self._free <= self._params.stop_at_free:
            self._move(Act.BUFFER_FULL, self._state)
            self._stop.begin()
            self._timers.stop(Timer.SILENCE)
            self._say_code(self._params.xoff, Mark.STOP)

    def _resume_if_low(self, now: Nanos) -> None:
        if not (self._stop.active or self._owes_xon) or self._free < self._params.xon_at_free:
            return
        self._move(Act.BUFFER_LOW, self._state)
        self._owes_xon = False
        if self._out.withdraw(Mark.STOP):
            self._stop.end()
            self._start_silence(now)
            return
        if self._stop.active:
            self._end_stop()
        self._say_code(self._params.xon, Mark.GO)

    def _end_stop(self) -> None:
        self._events.put(AfterStop(count=self._stop.count, allowed=STOP_CHARACTERS))
        self._stop.end()

    def _breaks_the_stop(self) -> bool:
        """A character comes: True if it is one too many after XOFF (3.2) and that ends the job."""
        if not self._stop.character_came(self._out.left):
            return False
        what = f"more than {STOP_CHARACTERS} characters came after XOFF (3.2)"
        self._violation(what)
        if self._params.stop_breach is StopBreach.REPORT:
            return False
        self._fault(what)
        return True
