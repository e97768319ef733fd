"""Tapewire: feed NC programs to CNC controls over serial lines, take programs back, and simulate the control.

    import asyncio, tapewire

    result = asyncio.run(tapewire.send("O1234.nc", line="/dev/ttyUSB0", protocol="fanuc-b"))
    print(result.outcome, result.bytes, result.sha256)

The names below are the whole public interface; each is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tapewire.engine import (
        AfterStop,
        Alarm,
        Ended,
        Event,
        Held,
        Notice,
        Outcome,
        Received,
        Requested,
        Resumed,
        Started,
        Violation,
    )
    from tapewire.errors import LineBusy, LineError, LineNotFound, ProgramError, TapewireError, UsageError
    from tapewire.protocols import PROTOCOLS
    from tapewire.sim.nc import Ground
    from tapewire.sim.operator import Press
    from tapewire.sim.world import Pair, World
    from tapewire.transfer.api import receive, run_control, send
    from tapewire.transfer.control import ControlTask, Operation
    from tapewire.transfer.program import Program
    from tapewire.transfer.reports import Observer, Progress, Ready, Report, Result, StopDistanceTold

_HOMES: Final = {
    "tapewire.engine": ("AfterStop Alarm Ended Event Held Notice Outcome Received Requested Resumed Started Violation"),
    "tapewire.errors": "LineBusy LineError LineNotFound ProgramError TapewireError UsageError",
    "tapewire.protocols": "PROTOCOLS",
    "tapewire.sim.nc": "Ground",
    "tapewire.sim.operator": "Press",
    "tapewire.sim.world": "Pair World",
    "tapewire.transfer.api": "receive run_control send",
    "tapewire.transfer.control": "ControlTask Operation",
    "tapewire.transfer.program": "Program",
    "tapewire.transfer.reports": "Observer Progress Ready Report Result StopDistanceTold",
}
_HOME_OF: Final = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "PROTOCOLS",
    "AfterStop",
    "Alarm",
    "ControlTask",
    "Ended",
    "Event",
    "Ground",
    "Held",
    "LineBusy",
    "LineError",
    "LineNotFound",
    "Notice",
    "Observer",
    "Operation",
    "Outcome",
    "Pair",
    "Press",
    "Program",
    "ProgramError",
    "Progress",
    "Ready",
    "Received",
    "Report",
    "Requested",
    "Result",
    "Resumed",
    "Started",
    "StopDistanceTold",
    "TapewireError",
    "UsageError",
    "Violation",
    "World",
    "receive",
    "run_control",
    "send",
]


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module 'tapewire' has no attribute {name!r}")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return __all__
