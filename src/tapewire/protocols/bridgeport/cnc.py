"""The control's end of REMOTE LOAD and DNC LINK (the text's clauses 1 to 4): asks, checks, answers, saves, cancels.

     0.001  cnc   DC2
     0.003  host  DC1
     0.004  cnc   77;D DC4
     0.010  cnc   DC1
     0.012  host  N10G1X1F5 CR LF ETB 33
     0.027  cnc   ACK
     0.029  host  N20Y1 CR LF ETB 35
     0.239  cnc   NAK
     0.241  host  N20Y1 CR LF ETB 34
     0.252  cnc   ACK
     0.254  host  EOT

The control asks for everything, and the remote only answers. What the remote says has a meaning by its place, so the
table in `cnc_law` says what a character means in each state; all others are uninvited and change nothing.

The modem lines say nothing in this protocol: a line that holds characters back does so by itself.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import (
    ALL_ON,
    MILLISECOND,
    Closure,
    Event,
    Held,
    LineFault,
    Nanos,
    Outcome,
    Resumed,
    SignalsIn,
    SignalsOut,
    Source,
    Started,
)
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.cnc_core import Timer
from tapewire.protocols.bridgeport.cnc_law import LAW, Act, Cause, State, Word, vocabulary
from tapewire.protocols.bridgeport.cnc_output import Mark
from tapewire.protocols.bridgeport.cnc_reading import Reading
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS
from tapewire.protocols.bridgeport.messages import DUMB, FirstRecord, Name, Params, Parity
from tapewire.protocols.bridgeport.records import Lrc
from tapewire.protocols.settings import Switch

__all__ = ["LAW", "Act", "BridgeportCnc", "State"]

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often a source that has nothing yet is asked again: about nine characters at 9600 baud."""

SAVE_BYTES: Final = 256
"""Characters taken from the source at once."""

_BLANK_TAPE: Final = frozenset((State.TEXT_DUE, State.LOADING, State.RECORD_DUE, State.RECEIVED))
"""Where leader and rubouts are passed over. In a record the LRC counts them."""


_BEHIND_A_NAME: Final = frozenset((State.ASKING, State.TEXT_DUE, State.RECORD_DUE, State.SAVE_OPENING))
"""Where the XOFF that closes a name may still come (closing_dc3)."""


class BridgeportCnc(Reading):
    """The communication of a Bridgeport control: a CncEngine.

    `cycle_start` asks for program `program` in mode `mode`, and `program=-1` only says DC1 and takes what comes;
    `punch` saves a program to the remote; `reset` is the operator's cancel.

    `Ended` of a read: `bytes_low` is what the control has taken out of its buffer, `bytes_high` what came in of the
    text, for DNC LINK in good records. Of a save: what has left the line, and what was handed over to it.
    """

    def __init__(self, params: Params) -> None:
        if params.lrc is Lrc.AUTO:
            raise UsageError("lrc=auto: a control has one way to compute the LRC; name it")
        super().__init__(params)
        self._vocabulary = vocabulary(params)
        self._unanswered = 0
        self._exhausted = False
        self._may_still_send = 0

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        software = self._params.parity is Parity.SOFTWARE
        for byte in data:
            if software and byte.bit_count() % 2:
                self.receive_line_fault(LineFault.PARITY, byte, now)
            else:
                self._receive(byte & SEVEN_BITS, now)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """2.1.4, 2.2.4: a damaged character. Its value counts for nothing, as one wrong bit makes DC1 of DLE."""
        seen = str(fault) if byte is None else f"{fault} ({byte:02X}h)"
        if byte is not None and self._breaks_the_stop():
            return
        match self._state:
            case State.TEXT_DUE | State.LOADING:
                self._fault(f"{seen} after {self._text.received} characters of text, which is fatal (4.1.1)")
            case State.RECORD_DUE | State.RECORD | State.CHECK:
                self._damage_record(byte, now)
            case _:
                self._violation(f"{seen} where no program comes in: ignored")
                self._restart_quiet(now)

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        pass

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._line_closed = True
        self._recalling = False
        self._out.abandon()
        why = f"the line is {closure}: {reason}"
        match self._state:
            case State.IDLE:
                pass
            case State.RECEIVED:
                self._move(Act.LINE_GONE, State.RECEIVED)
                self._owes_xon = False
            case State.CLOSING:
                self._move(Act.LINE_GONE, State.CLOSING)
                if self._ending is Outcome.COMPLETE and self._source is not None:
                    self._ending, self._reason = Outcome.FAILED, why
                self._end_if_left()
            case _:
                self._close(Act.LINE_GONE, Outcome.FAILED, why, b"")

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        if self._recalling or self._line_closed:
            return b""
        return self._out.look(limit, self._may_still_send if self._state is State.PAUSED else limit)

    def data_sent(self, count: int, now: Nanos) -> None:
        while count and self._out.has_codes:
            count -= 1
            self._code_handed_over(self._out.hand_over_code(), now)
        if count:
            self._text_handed_over(count, now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._out.leave(count)
        self._end_if_left()

    def data_discarded(self, count: int, now: Nanos) -> None:
        self._out.call_back(count)
        self._recalling = False
        self._end_if_left()

    @property
    def recall(self) -> bool:
        return self._recalling

    @property
    def signals(self) -> SignalsOut:
        return ALL_ON

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def handle_timer(self, now: Nanos) -> None:
        for timer in self._timers.due(now):
            match timer:
                case Timer.REPEAT:
                    self._say_again()
                case Timer.ANSWER:
                    self._fault(f"no answer for {self._params.answer_limit:g} s")
                case Timer.SILENCE:
                    self._on_silence(now)
                case Timer.QUIET:
                    self._answer_if_possible()
                case Timer.SOURCE:
                    self._fill(now)

    def next_event(self) -> Event | None:
        return self._events.get()

    # the operator and the control

    def _begin(self, source: Source | None) -> None:
        super()._begin(source)
        self._unanswered = 0
        self._exhausted = False

    def cycle_start(self, now: Nanos) -> None:
        """Ask for a program. Raises UsageError while another job runs, and on a closed line."""
        self._require_rest("load")
        self._begin(None)
        if self._is_named:
            self._move(Act.CYCLE_START, State.NAME_OPENING)
            self._say_code(self._params.open_write, Mark.OPEN)
        else:
            self._move(Act.CYCLE_START, State.ASKING)
            self._request()

    def reset(self, now: Nanos) -> None:
        """4.3: the operator cancels. Said also at rest, since the remote may still believe in a job."""
        said = self._params.operator_cancel
        if self._state is State.IDLE and self._idle_cancel and not (self._line_closed or self._out.has_codes):
            self._out.say(said)
        self._interrupt(Act.RESET, Outcome.CANCELLED, "cancelled by the operator of the control", said)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm for a reason of its own."""
        self._interrupt(Act.ALARM, Outcome.FAILED, "an alarm of the control", self._params.parity_cancel)

    def punch(self, source: Source, now: Nanos) -> None:
        """Save a program to the remote (1.2.2). Raises UsageError while another job runs, and on a closed line."""
        self._require_rest("save")
        self._begin(source)
        if self._params.program == DUMB and self._params.bare_save is Switch.ON:
            self._start_saving(Act.SAVE, "the program goes out, as to a tape punch", now)
            return
        self._move(Act.SAVE, State.NAME_OPENING if self._is_named else State.SAVE_OPENING)
        self._say_code(self._params.open_write, Mark.OPEN)

    @property
    def progress(self) -> int:
        return self._text.taken if self._source is None else self._out.saved

    @property
    def buffered(self) -> int:
        return len(self._text)

    @property
    def program_ended(self) -> bool:
        at_end = self._state is State.RECEIVED or self._ending is Outcome.COMPLETE
        return self._source is None and at_end and 0 < self._text.received == self._text.taken

    # what the remote says

    def _receive(self, character: int, now: Nanos) -> None:
        if self._breaks_the_stop():
            return
        if self._state in _BLANK_TAPE and character in self._params.ignore_rx:
            return
        if self._state in _BEHIND_A_NAME and character == self._params.xoff and self._params.closing_dc3 is Switch.ON:
            return
        match self._vocabulary[self._state][character]:
            case Word.READY:
                self._on_ready(character, now)
            case Word.XOFF | Word.XON | Word.CANCEL as word:
                self._on_flow(word)
            case Word.TEXT:
                self._on_text(character, now)
            case Word.TEXT_END:
                self._on_text_end(now)
            case Word.RECORD_END:
                self._on_record_end(character, now)
            case Word.LRC:
                self._on_lrc(character, now)
            case _:
                self._uninvited(now)

    def _on_ready(self, character: int, now: Nanos) -> None:
        """1.1, 1.2.2: the remote's DC1. A DC2 said twice may be answered twice."""
        match self._state:
            case State.NAME_OPENING if self._unanswered:
                self._opened()
                name = Name(number=self._params.program, mode=self._params.mode, raw=b"")
                self._out.say(name.encoded + self._params.name_trailer)
                if self._source is None:
                    self._move(Word.READY, State.ASKING)
                    self._request()
                else:
                    self._move(Word.READY, State.SAVE_OPENING)
                    self._say_code(self._params.open_write, Mark.OPEN)
            case State.SAVE_OPENING if self._unanswered and not self._out.waits(Mark.OPEN):
                self._opened()
                self._start_saving(Word.READY, "the remote is ready for the program", now)
            case State.NAME_OPENING:
                self._uninvited(now)
            case _ if self._unanswered:
                self._unanswered -= 1
                self._move(Word.READY, self._state)
            case State.TEXT_DUE | State.RECORD_DUE:
                self._on_text(character, now)
            case State.SAVING if character == self._params.xon:
                self._on_flow(Word.XON)
            case _:
                self._uninvited(now)

    def _opened(self) -> None:
        self._unanswered -= 1
        self._answer_has_begun()
        self._out.withdraw(Mark.OPEN)

    def _on_flow(self, word: Word) -> None:
        """3.1 and 3.2, from a remote that receives."""
        match word, self._state:
            case Word.CANCEL, _:
                self._recalling = self._out.text_in_flight
                self._cut_off(word, Outcome.CANCELLED, "the remote cancelled what the control sent (3.2)", b"")
            case Word.XOFF, State.SAVING:
                # What is with the UART already leaves whatever is done here: it is some of the three.
                self._may_still_send = max(0, self._params.after_stop - self._out.in_flight)
                self._move(word, State.PAUSED)
                self._events.put(Held(why="XOFF from the remote"))
            case Word.XON, State.PAUSED:
                self._move(word, State.SAVING)
                self._events.put(Resumed(why="XON from the remote"))
                self._end_if_saved()
            case _:
                self._move(word, self._state)
                self._violation(f"the remote said {word.name} where it changes nothing: ignored")

    # 1.2.2: the control saves a program

    def _start_saving(self, cause: Cause, why: str, now: Nanos) -> None:
        self._move(cause, State.SAVING)
        self._events.put(Started(why=why))
        self._fill(now)

    def _fill(self, now: Nanos) -> None:
        assert self._source is not None
        text = self._source.read(SAVE_BYTES)
        if text is None:
            self._timers.start(Timer.SOURCE, now + SOURCE_POLL)
        elif text:
            self._out.chunk = text
        else:
            self._exhausted = True
            self._end_if_saved()

    def _text_handed_over(self, count: int, now: Nanos) -> None:
        self._out.hand_over_text(count)
        if self._state is State.PAUSED:
            self._may_still_send -= count
        if not self._out.chunk:
            self._fill(now)

    def _end_if_saved(self) -> None:
        """A remote that has stopped us gets the end after it has let us go on."""
        if self._exhausted and self._state is State.SAVING:
            self._close(Act.SAVED, Outcome.COMPLETE, "the program has been sent", self._params.save_trailer)

    # what is said, and when

    @property
    def _is_named(self) -> bool:
        return self._params.program != DUMB and self._params.naming is Switch.ON

    def _request(self) -> None:
        """1.2.1 line 1."""
        on_ack = self._linked and self._params.first_record is FirstRecord.ON_ACK
        codes = (self._params.read_request, self._params.ack) if on_ack else (self._params.read_request,)
        self._out.say(bytes(codes), Mark.REQUEST)

    def _say_again(self) -> None:
        if self._state in (State.NAME_OPENING, State.SAVE_OPENING):
            self._say_code(self._params.open_write, Mark.OPEN)
        else:
            self._say_code(self._params.read_request, Mark.REQUEST)

    def _code_handed_over(self, mark: Mark | None, now: Nanos) -> None:
        match mark:
            case Mark.OPEN:
                self._unanswered += 1
                self._start(Timer.REPEAT, self._params.repeat, now)
            case Mark.REQUEST:
                self._requested(now)
            case Mark.ANSWER:
                self._move(Act.ANSWERED, State.RECORD_DUE)
            case Mark.STOP:
                self._stop.dc3_handed_over(self._out.handed)
            case Mark.GO:
                self._start_silence(now)
        waits = self._state in (State.NAME_OPENING, State.SAVE_OPENING, State.TEXT_DUE, State.RECORD_DUE)
        if waits and mark is not None and not self._timers.running(Timer.ANSWER):
            self._start(Timer.ANSWER, self._params.answer_limit, now)

    def _requested(self, now: Nanos) -> None:
        if self._state is State.ASKING:
            self._move(Act.ASKED, State.RECORD_DUE if self._linked else State.TEXT_DUE)
            self._events.put(Started(why="the remote was asked for a program"))
        if self._state in (State.TEXT_DUE, State.RECORD_DUE):
            self._start(Timer.REPEAT, self._params.request_repeat, now)
