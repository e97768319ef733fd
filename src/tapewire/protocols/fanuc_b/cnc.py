"""The control's end of protocol B and expansion protocol B (B-63322EN-1 chapters 6, 7 and 8): the remote buffer.

     0.000  cnc   DC1
     0.002  host  7680 bytes  "%\\nO0001\\nG91..."
     4.403  cnc   DC3
     4.403  host  48 bytes  "X1.5Y-2.\\nX1...."
     9.870  cnc   DC1
     9.871  host  1210 bytes  "G01X3.\\nX4.Y..."
    14.210  cnc   DC3
    14.210  cnc   -- complete: the program has been read to its EOR
    20.000  cnc   DC2
    20.001  cnc   412 bytes  "%\\nO0002\\nG00..."
    20.237  cnc   DC4

The control alone says who may speak: while it reads, every character is program, and only its own DC1 and DC3 and
the free space of the buffer steer; while it punches, the host can hold it by CS or by DC3.

Where the manual is silent, or speaks twice, the comment beside the code says what was chosen.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import Enum
from typing import Final, TypeAlias

from tapewire.engine import (
    MILLISECOND,
    AfterStop,
    Alarm,
    Closure,
    Ended,
    Event,
    Events,
    Held,
    LineFault,
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
from tapewire.fanuc.tape import TapeScanner
from tapewire.protocols.fanuc_b.messages import (
    BUFFER_BYTES,
    EXPANSION_B,
    AlarmEnds,
    ClosingAt,
    ControlCode,
    Params,
    code_of,
    encode,
)
from tapewire.protocols.settings import Switch

__all__ = ["LAW", "Act", "FanucBCnc", "State"]

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often a source that has nothing yet is asked again: half a dozen characters at 9600 baud."""

PUNCH_BYTES: Final = 256
"""Characters taken from the source at once: the remote buffer's own send buffer (12.2)."""

CROSSING: Final = 1
"""Characters that may cross the end of a punch-out unblamed: the host's DC3 on its way against our DC4."""


class State(Enum):
    """Where the control's communication stands."""

    IDLE = "at rest"
    STARTING = "a read was started, its DC1 waits for the line"
    READING = "the host may send"
    STOPPED = "the host was told to stop, the buffer is full enough"
    RECEIVED = "the program is in and the host is done with, the control reads the rest"
    OPENING = "a punch-out was started, its DC2 waits for the line"
    PUNCHING = "the program goes out"
    PAUSED = "the host has sent DC3"
    CLOSING = "the last codes are on their way"


class Act(Enum):
    """What moves the control, besides the codes a host sends during a punch-out."""

    CYCLE_START = "cycle start"
    PUNCH = "punch-out"
    RESET = "RESET"
    ALARM = "an alarm of the CNC"
    OPENED = "the first DC1 or DC2 was handed over"
    BUFFER_FULL = "little is free"
    BUFFER_LOW = "enough is free again"
    EOR_IN = "EOR came in"
    EOR_TAKEN = "the control has taken EOR"
    PUNCHED = "the source is at its end"
    OVERRUN = "more came after DC3 than the buffer bears"
    LINE_FAULT = "a damaged character"
    HOST_GONE = "DR OFF, or the line is closed"
    CLOSED = "the last code has left"


class _Timer(Enum):
    SOURCE = "source"


Cause: TypeAlias = ControlCode | Act

_S, _A, _C = State, Act, ControlCode
_END: Final = frozenset({State.CLOSING})

LAW: Final[Mapping[tuple[State, Cause], frozenset[State]]] = {
    (_S.IDLE, _A.CYCLE_START): frozenset({_S.STARTING}),
    (_S.IDLE, _A.PUNCH): frozenset({_S.OPENING}),
    (_S.IDLE, _A.RESET): frozenset({_S.IDLE}),
    (_S.IDLE, _A.ALARM): frozenset({_S.IDLE}),
    (_S.STARTING, _A.OPENED): frozenset({_S.READING}),
    (_S.STARTING, _A.RESET): _END,
    (_S.STARTING, _A.ALARM): _END,
    (_S.STARTING, _A.HOST_GONE): _END,
    (_S.READING, _A.BUFFER_FULL): frozenset({_S.STOPPED}),
    (_S.READING, _A.EOR_IN): frozenset({_S.READING, _S.RECEIVED}),
    (_S.READING, _A.EOR_TAKEN): _END,
    (_S.READING, _A.RESET): _END,
    (_S.READING, _A.ALARM): frozenset({_S.READING, _S.CLOSING}),
    (_S.READING, _A.LINE_FAULT): _END,
    (_S.READING, _A.HOST_GONE): frozenset({_S.RECEIVED, _S.CLOSING}),
    (_S.STOPPED, _A.BUFFER_LOW): frozenset({_S.READING}),
    (_S.STOPPED, _A.EOR_IN): frozenset({_S.STOPPED, _S.RECEIVED}),
    (_S.STOPPED, _A.EOR_TAKEN): _END,
    (_S.STOPPED, _A.RESET): _END,
    (_S.STOPPED, _A.ALARM): frozenset({_S.STOPPED, _S.CLOSING}),
    (_S.STOPPED, _A.OVERRUN): _END,
    (_S.STOPPED, _A.LINE_FAULT): _END,
    (_S.STOPPED, _A.HOST_GONE): frozenset({_S.RECEIVED, _S.CLOSING}),
    (_S.RECEIVED, _A.EOR_TAKEN): _END,
    (_S.RECEIVED, _A.RESET): _END,
    (_S.RECEIVED, _A.ALARM): _END,
    (_S.RECEIVED, _A.HOST_GONE): frozenset({_S.RECEIVED}),
    (_S.OPENING, _A.OPENED): frozenset({_S.PUNCHING}),
    (_S.OPENING, _A.RESET): _END,
    (_S.OPENING, _A.ALARM): _END,
    (_S.OPENING, _A.HOST_GONE): _END,
    (_S.PUNCHING, _C.DC1): frozenset({_S.PUNCHING}),
    (_S.PUNCHING, _C.DC2): frozenset({_S.PUNCHING}),
    (_S.PUNCHING, _C.DC3): frozenset({_S.PAUSED}),
    (_S.PUNCHING, _A.PUNCHED): _END,
    (_S.PUNCHING, _A.RESET): _END,
    (_S.PUNCHING, _A.ALARM): frozenset({_S.PUNCHING, _S.CLOSING}),
    (_S.PUNCHING, _A.LINE_FAULT): _END,
    (_S.PUNCHING, _A.HOST_GONE): _END,
    (_S.PAUSED, _C.DC1): frozenset({_S.PAUSED, _S.PUNCHING}),
    (_S.PAUSED, _C.DC2): frozenset({_S.PAUSED, _S.PUNCHING}),
    (_S.PAUSED, _C.DC3): frozenset({_S.PAUSED}),
    (_S.PAUSED, _A.RESET): _END,
    (_S.PAUSED, _A.ALARM): frozenset({_S.PAUSED, _S.CLOSING}),
    (_S.PAUSED, _A.LINE_FAULT): _END,
    (_S.PAUSED, _A.HOST_GONE): _END,
    (_S.CLOSING, _A.RESET): _END,
    (_S.CLOSING, _A.ALARM): _END,
    (_S.CLOSING, _A.HOST_GONE): _END,
    (_S.CLOSING, _A.CLOSED): frozenset({_S.IDLE}),
}
"""(state, what happens) -> where the control may then be. The engine asserts every move against it."""


class FanucBCnc:
    """The remote buffer: a CncEngine.

    `Ended` of a read: `bytes_low` is what the control has taken out of the buffer, `bytes_high` what came in of the
    program, both with EOR. Of a punch-out: what has left the line, and what was handed over to it.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._limits = params.limits
        self._posting = params.posting is Switch.ON
        # 6.1.2: with posting ER is ON from power-up to power-off.
        self._er_on = self._posting
        self._state = State.IDLE
        self._events = Events()
        self._timers = Timers()
        self._signals_in = SignalsIn()
        self._line_closed = False
        # Positions count every character handed over since the line was opened.
        self._handed = 0
        self._left = 0
        self._code_at = 0
        self._codes: deque[ControlCode] = deque()
        self._recalling = False
        self._ending = Outcome.COMPLETE
        self._reason = ""
        self._owed: ControlCode | None = None
        self._late_allowed = 0
        self._late_seen = False
        self._begin_read()
        self._begin_punch(None)

    def _begin_read(self) -> None:
        self._scanner = TapeScanner(self._params.data)
        self._buffer = bytearray()
        self._received = 0
        self._taken = 0
        self._after_eor = 0
        self._program_ended = False
        self._after_stop = 0
        self._stop_at: int | None = None

    def _begin_punch(self, source: Source | None) -> None:
        self._source = source
        self._chunk = b""
        self._punched = 0
        self._data_from = self._handed
        self._may_still_punch = 0
        self._exhausted = False
        self._held = False

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        while data:
            if self._state in (State.READING, State.STOPPED):
                data = self._receive_program(data)
                continue
            if self._state in (State.PUNCHING, State.PAUSED):
                data = self._receive_code(data)
                continue
            self._ignore(len(data))
            return

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        # Chapter 11 names framing and overrun errors; parity and break are taken for the same.
        seen = "" if byte is None else f" ({byte:02X}h)"
        match self._state:
            case State.READING | State.STOPPED if not self._scanner.ended:
                where = f"after {self._received} characters of program"
            case State.PUNCHING | State.PAUSED:
                where = f"from the host, {self._punched} characters into the punch-out"
            case _:
                self._events.put(Violation(what=f"{fault}{seen} while nothing is received: ignored"))
                return
        self._communication_alarm(Act.LINE_FAULT, "SR946", f"COMMUNICATION ERROR (RMT-BUF): {fault}{seen} {where}")

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        before, self._signals_in = self._signals_in, signals
        if not signals.dsr:
            self._host_gone("DR is OFF")
        elif self._has_cd and before.cd and not signals.cd:
            # SR855 speaks of a CD that turns off (5000#4 = 0). 3.2 has it strapped to our own ER, so a CD that
            # was never ON has no wire and says nothing.
            self._host_gone("CD turned OFF")
        self._note_hold("CS")

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._line_closed = True
        self._host_gone(f"the line is {closure}: {reason}")

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        # 3.2: the host is ready to receive while DR and CS are ON.
        if self._line_closed or self._recalling or not (self._signals_in.dsr and self._signals_in.cts):
            return b""
        if self._codes:
            return b"".join(encode(code, self._params.code) for code in self._codes)[:limit]
        match self._state:
            case State.PUNCHING:
                return self._chunk[:limit]
            case State.PAUSED:
                return self._chunk[: min(limit, self._may_still_punch)]
            case _:
                return b""

    def data_sent(self, count: int, now: Nanos) -> None:
        while count and self._codes:
            count -= 1
            self._handed += 1
            self._code_handed_over(self._codes.popleft(), now)
        if count:
            self._punch_handed_over(count, now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._left = min(self._left + count, self._handed)
        if self._state is State.RECEIVED and self._codes_have_left:
            self._er_on = self._posting
        self._end_if_left()

    def data_discarded(self, count: int, now: Nanos) -> None:
        count = min(count, self._handed - self._left)
        self._handed -= count
        self._punched -= min(count, self._punched)
        self._code_at = min(self._code_at, self._handed)
        if not self._recalling:
            return
        self._recalling = False
        if self._handed < self._data_from and self._codes:
            # Even DC2 came back: to the host there was no punch-out, so nothing is to be ended by DC4 or DC3.
            self._codes.popleft()
        self._end_if_left()

    @property
    def recall(self) -> bool:
        return self._recalling

    @property
    def signals(self) -> SignalsOut:
        return SignalsOut(rts=True, dtr=self._er_on)

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
        """Start to read a program. The DC1 waits until DR and CS are ON. UsageError while another job runs."""
        self._require_rest("start to read")
        self._begin_read()
        self._open(Act.CYCLE_START, State.STARTING, ControlCode.DC1)

    def reset(self, now: Nanos) -> None:
        """The operator presses RESET: what runs ends at once and what was received is lost (6.4, 8.2)."""
        code = self._owed or ControlCode.SYN
        if code is ControlCode.NAK:
            self._stop_communication(Act.RESET, Outcome.FAILED, "an alarm of the CNC, ended by RESET", code)
        else:
            self._stop_communication(Act.RESET, Outcome.CANCELLED, "RESET at the control", code)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm by itself. Ends the communication at once, or leaves that to RESET."""
        communicating = self._state in (State.READING, State.STOPPED, State.PUNCHING, State.PAUSED)
        if not (communicating and self._posting and self._params.alarm is AlarmEnds.AT_RESET):
            self._stop_communication(Act.ALARM, Outcome.FAILED, "an alarm of the CNC", ControlCode.NAK)
            return
        self._move(Act.ALARM, self._state)
        if self._owed is None:
            self._owed = ControlCode.NAK
            self._events.put(Notice(text="the control is in alarm; the communication goes on until RESET (6.4 note 1)"))

    def punch(self, source: Source, now: Nanos) -> None:
        """Punch a program out. The DC2 waits until DR and CS are ON. UsageError while another job runs."""
        self._require_rest("punch out")
        self._begin_punch(source)
        self._open(Act.PUNCH, State.OPENING, ControlCode.DC2)

    def take(self, count: int, now: Nanos) -> bytes:
        """At most `count` bytes out of the buffer, nothing while the control is in alarm."""
        if count <= 0 or self._owed is not None or not self._buffer:
            return b""
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        self._taken += len(data)
        if self._scanner.ended and not self._buffer:
            self._program_ended = True
            self._finish_read()
        elif self._state is State.STOPPED and self._free >= self._limits.start_at_free:
            self._move(Act.BUFFER_LOW, State.READING)
            self._steer(ControlCode.DC1)
        return data

    @property
    def buffered(self) -> int:
        return len(self._buffer)

    @property
    def program_ended(self) -> bool:
        return self._program_ended

    # 6.1.1 1) and 6.3: the remote buffer receives

    @property
    def _free(self) -> int:
        return BUFFER_BYTES - len(self._buffer)

    @property
    def _counting(self) -> bool:
        """The stop request has left completely: from here on characters are overrun."""
        return self._stop_at is not None and self._left >= self._stop_at

    def _receive_program(self, data: bytes) -> bytes:
        """Takes in what changes the state at most once; returns the rest."""
        count = len(data) if self._scanner.ended else min(len(data), self._free)
        if self._counting:
            count = min(count, self._params.allowed_overrun - self._after_stop)
        if not count:
            self._overrun()
            return data
        part = data[:count]
        end = None if self._scanner.ended else self._scanner.feed(part)
        if self._scanner.ended and end is None:
            # 8.2: all data after EOR is ignored.
            self._after_eor += count
        else:
            part = part[:end]
            self._buffer += part
            self._received += len(part)
        if self._counting:
            self._after_stop += len(part)
        if self._state is State.READING and self._free <= self._limits.stop_at_free:
            self._move(Act.BUFFER_FULL, State.STOPPED)
            self._steer(ControlCode.DC3)
        if end is not None:
            self._eor_in()
        return data[len(part) :]

    def _eor_in(self) -> None:
        """With closing=read the buffer goes on by its levels, and may send a DC1 that nothing can follow."""
        if self._params.closing is ClosingAt.READ:
            self._move(Act.EOR_IN, self._state)
            return
        self._move(Act.EOR_IN, State.RECEIVED)
        self._codes.append(ControlCode.DC3)

    def _steer(self, code: ControlCode) -> None:
        """DC1 or DC3 by the free space. While CS holds a pair of them back a third undoes the second."""
        if code is ControlCode.DC3:
            self._after_stop = 0
        if len(self._codes) > 1:
            self._codes.pop()
        else:
            self._codes.append(code)

    def _overrun(self) -> None:
        if self._counting and self._after_stop == self._params.allowed_overrun:
            self._after_stop += 1
            why = f"more than {self._params.allowed_overrun} characters came after DC3"
        else:
            why = f"the buffer of {BUFFER_BYTES} characters is full"
        self._communication_alarm(Act.OVERRUN, "SR856", f"BUFFER OVERFLOW (RMT-BUF): {why}")

    def _finish_read(self) -> None:
        """6.1.1 1) (7): DC3 when the read is completed."""
        codes: tuple[ControlCode, ...] = ()
        if self._state is not State.RECEIVED:
            self._codes.clear()
            codes = (ControlCode.DC3,)
        self._close(Act.EOR_TAKEN, Outcome.COMPLETE, "the program has been read to its EOR", codes)

    def _ignore(self, count: int) -> None:
        """Characters nobody asked for. A host whose read was cut short may still send the overrun of 6.3."""
        if self._after_whole_read:
            self._after_eor += count
            return
        late = count if self._state is State.CLOSING else min(count, self._late_allowed)
        if self._state is State.IDLE:
            self._late_allowed -= late
        if late and not self._late_seen:
            self._late_seen = True
            self._events.put(Notice(text="what the host still sent after the end of the job is ignored"))
        if count > late:
            self._events.put(
                Violation(what="the host sent while the control was not reading: ignored", count=count - late)
            )

    @property
    def _after_whole_read(self) -> bool:
        if self._state is State.RECEIVED:
            return True
        return self._state is State.CLOSING and self._program_ended and self._source is None

    # 6.1.1 2) and 6.1.2 2): the remote buffer punches out

    def _receive_code(self, data: bytes) -> bytes:
        code = code_of(data[0])
        match code:
            case ControlCode.DC3 if self._state is State.PUNCHING:
                self._move(code, State.PAUSED)
                self._may_still_punch = self._params.after_stop
                self._note_hold("DC3 from the host")
            case self._params.resume_code if self._state is State.PAUSED:
                self._move(code, State.PUNCHING)
                self._note_hold(f"{code.name} from the host")
                self._end_if_punched()
            case ControlCode.DC1 | ControlCode.DC2 | ControlCode.DC3:
                self._move(code, self._state)
                self._events.put(Violation(what=f"{code.name} in a punch-out that it cannot steer: ignored"))
            case _:
                self._events.put(Violation(what="the host sent what is no code during a punch-out: ignored"))
        return data[1:]

    def _fill(self, now: Nanos) -> None:
        assert self._source is not None
        data = self._source.read(PUNCH_BYTES)
        if data is None:
            self._timers.start(_Timer.SOURCE, now + SOURCE_POLL)
        elif data:
            self._chunk = data
        else:
            self._exhausted = True
            self._end_if_punched()

    def _punch_handed_over(self, count: int, now: Nanos) -> None:
        assert count <= len(self._chunk)
        self._chunk = self._chunk[count:]
        self._handed += count
        self._punched += count
        if self._state is State.PAUSED:
            self._may_still_punch -= count
        if not self._chunk:
            self._fill(now)

    def _end_if_punched(self) -> None:
        """A host that has paused us gets DC4 when it resumes."""
        if self._exhausted and self._state is State.PUNCHING:
            self._close(Act.PUNCHED, Outcome.COMPLETE, "the program has been punched out", (ControlCode.DC4,))

    def _note_hold(self, why: str) -> None:
        held = self._state is State.PAUSED or (
            self._state in (State.PUNCHING, State.CLOSING) and self._source is not None and not self._signals_in.cts
        )
        if held is self._held:
            return
        self._held = held
        if why == "CS":
            why = "CS is OFF" if held else "CS is ON"
        self._events.put(Held(why=why) if held else Resumed(why=why))

    # 6.1.2 and 6.4: reset, alarm, and the end

    @property
    def _has_cd(self) -> bool:
        """Expansion B is RS-422, which has no CD (3.3)."""
        return self._limits != EXPANSION_B

    @property
    def _host_ready(self) -> bool:
        """6.1.2: SYN and NAK need DR, CD and CS ON."""
        signals = self._signals_in
        return signals.dsr and signals.cts and (signals.cd or not self._has_cd) and not self._line_closed

    def _post(self, code: ControlCode) -> tuple[ControlCode, ...]:
        return (code,) if self._posting and self._host_ready else ()

    def _post_at_rest(self, code: ControlCode) -> tuple[ControlCode, ...]:
        """6.1.2 1): neither receiving nor transmitting."""
        return self._post(code) if self._params.idle_posting is Switch.ON else ()

    def _parting(self, code: ControlCode) -> tuple[ControlCode, ...]:
        """What is said when a transfer is cut short."""
        if self._state in (State.READING, State.STOPPED):
            # The condition of 6.1.2 is on SYN and NAK only: a DC3 held back by CS leaves when CS is ON.
            return (ControlCode.DC3, *self._post(code))
        if not self._posting:
            # 6.4 (1) says DC3 for punch-out too. A DC4 would make the cut program look whole.
            return (ControlCode.DC3,) if self._host_ready else ()
        # 6.1.2 NOTE: while CS is OFF neither DC4 nor SYN or NAK, and none of them later; DC4 never goes alone.
        return (ControlCode.DC4, code) if self._host_ready else ()

    def _stop_communication(self, cause: Act, outcome: Outcome, reason: str, code: ControlCode) -> None:
        match self._state:
            case State.IDLE:
                self._move(cause, State.IDLE)
                if not self._codes:
                    self._codes.extend(self._post_at_rest(code))
            case State.CLOSING:
                self._stop_closing(cause, outcome, reason, code)
            case State.STARTING | State.OPENING:
                self._codes.clear()
                self._close(cause, outcome, reason, self._post_at_rest(code))
            case State.RECEIVED:
                self._close(cause, outcome, reason, self._post_at_rest(code))
            case _:
                parting = self._parting(code)
                # 6.4 note 2: RESET stops a punch-out at once, so what still waits in the line is called back.
                self._recalling = cause is Act.RESET and self._punched > 0 and self._left < self._handed
                self._codes.clear()
                self._close(cause, outcome, reason, parting)

    def _stop_closing(self, cause: Act, outcome: Outcome, reason: str, code: ControlCode) -> None:
        """A job is over when its last code has left; until then a reset or an alarm still ends it otherwise."""
        self._move(cause, State.CLOSING)
        if self._ending is Outcome.COMPLETE:
            self._ending, self._reason = outcome, reason
            self._codes.extend(self._post(code))
        if not self._signals_in.cts:
            # What CS holds back is given up: a DC4 that came later, alone, would make a cut program look whole.
            self._abandon_codes()
        self._end_if_left()

    def _communication_alarm(self, cause: Act, number: str, text: str) -> None:
        """An alarm of the communication itself ends it at once, whatever 6.4 note 1 allows a CNC alarm."""
        self._events.put(Alarm(number=number, text=text))
        codes = () if cause is Act.HOST_GONE else self._parting(ControlCode.NAK)
        self._codes.clear()
        self._close(cause, Outcome.FAILED, f"{number} {text}", codes)

    def _host_gone(self, why: str) -> None:
        alarm = f"DATA SET READY DOWN (RMT-BUF): {why}"
        match self._state:
            case State.IDLE:
                self._abandon_codes()
            case State.STARTING | State.OPENING if not self._line_closed:
                pass  # 3.2 makes DR OFF an alarm during data transmission, which has not begun
            case State.READING | State.STOPPED | State.RECEIVED if self._scanner.ended:
                # The whole program is here: the control reads it without the host.
                self._move(Act.HOST_GONE, State.RECEIVED)
                self._abandon_codes()
                self._er_on = self._posting
            case State.CLOSING:
                self._move(Act.HOST_GONE, State.CLOSING)
                if self._ending is Outcome.COMPLETE and self._source is not None:
                    self._events.put(Alarm(number="SR855", text=alarm))
                    self._ending, self._reason = Outcome.FAILED, f"SR855 {alarm}"
                self._abandon_codes()
                self._end_if_left()
            case _:
                self._code_at = 0
                self._communication_alarm(Act.HOST_GONE, "SR855", alarm)

    # every job's beginning and end

    def _require_rest(self, what: str) -> None:
        if self._state is not State.IDLE:
            raise UsageError(f"the control cannot {what}: {self._state.value}; press RESET, or wait")
        if self._line_closed:
            raise UsageError(f"the control cannot {what}: its line is closed; open the line again")

    def _open(self, act: Act, state: State, code: ControlCode) -> None:
        self._move(act, state)
        self._er_on = True
        self._owed = None
        self._late_allowed = 0
        self._late_seen = False
        self._codes.append(code)
        if not (self._signals_in.dsr and self._signals_in.cts):
            off = "CS" if self._signals_in.dsr else "DR"
            self._events.put(Notice(text=f"the host is not ready, {off} is OFF: {code.name} waits for it"))

    def _code_handed_over(self, code: ControlCode, now: Nanos) -> None:
        self._code_at = self._handed
        match self._state, code:
            case State.STARTING, ControlCode.DC1:
                self._move(Act.OPENED, State.READING)
                self._events.put(Started(why="DC1: the control reads"))
            case State.STOPPED, ControlCode.DC3:
                self._stop_at = self._handed
            case State.OPENING, ControlCode.DC2:
                self._move(Act.OPENED, State.PUNCHING)
                self._data_from = self._handed
                self._events.put(Started(why="DC2: the control punches out"))
                self._fill(now)

    def _move(self, cause: Cause, to: State) -> None:
        assert to in LAW[self._state, cause], f"{self._state} {cause} {to}"
        if self._state is State.STOPPED and to is not State.STOPPED:
            self._events.put(AfterStop(count=self._after_stop, allowed=self._params.allowed_overrun))
            self._stop_at = None
        self._state = to

    def _close(self, cause: Act, outcome: Outcome, reason: str, codes: tuple[ControlCode, ...]) -> None:
        """Everything of the job is over but its last codes, which `codes` adds to those still waiting."""
        cut_short = outcome is not Outcome.COMPLETE
        if self._source is not None:
            self._late_allowed = CROSSING
            if not codes:
                self._code_at = 0
        else:
            self._late_allowed = self._params.allowed_overrun if cut_short else 0
        self._move(cause, State.CLOSING)
        self._ending, self._reason = outcome, reason
        self._timers.stop_all()
        self._buffer.clear()
        self._chunk = b""
        self._held = self._held and not cut_short
        self._codes.extend(codes)
        self._end_if_left()

    @property
    def _codes_have_left(self) -> bool:
        return not self._codes and self._left >= self._code_at

    def _abandon_codes(self) -> None:
        self._codes.clear()
        self._code_at = 0
        self._recalling = False

    def _end_if_left(self) -> None:
        if self._state is not State.CLOSING or self._recalling or not self._codes_have_left:
            return
        self._move(Act.CLOSED, State.IDLE)
        # 6.4 (1): without posting, ER OFF after the last code. That a whole read ends so too is by analogy.
        self._er_on = self._posting
        low, high = self._taken, self._received
        if self._source is not None:
            low, high = min(max(self._left - self._data_from, 0), self._punched), self._punched
            self._begin_punch(None)
        elif self._after_eor:
            self._events.put(Notice(text=f"{self._after_eor} characters after EOR were ignored (8.2)"))
        self._owed = None
        self._events.put(Ended(outcome=self._ending, reason=self._reason, bytes_low=low, bytes_high=high))
