"""Holds a recorded dialogue of protocol B or its expansion against chapters 6 and 7."""

from __future__ import annotations

from tapewire.engine import Nanos
from tapewire.protocols.fanuc_b.messages import ControlCode, Params
from tapewire.protocols.listening import Word
from tapewire.protocols.settings import End

__all__ = ["Listener"]

_CODES = frozenset(code.name for code in ControlCode)


class Listener:
    """Was every DC3 obeyed, and did anybody speak out of turn.

    A capture may begin in the middle, so that nothing is held against characters before the first code.
    """

    def __init__(self, params: Params) -> None:
        self._allowed = params.allowed_overrun
        self._after: int | None = None
        """Program characters since the control's DC3; None while it lets the host send."""
        self._paused: int | None = None
        """Punched characters since the host's DC3."""
        self._punching = False
        self._stray = False
        self._stops = self._most_after = self._most_paused = 0
        self.evidence = 0

    def heard(self, who: End, word: Word, began: Nanos, ended: Nanos) -> list[str]:
        if isinstance(word, bytes):
            return self._data(who, len(word))
        if word not in _CODES:
            return []
        return self._from_control(word) if who is End.CONTROL else self._from_host(word)

    def _data(self, who: End, count: int) -> list[str]:
        if who is End.HOST:
            return self._fed(count)
        if self._punching:
            if self._paused is not None:
                self._paused += count
                self._most_paused = max(self._most_paused, self._paused)
            return []
        self.evidence -= min(count, 10)
        if self._stray:
            return []
        self._stray = True
        return ["the control said characters that are no codes, without DC2 before them (6.1.1)"]

    def _fed(self, count: int) -> list[str]:
        if self._after is None:
            return []
        before, self._after = self._after, self._after + count
        self._most_after = max(self._most_after, self._after)
        if before <= self._allowed < self._after:
            return [f"more than {self._allowed} characters after DC3: the control's buffer overruns (6.3, 7)"]
        return []

    def _from_control(self, code: str) -> list[str]:
        self._stray = False
        match code:
            case "DC1":
                self.evidence += 1
                self._after = None
            case "DC3":
                self.evidence += 1
                self._after, self._stops = 0, self._stops + 1
            case "DC2":
                self._punching, self._paused = True, None
            case "DC4":
                self.evidence += 2 if self._punching else -1
                wrong = [] if self._punching else ["DC4, and no DC2 before it (6.1.1)"]
                self._punching = False
                return wrong
            case _:
                self._punching = False
        return []

    def _from_host(self, code: str) -> list[str]:
        match code:
            case "DC3":
                self._paused = 0
            case "DC1" | "DC2":
                self._paused = None
        return []

    def summary(self) -> list[str]:
        said = []
        if self._stops:
            stops = "once" if self._stops == 1 else f"{self._stops} times"
            said.append(f"DC3 {stops}, at most {self._most_after} characters after it; {self._allowed} are allowed")
        if self._most_paused:
            said.append(f"at most {self._most_paused} characters of the punch-out came after the host's DC3")
        return said
