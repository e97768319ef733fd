"""What a machine may do, and how exactly a path is to be kept: the numbers the planner works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import UsageError
from tapewire.g05.layout import IncrementSystem, Layout, Unit, UnitTime

__all__ = ["Axis", "Floats", "Machine", "Planning"]

Floats = NDArray[np.float64]

MOST_SMOOTHING_TICKS: Final = 512
MOST_SMOOTHING_S: Final = 1.0
"""Of one average. Longer ones leave a corner no speed at all within any tolerance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One axis: its address, its unit, and its limits in units a minute, a second squared and a second cubed."""

    name: str
    unit: Unit = Unit.MM
    velocity_per_min: float = 6000.0
    acceleration: float = 1000.0
    jerk: float = 20_000.0

    def __post_init__(self) -> None:
        for what, value in (
            ("velocity", self.velocity_per_min),
            ("acceleration", self.acceleration),
            ("jerk", self.jerk),
        ):
            if not 0 < value < 1e12:
                raise UsageError(f"axis {self.name}: its {what} limit is {value:g}, and must be above 0 and below 1e12")


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """The axes in the order of the control, and their increments."""

    axes: tuple[Axis, ...]
    increments: IncrementSystem = IncrementSystem.IS_B

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(axis.name for axis in self.axes)

    @property
    def per_unit(self) -> Floats:
        """Increments in one unit, by axis."""
        return np.array([self.increments.per_unit(axis.unit) for axis in self.axes], np.float64)

    @property
    def velocity(self) -> Floats:
        """Units a second, by axis."""
        return np.array([axis.velocity_per_min / 60 for axis in self.axes])

    @property
    def acceleration(self) -> Floats:
        return np.array([axis.acceleration for axis in self.axes])

    @property
    def jerk(self) -> Floats:
        return np.array([axis.jerk for axis in self.axes])


@dataclass(frozen=True, slots=True, kw_only=True)
class Planning:
    """A plan to be made: the machine, the records, the unit time, and how far from the path the axes may be.

    `tolerance` is in units of the path. `smoothing_ticks` is the length of each of the two averages that the motion
    goes through, in units of time; None takes the length at which tolerance and jerk bind alike.
    """

    machine: Machine
    layout: Layout
    unit_time: UnitTime = UnitTime.MS_8
    tolerance: float = 0.01
    smoothing_ticks: int | None = None

    def __post_init__(self) -> None:
        if self.layout.axis_count != len(self.machine.axes):
            raise UsageError(f"{len(self.machine.axes)} axes do not go into records of {self.layout.axis_count}")
        if not 0 < self.tolerance < 1e6:
            raise UsageError(f"a path tolerance of {self.tolerance:g} is none; it is above 0")
        if self.smoothing_ticks is not None and not 2 <= self.smoothing_ticks <= MOST_SMOOTHING_TICKS:
            raise UsageError(
                f"smoothing over {self.smoothing_ticks} units of time: 2 to {MOST_SMOOTHING_TICKS} will do"
            )
        if self.smoothing_ticks is not None and self.smoothing_ticks * self.tick_s > MOST_SMOOTHING_S:
            raise UsageError(
                f"smoothing over {self.smoothing_ticks} units of {self.unit_time.value} ms is "
                f"{self.smoothing_ticks * self.tick_s:g} s for each average: {MOST_SMOOTHING_S:g} s is the most"
            )
        if self.tolerance * self.machine.per_unit.min() < 2:
            raise UsageError(
                f"a path tolerance of {self.tolerance:g} is less than two increments: rounding alone takes one"
            )

    @property
    def tick_s(self) -> float:
        return self.unit_time.value / 1000

    @property
    def ticks(self) -> int:
        """Length of each average, in units of time."""
        if self.smoothing_ticks is not None:
            return self.smoothing_ticks
        jerk = float(self.machine.jerk.min())
        balanced = (BALANCE * self.tolerance / jerk) ** (1 / 3)
        most = min(MOST_SMOOTHING_TICKS, int(MOST_SMOOTHING_S / self.tick_s))
        return int(min(max(round(balanced / self.tick_s), 2), most))


BALANCE: Final = 16.0
"""An average of (16 tolerance / jerk)^(1/3): corners as fast as the tolerance lets them be then need most of the jerk.
Shorter ones cost acceleration on long moves, longer ones cost speed in corners."""
