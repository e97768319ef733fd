"""What the host of protocol A may do when: its states, its deadlines, and the table that is law.

The engine in `host.py` chooses; after each message it checks its choice against this table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tapewire.engine import Named
from tapewire.protocols.fanuc_a.messages import ANSWERS, ORIGINS, Command, Origin

__all__ = ["LAW", "Row", "State", "Timer"]


class State(Named):
    """Where a job stands."""

    IDLE = "idle"
    """No job, or one that was given up: the control gets no program."""
    ARMED = "armed"
    """A program waits for GTD."""
    SENDING = "sending"
    """By DAT, one for each GTD (4.4.1)."""
    STREAMING = "streaming"
    """By packets, from GTD to the end packet (5.1)."""
    AWAITING = "awaiting"
    """The end packet has been handed over; the control has not spoken since."""
    DELIVERED = "delivered"
    """The control has it all and executes what is in its buffer."""
    FINISHED = "finished"
    """The buffer is empty; a further GTD of the same reading gets EOD."""


class Timer(Named):
    """The deadlines of this engine."""

    SILENCE = "silence"
    """Tp + Tx and a margin without a word from the control (4.3 (4))."""
    INTERBYTE = "inter-byte"
    """A message has begun and does not go on."""
    QUIET = "quiet"
    """What could not be read is over: now it can be asked for again."""
    REPEAT = "repeat"
    """RTY came while our own message was on its way: when that is out, and no other RTY has come, it is repeated."""
    CROSSED = "crossed"
    """A good message came after our own RTY: the repetition may still follow, and only one of them is answered."""
    SOURCE = "source poll"
    WAT = "WAT"
    """The source is late: the control must hear something before To."""
    KEEP_ALIVE = "keep-alive"
    """The same among packets: an invalid packet is due (5.2 2) c))."""
    DAMAGED = "damaged wait"
    """A monitor packet could not be read: the transfer is held for so long."""
    ROOM = "room"
    """Half of what may be on its way before No is confirmed has left: the line is fed again before it is empty."""
    NEXT = "next packet"
    """So little of the packet before is still to leave that the next one is begun."""
    VERDICT = "verdict"
    """A packet was sent again that may have been there already: NAK for the one behind it may follow."""
    HELD = "held limit"
    """RS OFF, or DC3, for longer than the operator lets it last."""
    LEAVING = "leaving"
    """The job is over; the last answer is on its way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What may be answered, and where it may lead. An answer may come later, or be packets."""

    answers: frozenset[Command]
    states: frozenset[State]


def _row(said: Command, *states: State) -> Row:
    return Row(answers=ANSWERS[said], states=frozenset(states))


_S = State
_NOT_RUNNING: Final = (_S.IDLE, _S.ARMED, _S.FINISHED)
_RUNNING: Final = (_S.SENDING, _S.STREAMING, _S.AWAITING, _S.DELIVERED)
_OVER: Final = (_S.IDLE, _S.FINISHED)

_ANY_ANSWER: Final = frozenset(command for command in Command if ORIGINS[command] is not Origin.CONTROL)


def _resets() -> dict[tuple[State, Command], Row]:
    """SYN, RDY, RST and ALM end what is under way and leave alone what has not begun (15 of the protocol's page)."""
    rows = {}
    for said in (Command.SYN, Command.RDY, Command.RST, Command.ALM):
        for state in State:
            rows[state, said] = _row(said, _S.ARMED) if state is _S.ARMED else _row(said, _S.IDLE)
    return rows


LAW: Final[dict[tuple[State, Command], Row]] = {
    **_resets(),
    (_S.IDLE, Command.SAT): _row(Command.SAT, _S.IDLE),
    (_S.ARMED, Command.SAT): _row(Command.SAT, _S.ARMED, _S.IDLE),
    (_S.SENDING, Command.SAT): _row(Command.SAT, _S.SENDING, _S.DELIVERED, *_OVER),
    (_S.STREAMING, Command.SAT): _row(Command.SAT, _S.IDLE),
    (_S.AWAITING, Command.SAT): _row(Command.SAT, _S.DELIVERED, *_OVER),
    (_S.DELIVERED, Command.SAT): _row(Command.SAT, _S.DELIVERED, *_OVER),
    (_S.FINISHED, Command.SAT): _row(Command.SAT, *_OVER),
    (_S.IDLE, Command.GTD): _row(Command.GTD, _S.IDLE),
    (_S.ARMED, Command.GTD): _row(Command.GTD, _S.ARMED, _S.SENDING, _S.STREAMING, _S.IDLE),
    (_S.SENDING, Command.GTD): _row(Command.GTD, _S.SENDING, _S.DELIVERED, _S.IDLE),
    (_S.STREAMING, Command.GTD): _row(Command.GTD, _S.IDLE),
    (_S.AWAITING, Command.GTD): _row(Command.GTD, _S.DELIVERED, _S.IDLE),
    (_S.DELIVERED, Command.GTD): _row(Command.GTD, _S.DELIVERED),
    (_S.FINISHED, Command.GTD): _row(Command.GTD, _S.FINISHED),
    (_S.IDLE, Command.SDI): _row(Command.SDI, _S.IDLE),
    (_S.ARMED, Command.SDI): _row(Command.SDI, _S.ARMED, _S.SENDING, _S.IDLE),
    (_S.SENDING, Command.SDI): _row(Command.SDI, _S.SENDING, _S.DELIVERED, _S.IDLE),
    (_S.DELIVERED, Command.SDI): _row(Command.SDI, _S.DELIVERED),
    (_S.FINISHED, Command.SDI): _row(Command.SDI, _S.FINISHED),
    **{
        (state, Command.RTY): Row(answers=_ANY_ANSWER, states=frozenset({state, _S.IDLE}))
        for state in State
        if state not in (_S.STREAMING, _S.AWAITING)
    },
}
"""What each command may do in each state (4.4.1, 4.6, 5.2). A pair without a row is a Violation: it changes nothing
and gets no answer, and the silence that follows leads to SYN.
"""
