"""What of a program these protocols cannot carry, seen before a line is opened (4.1, 5.2, 8.2)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tapewire.errors import ProgramError
from tapewire.fanuc.tape import TapeScanner
from tapewire.protocols.fanuc_a.params import Params

__all__ = ["refuse_program"]

CHUNK_BYTES: Final = 1 << 16


def refuse_program(params: Params, read: Callable[[int], bytes]) -> None:
    """Read a whole program, as it would be sent, in constant memory. Raises ProgramError with what to do.

    In protocol A the end code of the messages cannot stand in the data. Expansion A has packets of a fixed length: a
    program without EOR that does not fill its last one would end in padding that the control takes for program.
    """
    end, tape = params.coding.end_byte, TapeScanner(params.data)
    offset = 0
    while chunk := read(CHUNK_BYTES):
        at = -1 if params.packet_n else chunk.find(end)
        if at >= 0:
            raise ProgramError(
                f"byte {offset + at + 1:,} is {end[0]:02X}h, the end code of every message: remove it, or change the "
                "end code (5000#3) or the code (5000#2) of control and host"
            )
        tape.feed(chunk)
        offset += len(chunk)
    if params.packet_n and not tape.ended and offset % (256 * params.packet_n):
        raise ProgramError(
            f"no EOR, and {offset:,} bytes do not fill packets of {256 * params.packet_n}: the control would take the "
            "padding of the last one for program; end it with EOR, or use protocol A or B"
        )
