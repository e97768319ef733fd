"""One line of a dialogue, apart from the reading of one: a command that shows none loads no protocol for it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tapewire.engine import Nanos
from tapewire.line.captures.records import Side

__all__ = ["Entry", "Kind"]


class Kind(StrEnum):
    """What an entry of a dialogue is."""

    SAID = "said"
    """A code or a message by its name."""
    PROGRAM = "program"
    """A run of program bytes."""
    SIGNALS = "signals"
    FAULT = "fault"
    """A character arrived damaged."""
    VIOLATION = "violation"
    """Against the rules of the protocol or of the line."""
    NOTE = "note"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One line of a dialogue. `side` said it, None where nobody did; `count` program bytes came `at` to `until`."""

    kind: Kind
    at: Nanos
    until: Nanos
    text: str
    side: Side | None = None
    count: int = 0
