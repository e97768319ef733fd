"""What a person has allowed the host to give out and to take in: one program, or a library by number.

Numbers are digits that the control sent, or None where it sent none. They are looked up, never made into a path here.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from tapewire.engine import Sink, Source
from tapewire.protocols.bridgeport.messages import Mode

__all__ = ["Arming", "Library", "OneProgram", "OneSink", "Policy", "Shelf"]


class Library(Protocol):
    """Programs by number."""

    def find(self, number: str | None, mode: Mode | None) -> Source | None:
        """The program called `number` (one to six digits), from its first byte; None where there is none.

        `number` is None when the control asks without a name, `mode` too where it gave no letter. Never blocks.
        """
        ...


class Shelf(Protocol):
    """Where programs that the control sends are put."""

    def place(self, number: str | None) -> Sink | None:
        """A sink for the program called `number`; None: it is not wanted. Never blocks."""
        ...


class OneProgram:
    """A library of one program, served once, whatever number is asked for."""

    def __init__(self, source: Source) -> None:
        self._source: Source | None = source

    def find(self, number: str | None, mode: Mode | None) -> Source | None:
        source, self._source = self._source, None
        return source


class OneSink:
    """A shelf for one program, whatever its number."""

    def __init__(self, sink: Sink) -> None:
        self._sink: Sink | None = sink

    def place(self, number: str | None) -> Sink | None:
        sink, self._sink = self._sink, None
        return sink


class Policy(Enum):
    """For how long something is armed."""

    ONCE = "for one transfer"
    STANDING = "until it is taken back"


@dataclass(frozen=True, slots=True, kw_only=True)
class Arming:
    """What may be transferred."""

    policy: Policy
    library: Library | None = None
    shelf: Shelf | None = None
