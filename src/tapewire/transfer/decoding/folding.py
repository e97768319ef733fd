"""Long dialogues repeat themselves: the same exchange a thousand times. Folded, what is different can be seen."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from tapewire.engine import Nanos
from tapewire.line.captures.records import Side
from tapewire.transfer.decoding.entry import Entry, Kind

__all__ = ["Fold", "Row", "fold"]

LONGEST: Final = 8
"""Entries in an exchange that repeats."""

LEAST: Final = 5
"""Repetitions that are worth folding: the first and the last are shown, and three or more are not."""

_NUMBERS: Final = re.compile(r"[0-9A-F]*\d[0-9A-F]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """The same exchange, `times` over, left out between two moments; `count` program bytes went by in it."""

    times: int
    what: tuple[str, ...]
    at: Nanos
    until: Nanos
    count: int


Row: TypeAlias = Entry | Fold

_Shape: TypeAlias = tuple[Kind, Side | None, str]


def fold(entries: Sequence[Entry]) -> Iterator[Row]:
    """`entries`, with the middle of every repetition left out. What is against the rules is always there."""
    shapes = [_shape(entry, place) for place, entry in enumerate(entries)]
    at = 0
    while at < len(entries):
        length, times = _repetition(shapes, at)
        if times < LEAST:
            yield entries[at]
            at += 1
            continue
        yield from entries[at : at + length]
        yield _left_out(entries[at + length : at + length * (times - 1)], length)
        at += length * times
        yield from entries[at - length : at]


def _shape(entry: Entry, place: int) -> _Shape:
    """What makes two entries the same: numbers and program do not count."""
    match entry.kind:
        case Kind.PROGRAM:
            return entry.kind, entry.side, ""
        case Kind.SAID:
            return entry.kind, entry.side, _NUMBERS.sub("#", entry.text)
        case Kind.SIGNALS:
            return entry.kind, entry.side, entry.text
        case _:
            return entry.kind, entry.side, f"the only one at {place}"


def _repetition(shapes: Sequence[_Shape], at: int) -> tuple[int, int]:
    """The exchange that begins at `at` and leaves most out: its length, and how often it stands there."""
    best = (1, 1)
    for length in range(1, LONGEST + 1):
        times = 1
        pattern = shapes[at : at + length]
        while shapes[at + length * times : at + length * (times + 1)] == pattern:
            times += 1
        if times >= LEAST and length * (times - 2) > best[0] * (best[1] - 2):
            best = (length, times)
    return best


def _left_out(entries: Sequence[Entry], length: int) -> Fold:
    return Fold(
        times=len(entries) // length,
        what=tuple(_brief(entry) for entry in entries[:length]),
        at=entries[0].at,
        until=entries[-1].until,
        count=sum(entry.count for entry in entries),
    )


def _brief(entry: Entry) -> str:
    return "program" if entry.kind is Kind.PROGRAM else entry.text.split(" ")[0]
