"""Speed along the path (look-ahead, second half), and where the axes would be at each unit of time.

Between corners the speed is a trapezoid: it rises and falls with the acceleration of the move. That no corner is come
to too fast is one sweep forwards and one backwards over the squares of the speeds, each a running minimum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.limits import Floats
from tapewire.g05.path import Path

__all__ = ["Samples", "Speeds", "sample", "sweep"]

MOST_TICKS: Final = 1 << 18
"""Units of time planned at once: a few long moves take as many as very many short ones."""


@dataclass(frozen=True, slots=True)
class Speeds:
    """At the corners (moves + 1,), the first one given; `settled` ones do not depend on what comes after."""

    at: Floats
    settled: int


def sweep(path: Path, corners: Floats, accelerations: Floats, entry: float) -> Speeds:
    """Speeds at all corners from `entry` to a stop at the end. `corners` are the limits of (moves - 1,)."""
    gains = 2 * accelerations * path.lengths
    rise = np.concatenate([[0.0], np.cumsum(gains)])
    squares = np.concatenate([[entry**2], corners**2, [0.0]])
    squares = np.minimum.accumulate(squares - rise) + rise
    left = rise[-1] - rise
    squares = np.minimum.accumulate((squares - left)[::-1])[::-1] + left
    free = np.flatnonzero(squares < left * (1 - 1e-12))
    settled = int(free[-1]) if len(free) else 0
    return Speeds(np.sqrt(np.maximum(squares, 0.0)), settled)


@dataclass(frozen=True, slots=True)
class Samples:
    """Where the axes would be, unsmoothed, at units of time: `points` (axes, ticks) in units; `moves` (ticks,) says on
    which move of the path; `begins_s` (moves + 1,) is when each move begins, and the last one ends.
    """

    points: Floats
    moves: NDArray[np.intp]
    begins_s: Floats


def sample(
    path: Path, speeds: Floats, fastest: Floats, accelerations: Floats, tick_s: float, first_s: float
) -> Samples:
    """Run along the path; the first tick is `first_s` after its beginning, the last before its end.

    Only as many moves are run along, one at least, as make no more than `MOST_TICKS`.
    """
    entry, leave = speeds[:-1], speeds[1:]
    doubled = 2 * accelerations
    peak = np.sqrt(np.minimum(fastest**2, (entry**2 + leave**2 + doubled * path.lengths) / 2))
    peak = np.maximum(peak, np.maximum(entry, leave))
    rising, falling = (peak**2 - entry**2) / doubled, (peak**2 - leave**2) / doubled
    level = np.maximum(path.lengths - rising - falling, 0.0)
    times = np.empty((len(path), 3))
    times[:, 0] = (peak - entry) / accelerations
    times[:, 1] = level / peak
    times[:, 2] = (peak - leave) / accelerations
    ends = np.cumsum(times.ravel())
    counts = np.floor((ends - first_s) / tick_s).astype(np.int64) + 1
    counts = np.maximum.accumulate(np.maximum(counts, 0))
    if counts[-1] > MOST_TICKS:
        taken = max(int(np.searchsorted(counts[2::3], MOST_TICKS, "right")), 1)
        ends, counts = ends[: 3 * taken], counts[: 3 * taken]
    total = int(counts[-1])
    piece = np.repeat(np.arange(len(ends)), np.diff(counts, prepend=0))
    begins = np.concatenate([[0.0], ends[:-1]])
    since = np.arange(total) * tick_s + first_s - begins[piece]
    starts = np.stack([np.zeros(len(path)), rising, rising + level], axis=1).ravel()
    velocities = np.stack([entry, peak, peak], axis=1).ravel()
    slopes = np.stack([accelerations, np.zeros(len(path)), -accelerations], axis=1).ravel() / 2
    along = (slopes[piece] * since + velocities[piece]) * since + starts[piece]
    moves = piece // 3
    np.clip(along, 0.0, path.lengths[moves], out=along)
    points = np.empty((path.starts.shape[1], total))
    for axis in range(len(points)):
        np.multiply(path.directions[:, axis][moves], along, out=points[axis])
        points[axis] += path.starts[:, axis][moves]
    return Samples(points, moves, np.concatenate([[0.0], ends[2::3]]))
