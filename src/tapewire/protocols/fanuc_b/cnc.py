"""The control's end of protocol B and expansion protocol B (B-63322EN-1 chapters 6, 7 and 8): the remote buffer.

     0.001  cnc   DC1
     0.001  host  9192 bytes  "%\\nO0001\\nG01X..."
     5.267  cnc   DC3
     5.267  host  32 bytes  "1.5Y-2.\\nG01X..."
    20.352  cnc   DC1
    20.353  host  2789 bytes  "G01X1.5Y-2.\\n..."
    49.052  cnc   DC3
    50.102  cnc   DC2
    50.103  cnc   373 bytes  "%\\nO0002\\nG00X..."
    50.317  cnc   DC4

The control alone says who may speak: while it reads, every character is program, and its own DC1 and DC3 follow the
free space of the buffer; while it punches out, the host can hold it by CS or by DC3.

Where the manual is silent, or speaks twice, the comment beside the code says what was chosen.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import (
    ALL_ON,
    MILLISECOND,
    AfterStop,
    Alarm,
    Closure,
    Ended,
    Event,
    Events,
    Held,
    LineFault,
    Named,
    Nanos,
    Notice,
    Outcome,
    Resumed,
    SignalsIn,
    SignalsOut,
    Source,
    Started,
    Timers,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.protocols.fanuc_b.cnc_buffer import Latecomers, Output, ReceiveBuffer, StopCount, codes_in
from tapewire.protocols.fanuc_b.cnc_law import LAW, Act, Cause, State
from tapewire.protocols.fanuc_b.cnc_posting import Codes, Posting
from tapewire.protocols.fanuc_b.messages import BUFFER_BYTES, AlarmEnds, ClosingAt, ControlCode, Params

__all__ = ["LAW", "Act", "FanucBCnc", "State"]

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often a source that has nothing yet is asked again: about nine characters at 9600 baud."""

PUNCH_BYTES: Final = 256
"""Characters taken from the source at once: the send buffer of 12.2."""


class _Timer(Named):
    SOURCE = "source"


class FanucBCnc:
    """The remote buffer: a CncEngine.

    `Ended` of a read: `bytes_low` is what the control has taken out of the buffer, `bytes_high` what came in of the
    program, both with EOR. Of a punch-out: what has left the line, and what was handed over to it.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._posting = Posting(params)
        # 6.1.2: with posting ER is ON from power-up to power-off.
        self._er_on = self._posting.on
        self._state = State.IDLE
        self._events = Events()
        self._timers = Timers()
        self.buffer = ReceiveBuffer(params.data, params.g05.record_bytes)
        self._stop = StopCount(params.allowed_overrun)
        self._out = Output(params.code)
        self._recalling = False
        self._source: Source | None = None
        self._exhausted = False
        self._may_still_punch = 0
        self._held = False
        self._owed: ControlCode | None = None
        self._ending = Outcome.COMPLETE
        self._reason = ""
        self._latecomers = Latecomers()

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        while data:
            match self._state:
                case State.READING | State.STOPPED:
                    data = self._receive_program(data)
                case State.PUNCHING | State.PAUSED:
                    data = self._receive_codes(data)
                case _:
                    self._ignore(len(data))
                    return

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        # Chapter 11 names framing and overrun errors; parity errors and breaks are taken for the same.
        seen = str(fault) if byte is None else f"{fault} ({byte:02X}h)"
        match self._state:
            case State.READING | State.STOPPED if not self.buffer.eor_in:
                where = f"after {self.buffer.received} characters of program"
            case State.PUNCHING | State.PAUSED:
                where = f"from the host, {self._out.punched} characters into the punch-out"
            case _:
                self._events.put(Violation(what=f"{seen} while nothing was to come: ignored"))
                return
        self._communication_alarm(Act.LINE_FAULT, AlarmNumber.SR946, f"{seen} {where}")

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        why = self._posting.update(signals)
        if why is not None:
            self._host_gone(why)
        self._note_hold("CS is ON" if signals.cts else "CS is OFF")

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._posting.line_closed = True
        self._host_gone(f"the line is {closure}: {reason}")

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        if self._recalling or not self._posting.may_send:
            return b""
        return self._out.look(limit, self._may_still_punch if self._state is State.PAUSED else limit)

    def data_sent(self, count: int, now: Nanos) -> None:
        while count and self._out.codes:
            count -= 1
            self._code_handed_over(self._out.hand_over_code(), now)
        if count:
            self._program_handed_over(count, now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._out.leave(count)
        if self._state is State.RECEIVED and self._out.codes_have_left:
            self._er_on = self._posting.on
        self._end_if_left()

    def data_discarded(self, count: int, now: Nanos) -> None:
        begun = self._out.call_back(count)
        if self._recalling and not begun and self._out.codes:
            # To the host there was no punch-out, so no DC4 or DC3 is to end it.
            self._out.codes.popleft()
        self._recalling = False
        self._end_if_left()

    @property
    def recall(self) -> bool:
        return self._recalling

    @property
    def signals(self) -> SignalsOut:
        return ALL_ON if self._er_on else SignalsOut(dtr=False)

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def handle_timer(self, now: Nanos) -> None:
        for _ in self._timers.due(now):
            self._fill(now)

    def next_event(self) -> Event | None:
        return self._events.get()

    # the operator and the control

    def cycle_start(self, now: Nanos) -> None:
        """Start to read a program; the DC1 waits until DR and CS are ON.

        Raises UsageError while another job runs, and on a closed line.
        """
        self._require_rest("read")
        self.buffer = ReceiveBuffer(self._params.data, self._params.g05.record_bytes)
        self._source = None
        self._open(Act.CYCLE_START, State.STARTING, ControlCode.DC1)

    def reset(self, now: Nanos) -> None:
        """The operator presses RESET: what runs ends at once, and what was received is lost (6.4, 8.2)."""
        if self._owed is None:
            self._interrupt(Act.RESET, Outcome.CANCELLED, "RESET at the control", ControlCode.SYN)
        else:
            self._interrupt(Act.RESET, Outcome.FAILED, "an alarm of the CNC, ended by RESET", self._owed)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm by itself. That ends the communication, or leaves it to RESET to end it."""
        communicating = self._state in (State.READING, State.STOPPED, State.PUNCHING, State.PAUSED)
        if not (communicating and self._posting.on and self._params.alarm is AlarmEnds.AT_RESET):
            self._interrupt(Act.ALARM, Outcome.FAILED, "an alarm of the CNC", ControlCode.NAK)
            return
        self._move(Act.ALARM, self._state)
        if self._owed is None:
            self._owed = ControlCode.NAK
            self._notice("the control is in alarm; its communication goes on until RESET (6.4 note 1)")

    def punch(self, source: Source, now: Nanos) -> None:
        """Punch a program out; the DC2 waits until DR and CS are ON.

        Raises UsageError while another job runs, and on a closed line.
        """
        self._require_rest("punch out")
        self._source = source
        self._exhausted = False
        self._out.punched = 0
        self._open(Act.PUNCH, State.OPENING, ControlCode.DC2)

    def take(self, count: int, now: Nanos) -> bytes:
        """At most `count` bytes out of the buffer; nothing while the control is in alarm."""
        if count <= 0 or self._owed is not None or not self.buffer:
            return b""
        data = self.buffer.take(count)
        if self.buffer.eor_taken:
            self._finish_read()
        elif self._state is State.STOPPED and self.buffer.free >= self._params.limits.start_at_free:
            self._move(Act.BUFFER_LOW, State.READING)
            self._steer(ControlCode.DC1)
        return data

    @property
    def progress(self) -> int:
        return self.buffer.taken if self._source is None else self._out.punched

    @property
    def buffered(self) -> int:
        return len(self.buffer)

    @property
    def program_ended(self) -> bool:
        return self._source is None and self.buffer.eor_taken

    # 6.1.1 1) and 6.3: the remote buffer receives

    def _receive_program(self, data: bytes) -> bytes:
        """Takes in what changes the state at most once; returns the rest."""
        left = self._out.left
        count = self._stop.room(self.buffer.room(len(data)), left)
        if not count:
            self._overrun()
            return data
        count = self.buffer.receive(data[:count])
        self._stop.add(count, left)
        if self._state is State.READING and self.buffer.free <= self._params.limits.stop_at_free:
            self._move(Act.BUFFER_FULL, State.STOPPED)
            self._steer(ControlCode.DC3)
        if self.buffer.eor_in and self._params.closing is ClosingAt.RECEIVED:
            self._move(Act.EOR_IN, State.RECEIVED)
            self._out.codes.append(ControlCode.DC3)
        # With closing=read the buffer goes on by its levels (6.3): a DC1 may follow that nobody can answer.
        return data[count:]

    def _steer(self, code: ControlCode) -> None:
        """Ask by DC1 or DC3. While CS holds a pair of them back, a third one undoes the second."""
        if len(self._out.codes) > 1:
            self._out.codes.pop()
        else:
            self._out.codes.append(code)

    def _overrun(self) -> None:
        why = self._stop.overflow() or f"the buffer of {BUFFER_BYTES} characters is full"
        self._communication_alarm(Act.OVERRUN, AlarmNumber.SR856, why)

    def _finish_read(self) -> None:
        """6.1.1 1) (7): DC3 when the read is completed."""
        reason = "the program has been read to its EOR"
        if self._state is State.RECEIVED:
            self._close(Act.EOR_TAKEN, Outcome.COMPLETE, reason, ())
        else:
            self._cut_off(Act.EOR_TAKEN, Outcome.COMPLETE, reason, (ControlCode.DC3,))

    def _ignore(self, count: int) -> None:
        """Characters nobody asked for. A host whose job was cut short may still send the overrun of 6.3."""
        if self._state is State.RECEIVED or (self._state is State.CLOSING and self.program_ended):
            self.buffer.ignored += count
            return
        late, uninvited = self._latecomers.split(count, job_over=self._state is not State.CLOSING)
        if late and not self._latecomers.seen:
            self._latecomers.seen = True
            self._notice("what the host still sent when its job had ended is ignored")
        if uninvited:
            what = "the host sent while the control was not reading: ignored"
            self._events.put(Violation(what=what, count=uninvited))

    # 6.1.1 2) and 6.1.2 2): the remote buffer punches out

    def _receive_codes(self, data: bytes) -> bytes:
        """Obeys codes while it punches out; returns the rest."""
        for code, count, end in codes_in(data):
            if code is not None:
                self._obey(code)
            else:
                what = "the host sent what is no code of its own during a punch-out: ignored"
                self._events.put(Violation(what=what, count=count))
            if self._state not in (State.PUNCHING, State.PAUSED):
                return data[end:]
        return b""

    def _obey(self, code: ControlCode) -> None:
        match code:
            case ControlCode.DC3 if self._state is State.PUNCHING:
                self._may_still_punch = self._params.punch_overrun
                self._move(code, State.PAUSED)
                self._note_hold("DC3")
            case self._params.resume_code if self._state is State.PAUSED:
                self._move(code, State.PUNCHING)
                self._note_hold(code.name)
                self._end_if_punched()
            case _:
                self._move(code, self._state)
                self._events.put(Violation(what=f"{code.name} where it cannot steer the punch-out: ignored"))

    def _fill(self, now: Nanos) -> None:
        assert self._source is not None
        data = self._source.read(PUNCH_BYTES)
        if data is None:
            self._timers.start(_Timer.SOURCE, now + SOURCE_POLL)
        elif data:
            self._out.chunk = data
        else:
            self._exhausted = True
            self._end_if_punched()

    def _program_handed_over(self, count: int, now: Nanos) -> None:
        self._out.hand_over_program(count)
        if self._state is State.PAUSED:
            self._may_still_punch -= count
        if not self._out.chunk:
            self._fill(now)

    def _end_if_punched(self) -> None:
        """A host that has paused us gets the DC4 after it has resumed."""
        if self._exhausted and self._state is State.PUNCHING:
            self._close(Act.PUNCHED, Outcome.COMPLETE, "the program has been punched out", (ControlCode.DC4,))

    def _note_hold(self, why: str) -> None:
        punching = self._source is not None and self._state in (State.PUNCHING, State.CLOSING)
        held = self._state is State.PAUSED or (punching and not self._posting.cs)
        if held is not self._held:
            self._held = held
            self._events.put(Held(why=why) if held else Resumed(why=why))

    # 6.1.2 and 6.4: reset and alarm

    def _interrupt(self, cause: Act, outcome: Outcome, reason: str, code: ControlCode) -> None:
        match self._state:
            case State.IDLE:
                self._move(cause, State.IDLE)
                if not self._out.codes:
                    self._out.codes.extend(self._posting.at_rest(code))
            case State.CLOSING:
                self._interrupt_closing(cause, outcome, reason, code)
            case State.STARTING | State.OPENING:
                # Nothing was said to the host: a line that takes nothing must not keep the job from its end.
                self._cut_off(cause, outcome, reason, ())
                self._out.codes.extend(self._posting.at_rest(code))
            case State.RECEIVED:
                self._close(cause, outcome, reason, self._posting.at_rest(code))
            case State.PUNCHING | State.PAUSED:
                # 6.4 note 2: RESET stops a punch-out at once, so what waits in the line is called back.
                self._recalling = cause is Act.RESET and self._out.program_in_flight
                self._cut_off(cause, outcome, reason, self._posting.in_punch(code))
            case State.READING | State.STOPPED:
                self._cut_off(cause, outcome, reason, self._posting.in_read(code))

    def _cut_off(self, cause: Act, outcome: Outcome, reason: str, codes: Codes) -> None:
        """What was still to be said is overtaken by `codes`."""
        self._out.codes.clear()
        self._close(cause, outcome, reason, codes)

    def _interrupt_closing(self, cause: Act, outcome: Outcome, reason: str, code: ControlCode) -> None:
        """A job is over when its last code has left; until then a reset or an alarm ends it otherwise."""
        self._move(cause, State.CLOSING)
        if self._ending is Outcome.COMPLETE:
            self._ending, self._reason = outcome, reason
            self._out.codes.extend(self._posting.added(code))
        if not self._posting.cs:
            # What CS holds back is given up: a DC4 that came later, alone, would make a cut program look whole.
            self._out.abandon()
        self._end_if_left()

    def _communication_alarm(self, cause: Act, number: AlarmNumber, detail: str) -> None:
        """An alarm of the communication itself ends it at once, whatever 6.4 note 1 leaves to RESET."""
        text = text_of(number, detail)
        self._events.put(Alarm(number=number, text=text))
        codes: Codes = ()
        if cause is Act.HOST_GONE:
            self._out.abandon()
        elif self._state in (State.READING, State.STOPPED):
            codes = self._posting.in_read(ControlCode.NAK)
        else:
            codes = self._posting.in_punch(ControlCode.NAK)
        self._cut_off(cause, Outcome.FAILED, f"{number} {text}", codes)

    def _host_gone(self, why: str) -> None:
        match self._state:
            case State.IDLE:
                self._out.abandon()
            case State.STARTING | State.OPENING if not self._posting.line_closed:
                pass  # 3.2: an alarm during data transmission; none has begun
            case State.READING | State.STOPPED | State.RECEIVED if self.buffer.eor_in:
                # The whole program is here, and the control can read it without the host.
                self._move(Act.HOST_GONE, State.RECEIVED)
                self._out.abandon()
                self._er_on = self._posting.on
            case State.CLOSING:
                self._move(Act.HOST_GONE, State.CLOSING)
                if self._ending is Outcome.COMPLETE and self._source is not None:
                    text = text_of(AlarmNumber.SR855, why)
                    self._events.put(Alarm(number=AlarmNumber.SR855, text=text))
                    self._ending, self._reason = Outcome.FAILED, f"SR855 {text}"
                self._out.abandon()
                self._recalling = False
                self._end_if_left()
            case _:
                self._communication_alarm(Act.HOST_GONE, AlarmNumber.SR855, why)

    # how every job begins and ends

    def _require_rest(self, what: str) -> None:
        if self._state is not State.IDLE:
            raise UsageError(f"the control cannot {what} now: {self._state.value}; wait, or press RESET")
        if self._posting.line_closed:
            raise UsageError(f"the control cannot {what}: its line is closed; open the line again")

    def _open(self, act: Act, state: State, code: ControlCode) -> None:
        self._move(act, state)
        self._er_on = True
        self._owed = None
        self._held = False
        self._latecomers = Latecomers()
        self._out.codes.append(code)
        if not self._posting.may_send:
            off = "CS" if self._posting.dr else "DR"
            self._notice(f"the host is not ready, {off} is OFF: {code.name} waits until it is ON")

    def _code_handed_over(self, code: ControlCode, now: Nanos) -> None:
        match self._state, code:
            case State.STARTING, ControlCode.DC1:
                self._move(Act.OPENED, State.READING)
                self._events.put(Started(why="DC1 asks the host for a program"))
            case State.STOPPED, ControlCode.DC3:
                self._stop.dc3_handed_over(self._out.handed)
            case State.OPENING, ControlCode.DC2:
                self._move(Act.OPENED, State.PUNCHING)
                self._events.put(Started(why="DC2 announces a punch-out"))
                self._out.begin_program()
                self._fill(now)

    def _move(self, cause: Cause, to: State) -> None:
        assert to in LAW[self._state, cause], f"{self._state} {cause} {to}"
        if self._state is State.STOPPED and to is not State.STOPPED:
            self._events.put(AfterStop(count=self._stop.count, allowed=self._params.allowed_overrun))
            self._stop = StopCount(self._params.allowed_overrun)
        self._state = to

    def _close(self, cause: Act, outcome: Outcome, reason: str, codes: Codes) -> None:
        """All of the job is over but its last codes: those that still wait, and `codes`."""
        self._latecomers = Latecomers(0 if self.program_ended else self._params.allowed_overrun)
        self._ending, self._reason = outcome, reason
        self._timers.stop_all()
        self.buffer.clear()
        self._out.chunk = b""
        if self._source is not None and not codes:
            self._out.abandon()
        self._out.codes.extend(codes)
        self._held = self._held and outcome is Outcome.COMPLETE
        self._move(cause, State.CLOSING)
        self._end_if_left()

    def _end_if_left(self) -> None:
        if self._state is not State.CLOSING or self._recalling or not self._out.codes_have_left:
            return
        self._move(Act.CLOSED, State.IDLE)
        # 6.4 (1): without posting ER is OFF after the last code; that a whole read ends so too is by analogy.
        self._er_on = self._posting.on
        self._owed = None
        self._held = False
        if self._source is not None:
            low, high = self._out.punched_left, self._out.punched
        else:
            low, high = self.buffer.taken, self.buffer.received
            if self.buffer.ignored:
                self._notice(f"{self.buffer.ignored} characters after EOR were ignored (8.2)")
        self._events.put(Ended(outcome=self._ending, reason=self._reason, bytes_low=low, bytes_high=high))

    def _notice(self, text: str) -> None:
        self._events.put(Notice(text=text))
