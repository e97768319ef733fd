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
from tapewire.protocols import fanuc_a, fanuc_b
from tapewire.protocols.settings import End

__all__ = ["PROTOCOLS", "ProtocolEntry", "Reader", "protocol"]

Reader: TypeAlias = Callable[[bytes], list[str | bytes]]
"""Puts what one end sent into words: names of codes and messages, and runs of program bytes."""


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
    refuse: Callable[[Any, Callable[[int], bytes]], None] | None = None
    """Reads a program as it would be sent and raises ProgramError when the protocol cannot carry it."""

    def data_code(self, params: Any) -> DataCode:
        """The code of the program's characters on the line."""
        code = params.data
        assert isinstance(code, DataCode)
        return code


def _fanuc_a_words(params: fanuc_a.Params) -> tuple[Reader, Reader]:
    words = fanuc_a.Words(params)
    return words.host, words.control


def _fanuc_b_words(params: fanuc_b.Params) -> tuple[Reader, Reader]:
    words = fanuc_b.Words(params.data)
    return words.host, words.control


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
        words=_fanuc_a_words,
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
        words=_fanuc_a_words,
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
        words=_fanuc_b_words,
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
        words=_fanuc_b_words,
    ),
)

PROTOCOLS: Final[dict[str, ProtocolEntry]] = {entry.name: entry for entry in _ENTRIES}


def protocol(name: str) -> ProtocolEntry:
    """The protocol called `name`. Raises UsageError with the names there are."""
    entry = PROTOCOLS.get(name)
    if entry is None:
        raise UsageError(f"there is no protocol {name!r}; the protocols are {', '.join(PROTOCOLS)}")
    return entry
