"""Distances from a path, found with nothing of the planner: every point against every straight piece near it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

AT_ONCE: Final = 256


def farthest(points: Points, path: Points, reach: float) -> float:
    """The largest distance of any of `points` (n, axes) from the polyline `path` (m, axes); infinity beyond `reach`."""
    begins, ends = path[:-1], path[1:]
    low, high = np.minimum(begins, ends) - reach, np.maximum(begins, ends) + reach
    found = 0.0
    for at in range(0, len(points), AT_ONCE):
        some = points[at : at + AT_ONCE]
        near = ((low <= some.max(axis=0)) & (high >= some.min(axis=0))).all(axis=1)
        if not near.any():
            return np.inf
        found = max(found, float(_nearest(some, begins[near], ends[near]).max()))
    return found


def _nearest(points: Points, begins: Points, ends: Points) -> Points:
    ways = ends - begins
    squares = np.maximum((ways**2).sum(axis=1), 1e-300)
    off = points[:, None, :] - begins[None]
    share = np.clip((off * ways).sum(axis=2) / squares, 0.0, 1.0)
    rest = off - share[:, :, None] * ways
    nearest: Points = np.sqrt((rest**2).sum(axis=2)).min(axis=1)
    return nearest


def in_between(positions: Points) -> Points:
    """Positions and the middles between them: the control goes straight from one to the next."""
    return np.concatenate([positions, (positions[1:] + positions[:-1]) / 2])
