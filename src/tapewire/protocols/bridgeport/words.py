"""What both ends say, in words, for transcripts: codes by their names, runs of text, a check character as `LRC=33`."""

from __future__ import annotations

from typing import Final

from tapewire.codes import CR, LF, TAB, name_of
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS, SPACE
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.records import record_end_codes

__all__ = ["Words"]

_TEXT: Final = frozenset((*range(SPACE, SEVEN_BITS), CR, LF, TAB))
_NAMES: Final = {byte: name_of(byte).split()[0] for byte in range(SEVEN_BITS + 1) if byte not in _TEXT} | {0x17: "ETB"}


class Words:
    """Reads both directions of one line. Parity is not shown.

    Only the host sends records, so only there a check character is known by its place.
    """

    def __init__(self, params: Params) -> None:
        self._end_codes = record_end_codes(params, params.dnc_end)
        self._lrc_next = False

    def host(self, data: bytes) -> list[str | bytes]:
        """What the host sent."""
        words: list[str | bytes] = []
        for byte in data:
            character = byte & SEVEN_BITS
            if self._lrc_next:
                words.append(f"LRC={character:02X}")
                self._lrc_next = False
            else:
                _append(words, character)
                self._lrc_next = character in self._end_codes
        return words

    def control(self, data: bytes) -> list[str | bytes]:
        """What the control sent."""
        words: list[str | bytes] = []
        for byte in data:
            _append(words, byte & SEVEN_BITS)
        return words


def _append(words: list[str | bytes], character: int) -> None:
    if character not in _TEXT:
        words.append(_NAMES[character])
    elif words and isinstance(words[-1], bytes):
        words[-1] += bytes([character])
    else:
        words.append(bytes([character]))
