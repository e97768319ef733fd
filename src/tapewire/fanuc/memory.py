"""The remote buffer's memory as the control's memory display shows it (B-63322EN-1/01 12.1.2, 12.2).

    4n810500   long    read pointer
    4n810504   long    write pointer
    4n810508   8 KB    buffer, to 4n812507
    4n823100   long    write pointer of the send buffer
    4n823104   256     send buffer, to 4n823203: what the remote buffer said last
    4n80E014 to 4n80E025   nine words, what to note down at a system error

n is the logical slot number of the board, in hexadecimal. Its DRAM is 4n800000 to 4n9FFFFF (the manual prints a digit
too many); an address outside brings a system error. Not stated, and taken so: pointers are offsets from the beginning
of their buffer, as the rule for the latest character sent says of one of them; longs are stored high byte first. All
8192 bytes full would look empty. From 4n80E014 to 4n80E024 there are nine words of two bytes: so "the nine words prior
to 4n80E024" are read.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Final, Protocol, runtime_checkable

from tapewire.errors import UsageError

__all__ = ["BUFFER_BYTES", "SEND_BYTES", "Address", "BoardMemory", "BufferImage", "Cause", "pointers_say"]

BUFFER_BYTES: Final = 0x2000
SEND_BYTES: Final = 0x100
DRAM_FIRST: Final = 0x800000
DRAM_LAST: Final = 0x9FFFFF
HIGHEST_SLOT: Final = 0xF


class Address(Enum):
    """Behind 4n."""

    READ_POINTER = 0x810500
    WRITE_POINTER = 0x810504
    BUFFER = 0x810508
    SEND_POINTER = 0x823100
    SEND_BUFFER = 0x823104
    ERROR_RECORD = 0x80E014


@runtime_checkable
class BufferImage(Protocol):
    """The receive buffer of an engine. Counts are of one operation, and begin again with the next."""

    @property
    def received(self) -> int:
        """Bytes that have come in."""
        ...

    @property
    def taken(self) -> int:
        """Bytes that the control has taken out."""
        ...

    @property
    def held(self) -> bytes:
        """What is in it now."""
        ...


class Cause(Enum):
    """Where the cause lies when an operation does not go on (12.2 no. 1, step 2)."""

    HOST_OR_BUFFER = "the buffer is empty: the cause is in the remote buffer or in the host"
    CONTROL = "there is data in the buffer: the cause is in the NC"


def pointers_say(read_pointer: int, write_pointer: int) -> Cause:
    """12.2 no. 1, step 2."""
    return Cause.HOST_OR_BUFFER if read_pointer == write_pointer else Cause.CONTROL


class BoardMemory:
    """A live view: `buffer` is asked for with every question, and `sent` is told what leaves.

    What the control has taken stays in the buffer until it is overwritten, as far as this view has seen it.
    """

    def __init__(self, buffer: Callable[[], BufferImage], slot: int = 9) -> None:
        if not 0 <= slot <= HIGHEST_SLOT:
            raise UsageError(f"slot {slot}: a logical slot number has one hexadecimal digit, 0 to F")
        self.slot = slot
        self._buffer = buffer
        self._ring = bytearray(BUFFER_BYTES)
        self._send_ring = bytearray(SEND_BYTES)
        self._sent = 0

    def sent(self, data: bytes) -> None:
        """The remote buffer has said `data`."""
        self._sent += max(0, len(data) - SEND_BYTES)
        for byte in data[-SEND_BYTES:]:
            self._send_ring[self._sent % SEND_BYTES] = byte
            self._sent += 1

    @property
    def read_pointer(self) -> int:
        return self._buffer().taken % BUFFER_BYTES

    @property
    def write_pointer(self) -> int:
        return self._buffer().received % BUFFER_BYTES

    @property
    def send_pointer(self) -> int:
        """1 to 256 once something was sent: 4n823104 + (pointer - 1) holds the latest character."""
        return (self._sent - 1) % SEND_BYTES + 1 if self._sent else 0

    @property
    def latest_sent(self) -> bytes:
        """The last characters sent, at most 256, the oldest first."""
        at = self.send_pointer
        ring = bytes(self._send_ring[at:] + self._send_ring[:at])
        return ring[-min(self._sent, SEND_BYTES) :] if self._sent else b""

    def refresh(self) -> None:
        """Put what the buffer holds where it lies."""
        buffer = self._buffer()
        held = buffer.held[-BUFFER_BYTES:]
        begin = (buffer.received - len(held)) % BUFFER_BYTES
        first = held[: BUFFER_BYTES - begin]
        self._ring[begin : begin + len(first)] = first
        self._ring[: len(held) - len(first)] = held[len(first) :]

    def byte(self, address: int) -> int:
        """The byte at a whole address, as 49810508h. Raises UsageError for one outside the board's DRAM."""
        offset = self._offset(address)
        self.refresh()
        for base, content in self._map():
            if base <= offset < base + len(content):
                return content[offset - base]
        return 0

    def long(self, address: int) -> int:
        """Four bytes as a number."""
        return int.from_bytes(bytes(self.byte(address + place) for place in range(4)), "big")

    def address(self, of: Address) -> int:
        return 0x4 << 28 | self.slot << 24 | of.value

    def dump(self, of: Address, count: int) -> str:
        """`count` bytes as the memory display shows them: 16 a line, with their address."""
        begin = self.address(of)
        lines = []
        for at in range(0, count, 16):
            data = [self.byte(begin + at + place) for place in range(min(16, count - at))]
            lines.append(f"{begin + at:08X} " + " ".join(f"{byte:02X}" for byte in data))
        return "\n".join(lines)

    def _map(self) -> tuple[tuple[int, bytes | bytearray], ...]:
        return (
            (Address.READ_POINTER.value, self.read_pointer.to_bytes(4, "big")),
            (Address.WRITE_POINTER.value, self.write_pointer.to_bytes(4, "big")),
            (Address.BUFFER.value, self._ring),
            (Address.SEND_POINTER.value, self.send_pointer.to_bytes(4, "big")),
            (Address.SEND_BUFFER.value, self._send_ring),
        )

    def _offset(self, address: int) -> int:
        offset = address & 0xFFFFFF
        if address >> 24 != 0x40 | self.slot or not DRAM_FIRST <= offset <= DRAM_LAST:
            first, last = 0x4 << 28 | self.slot << 24 | DRAM_FIRST, 0x4 << 28 | self.slot << 24 | DRAM_LAST
            raise UsageError(
                f"address {address:08X}: the DRAM of the remote buffer in slot {self.slot:X} is {first:08X} to "
                f"{last:08X}; elsewhere the control raises a system error"
            )
        return offset
