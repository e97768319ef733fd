"""What records add up to: travel, speeds, accelerations and time, in pieces of any size and little memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tapewire.g05.limits import Floats, Machine

__all__ = ["Motion", "Sketch"]


class Motion:
    """Sums and peaks by axis of travel in increments per unit time, from rest to rest."""

    def __init__(self, axis_count: int) -> None:
        self.records = 0
        self.position = np.zeros(axis_count, np.int64)
        self.lowest = np.zeros(axis_count, np.int64)
        self.highest = np.zeros(axis_count, np.int64)
        self._peaks = [np.zeros(axis_count, np.int64) for _ in range(3)]
        self._before = np.zeros((2, axis_count), np.int64)

    def add(self, travel: NDArray[np.integer]) -> None:
        """(records, axes)."""
        if not len(travel):
            return
        steps = travel.astype(np.int64)
        where = np.cumsum(steps, axis=0) + self.position
        self.records += len(steps)
        self.lowest = np.minimum(self.lowest, where.min(axis=0))
        self.highest = np.maximum(self.highest, where.max(axis=0))
        self.position = where[-1]
        self._note(steps)

    def finish(self) -> None:
        """The axes come to rest."""
        self._note(np.zeros((2, len(self.position)), np.int64))

    def _note(self, steps: NDArray[np.int64]) -> None:
        joined = np.concatenate([self._before, steps])
        self._before = joined[-2:]
        for order in range(3):
            sizes = np.abs(np.diff(joined, order, axis=0))
            self._peaks[order] = np.maximum(self._peaks[order], sizes.max(axis=0))

    def peaks(self, machine: Machine, tick_s: float) -> tuple[Floats, Floats, Floats]:
        """Largest velocity, acceleration and jerk by axis, in units a second, a second squared and cubed.

        Rounding alone makes an acceleration of up to two increments per unit time squared, and a jerk of up to four.
        """
        per_unit = machine.per_unit
        velocity, acceleration, jerk = (
            peak / per_unit / tick_s**order for order, peak in enumerate(self._peaks, start=1)
        )
        return velocity, acceleration, jerk


MOST_POINTS = 2048


@dataclass(slots=True)
class _Envelope:
    """The largest value in each of at most `MOST_POINTS` equal spans; they double when there are too many."""

    span: int
    values: list[float]
    filled: int = 0

    def add(self, sizes: Floats) -> None:
        at = 0
        while at < len(sizes):
            if not self.filled:
                self.values.append(0.0)
            count = min(self.span - self.filled, len(sizes) - at)
            self.values[-1] = max(self.values[-1], float(sizes[at : at + count].max()))
            self.filled = (self.filled + count) % self.span
            at += count
            if not self.filled and len(self.values) >= MOST_POINTS:
                self.values = [max(pair) for pair in zip(self.values[::2], self.values[1::2], strict=True)]
                self.span *= 2


class Sketch:
    """The path in its first two axes, the speed and the acceleration, coarse enough for a picture."""

    def __init__(self, machine: Machine, tick_s: float) -> None:
        self.tick_s = tick_s
        self.names = machine.names
        self.units = tuple(str(axis.unit) for axis in machine.axes)
        self.points: list[tuple[float, float]] = [(0.0, 0.0)]
        self.speed = _Envelope(1, [])
        self.acceleration = _Envelope(1, [])
        self.records = 0
        self._per_unit = machine.per_unit
        self._every = 1
        self._position = np.zeros(len(machine.axes))
        self._before = np.zeros(len(machine.axes))

    def add(self, travel: NDArray[np.integer]) -> None:
        """(records, axes) of increments."""
        if not len(travel):
            return
        steps = travel / self._per_unit
        velocity = steps / self.tick_s
        change = np.diff(velocity, axis=0, prepend=self._before[None])
        self.speed.add(np.sqrt((velocity**2).sum(axis=1)))
        self.acceleration.add(np.sqrt((change**2).sum(axis=1)) / self.tick_s)
        where = np.cumsum(steps, axis=0) + self._position
        self._keep(where)
        self._position, self._before = where[-1], velocity[-1]
        self.records += len(travel)

    @property
    def end(self) -> tuple[float, float]:
        """Where the first two axes are."""
        return float(self._position[0]), float(self._position[1]) if len(self._position) > 1 else 0.0

    def _keep(self, where: Floats) -> None:
        picked = where[(-self.records - 1) % self._every :: self._every]
        flat = picked[:, :2] if picked.shape[1] > 1 else np.stack([picked[:, 0], np.zeros(len(picked))], axis=1)
        self.points += [(float(x), float(y)) for x, y in flat]
        while len(self.points) > 2 * MOST_POINTS:
            self.points = self.points[::2]
            self._every *= 2
