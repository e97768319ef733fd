"""The life of a job at the host's end: armed, requested, under way, over; and what is known of it at each moment.

`host.py` hears what the control says and calls this; here is what follows from it for the job.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tapewire.engine import (
    MILLISECOND,
    SECOND,
    Ended,
    Events,
    LineFault,
    Nanos,
    Notice,
    Outcome,
    Received,
    Requested,
    Sink,
    Source,
    Started,
    Timers,
)
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.host_arming import Arming, Library, OneProgram, OneSink, Policy, Shelf
from tapewire.protocols.bridgeport.host_law import SENDING, State, Timer
from tapewire.protocols.bridgeport.host_reception import Reception
from tapewire.protocols.bridgeport.host_text import Text
from tapewire.protocols.bridgeport.host_transmission import Guess, LinkRecords, LoadText, Transmission
from tapewire.protocols.bridgeport.messages import Mode, Name, Params, WhenMissing
from tapewire.protocols.delivery import Delivery
from tapewire.protocols.settings import Switch

__all__ = ["AGAIN", "ASK_AGAIN", "Job"]

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often a source that had nothing yet is asked again."""

LIBRARY_POLL: Final[Nanos] = SECOND
"""How often a program that the control waits for is looked for again: no person notices a shorter wait."""

ASK_AGAIN: Final = "cancel at the control and ask again"

AGAIN: Final = "cancel the transfer at the control before anything else is sent to it"

GUESSED: Final = (
    "the name had no letter, and REMOTE LOAD was guessed by the length: look there whether the program is in"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ending:
    """A job that is over while what was on its way is called back, and all that tells how much of it arrived.

    It is put aside, since the control may begin another transaction before that is known.
    """

    outcome: Outcome
    reason: str
    progress: int
    transmission: Transmission | None
    delivery: Delivery
    certain: int

    def delivered(self) -> tuple[int, int]:
        """Bytes the control has for certain, and at most; of a program from the control, what is stored."""
        transmission = self.transmission
        if self.outcome is Outcome.COMPLETE or transmission is None:
            return self.progress, self.progress
        high = min(transmission.position, self.delivery.sent)
        low = self.certain if transmission.proven is None else transmission.proven
        return min(low, high), high


class Job:
    """At most one job at a time, and the dialogue's state."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state = State.REST
        self._timers = Timers()
        self._events = Events()
        self._arming: Arming | None = None
        self._name: Name | None = None
        self._spoilt_name = ""
        """What was wrong with the name before the request that is due; empty while nothing was."""
        self._transmission: Transmission | None = None
        self._asked_for = ""
        self._reception: Reception | None = None
        self._behind = ""
        """At rest: what came before and had no end; empty where there is none."""
        self._pause_wanted = False
        self._pause_told = False
        self._replies = bytearray()
        self._held = False
        self._ended_at: Nanos | None = None
        self._delivery = Delivery()
        self._certain = 0
        self._may_be_over = False
        self._ending: _Ending | None = None
        self._tail_verdict: tuple[Outcome, str] | None = None
        self._recall = False

    # the application's side

    def start(self, source: Source, now: Nanos) -> None:
        """Arm one program: it goes to the next request, whatever number that names."""
        self._arm(Arming(policy=Policy.ONCE, library=OneProgram(source)), now)

    def receive(self, sink: Sink, now: Nanos) -> None:
        """Arm a reception: the next program the control sends goes to `sink`, whatever its number."""
        self._arm(Arming(policy=Policy.ONCE, shelf=OneSink(sink)), now)

    def serve(
        self, library: Library | None, now: Nanos, *, shelf: Shelf | None = None, policy: Policy = Policy.STANDING
    ) -> None:
        """Give out programs by number from `library`, and take them in by number to `shelf`."""
        self._arm(Arming(policy=policy, library=library, shelf=shelf), now)

    def answer(self, source: Source, now: Nanos) -> None:
        """The operator gives the program that the control waits for (1.2). Raises UsageError when it does not."""
        if self._state is not State.HOLD:
            raise UsageError(f"the control waits for no program ({self._state.value}); arm it with start")
        self._stop_waiting()
        self._begin(source, now)

    def abort(self, now: Nanos) -> None:
        """Fall silent, call back what has not left, and disarm. No EOT is sent: a cut program cannot look whole."""
        self._break_off()
        if self._has_job and self._ending is None:
            self._end(Outcome.CANCELLED, f"given up here; {AGAIN}", now)
        elif self._state is State.HOLD:
            self._rest()
        self._arming = None

    def hold_reception(self, now: Nanos) -> None:
        """Ask the control to pause, now or as soon as it sends (3.1). It may still send three characters."""
        self._pause_wanted = True

    def release(self, now: Nanos) -> None:
        """Let it go on."""
        self._pause_wanted = False

    @property
    def state(self) -> State:
        return self._state

    @property
    def progress(self) -> int:
        if self._transmission is not None:
            return self._transmission.position
        return self._reception.stored if self._reception is not None else 0

    # what is going on

    @property
    def _in_transfer(self) -> bool:
        """A program is under way."""
        if self._state in (State.RECEIVING, State.SAVED):
            return self._reception is not None and self._reception.kept
        return self._state in SENDING

    @property
    def _has_job(self) -> bool:
        once = self._arming is not None and self._arming.policy is Policy.ONCE
        return once or self._in_transfer

    @property
    def _more_to_send(self) -> bool:
        """Characters of this transfer wait for the line, or for XON."""
        if self._state not in SENDING:
            return False
        if self._state is State.TAIL:
            return bool(self._replies) or (self._transmission is not None and bool(self._transmission.look(1)))
        return self._state is not State.WAIT_ACK

    @property
    def _what(self) -> str:
        return _called(self._name)

    def _start(self, timer: Timer, seconds: float, now: Nanos) -> None:
        """Run `timer`; 0 stands for never."""
        if seconds:
            self._timers.start(timer, now + round(seconds * SECOND))

    # a program for the control

    def _arm(self, arming: Arming, now: Nanos) -> None:
        if self._has_job or self._ending is not None:
            raise UsageError(f"a job is under way ({self._state.value}); abort it or wait for its end")
        self._arming = arming
        self._transmission = None
        self._behind = ""
        self._pause_wanted = False
        if self._state is State.HOLD:
            self._stop_waiting()
            self._state = State.REST
        if self._state is not State.RECEIVING:
            self._reception = None

    def _serve(self, now: Nanos) -> None:
        """1.2.1: the control wants a program; by its name, where it said one."""
        self._held = False
        source = self._look_up()
        self._events.put(Requested(number=self._name.number if self._name else None, served=source is not None))
        if source is not None:
            self._begin(source, now)
        elif self._arming is not None and self._arming.library is None:
            text = f"the control asks for {self._what} while we only receive: not answered"
            self._name = None
            self._events.put(Notice(text=text))
        elif self._arming is not None and self._params.missing is WhenMissing.EOT:
            self._refuse(now)
        else:
            self._state = State.HOLD
            self._start(Timer.HOLD, self._params.hold_limit, now)
            self._look_again_later(now)

    def _look_up(self) -> Source | None:
        if self._arming is None or self._arming.library is None:
            return None
        name = self._name
        return self._arming.library.find(name.number if name else None, name.mode if name else None)

    def _look_again(self, now: Nanos) -> None:
        """1.2: what the control waits for may have been put into the library meanwhile."""
        source = self._look_up()
        if source is not None:
            self.answer(source, now)
        else:
            self._look_again_later(now)

    def _look_again_later(self, now: Nanos) -> None:
        if self._arming is not None and self._arming.library is not None:
            self._timers.start(Timer.LIBRARY, now + LIBRARY_POLL)

    def _just_ended(self, now: Nanos) -> bool:
        after = round(self._params.stray_xon_time * SECOND)
        return self._ended_at is not None and now - self._ended_at < after

    def _stop_waiting(self) -> None:
        self._timers.stop(Timer.HOLD)
        self._timers.stop(Timer.LIBRARY)

    def _refuse(self, now: Nanos) -> None:
        """An empty program, which is what the control is told where `missing` says so."""
        self._tail_verdict = Outcome.FAILED, f"there is no {self._what}: an empty program was sent"
        self._name = None
        self._forget_the_last()
        self._replies[:] = bytes([self._params.text_end])
        self._state = State.TAIL

    def _begin(self, source: Source, now: Nanos) -> None:
        name, self._name = self._name, None
        text = Text(source, self._params)
        self._forget_the_last()
        self._replies.clear()
        self._tail_verdict = None
        self._asked_for = _called(name)
        match name.mode if name is not None else Mode.LOAD:
            case Mode.LOAD:
                self._take_up(LoadText(text, self._params, named=name is not None), now)
            case Mode.LINK:
                self._take_up(LinkRecords(text, self._params), now)
            case None:
                self._transmission = Guess(text, self._params)
                self._state = self._transmission.state
                self._pump(now)

    def _take_up(self, transmission: LoadText | LinkRecords, now: Nanos) -> None:
        by = "REMOTE LOAD" if isinstance(transmission, LoadText) else "DNC LINK"
        self._events.put(Started(why=f"{self._asked_for} by {by}"))
        self._transmission = transmission
        self._state = transmission.state
        self._pump(now)
        if self._state is State.WAIT_ACK:
            self._start(Timer.ACK, self._params.ack_limit, now)

    def _forget_the_last(self) -> None:
        """What is told of the job that begins is its own."""
        self._reception = self._transmission = None
        self._delivery = Delivery(stale=self._delivery.on_the_way)
        self._certain = 0
        self._may_be_over = False

    def _pump(self, now: Nanos) -> None:
        transmission = self._transmission
        assert transmission is not None
        transmission.pump()
        if isinstance(transmission, Guess) and transmission.chosen is not None:
            self._take_up(transmission.chosen, now)
        else:
            self._follow(now)

    def _follow(self, now: Nanos) -> None:
        """Take over where the transmission stands."""
        transmission = self._transmission
        assert transmission is not None
        while transmission.notices:
            self._events.put(Notice(text=transmission.notices.pop(0)))
        if transmission.problem:
            begun = f"; {AGAIN}" if transmission.position else ""
            self._end(Outcome.FAILED, transmission.problem + begun, now)
            return
        if transmission.starved:
            self._timers.start(Timer.SOURCE, now + SOURCE_POLL)
        before, self._state = self._state, transmission.state
        if self._state is State.WAIT_ACK and before is not State.WAIT_ACK:
            self._start(Timer.ACK, self._params.ack_limit, now)
        self._listen_in_tail(now)

    def _listen_in_tail(self, now: Nanos) -> None:
        """From when the last character has left, a cancel may still come."""
        if self._state is not State.TAIL or self._more_to_send or self._delivery.in_flight:
            return
        if not self._timers.running(Timer.END):
            self._timers.stop(Timer.PAUSE)
            self._start(Timer.END, self._params.end_wait, now)

    def _finish_tail(self, now: Nanos) -> None:
        guess = f"; {GUESSED}" if self._has_guessed else ""
        whole = Outcome.COMPLETE, f"the control has been sent the whole program{guess}"
        outcome, reason = self._tail_verdict or whole
        self._end(outcome, reason, now)

    @property
    def _has_guessed(self) -> bool:
        return isinstance(self._transmission, LoadText) and self._transmission.guessed

    def _end_guess(self, answer: str, now: Nanos) -> None:
        """Nothing acknowledges a text (2.1): a control that answers it wanted records, and keeps nothing of this."""
        self._end(Outcome.FAILED, f"{answer} to a text, as to a record of DNC LINK: {GUESSED}; {AGAIN}", now)

    def _note_certain(self, now: Nanos) -> None:
        """What came damaged may have been the end of the transfer: until XON nothing behind it proves more."""
        if not self._may_be_over:
            self._certain = self._delivery.certain(now)

    def _doubt(self, fault: LineFault, now: Nanos) -> None:
        """Nothing of ours is under way, so it may have been a cancel: what hangs on its not being one is doubtful."""
        match self._state:
            case State.TAIL:
                self._doubt_the_end(now)
            case State.SAVED:
                assert self._reception is not None
                self._reception.damage = self._reception.damage or f"{fault} behind its end"
            case State.HOLD:
                self._events.put(Notice(text=f"it may have been a cancel: {self._what} is not waited for any more"))
                self._rest()
            case State.WAIT_ACK:
                why = f"it may have been the answer to a record: if nothing follows, {ASK_AGAIN}"
                self._events.put(Notice(text=why))
            case State.REST if self._name is not None:
                self._name, self._spoilt_name = None, f"{fault} behind it"
            case State.REST:
                self._held = self._held or self._just_ended(now)
            case _:
                pass

    def _doubt_the_end(self, now: Nanos) -> None:
        """It may have been XOFF, too, and then an XON is still due, which is no request."""
        self._note_certain(now)
        self._held = self._may_be_over = True
        if self._tail_verdict is None:
            why = "sent whole, then a damaged character came, which may have been a cancel: see at the control"
            self._tail_verdict = Outcome.FAILED, f"{why} whether the program is in"

    def _lose_the_control(self, now: Nanos) -> None:
        """DSR fell and no program is under way: the control, or the one that comes back, has asked for nothing."""
        behind = self._break_off() or self._behind
        if self._state is State.HOLD:
            self._events.put(Notice(text=f"DSR fell: {self._what} is not waited for any more"))
        spoilt = self._spoilt_name
        if self._state is State.RECEIVING or (self._state is State.REST and self._name is not None):
            spoilt = "DSR fell inside it or behind it"
        if self._state is State.RECEIVING and self._pause_told:
            # Nothing would ever let it go on: not XON either, which at rest could pass for an answer.
            self._end(Outcome.FAILED, f"DSR fell while the control was held by XOFF: {ASK_AGAIN}", now)
        else:
            self._rest()
        self._spoilt_name, self._behind = spoilt, behind

    # a program from the control

    def _place(self) -> Sink | None:
        """A program is coming in: where to?"""
        shelf = self._arming.shelf if self._arming is not None else None
        sink = shelf.place(self._name.number if self._name is not None else None) if shelf is not None else None
        if sink is not None:
            self._events.put(Started(why=f"the control sends {self._what}"))
        else:
            self._events.put(Notice(text=f"the control sends {self._what}, which nobody has asked for: it is dropped"))
        return sink

    def _note_stored(self) -> None:
        assert self._reception is not None
        if count := self._reception.unreported():
            self._events.put(Received(count=count))

    def _break_off(self) -> str:
        """If something comes in, its end does not. What was long enough for a program is one, and cut short. Returns in
        words behind what the next begins; empty where nothing had come.
        """
        if self._state is not State.RECEIVING:
            return ""
        assert self._reception is not None
        if self._ending is None:
            self._reception.break_off()
            self._note_stored()
        return self._reception.unended

    def _doubt_head(self, fault: LineFault, now: Nanos) -> None:
        """At rest, as to a tape punch, it may have been the first character of a program, which is lost then."""
        if self._state is State.REST and self._punch_shelf is not None and not self._behind:
            self._behind = f"behind a damaged character ({fault})"
            self._start(Timer.TEXT, self._params.text_timeout, now)

    @property
    def _punch_shelf(self) -> Shelf | None:
        """Where programs that come without DC2 go, if they are taken."""
        return self._arming.shelf if self._arming is not None and self._params.punch_mode is Switch.ON else None

    def _finish_saved(self, now: Nanos) -> None:
        assert self._reception is not None
        if self._reception.damage:
            self._end(Outcome.FAILED, f"received to its end, but damaged: {self._reception.damage}", now)
        else:
            self._end(Outcome.COMPLETE, f"the control has sent {self._what}", now)

    # the end

    def _end(self, outcome: Outcome, reason: str, now: Nanos) -> None:
        """The dialogue is at rest again, and the job, if there was one, is over.

        What was on its way is called back unless it is all the control is to have.
        """
        behind = self._break_off()
        had_job = self._has_job
        if self._in_transfer:
            self._ended_at = now
        self._rest()
        self._behind = "" if outcome is Outcome.CANCELLED else behind
        if not had_job:
            self._events.put(Notice(text=reason))
            return
        if self._arming is not None and self._arming.policy is Policy.ONCE:
            self._arming = None
        self._finish()
        self._ending = _Ending(
            outcome=outcome,
            reason=reason,
            progress=self.progress,
            transmission=self._transmission,
            delivery=self._delivery,
            certain=self._certain,
        )
        self._recall = outcome is not Outcome.COMPLETE and self._delivery.on_the_way > 0
        if not self._recall:
            self._finish()

    def _rest(self) -> None:
        self._timers.stop_all()
        self._name = None
        self._spoilt_name = self._behind = ""
        self._replies.clear()
        self._state = State.REST

    def _finish(self) -> None:
        """Say how the job ended, once it is known what could be called back."""
        if self._ending is None:
            return
        ending, self._ending = self._ending, None
        self._recall = False
        low, high = ending.delivered()
        self._events.put(Ended(outcome=ending.outcome, reason=ending.reason, bytes_low=low, bytes_high=high))


def _called(name: Name | None) -> str:
    return f"program {name.number}" if name is not None and name.number else "a program without a name"
