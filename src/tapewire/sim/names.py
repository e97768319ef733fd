"""The names of what the protocols cannot detect by their own rules. docs/simulator.md says of each what it is."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Undetectable"]


class Undetectable(StrEnum):
    """Decided by `undetectable.py`, which wants the damage that explains the deviation."""

    # characters
    FLIP = "flip without parity"
    LOST = "lost character"
    DOUBLED = "doubled character"
    OUT_OF_NOTHING = "character out of nothing"

    # protocol B, and what Bridgeport shares with it
    LOOKS_LIKE_STOP = "a reset that looks like a stop: no posting, and ER unseen"
    WITH_THE_LAST = "an alarm or a reset behind the last characters, without posting"
    END_LIKE_RESET = "an end right behind a stop, which a reset would say too"
    CODE = "a control code lost, damaged or forged"
    CS_OFF = "an alarm or a reset while the host holds CS OFF, and ER unseen"
    EOR = "an EOR lost or forged"
    SILENT_ALARM = "an alarm that is told only at RESET"
    LONG_BLOCK = "a damaged block that takes hours"
    DARK_CONTROL = "a control whose loss of power nothing shows"
    ALARM_UNPLUGGED = "an alarm of the control while its cable was pulled"
    END_UNPLUGGED = "the end of a reading whose cable was pulled, and ER unseen"
    LATE_WORD = "a word of the control that is heard later than 100 ms"

    # protocol A and its expansion
    SUM = "a sum of eight bits that cancels"
    LAST_PACKET = "a packet lost directly before the end packet"
    TEN_PACKETS = "ten packets running lost: their numbers go round"
    GAVE_UP_HOLDING = "a control that gave up the line while it held the host"

    # Bridgeport
    FORGED_END = "an end code forged in the middle of a program"
    END_CODE = "the end code lost behind a program that is whole"
    CHECK = "a check character of seven bits that cancels"
    REST = "the rest of a record behind a pause, whose check character fits by chance"
    NO_RECORD = "a record of which nothing came"
    READ_AS_TEXT = "a code of the host read as text"
    OTHER_NAME = "a program name that came otherwise"
    DAMAGED_NAME = "a program name that came damaged"
    ANSWER = "ACK or NAK lost or forged"

    # all of them
    STOP_REQUEST = "a stop request lost, damaged or late"
    NO_STOP_DISTANCE = "a path that guarantees no stop distance"
    OVER_AT_HOST = "the host's job is over, and the control waits for RESET"
