"""What a receiver reads of a character that was damaged on its way: a wrong byte, a marked one, or none at all."""

from __future__ import annotations

from enum import Enum

from tapewire.engine import LineFault
from tapewire.line.faults.chance import Stream
from tapewire.line.transport import Fault

__all__ = ["DATA_BITS", "Parity", "flipped", "garbled", "misreadings", "truncated"]

DATA_BITS = 8


class Parity(Enum):
    """Whether the receiver checks even parity (8E1) or has none (8N2)."""

    CHECKED = "checked"
    NONE = "none"


def flipped(byte: int, bits: int, stream: Stream, parity: Parity) -> bytes | Fault:
    """`byte` with `bits` different bits turned, the parity bit among those that can be hit where there is one."""
    places = list(range(DATA_BITS + (parity is Parity.CHECKED)))
    for _ in range(min(bits, len(places))):
        byte ^= 1 << places.pop(stream.randrange(len(places)))
    if parity is Parity.CHECKED and bits % 2:
        return Fault(fault=LineFault.PARITY, byte=byte & 0xFF)
    return bytes((byte & 0xFF,))


def garbled(stream: Stream, parity: Parity) -> bytes | Fault:
    """A character out of nothing: any bits, one in four without a stop bit, and half of the rest with wrong parity."""
    byte, chance = stream.randrange(256), stream.randrange(8)
    if chance < 2:
        return Fault(fault=LineFault.FRAMING, byte=byte)
    if parity is Parity.CHECKED and chance < 5:
        return Fault(fault=LineFault.PARITY, byte=byte)
    return bytes((byte,))


def truncated(byte: int, bits: int, parity: Parity) -> bytes | Fault | None:
    """What is read of a character whose sender lost its power after `bits` of its bits: the wire falls back to idle,
    which reads as ones. None when not even the start bit was sent.
    """
    if bits < 1:
        return None
    sent = _frame(byte, parity)
    return _read([*sent[:bits], *[1] * (len(sent) - bits)], parity)


def misreadings(percent: float, parity: Parity) -> tuple[bytes | Fault, ...]:
    """What a receiver whose clock is `percent` faster reads of each of the 256 characters, each sent alone.

    It samples bit i in what it takes for its middle, (i + 1/2) of its own bit times after the edge of the start bit.
    """
    return tuple(_misread(byte, 1 + percent / 100, parity) for byte in range(256))


def _misread(byte: int, speed: float, parity: Parity) -> bytes | Fault:
    sent = _frame(byte, parity)
    return _read([_level(sent, (place + 0.5) / speed) for place in range(len(sent))], parity)


def _frame(byte: int, parity: Parity) -> list[int]:
    """The bits of a character in their order: start, data, parity or the first of two stop bits, stop."""
    check = byte.bit_count() & 1 if parity is Parity.CHECKED else 1
    return [0, *(byte >> place & 1 for place in range(DATA_BITS)), check, 1]


def _read(bits: list[int], parity: Parity) -> bytes | Fault:
    byte = sum(bit << place for place, bit in enumerate(bits[1 : 1 + DATA_BITS]))
    if not bits[-1] or (parity is Parity.NONE and not bits[-2]):
        return Fault(fault=LineFault.FRAMING, byte=byte)
    if parity is Parity.CHECKED and bits[-2] != byte.bit_count() & 1:
        return Fault(fault=LineFault.PARITY, byte=byte)
    return bytes((byte,))


def _level(sent: list[int], bit_times: float) -> int:
    return sent[int(bit_times)] if bit_times < len(sent) else 1
