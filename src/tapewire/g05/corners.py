"""How fast each corner may be taken (look-ahead, first half).

The motion is smoothed by two averages of T each. What goes in is a speed along straight moves; what comes out has

    acceleration  a(t) = [v(t) - v(t-T)] / T, averaged over T
    jerk          j(t) = [v(t) - 2 v(t-T) + v(t-2T)] / T^2

so both are bounded by how much the velocity of an axis changes, corners and all, within any span of T: by M = min(a T,
j T^2), unless two such changes one after the other are opposite, which what looks at the result finds. Of M the share
`TANGENTIAL` belongs to speeding up and slowing down, the rest to corners. A corner also pulls the smoothed path
inwards, by |dv| T / 6 for one alone, and by |du| A T^2 / 24 more where it is braked into and sped up out of. Corners
closer together than the averages are counted together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.limits import Floats, Planning
from tapewire.g05.path import Path

__all__ = ["Bounds", "corner_speeds"]


TANGENTIAL: Final = 0.5
"""Of the change of velocity within T; with half of it long moves and corners suffer alike."""

INWARDS: Final = 0.8
"""Two corners just outside of each other's span pull a quarter more than one: together they keep the tolerance."""

HALVINGS: Final = 6
"""Of the logarithm of what is left between a speed that is slow enough and one that is not: to a few percent."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the smoothing makes of the limits of the machine."""

    span_s: float
    """T and one unit of time: the span within which changes of velocity are counted together."""
    average_s: float
    change: Floats
    """M by axis, units a second."""
    tolerance: float

    @classmethod
    def of(cls, planning: Planning, tolerance: float) -> Bounds:
        machine, average_s = planning.machine, planning.ticks * planning.tick_s
        change = np.minimum(machine.acceleration * average_s, machine.jerk * average_s**2)
        return cls(average_s + planning.tick_s, average_s, change, tolerance)

    def accelerations(self, path: Path) -> Floats:
        """Along each move, so that no axis changes its velocity by more than its share within T, and so that braking
        into a corner takes no more than half of what the tolerance leaves to it.
        """
        share = TANGENTIAL * self.change / self.span_s
        with np.errstate(divide="ignore"):
            along: Floats = (share / np.abs(path.directions)).min(axis=1)
            gentle = 12 * INWARDS * self.tolerance / (_turning(path) * self.average_s**2)
        np.minimum(along[:-1], gentle, out=along[:-1])
        np.minimum(along[1:], gentle, out=along[1:])
        return along


def _turning(path: Path) -> Floats:
    """By how much the direction changes at each corner: 0 straight on, 2 straight back."""
    turns = np.diff(path.directions, axis=0)
    turning: Floats = np.sqrt(np.einsum("ij,ij->i", turns, turns))
    return turning


def corner_speeds(path: Path, bounds: Bounds, fastest: Floats, accelerations: Floats) -> Floats:
    """Highest speed at the beginning of each move but the first, (moves - 1,), not above those of the moves beside it.

    A corner near an end of `path` is judged by what is in it: give the neighbourhood too.
    """
    turns = np.abs(np.diff(path.directions, axis=0))
    limit = np.minimum(fastest[:-1], fastest[1:])
    changing = (turns / ((1 - TANGENTIAL) * bounds.change)).max(axis=1)
    turning = _turning(path)
    braked = turning * np.maximum(accelerations[:-1], accelerations[1:]) * bounds.average_s**2 / 24
    pulling = turning * bounds.average_s / (6 * (INWARDS * bounds.tolerance - braked))
    at = np.cumsum(path.lengths)[:-1]
    gained = float(accelerations.max()) * bounds.span_s**2 / 2
    span, half, near = (bounds.span_s, gained), (bounds.span_s / 2, gained / 2), (bounds.average_s / 2, 0.0)
    changed = _running(changing)
    measures = (
        _Measure(at, changed, span, half),
        _Measure(at, changed, half, span),
        _Measure(at, _running(pulling), near, near),
    )
    around = _around(measures, np.arange(len(at)), limit)
    too_fast = np.flatnonzero(limit * around > 1.0)
    if len(too_fast):
        limit[too_fast] = _slowed(measures, too_fast, limit[too_fast], around[too_fast])
    return limit


@dataclass(frozen=True, slots=True)
class _Measure:
    """Turning along the path, and how far around a corner it is counted: from `behind` to `ahead`, each
    (seconds of the speed, units more).
    """

    at: Floats
    running: Floats
    behind: tuple[float, float]
    ahead: tuple[float, float]

    def around(self, corners: NDArray[np.intp], speeds: Floats) -> Floats:
        middle = self.at[corners]
        first = np.searchsorted(self.at, middle - (speeds * self.behind[0] + self.behind[1]), "left")
        last = np.searchsorted(self.at, middle + (speeds * self.ahead[0] + self.ahead[1]), "right")
        counted: Floats = self.running[last] - self.running[first]
        return counted


def _running(values: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(values)])


def _around(measures: tuple[_Measure, ...], corners: NDArray[np.intp], speeds: Floats) -> Floats:
    """The largest of the measures: a speed times it is at most 1 where all of them are kept."""
    largest = measures[0].around(corners, speeds)
    for measure in measures[1:]:
        np.maximum(largest, measure.around(corners, speeds), out=largest)
    return largest


def _slowed(measures: tuple[_Measure, ...], corners: NDArray[np.intp], limit: Floats, around: Floats) -> Floats:
    """The highest speeds that keep all measures. Those grow with the speed: 1 / (a measure at a higher one) is safe."""
    high, low = limit, 1 / around
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        around = _around(measures, corners, middle)
        kept = middle * around <= 1.0
        low = np.where(kept, middle, np.maximum(low, 1 / np.maximum(around, 1.0 / limit)))
        high = np.where(kept, high, middle)
    return low
