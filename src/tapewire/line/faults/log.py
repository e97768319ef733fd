"""What was injected into a line."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from tapewire.engine import Nanos
from tapewire.line.faults.plan import Wire
from tapewire.line.transport import Fault

__all__ = ["FaultLog", "Injected"]

KEPT_ENTRIES: Final = 1000
"""Faults kept one by one; older ones are only counted."""


@dataclass(frozen=True, slots=True)
class Injected:
    """One fault as it happened. `place` counts from 1 what the fault hits: characters, edges, stop requests; 0 is a
    fault that hit none of them but came at its moment.
    """

    moment: Nanos
    kind: str
    wire: Wire
    place: int
    sent: bytes = b""
    """What it hit,"""
    arrived: tuple[bytes | Fault, ...] = ()
    """and what came of it."""
    late: Nanos = 0
    """So much later it arrives."""

    def __str__(self) -> str:
        return f"{self.kind} {self.wire}" + (f", number {self.place}" if self.place else "")


@dataclass(slots=True)
class FaultLog:
    """All faults by kind, and the last ones singly."""

    counts: Counter[str] = field(default_factory=Counter)
    entries: deque[Injected] = field(default_factory=lambda: deque(maxlen=KEPT_ENTRIES))
    on_fault: Callable[[Injected], None] | None = None
    """Told of every fault as it happens."""

    def note(
        self,
        moment: Nanos,
        kind: str,
        wire: Wire,
        place: int,
        sent: bytes = b"",
        arrived: tuple[bytes | Fault, ...] = (),
        *,
        late: Nanos = 0,
    ) -> None:
        entry = Injected(moment, kind, wire, place, sent, arrived, late)
        self.counts[kind] += 1
        self.entries.append(entry)
        self.tell(entry)

    def tell(self, entry: Injected) -> None:
        """What follows from a fault that is noted already: characters in a pulled cable."""
        if self.on_fault is not None:
            self.on_fault(entry)
