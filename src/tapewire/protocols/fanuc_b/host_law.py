"""What the host may do when, on protocol B: its states, its deadlines, the table that is law, and its reasons.

The engine in `host.py` chooses; after each code it checks its choice against this table.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Named, Nanos, Outcome
from tapewire.protocols.delivery import HEARD_LATE_CHARACTERS, SLOWEST
from tapewire.protocols.fanuc_b.messages import ControlCode

__all__ = [
    "DAMAGED_WAIT",
    "DC4_LATE",
    "ER_FELL",
    "ER_ROSE",
    "FEED",
    "LAW",
    "LEAVING",
    "LOOKS_LIKE_RESET",
    "MAY_BE_NOTICE",
    "NOTICES",
    "NO_LAST_DC3",
    "READ_AND_ER_OFF",
    "RESET_AT_END",
    "RISK_BLIND",
    "RISK_POWER",
    "SOURCE_POLL",
    "STALE",
    "TIMED_ENDS",
    "State",
    "Timer",
]


class State(Named):
    """Where a job stands."""

    IDLE = "idle"
    ARMED = "armed"
    """A program waits for DC1."""
    SENDING = "sending"
    HELD = "held"
    """Stopped by DC3."""
    DELIVERED = "delivered"
    """The last byte has been handed over; the control reads on."""
    CLOSING = "closing"
    """A DC3 came after the last byte: a stop, or the end."""
    LISTENING = "listening"
    """A reception waits for DC2."""
    RECEIVING = "receiving"
    AFTER_DC4 = "after DC4"
    """The punch-out has ended; SYN or NAK may still follow."""
    LEAVING = "leaving"
    """The job is over; what was on its way is called back or leaves."""


class Timer(Named):
    """The deadlines of this engine."""

    CLOSING = "closing time"
    NOTICE = "notice time"
    SOURCE = "source poll"
    LEAVING = "leaving"
    DAMAGED = "damaged wait"
    ER_FELL = "ER fell"
    """A control line is seen at once, and the last DC3 or DC4 before it may still be in a receive FIFO."""
    EARLY_STOP = "early stop"


FEED: Final = b"\x00\x7f"
"""Blank and rubbed-out tape, which says nothing."""

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often a source that had nothing yet is asked again."""

LEAVING: Final[Nanos] = SECOND
"""After a job has ended, what was on its way gets so long to leave before it counts as undecided."""

DAMAGED_WAIT: Final[Nanos] = 60 * SECOND
"""A damaged character may have been the DC1 we wait for: after so long without another, the job has failed."""

DC4_LATE: Final[Nanos] = HEARD_LATE_CHARACTERS * SLOWEST
"""ER falls with DC4, and is seen at once: so much later the DC4 may be heard on the slowest line."""

_ENDING: Final = frozenset({State.LEAVING, State.IDLE})

_DC1, _DC2, _DC3, _DC4 = ControlCode.DC1, ControlCode.DC2, ControlCode.DC3, ControlCode.DC4

LAW: Final[dict[tuple[State, ControlCode], frozenset[State]]] = {
    (State.IDLE, _DC1): frozenset({State.IDLE}),
    (State.LISTENING, _DC1): frozenset({State.LISTENING}),
    (State.ARMED, _DC1): frozenset({State.SENDING, State.DELIVERED}) | _ENDING,
    (State.SENDING, _DC1): frozenset({State.SENDING}) | _ENDING,
    (State.SENDING, _DC3): frozenset({State.HELD, State.CLOSING}) | _ENDING,
    (State.HELD, _DC1): frozenset({State.SENDING, State.DELIVERED}),
    (State.HELD, _DC3): frozenset({State.HELD, State.CLOSING}) | _ENDING,
    (State.DELIVERED, _DC1): frozenset({State.DELIVERED}) | _ENDING,
    (State.DELIVERED, _DC3): frozenset({State.CLOSING, State.HELD}) | _ENDING,
    (State.CLOSING, _DC1): frozenset({State.DELIVERED}),
    (State.CLOSING, _DC3): frozenset({State.CLOSING, State.HELD}) | _ENDING,
    (State.LISTENING, _DC2): frozenset({State.RECEIVING}),
    (State.RECEIVING, _DC3): _ENDING,
    (State.RECEIVING, _DC4): frozenset({State.AFTER_DC4}),
    **{
        (state, code): frozenset({state}) if state in (State.IDLE, State.ARMED, State.LISTENING) else _ENDING
        for state in State
        for code in (ControlCode.SYN, ControlCode.NAK)
        if state is not State.LEAVING
    },
}
"""What each code may do in each state (6.1, 6.4). A pair without a row is a Violation and changes nothing."""

ER_FELL: Final = "the control's ER fell: it was reset, has an alarm, or lost power"

STALE: Final = "characters of the last job are still on the line, and would go out first; RESET the control"

NO_LAST_DC3: Final = f"sent whole, and its end was not heard: {ER_FELL}"

ER_ROSE: Final = "the control's ER came ON in the middle: what asked is not there any more"

RESET_AT_END: Final = "the control has read the whole program and was reset at its end (SYN)"

READ_AND_ER_OFF: Final = (Outcome.COMPLETE, "the control has read the whole program and turned ER OFF")

MAY_BE_NOTICE: Final = "it may have been SYN or NAK; see at the control whether it has read the whole program"
LOOKS_LIKE_RESET: Final = (
    "the control was reset or has an alarm, and its next DC1 would be a start, not a resume; RESET the control and "
    "send again (with 5000#3 = 1 and posting=on it would say which)"
)

RISK_POWER: Final = (
    "ER cannot be seen: if the control loses power while it holds the host, its next start looks like a resume and "
    "would get the middle of the program; stop this job before you start the control anew"
)

RISK_BLIND: Final = (
    "posting is off and ER cannot be seen: a reset after the buffer has filled looks like a stop, and the start that "
    "follows it would get the middle of the program; stop this job before you start the control anew"
)

NOTICES: Final = {
    ControlCode.SYN: (Outcome.CANCELLED, "was reset (SYN)"),
    ControlCode.NAK: (Outcome.FAILED, "has an alarm (NAK)"),
}
"""What the control posts (6.1.2, 6.4)."""

TIMED_ENDS: Final[dict[Enum, tuple[Outcome, str]]] = {
    Timer.CLOSING: (Outcome.COMPLETE, "the control has read the whole program"),
    Timer.DAMAGED: (Outcome.FAILED, "a damaged character came from the control and nothing after it; RESET it"),
    Timer.EARLY_STOP: (Outcome.FAILED, f"a DC3 that cannot have been a stop: {LOOKS_LIKE_RESET}"),
}
"""How a job ends when one of these deadlines passes."""
