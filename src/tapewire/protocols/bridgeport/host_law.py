"""What the host may do when, in REMOTE LOAD and DNC LINK: its states, its deadlines, and the table that is law.

The engine in `host.py` chooses; after each character it checks its choice against this table.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import Named
from tapewire.protocols.bridgeport.code_table import CodeTable

__all__ = [
    "LAW",
    "SENDING",
    "Heard",
    "State",
    "Timer",
    "heard_at_rest",
    "heard_while_receiving",
    "heard_while_sending",
]


class State(Named):
    """Where the dialogue stands. A program may be armed in any of them."""

    REST = "at rest"
    RECEIVING = "receiving"
    """After our go-ahead: a name or a program comes in."""
    SAVED = "listening after a program"
    """A program has come in; a cancel may still follow."""
    HOLD = "waiting for the operator"
    """The control wants a program that we do not have."""
    TEXT = "sending a text"
    RECORD = "sending a record"
    WAIT_ACK = "waiting for ACK"
    TAIL = "at the end of a program"
    """The end code goes out, then we listen for a cancel."""


class Heard(Named):
    """What a character from the control means where it is heard."""

    OPEN_WRITE = "open_write"
    REQUEST = "read_request"
    XON = "xon"
    XOFF = "xoff"
    CANCEL = "cancel"
    ACK = "ack"
    NAK = "nak"
    END = "end of a text"
    TEXT = "text"


class Timer(Named):
    """The deadlines of this engine."""

    TEXT = "silence inside what the control sends"
    SOURCE = "source poll"
    PAUSE = "pause limit"
    HOLD = "hold limit"
    LIBRARY = "look again"
    ACK = "ACK limit"
    GRACE = "XOFF grace after ACK"
    END = "end wait"
    DAMAGED = "damaged wait"


SENDING: Final = frozenset({State.TEXT, State.RECORD, State.WAIT_ACK, State.TAIL})


def heard_at_rest(character: int, codes: CodeTable) -> Heard:
    """At rest the read request counts before XON, which is the same character by default."""
    match character:
        case codes.open_write:
            return Heard.OPEN_WRITE
        case codes.read_request:
            return Heard.REQUEST
        case codes.xon:
            return Heard.XON
        case _:
            return _heard_anywhere(character, codes)


def heard_while_sending(character: int, codes: CodeTable) -> Heard:
    match character:
        case codes.open_write:
            return Heard.OPEN_WRITE
        case codes.xon:
            return Heard.XON
        case codes.read_request:
            return Heard.REQUEST
        case _:
            return _heard_anywhere(character, codes)


def heard_while_receiving(character: int, codes: CodeTable) -> Heard:
    """Only for what is a mark between text: anything else is text."""
    match character:
        case codes.open_write:
            return Heard.OPEN_WRITE
        case codes.cancel:
            return Heard.CANCEL
        case codes.xoff:
            return Heard.XOFF
        case _:
            return Heard.END if character in codes.upload_ends else Heard.XON


def _heard_anywhere(character: int, codes: CodeTable) -> Heard:
    match character:
        case codes.xoff:
            return Heard.XOFF
        case codes.cancel:
            return Heard.CANCEL
        case codes.ack:
            return Heard.ACK
        case codes.nak:
            return Heard.NAK
        case _:
            return Heard.END if character in codes.upload_ends else Heard.TEXT


_REST: Final = frozenset({State.REST})
_AFTER_REQUEST: Final = frozenset({State.TEXT, State.RECORD, State.WAIT_ACK, State.TAIL, State.HOLD, State.REST})

LAW: Final[dict[tuple[State, Heard], frozenset[State]]] = {
    **{(state, Heard.OPEN_WRITE): frozenset({State.RECEIVING}) for state in State},
    **{(state, Heard.CANCEL): _REST for state in State},
    (State.REST, Heard.REQUEST): _AFTER_REQUEST,
    (State.REST, Heard.XOFF): _REST,
    (State.REST, Heard.END): _REST,
    (State.REST, Heard.TEXT): frozenset({State.REST, State.RECEIVING}),
    (State.RECEIVING, Heard.XON): frozenset({State.RECEIVING}),
    (State.RECEIVING, Heard.XOFF): frozenset({State.RECEIVING}),
    (State.RECEIVING, Heard.END): frozenset({State.REST, State.SAVED}),
    (State.SAVED, Heard.END): frozenset({State.SAVED}),
    (State.SAVED, Heard.TEXT): frozenset({State.SAVED, State.REST, State.RECEIVING}),
    (State.SAVED, Heard.REQUEST): _AFTER_REQUEST,
    (State.HOLD, Heard.REQUEST): frozenset({State.HOLD}),
    **{(state, Heard.XOFF): frozenset({state}) for state in SENDING},
    **{(state, Heard.XON): frozenset({state}) for state in SENDING},
    (State.TEXT, Heard.XON): frozenset({State.TEXT, State.REST}),
    (State.TEXT, Heard.NAK): frozenset({State.TEXT, State.REST}),
    (State.TEXT, Heard.ACK): frozenset({State.TEXT, State.REST}),
    (State.RECORD, Heard.NAK): frozenset({State.RECORD, State.REST}),
    (State.RECORD, Heard.ACK): frozenset({State.RECORD, State.TAIL, State.REST}),
    (State.WAIT_ACK, Heard.NAK): frozenset({State.RECORD, State.REST}),
    (State.TAIL, Heard.NAK): frozenset({State.TAIL, State.REST}),
    (State.TAIL, Heard.ACK): frozenset({State.TAIL, State.REST}),
    (State.WAIT_ACK, Heard.ACK): frozenset({State.RECORD, State.TAIL, State.REST}),
}
"""What each character may do in each state (chapter 1, 3, 4). A pair without a row changes nothing: at rest and while
waiting it is ignored in silence if it may be the other half of a cancel, anywhere else it is a Violation."""
