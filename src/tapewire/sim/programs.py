"""Programs for a campaign: of any size, no block like another, so that a lost, doubled or moved one shows where."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Final

from tapewire.codes import DataCode, encode

__all__ = ["LEAST_BYTES", "MOST_BYTES", "program", "program_with_cr_lf"]

LEAST_BYTES: Final = 100
MOST_BYTES: Final = 64 * 1024


@cache
def _blocks(eob: bytes) -> bytes:
    """Half as much again as the longest program, so that a program can begin at many places of it."""
    lines, length = [], 0
    for n in itertools.count(1):
        line = b"N%d G0%d X%d.%03d Y-%d.%03d F%d" % (n, n % 3 > 0, n % 97, n % 1000, n % 83, n * 7 % 1000, 400 + n % 90)
        lines.append(line + eob)
        length += len(lines[-1])
        if length > MOST_BYTES * 3 // 2:
            return b"".join(lines)
    raise AssertionError


@cache
def _encoded(eob: bytes, code: DataCode) -> bytes:
    return encode(_blocks(eob), code)


def program(size: int, place: int, code: DataCode) -> bytes:
    """About `size` bytes of program in `code` for a FANUC control, beginning with block `place` of a long text."""
    return _cut(b"%\nO0300\nG90 G01 F500\n", size, place, b"M30\n%", b"\n", code)


def program_with_cr_lf(size: int, place: int) -> bytes:
    """The same for a Bridgeport control, which has CR LF and no tape codes."""
    return _cut(b"", size, place, b"M2\r\n", b"\r\n", DataCode.ASCII)


def _cut(head: bytes, size: int, place: int, tail: bytes, eob: bytes, code: DataCode) -> bytes:
    text, end = _encoded(eob, code), encode(eob, code)
    start = text.find(end, place % (MOST_BYTES // 2)) + len(end)
    length = max(size - len(head) - len(tail), 1)
    stop = text.rfind(end, start, start + length) + len(end)
    return encode(head, code) + (text[start:stop] if stop > start else b"") + encode(tail, code)
