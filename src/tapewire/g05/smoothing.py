"""Two averages one after the other: the motion as it goes out, with bounded acceleration and jerk."""

from __future__ import annotations

import numpy as np

from tapewire.g05.limits import Floats

__all__ = ["smooth"]


def smooth(points: Floats, ticks: int) -> Floats:
    """The mean of `ticks` positions, twice. (axes, n) in, (axes, n - 2 ticks + 2) out: where both averages are full.

    Position k out stands for position k + ticks - 1 in: the middle of what it is made of.
    """
    return _average(_average(points, ticks), ticks)


def _average(points: Floats, ticks: int) -> Floats:
    """Sums run from the first position, so that they stay small and exact enough."""
    origin = points[:, :1]
    running = np.empty((points.shape[0], points.shape[1] + 1))
    running[:, 0] = 0.0
    np.cumsum(points - origin, axis=1, out=running[:, 1:])
    averaged: Floats = (running[:, ticks:] - running[:, :-ticks]) / ticks + origin
    return averaged
