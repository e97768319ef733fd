"""What a block means for the operation: program stop, optional stop, end of program, or an alarm.

M00 stops behind its block, M01 where the operator's switch is on, M02 and M30 end the program. A tape may hold several
programs, each with its end (8.2); the next one waits for CYCLE START. M30 rewinds a tape reader; there is nothing to
rewind behind a remote buffer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from typing import Final

from tapewire.codes import TABLES, DataCode
from tapewire.fanuc.block_check import BlockCheck, Complaint
from tapewire.protocols.settings import Switch

__all__ = ["After", "Judgement", "ProgramFlow"]

_COMMENT: Final = re.compile(rb"\([^)]*\)?")
_M_CODE: Final = re.compile(rb"(?<![A-Z])M[ \t]*0*(\d{1,4})(?![\d.])")


class After(Enum):
    """What comes behind a block."""

    GO_ON = "the next block"
    STOP = "a stop until CYCLE START (M00, M01)"
    END = "the end of the program (M02, M30)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """`complaint` None: the block can be executed."""

    after: After = After.GO_ON
    complaint: Complaint | None = None


class ProgramFlow:
    """Judges blocks as they come, in the code of the program. Without `check` every block can be executed."""

    def __init__(self, code: DataCode, *, check: BlockCheck | None = None) -> None:
        self._to_ascii = TABLES[code].to_ascii
        self._check = check
        self.optional_stop = Switch.OFF
        """The operator's switch."""

    def judge(self, block: bytes) -> Judgement:
        """`block` as taken from the buffer, with or without its EOB."""
        text = block.translate(self._to_ascii).partition(b"%")[0].strip(b"\r\n\x00\x7f ")
        complaint = self._check.complaint(text) if self._check is not None else None
        return Judgement(after=self._after(text), complaint=complaint)

    def is_blank(self, data: bytes) -> bool:
        """Nothing to execute: EOBs, EOR, blank tape."""
        return not data.translate(self._to_ascii).strip(b"\r\n\x00\x7f %")

    def _after(self, text: bytes) -> After:
        codes = {int(code) for code in _M_CODE.findall(_COMMENT.sub(b"", text))}
        if codes & {2, 30}:
            return After.END
        stops = 0 in codes or (1 in codes and self.optional_stop is Switch.ON)
        return After.STOP if stops else After.GO_ON
