"""How every job of the control's end begins and ends, and what is common to loading and saving."""

from __future__ import annotations

from typing import Final

from tapewire.engine import SECOND, Alarm, Ended, Events, Named, Nanos, Notice, Outcome, Source, Timers, Violation
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.cnc_buffer import Latecomers, TextBuffer
from tapewire.protocols.bridgeport.cnc_law import LAW, Act, Cause, State
from tapewire.protocols.bridgeport.cnc_output import Mark, Output
from tapewire.protocols.bridgeport.messages import STOP_CHARACTERS, Params
from tapewire.protocols.settings import Switch

__all__ = ["Core", "Timer"]

ALARM_NUMBER: Final = "0040"
"""What users of these controls report as the communications error."""


class Timer(Named):
    REPEAT = "DC2, or the request, is said again"
    ANSWER = "the remote has not answered"
    SILENCE = "nothing comes in the middle of text"
    QUIET = "the line is quiet enough for NAK"
    SOURCE = "the source may have more"


class Core:
    """One job after another, and what has to be said about each."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state = State.IDLE
        self._events = Events()
        self._timers = Timers()
        self._out = Output(params.parity)
        self._text = TextBuffer(params.buffer)
        self._source: Source | None = None
        self._recalling = False
        self._line_closed = False
        self._ending = Outcome.COMPLETE
        self._reason = ""
        self._latecomers = Latecomers()

    def _begin(self, source: Source | None) -> None:
        self._source = source
        self._out.saved = 0
        self._text = TextBuffer(self._params.buffer)
        self._ending = Outcome.FAILED
        self._latecomers = Latecomers()

    def _require_rest(self, what: str) -> None:
        if self._state is not State.IDLE:
            raise UsageError(f"the control cannot {what} now: {self._state.value}; wait, or cancel")
        if self._line_closed:
            raise UsageError(f"the control cannot {what}: its line is closed; open the line again")

    def _move(self, cause: Cause, to: State) -> None:
        assert to in LAW[self._state, cause], f"{self._state} {cause} {to}"
        self._state = to

    def _start(self, timer: Timer, seconds: float, now: Nanos) -> None:
        """0 s is for ever, and for NAK at once."""
        if seconds:
            self._timers.start(timer, now + round(seconds * SECOND))

    def _say_code(self, code: int, mark: Mark) -> None:
        self._out.say(bytes([code]), mark)

    def _fault(self, why: str) -> None:
        """4.1.1, 4.3.1: the control gives the transfer up and asks the remote to cancel it."""
        text = f"COMMUNICATIONS ERROR: {why}"
        self._events.put(Alarm(number=ALARM_NUMBER, text=text))
        self._cut_off(Act.FAULT, Outcome.FAILED, f"{ALARM_NUMBER} {text}", self._params.parity_cancel)

    def _interrupt(self, cause: Act, outcome: Outcome, reason: str, codes: bytes) -> None:
        match self._state:
            case State.IDLE:
                self._move(cause, State.IDLE)
            case State.CLOSING:
                self._move(cause, State.CLOSING)
                if self._ending is Outcome.COMPLETE:
                    self._ending, self._reason = outcome, reason
                    self._out.say(codes)
            case State.RECEIVED:
                self._cut_off(cause, outcome, reason, codes if self._idle_cancel and not self._line_closed else b"")
            case _:
                self._recalling = self._out.text_in_flight
                self._cut_off(cause, outcome, reason, codes)

    @property
    def _idle_cancel(self) -> bool:
        return self._params.idle_cancel is Switch.ON

    def _cut_off(self, cause: Cause, outcome: Outcome, reason: str, codes: bytes) -> None:
        """What was still to be said is overtaken by `codes`."""
        self._out.drop_codes()
        self._close(cause, outcome, reason, codes)

    def _close(self, cause: Cause, outcome: Outcome, reason: str, codes: bytes) -> None:
        """All of the job is over but its last codes: those that still wait, and `codes`."""
        if self._state is not State.RECEIVED:
            self._latecomers = Latecomers(STOP_CHARACTERS)
        self._ending, self._reason = outcome, reason
        self._timers.stop_all()
        self._text.clear()
        self._out.chunk = b""
        self._out.say(codes)
        self._move(cause, State.CLOSING)
        self._end_if_left()

    def _end_if_left(self) -> None:
        if self._state is not State.CLOSING or self._recalling or not self._out.codes_have_left:
            return
        if self._ending is Outcome.COMPLETE and self._out.text_in_flight:
            return
        self._move(Act.CLOSED, State.IDLE)
        if self._source is not None:
            low, high = self._out.saved_left, self._out.saved
        else:
            low, high = self._text.taken, self._text.received
        self._events.put(Ended(outcome=self._ending, reason=self._reason, bytes_low=low, bytes_high=high))

    def _uninvited(self, now: Nanos) -> None:
        match self._state:
            case State.IDLE | State.RECEIVED | State.CLOSING:
                over = self._state is not State.CLOSING
                if not self._latecomers.may_come(job_over=over):
                    self._violation("the remote sent what nobody asked for: ignored")
                elif not self._latecomers.seen:
                    self._latecomers.seen = True
                    self._notice("what the remote still sent when its job had ended is ignored")
            case State.ANSWERING:
                self._violation("the remote sent more before it was answered: ignored")
                self._restart_quiet(now)
            case _:
                self._violation(f"the remote sent what means nothing here ({self._state.value}): ignored")

    def _restart_quiet(self, now: Nanos) -> None:
        if self._timers.running(Timer.QUIET):
            self._start(Timer.QUIET, self._params.nak_quiet, now)

    def _violation(self, what: str) -> None:
        self._events.put(Violation(what=what))

    def _notice(self, text: str) -> None:
        self._events.put(Notice(text=text))
