"""What of a program these protocols cannot carry, seen before a line is opened (4.1, 5.2, 8.2, 9.1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tapewire.codes import TABLES
from tapewire.errors import ProgramError
from tapewire.fanuc.tape import TapeScanner
from tapewire.g05.sections import SectionScan
from tapewire.protocols.fanuc_a.params import Params

__all__ = ["refuse_program"]

CHUNK_BYTES: Final = 1 << 16


def refuse_program(params: Params, read: Callable[[int], bytes]) -> None:
    """Read a whole program, as it would be sent, in constant memory. Raises ProgramError with what to do.

    In protocol A the end code of the messages cannot stand in the data, and a G05 section is in the special format
    (9.1 (5) note). Expansion A has packets of a fixed length: a program without EOR that does not fill its last one
    would end in padding that the control takes for program; in the general format a byte of a section can look like
    EOR to a host that does not know its records.
    """
    end, tape = params.coding.end_byte, TapeScanner(params.data, params.g05.record_bytes)
    sections = SectionScan(TABLES[params.data].to_ascii, params.g05.record_bytes)
    offset, end_code_at = 0, -1
    while chunk := read(CHUNK_BYTES):
        if not params.packet_n and end_code_at < 0 and (at := chunk.find(end)) >= 0:
            end_code_at = offset + at
        sections.feed(chunk)
        tape.feed(chunk)
        offset += len(chunk)
    sections.feed(b"")
    if sections.general_bytes is not None:
        _refuse_general(params, sections.general_bytes)
    if end_code_at >= 0:
        raise ProgramError(
            f"byte {end_code_at + 1:,} is {end[0]:02X}h, the end code of every message: remove it, or change the "
            "end code (5000#3) or the code (5000#2) of control and host"
        )
    if params.packet_n and not tape.ended and offset % (256 * params.packet_n):
        raise ProgramError(
            f"no EOR, and {offset:,} bytes do not fill packets of {256 * params.packet_n}: the control would take the "
            "padding of the last one for program; end it with EOR, or use protocol A or B"
        )


def _refuse_general(params: Params, record_bytes: int) -> None:
    if not params.packet_n:
        raise ProgramError(
            f"a G05 section with records of {record_bytes} bytes is in the general format: protocol A carries the "
            "special one only (7609#2 = 0); encode it anew, or use expansion A or protocol B"
        )
    if params.g05.layout is None:
        raise ProgramError(
            f"a G05 section with records of {record_bytes} bytes is in the general format, in which any byte may look "
            f"like EOR: say how its records are made, with --set g05={(record_bytes - 1) // 2},general or, if they "
            "carry auxiliary functions, their axes and aux"
        )
