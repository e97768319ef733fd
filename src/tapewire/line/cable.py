"""Which jumpers a cable looks like, by what comes back of the control lines that this end drives. Pure.

Null modem is not one cable. A line that follows our own RTS or DTR is joined to it at this end, or at the far end by a
plug; either way it says nothing of the control.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tapewire.engine import SignalsIn, SignalsOut

__all__ = ["Wiring", "wiring_of"]

BOTH_OFF = SignalsOut(rts=False, dtr=False)
BOTH_ON = SignalsOut(rts=True, dtr=True)
RTS_ONLY = SignalsOut(rts=True, dtr=False)
DTR_ONLY = SignalsOut(rts=False, dtr=True)
DRIVEN = (BOTH_ON, BOTH_OFF, RTS_ONLY, DTR_ONLY, BOTH_ON)
"""What is driven to find out, in this order; it ends as a job begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """`follows`: for each line that comes in, what it follows: RTS, DTR, or nothing; `steady`: what it is then."""

    follows: Mapping[str, str | None]
    steady: Mapping[str, bool]

    @property
    def words(self) -> tuple[str, ...]:
        """For the person who made the cable, in the pin numbers of 25-pole connectors."""
        return tuple(self._word(name) for name in ("CTS", "DSR", "CD"))

    @property
    def cts_is_the_controls(self) -> bool:
        """A control can stop us by it."""
        return self.follows["CTS"] is None and self.steady["CTS"]

    def _word(self, name: str) -> str:
        match self.follows[name]:
            case None if self.steady[name]:
                return f"{name} is ON whatever we drive: the other end drives it"
            case None:
                return f"{name} is OFF: not connected, or the other end is off"
            case driver if (driver, name) == ("RTS", "CTS"):
                return "CTS follows our RTS: pins 4 and 5 are joined, so the control cannot stop us by it"
            case driver if driver == "DTR":
                return f"{name} follows our DTR: pins 20 and {6 if name == 'DSR' else 8} are joined"
            case driver:
                return f"{name} follows our {driver}: an unusual plug"


def wiring_of(seen: Mapping[SignalsOut, SignalsIn]) -> Wiring:
    """`seen` has what came in for each of DRIVEN, after it had time to settle."""
    follows: dict[str, str | None] = {}
    steady: dict[str, bool] = {}
    for name, of in (("CTS", _cts), ("DSR", _dsr), ("CD", _cd)):
        with_rts, with_dtr, off = of(seen[RTS_ONLY]), of(seen[DTR_ONLY]), of(seen[BOTH_OFF])
        follows[name] = "RTS" if with_rts and not off else "DTR" if with_dtr and not off else None
        steady[name] = of(seen[BOTH_ON])
    return Wiring(follows=follows, steady=steady)


def _cts(signals: SignalsIn) -> bool:
    return signals.cts


def _dsr(signals: SignalsIn) -> bool:
    return signals.dsr


def _cd(signals: SignalsIn) -> bool:
    return signals.cd
