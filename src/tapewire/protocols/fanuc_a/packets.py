"""The packets of expansion protocol A (B-63322EN-1 5.2, 5.3).

    No.  data        sum  end        host to control: a data packet, 256 n + 4 characters
    1    256 n       2    1

    code  No. or blank  sum  end     control to host: a monitor packet, 5 characters
    1     1             2    1

The sum of a data packet covers its number and its data, not its end code; the digits and the end code CR are ASCII
whatever 5000#2 and #3 say. What the sum of a monitor packet covers is not stated: both readings are understood.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final, TypeAlias

from tapewire.codes import with_even_parity
from tapewire.protocols.fanuc_a.messages import Coding, MessageReader, Reading, Unreadable, checksum

__all__ = [
    "END_NUMBER",
    "FIRST_NUMBER",
    "NUMBERS",
    "BadMonitor",
    "BadPacket",
    "HostReader",
    "Kind",
    "Monitor",
    "MonitorCode",
    "MonitorPacket",
    "MonitorSum",
    "Packet",
    "PacketReader",
    "data_bytes",
    "encode_monitor",
    "encode_packet",
    "next_number",
    "packet_bytes",
]

NUMBERS: Final = bytes(range(0x30, 0x3A))
"""Numbers of effective packets (5.2 2) a)): the next after 39h is 30h."""

FIRST_NUMBER: Final = 0x30

END_NUMBER: Final = 0xFF
"""5.2 2) b): its data counts, unless it answers CAN."""

_CR: Final = 0x0D
_FRAME: Final = 4
_MONITOR_BYTES: Final = 5
_BLANK: Final = 0x20


class Kind(StrEnum):
    """5.2 2)."""

    EFFECTIVE = "effective"
    END = "end"
    INVALID = "invalid"


def data_bytes(n: int) -> int:
    """NC data in one packet. `n` is 1, 2 or 4."""
    assert n in (1, 2, 4)
    return 256 * n


def packet_bytes(n: int) -> int:
    """A whole packet: 260, 516 or 1028."""
    return data_bytes(n) + _FRAME


def next_number(number: int) -> int:
    """The effective number after `number`."""
    assert number in NUMBERS
    return FIRST_NUMBER if number == NUMBERS[-1] else number + 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Packet:
    """A data packet whose sum and end code are right."""

    number: int
    data: bytes

    @property
    def kind(self) -> Kind:
        if self.number == END_NUMBER:
            return Kind.END
        return Kind.EFFECTIVE if self.number in NUMBERS else Kind.INVALID


@dataclass(frozen=True, slots=True, kw_only=True)
class BadPacket:
    """As many characters as a packet has, and they are none. `number` is what stood first."""

    number: int
    why: str


PacketReading: TypeAlias = Packet | BadPacket


def encode_packet(number: int, data: bytes, n: int) -> bytes:
    """`data` fills the packet: exactly 256 n bytes."""
    assert len(data) == data_bytes(n)
    body = bytes([number]) + data
    return body + checksum(body) + b"\r"


class PacketReader:
    """Finds data packets in what comes in, the same whatever the pieces it comes in.

    Packets have no start mark. After a bad one the reader looks for the next good one at every character, so that a
    character lost or gained does not spoil all that follows. As much as a packet holds and one more, which may have
    been gained, is another bad packet.
    """

    def __init__(self, n: int) -> None:
        self._length = packet_bytes(n)
        self._kept = bytearray()
        self._number = 0
        self._skipped = 0
        self._damaged = False

    @property
    def pending(self) -> int:
        """Characters of a packet that has begun and not ended."""
        return len(self._kept)

    def read(self, data: bytes, position: int = 0) -> tuple[int, PacketReading | None]:
        """Take characters from `position` to the end of one packet. Returns where to go on, and what was found."""
        while position < len(data):
            stop = min(len(data), position + self._length - len(self._kept))
            self._kept += data[position:stop]
            position = stop
            if len(self._kept) < self._length:
                break
            reading = self._finish()
            if reading is not None:
                return position, reading
        return position, None

    def damage(self) -> None:
        """A character was lost or damaged: the packet it belongs to is bad, whatever its sum says."""
        self._damaged = True

    def restart(self) -> int:
        """Forget what has begun: the next character is the first of a packet. Returns how many were forgotten."""
        forgotten = len(self._kept)
        self._kept.clear()
        self._skipped = 0
        self._damaged = False
        return forgotten

    def _finish(self) -> PacketReading | None:
        kept, why = self._kept, self._complaint()
        if why is None:
            packet = Packet(number=kept[0], data=bytes(kept[1:-3]))
            kept.clear()
            self._skipped = 0
            return packet
        if not self._skipped or self._skipped == self._length:
            self._number = kept[0]
        del kept[0]
        self._skipped += 1
        if self._skipped == self._length + 2:
            self._skipped = 1
        return BadPacket(number=self._number, why=why) if self._skipped == 1 else None

    def _complaint(self) -> str | None:
        kept = self._kept
        if self._damaged:
            self._damaged = False
            return "a damaged character"
        if kept[-1] != _CR:
            return "no end code at its place"
        if kept[-3:-1].upper() != checksum(kept[:-3]):
            return "checksum error"
        return None


class Monitor(Enum):
    """The monitor packets of 5.3; the value is the form without parity."""

    CAN = 0x18
    """Stop: send an end packet with dummy data."""
    NAK = 0x15
    """Repeat from this number on."""
    DC3 = 0x13
    """Interrupt."""
    DC1 = 0x11
    """Go on."""


class MonitorCode(StrEnum):
    """How a control writes monitor packets. 5.3 prints DC3 as 93h, which is ISO, beside NAK 15h, which is ASCII."""

    PRINTED = "printed"
    ASCII = "ascii"
    ISO = "iso"


class MonitorSum(StrEnum):
    """What the sum of a monitor packet covers: not stated in 5.3."""

    WITHOUT_END = "without-end"
    """Bytes 1 and 2, as in a data packet."""
    WITH_END = "with-end"
    """The end code too, as in a message of protocol A."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorPacket:
    """A monitor packet as received."""

    monitor: Monitor
    number: int | None = None
    """What a NAK names."""
    sum_covers: MonitorSum = MonitorSum.WITHOUT_END
    first_byte: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class BadMonitor:
    """Began like a monitor packet and is none."""

    raw: bytes


def encode_monitor(
    monitor: Monitor,
    *,
    number: int | None = None,
    code: MonitorCode = MonitorCode.PRINTED,
    sum_covers: MonitorSum = MonitorSum.WITHOUT_END,
) -> bytes:
    """The five characters. `number` belongs to NAK and to no other."""
    assert (number is not None) is (monitor is Monitor.NAK)
    iso = code is MonitorCode.ISO
    first = with_even_parity(monitor.value) if iso or (code, monitor) == _PRINTED_DC3 else monitor.value
    second = _BLANK if number is None else number
    end = _CR
    if iso:
        second, end = with_even_parity(second), with_even_parity(end)
    summed = bytes([first, second, end] if sum_covers is MonitorSum.WITH_END else [first, second])
    digits = checksum(summed)
    if iso:
        digits = bytes(with_even_parity(digit) for digit in digits)
    return bytes([first, second]) + digits + bytes([end])


_PRINTED_DC3: Final = (MonitorCode.PRINTED, Monitor.DC3)

_MONITORS: Final = {monitor.value: monitor for monitor in Monitor}


def _begins_monitor(byte: int) -> bool:
    return byte & 0x7F in _MONITORS


def _decode_monitor(raw: bytes) -> MonitorPacket | BadMonitor:
    """Bit 8 is looked at in the sum only."""
    plain = bytes(byte & 0x7F for byte in raw)
    if len(raw) != _MONITOR_BYTES or plain[-1] != _CR:
        return BadMonitor(raw=raw)
    monitor = _MONITORS[plain[0]]
    number = plain[1] if monitor is Monitor.NAK else None
    for covers, summed in ((MonitorSum.WITHOUT_END, raw[:2]), (MonitorSum.WITH_END, raw[:2] + raw[-1:])):
        if plain[2:4].upper() == checksum(summed):
            return MonitorPacket(monitor=monitor, number=number, sum_covers=covers, first_byte=raw[0])
    return BadMonitor(raw=raw)


class HostReader:
    """What the control says while packets may be on: monitor packets and messages, told apart by the first byte.

    With `monitors` False everything is read as messages.
    """

    def __init__(self, coding: Coding, *, longest: int) -> None:
        self.monitors = False
        self._messages = MessageReader(coding, longest=longest)
        self._monitor = bytearray()
        self._damaged = False

    @property
    def pending(self) -> int:
        """Characters of something that has begun and not ended."""
        return len(self._monitor) or self._messages.pending

    def read(self, data: bytes, position: int = 0) -> tuple[int, Reading | MonitorPacket | BadMonitor | None]:
        """Take characters from `position` to the end of one message or monitor packet."""
        if position >= len(data):
            return position, None
        if self._monitor or (self.monitors and not self._messages.pending and _begins_monitor(data[position])):
            return self._read_monitor(data, position)
        return self._messages.read(data, position)

    def damage(self) -> None:
        """A character was lost or damaged; what it belongs to cannot be read."""
        if self._monitor:
            self._damaged = True
        else:
            self._messages.damage()

    def break_off(self) -> Unreadable | BadMonitor | None:
        """Give up waiting for the rest; None when nothing has begun."""
        if self._monitor:
            raw = bytes(self._monitor)
            self._forget_monitor()
            return BadMonitor(raw=raw)
        return self._messages.break_off()

    def _read_monitor(self, data: bytes, position: int) -> tuple[int, MonitorPacket | BadMonitor | None]:
        for at in range(position, len(data)):
            self._monitor.append(data[at])
            if len(self._monitor) == _MONITOR_BYTES or data[at] & 0x7F == _CR:
                return at + 1, self._finish_monitor()
        return len(data), None

    def _finish_monitor(self) -> MonitorPacket | BadMonitor:
        raw, damaged = bytes(self._monitor), self._damaged
        self._forget_monitor()
        # Damage before it belongs to nothing that follows: a message would count as damaged however much later.
        self._messages.break_off()
        return BadMonitor(raw=raw) if damaged else _decode_monitor(raw)

    def _forget_monitor(self) -> None:
        self._monitor.clear()
        self._damaged = False
