"""Frames that came otherwise than they were sent and still pass their own check: what sums of few bits let through.

Written from the manuals, not with the engines' readers: an engine that forgets to check must not be its own excuse.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import Final

__all__ = [
    "LAST_CODES",
    "cancelled_sums",
    "ends_record",
    "ends_with_nak",
    "ends_with_stop",
    "forged_records",
    "is_monitor",
    "last_codes",
    "rest_fits",
    "right_packet",
    "says_nak",
    "text_of",
]

_HEX: Final = {bytes((digit,)): value for value, digit in enumerate(b"0123456789ABCDEF")}
_LRC_XOR_BITS: Final = 0x7F

MOST_BEFORE: Final = 4
"""Characters in front of a record that are none of it: every place where one may begin fits by chance once in 128."""


def cancelled_sums(sent: Sequence[bytes], brought: bytes, n: int) -> bool:
    """Some message of protocol A, or data packet of 256 `n` bytes, was brought that was not sent, with a right sum.

    No message of one piece of `sent` goes on in the next.
    """
    return _messages(brought, sent) or (n > 0 and _packets(brought, b"".join(sent), 256 * n + 4))


def _messages(brought: bytes, sent: Sequence[bytes]) -> bool:
    """4.1: the sum of all from the command to the end code, in two digits before it; ISO puts parity into bit 8."""
    for end in (b"\x0d", b"\x8d", b"\x03"):
        known = {text for piece in sent for text in piece.split(end)}
        for text in brought.split(end):
            if text not in known and len(text) >= 5 and _digits(text[:2]) == sum(text[2:] + end) & 0xFF:
                return True
    return False


def _packets(brought: bytes, sent: bytes, length: int) -> bool:
    """5.2 3): the sum of number and data, in two digits before the end code."""
    sums = [0, *accumulate(brought)]
    for end in range(length - 1, len(brought)):
        if brought[end] != 0x0D:
            continue
        first = end - length + 1
        right = (sums[end - 2] - sums[first]) & 0xFF == _digits(brought[end - 2 : end])
        if right and brought[first : end + 1] not in sent:
            return True
    return False


def right_packet(packet: bytes, length: int) -> bool:
    """A data packet of `length` characters, its sum and its end code right (5.2)."""
    right = len(packet) == length and packet[-1] == 0x0D
    return right and _digits(packet[-3:-1]) == sum(packet[:-3]) & 0xFF


def _digits(digits: bytes) -> int | None:
    """ASCII or ISO."""
    values = [_HEX.get(bytes((digit & 0x7F,))) for digit in digits]
    high, low = values if len(values) == 2 else (None, None)
    return None if high is None or low is None else high * 16 + low


def forged_records(sent: bytes, brought: bytes, lrc: str, ends: frozenset[int]) -> bool:
    """Some record of DNC LINK was brought that was not sent, its check character right (2.2). `ends` end a record."""
    sent, brought = bytes(byte & 0x7F for byte in sent), bytes(byte & 0x7F for byte in brought)
    places = [at for at, byte in enumerate(brought[:-1]) if byte in ends]
    starts = [start for begins in (0, *(end + 2 for end in places)) for start in _behind_codes(brought, begins)]
    for end in places:
        for start in starts:
            right = 0 <= end - start <= 256 and _check(brought[start:end], brought[end], lrc) == brought[end + 1]
            if right and brought[start : end + 2] not in sent:
                return True
    return False


def _behind_codes(brought: bytes, begins: int) -> Iterator[int]:
    """Where a record may begin that stands behind another, or first of all: at once, or behind what is no text. Those
    are the answers to DC2, the XOFF that closes a name (`closing_dc3`), and blank tape.
    """
    for start in range(begins, begins + MOST_BEFORE + 1):
        yield start
        if text_of(brought[start : start + 1]):
            return


def ends_record(sent: bytes, ends: frozenset[int]) -> bool:
    """Its last character is the check character of a record (2.2), or an end code right behind that."""
    return any(sent[at] & 0x7F in ends for at in (-2, -3) if len(sent) >= -at)


def rest_fits(brought: bytes, taken: bytes, program: bytes, wrong: int, lrc: str, ends: frozenset[int]) -> bool:
    """Where `taken` differs from `program`, at byte `wrong` of their texts, a record that was brought should stand, and
    only the rest of it does: the control gave up its beginning after a silence (2.2.4).
    """
    brought = bytes(byte & 0x7F for byte in brought)
    places = [at for at, byte in enumerate(brought[:-1]) if byte in ends]
    for start, end in zip([-2, *places], places, strict=False):
        record = text_of(brought[start + 2 : end])
        for begins in range(start + 3, end):
            rest = text_of(brought[begins:end])
            stands = range(max(0, wrong - len(rest)), wrong + 1)
            if len(rest) == len(record) or _check(brought[begins:end], brought[end], lrc) != brought[end + 1]:
                continue
            if any(program.startswith(record, at) and taken.startswith(rest, at) for at in stands):
                return True
    return False


def _check(text: bytes, end: int, lrc: str) -> int:
    covered = text + bytes((end,)) if "_etb" in lrc else text
    if lrc.startswith("xor7"):
        value = 0
        for byte in covered:
            value ^= byte
    else:
        value = sum(covered)
    if lrc.endswith("_inv"):
        value = ~value
    return (-value if lrc.startswith("neg7") else value) & _LRC_XOR_BITS


LAST_CODES: Final = 3
"""What both ends do at the moment hangs on so many of the last codes: a name, its end, the request behind it."""

_NO_TEXT: Final = bytes(
    byte for byte in range(256) if byte & 0x7F == 0x7F or (byte & 0x7F < 0x20 and byte & 0x7F not in b"\t\n\r")
)
_SEVEN_BITS: Final = bytes(byte & 0x7F for byte in range(256))


def text_of(data: bytes) -> bytes:
    """What two ends may compare of a program: without control codes and parity bits, blanks and rubouts."""
    return data.translate(_SEVEN_BITS, _NO_TEXT)


def last_codes(data: bytes, codes: frozenset[int]) -> bytes:
    """The last of `codes` in `data`, at most three, without their parity bits."""
    found = data.translate(None, bytes(byte for byte in range(256) if byte not in codes))
    return found[-LAST_CODES:].translate(_SEVEN_BITS)


def ends_with_stop(brought: bytes) -> bool:
    """The last monitor packet of expansion A is DC3 (5.3), whatever noise came behind it."""
    packets = (brought[at : at + 5] for at in range(len(brought) - 5, -1, -1))
    return next((packet[0] & 0x7F == 0x13 for packet in packets if is_monitor(packet)), False)


_CAN: Final = 0x18


def ends_with_nak(sent: bytes, number: int) -> bool:
    """The last monitor packet of expansion A but CAN is NAK, for the packets that bear `number`, 0 to 9 (5.3)."""
    packets = (sent[at : at + 5] for at in range(len(sent) - 5, -1, -1))
    last = next((packet for packet in packets if is_monitor(packet) and packet[0] & 0x7F != _CAN), b"")
    return bool(last) and last[0] & 0x7F == 0x15 and last[1] & 0x7F == 0x30 + number


def says_nak(sent: bytes, number: int) -> bool:
    """Some monitor packet of expansion A is NAK for the packets that bear `number`, 0 to 9 (5.3)."""
    packets = (sent[at : at + 5] for at in range(len(sent) - 4))
    named = (packet for packet in packets if packet[0] & 0x7F == 0x15 and packet[1] & 0x7F == 0x30 + number)
    return any(is_monitor(packet) for packet in named)


def is_monitor(packet: bytes) -> bool:
    """5.3: a code, No. or filler, the sum in two digits, the end code. What the sum covers is not stated."""
    named = packet[0] & 0x7F in b"\x11\x13\x15\x18" and packet[4] & 0x7F == 0x0D
    return named and _digits(packet[2:4]) in (sum(packet[:2]) & 0xFF, (sum(packet[:2]) + packet[4]) & 0xFF)
