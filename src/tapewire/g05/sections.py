"""Where binary input operation begins and ends inside an NC program (B-63322EN-1 9.1, 9.3).

A block that is `G05` alone begins a section; its records follow the EOB at once and a record of zeros ends it. Records
have no mark of their own: whoever does not know their length finds it by their check bytes.
"""

from __future__ import annotations

import re
from typing import Final

from tapewire.errors import ProgramError
from tapewire.g05.layout import BITS_PER_CHARACTER, MOST_AXES, UnitTime

__all__ = [
    "BinaryTally",
    "BlockWatch",
    "ExitFinder",
    "Section",
    "SectionScan",
    "find_g05",
    "find_g05_with_point",
    "g05_block",
    "has_odd_byte",
    "record_lengths",
]

RECORD_LENGTHS: Final = tuple(range(3, 2 * MOST_AXES + 6, 2))
"""2N + 1 and 2N + 5 bytes for 1 to 24 axes."""

DETECTION_BYTES: Final = 1 << 16
"""So much of a section is looked at to find the length of its records: over a thousand of the longest."""

LONGEST_BLOCK: Final = 4096
"""A block that is G05 alone, with a number and comments, is never longer."""

_BLANKS: Final = b" \t\r"
_SEVEN_BITS: Final = bytes(byte & 0x7F for byte in range(0x100))
_TEXT_AFTER: Final = frozenset(b"\t\n\r %()/") | frozenset(range(0x20, 0x7F))
# Binary data follows the block G05 EOB (chapter 9); block number, block skip and comments do not change that.
_END: Final = re.compile(rb"[Gg][ \t]*(?:0[ \t]*)*5[ \t]*(?:\([^()\n]*\)[ \t]*)*\r?(?:\n|\Z)")
_POINT: Final = re.compile(rb"[Gg][ \t]*(?:0[ \t]*)*5[ \t]*\.[ \t0]*(?:\([^()\n]*\)[ \t]*)*\r?(?:\n|\Z)")
_BEGINNING: Final = re.compile(rb"(?:/[1-9]?)?(?:[Nn][0-9]+)?")
_COMMENT: Final = re.compile(rb"\([^()\n]*\)")


def find_g05(text: bytes, start: int = 0) -> int | None:
    """The offset, from `start` on, of the G of the first block of ASCII text that is G05 alone: binary follows it."""
    found = g05_block(text, start)
    return None if found is None else found[0]


def g05_block(text: bytes, start: int = 0) -> tuple[int, int] | None:
    """(offset of the G, offset behind the EOB, if it has one) of the first block of ASCII text that is G05 alone."""
    return _alone(_END, text, start)


def find_g05_with_point(text: bytes) -> int | None:
    """The offset of the G of the first block that is `G05.` alone, which is not the block G05.

    The manual writes G05 without a point, and a number with one is for addresses of lengths and times: what a control
    makes of it, G05 or an alarm, is nowhere stated.
    """
    found = _alone(_POINT, text, 0)
    return None if found is None else found[0]


def _alone(pattern: re.Pattern[bytes], text: bytes, start: int) -> tuple[int, int] | None:
    for match in pattern.finditer(text, start):
        begin = text.rfind(b"\n", 0, match.start()) + 1
        if match.end() - begin > LONGEST_BLOCK:
            continue
        before = text[begin : match.start()]
        if _BEGINNING.fullmatch(_COMMENT.sub(b"", before).translate(None, _BLANKS)):
            return match.start(), match.end()
    return None


class BlockWatch:
    """Finds the block G05 in text that comes in pieces, cut anywhere."""

    def __init__(self) -> None:
        self._block = b""

    def feed(self, text: bytes) -> int | None:
        """The offset in `text` behind the EOB of the first block G05, or None."""
        known = len(self._block)
        joined = self._block + text
        found = g05_block(joined)
        if found is not None and joined[found[1] - 1 : found[1]] == b"\n":
            self._block = b""
            return found[1] - known
        self._block = joined[joined.rfind(b"\n") + 1 :][: LONGEST_BLOCK + 1]
        return None


class ExitFinder:
    """Finds the exit record of a section whose records have a known length. Looks at nothing else."""

    def __init__(self, record_bytes: int) -> None:
        self._exit = bytes(record_bytes)
        self._partial = b""

    def feed(self, data: bytes) -> int | None:
        """The offset in `data` behind the exit record, or None while it has not come."""
        size, known = len(self._exit), len(self._partial)
        joined = self._partial + data
        at = joined.find(self._exit)
        while at >= 0:
            aligned = -(-at // size) * size
            if joined.startswith(self._exit, aligned):
                return aligned + size - known
            at = joined.find(self._exit, aligned + 1)
        self._partial = joined[len(joined) - len(joined) % size :]
        return None


def record_lengths(data: bytes, *, whole: bool, to_ascii: bytes = _SEVEN_BITS) -> list[int]:
    """Every length that the records at the beginning of `data` can have, by their check bytes.

    A section without records has none. `whole` says that nothing follows `data`: the exit record must be in it.
    `to_ascii` translates the text around the records.
    """
    return [length for length in RECORD_LENGTHS if _fits(data, length, whole, to_ascii)]


def _fits(data: bytes, length: int, whole: bool, to_ascii: bytes) -> bool:
    end = ExitFinder(length).feed(data)
    if end is None and (whole or len(data) < length):
        return False
    records = data[: len(data) // length * length] if end is None else data[: end - length]
    if not records or _first_wrong_sum(records, length) is not None:
        return False
    return end is None or end == len(data) or to_ascii[data[end]] & 0x7F in _TEXT_AFTER


def _first_wrong_sum(records: bytes, length: int) -> int | None:
    """The index of the first record whose last byte is not the sum of the others."""
    import numpy as np

    rows = np.frombuffer(records, np.uint8).reshape(-1, length)
    wrong = np.add.reduce(rows[:, :-1], axis=1, dtype=np.uint8) != rows[:, -1]
    return int(np.argmax(wrong)) if wrong.any() else None


class Section:
    """One section as it passes by: its records are checked, and it knows where it ends.

    Without `record_bytes` the length of the records is found; what comes in is held back until then. `to_ascii`
    translates the text around the records.
    """

    def __init__(self, record_bytes: int | None = None, to_ascii: bytes = _SEVEN_BITS) -> None:
        self.record_bytes = record_bytes
        self._to_ascii = to_ascii
        self.record_count = 0
        """Records without the exit record."""
        self.byte_count = 0
        """With the exit record, once it has ended."""
        self.is_special = True
        """No byte is odd, as in the special format."""
        self.ended = False
        self._held = b""
        self._partial = b""
        self._exit: ExitFinder | None = None

    def feed(self, data: bytes) -> tuple[bytes, bytes]:
        """(what of the section can go on, what stands behind it). Raises ProgramError naming the record."""
        if self._exit is None:
            self._held += data
            if len(self._held) < DETECTION_BYTES and self.record_bytes is None:
                return b"", b""
            data, self._held = self._held, b""
            self._exit = ExitFinder(self._settled(data, whole=False))
        end = self._exit.feed(data)
        mine, rest = (data, b"") if end is None else (data[:end], data[end:])
        self.ended = end is not None
        self._check(mine)
        return mine, rest

    def finish(self) -> tuple[bytes, bytes]:
        """Nothing more comes. As `feed`; raises ProgramError also where the exit record is missing."""
        mine = rest = b""
        if self._held:
            data, self._held = self._held, b""
            self._exit = ExitFinder(self._settled(data, whole=True))
            mine, rest = self.feed(data)
        if not self.ended:
            raise ProgramError(
                f"the file ends after {self.record_count:,} records without the exit record (zeros): it is cut off, or "
                "its records have another length"
            )
        return mine, rest

    def _settled(self, data: bytes, *, whole: bool) -> int:
        if self.record_bytes is None:
            lengths = record_lengths(data, whole=whole, to_ascii=self._to_ascii)
            if len(lengths) != 1:
                raise ProgramError(_undecided(lengths))
            self.record_bytes = lengths[0]
        return self.record_bytes

    def _check(self, data: bytes) -> None:
        """Check bytes of what has just come in; a record may come in pieces."""
        assert self.record_bytes is not None
        size = self.record_bytes
        joined = self._partial + data
        whole = len(joined) // size * size
        self._partial = joined[whole:]
        self.byte_count += len(data)
        if not whole:
            return
        wrong = _first_wrong_sum(joined[:whole], size)
        if wrong is not None:
            record = joined[wrong * size : (wrong + 1) * size]
            raise ProgramError(
                f"record {self.record_count + wrong + 1:,} of {size} bytes has the check byte {record[-1]:02X}h, but "
                f"the sum of its other bytes is {sum(record[:-1]) & 0xFF:02X}h: the control would raise SR890"
            )
        self.record_count += whole // size - self.ended
        self.is_special = self.is_special and not has_odd_byte(joined[:whole])


class SectionScan:
    """Follows a program as it will be sent, and knows what kind of sections it holds; sound ones, that is."""

    def __init__(self, to_ascii: bytes, record_bytes: int | None) -> None:
        self.general_bytes: int | None = None
        """Length of the records of the first section in the general format."""
        self._to_ascii = to_ascii
        self._record_bytes = record_bytes
        self._watch = BlockWatch()
        self._section: Section | None = None
        self._lost = False

    @property
    def inside(self) -> bool:
        """A section has begun and not ended."""
        return self._section is not None

    def feed(self, data: bytes) -> None:
        """The next bytes; empty at the end of the program."""
        at_end = not data
        while (data or at_end) and not self._lost:
            if self._section is None:
                begins = self._watch.feed(data.translate(self._to_ascii))
                if begins is None:
                    return
                self._section, data = Section(self._record_bytes, self._to_ascii), data[begins:]
            if data or at_end:
                data = self._follow(self._section, data)
                at_end = at_end and self._section is None and bool(data)

    def _follow(self, section: Section, data: bytes) -> bytes:
        """What stands behind the section."""
        try:
            _, rest = section.feed(data) if data else section.finish()
        except ProgramError:
            self._lost = True
            return b""
        if section.ended:
            self._section = None
        if section.record_bytes is not None and not section.is_special and self.general_bytes is None:
            self.general_bytes = section.record_bytes
        return rest


class BinaryTally:
    """The sections of a program in one sentence for each length of records."""

    def __init__(self) -> None:
        self._kinds: dict[int, list[int]] = {}

    def add(self, section: Section) -> None:
        assert section.record_bytes is not None
        kind = self._kinds.setdefault(section.record_bytes, [0, 0, 0])
        for index, count in enumerate((1, section.record_count, not section.is_special)):
            kind[index] += count

    def notes(self) -> tuple[str, ...]:
        return tuple(self._note(size, *kind) for size, kind in sorted(self._kinds.items()))

    @staticmethod
    def _note(size: int, sections: int, records: int, general: int) -> str:
        bits = size * BITS_PER_CHARACTER * 1000
        rates = ", ".join(f"{-(-bits // time):,} at {time.value}" for time in UnitTime)
        return (
            f"binary input operation (G05): {sections:,} section{'s' * (sections != 1)}, {records:,} records of {size} "
            f"bytes in {'general' if general else 'special'} format, sent as they are; the line must keep up, in baud "
            f"by unit time in ms: {rates}"
        )


_ODD: Final = bytes(range(1, 256, 2))


def has_odd_byte(data: bytes) -> bool:
    return len(data.translate(None, _ODD)) != len(data)


def _undecided(lengths: list[int]) -> str:
    if not lengths:
        return (
            "no length of records (3 to 53 bytes) fits its check bytes up to a record of zeros: it is damaged or cut "
            "off, or no binary data follows at all"
        )
    named = ", ".join(str(length) for length in lengths)
    return f"its records may be of {named} bytes: it is too short to tell; say how they are made (g05=AXES)"
