"""The words of REMOTE LOAD and DNC LINK: names, programs, and every setting of both ends.

    cnc   DC2              it has something to say
    host  DC1              go ahead
    cnc   1234;L DC4       a name (1.1): program 1234, as one text
    cnc   DC1              a request (1.2.1)
    host  text EOT         REMOTE LOAD (2.1), at most 12000 bytes

With `;D` instead of `;L` the host sends records, and the control answers each with ACK or NAK (DNC LINK, 2.2, 4.2).
A program the control sends follows DC2 and DC1 as a name does, and is told from it by its length (1.1, 1.2.2).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.codes import with_even_parity
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.code_table import CODE_STRING, CodeTable
from tapewire.protocols.bridgeport.records import RECORD_BYTES, Cut, DncEnd, Lrc
from tapewire.protocols.settings import End, Form, Switch, parse_settings, setting

__all__ = [
    "CAUTION",
    "DUMB",
    "NAME_BYTES",
    "STOP_CHARACTERS",
    "ErLine",
    "FirstRecord",
    "Hold",
    "Mode",
    "Name",
    "Params",
    "Parity",
    "StopBreach",
    "TapeEnd",
    "WhenMissing",
    "classify",
    "data_bits",
    "number_or_dumb",
    "on_the_wire",
]

CAUTION: Final = (
    "the control codes of this protocol are a reconstruction that no control has confirmed: "
    "`tapewire bridgeport learn` finds out what yours says, and --profile tells it"
)

STOP_CHARACTERS: Final = 3
"""A sender stops within so many characters of XOFF (3.2)."""

NAK_LIMIT: Final = 20
"""A record refused so often will not get better. The text sets no limit; a related control gives up after three. More
than the 14 by which lrc=auto gets to the last of eight candidates, each tried twice."""

NAME_BYTES: Final = 8
"""No name is longer, and every program is (1.1)."""

DUMB: Final = "-1"
"""The program number by which a control asks without a name and takes what comes, as from a tape reader."""

_NAME: Final = re.compile(rb"(\d{1,6});([LD])")
_NUMBER: Final = re.compile(r"[0-9]{1,6}")


class Mode(StrEnum):
    """What a control does with a program, by the letter behind its number."""

    LOAD = "L"
    """REMOTE LOAD: one text into memory (2.1)."""
    LINK = "D"
    """DNC LINK: record by record, while it cuts (2.2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Name:
    """A name that a control sent (1.1). What is received never becomes more than these digits."""

    number: str | None
    """One to six digits; None where the control sent something else."""
    mode: Mode | None
    raw: bytes

    @property
    def usual(self) -> bool:
        return self.number is not None and self.mode is not None

    @property
    def encoded(self) -> bytes:
        """As it stands on the line: `1234;L`."""
        return b"%s;%s" % ((self.number or "").encode(), (self.mode or "").encode())


def classify(text: bytes) -> Name | None:
    """What came between DC2 and its end: a name, or None for a program, which is longer (1.1).

    The form decides first, since a control may put CR LF behind a name.
    """
    word = text.strip()
    named = _NAME.fullmatch(word)
    if named:
        return Name(number=named[1].decode(), mode=Mode(named[2].decode()), raw=text)
    if len(text) > NAME_BYTES:
        return None
    digits = word.isdigit() and len(word) <= 6
    return Name(number=word.decode() if digits else None, mode=None, raw=text)


def on_the_wire(characters: bytes, parity: Parity) -> bytes:
    """Characters as they are handed to the line."""
    if parity is Parity.LINE:
        return characters
    return bytes(map(with_even_parity, characters))


def data_bits(params: Params, stopbits: int) -> int:
    """Seven, and the UART makes the parity; or eight without parity, of which the eighth is the parity made here."""
    if params.parity is Parity.LINE:
        return 7
    if stopbits == 1:
        raise UsageError("parity=software needs a line without parity of its own: that is 8N2, --stopbits 2")
    return 8


class Parity(StrEnum):
    """Who makes and checks the parity of 2.1.4 and 2.2.4."""

    LINE = "line"
    """The UART: seven data bits and even parity."""
    SOFTWARE = "software"
    """This program, on a line of eight data bits without parity."""


class FirstRecord(StrEnum):
    """When the first record of DNC LINK is sent."""

    AT_ONCE = "at_once"
    ON_ACK = "on_ack"


class ErLine(StrEnum):
    """Whether this line shows whether the control is switched on."""

    AUTO = "auto"
    HIDDEN = "hidden"


class WhenMissing(StrEnum):
    """What the host does when it is asked for a program that it does not have."""

    HOLD = "hold"
    """It sends nothing and waits for the operator."""
    EOT = "eot"
    """It sends a lone EOT: an empty program."""


class Hold(StrEnum):
    """How the control gets time in DNC LINK."""

    ACK = "ack"
    """It says ACK when it has room for another record."""
    XOFF = "xoff"
    """It says ACK at once, and XOFF in the middle of a record (3.1)."""


class StopBreach(StrEnum):
    """What the control does when more than three characters come after its XOFF (3.2)."""

    REPORT = "report"
    CANCEL = "cancel"


class TapeEnd(StrEnum):
    """What ends a load without a name besides EOT, which the text leaves open."""

    EOT = "eot"
    """Nothing else."""
    PERCENT = "percent"
    """A percent sign that is not the first character."""
    M30 = "m30"
    """The end of a block with M02 or M30."""


def number_or_dumb(text: str) -> str:
    """A program number, one to six digits, or -1. Raises UsageError."""
    if text != DUMB and not _NUMBER.fullmatch(text):
        raise UsageError("a program number has one to six digits, or is -1 for a load without a name")
    return text


_PROGRAM_NUMBER: Final = Form(values="one to six digits, or -1", parse=number_or_dumb, word=str)

_SECONDS: Final = (0, 86400.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Params(CodeTable):
    """The parameters of REMOTE LOAD and DNC LINK, both ends, with the code table among them."""

    parity: Parity = setting(
        Parity.LINE,
        "Who makes and checks the even parity: the UART of a 7E line, or software on an 8N line.",
    )
    lrc: Lrc = setting(
        Lrc.XOR7_ETB,
        "How the check character of a record is computed (XOR 90 % sure, with ETB 70 %). auto, for the host: try "
        "each until one draws an ACK.",
    )
    dnc_end: DncEnd = setting(DncEnd.EOT_ON_ACK, "How a program ends in DNC LINK (70 % sure).")
    first_record: FirstRecord = setting(
        FirstRecord.AT_ONCE, "The first record follows the request at once, or only an ACK (85 % sure)."
    )
    record_cut: Cut = setting(
        Cut.LINES, "Records end with a line, or are all full. Only a setting: the text says neither.", end=End.HOST
    )
    record_bytes: int = setting(
        RECORD_BYTES, "The most text in a record (2.2.3).", end=End.HOST, unit="bytes", limits=(1, RECORD_BYTES)
    )
    avoid_lrc_codes: Switch = setting(
        Switch.OFF,
        "Cut records so that no check character looks like a code, for a control whose driver stumbles over it.",
        end=End.HOST,
    )
    missing: WhenMissing = setting(
        WhenMissing.HOLD, "Asked for a program it does not have, the host waits or sends a lone EOT.", end=End.HOST
    )
    dumb_eot: Switch = setting(
        Switch.ON, "A program that was asked for without a name ends with EOT; off: with its text.", end=End.HOST
    )
    punch_mode: Switch = setting(
        Switch.OFF, "Take a program that comes without DC2 and DC1, as to a tape punch.", end=End.HOST
    )
    closing_dc3: Switch = setting(
        Switch.OFF, "The host answers the end of what the control sends with XOFF, as related links do.", end=End.BOTH
    )
    text_timeout: float = setting(
        30.0,
        "Silence inside what the control sends, after which it has failed; 0: never.",
        end=End.HOST,
        unit="s",
        limits=_SECONDS,
    )
    upload_limit: int = setting(
        1 << 20, "The most a control may send as one program.", end=End.HOST, unit="bytes", limits=(9, 1 << 30)
    )
    end_wait: float = setting(
        1.0,
        "After the end of a program, in either direction, the host listens so long for a cancel before it is complete.",
        end=End.HOST,
        unit="s",
        limits=(0.05, 3600.0),
    )
    pause_limit: float = setting(
        600.0,
        "A pause longer than this ends the job: a control that lost power would resume in the middle. 0: never.",
        end=End.HOST,
        unit="s",
        limits=_SECONDS,
    )
    hold_limit: float = setting(
        600.0,
        "A request that waits for the operator longer than this ends as failed. 0: never.",
        end=End.HOST,
        unit="s",
        limits=_SECONDS,
    )
    ack_limit: float = setting(
        0.0,
        "No answer to a record for so long ends the job. 0: never, since a long cut keeps a control silent.",
        end=End.HOST,
        unit="s",
        limits=_SECONDS,
    )
    xoff_ack_grace: float = setting(
        0.0,
        "An ACK while XOFF holds the host lets it go on after so long without XON. 0: wait for XON, as 3.2 says.",
        end=End.HOST,
        unit="s",
        limits=(0, 3600.0),
    )
    stray_xon_time: float = setting(
        2.0,
        "An XOFF without XON at the end of a job: so long after it, an XON without a name is no request.",
        end=End.HOST,
        unit="s",
        limits=(0, 3600.0),
    )
    nak_warning: int = setting(
        3, "NAKs of one record after which the operator is told.", end=End.HOST, unit="NAKs", limits=(1, 1000)
    )
    er: ErLine = setting(
        ErLine.AUTO,
        "hidden: DSR is strapped or has no wire, so its state says nothing. auto: its fall ends the job.",
        end=End.HOST,
    )
    program: str = setting(
        "1",
        "The program number the simulated control asks for, or sends under.",
        end=End.CONTROL,
        form=_PROGRAM_NUMBER,
    )
    mode: Mode = setting(
        Mode.LINK, "What the simulated control asks for: L for REMOTE LOAD, D for DNC LINK.", end=End.CONTROL
    )
    name_trailer: bytes = setting(
        b"\x14", "What the simulated control sends behind a name.", end=End.CONTROL, form=CODE_STRING
    )
    save_trailer: bytes = setting(
        b"\x04\x14", "What the simulated control sends behind a program.", end=End.CONTROL, form=CODE_STRING
    )
    operator_cancel: bytes = setting(
        b"\x13\x10",
        "The pair by which the operator of the simulated control cancels.",
        end=End.CONTROL,
        form=CODE_STRING,
    )
    parity_cancel: bytes = setting(
        b"\x10",
        "What the simulated control sends when a character of REMOTE LOAD is damaged.",
        end=End.CONTROL,
        form=CODE_STRING,
    )
    repeat: float = setting(
        3.0,
        "The simulated control says DC2 again after so long without DC1; 0: never.",
        end=End.CONTROL,
        unit="s",
        limits=(0, 3600.0),
    )
    record_timeout: float = setting(
        5.0,
        "Silence inside a record, after which the simulated control asks for it again by NAK; 0: never.",
        end=End.CONTROL,
        unit="s",
        limits=(0, 3600.0),
    )
    nak_limit: int = setting(
        NAK_LIMIT,
        "NAKs of one record after which the simulated control cancels; 0: never. lrc=auto draws 14 at most.",
        end=End.CONTROL,
        unit="NAKs",
        limits=(0, 1000),
    )
    buffer: int = setting(
        1024,
        "Characters the simulated control can hold while it executes.",
        end=End.CONTROL,
        unit="characters",
        limits=(300, 1 << 20),
    )
    after_stop: int = setting(
        STOP_CHARACTERS,
        "Characters the simulated control still sends after it has received XOFF, those in its UART among them.",
        end=End.CONTROL,
        unit="characters",
        limits=(0, STOP_CHARACTERS),
    )
    naming: Switch = setting(
        Switch.ON,
        "The simulated control names the program first (1.1); off: the remote's operator has to choose (1.2).",
        end=End.CONTROL,
    )
    hold: Hold = setting(
        Hold.ACK,
        "What keeps the host waiting in DNC LINK: the ACK, until a record has room, or XOFF inside records.",
        end=End.CONTROL,
    )
    stop_at_free: int = setting(
        32,
        "The simulated control says XOFF when so little is free: the three characters of 3.2 and a UART's delay.",
        end=End.CONTROL,
        unit="characters",
        limits=(STOP_CHARACTERS + 1, 1 << 20),
    )
    start_at_free: int = setting(
        0,
        "It says XON when so much is free; 0: half of the buffer beside one record.",
        end=End.CONTROL,
        unit="characters",
        limits=(0, 1 << 20),
    )
    stop_breach: StopBreach = setting(
        StopBreach.REPORT,
        "More than three characters after XOFF: the simulated control says so, or cancels too.",
        end=End.CONTROL,
    )
    late_xon: Switch = setting(
        Switch.OFF,
        "Its XOFF came too late and the program is in: it still says XON when enough is free.",
        end=End.CONTROL,
    )
    nak_quiet: float = setting(
        0.2,
        "The line is to be quiet for so long before NAK; 0: at once. What only looked like the end of a record would "
        "draw two NAKs, two copies, and a record doubled.",
        end=End.CONTROL,
        unit="s",
        limits=(0, 3600.0),
    )
    load_timeout: float = setting(
        0.0,
        "Silence inside the text of REMOTE LOAD, after which the simulated control cancels; 0: never.",
        end=End.CONTROL,
        unit="s",
        limits=(0, 3600.0),
    )
    answer_limit: float = setting(
        0.0,
        "No answer to DC2, a request, ACK or NAK for so long makes the simulated control cancel; 0: never.",
        end=End.CONTROL,
        unit="s",
        limits=_SECONDS,
    )
    request_repeat: float = setting(
        0.0,
        "The simulated control requests again after so long without a character; 0: never.",
        end=End.CONTROL,
        unit="s",
        limits=(0, 3600.0),
    )
    tape_end: TapeEnd = setting(
        TapeEnd.EOT, "What ends a load of program -1 in the simulated control, besides EOT.", end=End.CONTROL
    )
    bare_save: Switch = setting(
        Switch.OFF, "The simulated control sends program -1 without DC2 and DC1, as to a tape punch.", end=End.CONTROL
    )
    idle_cancel: Switch = setting(
        Switch.ON, "The operator's cancel is said also when nothing runs, or all is in (4.3).", end=End.CONTROL
    )

    def __post_init__(self) -> None:
        CodeTable.__post_init__(self)
        if not self.name_trailer:
            raise UsageError("name_trailer=none: the end of a name could not be told; give it a code, as 14")
        if not self.stop_at_free < self.xon_at_free <= self.buffer - RECORD_BYTES:
            raise UsageError(
                f"stop_at_free={self.stop_at_free}, start_at_free={self.start_at_free}, buffer={self.buffer}: it must "
                f"be less than start_at_free, and that at most the buffer less the {RECORD_BYTES} of a record"
            )

    @property
    def xon_at_free(self) -> int:
        """Where the simulated control says XON."""
        return self.start_at_free or max((self.buffer - RECORD_BYTES) // 2, self.stop_at_free + 1)

    @classmethod
    def for_bridgeport(cls, settings: Mapping[str, str], end: End) -> Params:
        if end is End.CONTROL and settings.get("lrc") == Lrc.AUTO:
            raise UsageError("lrc=auto: the control has one way of its own; auto is for the host that looks for it")
        return parse_settings(cls, settings, end, {})
