"""The host computer's end of protocol A and expansion A (B-63322EN-1 chapters 4 and 5).

    cnc   SYN          host  SYN
    cnc   RDY          host  RDY
    cnc   SAT reset    host  SET Nb=4000 No=512 Ti=0 ...
    cnc   GTD          host  DAT 3488 bytes
    cnc   GTD          host  DAT ... %
    cnc   GTD          host  EOD                             the control has it all
    cnc   SAT operating, 1200 stored    host  SET
    cnc   SAT operating, 0 stored       host  SET            the job is complete

The host only ever answers: whatever it hears tells it what to say, and silence tells it to say SYN. What it has
delivered is what a later message of the control proves; nothing is ever continued in the middle.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import SECOND, Nanos, Notice, Outcome, Requested, Sink, Source, Started, Violation
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.host_job import Job, Supply
from tapewire.protocols.fanuc_a.host_law import LAW, Row, State, Timer
from tapewire.protocols.fanuc_a.host_line import BEGUN, TOO_OFTEN, UNDER_WAY, HostLine
from tapewire.protocols.fanuc_a.host_outbox import Span
from tapewire.protocols.fanuc_a.messages import (
    ANSWERS,
    LONGEST_DAT,
    Command,
    DataError,
    Message,
    parse_image,
)
from tapewire.protocols.fanuc_a.packets import MonitorPacket, packet_bytes
from tapewire.protocols.fanuc_a.params import GtdAnswers, RstAtEnd
from tapewire.protocols.fanuc_a.status import CAUSES, BufferState, Doubt, Status, disbelief

__all__ = ["LAW", "FanucAHost", "State"]

DAT_HEADER: Final = 5
"""Sum and command stand before the data."""

STATUS_LIMIT: Final[Nanos] = 60 * SECOND
"""A control that goes on with GTD gets WAT for so long before the SAT it owes: a person who was told has RESET it."""


class FanucAHost(HostLine):
    """A host computer on protocol A or expansion A: the params, and what the control agrees to, say which.

    A HostEngine.

    `Ended.bytes_low` are the program bytes that a later message of the control proves to be there (in packets: those
    that can no longer be asked for again), `bytes_high` all that were handed over.
    """

    # the application's side

    def start(self, source: Source, now: Nanos) -> None:
        """Arm a program; it starts with the next GTD of a control that stands at a beginning (SYN, RST, ALM, CAN, or
        SAT in another state than operating, since the last data). Raises UsageError while a job is under way, when the
        program is empty, and when its first bytes cannot be sent (4.1: they hold the end code); where later ones
        cannot, the job fails before they are sent.
        """
        if self._state in UNDER_WAY or self._ending is not None:
            raise UsageError(f"a job is under way ({self._state.value}); abort it or wait for its end")
        if self._closed:
            raise UsageError("the line is gone; open it anew")
        job = Job(source, self._params)
        job.supply(LONGEST_DAT)
        if job.refusal:
            raise UsageError(job.refusal)
        self._job = job
        self._state = State.ARMED
        self._armed_at = now
        self._drop_wishes()
        self._proven = self._high = 0
        self._stored_at_end = None
        if not self._recall:
            self._outbox.forget_program()
        self._exchange.forget_retries()
        self._doubted = 0
        self._had_all_again = False
        self._exchange.begin(now)
        self._told -= {"obstacle", "status"}
        if self._streaming.waits_for_job and self._fresh and not self._agreement.obstacle:
            self._streaming.take_up(job)
            self._begin_streaming()
        self._settle(now)

    def receive(self, sink: Sink, now: Nanos) -> None:
        """Protocol A has no punch-out (4.4.1). Raises UsageError."""
        raise UsageError("protocol A cannot take programs from a control: use protocol B for the punch-out")

    def abort(self, now: Nanos) -> None:
        """Give the job up. A DAT under way is cut off so that the control cannot take it; a packet is finished.
        After that come WAT or invalid packets, which cannot make a cut program look whole.
        """
        if self._state not in UNDER_WAY:
            return
        begun = self._state in BEGUN
        advice = "RESET the control before anything else is sent to it" if begun else "nothing of it was sent"
        self._end(Outcome.CANCELLED, f"given up here; {advice}", now)
        self._settle(now)

    def hold_reception(self, now: Nanos) -> None:
        """There is no reception."""

    def release(self, now: Nanos) -> None:
        """There is no reception."""

    @property
    def state(self) -> State:
        return self._state

    @property
    def progress(self) -> int:
        return self._high

    @property
    def needs_stop_distance(self) -> int:
        """No (4.3 (5)). Packets are begun one at a time, so that DC3 and NAK need no more (5.3)."""
        return self._params.no

    # what the control says

    def _obey_message(self, message: Message, now: Nanos) -> None:
        command, before = message.command, self._state
        self._drop_crossed()
        row = LAW.get((before, command))
        if row is None or self._is_out_of_place(command):
            self._events.put(Violation(what=f"{command.value} while {before.value}"))
            return
        cut = self._is_sending_dat and not self._outbox.empty
        self._timers.stop(Timer.WAT)
        self._timers.stop(Timer.SOURCE)
        self._answer = None
        if command is not Command.RTY:
            self._sdi_due = False
            self._exchange.good()
            self._leave_packets()
            if cut:
                outcome = Outcome.CANCELLED if command is Command.RST else Outcome.FAILED
                self._interrupt(outcome, f"{command.value} came before the end of a DAT", now)
        self._dispatch(message, now)
        self._obeyed(row, command, before)

    def _obeyed(self, row: Row, command: Command, before: State) -> None:
        assert self._answer is None or self._answer in row.answers, f"{command} was answered with {self._answer}"
        assert self._state in row.states, f"{command} led from {before} to {self._state}"

    def _is_out_of_place(self, command: Command) -> bool:
        match command:
            case Command.SDI:
                return not self._sdi_due
            case Command.RTY:
                return self._streaming.active or self._exchange.last is None
            case _:
                return False

    def _leave_packets(self) -> None:
        """A message of protocol A ends the packets (5.2 2) b))."""
        self._canned = self._streaming.stopped
        self._fresh = self._fresh or self._canned
        self._proven = max(self._proven, self._proven_by_packets)
        self._streaming.close()

    def _dispatch(self, message: Message, now: Nanos) -> None:
        match message.command:
            case Command.SYN | Command.RDY:
                self._on_initialisation(message.command, now)
            case Command.RST:
                self._on_rst(now)
            case Command.ALM:
                self._on_alm(now)
            case Command.SAT:
                self._on_sat(message, now)
            case Command.GTD:
                self._on_gtd(now)
            case Command.SDI:
                self._on_sdi(message, now)
            case _:
                assert message.command is Command.RTY
                self._on_rty(now)

    def _say(self, command: Command, data: bytes = b"", span: Span | None = None) -> None:
        self._answer = command
        self._sdi_due = command is Command.RDI
        if command is Command.EOD and self._stored_at_end is None:
            self._stored_at_end = 0
        self._exchange.say(Message(command=command, data=data), span)

    def _on_initialisation(self, command: Command, now: Nanos) -> None:
        """SYN, RDY: power-on, or an open-line error of the control (4.6 1)). We are always ready."""
        self._interrupt(Outcome.FAILED, f"the control was initialised anew ({command.value})", now)
        self._begin_anew()
        self._outbox.begin_anew()
        self._stand_at_beginning()
        self._say(command)

    def _on_rst(self, now: Nanos) -> None:
        """8.2: what is in the buffer is lost."""
        told_empty = self._state is State.DELIVERED and self._stored_at_end == 0
        if told_empty and self._params.rst_at_end is RstAtEnd.COMPLETE:
            self._end(Outcome.COMPLETE, "delivered whole; the control was reset at its end (RST)", now)
        self._interrupt(Outcome.CANCELLED, "the control was reset (RST)", now)
        self._stand_at_beginning()
        self._say(Command.ARS)

    def _on_alm(self, now: Nanos) -> None:
        self._interrupt(Outcome.FAILED, "the control has an alarm (ALM)", now)
        self._stand_at_beginning()
        self._say(Command.AAL)

    def _stand_at_beginning(self) -> None:
        """Whatever is asked for now is the beginning of a program, not the middle of one."""
        self._fresh = True
        self._told -= {"unserved", "middle", "status", "obstacle"}
        if self._state is State.FINISHED:
            self._state = State.IDLE

    # SAT

    def _on_sat(self, message: Message, now: Nanos) -> None:
        base = self._agreement.base
        if doubt := disbelief(message.data, base):
            self._disbelieve(doubt, now)
        else:
            status = Status.parse(message.data, base)
            self._had_all_again = False
            self._hear_parameters(status)
            self._judge(status, now)
        if self._state is State.STREAMING:
            self._interrupt(Outcome.FAILED, "SAT before the end packet: the control has left the packets", now)
        self._answer_sat()

    def _answer_sat(self) -> None:
        if not self._say_wish(Command.SAT):
            self._say(Command.SET, self._agreement.set_data())

    def _hear_parameters(self, status: Status) -> None:
        self._agreement.hear(status)
        if self._agreement.refused and "refused" not in self._told:
            self._told.add("refused")
            self._events.put(Notice(text=f"the control does not take what SET asks for: {self._agreement.differences}"))

    def _disbelieve(self, doubt: Doubt, now: Nanos) -> None:
        """A SAT that no control can say (4.5) proves nothing. One that has come so often is no damage, and no end of a
        job is believed of this control; but a SET of all, said once a job, may mend a value that it holds.
        """
        self._events.put(Violation(what=doubt.what))
        reason = f"nothing that the control says of its state can be believed: {doubt.what}"
        first = self._doubted_enough and not self._had_all_again
        if first:
            self._had_all_again = True
            self._agreement.say_all_again()
        if self._state is State.ARMED and self._doubted_enough:
            if first:
                self._doubted = 0
            elif doubt.readable:
                self._end(Outcome.FAILED, f"nothing was sent: {reason}", now)
        elif self._state is not State.STREAMING:
            self._interrupt(Outcome.FAILED, reason, now)

    def _judge(self, status: Status, now: Nanos) -> None:
        """What the state of the control means for the job (4.4.2 1), 4.7)."""
        match status.state:
            case BufferState.OPERATING:
                self._judge_operating(status.stored, now)
            case BufferState.RESET:
                self._judge_reset(status.stored, now)
            case BufferState.ALARM:
                cause = CAUSES[status.cause]
                self._interrupt(Outcome.FAILED, f"the remote buffer is in alarm state: {cause}", now)
                self._stand_at_beginning()
            case BufferState.NOT_READY | BufferState.OPEN_LINE:
                self._interrupt(Outcome.FAILED, f"the remote buffer reports {status.state.name.lower()}", now)
                self._stand_at_beginning()

    def _judge_operating(self, stored: int, now: Nanos) -> None:
        if self._canned:
            self._interrupt(Outcome.FAILED, "the control stopped the transfer (CAN)", now)
        self._note_taken()
        if self._stored_at_end is not None:
            self._stored_at_end += stored
        if self._state is State.DELIVERED and not stored:
            self._end(Outcome.COMPLETE, "delivered whole, and the buffer is empty", now)

    def _judge_reset(self, stored: int, now: Nanos) -> None:
        if not self._canned:
            self._note_taken()
        if self._state is State.DELIVERED and not stored:
            self._end(Outcome.COMPLETE, "delivered whole, and the control is in the reset state", now)
        self._interrupt(Outcome.CANCELLED, "the control went to the reset state", now)
        self._stand_at_beginning()

    def _note_taken(self) -> None:
        """GTD, or SAT in state 1 or 2: what was sent before it has been taken. Nothing else proves that."""
        if self._state is State.SENDING:
            assert self._job is not None
            self._proven = self._job.taken
            if self._job.supply(1) is Supply.LAST and self._job.all_taken:
                self._state = State.DELIVERED
        elif self._state is State.AWAITING:
            self._state = State.DELIVERED
            self._stored_at_end = 0

    # GTD

    def _on_gtd(self, now: Nanos) -> None:
        if self._state in (State.STREAMING, State.AWAITING) and (self._canned or self._state is State.STREAMING):
            self._interrupt(Outcome.FAILED, "GTD in the middle of the packets", now)
        self._note_taken()
        if self._agreement.n or not self._say_wish(Command.GTD):
            self._answer_gtd(now)

    def _answer_gtd(self, now: Nanos) -> None:
        match self._state:
            case State.ARMED if not self._agreement.settled:
                self._await_status(now)
            case State.ARMED if self._agreement.obstacle:
                self._meet_obstacle(self._agreement.obstacle, now)
            case State.ARMED if not self._fresh:
                self._tell_middle()
                self._have_it_wait(now)
            case State.ARMED if self._agreement.n:
                self._begin_packets(self._job)
                self._begin_streaming()
            case State.ARMED | State.SENDING:
                self._send_dat(now, late=False)
            case State.DELIVERED | State.FINISHED:
                self._say_no_more()
            case _:
                if "unserved" not in self._told:
                    self._told.add("unserved")
                    self._events.put(Requested(served=False))
                self._have_it_wait(now)

    def _await_status(self, now: Nanos) -> None:
        """Before SET a code conversion of a host before us may be in force, and a control that goes on with GTD says no
        SAT that could be answered by SET: Tw is at most Tp (4.5).
        """
        asks = "the control asks for the program (GTD) and has not told its parameters (SAT)"
        self._await_sat("status", asks, now)

    def _meet_obstacle(self, obstacle: str, now: Nanos) -> None:
        """Wait as long as SET may still remove it."""
        if self._agreement.refused:
            self._fail_unsent(f"nothing was sent: {obstacle}", now)
        else:
            self._await_sat("obstacle", obstacle, now)

    def _await_sat(self, key: str, problem: str, now: Nanos) -> None:
        """Only SET can end the `problem`, and the control asks for the program: WAT, while an operator may RESET it."""
        if key not in self._told:
            self._told.add(key)
            self._asked_at = now
            self._events.put(Notice(text=f"the program waits: {problem}; RESET it, and start it some seconds later"))
        if now - self._asked_at > STATUS_LIMIT:
            self._fail_unsent(f"nothing was sent: {problem} for {STATUS_LIMIT // SECOND} s", now)
        else:
            self._say(Command.WAT)

    def _tell_middle(self) -> None:
        if "middle" not in self._told:
            self._told.add("middle")
            text = "the control is in the middle of a program that this job did not begin: RESET it, then start it"
            self._events.put(Notice(text=text))

    def _have_it_wait(self, now: Nanos) -> None:
        """No data now: WAT; among packets invalid ones, since a message may look like a packet (5.2)."""
        if self._answers_by_packets:
            self._begin_packets(None)
        else:
            self._say(Command.WAT)

    @property
    def _answers_by_packets(self) -> bool:
        """A host of protocol A never does, whatever the control keeps."""
        packets = self._params.packet_n and self._agreement.n
        return bool(packets) and self._params.gtd_answers is GtdAnswers.PACKETS

    def _say_no_more(self) -> None:
        """Nothing left: EOD; among packets an end packet with EOR alone."""
        if self._answers_by_packets:
            self._streaming.begin_end_only()
        else:
            self._say(Command.EOD)

    def _begin_packets(self, job: Job | None) -> None:
        """From here on a RTY must not draw what was said before the packets."""
        self._exchange.say_next_time(Message(command=Command.WAT))
        self._streaming.begin(job)

    def _begin_streaming(self) -> None:
        self._state = State.STREAMING
        self._begin_program(f"GTD: packets of {packet_bytes(self._agreement.n)} characters")

    def _begin_program(self, why: str) -> None:
        self._fresh = False
        self._drop_wishes()
        self._told.discard("unserved")
        self._nudged = False
        self._events.put(Requested())
        self._events.put(Started(why=why))

    def _send_dat(self, now: Nanos, *, late: bool) -> None:
        """The answer to a GTD, as soon as the source has it: DAT never longer than has been agreed on (4.5 note 1)."""
        job = self._job
        assert job is not None
        longest = self._agreement.longest_dat(self._outbox.rate)
        if longest < 1:
            self._events.put(Violation(what="Nb - No of the control's SAT leaves no room for data"))
            self._say(Command.WAT)
            return
        supply = job.supply(longest)
        if job.refusal:
            self._fail_unsent(job.refusal, now)
            return
        if supply is Supply.LATE and not late:
            self._wait_for_source(now)
            return
        self._poll.begin()
        self._timers.stop(Timer.WAT)
        if not job.at_hand:
            self._state = self._state if supply is Supply.LATE else State.DELIVERED
            self._say(Command.WAT if supply is Supply.LATE else Command.EOD)
            return
        if self._state is State.ARMED:
            self._state = State.SENDING
            self._begin_program("GTD: from the first byte of the program")
        base = job.taken
        data = job.take(longest)
        self._say(Command.DAT, data, Span(base=base, header=DAT_HEADER, length=len(data)))

    def _wait_for_source(self, now: Nanos) -> None:
        """Never so long that the control would time out (To). RTY in between draws WAT: this GTD says that the DAT
        before it was taken, and what was said before the first GTD is no answer to it.
        """
        self._exchange.say_next_time(Message(command=Command.WAT))
        self._poll.again(now)
        if not self._timers.running(Timer.WAT):
            self._timers.start(Timer.WAT, now + min(round(self._params.wat_after * SECOND), self._agreement.to // 2))

    def _fail_unsent(self, reason: str, now: Nanos) -> None:
        self._end(Outcome.FAILED, reason, now)
        self._say(Command.WAT)

    # the others

    def _on_sdi(self, message: Message, now: Nanos) -> None:
        """Then the answer is due that SAT or GTD did not get (4.4.1 SDI)."""
        try:
            self._di = parse_image(message.data)
        except DataError as error:
            self._events.put(Violation(what=str(error)))
        else:
            self._events.put(Notice(text=f"DI is {self._di:02X}h"))
        if self._polled_by is Command.GTD:
            if not self._say_wish(Command.GTD):
                self._answer_gtd(now)
        else:
            self._answer_sat()

    def _on_rty(self, now: Nanos) -> None:
        self._events.put(Violation(what="the control asks for a repetition (RTY)"))
        if self._exchange.say_again(now):
            self._answer = self._exchange.last
        else:
            self._interrupt(Outcome.FAILED, TOO_OFTEN, now)

    def _say_wish(self, poll: Command) -> bool:
        """Answer a poll by what the application wants to have said, if it may be said here."""
        self._polled_by = poll
        # Until SET has gone out every GTD gets WAT, and a control that goes on with GTD sends no further SAT.
        first = frozenset() if self._agreement.settled else {Command.SDO, Command.CLB}
        command = next((command for command in self._wishes if command in ANSWERS[poll] - first), None)
        if command is None:
            return False
        wish = self._wishes.pop(command)
        self._say(command, wish.data)
        if command is Command.SYN:
            self._begin_anew()
        return True

    def _obey_monitor(self, packet: MonitorPacket, now: Nanos) -> None:
        problem = self._streaming.obey(packet)
        if problem:
            self._interrupt(Outcome.FAILED, problem, now)
        elif self._state is State.AWAITING and self._streaming.our_turn:
            self._state = State.STREAMING
