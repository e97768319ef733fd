"""What the control's end of protocol A does with what it hears (B-63322EN-1 4.4.1, 4.6, 4.7).

The remote buffer speaks and the host answers, so a state is, mostly, the message whose answer is awaited. A pair of
`LAW` says what the control then does; a pair that has no row falls to `refusal`, the reception error of 4.6 2) (2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum, StrEnum
from typing import Final

from tapewire.engine import Named
from tapewire.fanuc.alarms import AlarmNumber
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_a.params import AmongPackets

__all__ = ["AWAITED", "DEAF", "LAW", "MESSAGES_AMONG_PACKETS", "Act", "Refusal", "State", "Timer", "refusal"]


class State(Named):
    """Where the dialogue stands."""

    NOT_READY = "DR is OFF, or the control has yet to begin, after power-on or an open line"
    SYN_WAIT = "an open line: only the host's SYN counts"
    RESTING = "the control has the turn"
    SENDING = "a message of the control is on its way out"
    SYN_SENT = "SYN awaits its answer"
    RDY_SENT = "RDY awaits its answer"
    SAT_SENT = "SAT awaits its answer"
    GTD_SENT = "GTD awaits its answer"
    SDI_FOR_SAT = "SDI has gone, the answer to SAT is still owed"
    SDI_FOR_GTD = "SDI has gone, the answer to GTD is still owed"
    RST_SENT = "RST awaits its answer"
    ALM_SENT = "ALM awaits its answer"
    PACKETS = "packets come in"
    CLOSED = "the line is gone"


class Act(StrEnum):
    """What the control does with a command."""

    INITIALISE = "begins the initialisation anew"
    GO_ON = "goes on with RDY"
    READY = "is initialised"
    NOT_YET = "polls the host again after Tp"
    APPLY = "takes the parameters"
    CLEAR = "clears the buffer"
    SEND_DI = "sends SDI"
    PUT_DO = "puts the image to DO"
    STORE = "stores the data"
    WAIT = "asks again after Tw"
    NO_MORE = "asks no more"
    NOTED = "knows that the host knows"
    REPEAT = "repeats its last message"
    IGNORE = "hears nothing"


class Timer(Named):
    """The deadlines of this engine."""

    POWER_ON = "the 2 s of 4.3 (1)"
    TX = "Tx"
    TP = "Tp"
    TW = "Tw"
    TO = "To"
    TI = "Ti"
    QUIET = "quiet"


class Refusal(Enum):
    """The two alarms that chapter 11 has for a command in the wrong place."""

    INVALID_RESPONSE = AlarmNumber.SR947
    NOT_EXPECTED = AlarmNumber.SR948


AWAITED: Final[Mapping[Command, State]] = {
    Command.SYN: State.SYN_SENT,
    Command.RDY: State.RDY_SENT,
    Command.SAT: State.SAT_SENT,
    Command.GTD: State.GTD_SENT,
    Command.RST: State.RST_SENT,
    Command.ALM: State.ALM_SENT,
}
"""Message of the control -> the state its leaving leads to. SDI leads to the state of the answer that is owed."""

DEAF: Final = frozenset({State.NOT_READY, State.SENDING, State.CLOSED})
"""4.6 3): what comes in while the control transmits is ignored. Before it has spoken there is nothing to answer."""

_S, _C = State, Command

_ANSWERED: Final = (*AWAITED.values(), _S.SDI_FOR_SAT, _S.SDI_FOR_GTD)
_POLLED: Final = (_S.SAT_SENT, _S.SDI_FOR_SAT)
_ASKED: Final = (_S.GTD_SENT, _S.SDI_FOR_GTD)


def _rows(states: Iterable[State], act: Act, *commands: Command) -> dict[tuple[State, Command], Act]:
    return {(state, command): act for state in states for command in commands}


LAW: Final[Mapping[tuple[State, Command], Act]] = {
    # "Initialization command. It is command to initialize the remote buffer": at any time that it is heard.
    **_rows((*_ANSWERED, _S.RESTING, _S.SYN_WAIT, _S.PACKETS), Act.INITIALISE, _C.SYN),
    # In the turn of the control a host that has read garbage may still ask for what was said last.
    **_rows((*_ANSWERED, _S.RESTING, _S.PACKETS), Act.REPEAT, _C.RTY),
    (_S.SYN_SENT, _C.SYN): Act.GO_ON,
    (_S.RDY_SENT, _C.RDY): Act.READY,
    (_S.RDY_SENT, _C.SYN): Act.NOT_YET,
    (_S.RST_SENT, _C.ARS): Act.NOTED,
    (_S.ALM_SENT, _C.AAL): Act.NOTED,
    **_rows(_POLLED, Act.APPLY, _C.SET),
    **_rows(_POLLED, Act.CLEAR, _C.CLB),
    **_rows((_S.GTD_SENT, _S.SDI_FOR_GTD), Act.STORE, _C.DAT),
    **_rows((*_ASKED, _S.PACKETS), Act.WAIT, _C.WAT),
    **_rows((*_ASKED, _S.PACKETS), Act.NO_MORE, _C.EOD),
    **_rows((_S.SAT_SENT, _S.GTD_SENT, _S.PACKETS), Act.SEND_DI, _C.RDI),
    **_rows((*_POLLED, *_ASKED, _S.PACKETS), Act.PUT_DO, _C.SDO),
    **_rows(DEAF, Act.IGNORE, *Command),
    **_rows((_S.SYN_WAIT,), Act.IGNORE, *(command for command in Command if command is not _C.SYN)),
}
"""(state, what the host says) -> what the control does."""

MESSAGES_AMONG_PACKETS: Final[Mapping[AmongPackets, frozenset[Command]]] = {
    AmongPackets.NONE: frozenset(),
    AmongPackets.RTY: frozenset({_C.RTY}),
    AmongPackets.SYN: frozenset({_C.RTY, _C.SYN}),
}
"""What `among_packets` lets be understood where a packet may begin: a host that did not get the GTD, and one that
begins anew. The other rows of PACKETS need `gtd_answers=messages`."""

_RESPONSES: Final = frozenset({_C.SYN, _C.RDY, _C.ARS, _C.AAL, _C.SET, _C.DAT, _C.WAT, _C.EOD, _C.CLB, _C.RDI, _C.SDO})


def refusal(state: State, command: Command) -> Refusal:
    """The policy for every pair without a row: the data is ignored, alarm state 3 with cause 6, SAT (4.6 2) (2)).

    Chapter 11 tells two alarms apart. SR947 is an invalid response: a message awaits its answer, the host may say
    such a thing, but not here. SR948, third cause, is the rest: a command of the remote buffer's own, or one while
    no answer is awaited.
    """
    if state in _ANSWERED and command in _RESPONSES:
        return Refusal.INVALID_RESPONSE
    return Refusal.NOT_EXPECTED
