"""Positions to whole increments, and never a unit of time without motion.

Every position is rounded by itself, so nothing accumulates: the sum of all travel is the rounded end less the rounded
start. A position is off by half an increment at most, hence the travel of a unit of time by less than one, the change
of it by less than two, and the change of that by less than four: so much is to be allowed for on top of the limits.

A record without motion would end binary input operation (9.1), so there is none. Where the axes creep (no step beside
the pause is longer than an increment) the pause is left out. Where they turn round at speed one increment goes ahead
of its time. Beside such a place rounding may take twice what it takes elsewhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.limits import Floats

__all__ = ["Quantiser"]

Whole = NDArray[np.int64]


class Quantiser:
    """Rounds a motion that comes in pieces, from rest at `start` to rest. Positions are (axes, n) in increments."""

    def __init__(self, start: Whole) -> None:
        self._last = start.copy()
        self._held = np.empty((len(start), 0))
        """Positions at the end of a piece from the last step on: whether they are a pause is not known yet."""
        self._moving = False
        self.left_out = 0
        """Units of time without motion that were left out, between the first motion and the last."""
        self.moved_ahead = 0
        """Units of time in which an increment went ahead of its time."""

    def travel(self, positions: Floats) -> Whole:
        """(n, axes) of travel, none of it all zeros."""
        exact = np.concatenate([self._held, positions], axis=1)
        whole = np.rint(exact).astype(np.int64)
        steps = self._steps(whole)
        moves = np.flatnonzero(steps.any(axis=0))
        begin = 0 if self._moving or not len(moves) else int(moves[0])
        end = int(moves[-1]) if len(moves) else 0
        self._held = exact[:, end:] if len(moves) else exact[:, -1:]
        if end <= begin:
            return np.empty((0, len(whole)), np.int64)
        self._moving = True
        return self._finished(exact[:, begin:end], whole[:, begin:end], steps[:, begin : end + 1])

    def finish(self, end: Floats) -> Whole:
        """The last travel, to `end` (axes,) exactly, whatever has become of the last decimals on the way there."""
        steps = self._steps(np.rint(end).astype(np.int64)[:, None])
        return np.ascontiguousarray(steps[:, steps.any(axis=0)].T)

    def _steps(self, whole: Whole) -> Whole:
        return np.diff(np.concatenate([self._last[:, None], whole], axis=1), axis=1)

    def _finished(self, exact: Floats, whole: Whole, steps: Whole) -> Whole:
        """`steps` has one more behind those of `whole`, which is none of zeros."""
        still = np.flatnonzero(~steps[:, :-1].any(axis=0))
        if len(still):
            kept = self._without_pauses(exact, whole, steps, still)
            steps = self._steps(whole)[:, kept]
        else:
            steps = steps[:, :-1]
        self._last = whole[:, -1].copy()
        return np.ascontiguousarray(steps.T)

    def _without_pauses(self, exact: Floats, whole: Whole, steps: Whole, still: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Changes `whole` where an increment goes ahead; says which units of time are kept."""
        kept = np.ones(whole.shape[1], np.bool_)
        creeps = _creeping(steps)[still]
        if creeps.all():
            kept[still] = False
            self.left_out += len(still)
            return kept
        for index, creeping in zip(still.tolist(), creeps.tolist(), strict=True):
            before = whole[:, index - 1] if index else self._last
            if (whole[:, index] != before).any():
                continue
            if creeping:
                kept[index] = False
                self.left_out += 1
            else:
                self._move_ahead(exact, whole, before, index)
        return kept

    def _move_ahead(self, exact: Floats, whole: Whole, before: Whole, index: int) -> None:
        """One axis to the whole increment on the other side of where it should be; what follows is taken from there."""
        while index < whole.shape[1] and (whole[:, index] == before).all():
            off = exact[:, index] - whole[:, index]
            axis = int(np.argmax(np.abs(off)))
            whole[axis, index] += 1 if off[axis] >= 0 else -1
            self.moved_ahead += 1
            before = whole[:, index]
            index += 1


def _creeping(steps: Whole) -> NDArray[np.bool_]:
    """Where no step beside, before the pause and behind it, is longer than an increment."""
    sizes = np.abs(steps).max(axis=0)
    places = np.arange(len(sizes))
    before = np.maximum.accumulate(np.where(sizes > 0, places, -1))
    behind = np.minimum.accumulate(np.where(sizes > 0, places, len(sizes) - 1)[::-1])[::-1]
    creeping: NDArray[np.bool_] = np.maximum(np.where(before >= 0, sizes[before], 0), sizes[behind]) <= 1
    return creeping
