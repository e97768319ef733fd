"""What the control's end of protocol B may do next (B-63322EN-1 6.1 to 6.4)."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Final, TypeAlias

from tapewire.engine import Named
from tapewire.protocols.fanuc_b.messages import ControlCode

__all__ = ["LAW", "Act", "Cause", "State"]


class State(Named):
    """Where the control's communication stands."""

    IDLE = "at rest"
    STARTING = "a read was started, its DC1 waits for the line"
    READING = "the host may send"
    STOPPED = "the host was told to stop, the buffer is full enough"
    RECEIVED = "the program is in and the host is done with, the control reads the rest"
    OPENING = "a punch-out was started, its DC2 waits for the line"
    PUNCHING = "the program goes out"
    PAUSED = "the host has sent DC3"
    CLOSING = "the last codes are on their way"


class Act(Named):
    """What moves the control, besides the codes a host sends during a punch-out."""

    CYCLE_START = "cycle start"
    PUNCH = "punch-out"
    RESET = "RESET"
    ALARM = "an alarm of the CNC"
    OPENED = "the first DC1 or DC2 was handed over"
    BUFFER_FULL = "little is free"
    BUFFER_LOW = "enough is free again"
    EOR_IN = "EOR came in, and ends the communication"
    EOR_TAKEN = "the control has taken EOR"
    PUNCHED = "the whole program was handed over"
    OVERRUN = "more came after DC3 than the buffer bears"
    LINE_FAULT = "a damaged character"
    HOST_GONE = "DR OFF, or the line is closed"
    CLOSED = "the last code has left"


Cause: TypeAlias = ControlCode | Act

LAW: Final[Mapping[tuple[State, Cause], AbstractSet[State]]] = {
    (State.IDLE, Act.CYCLE_START): {State.STARTING},
    (State.IDLE, Act.PUNCH): {State.OPENING},
    (State.IDLE, Act.RESET): {State.IDLE},
    (State.IDLE, Act.ALARM): {State.IDLE},
    (State.STARTING, Act.OPENED): {State.READING},
    (State.STARTING, Act.RESET): {State.CLOSING},
    (State.STARTING, Act.ALARM): {State.CLOSING},
    (State.STARTING, Act.HOST_GONE): {State.CLOSING},
    (State.READING, Act.BUFFER_FULL): {State.STOPPED},
    (State.READING, Act.EOR_IN): {State.RECEIVED},
    (State.READING, Act.EOR_TAKEN): {State.CLOSING},
    (State.READING, Act.RESET): {State.CLOSING},
    (State.READING, Act.ALARM): {State.READING, State.CLOSING},
    (State.READING, Act.LINE_FAULT): {State.CLOSING},
    (State.READING, Act.HOST_GONE): {State.RECEIVED, State.CLOSING},
    (State.STOPPED, Act.BUFFER_LOW): {State.READING},
    (State.STOPPED, Act.EOR_IN): {State.RECEIVED},
    (State.STOPPED, Act.EOR_TAKEN): {State.CLOSING},
    (State.STOPPED, Act.RESET): {State.CLOSING},
    (State.STOPPED, Act.ALARM): {State.STOPPED, State.CLOSING},
    (State.STOPPED, Act.OVERRUN): {State.CLOSING},
    (State.STOPPED, Act.LINE_FAULT): {State.CLOSING},
    (State.STOPPED, Act.HOST_GONE): {State.RECEIVED, State.CLOSING},
    (State.RECEIVED, Act.EOR_TAKEN): {State.CLOSING},
    (State.RECEIVED, Act.RESET): {State.CLOSING},
    (State.RECEIVED, Act.ALARM): {State.CLOSING},
    (State.RECEIVED, Act.HOST_GONE): {State.RECEIVED},
    (State.OPENING, Act.OPENED): {State.PUNCHING},
    (State.OPENING, Act.RESET): {State.CLOSING},
    (State.OPENING, Act.ALARM): {State.CLOSING},
    (State.OPENING, Act.HOST_GONE): {State.CLOSING},
    (State.PUNCHING, ControlCode.DC1): {State.PUNCHING},
    (State.PUNCHING, ControlCode.DC2): {State.PUNCHING},
    (State.PUNCHING, ControlCode.DC3): {State.PAUSED},
    (State.PUNCHING, Act.PUNCHED): {State.CLOSING},
    (State.PUNCHING, Act.RESET): {State.CLOSING},
    (State.PUNCHING, Act.ALARM): {State.PUNCHING, State.CLOSING},
    (State.PUNCHING, Act.LINE_FAULT): {State.CLOSING},
    (State.PUNCHING, Act.HOST_GONE): {State.CLOSING},
    (State.PAUSED, ControlCode.DC1): {State.PAUSED, State.PUNCHING},
    (State.PAUSED, ControlCode.DC2): {State.PAUSED, State.PUNCHING},
    (State.PAUSED, ControlCode.DC3): {State.PAUSED},
    (State.PAUSED, Act.RESET): {State.CLOSING},
    (State.PAUSED, Act.ALARM): {State.PAUSED, State.CLOSING},
    (State.PAUSED, Act.LINE_FAULT): {State.CLOSING},
    (State.PAUSED, Act.HOST_GONE): {State.CLOSING},
    (State.CLOSING, Act.RESET): {State.CLOSING},
    (State.CLOSING, Act.ALARM): {State.CLOSING},
    (State.CLOSING, Act.HOST_GONE): {State.CLOSING},
    (State.CLOSING, Act.CLOSED): {State.IDLE},
}
"""(state, what happens) -> where the control may then be. The engine checks every move against it."""
