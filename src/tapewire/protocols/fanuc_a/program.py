"""What these protocols cannot carry (4.1, 4.4.2, 5.2, 8.2, 9.1): seen before the line is opened, or on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tapewire.codes import TABLES, DataCode
from tapewire.errors import ProgramError
from tapewire.fanuc.tape import TapeScanner
from tapewire.g05.sections import SectionScan, find_g05
from tapewire.protocols.fanuc_a.params import Params

__all__ = ["EMPTY", "Scrutiny", "refuse_program"]

CHUNK_BYTES: Final = 1 << 16

LONGEST_BLOCK: Final = 4096
"""A block that is G05 alone is shorter, whatever comment it has."""

EMPTY: Final = "the program is empty: there is nothing to send"

_SEVEN_BITS: Final = bytes(byte & 0x7F for byte in range(0x100))


class Scrutiny:
    """Reads a program as it would be sent, in any pieces, and says why it cannot be."""

    def __init__(self, params: Params) -> None:
        self._end = b"" if params.packet_n else params.coding.end_byte
        self._converts = params.converts
        self._change = f"{params.convert_from:02X}h into {params.convert_to:02X}h"
        self._to_text = _to_text(params)
        self._block = b""
        self._offset = 0
        self._tape = TapeScanner(params.data, params.g05.record_bytes)
        self._sections = SectionScan(TABLES[params.data].to_ascii, params.g05.record_bytes)
        self._records_are_known = params.g05.layout is not None
        self._packet = 256 * params.packet_n

    def look(self, data: bytes) -> str:
        """Why the program cannot be sent from somewhere in `data` on; empty while it can."""
        self._sections.feed(data)
        why = self._general_format() or self._end_code(data) or self._binary_section(data)
        self._tape.feed(data)
        self._offset += len(data)
        return why

    def finish(self) -> str:
        """The same for its end."""
        if not self._offset:
            return EMPTY
        self._sections.feed(b"")
        if why := self._general_format():
            return why
        if self._packet and not self._tape.ended and self._offset % self._packet:
            return (
                f"no EOR, and {self._offset:,} bytes do not fill packets of {self._packet}: the control would take the "
                "padding of the last one for program; end it with EOR, or use protocol A or B"
            )
        return ""

    def _end_code(self, data: bytes) -> str:
        """4.1: in protocol A the end code of the messages cannot stand in the data."""
        at = data.find(self._end) if self._end else -1
        if at < 0:
            return ""
        return (
            f"byte {self._offset + at + 1:,} is {self._end[0]:02X}h, the end code of every message: remove it, or "
            "change the end code (5000#3) or the code (5000#2) of control and host"
            + (
                "; a G05 section is encoded in the special format, which never holds it"
                if self._sections.inside
                else ""
            )
        )

    def _general_format(self) -> str:
        """9.1 (5) note: protocol A takes the special format only. In expansion A a byte may look like EOR to us."""
        size = self._sections.general_bytes
        if size is None or (self._packet and self._records_are_known):
            return ""
        what = f"a G05 section with records of {size} bytes is in the general format"
        if not self._packet:
            return f"{what}: protocol A carries the special one only (7609#2 = 0); encode it anew"
        return (
            f"{what}, in which any byte may look like EOR: say how its records are made, with --set "
            f"g05={(size - 1) // 2},general or, if they carry auxiliary functions, their axes and aux"
        )

    def _binary_section(self, data: bytes) -> str:
        """4.4.2 1) note: a conversion changes every byte of the data, records of binary input operation too."""
        if not self._converts:
            return ""
        text = self._block + data.translate(self._to_text)
        at = find_g05(text, 0)
        if at is None:
            self._block = text[text.rfind(b"\n") + 1 :][-LONGEST_BLOCK:]
            return ""
        where = self._offset - len(self._block) + at + 1
        return (
            f"byte {where:,} begins a G05 section, and the control would turn {self._change} inside its binary records "
            "too: convert the program here and leave convert_from and convert_to alone"
        )


def _to_text(params: Params) -> bytes:
    """As the control reads it: converted, then ASCII."""
    read = _SEVEN_BITS if params.data is DataCode.BINARY else TABLES[params.data].to_ascii
    table = bytearray(read)
    table[params.convert_from] = read[params.convert_to]
    return bytes(table)


def refuse_program(params: Params, read: Callable[[int], bytes]) -> None:
    """Read a whole program, as it would be sent, in constant memory. Raises ProgramError with what to do."""
    scrutiny = Scrutiny(params)
    while chunk := read(CHUNK_BYTES):
        why = scrutiny.look(chunk)
        if why:
            raise ProgramError(why)
    why = scrutiny.finish()
    if why:
        raise ProgramError(why)
