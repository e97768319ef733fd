"""What the control shows by RS and ER and says by DC3, SYN and NAK, and how much of it is proof (6.1, 6.4).

Nothing is decided here about what the host does: `host.py` asks, and acts.
"""

from __future__ import annotations

from typing import Literal

from tapewire.engine import SECOND, Named, Nanos, Outcome
from tapewire.protocols.fanuc_b.host_delivery import Delivery
from tapewire.protocols.fanuc_b.host_law import NOTICES, RESET_AT_END, State
from tapewire.protocols.fanuc_b.messages import ControlCode, ErLine, Params, SynAtEnd
from tapewire.protocols.settings import Switch

__all__ = ["Er", "Signs"]


class Er(Named):
    """What the control's ER has done."""

    FELL = "fell"
    ROSE = "rose"
    SAME = "same"


class Signs:
    """The signs of one control. They outlast a job: RS and ER stay as they are."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._posts = params.posting is Switch.ON
        self.rs = True
        self.er = False
        """ER is visible, and ON."""
        self.sees_er = False
        self.er_fell_at: Nanos = 0
        self.are_shown = False
        """This line has control lines."""
        self.dc3_at: Nanos = 0
        """When the last DC3 was heard."""
        self.dc3_may_be_end = False
        """Nothing was on its way then, and a reset would be told."""
        self.dc3_may_be_reset = False
        """The last DC3 follows another with no DC1 between, and what left just before it may not have come."""
        self.was_damaged = False
        """A damaged character came, and no DC1 since: it may have been a stop."""

    @property
    def blind(self) -> bool:
        """Nothing on this line tells a reset from a stop (6.1.1, 6.4)."""
        return not (self._posts or self.sees_er)

    def see_rs(self, rs: bool) -> bool:
        """Returns whether RS has changed."""
        self.are_shown = True
        before, self.rs = self.rs, rs
        return rs != before

    def see_er(self, er: bool, now: Nanos) -> Er:
        if self._params.er is ErLine.HIDDEN or er == self.er:
            return Er.SAME
        self.er = er
        self.sees_er |= er
        if not er:
            self.er_fell_at = now
        return Er.ROSE if er else Er.FELL

    def follows_a_stop(self, state: State, delivery: Delivery) -> bool:
        """A DC3 heard now comes behind a stop, or what may have been one."""
        closing_was_stop = delivery.may_have_filled_the_buffer or self.dc3_may_be_reset
        return self.was_damaged or state is State.HELD or (state is State.CLOSING and closing_was_stop)

    def hear_dc3(self, delivery: Delivery, which: Literal["first", "again"], now: Nanos) -> None:
        """`again`: it follows a stop, with no DC1 between.

        Of two the first was the stop, so the second is the end, or a reset that what was on its way did not reach. SYN
        tells a reset where the control posts, and ER where it does not after all: one of them alone is not enough.
        What one such DC3 puts in doubt the next does not prove.
        """
        self.dc3_at = now
        doubt = self.dc3_may_be_reset or not delivery.has_arrived(now)
        self.dc3_may_be_reset = which == "again" and doubt
        told = self._posts and self.sees_er
        self.dc3_may_be_end = not delivery.in_flight and (told or not self.dc3_may_be_reset)

    def wait_behind_last_dc3(self, state: State, delivery: Delivery) -> Nanos:
        """How long something may still follow the last DC3 that shows it to be no end; 0 where nothing can."""
        if state is State.DELIVERED and self._dc3_may_be_stop(delivery):
            return round(self._params.closing_time * SECOND)
        return round(self._params.notice_time * SECOND) if self._posts else 0

    def hanging_up_ends_the_read(self, state: State, delivery: Delivery) -> bool:
        """ER OFF, or the line closed, behind the last DC3. With none it may be a loss of power; and as a reset does the
        same, it proves nothing behind a DC3 that may be one.
        """
        return state is State.CLOSING and not self.dc3_may_be_reset and not delivery.in_flight

    def er_ends_the_read(self, state: State, delivery: Delivery) -> bool:
        """A stop leaves ER ON (6.1.1): where it falls long behind a DC3 that may be one, the control was stopped there,
        and went.
        """
        belongs = self.er_fell_at - self.dc3_at <= delivery.heard_late or not self._dc3_may_be_stop(delivery)
        return belongs and self.hanging_up_ends_the_read(state, delivery)

    def last_dc3_may_follow_er(self, delivery: Delivery) -> bool:
        """A control line is seen at once, and that DC3 may still be in a receive FIFO. With posting ER stays ON until
        power-off (6.1.2), and belongs to no DC3 to come.
        """
        return not self._posts and not delivery.in_flight

    def _dc3_may_be_stop(self, delivery: Delivery) -> bool:
        """Judged by when it was heard: the source may say only much later that there is no more."""
        return delivery.may_have_filled_the_buffer and not delivery.long_silent(self.dc3_at)

    def end_by_notice(
        self, code: ControlCode, state: State, delivery: Delivery, now: Nanos
    ) -> tuple[Outcome, str] | None:
        """How SYN or NAK ends the job; None where none is under way."""
        outcome, what = NOTICES[code]
        match state:
            case State.IDLE | State.ARMED | State.LISTENING:
                return None
            case State.DELIVERED | State.CLOSING:
                ends_by_reset = code is ControlCode.SYN and self._params.syn_at_end is SynAtEnd.COMPLETE
                said_at = self.dc3_at if state is State.CLOSING else now
                in_doubt = state is State.CLOSING and self.dc3_may_be_reset
                if ends_by_reset and not in_doubt and delivery.has_arrived(said_at):
                    return Outcome.COMPLETE, RESET_AT_END
                return outcome, f"sent whole, not executed: the control {what}"
            case _:
                return outcome, f"the control {what}"
