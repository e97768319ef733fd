"""What users can set of protocol A and expansion protocol A, at either end."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from tapewire.codes import EOR_CODES, DataCode
from tapewire.errors import UsageError
from tapewire.g05.layout import BinaryInput
from tapewire.protocols.binary_input import binary_input
from tapewire.protocols.fanuc_a.messages import LONGEST_DAT, Coding, EndCode, MessageCode
from tapewire.protocols.fanuc_a.packets import MonitorCode, MonitorSum
from tapewire.protocols.fanuc_a.status import LIMITS, TENTHS_OF_SECONDS, Filler, Parameters
from tapewire.protocols.settings import End, Switch, parse_settings, setting

__all__ = [
    "AfterEnd",
    "AmongPackets",
    "DataLength",
    "First",
    "GtdAnswers",
    "NakNumber",
    "Naks",
    "OpenLine",
    "PacketLength",
    "Params",
    "PollingUnit",
    "Retries",
    "RstAtEnd",
    "SetData",
    "Switching",
    "SynParameters",
    "TimeOut",
    "Unready",
]


class PacketLength(StrEnum):
    """n of positions 55 and 56 of SET (5.2 1)): data bytes of a packet / 256."""

    AUTO = "auto"
    PROTOCOL_A = "0"
    N1 = "1"
    N2 = "2"
    N4 = "4"


class DataLength(StrEnum):
    """Length of the data of SAT and SET (4.4.2): 57 to 72 have no meaning."""

    USED = "56"
    ALL = "72"


class GtdAnswers(StrEnum):
    """How GTD is answered in expansion A when there is no data now, or none any more: chapter 5 does not say."""

    PACKETS = "packets"
    """Invalid packets; an end packet that holds EOR and nothing else."""
    MESSAGES = "messages"
    """WAT; EOD. Both can look like the beginning of a packet."""


class Retries(StrEnum):
    """How long the retry count of 4.6 2) (1) goes on counting."""

    EXCHANGE = "exchange"
    JOB = "job"


class First(StrEnum):
    """Who speaks first."""

    CONTROL = "control"
    """4.3 (1)."""
    HOST = "host"


class SetData(StrEnum):
    """When SET carries data (4.4.2 2))."""

    CHANGES = "changes"
    ALWAYS = "always"


class Switching(StrEnum):
    """Position 1 of SET (4.4.2 2)). Which digit asks for remote operation and which for tape is not stated."""

    ECHO = "echo"
    """What the last SAT has there: nothing is to be switched."""
    ZERO = "0"
    ONE = "1"


class PollingUnit(StrEnum):
    """P2 of positions 41 to 44 (4.4.2 1)): what Tp counts."""

    SECONDS = "0"
    TENTHS = "1"


class RstAtEnd(StrEnum):
    """What RST means when the whole program has been taken, but no SAT has yet reported an empty buffer."""

    COMPLETE = "complete"
    CANCELLED = "cancelled"


class OpenLine(StrEnum):
    """What a control does after an open-line error; the text of 4.6 1) is garbled."""

    WAITS = "waits"
    """Silent until the host's SYN."""
    SPEAKS = "speaks"
    """SYN, as after power-on."""


class Unready(StrEnum):
    """With what a control polls a host that answered RDY with SYN."""

    SYN = "syn"
    RDY = "rdy"


class SynParameters(StrEnum):
    """What becomes of the parameters when a control is initialised anew."""

    KEPT = "kept"
    POWER_ON = "power-on"


class TimeOut(StrEnum):
    """What To measures at the control: 4.3 (3) says "start transmission", 4.6 nothing."""

    BYTES = "bytes"
    """The silence before the answer and between its bytes."""
    MESSAGE = "message"
    """All of the answer."""


class NakNumber(StrEnum):
    """What a NAK names when a packet is out of order; 5.2 2) a) calls it improper."""

    EXPECTED = "expected"
    RECEIVED = "received"


class Naks(StrEnum):
    """How often a control asks for one and the same packet."""

    ERROR = "error"
    """Once for an error; what comes before the packet asked for is passed over."""
    PACKET = "packet"
    """For every packet that is not the one asked for; not for what comes twice because it was asked for twice."""


class AmongPackets(StrEnum):
    """Messages that a control hears between GTD and the end packet, where chapter 5 has nothing but packets."""

    NONE = "none"
    RTY = "rty"
    """RTY in place of the first packet: a host that could not read the GTD."""
    SYN = "syn"
    """That, and SYN wherever a packet may begin: a host that begins anew."""


class AfterEnd(StrEnum):
    """The state a control reports when it has read the end of the program (4.7 is a lost figure)."""

    RESET = "reset"
    OPERATING = "operating"


_HOST, _CONTROL = End.HOST, End.CONTROL


def _parameter(field: str, default: int, why: str) -> Any:
    limit = LIMITS[field]
    text = f"{limit.meaning[0].upper()}{limit.meaning[1:]} (4.5). {why}".rstrip()
    limits = (limit.low, limit.high)
    return setting(default, text, key=limit.name, unit=limit.unit, limits=limits, control=limit.power_on)


@dataclass(frozen=True, slots=True, kw_only=True)
class Params:
    """The parameters of both ends. `nb` to `tw` are what a host asks for by SET and what a control starts with."""

    code: MessageCode = setting(
        MessageCode.ASCII, "Code of the messages: 5000#2 = 0 is ASCII, 1 is ISO (the reverse of protocol B)."
    )
    end: EndCode = setting(EndCode.CR, "End code of the messages: 5000#3 = 0 is CR, 1 is ETX.")
    data: DataCode = setting(DataCode.ASCII, "The code of the program's characters (0000#2).")
    g05: BinaryInput = binary_input()
    n: PacketLength = setting(
        PacketLength.AUTO,
        "Data bytes of a packet / 256; 0 is protocol A. auto: 0 for fanuc-a, 4 for fanuc-a-expansion, 0 for a control, "
        "which takes what the host's SET says.",
    )
    nb: int = _parameter("nb", 4000, "A large one makes long DATs.")
    no: int = _parameter("no", 512, "The host may have this much under way when RS goes OFF.")
    ne: int = _parameter("ne", 10, "")
    tp: int = _parameter("tp", 2, "Short, so that the end of a program is soon known.")
    to: int = _parameter("to", 20, "")
    ti: int = _parameter("ti", 0, "A host computer needs no gaps between bytes.")
    tx: int = _parameter("tx", 0, "A host computer can receive while it sends; a line that must turn round cannot.")
    tw: int = _parameter("tw", 1, "Short, so that a late source costs little.")
    p2: PollingUnit = setting(
        PollingUnit.SECONDS, "Tp counts seconds, or with 1 tenths of a second (positions 41 to 44).", key="P2"
    )
    retries: Retries = setting(
        Retries.EXCHANGE,
        "The retry count starts again at zero after a good exchange, or runs through the job.",
    )
    gtd_answers: GtdAnswers = setting(
        GtdAnswers.PACKETS,
        "How GTD is answered in expansion A when there is no data: not stated; WAT and EOD can look like a packet.",
    )
    first: First = setting(
        First.CONTROL, "Who speaks first. host: SYN is sent as soon as the line is there.", end=_HOST
    )
    margin: float = setting(
        1.0,
        "The control counts as silent, and gets SYN, after Tp + Tx, the time its message takes, and this.",
        end=_HOST,
        unit="s",
        limits=(0.1, 600.0),
    )
    interbyte: float = setting(
        1.0,
        "A message that stops in the middle for so long is asked for again.",
        end=_HOST,
        unit="s",
        limits=(0.05, 60.0),
    )
    set_data: SetData = setting(
        SetData.CHANGES, "SET carries data when something is to be changed, or always.", end=_HOST
    )
    set_length: DataLength = setting(
        DataLength.USED, "Length of the data of SET; positions 57 to 72 have no meaning.", end=_HOST
    )
    switching: Switching = setting(
        Switching.ECHO,
        "Position 1 of SET: what SAT has there, so that nothing is switched, or a digit. Which one asks for remote "
        "operation is not stated.",
        end=_HOST,
    )
    convert_from: int = setting(
        0, "A byte of the data that the control turns into convert_to; 0 and 0: none.", end=_HOST, limits=(0, 255)
    )
    convert_to: int = setting(0, "What convert_from becomes.", end=_HOST, limits=(0, 255))
    longest_dat: int = setting(
        LONGEST_DAT,
        "A DAT is never longer than this, than Nb - No, and than the line carries in half of To.",
        end=_HOST,
        unit="bytes",
        limits=(1, LONGEST_DAT),
    )
    wat_after: float = setting(
        1.0,
        "A source that has nothing is waited for so long, and half of To at most, before WAT or an invalid packet.",
        end=_HOST,
        unit="s",
        limits=(0.0, 99.0),
    )
    held_limit: float = setting(
        0.0,
        "A job that the control holds by RS or DC3 for longer has failed. 0: no limit, since a feed hold has none.",
        end=_HOST,
        unit="s",
        limits=(0.0, 604_800.0),
    )
    lookahead: float = setting(
        8.0,
        "Expansion A: the next packet is begun when so much of the one before is still to leave, and from 16 "
        "characters to a quarter of a packet in any case. A computer may wake late by so much.",
        end=_HOST,
        unit="ms",
        limits=(0.0, 50.0),
    )
    pad: int = setting(0, "Fills the last packet behind EOR; not stated.", end=_HOST, limits=(0, 255))
    invalid: int = setting(0, "The number of invalid packets.", end=_HOST, limits=(0, 0x2F))
    rst_at_end: RstAtEnd = setting(
        RstAtEnd.CANCELLED,
        "RST after all has been taken, before SAT has reported an empty buffer: complete where M30 resets the CNC.",
        end=_HOST,
    )
    start_time: float = setting(
        2.0,
        "The control's first message comes so long after both ends are ready (4.3 (1)).",
        end=_CONTROL,
        unit="s",
        limits=(0.0, 60.0),
    )
    sat_length: DataLength = setting(DataLength.USED, "Length of the data of SAT: not stated.", end=_CONTROL)
    filler: Filler = setting(Filler.ZERO, "What stands in the unused positions of SAT: not stated.", end=_CONTROL)
    echo: Switch = setting(
        Switch.OFF, "Position 1 of SAT repeats that of the last SET, or is always 0 (5000#1).", end=_CONTROL
    )
    cd: Switch = setting(Switch.ON, "CD is checked (5000#4 = 0). RS-422 has none (3.3).", end=_CONTROL)
    di: int = setting(0, "The DI byte G152 that RDI reads.", end=_CONTROL, limits=(0, 255))
    open_line: OpenLine = setting(
        OpenLine.WAITS, "Whether a control waits for SYN after an open-line error or speaks itself.", end=_CONTROL
    )
    unready: Unready = setting(
        Unready.SYN, "With what a host is polled that answers RDY with SYN: not stated.", end=_CONTROL
    )
    syn_parameters: SynParameters = setting(
        SynParameters.POWER_ON, "What becomes of Nb and the others at SYN: not stated.", end=_CONTROL
    )
    time_out: TimeOut = setting(
        TimeOut.BYTES, "Whether To covers the silence between bytes or all of an answer: not stated.", end=_CONTROL
    )
    after_end: AfterEnd = setting(
        AfterEnd.RESET, "The state after the end of the program has been read: not stated.", end=_CONTROL
    )
    monitor: MonitorCode = setting(
        MonitorCode.PRINTED,
        "Monitor packets as printed (DC3 93h, NAK 15h), all ASCII (13h, 15h) or all ISO (93h, 95h, ...).",
        end=_CONTROL,
    )
    monitor_sum: MonitorSum = setting(
        MonitorSum.WITHOUT_END, "What the sum of monitor packets covers: not stated.", end=_CONTROL
    )
    nak_number: NakNumber = setting(NakNumber.EXPECTED, "What NAK names when a packet is out of order.", end=_CONTROL)
    naks: Naks = setting(
        Naks.ERROR, "One NAK for an error, or one for each packet that comes before the one asked for.", end=_CONTROL
    )
    monitors_again: Switch = setting(
        Switch.OFF,
        "NAK and CAN are said again when more than four packets have come that do not obey them: not stated. RESET "
        "says a CAN again in any case, when more has come behind it than the packet under way.",
        end=_CONTROL,
    )
    among_packets: AmongPackets = setting(
        AmongPackets.NONE,
        "Messages heard between GTD and the end packet: chapter 5 has none. rty: RTY in place of the first packet; "
        "syn: that, and SYN wherever a packet may begin.",
        end=_CONTROL,
    )
    time_out_in_hold: Switch = setting(
        Switch.OFF, "To goes on while the control itself holds the host by DC3: not stated.", end=_CONTROL
    )
    dc3_free: int = setting(
        2560,
        "Expansion A: DC3 when so little is free. The manual gives no level.",
        end=_CONTROL,
        unit="bytes",
        limits=(1, 8191),
    )
    dc1_free: int = setting(
        4096,
        "Expansion A: DC1 when so much is free. The manual gives no level.",
        end=_CONTROL,
        unit="bytes",
        limits=(2, 8192),
    )

    def __post_init__(self) -> None:
        complaint = self.wanted.complaint()
        if complaint is not None:
            raise UsageError(complaint)
        if self.p2 is PollingUnit.TENTHS and self.tw * 10 > self.tp:
            raise UsageError(
                f"Tw={self.tw} s is longer than Tp={self.tp}, which P2=1 makes tenths of a second: set Tp to "
                f"{self.tw * 10} or more, or Tw to {self.tp // 10}"
            )
        if self.dc1_free <= self.dc3_free:
            raise UsageError(f"dc1_free={self.dc1_free} must be greater than dc3_free={self.dc3_free}")
        if self.converts and {self.convert_from, self.convert_to} & set(EOR_CODES[self.data]):
            raise UsageError(
                f"convert_from={self.convert_from}, convert_to={self.convert_to} would take an EOR away from the "
                "program, or put one into its middle, which hides what follows: choose other codes"
            )
        if self.converts and self.data is DataCode.BINARY and self.convert_from % 2 == 0:
            raise UsageError(
                f"convert_from={self.convert_from} would change binary records, whose bytes are even: "
                "leave the conversion off (convert_from=0, convert_to=0)"
            )

    @property
    def coding(self) -> Coding:
        """How messages are written."""
        return Coding(code=self.code, end=self.end)

    @property
    def converts(self) -> bool:
        """The control is to change codes of the data (positions 45 to 48 of SET)."""
        return self.convert_from != self.convert_to

    @property
    def packet_n(self) -> int:
        """n as a number; 0 is protocol A."""
        return 0 if self.n is PacketLength.AUTO else int(self.n)

    @property
    def wanted(self) -> Parameters:
        """What a host asks for by SET, and what a control has at power-on."""
        return Parameters(
            nb=self.nb,
            no=self.no,
            ne=self.ne,
            tp=self.tp,
            to=self.to,
            ti=self.ti,
            tx=self.tx,
            tw=self.tw,
            unit=TENTHS_OF_SECONDS if self.p2 is PollingUnit.TENTHS else 0,
            convert_from=self.convert_from,
            convert_to=self.convert_to,
            n=self.packet_n,
        )

    @classmethod
    def for_protocol_a(cls, settings: Mapping[str, str], end: End) -> Params:
        """Protocol A. Raises UsageError."""
        return cls._parsed(settings, end, PacketLength.PROTOCOL_A)

    @classmethod
    def for_expansion_a(cls, settings: Mapping[str, str], end: End) -> Params:
        """Expansion protocol A. Raises UsageError."""
        params = cls._parsed(settings, end, PacketLength.N4)
        if end is End.HOST and not params.packet_n:
            raise UsageError("n=0 is protocol A: use fanuc-a, or n=1, 2 or 4")
        return params

    @classmethod
    def _parsed(cls, settings: Mapping[str, str], end: End, automatic: PacketLength) -> Params:
        params = parse_settings(cls, settings, end, {})
        if params.n is not PacketLength.AUTO:
            return params
        return dataclasses.replace(params, n=automatic if end is End.HOST else PacketLength.PROTOCOL_A)
