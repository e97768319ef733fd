"""A whole capture, stream by stream, as it is read: nothing is held but what a stream needs to be recognised."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

from tapewire.engine import Nanos
from tapewire.line.captures.reader import Packet, Problem, Readable, read_capture
from tapewire.line.captures.records import Origin
from tapewire.transfer.decoding.entry import Entry
from tapewire.transfer.decoding.recognise import Asked, Stream

__all__ = ["Began", "Decoded", "Figures", "Told", "decode"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Began:
    """A stream: what it says of itself, how it is read, and its first moment, from which times are counted."""

    stream: int
    at: Nanos
    origin: Origin
    known: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """One entry of the dialogue on a stream that began at `began`."""

    stream: int
    began: Nanos
    entry: Entry


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What a stream comes to."""

    stream: int
    lines: tuple[str, ...]
    characters: int
    violations: int


Decoded: TypeAlias = Began | Told | Figures | Problem


def decode(file: Readable, asked: Asked) -> Iterator[Decoded]:
    """Everything in `file`, in words. Raises nothing but what reading the file raises."""
    streams: dict[int, _Reading] = {}
    section = 0
    for item in read_capture(file):
        if isinstance(item, Problem):
            yield item
            continue
        if item.section != section:
            yield from _finish(streams)
            section = item.section
        if item.stream not in streams:
            streams[item.stream] = _Reading(item, asked)
        yield from streams[item.stream].feed(item)
    yield from _finish(streams)


def _finish(streams: dict[int, _Reading]) -> Iterator[Decoded]:
    for reading in streams.values():
        yield from reading.finish()
    streams.clear()


class _Reading:
    """One stream on its way from records to entries."""

    def __init__(self, first: Packet, asked: Asked) -> None:
        self._number = first.stream
        self._at = first.record.at
        self._stream = Stream(asked, first.origin)
        self._announced = False

    def feed(self, packet: Packet) -> Iterator[Decoded]:
        yield from self._tell(self._stream.feed(packet.record))

    def finish(self) -> Iterator[Decoded]:
        yield from self._tell(self._stream.finish())
        dialogue = self._stream.dialogue
        yield Figures(
            stream=self._number,
            lines=tuple(dialogue.summary()),
            characters=sum(dialogue.characters.values()),
            violations=dialogue.violations,
        )

    def _tell(self, entries: Iterator[Entry]) -> Iterator[Decoded]:
        for entry in entries:
            yield from self._announce()
            yield Told(stream=self._number, began=self._at, entry=entry)
        yield from self._announce()

    def _announce(self) -> Iterator[Decoded]:
        if not self._announced and self._stream.known is not None:
            self._announced = True
            yield Began(stream=self._number, at=self._at, origin=self._stream.origin, known=self._stream.known)
