"""Reads captures: our own and those of any tool that writes link type RTAC serial, as pcapng or as classic pcap.

Either byte order, any resolution of time, several sections and interfaces; blocks of no interest are passed over. What
cannot be read is told with its place in the file, and reading goes on where it can. Nothing in a file makes this raise,
and nothing makes it hold more than one block of a bounded size.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, Protocol, TypeAlias

from tapewire.engine import MICROSECOND, SECOND, Nanos
from tapewire.line.captures.records import (
    BYTE_ORDER_MAGIC,
    ENHANCED_PACKET,
    IF_DESCRIPTION,
    IF_SPEED,
    IF_TSRESOL,
    INTERFACE_DESCRIPTION,
    LINK_TYPE,
    OPT_COMMENT,
    RTAC_HEADER,
    Happening,
    Lines,
    Origin,
    Record,
)

__all__ = ["CaptureItem", "Packet", "Problem", "Readable", "is_capture", "read_capture"]

MAX_BLOCK: Final = 1 << 20
"""A longer block is passed over: no serial line fills it."""

MAX_INTERFACES: Final = 1024
"""Of one section; packets of further ones are left out."""

MAX_TIME: Final[Nanos] = (1 << 63) - 1
"""A moment after the year 2262 is none."""

MAX_TEXT: Final = 1024
"""Characters of a name or a remark that are kept."""

MAX_COMMENT: Final = 1 << 16
"""Of the comment of an interface, which may hold a whole code table."""

SIMPLE_PACKET: Final = 3
OBSOLETE_PACKET: Final = 2
IF_TSOFFSET: Final = 14

SKIP: Final = 1 << 16

CLASSIC: Final = {
    b"\xa1\xb2\xc3\xd4": (">", MICROSECOND),
    b"\xd4\xc3\xb2\xa1": ("<", MICROSECOND),
    b"\xa1\xb2\x3c\x4d": (">", 1),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
}
"""First four bytes of a classic pcap: its byte order, and the unit of its fractions of a second."""

SECTION_MARK: Final = b"\x0a\x0d\x0d\x0a"


@dataclass(frozen=True, slots=True, kw_only=True)
class Packet:
    """A record, and where it comes from: `stream` counts the interfaces of the whole file."""

    stream: int
    section: int
    """Sections follow one another: once one is over nothing more comes of its streams."""
    origin: Origin
    record: Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Something of the file that could not be read, `offset` bytes from its beginning."""

    offset: int
    what: str


CaptureItem: TypeAlias = Packet | Problem


class Readable(Protocol):
    """A file, or what reads like one."""

    def read(self, size: int, /) -> bytes: ...


@dataclass(slots=True)
class _Interface:
    stream: int
    origin: Origin
    is_serial: bool
    ticks: int = SECOND // MICROSECOND
    """Of its clock, in a second."""
    began_s: int = 0
    told: bool = False

    def moment(self, high: int, low: int) -> Nanos:
        return _limited((high << 32 | low) * SECOND // self.ticks + self.began_s * SECOND)


@dataclass(slots=True)
class _Section:
    order: str
    interfaces: list[_Interface] = field(default_factory=list)


class _Ended(Exception):
    """Nothing more can be read."""


def is_capture(beginning: bytes) -> bool:
    """Whether a file that begins so is a capture at all."""
    return beginning[:4] == SECTION_MARK or beginning[:4] in CLASSIC


def read_capture(stream: Readable) -> Iterator[CaptureItem]:
    """Everything in `stream`, in the order of the file."""
    reader = _Reader(stream)
    beginning = reader.peek_four()
    if beginning in CLASSIC:
        yield from reader.classic(*CLASSIC[beginning])
    else:
        yield from reader.blocks()


class _Reader:
    def __init__(self, stream: Readable) -> None:
        self._stream = stream
        self._offset = 0
        self._begun = b""
        self._streams = self._sections = 0
        self._last: Nanos = 0

    def peek_four(self) -> bytes:
        self._begun = _whole(self._stream, 4)
        return self._begun

    # pcapng

    def blocks(self) -> Iterator[CaptureItem]:
        section: _Section | None = None
        while True:
            at = self._offset
            try:
                block = self._block(section)
                if block is None:
                    return
                kind, section, body = block
            except _Ended as end:
                yield Problem(offset=at, what=str(end))
                return
            if body is None:
                yield Problem(offset=at, what=f"a block longer than {MAX_BLOCK} bytes is passed over")
            else:
                yield from self._items(kind, section, body, at)

    def _block(self, section: _Section | None) -> tuple[int, _Section, bytes | None] | None:
        """The next block: its kind, the section it belongs to, and its body without the lengths around it."""
        head = self._read(8)
        if not head:
            return None
        self._require(head, 8)
        begun = b""
        if head[:4] == SECTION_MARK:
            begun = self._require(self._read(4), 4)
            section = _Section(_order_of(begun))
            self._sections += 1
        if section is None:
            raise _Ended("this is no capture: it does not begin with a section header")
        kind, length = struct.unpack(f"{section.order}II", head)
        if length % 4 or length < 12 + len(begun):
            raise _Ended(f"a block has the impossible length {length}; nothing behind it can be read")
        if length > MAX_BLOCK:
            self._skip(length - 8 - len(begun))
            return kind, section, None
        rest = self._require(self._read(length - 8 - len(begun)), length - 8 - len(begun))
        if rest[-4:] != head[4:]:
            raise _Ended("the two lengths of a block differ; nothing behind it can be read")
        return kind, section, begun + rest[:-4]

    def _items(self, kind: int, section: _Section, body: bytes, at: int) -> Iterator[CaptureItem]:
        try:
            match kind:
                case kind if kind == INTERFACE_DESCRIPTION:
                    yield from self._describe(section, body, at)
                case kind if kind == ENHANCED_PACKET:
                    number, high, low, captured, original = struct.unpack_from(f"{section.order}5I", body)
                    yield from self._packet(section, number, (high, low), body[20:], captured, original, at)
                case kind if kind == OBSOLETE_PACKET:
                    number, _, high, low, captured, original = struct.unpack_from(f"{section.order}HH4I", body)
                    yield from self._packet(section, number, (high, low), body[20:], captured, original, at)
                case kind if kind == SIMPLE_PACKET:
                    (original,) = struct.unpack_from(f"{section.order}I", body)
                    captured = min(original, len(body) - 4)
                    yield from self._packet(section, 0, None, body[4:], captured, original, at)
        except struct.error:
            yield Problem(offset=at, what="a block is too short for what it should hold")

    def _describe(self, section: _Section, body: bytes, at: int) -> Iterator[Problem]:
        (link_type,) = struct.unpack_from(f"{section.order}H", body)
        if len(section.interfaces) >= MAX_INTERFACES:
            yield Problem(offset=at, what=f"more than {MAX_INTERFACES} interfaces: this one is left out")
            return
        options = dict(_options(section.order, body[8:]))
        speed = options.get(IF_SPEED, b"")
        baud = int.from_bytes(speed, "little" if section.order == "<" else "big") if len(speed) == 8 else 0
        line = _text(options.get(IF_DESCRIPTION, b""))
        origin = Origin.loads(_text(options.get(OPT_COMMENT, b""), MAX_COMMENT), line=line, baud=min(baud, 4_000_000))
        interface = _Interface(self._streams, origin, link_type == LINK_TYPE)
        self._streams += 1
        resolution = options.get(IF_TSRESOL, b"")
        if len(resolution) == 1:
            power = resolution[0] & 0x7F
            interface.ticks = 2**power if resolution[0] & 0x80 else 10**power
        offset = options.get(IF_TSOFFSET, b"")
        if len(offset) == 8:
            (interface.began_s,) = struct.unpack(f"{section.order}q", offset)
        section.interfaces.append(interface)

    def _packet(
        self,
        section: _Section,
        number: int,
        moment: tuple[int, int] | None,
        rest: bytes,
        captured: int,
        original: int,
        at: int,
    ) -> Iterator[CaptureItem]:
        if number >= len(section.interfaces):
            yield Problem(offset=at, what=f"a packet of interface {number}, which is not described")
            return
        interface = section.interfaces[number]
        if not interface.is_serial:
            if not interface.told:
                interface.told = True
                yield Problem(offset=at, what=f"interface {number} is no RTAC serial line: its packets are left out")
            return
        if captured > len(rest):
            yield Problem(offset=at, what="a packet is longer than the block around it")
            return
        comment = dict(_options(section.order, rest[captured + -captured % 4 :])).get(OPT_COMMENT, b"")
        when = None if moment is None else interface.moment(*moment)
        yield from self._record(interface, when, rest[:captured], original, comment, at)

    # classic pcap

    def classic(self, order: str, fraction: Nanos) -> Iterator[CaptureItem]:
        head = self._read(24)
        if len(head) < 24:
            yield Problem(offset=0, what=_truncated(24 - len(head)))
            return
        (link_type,) = struct.unpack_from(f"{order}I", head, 20)
        interface = _Interface(0, Origin(), link_type & 0xFFFF == LINK_TYPE)
        if not interface.is_serial:
            yield Problem(offset=0, what="this is a capture of something else than an RTAC serial line")
            return
        while frame := self._read(16):
            at = self._offset - len(frame)
            if len(frame) < 16:
                yield Problem(offset=at, what=_truncated(16 - len(frame)))
                return
            seconds, rest, captured, original = struct.unpack(f"{order}4I", frame)
            if captured > MAX_BLOCK:
                yield Problem(offset=at, what=f"a packet of {captured} bytes; nothing behind it can be read")
                return
            data = self._read(captured)
            if len(data) < captured:
                yield Problem(offset=at, what=_truncated(captured - len(data)))
                return
            yield from self._record(interface, seconds * SECOND + rest * fraction, data, original, b"", at)

    # both

    def _record(
        self, interface: _Interface, when: Nanos | None, data: bytes, original: int, comment: bytes, at: int
    ) -> Iterator[CaptureItem]:
        if original > len(data):
            yield Problem(offset=at, what=f"{original - len(data)} characters of a packet were not captured")
        if len(data) < RTAC_HEADER.size:
            yield Problem(offset=at, what=f"a packet of {len(data)} bytes has no room for the header of its link type")
            return
        seconds, microseconds, what, lines, _ = RTAC_HEADER.unpack_from(data)
        if when is None:
            when = seconds * SECOND + microseconds * MICROSECOND
        if when < self._last:
            yield Problem(offset=at, what=f"time goes back by {(self._last - when) / SECOND:.6f} s")
        self._last = when
        if what not in _KNOWN:
            yield Problem(offset=at, what=f"a packet of the unknown event type {what:#04x} is left out")
            return
        characters = data[RTAC_HEADER.size :]
        record = Record(at=when, what=_KNOWN[what], lines=Lines(lines & 0x7F), data=characters, remark=_text(comment))
        yield Packet(stream=interface.stream, section=self._sections, origin=interface.origin, record=record)

    def _read(self, size: int) -> bytes:
        begun, self._begun = self._begun[:size], self._begun[size:]
        data = begun + _whole(self._stream, size - len(begun))
        self._offset += len(data)
        return data

    def _require(self, data: bytes, size: int) -> bytes:
        if len(data) < size:
            raise _Ended(_truncated(size - len(data)))
        return data

    def _skip(self, size: int) -> None:
        while size:
            passed = len(self._read(min(size, SKIP)))
            if not passed:
                raise _Ended(_truncated(size))
            size -= passed


_KNOWN: Final = {happening.value: happening for happening in Happening}


def _truncated(missing: int) -> str:
    return f"the file ends in the middle of a block, at least {missing} bytes of it are missing"


def _order_of(magic: bytes) -> str:
    for order in "<>":
        if struct.unpack(f"{order}I", magic)[0] == BYTE_ORDER_MAGIC:
            return order
    raise _Ended("a section header without its byte order; nothing behind it can be read")


def _options(order: str, data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 4 <= len(data):
        code, length = struct.unpack_from(f"{order}HH", data, at)
        if code == 0 or at + 4 + length > len(data):
            return
        yield code, data[at + 4 : at + 4 + length]
        at += 4 + length + -length % 4


def _text(raw: bytes, limit: int = MAX_TEXT) -> str:
    """Text of a file: no control character of it reaches a terminal."""
    text = raw[:limit].decode("utf-8", "replace")
    return "".join(character if character.isprintable() else "?" for character in text)


def _limited(moment: Nanos) -> Nanos:
    return max(0, min(moment, MAX_TIME))


def _whole(stream: Readable, size: int) -> bytes:
    """`size` bytes, fewer only at the end of the file: a pipe gives them in pieces."""
    data = stream.read(size) if size else b""
    while data and len(data) < size and (more := stream.read(size - len(data))):
        data += more
    return data or b""
