"""G05 sections read out of a program: in pieces, and with records whose making is found where nobody has told it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from tapewire.errors import ProgramError
from tapewire.g05.layout import Layout, RecordFormat
from tapewire.g05.records import Records, decode
from tapewire.g05.sections import RECORD_LENGTHS, BlockWatch, ExitFinder, record_lengths

__all__ = ["DECISION_BYTES", "Pieces", "found_layout", "sections_of"]

CHUNK_BYTES: Final = 1 << 18
DECISION_BYTES: Final = 1 << 16
"""So much of a section tells the length of its records, if nobody has."""
LIKELY: Final = 0.6
"""Right check bytes among all, at which a length is taken for that of damaged records; by chance it is 1 in 256."""


class Pieces:
    """A file in pieces, of which some can be given back. Knows the line and the offset of what comes next."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self._pending = b""
        self.line = 1
        self.offset = 0

    def piece(self) -> bytes:
        data, self._pending = self._pending or self._read(CHUNK_BYTES), b""
        self.line += data.count(b"\n")
        self.offset += len(data)
        return data

    def at_least(self, count: int) -> bytes:
        """Less only at the end of the file."""
        data = bytearray()
        while len(data) < count and (piece := self.piece()):
            data += piece
        return bytes(data)

    def give_back(self, data: bytes) -> None:
        self._pending = data + self._pending
        self.line -= data.count(b"\n")
        self.offset -= len(data)


def sections_of(read: Callable[[int], bytes], layout: Layout | None) -> Iterator[tuple[int, Iterator[Records]]]:
    """(number from 1, records in pieces) of every section. Take all of one before the next one is asked for.

    Raises ProgramError for a program without a section, and for the first record that is not sound.
    """
    source, watch, number = Pieces(read), BlockWatch(), 0
    while data := source.piece():
        begins = watch.feed(data)
        if begins is not None:
            number += 1
            source.give_back(data[begins:])
            yield number, _records(source, layout)
    if not number:
        raise ProgramError("there is no G05 section: no block that is G05 alone")


def _records(source: Pieces, layout: Layout | None) -> Iterator[Records]:
    line, done, partial = source.line - 1, 0, b""
    if layout is None:
        head = source.at_least(DECISION_BYTES)
        layout, _ = found_layout(head, len(head) < DECISION_BYTES, line)
        source.give_back(head)
    size, finder = layout.record_bytes, ExitFinder(layout.record_bytes)
    while data := source.piece():
        end = finder.feed(data)
        joined = partial + (data if end is None else data[:end])
        whole = len(joined) // size * size
        partial = joined[whole:]
        records = joined[:whole] if end is None else joined[: whole - size]
        if records:
            try:
                yield decode(records, layout, first_record=done + 1)
            except ProgramError as error:
                raise ProgramError(f"line {line}, G05 section: {error}", line=line) from None
            done += len(records) // size
        if end is not None:
            source.give_back(data[end:])
            return
    raise ProgramError(
        f"line {line}: the G05 section has no exit record (zeros) after {done:,} records of {size} bytes: it is cut "
        "off, or its records are made otherwise",
        line=line,
    )


def found_layout(data: bytes, whole: bool, line: int) -> tuple[Layout, str]:
    """The layout by the check bytes. Raises ProgramError where no length is even likely."""
    lengths = record_lengths(data, whole=whole)
    how = "by its check bytes"
    if len(lengths) > 1:
        named = ", ".join(map(str, lengths))
        raise ProgramError(f"line {line}: the records may be of {named} bytes; say how they are made with --axis")
    if not lengths:
        shares = {length: _right_share(data, length) for length in RECORD_LENGTHS}
        best = max(shares, key=lambda length: shares[length])
        if data.startswith(b"\r\r") and record_lengths(data[2:], whole=whole):
            raise ProgramError(
                f"line {line}: two CR behind the EOB of G05 are read as data, and sound records follow them: end the "
                "block with a single LF"
            )
        if shares[best] < LIKELY:
            raise ProgramError(
                f"line {line}: what follows G05 is no binary input operation: with no length of records (3 to 53 "
                "bytes) are most check bytes right; say how they are made with --axis to see each fault"
            )
        lengths, how = [best], f"because {shares[best]:.0%} of its check bytes are right so"
    length = lengths[0]
    axes = (length - 1) // 2
    records = data[: len(data) // length * length]
    end = ExitFinder(length).feed(records)
    rows = np.frombuffer(records[: end or len(records)], np.uint8).reshape(-1, length)
    odd = (rows[:, :-1] & 1).any(axis=1)
    right = rows[:, :-1].sum(axis=1, dtype=np.uint8) == rows[:, -1]
    # A damaged record of the special format has an odd byte too, but hardly the right sum.
    form = RecordFormat.GENERAL if (odd & right).sum() > (odd & ~right).sum() else RecordFormat.SPECIAL
    if axes > 24:
        raise ProgramError(f"line {line}: records of {length} bytes carry auxiliary functions: use --axis and --aux")
    taken = f"{length} bytes a record, {how}; taken for {axes} axes without auxiliary functions"
    return Layout(axis_count=axes, format=form), taken


def _right_share(data: bytes, length: int) -> float:
    end = ExitFinder(length).feed(data)
    rows = np.frombuffer(data[: (len(data) if end is None else end) // length * length], np.uint8).reshape(-1, length)
    if len(rows) < 2:
        return 0.0
    return float((rows[:, :-1].sum(axis=1, dtype=np.uint8) == rows[:, -1]).mean())
