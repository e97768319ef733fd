"""What is drawn for a transfer, and what follows from it."""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.codes import DataCode
from tapewire.sim.execution import BlockTime, Speeds
from tapewire.sim.programs import program
from tapewire.sim.scenarios import draw


@pytest.mark.parametrize("override", [0.5, 1.0, 33.0, 5000.0])
@pytest.mark.parametrize("size", [100, 3000, 60_000])
def test_the_time_a_program_needs_at_most_covers_its_blocks(size: int, override: float) -> None:
    """G00 is hastened by no override, so the last two overrides take nearly as long as each other."""
    drawn = draw("fanuc-b-expansion", "clean", 1)
    scenario = dataclasses.replace(drawn, size=size, override=override, baud=86400)
    block_time = BlockTime(Speeds(override=override))
    blocks = program(size, 41_647, DataCode.ASCII).split(b"\n")
    assert sum(block_time(block) for block in blocks) <= scenario.run_time


def test_a_host_that_looks_for_the_check_character_may_be_refused_as_often_as_that_takes() -> None:
    """Two NAKs for each of seven candidates (4.2.1): a control that gives up after five cannot be learned from."""
    drawn = [draw("bridgeport", "clean", seed).settings for seed in range(1, 400)]
    searching = [settings.cnc for settings in drawn if settings.host.get("lrc") == "auto"]
    assert searching
    assert {words.get("nak_limit", "20") for words in searching} <= {"0", "20"}
