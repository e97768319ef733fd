"""A real program, from its text to the axes of the simulated control, over expansion B at 86400 baud and 2 ms."""

from __future__ import annotations

from benchmarks.g05_run import Run, run

MOVES = 5000
"""The campaign of docs/reliability.md has a hundred thousand."""


def test_a_real_program_runs_on_the_simulated_control() -> None:
    done: Run = run(MOVES)
    assert done.moves > MOVES
    assert done.interruptions == 0
    assert done.records_executed == done.records
    assert done.off_the_end == [0, 0, 0]
    assert done.farthest <= done.tolerance
    assert done.corners <= done.tolerance
    assert max(done.beyond) <= 0
    assert done.outcome == "complete"
