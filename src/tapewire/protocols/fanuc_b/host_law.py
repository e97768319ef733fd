"""What the host may do when, on protocol B: its states, its deadlines, and the table that is law.

The engine in `host.py` chooses; after each code it checks its choice against this table.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from tapewire.protocols.fanuc_b.messages import ControlCode

__all__ = ["LAW", "State", "Timer"]


class State(Enum):
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


class Timer(Enum):
    """The deadlines of this engine."""

    CLOSING = "closing time"
    NOTICE = "notice time"
    SOURCE = "source poll"
    LEAVING = "leaving"
    DAMAGED = "damaged wait"
    EARLY_STOP = "early stop"


_ENDING: Final = frozenset({State.LEAVING, State.IDLE})

_DC1, _DC2, _DC3, _DC4 = ControlCode.DC1, ControlCode.DC2, ControlCode.DC3, ControlCode.DC4

LAW: Final[dict[tuple[State, ControlCode], frozenset[State]]] = {
    (State.IDLE, _DC1): frozenset({State.IDLE}),
    (State.LISTENING, _DC1): frozenset({State.LISTENING}),
    (State.ARMED, _DC1): frozenset({State.SENDING, State.DELIVERED}),
    (State.SENDING, _DC3): frozenset({State.HELD}) | _ENDING,
    (State.HELD, _DC1): frozenset({State.SENDING, State.DELIVERED}),
    (State.HELD, _DC3): frozenset({State.HELD}) | _ENDING,
    (State.DELIVERED, _DC3): frozenset({State.CLOSING}) | _ENDING,
    (State.CLOSING, _DC1): frozenset({State.DELIVERED}),
    (State.CLOSING, _DC3): frozenset({State.CLOSING}) | _ENDING,
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
