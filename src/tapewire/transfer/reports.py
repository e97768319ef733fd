"""What a job tells while it runs and when it is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from tapewire.engine import Event, Nanos, Outcome

__all__ = ["Observer", "Progress", "Ready", "Report", "Result", "StopDistanceTold", "nothing"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """The line is open, or waits to be opened from the other side; `line` names it with the port in use."""

    line: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StopDistanceTold:
    """Characters that may still reach the control after its stop request, against what it tolerates."""

    characters: int
    needed: int
    guaranteed: bool
    how: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far a job is.

    `total` is None where nobody knows it. `rate` is in bytes a second and `share` of the line's capacity, both over
    the time not held; `left_s` is the time left at that rate. `buffered` and `blocks` come from a simulated control,
    `records` and `interruptions` from one that is in binary input operation.
    """

    bytes: int
    total: int | None
    held: bool
    rate: float
    share: float
    left_s: float | None
    buffered: int | None = None
    blocks: int | None = None
    records: int | None = None
    interruptions: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """How a job ended.

    `bytes` is what the other side (or, for a reception, the disk) has for certain, `bytes_handed` what it may have at
    most, `sha256` that of the first `bytes`. `utilisation` is characters x character time over the time not held,
    the first window left out; None where too little was sent to say.
    """

    outcome: Outcome
    reason: str
    bytes: int
    bytes_handed: int
    sha256: str
    seconds: float
    stops: int
    utilisation: float | None


Report: TypeAlias = Ready | StopDistanceTold | Progress | Event

Observer: TypeAlias = Callable[[Report, Nanos], None]
"""Gets every report with the moment of the monotonic clock."""


def nothing(report: Report, now: Nanos) -> None:
    """The observer that does not care."""
