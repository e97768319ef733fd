"""When the next fault comes: so many characters on, or at a moment. The cost is per fault, never per character."""

from __future__ import annotations

import math
from typing import Final

from tapewire.engine import Nanos
from tapewire.line.faults.chance import Stream
from tapewire.line.faults.plan import At, EndFault, Every, Extent, FaultPlan, Nth, PerTransfer, Rate, When

__all__ = ["NEVER", "end_schedule", "next_moment", "skip"]

NEVER: Final = 1 << 62
"""A count that no line reaches."""

HORIZON_TRANSFERS: Final = 4
"""`PerTransfer` ends after so many times the expected span, so that a line whose job is over falls quiet."""

MOST_END_FAULTS: Final = 100
"""Faults of the ends planned ahead, for a plan that would go on for ever."""


def skip(when: When, stream: Stream, expected: int) -> int:
    """How many things pass before the next one is hit, where a transfer is expected to have `expected` of them."""
    match when:
        case Nth(number=number):
            return number - 1
        case Rate(probability=probability):
            return _geometric(probability, stream)
        case PerTransfer(mean=mean):
            return _geometric(mean / max(1, expected), stream)
        case _:
            return NEVER


def _geometric(probability: float, stream: Stream) -> int:
    if probability >= 1:
        return 0
    if probability <= 0:
        return NEVER
    return min(NEVER, int(math.log1p(-stream.random()) / math.log1p(-probability)))


def next_moment(when: When, stream: Stream, after: Nanos, extent: Extent) -> Nanos | None:
    """The next moment behind `after`; None when none comes any more, or what it counts is not time."""
    match when:
        case At(moment=moment):
            return moment if not after else None
        case Every(mean=mean):
            return after + _exponential(mean, stream)
        case PerTransfer(mean=mean) if mean > 0:
            moment = after + _exponential(extent.span / mean, stream)
            return moment if moment <= HORIZON_TRANSFERS * extent.span else None
        case _:
            return None


def _exponential(mean: float, stream: Stream) -> Nanos:
    return 1 + int(-mean * math.log1p(-stream.random()))


def end_schedule(plan: FaultPlan, stream: Stream, extent: Extent) -> tuple[tuple[Nanos, EndFault], ...]:
    """What happens to the ends and when, in its order: for whoever runs them."""
    schedule: list[tuple[Nanos, EndFault]] = []
    for fault in plan.end_faults:
        moment = next_moment(fault.when, stream, 0, extent)
        while moment is not None and len(schedule) < MOST_END_FAULTS:
            schedule.append((moment, fault))
            moment = next_moment(fault.when, stream, moment, extent)
    return tuple(sorted(schedule, key=lambda entry: entry[0]))
