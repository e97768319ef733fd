"""Control lines that do not show what the other end drives."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tapewire.engine import SignalsIn
from tapewire.line.faults.chance import Stream
from tapewire.line.faults.plan import HoldSignal, Level, Nth, Signal
from tapewire.line.faults.when import NEVER, skip

__all__ = ["SignalFaults"]

GONE = SignalsIn(cts=False, dsr=False, cd=False)


@dataclass(slots=True)
class _OnEdges:
    fault: HoldSignal
    draws: Stream
    due: int


class SignalFaults:
    """The control lines of one wire as its receiving end sees them. Until the other end is first heard of: nothing."""

    __slots__ = ("_edges", "_held", "_raw", "_rules", "_shown", "gone")

    def __init__(self) -> None:
        self.gone = 0
        """Cables pulled now whose absence shows."""
        self._raw: SignalsIn | None = None
        self._shown: SignalsIn | None = None
        self._rules: list[_OnEdges] = []
        self._edges = dict.fromkeys(Signal, 0)
        self._held: dict[Signal, list[bool]] = {signal: [] for signal in Signal}

    def add(self, fault: HoldSignal, draws: Stream) -> None:
        """A fault that hits edges."""
        self._rules.append(_OnEdges(fault, draws, skip(fault.when, draws, 1)))

    def calm(self) -> None:
        """No edge meets a fault any more."""
        self._rules.clear()

    def drive(self, driven: SignalsIn) -> list[tuple[HoldSignal, bool, int]]:
        """The other end drives `driven`. Returns the faults that an edge of it meets, with the level and its number."""
        before, self._raw = self._raw, driven
        met = []
        for signal in Signal if before is not None and self._rules else ():
            was = _level(before, signal)
            if was is not _level(driven, signal):
                met += self._edge(signal, was)
        return met

    def _edge(self, signal: Signal, was: bool) -> list[tuple[HoldSignal, bool, int]]:
        self._edges[signal] += 1
        number = self._edges[signal]
        met = []
        for rule in self._rules:
            if rule.fault.signal is signal and rule.due == number - 1:
                once = isinstance(rule.fault.when, Nth)
                rule.due = NEVER if once else number + skip(rule.fault.when, rule.draws, 1)
                met.append((rule.fault, self.level_held(rule.fault, was), number))
        return met

    def level_held(self, fault: HoldSignal, was: bool | None = None) -> bool:
        """What the line shows while it is held; `was` is what it showed before an edge."""
        match fault.level:
            case Level.STAYS:
                return _level(self._raw, fault.signal) if was is None else was
            case level:
                return level is Level.ON

    def hold(self, signal: Signal, level: bool) -> None:
        self._held[signal].append(level)

    def let_go(self, signal: Signal, level: bool) -> None:
        self._held[signal].remove(level)

    def change(self) -> list[SignalsIn]:
        """What the receiving end sees now, if it is not what it saw last."""
        if self._raw is None:
            return []
        shown = GONE if self.gone else self._raw
        for signal, levels in self._held.items():
            if levels:
                shown = replace(shown, **{signal.lower(): levels[-1]})
        if shown == self._shown:
            return []
        self._shown = shown
        return [shown]


def _level(signals: SignalsIn | None, signal: Signal) -> bool:
    match signal:
        case _ if signals is None:
            return True
        case Signal.CTS:
            return signals.cts
        case Signal.DSR:
            return signals.dsr
        case Signal.CD:
            return signals.cd
