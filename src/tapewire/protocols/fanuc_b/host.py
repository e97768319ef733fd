"""The host computer's end of protocol B and expansion protocol B (B-63322EN-1 6.1, 6.4, chapter 7).

    cnc   DC1                  the control starts to read
    host  program ...          as fast as the line goes
    cnc   DC3                  its buffer is nearly full
    host  (stops)              what is on its way may still arrive: the overrun
    cnc   DC1
    host  ... program %        goes on with the next byte
    cnc   DC3                  it has read EOR: the end

Everything hangs on one thing: DC3 means "stop" and "the end" and "I was reset", and DC1 means "go on" and "start".
What tells them apart is how much has been sent since the last DC1, whether ER fell, and whether the control posts SYN
and NAK. Where nothing tells them apart, the host stops and says so; it never goes on in the middle on a guess.
"""

from __future__ import annotations

from typing import Final, Literal

from tapewire.engine import (
    SECOND,
    Closure,
    Held,
    LineFault,
    Nanos,
    Notice,
    Outcome,
    Received,
    Requested,
    Resumed,
    SignalsIn,
    Started,
    Violation,
)
from tapewire.protocols.fanuc_b.host_job import Job
from tapewire.protocols.fanuc_b.host_law import (
    DAMAGED_WAIT,
    DC4_LATE,
    ER_FELL,
    ER_ROSE,
    FEED,
    LAW,
    LOOKS_LIKE_RESET,
    MAY_BE_NOTICE,
    NO_LAST_DC3,
    NOTICES,
    READ_AND_ER_OFF,
    RISK_BLIND,
    RISK_POWER,
    SOURCE_POLL,
    STALE,
    TIMED_ENDS,
    State,
    Timer,
)
from tapewire.protocols.fanuc_b.host_signs import Er
from tapewire.protocols.fanuc_b.messages import ControlCode, code_of
from tapewire.protocols.settings import Switch

__all__ = ["LAW", "FanucBHost", "State"]

_SENDING: Final = frozenset({State.SENDING, State.HELD, State.DELIVERED})


class FanucBHost(Job):
    """A host computer on protocol B (or expansion B: the params say which). A HostEngine.

    When a job does not end complete, `Ended.bytes_low` are the program bytes that had left before the control can have
    said what ended it, and `bytes_high` all that were handed over: protocol B has no acknowledgement.
    """

    def hold_reception(self, now: Nanos) -> None:
        """Pause the punch-out, or the next one (6.1.1 2) (3)). The control may still send its overrun."""
        before, goes_on = self._pause.wanted, self._state in (State.LISTENING, State.RECEIVING)
        self._pause.wanted = goes_on or (before and self._state is State.AFTER_DC4)
        if self._pause.cs_off and not before and not self._signs.are_shown:
            self._events.put(Violation(what="pause=cs pauses nothing: this line has no control lines"))

    def release(self, now: Nanos) -> None:
        """Let the paused punch-out go on (6.1.1 2) (4), 6.1.2 (4))."""
        self._pause.wanted = False
        self._listen_for_notice(now)

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        position = 0
        while position < len(data):
            if self._state is State.RECEIVING:
                position = self._receive_punched(data, position, now)
            elif self._state is State.AFTER_DC4 and self._still_program(data[position]):
                continue
            else:
                if self._state is State.AFTER_DC4 and self._reception is not None:
                    self._reception.behind_dc4(data[position])
                self._receive_character(data[position], now)
                position += 1

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """Never obeyed as DC1. While we send, the control says nothing that does not begin with DC3: so it stops us."""
        self._events.put(Violation(what=f"{fault} in what the control sent"))
        self._signs.was_damaged = True
        self._delivery.may_be_over(now)
        match self._state:
            case State.SENDING:
                self._state, self._held_by_damage = State.HELD, True
                self._events.put(Held(why=f"{fault}: it may have been DC3"))
                self._timers.start(Timer.DAMAGED, now + DAMAGED_WAIT)
            case State.HELD:
                self._timers.start(Timer.DAMAGED, now + DAMAGED_WAIT)
            case State.CLOSING if self._params.posting is Switch.ON:
                self._end(Outcome.FAILED, f"sent whole, then damage ({fault}): {MAY_BE_NOTICE}", now)
            case State.RECEIVING | State.AFTER_DC4:
                assert self._reception is not None
                before = self._reception.stored
                self._reception.line_fault(fault, byte)
                self._note_stored(before)
            case _:
                pass

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        """Host CTS is the control's RS, host DSR its ER (3.2)."""
        if self._signs.see_rs(signals.cts) and self._state is State.SENDING:
            self._events.put(Resumed(why="RS is ON again") if signals.cts else Held(why="the control's RS is OFF"))
        match self._signs.see_er(signals.dsr, now):
            case Er.FELL:
                self._on_er_fell(now)
            case Er.ROSE if self._timers.running(Timer.ER_FELL):
                self._end(Outcome.FAILED, ER_ROSE, now)
            case Er.ROSE if self._state in _SENDING and self._delivery.is_past_beginning(now):
                self._end(Outcome.FAILED, ER_ROSE, now)

    def _on_er_fell(self, now: Nanos) -> None:
        """6.4 (1): a reset or an alarm, or what comes with the last DC3 or DC4. A late source is asked first."""
        if self._state in (State.SENDING, State.HELD) and not self._supply.ahead:
            self._fill(now)
        if self._signs.er_ends_the_read(self._state, self._delivery):
            self._end(*READ_AND_ER_OFF, now)
        elif self._state is State.AFTER_DC4:
            self._finish_reception(now)
        elif self._state is State.RECEIVING:
            self._timers.start(Timer.ER_FELL, now + DC4_LATE)
        elif self._may_be_the_end and self._signs.last_dc3_may_follow_er(self._delivery):
            self._delivery.may_be_over(now)
            self._timers.start(Timer.ER_FELL, now + self._delivery.heard_late)
        elif self._state in _SENDING or self._state is State.CLOSING:
            self._fail_by_er(now)

    @property
    def _may_be_the_end(self) -> bool:
        """Of the program: nothing more of it is at hand, and a late source has not said yet whether that was all."""
        return self._state in _SENDING and not self._supply.ahead

    def _fail_by_er(self, now: Nanos) -> None:
        sent_whole = self._reception is None and self._supply.is_over and not self._delivery.in_flight
        self._end(Outcome.FAILED, NO_LAST_DC3 if sent_whole else ER_FELL, now)

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        """The end of a TCP line counts as ER OFF."""
        ends = self._signs.hanging_up_ends_the_read(self._state, self._delivery)
        if ends and closure is Closure.ORDERLY:
            self._end(Outcome.COMPLETE, "the control has read the whole program and closed the line", now)
        elif self._state is State.AFTER_DC4 and closure is Closure.ORDERLY:
            self._finish_reception(now)
        elif self._state not in (State.IDLE, State.LEAVING):
            self._end(Outcome.FAILED, f"the line is gone: {reason}", now)
        if self._state is State.LEAVING:
            self._finish()

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        if self._state in (State.RECEIVING, State.AFTER_DC4):
            return self._pause.code_due
        if self._state is State.SENDING and self._signs.rs:
            return self._supply.ahead[:limit]
        return b""

    def data_sent(self, count: int, now: Nanos) -> None:
        self._delivery.hand_over(count)
        if self._state in (State.RECEIVING, State.AFTER_DC4):
            self._pause.told = self._pause.wanted
            self._listen_for_notice(now)
            return
        self._supply.take(count)
        self._fill(now)

    # time and what happened

    def handle_timer(self, now: Nanos) -> None:
        for timer in self._timers.due(now):
            match timer:
                case Timer.SOURCE:
                    self._fill(now)
                case Timer.NOTICE:
                    self._finish_reception(now)
                case Timer.LEAVING:
                    self._finish()
                case Timer.ER_FELL:
                    self._fail_by_er(now)
                case Timer.CLOSING | Timer.DAMAGED | Timer.EARLY_STOP:
                    self._end(*TIMED_ENDS[timer], now)

    # what the control says

    def _receive_character(self, byte: int, now: Nanos) -> None:
        code = code_of(byte)
        if code is not None:
            self._receive_code(code, now)
        elif self._state is not State.LEAVING and byte not in FEED:
            self._events.put(Violation(what="the control sent characters that are no control codes"))

    def _receive_code(self, code: ControlCode, now: Nanos) -> None:
        if self._state is State.LEAVING:
            return
        allowed = LAW.get((self._state, code))
        if allowed is None:
            self._events.put(Violation(what=f"{code.name} while {self._state.value}"))
            return
        match code:
            case ControlCode.DC1:
                self._on_dc1(now)
            case ControlCode.DC2:
                self._state = State.RECEIVING
                self._events.put(Started(why="DC2: the control punches out"))
            case ControlCode.DC3:
                self._on_dc3(now)
            case ControlCode.DC4:
                self._state = State.AFTER_DC4
                self._timers.stop(Timer.ER_FELL)
                self._listen_for_notice(now)
            case ControlCode.NAK | ControlCode.SYN:
                self._on_notice(code, now)
        assert self._state in allowed, f"{code.name} led to {self._state}"

    def _on_dc1(self, now: Nanos) -> None:
        """6.1.1 1) (2), (6)."""
        for timer in (Timer.DAMAGED, Timer.CLOSING, Timer.EARLY_STOP):
            self._timers.stop(timer)
        damaged = self._signs.was_damaged
        self._held_by_damage = self._signs.was_damaged = self._signs.dc3_may_be_reset = False
        match self._state:
            case State.ARMED:
                self._events.put(Requested())
                if self._delivery.on_the_way:
                    self._end(Outcome.FAILED, STALE, now)
                    return
                if not self._signs.sees_er:
                    self._events.put(Notice(text=RISK_BLIND if self._signs.blind else RISK_POWER))
                self._events.put(Started(why="DC1: from the first byte of the program"))
                self._delivery.start(now)
                self._begin_sending(now)
            case State.HELD:
                self._delivery.start(now)
                self._events.put(Resumed(why="DC1"))
                self._begin_sending(now)
            case State.DELIVERED if damaged:
                self._delivery.goes_on()
                self._events.put(Resumed(why="DC1: what came damaged was a stop; nothing is left to send"))
            case State.SENDING | State.DELIVERED if self._delivery.sent and not self._signs.er:
                self._end(Outcome.FAILED, f"DC1 with no stop before it: {LOOKS_LIKE_RESET}", now)
            case State.SENDING | State.DELIVERED:
                self._events.put(Violation(what="DC1 with no stop before it"))
            case State.CLOSING:
                self._delivery.goes_on()
                self._state = State.DELIVERED
                self._events.put(Resumed(why="DC1: the control reads on; nothing is left to send"))
            case _:
                self._events.put(Requested(served=False))

    def _on_dc3(self, now: Nanos) -> None:
        """6.1.1 1) (4), (8). Without posting and without ER this may be a reset (see the module's docstring)."""
        which: Literal["first", "again"] = (
            "again" if self._signs.follows_a_stop(self._state, self._delivery) else "first"
        )
        if self._held_by_damage:
            self._state, self._held_by_damage = State.SENDING, False
        if self._state is State.SENDING and not self._supply.ahead:
            self._fill(now)
        if self._state is State.LEAVING:
            return
        self._signs.hear_dc3(self._delivery, which, now)
        match self._state:
            case State.DELIVERED | State.CLOSING:
                self._on_closing_dc3(now)
            case State.RECEIVING:
                self._end(Outcome.FAILED, "the control stopped in the middle of its punch-out (DC3)", now)
            case State.HELD if self._supply.is_over and self._signs.dc3_may_be_end:
                self._state = State.CLOSING
                self._on_closing_dc3(now)
            case State.HELD:
                self._on_second_dc3(now)
            case _:
                self._on_sending_dc3(now)

    def _on_sending_dc3(self, now: Nanos) -> None:
        """A stop (6.1.1 1) (4)), or where nothing else tells of one, a reset."""
        if self._signs.blind and not self._delivery.may_have_filled_the_buffer:
            self._end(Outcome.FAILED, f"DC3 before the buffer can have filled: {LOOKS_LIKE_RESET}", now)
            return
        self._state = State.HELD
        self._certain = self._delivery.certain(now)
        self._timers.stop(Timer.DAMAGED)
        self._events.put(Held(why="DC3"))
        if not self._delivery.may_have_filled_the_buffer:
            self._doubt_stop("DC3 before the buffer can have filled", now)

    def _on_second_dc3(self, now: Nanos) -> None:
        """No stop, and no proof of the end: a reset may have thrown away what left just before, or overtaken it."""
        if self._signs.blind:
            self._end(Outcome.FAILED, f"a second DC3 with no DC1 between: {LOOKS_LIKE_RESET}", now)
            return
        if self._state is State.DELIVERED:
            self._certain = self._delivery.certain(now)
        self._state = State.HELD
        for timer in (Timer.DAMAGED, Timer.CLOSING):
            self._timers.stop(timer)
        self._doubt_stop("a second DC3 with no DC1 between", now)

    def _doubt_stop(self, what: str, now: Nanos) -> None:
        """A control that posts says SYN or NAK after a DC3 that is no stop. If nothing says so and ER cannot be seen,
        it may not post at all, and a late DC1 would be a start: it must not get the middle.
        """
        self._events.put(Notice(text=what))
        if not self._signs.sees_er or (self._supply.is_over and self._signs.dc3_may_be_reset):
            self._await_dc1_soon(now)

    def _await_dc1_soon(self, now: Nanos) -> None:
        self._timers.start(Timer.EARLY_STOP, now + round(self._params.early_stop * SECOND))

    def _on_closing_dc3(self, now: Nanos) -> None:
        """The end of the read, unless it can be a stop, or SYN or NAK follows it (6.1.1 1) (7), 6.1.2 (7)).

        While something is on its way the control cannot have read EOR: then it is a stop, or a reset.
        """
        if self._delivery.in_flight:
            self._on_sending_dc3(now)
            return
        if not self._signs.dc3_may_be_end:
            self._on_second_dc3(now)
            return
        wait = self._signs.wait_behind_last_dc3(self._state, self._delivery)
        self._state = State.CLOSING
        if not self._signs.dc3_may_be_reset:
            self._certain = self._delivery.certain(self._signs.dc3_at)
        for timer in (Timer.DAMAGED, Timer.EARLY_STOP):
            self._timers.stop(timer)
        if self._timers.running(Timer.ER_FELL):
            if self._signs.er_ends_the_read(self._state, self._delivery):
                self._end(*READ_AND_ER_OFF, now)
        elif wait:
            self._timers.start(Timer.CLOSING, now + wait)
        else:
            self._end(*TIMED_ENDS[Timer.CLOSING], now)

    def _on_notice(self, code: ControlCode, now: Nanos) -> None:
        """SYN is a reset, NAK an alarm (6.1.2, 6.4)."""
        end = self._signs.end_by_notice(code, self._state, self._delivery, now)
        if end is None:
            self._events.put(Notice(text=f"the control {NOTICES[code][1]}"))
        else:
            self._end(*end, now)

    # reception

    def _receive_punched(self, data: bytes, position: int, now: Nanos) -> int:
        """Returns where the next character to look at stands."""
        assert self._reception is not None
        before = self._reception.stored
        position, code = self._reception.read(data, position)
        self._note_stored(before)
        if code is not None:
            self._receive_code(code, now)
        return position

    def _note_stored(self, before: int) -> None:
        assert self._reception is not None
        if count := self._reception.stored - before:
            self._events.put(Received(count=count))

    def _listen_for_notice(self, now: Nanos) -> None:
        """After DC4, from when nothing of ours holds the control back: in binary data the DC4 may be program, and what
        shows it may be held back by our own pause.
        """
        paused = self._pause.wanted or self._pause.told
        if self._state is State.AFTER_DC4 and not paused and not self._timers.running(Timer.NOTICE):
            self._timers.start(Timer.NOTICE, now + round(self._params.notice_time * SECOND))

    def _begin_sending(self, now: Nanos) -> None:
        self._state = State.SENDING
        if not self._signs.rs:
            self._events.put(Held(why="the control's RS is OFF"))
        self._fill(now)

    def _still_program(self, byte: int) -> bool:
        assert self._reception is not None
        if not self._reception.still_program(byte):
            return False
        self._timers.stop(Timer.NOTICE)
        self._state = State.RECEIVING
        return True

    def _finish_reception(self, now: Nanos) -> None:
        assert self._reception is not None
        notice, damage = self._reception.undecided_notice, self._reception.damage
        if notice is not None:
            self._on_notice(notice, now)
        elif damage:
            self._end(Outcome.FAILED, f"received to its end, but damaged: {damage}", now)
        else:
            self._end(Outcome.COMPLETE, "the control has punched out everything", now)

    def _fill(self, now: Nanos) -> None:
        """Keep the next bytes at hand, and notice the end of the program with its last byte."""
        if not self._supply.fill():
            self._timers.start(Timer.SOURCE, now + SOURCE_POLL)
        elif self._supply.ahead and self._timers.running(Timer.ER_FELL):
            self._fail_by_er(now)
        elif self._supply.is_over and self._state is State.SENDING:
            self._state = State.DELIVERED
        elif self._supply.is_over and self._state is State.HELD and not self._held_by_damage:
            if self._signs.dc3_may_be_end:
                self._state = State.DELIVERED
                self._on_closing_dc3(now)
            elif self._signs.dc3_may_be_reset:
                self._await_dc1_soon(now)
