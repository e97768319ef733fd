"""The contract of whoever listens to both ends of a line and holds what they say against the rules.

A listener hears words, as the readers of `ProtocolEntry.words` make them of a capture, and knows neither end's mind: it
says what can be said of a recording. The engines decide; this only judges afterwards.
"""

from __future__ import annotations

from typing import Protocol, TypeAlias

from tapewire.engine import Nanos
from tapewire.protocols.settings import End

__all__ = ["Listener", "Word", "is_unreadable"]

Word: TypeAlias = str | bytes
"""A named code or message, or a run of program bytes."""


class Listener(Protocol):
    """Listens to one line."""

    @property
    def evidence(self) -> int:
        """How much speaks for this protocol, less what speaks against it. 0: nothing either way."""
        ...

    def heard(self, who: End, word: Word, began: Nanos, ended: Nanos) -> list[str]:
        """`who` (HOST or CONTROL) said `word` between two moments. Returns what was against the rules."""
        ...

    def summary(self) -> list[str]:
        """Figures of all that was heard."""
        ...


def is_unreadable(word: Word) -> bool:
    """Readers put what is no message, for its sum or its form, in brackets."""
    return isinstance(word, str) and word.startswith("(")
