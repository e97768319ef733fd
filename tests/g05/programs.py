"""Programs of the kind that shops feed to a machine, made from a seed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["finishing", "finishing_points"]

ROW_MOVES = 250


def finishing_points(moves: int, seed: int) -> NDArray[np.float64]:
    """A ball cutter going to and fro over a free-form surface: about 0.3 mm a move, in thousandths of a millimetre."""
    random = np.random.default_rng(seed)
    waves = random.uniform(0.05, 0.4, (4, 2)), random.uniform(0, 6.28, 4), random.uniform(0.2, 1.2, 4)
    step = np.clip(random.normal(0.3, 0.12, moves + 1), 0.03, 1.5)
    row = np.arange(moves + 1) // ROW_MOVES
    along = np.concatenate([np.cumsum(step[row == number]) for number in range(int(row[-1]) + 1)])
    x = np.where(row % 2 == 0, along, ROW_MOVES * 0.3 - along)
    y = row * 0.4 + 0.02 * np.sin(along)
    z = sum(height * np.sin(turn[0] * x + turn[1] * y + phase) for turn, phase, height in zip(*waves, strict=True))
    return np.round(np.stack([x, y, z], axis=1), 3)


def finishing(moves: int, seed: int = 1, feed: int = 3000) -> Iterator[str]:
    """The same as an NC program with its way there and back."""
    points = finishing_points(moves, seed)
    x, y, z = points[0]
    yield from ("%", "O2000(FINISHING)", "G21G90G17G40G49G80", "M03S8000", f"G00X{x:.3f}Y{y:.3f}Z20.000")
    yield f"G01X{x:.3f}Y{y:.3f}Z{z:.3f}F600"
    yield f"F{feed}"
    before = (None, None, None)
    for point in points[1:]:
        words = [f"{axis}{value:.3f}" for axis, value, last in zip("XYZ", point, before, strict=True) if value != last]
        before = tuple(point)
        yield "".join(words) or f"X{point[0]:.3f}"
    yield from ("G00Z20.000", "M05", "M30", "%")
