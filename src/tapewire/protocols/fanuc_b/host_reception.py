"""The host's side of a punch-out (B-63322EN-1 6.1.1 2), 6.1.2, 6.2): what is program and what is control code."""

from __future__ import annotations

import re
from typing import Final

from tapewire.codes import DataCode
from tapewire.engine import LineFault, Sink
from tapewire.protocols.fanuc_b.host_law import FEED
from tapewire.protocols.fanuc_b.messages import ControlCode, Params, PauseBy, code_of, encode

__all__ = ["Pause", "Reception"]

_CONTROL_CODES: Final = {
    DataCode.ASCII: re.compile(rb"[\x11-\x16\x93\x95\x96]"),
    DataCode.ISO: re.compile(rb"[\x11-\x16\x93\x95\x96]"),
    DataCode.EIA: re.compile(rb"[\x11\x12\x14\x93\x95\x96]"),
    DataCode.BINARY: re.compile(rb"\x14"),
}
"""What is a control code between DC2 and DC4. In EIA 13h, 15h and 16h are the digits 3, 5 and 6; every other code has
an even number of holes, which no EIA character has.
"""

_MAY_BE_DC3: Final = {DataCode.EIA: b"\x13", DataCode.BINARY: b"\x13\x93"}
"""Program where anything follows it; where nothing does, perhaps the DC3 of a punch-out that is cut short (6.4 (1))."""

_EXPECTED: Final = frozenset({ControlCode.DC3, ControlCode.DC4, ControlCode.SYN, ControlCode.NAK})


class Pause:
    """The host's hold on a punch-out (6.1.1 2) (3), (4), 6.1.2 (4))."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self.wanted = False
        self.told = False

    @property
    def by_code(self) -> bool:
        return self._params.pause is PauseBy.DC3

    @property
    def cs_off(self) -> bool:
        return self.wanted and not self.by_code

    @property
    def code_due(self) -> bytes:
        """What is still to be said of it."""
        if not self.by_code or self.wanted is self.told:
            return b""
        return encode(ControlCode.DC3 if self.wanted else self._params.resume_code, self._params.code)


class Reception:
    """One punch-out on its way into a sink."""

    def __init__(self, data: DataCode, sink: Sink) -> None:
        self._control_codes = _CONTROL_CODES[data]
        self._may_be_dc3 = _MAY_BE_DC3.get(data, b"")
        self._binary = data is DataCode.BINARY
        self._sink = sink
        self._last = b""
        self._undecided = b""
        self._another = False
        """DC2 has announced another punch-out behind this one."""
        self.stored = 0
        self.damage = ""
        """The first thing that makes the stored program doubtful; empty while there is none."""

    def read(self, data: bytes, position: int) -> tuple[int, ControlCode | None]:
        """Store what is program from `position` on. Returns where to go on, and the control code found before it."""
        found = self._control_codes.search(data, position)
        end = found.start() if found else len(data)
        self._store(data[position:end])
        if found is None:
            return end, None
        self._store_last()
        code = code_of(data[end])
        assert code is not None
        if code not in _EXPECTED:
            self._mark(f"{code.name} inside the punch-out")
        if self._binary:
            self._undecided = data[end : end + 1]
        return end + 1, code

    def still_program(self, byte: int) -> bool:
        """`byte` came after a DC4. In binary data 14h was the end only if nothing, or one SYN or NAK, follows it;
        otherwise it was data, is stored, and `byte` is to be read as program again.
        """
        if not self._binary:
            return False
        if len(self._undecided) == 1 and code_of(byte) in (ControlCode.SYN, ControlCode.NAK):
            self._undecided += bytes([byte])
            return False
        self._store(self._undecided)
        self._undecided = b""
        return True

    def behind_dc4(self, byte: int) -> None:
        """A text goes on behind its DC4: that was none, or something is missing in front of it."""
        code = code_of(byte)
        self._another |= code is ControlCode.DC2
        is_text = not self._binary and code in (None, ControlCode.DC4) and byte not in FEED
        if is_text and not self._another:
            self._mark("more came behind DC4,")

    @property
    def undecided_notice(self) -> ControlCode | None:
        """The SYN or NAK after the DC4 of binary data, once it is known that nothing follows."""
        return code_of(self._undecided[1]) if len(self._undecided) > 1 else None

    def line_fault(self, fault: LineFault, byte: int | None) -> None:
        """A damaged character is stored as it was read, so that the place can be found, and the program is doubtful."""
        self._mark(str(fault))
        if byte is not None:
            self._store(bytes([byte]))

    def _store(self, data: bytes) -> None:
        """All but a last character that may be DC3: it counts as program when another follows."""
        if not data:
            return
        self._store_last()
        if data[-1] in self._may_be_dc3:
            data, self._last = data[:-1], data[-1:]
        self._write(data)

    def _store_last(self) -> None:
        last, self._last = self._last, b""
        self._write(last)

    def _write(self, data: bytes) -> None:
        if data:
            self._sink.write(data)
            self.stored += len(data)

    def _mark(self, what: str) -> None:
        self.damage = self.damage or f"{what} at byte {self.stored + 1}"
