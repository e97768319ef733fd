"""What the control's end of REMOTE LOAD and DNC LINK may do next, and what a character means to it where it arrives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Final, TypeAlias

from tapewire.engine import Named
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.records import record_end_codes

__all__ = ["LAW", "Act", "Cause", "State", "Word", "vocabulary"]


class State(Named):
    """Where the control's communication stands."""

    IDLE = "at rest"
    NAME_OPENING = "DC2 announces a name, the remote's DC1 is awaited"
    ASKING = "the name and the request behind it, or the request alone, wait for the line"
    TEXT_DUE = "the text of a REMOTE LOAD is awaited"
    LOADING = "the text of a REMOTE LOAD comes in"
    RECORD_DUE = "a record of DNC LINK, or the end of the program, is awaited"
    RECORD = "the text of a record comes in"
    CHECK = "the next character is the LRC of the record"
    ANSWERING = "a record is in, its ACK or NAK is still to be said"
    RECEIVED = "the program is in and the remote is done with, the control takes the rest"
    SAVE_OPENING = "DC2 announces a program, the remote's DC1 is awaited"
    SAVING = "a program goes out"
    PAUSED = "the remote has sent DC3"
    CLOSING = "the last codes are on their way"


class Word(Named):
    """What a character of the remote can mean."""

    READY = "go ahead with a name or a program"
    XOFF = "stop sending"
    XON = "go on sending"
    CANCEL = "give up what you send"
    TEXT = "text of a program"
    TEXT_END = "the end of a program"
    RECORD_END = "the end of a record, its LRC follows"
    LRC = "the check character of a record"


class Act(Named):
    """What moves the control besides the words of the remote."""

    CYCLE_START = "cycle start"
    SAVE = "a save is started"
    RESET = "the operator cancels"
    ALARM = "an alarm of the control"
    ASKED = "the request was handed over"
    ANSWERED = "the ACK or NAK was handed over"
    BUFFER_FULL = "little is free"
    BUFFER_LOW = "enough is free again"
    SILENCE = "nothing comes in the middle of a record"
    FAULT = "a communications error"
    TAKEN = "the control has taken all of the program"
    SAVED = "the whole program was handed over"
    LINE_GONE = "the line is closed"
    CLOSED = "the last code has left"


Cause: TypeAlias = Word | Act

LAW: Final[Mapping[tuple[State, Cause], AbstractSet[State]]] = {
    (State.IDLE, Act.CYCLE_START): {State.NAME_OPENING, State.ASKING},
    (State.IDLE, Act.SAVE): {State.NAME_OPENING, State.SAVE_OPENING, State.SAVING},
    (State.IDLE, Act.RESET): {State.IDLE},
    (State.IDLE, Act.ALARM): {State.IDLE},
    (State.NAME_OPENING, Word.READY): {State.ASKING, State.SAVE_OPENING},
    (State.NAME_OPENING, Act.RESET): {State.CLOSING},
    (State.NAME_OPENING, Act.ALARM): {State.CLOSING},
    (State.NAME_OPENING, Act.FAULT): {State.CLOSING},
    (State.NAME_OPENING, Act.LINE_GONE): {State.CLOSING},
    (State.ASKING, Word.READY): {State.ASKING},
    (State.ASKING, Act.ASKED): {State.TEXT_DUE, State.RECORD_DUE},
    (State.ASKING, Act.RESET): {State.CLOSING},
    (State.ASKING, Act.ALARM): {State.CLOSING},
    (State.ASKING, Act.LINE_GONE): {State.CLOSING},
    (State.TEXT_DUE, Word.READY): {State.TEXT_DUE},
    (State.TEXT_DUE, Word.TEXT): {State.LOADING},
    (State.TEXT_DUE, Word.TEXT_END): {State.CLOSING},
    (State.TEXT_DUE, Act.RESET): {State.CLOSING},
    (State.TEXT_DUE, Act.ALARM): {State.CLOSING},
    (State.TEXT_DUE, Act.FAULT): {State.CLOSING},
    (State.TEXT_DUE, Act.LINE_GONE): {State.CLOSING},
    (State.LOADING, Word.TEXT): {State.LOADING},
    (State.LOADING, Word.TEXT_END): {State.RECEIVED},
    (State.LOADING, Act.BUFFER_FULL): {State.LOADING},
    (State.LOADING, Act.BUFFER_LOW): {State.LOADING},
    (State.LOADING, Act.RESET): {State.CLOSING},
    (State.LOADING, Act.ALARM): {State.CLOSING},
    (State.LOADING, Act.FAULT): {State.CLOSING},
    (State.LOADING, Act.LINE_GONE): {State.CLOSING},
    (State.RECORD_DUE, Word.READY): {State.RECORD_DUE},
    (State.RECORD_DUE, Word.TEXT): {State.RECORD},
    (State.RECORD_DUE, Word.TEXT_END): {State.RECORD_DUE, State.RECEIVED, State.CLOSING},
    (State.RECORD_DUE, Word.RECORD_END): {State.CHECK},
    (State.RECORD_DUE, Act.RESET): {State.CLOSING},
    (State.RECORD_DUE, Act.ALARM): {State.CLOSING},
    (State.RECORD_DUE, Act.FAULT): {State.CLOSING},
    (State.RECORD_DUE, Act.LINE_GONE): {State.CLOSING},
    (State.RECORD, Word.TEXT): {State.RECORD},
    (State.RECORD, Word.RECORD_END): {State.CHECK},
    (State.RECORD, Act.BUFFER_FULL): {State.RECORD},
    (State.RECORD, Act.BUFFER_LOW): {State.RECORD},
    (State.RECORD, Act.SILENCE): {State.ANSWERING},
    (State.RECORD, Act.RESET): {State.CLOSING},
    (State.RECORD, Act.ALARM): {State.CLOSING},
    (State.RECORD, Act.FAULT): {State.CLOSING},
    (State.RECORD, Act.LINE_GONE): {State.CLOSING},
    (State.CHECK, Word.LRC): {State.ANSWERING},
    (State.CHECK, Act.BUFFER_LOW): {State.CHECK},
    (State.CHECK, Act.SILENCE): {State.ANSWERING},
    (State.CHECK, Act.RESET): {State.CLOSING},
    (State.CHECK, Act.ALARM): {State.CLOSING},
    (State.CHECK, Act.FAULT): {State.CLOSING},
    (State.CHECK, Act.LINE_GONE): {State.CLOSING},
    (State.ANSWERING, Word.TEXT_END): {State.ANSWERING, State.RECEIVED, State.CLOSING},
    (State.ANSWERING, Act.ANSWERED): {State.RECORD_DUE},
    (State.ANSWERING, Act.BUFFER_LOW): {State.ANSWERING},
    (State.ANSWERING, Act.RESET): {State.CLOSING},
    (State.ANSWERING, Act.ALARM): {State.CLOSING},
    (State.ANSWERING, Act.FAULT): {State.CLOSING},
    (State.ANSWERING, Act.LINE_GONE): {State.CLOSING},
    (State.RECEIVED, Act.TAKEN): {State.CLOSING},
    (State.RECEIVED, Act.BUFFER_LOW): {State.RECEIVED},
    (State.RECEIVED, Act.RESET): {State.CLOSING},
    (State.RECEIVED, Act.ALARM): {State.CLOSING},
    (State.RECEIVED, Act.LINE_GONE): {State.RECEIVED},
    (State.SAVE_OPENING, Word.READY): {State.SAVE_OPENING, State.SAVING},
    (State.SAVE_OPENING, Act.RESET): {State.CLOSING},
    (State.SAVE_OPENING, Act.ALARM): {State.CLOSING},
    (State.SAVE_OPENING, Act.FAULT): {State.CLOSING},
    (State.SAVE_OPENING, Act.LINE_GONE): {State.CLOSING},
    (State.SAVING, Word.READY): {State.SAVING},
    (State.SAVING, Word.XOFF): {State.PAUSED},
    (State.SAVING, Word.XON): {State.SAVING},
    (State.SAVING, Word.CANCEL): {State.CLOSING},
    (State.SAVING, Act.SAVED): {State.CLOSING},
    (State.SAVING, Act.RESET): {State.CLOSING},
    (State.SAVING, Act.ALARM): {State.CLOSING},
    (State.SAVING, Act.LINE_GONE): {State.CLOSING},
    (State.PAUSED, Word.XOFF): {State.PAUSED},
    (State.PAUSED, Word.XON): {State.SAVING},
    (State.PAUSED, Word.CANCEL): {State.CLOSING},
    (State.PAUSED, Act.RESET): {State.CLOSING},
    (State.PAUSED, Act.ALARM): {State.CLOSING},
    (State.PAUSED, Act.LINE_GONE): {State.CLOSING},
    (State.CLOSING, Act.RESET): {State.CLOSING},
    (State.CLOSING, Act.ALARM): {State.CLOSING},
    (State.CLOSING, Act.LINE_GONE): {State.CLOSING},
    (State.CLOSING, Act.CLOSED): {State.IDLE},
}
"""(state, what happens) -> where the control may then be. The engine checks every move against it.

A word that has no row in a state is UNINVITED there, the one policy for all of them: it changes nothing, is answered
by nothing, and is reported, unless it was on its way when a job ended.
"""

_OTHERS: Final[Mapping[State, Word]] = {
    State.TEXT_DUE: Word.TEXT,
    State.LOADING: Word.TEXT,
    State.RECORD_DUE: Word.TEXT,
    State.RECORD: Word.TEXT,
    State.CHECK: Word.LRC,
}
"""What every character means that has no meaning of its own. In the other states it is uninvited.

The LRC is known by its place (2.2 figure): any value is one, that of a code too.
"""


def vocabulary(params: Params) -> Mapping[State, Sequence[Word | None]]:
    """What each of the 128 characters means in each state; None: it is uninvited."""
    ready = {params.write_ready: Word.READY}
    xon = {params.xon: Word.XON}
    hold = {params.xoff: Word.XOFF, params.cancel: Word.CANCEL}
    text_end = {params.text_end: Word.TEXT_END}
    record_ends = dict.fromkeys(record_end_codes(params, params.dnc_end), Word.RECORD_END)
    own: Mapping[State, Mapping[int, Word]] = {
        State.NAME_OPENING: ready,
        State.ASKING: ready,
        State.TEXT_DUE: ready | text_end,
        State.LOADING: text_end,
        State.RECORD_DUE: ready | record_ends | text_end,
        State.RECORD: record_ends,
        State.ANSWERING: text_end,
        State.SAVE_OPENING: ready,
        State.SAVING: xon | ready | hold,
        State.PAUSED: xon | hold,
    }
    return {state: _meanings(own.get(state, {}), _OTHERS.get(state)) for state in State}


def _meanings(own: Mapping[int, Word], others: Word | None) -> tuple[Word | None, ...]:
    meanings = [others] * (SEVEN_BITS + 1)
    for character, word in own.items():
        meanings[character] = word
    return tuple(meanings)
