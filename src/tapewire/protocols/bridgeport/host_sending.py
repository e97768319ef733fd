"""What the control says of a program on its way to it: XOFF and XON, ACK and NAK, a cancel, and what came damaged.

`host.py` hears it and calls this, which is between the line and the life of the job in `host_job.py`.
"""

from __future__ import annotations

from typing import Final

from tapewire.codes import name_of
from tapewire.engine import SECOND, Held, LineFault, Nanos, Outcome, Requested, Resumed, Violation
from tapewire.protocols.bridgeport.host_job import ASK_AGAIN, Job
from tapewire.protocols.bridgeport.host_law import SENDING, Heard, State, Timer
from tapewire.protocols.bridgeport.host_transmission import LinkRecords, LoadText

__all__ = ["Sending"]

DAMAGED_WAIT: Final[Nanos] = 60 * SECOND
"""A damaged character stops us, since it may have been XOFF: after so long without another, the job has failed."""


class Sending(Job):
    """The control's part in a transmission."""

    def _on_fault_while_sending(self, fault: LineFault, now: Nanos) -> None:
        """It can hardly be anything but XOFF or a cancel, so we stop: a pause is better than an overrun."""
        self._note_certain(now)
        self._may_be_over = True
        self._timers.stop(Timer.GRACE)
        if not self._held:
            self._held = True
            self._events.put(Held(why=f"{fault}: it may have been XOFF"))
        elif not self._timers.running(Timer.DAMAGED):
            return  # a pause that XOFF began is as long as a pause may be
        self._timers.start(Timer.DAMAGED, now + DAMAGED_WAIT)

    def _ignore(self, heard: Heard, character: int) -> None:
        """What has no row in the table: in silence if it may be half of a cancel pair, or blank tape."""
        if self._state not in SENDING and character in self._params.cancel_tail | self._params.ignore_rx:
            return
        what = "characters that are no codes" if heard is Heard.TEXT else name_of(character)
        self._events.put(Violation(what=f"the control sent {what} while this end was {self._state.value}"))

    @property
    def _end_has_left(self) -> bool:
        """A control that begins anew, or goes, before the end has left this end has not had it."""
        return not self._more_to_send and not self._delivery.in_flight

    def _on_cancel(self, character: int, now: Nanos) -> None:
        """4.3.2: stop, throw the rest away, wait for another request. Nothing is answered, and no XON is due."""
        self._held = False
        if self._state is State.REST and self._name is None:
            self._spoilt_name = self._behind = ""
            self._ignore(Heard.CANCEL, character)
            return
        whole = "sent whole, then " if self._state is State.TAIL and self._end_has_left else ""
        self._end(Outcome.CANCELLED, f"{whole}cancelled at the control ({name_of(character).split()[0]})", now)

    def _on_xoff(self, character: int, now: Nanos) -> None:
        """3.1, 3.2. At rest it may be one that crossed our last characters."""
        if self._state is State.RECEIVING:
            return
        if self._state is State.REST:
            self._held = self._just_ended(now)
            self._ignore(Heard.XOFF, character)
            return
        was_damaged = self._timers.running(Timer.DAMAGED)
        self._timers.stop(Timer.DAMAGED)
        if self._held and not was_damaged:
            return
        self._held = True
        if self._state is not State.TAIL or self._more_to_send:
            self._events.put(Held(why="XOFF"))
            self._start(Timer.PAUSE, self._params.pause_limit, now)

    def _on_xon(self, character: int, now: Nanos) -> None:
        if self._state is State.RECEIVING:
            return
        if self._held and self._may_be_over and self._state is State.TEXT and self._is_nameless:
            self._held = False
            why = "DC1 behind a damaged character: XON, or a new request if that was a cancel, which only a name tells"
            self._end(Outcome.FAILED, f"{why}; {ASK_AGAIN}", now)
        elif self._held:
            self._resume("XON")
        elif self._state is State.TAIL:
            self._events.put(Requested(served=False))
        else:
            self._ignore(Heard.XON, character)

    @property
    def _is_nameless(self) -> bool:
        """Asked for by DC1 alone (1.2.1): asked for again it is by the same."""
        return isinstance(self._transmission, LoadText) and not self._transmission.named

    def _resume(self, why: str) -> None:
        for timer in (Timer.PAUSE, Timer.GRACE, Timer.DAMAGED):
            self._timers.stop(timer)
        self._held = False
        if self._more_to_send or self._state is not State.TAIL:
            self._may_be_over = False
        self._events.put(Resumed(why=why))

    def _on_ack(self, now: Nanos) -> None:
        """4.2.1: the next record. While XOFF holds, 3.2 still wants an XON first."""
        if not isinstance(self._transmission, LinkRecords):
            self._on_answered_text(Heard.ACK, self._params.ack, now)
            return
        if self._state in (State.RECORD, State.TAIL) and not self._transmission.only_end_is_left:
            self._ignore(Heard.ACK, self._params.ack)
            self._transmission.ack_inside()
        else:
            self._answered(now)
            self._transmission.ack()
        self._follow(now)

    def _on_nak(self, now: Nanos) -> None:
        """4.2.1: the same record; one that is still going out is finished first."""
        if not isinstance(self._transmission, LinkRecords):
            self._on_answered_text(Heard.NAK, self._params.nak, now)
            return
        if self._state is State.TAIL:
            self._on_refused_end(now)
            return
        self._events.put(Violation(what="NAK: a record arrived damaged"))
        self._answered(now)
        self._transmission.nak()
        self._follow(now)

    def _on_answered_text(self, heard: Heard, character: int, now: Nanos) -> None:
        if self._has_guessed:
            self._end_guess(name_of(character).split()[0], now)
        else:
            self._ignore(heard, character)

    def _on_refused_end(self, now: Nanos) -> None:
        """The text knows no such answer, but it is none that says the program is in.

        Before the end has left it is a second answer to the last record, as it would be to any other.
        """
        assert isinstance(self._transmission, LinkRecords)
        if not self._end_has_left:
            self._transmission.nak()
            self._follow(now)
            return
        why = "sent whole, but the control answers the end with NAK: look there whether the program is in; dnc_end says"
        self._end(Outcome.FAILED, f"{why} what else the end may be", now)

    def _answered(self, now: Nanos) -> None:
        self._timers.stop(Timer.ACK)
        if self._held and self._params.xoff_ack_grace:
            self._start(Timer.GRACE, self._params.xoff_ack_grace, now)
