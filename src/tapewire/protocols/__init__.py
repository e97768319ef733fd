"""The protocols Tapewire speaks, each with both ends. Whoever is registered here gets the contract suite, the
simulated world and the command line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from tapewire.codes import DataCode
from tapewire.engine import CncEngine, HostEngine
from tapewire.errors import UsageError
from tapewire.g05.layout import BinaryInput
from tapewire.protocols import bridgeport, fanuc_a, fanuc_b
from tapewire.protocols.listening import Listener
from tapewire.protocols.settings import End
from tapewire.protocols.text_rules import FanucText, TextRules

__all__ = ["PROTOCOLS", "ProtocolEntry", "Reader", "protocol"]

Reader: TypeAlias = Callable[[bytes], list[str | bytes]]
"""Puts what one end sent into words: names of codes and messages, and runs of program bytes."""


def _fanuc_text(params: Any) -> TextRules:
    return FanucText(params.data, params.g05.record_bytes)


def _no_binary_input(params: Any) -> None:
    return None


def _fanuc_binary_input(params: Any) -> tuple[BinaryInput, DataCode]:
    return params.g05, params.data


def _eight_bits(params: Any, stopbits: int) -> int:
    return 8


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtocolEntry:
    """One protocol: its two engines and what must be known to run them."""

    name: str
    title: str
    clause: str
    """Where the manual describes it."""
    baud: int
    """The rate used when none is asked for: the highest the manual allows on its interface."""
    punches_out: bool
    """The control can send programs by it."""
    record: type[Any]
    """The frozen record of its parameters."""
    params: Callable[[Mapping[str, str], End], Any]
    """`--set` words to that record. Raises UsageError."""
    host: Callable[[Any], HostEngine]
    cnc: Callable[[Any], CncEngine]
    words: Callable[[Any], tuple[Reader, Reader]]
    """Readers for what the host says and for what the control says."""
    listener: Callable[[Any], Listener]
    """Holds a recorded dialogue against the rules."""
    text: Callable[[Any], TextRules] = _fanuc_text
    """What programs are on its line."""
    stopbits: int = 1
    """Used when none are asked for."""
    data_bits: Callable[[Any, int], int] = _eight_bits
    """Bits of a character between start and parity, for these parameters and stop bits. Raises UsageError."""
    caution: str = ""
    """What an operator should know who has no profile of his control; empty where there is nothing to say."""
    sends_on: int = 512
    """Characters its control may still send after a stop where no control line stops it (B-63322EN-1 6.3)."""
    binary_input: Callable[[Any], tuple[BinaryInput, DataCode] | None] = _no_binary_input
    """The parameters of binary input operation and the code of the text around it; None where there is none."""
    refuse: Callable[[Any, Callable[[int], bytes]], None] | None = None
    """Reads a program as it would be sent and raises ProgramError when the protocol cannot carry it."""


def _fanuc_a_words(params: fanuc_a.Params) -> tuple[Reader, Reader]:
    words = fanuc_a.Words(params)
    return words.host, words.control


def _fanuc_b_words(params: fanuc_b.Params) -> tuple[Reader, Reader]:
    words = fanuc_b.Words(params.data)
    return words.host, words.control


def _bridgeport_words(params: bridgeport.Params) -> tuple[Reader, Reader]:
    words = bridgeport.Words(params)
    return words.host, words.control


def _bridgeport_text(params: bridgeport.Params) -> TextRules:
    return bridgeport.BridgeportText()


_ENTRIES: Final = (
    ProtocolEntry(
        name="fanuc-a",
        title="FANUC remote buffer, protocol A",
        clause="B-63322EN-1 chapter 4",
        baud=19200,
        punches_out=False,
        record=fanuc_a.Params,
        params=fanuc_a.Params.for_protocol_a,
        host=fanuc_a.FanucAHost,
        cnc=fanuc_a.FanucACnc,
        binary_input=_fanuc_binary_input,
        words=_fanuc_a_words,
        listener=fanuc_a.Listener,
        refuse=fanuc_a.refuse_program,
    ),
    ProtocolEntry(
        name="fanuc-a-expansion",
        title="FANUC remote buffer, expansion protocol A",
        clause="B-63322EN-1 chapter 5",
        baud=86400,
        punches_out=False,
        record=fanuc_a.Params,
        params=fanuc_a.Params.for_expansion_a,
        host=fanuc_a.FanucAHost,
        cnc=fanuc_a.FanucACnc,
        binary_input=_fanuc_binary_input,
        words=_fanuc_a_words,
        listener=fanuc_a.Listener,
        refuse=fanuc_a.refuse_program,
    ),
    ProtocolEntry(
        name="fanuc-b",
        title="FANUC remote buffer, protocol B",
        clause="B-63322EN-1 chapter 6",
        baud=19200,
        punches_out=True,
        record=fanuc_b.Params,
        params=fanuc_b.Params.for_protocol_b,
        host=fanuc_b.FanucBHost,
        cnc=fanuc_b.FanucBCnc,
        binary_input=_fanuc_binary_input,
        words=_fanuc_b_words,
        listener=fanuc_b.Listener,
    ),
    ProtocolEntry(
        name="fanuc-b-expansion",
        title="FANUC remote buffer, expansion protocol B",
        clause="B-63322EN-1 chapter 7",
        baud=86400,
        punches_out=True,
        record=fanuc_b.Params,
        params=fanuc_b.Params.for_expansion_b,
        host=fanuc_b.FanucBHost,
        cnc=fanuc_b.FanucBCnc,
        binary_input=_fanuc_binary_input,
        words=_fanuc_b_words,
        listener=fanuc_b.Listener,
    ),
    ProtocolEntry(
        name="bridgeport",
        title="Bridgeport REMOTE LOAD and DNC LINK",
        clause="REMOTE LOAD AND DNC LINK PROTOCOLS, whose control codes are a reconstruction",
        baud=9600,
        punches_out=True,
        record=bridgeport.Params,
        params=bridgeport.Params.for_bridgeport,
        host=bridgeport.BridgeportHost,
        cnc=bridgeport.BridgeportCnc,
        words=_bridgeport_words,
        listener=bridgeport.Listener,
        text=_bridgeport_text,
        stopbits=2,
        data_bits=bridgeport.data_bits,
        caution=bridgeport.CAUTION,
        sends_on=bridgeport.STOP_CHARACTERS,
    ),
)

PROTOCOLS: Final[dict[str, ProtocolEntry]] = {entry.name: entry for entry in _ENTRIES}


def protocol(name: str) -> ProtocolEntry:
    """The protocol called `name`. Raises UsageError with the names there are."""
    entry = PROTOCOLS.get(name)
    if entry is None:
        raise UsageError(f"there is no protocol {name!r}; the protocols are {', '.join(PROTOCOLS)}")
    return entry
