"""The control's end of protocol A and expansion A (B-63322EN-1 chapters 4, 5 and 8): the remote buffer.

     2.053  cnc   SYN
     2.057  host  SYN
     2.210  cnc   RDY
     2.214  host  RDY
     2.959  cnc   SAT operating, 0 stored
     2.995  host  SET Nb=4000 No=512 Tp=2 Ti=0 Tx=0 Tw=1
     2.998  cnc   GTD
     3.019  host  DAT
     3.019  host  30 bytes  "%\\nO0001\\nG91 ..."
     3.022  cnc   GTD
     3.026  host  EOD
     5.061  cnc   SAT reset, 0 stored
     5.065  host  SET

The control speaks and the host answers, one message each. Only in expansion A does the host send packets as long as it
likes, from a GTD to its end packet.

Where the manual is silent, or speaks twice, the comment beside the code says what was chosen.
"""

from __future__ import annotations

from typing import Final, assert_never

from tapewire.engine import (
    ALL_ON,
    Closure,
    Event,
    Events,
    LineFault,
    Nanos,
    Notice,
    Outcome,
    SignalsIn,
    SignalsOut,
    Source,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber
from tapewire.protocols.fanuc_a.cnc_dialogue import Dialogue
from tapewire.protocols.fanuc_a.cnc_job import Job, Phase
from tapewire.protocols.fanuc_a.cnc_law import (
    DEAF,
    LAW,
    MESSAGES_AMONG_PACKETS,
    Act,
    Refusal,
    State,
    Timer,
    refusal,
)
from tapewire.protocols.fanuc_a.cnc_packets import LONGEST_AMONG_PACKETS, PacketSession, Verdict
from tapewire.protocols.fanuc_a.cnc_turn import legal_n
from tapewire.protocols.fanuc_a.messages import (
    Command,
    DataError,
    Error,
    Message,
    MessageReader,
    Reading,
    RetryReason,
    Unreadable,
    checksum,
    encode_image,
    parse_image,
)
from tapewire.protocols.fanuc_a.params import GtdAnswers, Params, TimeOut
from tapewire.protocols.fanuc_a.status import AlarmCause, Setting
from tapewire.protocols.settings import Switch

__all__ = ["FanucACnc"]

_HEADER: Final = 5
"""Characters before the data: sum and command."""


class FanucACnc:
    """The remote buffer: a CncEngine.

    Power comes on with the first call that carries a moment; until then `next_deadline` is 0, which asks for one.
    `Ended`: `bytes_low` is what the control has taken out of the buffer, `bytes_high` what came in of the program, both
    with EOR. It comes when the host has answered the SAT, RST or ALM that tells it of the end, or cannot be told.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._events = Events()
        self._job = Job(self._events, params.data, params.g05.record_bytes)
        self._line = Dialogue(params, self._job, self._events)
        self._powered = False
        self._signals_in = SignalsIn()
        self._signals_reported = False
        self._host_here = True
        self._ignored_in: State | None = None
        self._di = params.di
        self._do = 0

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        position = 0
        if data:
            self._power_on(now)
        while position < len(data):
            state = self._line.state
            if state in DEAF:
                self._ignore(state)
                return
            self._ignored_in = None
            if state is State.PACKETS:
                position = self._receive_packets(data, position, now)
            else:
                position = self._receive_message(data, position, now)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """4.6 1) (1) to (3). Chapter 11 names framing and overrun errors; parity and break are taken for the same."""
        self._power_on(now)
        seen = f"{fault}" if byte is None else f"{fault} ({byte:02X}h)"
        if self._line.state in DEAF or self._line.state is State.SYN_WAIT:
            self._events.put(Violation(what=f"{seen} while the control was not listening: ignored"))
            return
        self._line.open_line(AlarmNumber.SR946, seen, now)

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        # SR855 speaks of a CD that turns off (5000#4 = 0). 3.2 has it strapped to our own ER, so a CD that was never
        # ON has no wire and says nothing.
        checked = self._signals_reported and self._params.cd is Switch.ON
        cd_fell = checked and self._signals_in.cd and not signals.cd
        self._signals_in = signals
        self._signals_reported = True
        if self._line.state is State.CLOSED:
            return
        was_here, self._host_here = self._host_here, signals.dsr
        if not self._powered:
            self._power_on(now)
        elif self._host_here and not was_here:
            self._line.host_ready(now)
        elif was_here and (not self._host_here or cd_fell):
            self._line.host_gone("DR is OFF" if not self._host_here else "CD turned OFF", for_good=False)
            if self._host_here:
                self._line.host_ready(now)

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._power_on(now)
        if self._line.state is not State.CLOSED:
            self._line.host_gone(f"the line is {closure}: {reason}", for_good=True)

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        # 4.3 (6). The characters already in the line are within the 3 that may still come.
        return self._line.look(limit) if self._signals_in.cts else b""

    def data_sent(self, count: int, now: Nanos) -> None:
        self._line.sent(count, now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._line.left(count, now)

    def data_discarded(self, count: int, now: Nanos) -> None:
        self._line.discarded(count)

    @property
    def recall(self) -> bool:
        return False

    @property
    def signals(self) -> SignalsOut:
        return ALL_ON if self._line.room.rs_on else SignalsOut(rts=False)

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._line.timers.next() if self._powered else 0

    def handle_timer(self, now: Nanos) -> None:
        self._power_on(now)
        self._line.handle_timer(now)

    def next_event(self) -> Event | None:
        return self._events.get()

    # the operator and the CNC

    def cycle_start(self, now: Nanos) -> None:
        """Start to read a program. GTD waits until the line is initialised. UsageError while another operation runs,
        in alarm, or when the line is closed."""
        self._power_on(now)
        if self._line.state is State.CLOSED:
            raise UsageError("the control cannot start to read: its line is closed; open the line again")
        if self._line.in_alarm:
            raise UsageError("the control cannot start to read: it is in alarm; press RESET")
        if self._job.phase is not Phase.NONE:
            raise UsageError(f"the control cannot start to read: {self._job.phase.value}; press RESET, or wait")
        self._job.begin()
        self._line.cycle_start(now)

    def reset(self, now: Nanos) -> None:
        """The operator presses RESET: what runs is over and what was received is lost (8.2)."""
        self._power_on(now)
        if self._job.runs:
            self._job.finish(Outcome.CANCELLED, "RESET at the control")
        self._job.lose_buffer()
        self._line.reset(now)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm by itself, and stays in it until RESET."""
        self._power_on(now)
        if self._job.runs:
            self._job.finish(Outcome.FAILED, "an alarm of the CNC")
        self._line.go_to_alarm(now)

    def punch(self, source: Source, now: Nanos) -> None:
        """UsageError: protocol A has no punch-out (chapter 1)."""
        raise UsageError("protocol A cannot punch out: use protocol B or Bridgeport to take a program from a control")

    def take(self, count: int, now: Nanos) -> bytes:
        """At most `count` bytes out of the buffer."""
        self._power_on(now)
        data = self._job.take(count, connected=self._line.up)
        if data:
            self._line.room_freed(now)
        return data

    @property
    def progress(self) -> int:
        return self._job.taken

    @property
    def buffered(self) -> int:
        return self._job.buffered

    @property
    def buffer(self) -> Job:
        return self._job

    @property
    def program_ended(self) -> bool:
        return self._job.program_ended

    @property
    def di(self) -> int:
        """The DI byte G152, which RDI reads."""
        return self._di

    @di.setter
    def di(self, image: int) -> None:
        if not 0 <= image <= 0xFF:
            raise UsageError(f"DI = {image}: 8 bits are possible, 0 to 255")
        self._di = image

    @property
    def do(self) -> int:
        """The DO byte F152, which SDO writes."""
        return self._do

    def _power_on(self, now: Nanos) -> None:
        if not self._powered:
            self._powered = True
            if self._signals_in.dsr:
                self._line.host_ready(now)
            else:
                self._line.host_gone("DR is OFF", for_good=False)

    def _ignore(self, state: State) -> None:
        """4.6 3). Said once for all that comes before the control listens again."""
        if self._ignored_in is not state:
            self._ignored_in = state
            self._events.put(Violation(what=f"the host sent while {state.value}: ignored (4.6 3))"))

    # messages come in

    def _receive_message(self, data: bytes, position: int, now: Nanos) -> int:
        line = self._line
        before = line.reader.pending
        stop, reading = line.reader.read(data, position)
        if line.state in (State.GTD_SENT, State.SDI_FOR_GTD):
            length = before + stop - position - _HEADER - (reading is not None)
            line.room.heard(max(0, length), self._job.room, line.parameters)
        if not line.room.rs_on:
            line.timers.stop(Timer.TO)
        elif line.state not in (State.RESTING, State.SYN_WAIT) and self._between_bytes:
            line.watch(now)
        line.heard_something(now)
        if reading is not None:
            overran = line.room.overran
            line.room.end()
            self._hear(reading, overran, now)
        return stop

    @property
    def _between_bytes(self) -> bool:
        """To begins again with each character; or else it has been stopped while RS was OFF."""
        return self._params.time_out is TimeOut.BYTES or not self._line.timers.running(Timer.TO)

    def _hear(self, reading: Reading, overran: bool, now: Nanos) -> None:
        line = self._line
        if overran:
            line.damaged(RetryReason.OVERRUN, now)
        elif isinstance(reading, Message):
            self._obey(reading, now)
        elif line.state in (State.RESTING, State.SYN_WAIT):
            self._events.put(Violation(what=f"{reading.error} while no answer was awaited: ignored"))
        elif self._is_damaged(reading):
            self._events.put(Violation(what=f"{reading.error} in the host's answer"))
            line.damaged(RetryReason.CHECKSUM, now)
        else:
            self._refuse(Refusal.NOT_EXPECTED, str(reading.error), now)

    def _is_damaged(self, reading: Unreadable) -> bool:
        """The line did it: ask again. SR948 is for what a host meant to say: the sum of a short one decides."""
        if reading.error is not Error.SHORT:
            return reading.error is Error.CHECKSUM
        raw = reading.raw
        return len(raw) < 3 or raw[:2] != self._params.coding.encode(checksum(raw[2:]))

    def _refuse(self, alarm: Refusal, what: str, now: Nanos) -> None:
        self._line.reception_error(AlarmCause.UNEXPECTED, alarm.value, what, now)

    def _obey(self, message: Message, now: Nanos) -> None:
        line = self._line
        line.forget_retry()
        act = LAW.get((line.state, message.command))
        if act is None:
            what = f"{message.command.value}: {line.state.value}"
            self._refuse(refusal(line.state, message.command), what, now)
            return
        if line.state is State.PACKETS:
            line.leave_packets()
        try:
            self._do_act(act, message, now)
        except DataError as error:
            self._refuse(Refusal.NOT_EXPECTED, str(error), now)

    def _do_act(self, act: Act, message: Message, now: Nanos) -> None:
        line = self._line
        match act:
            case Act.INITIALISE:
                line.initialise(now)
            case Act.GO_ON:
                line.host_initialises(now)
            case Act.READY:
                line.initialised(now)
            case Act.NOT_YET:
                line.host_not_yet(now)
            case Act.APPLY:
                self._apply(message.data)
                line.polled(now)
            case Act.CLEAR:
                self._job.clear()
                line.polled(now)
            case Act.SEND_DI:
                line.send_di(encode_image(self._di), now)
            case Act.PUT_DO:
                self._do = parse_image(message.data)
                line.answered(now)
            case Act.STORE:
                self._job.store(message.data, line.parameters)
                line.answered(now)
            case Act.WAIT:
                line.wait_tw(now)
            case Act.NO_MORE:
                self._job.exhausted()
                line.answered(now)
            case Act.NOTED:
                line.answered(now)
            case Act.REPEAT:
                line.repeat(now)
            case Act.IGNORE:
                self._events.put(Violation(what=f"{message.command.value} on an open line: ignored"))
            case _:
                assert_never(act)

    def _apply(self, data: bytes) -> None:
        """SET (4.4.2 2)). Values outside table 4.5 are not taken: what a remote buffer does with them is not stated."""
        if not data:
            return
        line = self._line
        setting = Setting.parse(data, line.parameters)
        complaint = setting.parameters.complaint()
        if complaint is not None:
            self._events.put(Violation(what=f"SET {complaint}: the parameters stay as they were"))
            return
        if setting.switching != line.switching:
            self._events.put(Notice(text=f"the host asks for remote or tape operation by {setting.switching!r}"))
        line.switching = setting.switching
        line.parameters = legal_n(setting.parameters)

    # packets come in

    def _receive_packets(self, data: bytes, position: int, now: Nanos) -> int:
        session = self._line.session
        assert session is not None
        if session.peek is not None:
            return self._peek(session, session.peek, data, position, now)
        stop, reading = session.reader.read(data, position)
        session.heard(stop - position)
        if reading is not None:
            self._line.packet_in(now)
            self._judge(session, session.receive(reading), now)
            self._line.pump()
        return stop

    def _peek(self, session: PacketSession, peek: MessageReader, data: bytes, position: int, now: Nanos) -> int:
        """Chapter 5 has nothing but packets from GTD to the end packet. Where a setting lets a message be heard among
        them, it must be whole, its sum right, and it must stand where a packet may begin: its first character looks
        like a packet number."""
        end = min(len(data), position + LONGEST_AMONG_PACKETS - peek.pending)
        stop, reading = peek.read(data[:end], position)
        if isinstance(reading, Message) and self._understood(session, reading.command):
            self._obey(reading, now)
            return stop
        _, packet = session.reader.read(data[:stop], position)
        assert packet is None
        session.heard(stop - position)
        if reading is not None or peek.pending >= LONGEST_AMONG_PACKETS:
            session.peek = None
        return stop

    def _understood(self, session: PacketSession, command: Command) -> bool:
        heard = MESSAGES_AMONG_PACKETS[self._params.among_packets]
        if not session.at_start:
            return command in heard and command is Command.SYN
        answers = self._params.gtd_answers is GtdAnswers.MESSAGES
        return (State.PACKETS, command) in LAW and (answers or command in heard)

    def _judge(self, session: PacketSession, verdict: Verdict, now: Nanos) -> None:
        line = self._line
        match verdict:
            case Verdict.GO_ON:
                pass
            case Verdict.END:
                line.leave_packets()
                self._job.session_ended()
                line.answered(now)
            case Verdict.TOO_MANY:
                line.too_many_naks()
            case Verdict.OVERFLOW:
                line.open_line(AlarmNumber.SR856, "the host did not stop at DC3", now)
            case _:
                assert_never(verdict)
