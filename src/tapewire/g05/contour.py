"""How far the smoothed motion is from the path, and whether it keeps the limits of the axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.limits import Floats
from tapewire.g05.path import Path

__all__ = ["beyond_limits", "chord_errors", "contour_errors"]

Indices = NDArray[np.intp]


def contour_errors(
    points: Floats, path: Path, nearest: Indices, first: Indices, last: Indices, enough: float
) -> Floats:
    """Distance of each of `points` (axes, n) from the path.

    Looked for on the move `nearest` and, while it is more than `enough`, further and further away from it on the moves
    `first` to `last`. What is at most `enough` may be an upper bound.
    """
    errors = _distances(points, path, nearest)
    far = np.flatnonzero(errors > enough)
    step = 0
    while len(far):
        step += 1
        reached = (nearest[far] - step >= first[far]) | (nearest[far] + step <= last[far])
        far = far[reached]
        for side in (-step, step):
            moves = np.clip(nearest[far] + side, first[far], last[far])
            errors[far] = np.minimum(errors[far], _distances(points[:, far], path, moves))
        far = far[errors[far] > enough]
    return errors


def _distances(points: Floats, path: Path, moves: Indices) -> Floats:
    """From each point to one straight move."""
    axes = range(len(points))
    ways = [points[axis] - path.starts[:, axis][moves] for axis in axes]
    directions = [path.directions[:, axis][moves] for axis in axes]
    along = sum((ways[axis] * directions[axis] for axis in axes), np.zeros(len(moves)))
    np.clip(along, 0.0, path.lengths[moves], out=along)
    squares = np.zeros(len(moves))
    for axis in axes:
        rest = ways[axis] - directions[axis] * along
        squares += rest * rest
    distances: Floats = np.sqrt(squares)
    return distances


def chord_errors(points: Floats, corners: Floats, at: Indices, reach: int, enough: float) -> Floats:
    """Distance of each of `corners` (axes, n) from the chords between `points`.

    Looked for at the point `at` and, while it is more than `enough`, up to `reach` chords away. Corners are not
    only to be passed near by: the motion must come near them too, or the tip of a spike would be cut off with no point
    off the path.
    """
    errors = np.full(corners.shape[1], np.inf)
    far = np.arange(corners.shape[1])
    for step in range(reach):
        for offset in (step, -step - 1):
            begin = np.clip(at[far] + offset, 0, points.shape[1] - 2)
            distances = _to_chords(corners[:, far], points[:, begin], points[:, begin + 1])
            errors[far] = np.minimum(errors[far], distances)
        far = far[errors[far] > enough]
        if not len(far):
            break
    return errors


def _to_chords(corners: Floats, begins: Floats, ends: Floats) -> Floats:
    chords, ways = ends - begins, corners - begins
    squares = np.einsum("ij,ij->j", chords, chords)
    share = np.einsum("ij,ij->j", ways, chords) / np.maximum(squares, 1e-300)
    rest = ways - chords * np.clip(share, 0.0, 1.0)
    distances: Floats = np.sqrt(np.einsum("ij,ij->j", rest, rest))
    return distances


def beyond_limits(points: Floats, limits: tuple[Floats, Floats, Floats]) -> tuple[NDArray[np.bool_], list[Floats]]:
    """Which of the points (axes, n) from the fourth on break a limit per unit time; peaks by axis of each order.

    `limits` are those of travel, of its change, and of the change of that, in units.
    """
    wrong = np.zeros(points.shape[1] - 3, np.bool_)
    peaks, differences = [], points
    for order, limit in enumerate(limits):
        differences = np.diff(differences, axis=1)
        sizes = np.abs(differences[:, 2 - order :])
        peaks.append(sizes.max(axis=1, initial=0.0))
        if (peaks[-1] > limit).any():
            wrong |= (sizes > limit[:, None]).any(axis=0)
    return wrong, peaks
