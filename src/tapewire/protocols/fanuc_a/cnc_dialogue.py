"""How the dialogue of protocol A begins, breaks off and begins again at the control's end (B-63322EN-1 4.3, 4.6, 4.7).

Where the manual is silent, or speaks twice, the comment beside the code says what was chosen.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Alarm, Nanos, Notice, Outcome, Violation
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.protocols.fanuc_a.cnc_job import Phase
from tapewire.protocols.fanuc_a.cnc_law import State, Timer
from tapewire.protocols.fanuc_a.cnc_turn import Turn, legal_n
from tapewire.protocols.fanuc_a.messages import Command, Message, RetryReason, encode_message
from tapewire.protocols.fanuc_a.params import OpenLine, Retries, SynParameters
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState

__all__ = ["Dialogue"]

QUIET: Final = 20 * MILLISECOND
"""RTY waits until nothing has come for so long. An end code made by noise leaves the rest of its message on the way,
and what came in while RTY goes out would be lost (4.6 3)) and asked for once more."""


class Dialogue(Turn):
    """The turn, and all that begins or ends it: power-on, SYN and RDY, errors, the operator."""

    # 4.3 (1), 4.7: power-on and the state of the line

    def host_ready(self, now: Nanos) -> None:
        """DR is ON. After an open line it is for the host to begin, or for the control, as after power-on (4.6 1))."""
        self._host_here = True
        if self.state is not State.NOT_READY:
            return
        if self._broken and self._params.open_line is OpenLine.WAITS:
            self.state = State.SYN_WAIT
        else:
            self.timers.start(Timer.POWER_ON, now + round(self._params.start_time * SECOND))

    def host_gone(self, reason: str, *, for_good: bool) -> None:
        """3.2: DR OFF is an alarm during data transmission. Before, and when all is here, the control goes on."""
        self._host_here = False
        transmitting = self.up and self._job.phase is Phase.READING and not self._job.safe
        if transmitting:
            self._alarm(AlarmNumber.SR855, reason)
        elif self.up or for_good:
            self._events.put(Notice(text=f"the host is gone: {reason}"))
        if for_good and self._job.runs and not self._job.safe:
            self._job.finish(Outcome.FAILED, reason)
        self._break_off(State.CLOSED if for_good else State.NOT_READY)

    def _break_off(self, state: State) -> None:
        """Everything of the dialogue is over."""
        if self._status is not BufferState.NOT_READY:
            self._broken = True
            self._status = BufferState.OPEN_LINE
        self._clean()
        self.state = state
        self._job.let_go()

    def _clean(self) -> None:
        self._sender.drop()
        self.timers.stop_all()
        self.reader.break_off()
        self.room.end()
        self.leave_packets()
        self._due = None
        self._initialising = None
        self._notices.clear()
        self._poll_now = False
        self._retries = 0

    def initialise(self, now: Nanos) -> None:
        """The host's SYN: everything from the beginning, without the 2 s of power-on."""
        job = self._job
        if job.phase is Phase.READING and not job.safe:
            # Not stated. After a GTD the host has been at a program whose rest it no longer knows.
            if job.started:
                job.finish(Outcome.FAILED, "the host began anew with SYN in the middle of the program")
            else:
                job.link_down()
        job.let_go()
        if not job.safe:
            job.lose_buffer()
        self._clean()
        self._status = BufferState.NOT_READY
        self._begin_with(Command.SYN, now)
        self.rest(now)

    def _begin_with(self, command: Command, at: Nanos) -> None:
        self._initialising = command
        self._ask_at = at
        if command is Command.SYN and self._params.syn_parameters is SynParameters.POWER_ON:
            self.parameters = legal_n(self._params.wanted)

    def host_initialises(self, now: Nanos) -> None:
        """SYN was answered with SYN."""
        self._begin_with(Command.RDY, now)
        self.answered(now)

    def host_not_yet(self, now: Nanos) -> None:
        """RDY was answered with SYN. When to poll it again is not stated: Tp, as for every polling."""
        self._begin_with(Command(self._params.unready.value.upper()), now + self._tp)
        self.answered(now)

    def initialised(self, now: Nanos) -> None:
        """RDY was answered with RDY. SAT comes first: before it has been answered the host could not set n."""
        self._initialising = None
        self._broken = False
        self._status = BufferState.RESET
        self._job.link_up()
        self._poll_now = True
        self._ask_at = now
        if self.nc_alarm:
            self._to_alarm(AlarmCause.NC_ALARM)
            self._notices.append(Command.ALM)
        self.answered(now)

    # 4.6: errors

    def _alarm(self, number: AlarmNumber, detail: str) -> None:
        """An alarm of chapter 11, which ends what is running.

        It is none before the line is initialised, when nothing is being transmitted, and none for a program that is
        here as a whole.
        """
        text = text_of(number, detail)
        if not self.up or self._job.safe:
            self._events.put(Violation(what=f"{text} (no {number}: nothing of a program is being transmitted)"))
            return
        self._events.put(Alarm(number=number, text=text))
        if self._job.runs:
            self._job.finish(Outcome.FAILED, f"{number} {text}")

    def open_line(self, number: AlarmNumber, detail: str, now: Nanos) -> None:
        """4.6 1), 4.7 note 1: the line is broken off; then silence until the host's SYN, or all as at power-on."""
        self._alarm(number, detail)
        if self._status is BufferState.NOT_READY:
            self._status = BufferState.OPEN_LINE
        self._break_off(State.NOT_READY)
        if self._host_here:
            self.host_ready(now)

    def reception_error(self, cause: AlarmCause, number: AlarmNumber, detail: str, now: Nanos) -> None:
        """4.6 2), 4.7 note 2: what came is ignored, the state is alarm, SAT goes on."""
        ended_before = not self._job.runs
        self._status = BufferState.RESET if not self.up else self._status
        self._alarm(number, detail)
        if ended_before:
            self._job.let_go()
        self.room.end()
        self._due = None
        self._initialising = None
        self._poll_now = True
        self._retries = 0
        self._to_alarm(cause)
        self.rest(now)

    def too_many_naks(self) -> None:
        """An alarm that stops reception: CAN (5.3 1)), and then SAT says why."""
        assert self.session is not None
        self._alarm(AlarmNumber.SR945, f"{self._ne_exceeded} of one packet")
        self._to_alarm(AlarmCause.CHECKSUM)
        self._poll_now = True
        self.session.stop()

    def damaged(self, reason: RetryReason, now: Nanos) -> None:
        """4.6 2) (1): ask for it again, once nothing more comes."""
        if self._due is None:
            if self._too_many_retries():
                cause = AlarmCause.OVERRUN if reason is RetryReason.OVERRUN else AlarmCause.CHECKSUM
                detail = f"{self._ne_exceeded}, the last for {_why(reason)}"
                self.reception_error(cause, AlarmNumber.SR945, detail, now)
                return
            self._due = encode_message(Message(command=Command.RTY, data=reason.value), self._params.coding)
        self.heard_something(now)

    def heard_something(self, now: Nanos) -> None:
        """Characters come in: To begins again, and RTY waits."""
        if self._due is not None and self.state is not State.RESTING:
            self.timers.start(Timer.QUIET, now + max(QUIET, self._tx))

    def repeat(self, now: Nanos) -> None:
        """RTY of the host. 4.6 1) (7) against 4.6 2) (1): too many of the host's are an open line, of ours alarm 1."""
        if self._too_many_retries():
            self.open_line(AlarmNumber.SR945, f"{self._ne_exceeded}, the last the host's RTY", now)
            return
        if self.state is State.RESTING and not self._asks:
            # A GTD that is not meant any more would draw data that nobody takes.
            self._poll_now = True
        else:
            self._due = self._said
        self.rest(now)

    def forget_retry(self) -> None:
        """The answer has come after all: the RTY that waits for quiet is not said."""
        if self.state is not State.RESTING:
            self._due = None

    def _too_many_retries(self) -> bool:
        self._retries += 1
        return self._retries > self.parameters.ne

    @property
    def _ne_exceeded(self) -> str:
        return f"more than Ne = {self.parameters.ne} retries"

    # the operator and the CNC

    def cycle_start(self, now: Nanos) -> None:
        if self._params.retries is Retries.JOB:
            self._retries = 0
        if self.up:
            self._job.link_up()
            self._ask_at = now
            self.speak(now)

    def reset(self, now: Nanos) -> None:
        self.nc_alarm = False
        if self.up:
            self._status = BufferState.RESET
            self._notices.clear()
            self._notify(Command.RST, now)
        else:
            self._job.let_go()

    def go_to_alarm(self, now: Nanos) -> None:
        self.nc_alarm = True
        if self.up:
            self._to_alarm(AlarmCause.NC_ALARM)
            self._notify(Command.ALM, now)
        else:
            self._job.let_go()

    def _to_alarm(self, cause: AlarmCause) -> None:
        self._status, self._cause = BufferState.ALARM, cause

    def _notify(self, command: Command, now: Nanos) -> None:
        """4.4.1: transmitted as soon as it is possible to transmit, so after the answer that is still awaited."""
        if command not in self._notices:
            self._notices.append(command)
        if self.session is not None:
            self.session.stop()
            self.pump()
        self.room_freed(now)
        self.speak(now)

    # time

    def handle_timer(self, now: Nanos) -> None:
        for timer in self.timers.due(now):
            match timer:
                case Timer.POWER_ON:
                    self._begin_with(Command.SYN, now)
                    self.state = State.RESTING
                    self.speak(now)
                case Timer.TI:
                    self._sender.gap_over()
                case Timer.TO:
                    self._time_out(now)
                case Timer.QUIET:
                    assert self._due is not None
                    self._transmit(self._due)
                case _:
                    self.speak(now)

    def _time_out(self, now: Nanos) -> None:
        what = "no packet" if self.state is State.PACKETS else f"no answer, {self.state.value},"
        self.open_line(AlarmNumber.SR944, f"{what} within To = {self.parameters.to} s", now)


def _why(reason: RetryReason) -> str:
    return "a checksum error" if reason is RetryReason.CHECKSUM else "data after RS OFF"
