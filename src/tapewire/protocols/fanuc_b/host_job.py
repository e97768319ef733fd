"""The life of one job at the host's end of protocol B: armed, under way, over; what is on its way, and what is certain.

`host.py` hears what the control says and decides; here is what follows from it for the job.
"""

from __future__ import annotations

from tapewire.engine import (
    ALL_ON,
    Ended,
    Event,
    Events,
    Nanos,
    Outcome,
    SignalsOut,
    Sink,
    Source,
    Timers,
)
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.host_delivery import Delivery, Supply
from tapewire.protocols.fanuc_b.host_law import LEAVING, State, Timer
from tapewire.protocols.fanuc_b.host_reception import Pause, Reception
from tapewire.protocols.fanuc_b.host_signs import Signs
from tapewire.protocols.fanuc_b.messages import Params

__all__ = ["Job"]


class Job:
    """At most one job at a time, and the dialogue's state."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._state = State.IDLE
        self._timers = Timers()
        self._events = Events()
        self._signs = Signs(params)
        self._held_by_damage = self._recall = False
        self._pause = Pause(params)
        self._delivery = Delivery(params.limits)
        self._supply = Supply(None)
        self._reception: Reception | None = None
        self._ending: tuple[Outcome, str] | None = None
        self._certain = 0

    # the application's side

    def start(self, source: Source, now: Nanos) -> None:
        """Arm a program; it starts with the next DC1. Raises UsageError while a job is under way."""
        self._begin_job(State.ARMED)
        self._supply = Supply(source)

    def receive(self, sink: Sink, now: Nanos) -> None:
        """Arm a reception; it starts with the next DC2. Raises UsageError while a job is under way."""
        self._begin_job(State.LISTENING)
        self._reception = Reception(self._params.data, sink)
        self._pause = Pause(self._params)

    def abort(self, now: Nanos) -> None:
        """Fall silent and call back what has not left. No EOR is sent, so the program cannot look whole (8.2)."""
        if self._state not in (State.IDLE, State.LEAVING):
            began = self.progress or self._state is State.RECEIVING
            advice = "; RESET the control before anything else is sent to it" if began else " before anything was sent"
            self._end(Outcome.CANCELLED, f"given up here{advice}", now)

    @property
    def state(self) -> State:
        return self._state

    @property
    def progress(self) -> int:
        return self._reception.stored if self._reception is not None else self._delivery.sent

    @property
    def needs_stop_distance(self) -> int:
        return self._params.limits.overrun

    # what left, and what is over

    def data_left(self, count: int, now: Nanos) -> None:
        self._delivery.leave(count, now)
        if self._state is State.LEAVING and not self._delivery.in_flight:
            self._finish()

    def data_discarded(self, count: int, now: Nanos) -> None:
        self._recall = False
        self._delivery.call_back(count)
        if self._state is State.LEAVING and not self._delivery.in_flight:
            self._finish()

    @property
    def recall(self) -> bool:
        return self._recall

    @property
    def signals(self) -> SignalsOut:
        """ON, but for a pause by CS: with them OFF the control posts nothing (6.1.2) or alarms (3.2)."""
        return SignalsOut(rts=False) if self._pause.cs_off else ALL_ON

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def next_event(self) -> Event | None:
        return self._events.get()

    def _begin_job(self, state: State) -> None:
        if self._state is not State.IDLE:
            raise UsageError(f"a job is under way ({self._state.value}); abort it or wait for its end")
        self._state = state
        self._reception = None
        self._certain = 0
        self._delivery = Delivery(self._params.limits, stale=self._delivery.on_the_way)

    def _end(self, outcome: Outcome, reason: str, now: Nanos) -> None:
        """The job is over. One that is whole waits for its last byte to leave; any other calls back what it can."""
        self._timers.stop_all()
        self._ending = outcome, reason
        if self._state not in (State.HELD, State.CLOSING) or self._held_by_damage:
            self._certain = self._delivery.certain(now)
        self._state, self._held_by_damage = State.LEAVING, False
        self._pause = Pause(self._params)
        self._recall = outcome is not Outcome.COMPLETE
        self._timers.start(Timer.LEAVING, now + LEAVING)
        if not self._delivery.in_flight and not self._recall:
            self._finish()

    def _finish(self) -> None:
        assert self._ending is not None
        outcome, reason = self._ending
        self._ending, self._supply = None, Supply(None)
        self._timers.stop_all()
        self._recall = False
        self._state = State.IDLE
        low = high = self.progress
        if self._reception is None and outcome is not Outcome.COMPLETE:
            low = max(0, min(self._certain, high - self._delivery.in_flight))
        self._events.put(Ended(outcome=outcome, reason=reason, bytes_low=low, bytes_high=high))
