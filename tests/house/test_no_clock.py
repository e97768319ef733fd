"""Engines, and all that runs in simulated time, know no clock, no port and no chance.

Time comes in as an argument, randomness as a seeded one. So a run is repeated to the byte on any machine, and
ten minutes of cutting take a second.
"""

from __future__ import annotations

import pytest

from tests.house.sources import Module, package_modules, read_module

BANNED = {
    *("asyncio", "time", "datetime", "random", "os", "socket", "serial", "logging"),
    *("threading", "subprocess", "select", "termios"),
}
CLOCK_FREE = (
    *("tapewire.engine", "tapewire.errors", "tapewire.codes"),
    *("tapewire.fanuc", "tapewire.g05", "tapewire.nc", "tapewire.protocols", "tapewire.sim"),
    # The half of the line that a simulated cable and a real port have in common.
    *("tapewire.line.transport", "tapewire.line.link", "tapewire.line.pacing"),
    *("tapewire.line.rfc2217.telnet", "tapewire.line.rfc2217.ends", "tapewire.line.rates"),
    *("tapewire.line.cable", "tapewire.line.guess", "tapewire.line.loop_back"),
    *("tapewire.line.simulated", "tapewire.line.faults", "tapewire.line.paths", "tapewire.line.reception"),
    *("tapewire.line.closed_loop", "tapewire.line.lateness", "tapewire.line.faulty"),
    *("tapewire.line.captures.records", "tapewire.line.captures.reader", "tapewire.line.captures.tap"),
    "tapewire.line.relay",
)
# Records of the domain may hold dates; nothing in them runs.
RECORDS = ("tapewire.model",)


def is_clock_free(name: str) -> bool:
    return any(name == room or name.startswith(room + ".") for room in CLOCK_FREE)


def complaints(module: Module) -> list[str]:
    if not is_clock_free(module.name):
        return []
    found = []
    for imported in module.imports:
        where = f"{module.name}, line {imported.line}"
        if imported.module.split(".")[0] in BANNED:
            found.append(f"{where}: imports {imported.module}")
        elif imported.module.split(".")[0] == "tapewire" and not (
            is_clock_free(imported.module) or imported.module in RECORDS
        ):
            found.append(f"{where}: imports {imported.module}, which may look at a clock")
    return found


def test_nothing_that_runs_in_simulated_time_knows_a_clock() -> None:
    modules = package_modules()
    assert any(is_clock_free(module.name) for module in modules)
    assert [line for module in modules for line in complaints(module)] == []


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("tapewire.engine", "import time"),
        ("tapewire.codes", "import os.path"),
        ("tapewire.protocols.fanuc_b.host", "from datetime import datetime"),
        ("tapewire.protocols.fanuc_b.host", "def late() -> None:\n    import random"),
        ("tapewire.sim.world", "__import__('asyncio')"),
        ("tapewire.line.link", "from tapewire.line import driver"),
        ("tapewire.line.link", "from .driver import Driver"),
    ],
)
def test_a_clock_is_found(name: str, source: str) -> None:
    assert complaints(read_module(name, source, {"tapewire.line.driver"}))


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("tapewire.line.driver", "import asyncio"),
        ("tapewire.simulators", "import time"),
        ("tapewire.sim.world", "import heapq\nfrom tapewire.line import link"),
    ],
)
def test_what_may_know_one_is_left_alone(name: str, source: str) -> None:
    assert complaints(read_module(name, source, {"tapewire.line.link"})) == []
