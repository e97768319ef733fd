"""The host of protocol A as its driver sees it: the engine contract, the deadlines, and what is heard.

What is answered is in `host.py`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Final

from tapewire.engine import (
    ALL_ON,
    SECOND,
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
    Timers,
    Violation,
)
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_a.host_agreement import Agreement
from tapewire.protocols.fanuc_a.host_exchange import Exchange, Heard
from tapewire.protocols.fanuc_a.host_job import Job
from tapewire.protocols.fanuc_a.host_law import State, Timer
from tapewire.protocols.fanuc_a.host_streaming import SourcePoll, Streaming
from tapewire.protocols.fanuc_a.messages import Command, Message, Unreadable, encode_image
from tapewire.protocols.fanuc_a.packets import BadMonitor, MonitorPacket
from tapewire.protocols.fanuc_a.params import First, Params
from tapewire.protocols.fanuc_a.status import disbelief

__all__ = ["BEGUN", "UNDER_WAY", "HostLine"]

LEAVING: Final[Nanos] = SECOND
"""After a job has ended, the last answer gets so long to leave before the end is told."""

BEGUN: Final = frozenset({State.SENDING, State.STREAMING, State.AWAITING, State.DELIVERED})
"""The control has, or may have, some of the program."""

UNDER_WAY: Final = BEGUN | {State.ARMED}

NOT_EXECUTED: Final = "delivered whole, not executed"

UNNOTICED: Final = 16
"""Characters that may leave between RS OFF and our hearing of it: what a UART's FIFO holds."""

BETWEEN_JOBS: Final = (Command.CLB, Command.SYN)
"""What would spoil a job under way."""

TOO_OFTEN: Final = "more repetitions than Ne allows"

MOST_DOUBTS: Final = 3
"""A SAT that cannot be is asked for again so often, and not more than Ne times: after that it is no damage."""


class HostLine(ABC):
    """Bytes, signals and time in; bytes, deadlines and events out."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state = State.IDLE
        self._timers = Timers()
        self._events = Events()
        self._agreement = Agreement(params)
        self._exchange = Exchange(params, self._agreement, self._timers)
        self._outbox = self._exchange.outbox
        self._rs = True
        self._sees_rs = False
        self._er = False
        self._closed = False
        self._recall = False
        self._job: Job | None = None
        self._poll = SourcePoll(self._timers)
        self._streaming = Streaming(params, self._agreement, self._outbox, self._timers, self._poll, self._events)
        self._fresh = False
        self._armed_at: Nanos = 0
        self._asked_at: Nanos = 0
        self._polled_by: Command | None = None
        self._wishes: dict[Command, Message] = {}
        self._crossed: Message | None = None
        self._di: int | None = None
        self._proven = 0
        self._high = 0
        self._told: set[str] = set()
        self._sdi_due = False
        self._doubted = 0
        self._had_all_again = False
        self._stored_at_end: int | None = None
        self._canned = False
        self._nudged = False
        self._answer: Command | None = None
        self._ending: Ended | None = None
        if params.first is First.HOST:
            self._exchange.say(Message(command=Command.SYN))

    @abstractmethod
    def _obey_message(self, message: Message, now: Nanos) -> None:
        """Answer it."""

    @abstractmethod
    def _obey_monitor(self, packet: MonitorPacket, now: Nanos) -> None: ...

    @abstractmethod
    def _send_dat(self, now: Nanos, *, late: bool) -> None:
        """Answer the GTD that waits for the source; `late` when the control can wait no longer."""

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        if self._closed or not data:
            return
        self._exchange.begin(now)
        for heard in self._exchange.read(data, now):
            self._hear(heard, now)
        self._settle(now)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """The message it belongs to is asked for again (4.6)."""
        if not self._closed:
            self._events.put(Violation(what=f"{fault} in what the control sent"))
            self._exchange.damage(now)
            self._settle(now)

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        """Host CTS is the control's RS, host DSR its ER (3.2)."""
        self._exchange.begin(now)
        self._sees_rs = True
        if signals.cts != self._rs:
            self._rs = signals.cts
            if not self._outbox.empty:
                self._events.put(Resumed(why="RS is ON again") if self._rs else Held(why="the control's RS is OFF"))
        if self._er and not signals.dsr:
            self._interrupt(Outcome.FAILED, "the control's ER fell: it lost power or gave up the line", now)
            self._streaming.close()
            self._outbox.abandon()
        self._er = signals.dsr
        self._settle(now)

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._closed = True
        if self._state in UNDER_WAY:
            reason = f"{NOT_EXECUTED}: {reason}" if self._state is State.DELIVERED else reason
            self._end(Outcome.FAILED, f"the line is gone: {reason}", now)
        self._streaming.close()
        self._outbox.put(b"")
        self._recall = False
        self._finish()
        self._timers.stop_all()

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        if not self._rs or self._closed or self._recall:
            return b""
        return self._outbox.look(min(limit, self._tolerated) if self._sees_rs else limit)

    @property
    def _tolerated(self) -> int:
        """What may be handed over so that RS OFF never finds more than No on its way (4.3 (5)): the No that is certain
        to be in force is 50 until a SAT has confirmed the SET. A line that does not show RS is not stopped by it.
        """
        return max(self._most_in_flight - self._outbox.in_flight, 0)

    @property
    def _most_in_flight(self) -> int:
        return max(1, self._agreement.no - UNNOTICED)

    def _watch_room(self, now: Nanos) -> None:
        """A line wakes us when it has room by its own window, which may be larger, or else when it is empty."""
        over = self._outbox.in_flight - self._most_in_flight // 2
        if self._sees_rs and self._outbox.rate and over > 0 and not self._outbox.empty:
            self._timers.start(Timer.ROOM, now + over * SECOND // self._outbox.rate)
        else:
            self._timers.stop(Timer.ROOM)

    def data_sent(self, count: int, now: Nanos) -> None:
        self._outbox.hand_over(count, now)
        self._high = max(self._high, self._outbox.reached)
        if self._state is State.STREAMING and self._streaming.end_gone:
            self._state = State.AWAITING
        self._settle(now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._outbox.leave(count, now)
        self._settle(now)

    def data_discarded(self, count: int, now: Nanos) -> None:
        self._recall = False
        self._outbox.call_back(count)
        if self._outbox.holds_program:
            if self._outbox.untouched:
                self._exchange.say(Message(command=Command.WAT))
            elif not self._outbox.empty:
                self._outbox.break_off()
        self._settle(now)

    @property
    def recall(self) -> bool:
        return self._recall

    @property
    def signals(self) -> SignalsOut:
        """Always ON: the host can receive whenever the line is open."""
        return ALL_ON

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def handle_timer(self, now: Nanos) -> None:
        for timer in self._timers.due(now):
            self._on_timer(timer, now)
        self._settle(now)

    def next_event(self) -> Event | None:
        return self._events.get()

    def _on_timer(self, timer: Enum, now: Nanos) -> None:
        match timer:
            case Timer.SILENCE:
                self._on_silence(now)
            case Timer.INTERBYTE:
                broken = self._exchange.break_off()
                if broken is not None:
                    self._hear(broken, now)
            case Timer.QUIET:
                if not self._exchange.wait_for_turn(Timer.QUIET, now) and not self._exchange.ask_again():
                    self._interrupt(Outcome.FAILED, TOO_OFTEN, now)
            case Timer.REPEAT:
                if not self._exchange.wait_for_turn(Timer.REPEAT, now):
                    self._exchange.repeat()
            case Timer.CROSSED:
                self._on_crossed(now)
            case Timer.SOURCE | Timer.WAT if self._timers.running(Timer.QUIET):
                self._timers.start(timer, now + self._exchange.turn_time)
            case Timer.SOURCE | Timer.WAT if not self._streaming.active:
                self._send_dat(now, late=timer is Timer.WAT)
            case Timer.KEEP_ALIVE:
                self._streaming.keep_alive()
            case Timer.VERDICT:
                self._streaming.no_verdict()
            case Timer.HELD:
                self._interrupt(Outcome.FAILED, f"held for longer than held_limit={self._params.held_limit:g} s", now)
            case Timer.DAMAGED:
                self._interrupt(Outcome.FAILED, "a monitor packet could not be read and nothing came after it", now)
            case Timer.LEAVING:
                self._finish()

    def _settle(self, now: Nanos) -> None:
        """After every call: the next packet, the watch for silence, the end of a job."""
        problem = self._streaming.pump(now, hearing=self._exchange.reader.pending > 0)
        if problem:
            self._interrupt(Outcome.FAILED, problem, now)
        self._watch_hold(now)
        self._watch_room(now)
        ours = self._timers.running(Timer.WAT, Timer.QUIET, Timer.REPEAT, Timer.CROSSED)
        if not self._closed:
            if self._streaming.our_turn and self._state is State.ARMED:
                self._exchange.watch_from(self._armed_at)
            else:
                self._exchange.watch(not ours and not self._streaming.our_turn, now)
        if self._outbox.idle and not self._recall:
            self._finish()

    def _watch_hold(self, now: Nanos) -> None:
        """A feed hold lasts as long as it lasts, so there is a limit only where a person has set one."""
        held = self._streaming.held or (not self._rs and not self._outbox.empty)
        if not (held and self._state in BEGUN and self._params.held_limit):
            self._timers.stop(Timer.HELD)
        elif not self._timers.running(Timer.HELD):
            self._timers.start(Timer.HELD, now + round(self._params.held_limit * SECOND))

    # hearing

    def _hear(self, heard: Heard, now: Nanos) -> None:
        match heard:
            case Message() if doubt := self._doubt(heard):
                self._hear_nothing(doubt, now)
            case Message():
                self._hear_message(heard, now)
            case MonitorPacket() if self._streaming.active:
                self._obey_monitor(heard, now)
            case MonitorPacket(monitor=monitor):
                self._events.put(Violation(what=f"{monitor.name} while no packets are on"))
            case Unreadable(error=error):
                self._hear_nothing(f"{error} in what the control said", now)
            case BadMonitor():
                self._hear_nothing("monitor packet that cannot be read", now, monitor=True)
        self._exchange.reader.monitors = self._agreement.n > 0
        self._settle(now)

    def _doubt(self, message: Message) -> str:
        """Why this SAT is asked for again although its sum is right; empty when it is not.

        A 0 lost and another doubled keep the sum and shift what stands between: where that makes a state or a parameter
        that cannot be (4.4.2, 4.5), the rest may be another too. Among packets nothing can ask.
        """
        if message.command is not Command.SAT or self._streaming.our_turn:
            return ""
        doubt = disbelief(message.data, self._agreement.base)
        self._doubted = self._doubted + 1 if doubt else 0
        return doubt.what if doubt and not self._doubted_enough else ""

    @property
    def _doubted_enough(self) -> bool:
        return self._doubted > min(MOST_DOUBTS, self._agreement.ne)

    def _hear_nothing(self, what: str, now: Nanos, *, monitor: bool = False) -> None:
        """4.6: what arrived damaged is asked for again; among packets nothing can ask, so the transfer is held."""
        self._events.put(Violation(what=what))
        self._drop_crossed()
        if self._streaming.our_turn:
            self._streaming.hold_damaged(now)
        elif not monitor and not self._timers.running(Timer.REPEAT):
            self._exchange.wait_for_quiet(now)

    def _hear_message(self, message: Message, now: Nanos) -> None:
        self._timers.stop(Timer.QUIET)
        self._timers.stop(Timer.REPEAT)
        self._told.discard("silence")
        if self._exchange.last is Command.RTY and message.command is not Command.RTY:
            self._crossed = message
            self._timers.start(Timer.CROSSED, now + self._exchange.turn_time)
            return
        self._obey_message(message, now)

    def _on_crossed(self, now: Nanos) -> None:
        """Our RTY may have crossed the message it asks for: then that comes twice, and an answer to the first would be
        taken for the answer to the second, or be lost.
        """
        message = self._crossed
        if self._exchange.reader.pending or not self._outbox.idle:
            self._timers.start(Timer.CROSSED, now + self._exchange.turn_time)
        elif message is not None:
            self._obey_message(message, now)

    def _drop_crossed(self) -> None:
        self._crossed = None
        self._timers.stop(Timer.CROSSED)

    def _on_silence(self, now: Nanos) -> None:
        """4.3 (4), 4.6 1): after an open-line error a control waits for our SYN, by the likeliest reading."""
        if "silence" not in self._told:
            self._told.add("silence")
            self._events.put(Violation(what="the control is silent: SYN"))
        if self._state is State.AWAITING and not self._nudged:
            self._nudge()
            return
        self._interrupt(Outcome.FAILED, "the control was silent for longer than Tp + Tx", now)
        self._begin_anew()
        self._exchange.say(Message(command=Command.SYN))

    def _nudge(self) -> None:
        """A control that lost a character of the end packet waits for the last one. Whatever it hears now completes
        the packet, and it draws NAK; one that is not among packets obeys the SYN, and the job ends as failed.
        """
        self._nudged = True
        self._exchange.say(Message(command=Command.SYN))

    def _begin_anew(self) -> None:
        self._streaming.close()
        self._told.discard("status")
        self._sdi_due = False
        self._agreement.begin_anew()
        self._exchange.forget_retries()

    # what the application wants to have said

    def read_di(self, now: Nanos) -> None:
        """Ask for the DI byte (RDI); `di` has it when SDI has come."""
        self._wishes[Command.RDI] = Message(command=Command.RDI)

    @property
    def di(self) -> int | None:
        """The DI byte G152 as the control last told it."""
        return self._di

    def set_do(self, image: int, now: Nanos) -> None:
        """Set the DO byte F152 (SDO). Raises UsageError for anything but 0 to 255."""
        if not 0 <= image <= 0xFF:
            raise UsageError(f"DO is a byte, 0 to 255, not {image}")
        self._wishes[Command.SDO] = Message(command=Command.SDO, data=encode_image(image))

    def clear_buffer(self, now: Nanos) -> None:
        """Clear the control's buffer (CLB). Raises UsageError during a job: its blocks would be skipped unseen."""
        self._wish_between_jobs(Command.CLB)

    def initialise(self, now: Nanos) -> None:
        """Have the control initialise itself anew (SYN). Raises UsageError during a job, which would be lost."""
        self._wish_between_jobs(Command.SYN)

    def _wish_between_jobs(self, command: Command) -> None:
        if self._state in BEGUN:
            raise UsageError(f"{command.value} would spoil the job under way; abort it or wait for its end")
        self._wishes[command] = Message(command=command)

    def _drop_wishes(self) -> None:
        """A job is under way: what was wished before it and not yet said would spoil it."""
        for command in BETWEEN_JOBS:
            if self._wishes.pop(command, None) is not None:
                self._events.put(Notice(text=f"{command.value} was not said any more: a job has begun"))

    # the end of a job

    @property
    def _certain(self) -> int:
        """Bytes of the program that are proven to be with the control."""
        if self._state is State.DELIVERED:
            return self._high
        return max(self._proven, self._proven_by_packets)

    @property
    def _proven_by_packets(self) -> int:
        """Packets may be on without being those of this job."""
        return self._streaming.proven if self._state in (State.STREAMING, State.AWAITING) else 0

    @property
    def _is_sending_dat(self) -> bool:
        return self._state is State.SENDING and self._exchange.last is Command.DAT

    def _interrupt(self, outcome: Outcome, reason: str, now: Nanos) -> None:
        """Something ended the transfer, if one has begun."""
        if self._state in BEGUN:
            whole = f"{NOT_EXECUTED}: " if self._state is State.DELIVERED else ""
            self._end(outcome, whole + reason, now)

    def _end(self, outcome: Outcome, reason: str, now: Nanos) -> None:
        """The job is over; it is told when the last answer has left. Nothing of it is ever said again, and a DAT that
        has not left is cut off: the control must not take the rest of a job that has failed.
        """
        self._recall = self._is_sending_dat and not self._outbox.idle and outcome is not Outcome.COMPLETE
        self._ending = Ended(outcome=outcome, reason=reason, bytes_low=self._certain, bytes_high=self._high)
        if self._exchange.last is Command.DAT:
            self._exchange.say_next_time(Message(command=Command.WAT))
        if self._timers.running(Timer.WAT):
            self._exchange.say(Message(command=Command.WAT))
        self._timers.stop(Timer.WAT)
        self._timers.stop(Timer.SOURCE)
        self._streaming.give_up()
        # Without EOR the control may still be in the same reading: what it asks for next is no beginning (8.2).
        ended_the_tape = self._job is not None and self._job.has_ended_the_tape
        self._job = None
        self._state = State.FINISHED if outcome is Outcome.COMPLETE else State.IDLE
        self._fresh = self._fresh or (outcome is Outcome.COMPLETE and ended_the_tape)
        self._timers.start(Timer.LEAVING, now + LEAVING)

    def _finish(self) -> None:
        ending, self._ending = self._ending, None
        self._timers.stop(Timer.LEAVING)
        if ending is not None:
            high = max(self._high, ending.bytes_high, self._outbox.will_reach)
            low = high if ending.outcome is Outcome.COMPLETE else ending.bytes_low
            assert 0 <= low <= high, f"proven {low} of {high} handed over"
            self._events.put(Ended(outcome=ending.outcome, reason=ending.reason, bytes_low=low, bytes_high=high))
