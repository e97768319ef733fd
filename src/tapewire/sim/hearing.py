"""What a host heard of how its transfer stands: that it began, that it stopped, and what was said against it.

For the rules of `verdicts.py`. A host that calls a job complete has heard its end, and nothing that contradicts it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from tapewire.engine import Nanos
from tapewire.line.transport import Fault, LineItem

__all__ = ["MOST_OBJECTIONS", "Hearing", "Objection", "What"]

MOST_OBJECTIONS: Final = 1000
"""A wrong baud rate damages every character; the first that belongs to a job is enough."""

_NEVER: Final[Nanos] = -1

_SYN: Final = 0x16


class What(Enum):
    """What speaks against a transfer."""

    RESET = "SYN"
    REFUSAL = "NAK or a cancel"
    DAMAGE = "a damaged character"


@dataclass(frozen=True, slots=True)
class Objection:
    """It came at `moment`, behind the beginning of the transfer and its last stop, _NEVER where there was none."""

    what: What
    moment: Nanos
    begun: Nanos
    stop: Nanos


@dataclass(slots=True)
class Hearing:
    """Of one host, over all its jobs. Empty sets hear nothing."""

    begins: frozenset[int] = frozenset()
    stops: frozenset[int] = frozenset()
    refuses: frozenset[int] = frozenset()
    begun: Nanos = _NEVER
    stop: Nanos = _NEVER
    objections: list[Objection] = field(default_factory=list)

    def hear(self, item: LineItem, now: Nanos) -> None:
        if isinstance(item, Fault):
            self._object(What.DAMAGE, now)
        elif isinstance(item, bytes) and not self._of_interest.isdisjoint(item):
            for byte in item:
                self._hear(byte, now)

    @property
    def _of_interest(self) -> frozenset[int]:
        return self.begins | self.stops | self.refuses

    def _hear(self, byte: int, now: Nanos) -> None:
        if byte in self.begins:
            self.begun = now
        elif byte in self.stops:
            self.stop = now
        elif byte in self.refuses:
            self._object(What.RESET if byte & 0x7F == _SYN else What.REFUSAL, now)

    def _object(self, what: What, now: Nanos) -> None:
        if len(self.objections) < MOST_OBJECTIONS:
            self.objections.append(Objection(what, now, self.begun, self.stop))
