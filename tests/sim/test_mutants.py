"""The campaign notices deliberate bugs. Those that show within some transfers are planted at every run of the tests;
`python -m benchmarks.mutants` plants them all.
"""

from __future__ import annotations

import pytest

from benchmarks.mutants import transfers_needed
from tests.sim.mutants import MUTANTS, Mutant

SLOW = {
    "B: resume repeats a byte",
    "B: giving up ends the tape",
    "A: RST answered, and the job goes on",
    "expansion A: end packet not repeated",
    "expansion A: DC3 ignored",
    "Bridgeport: XOFF ignored",
}
"""These need dozens."""

QUICK = [mutant for mutant in MUTANTS if mutant.name not in SLOW]


def test_the_list_is_long_enough_and_names_differ() -> None:
    names = {mutant.name for mutant in MUTANTS}
    assert len(names) == len(MUTANTS) >= 20
    assert names >= SLOW


@pytest.mark.parametrize("mutant", QUICK, ids=lambda mutant: mutant.name)
def test_a_deliberate_bug_is_noticed(mutant: Mutant) -> None:
    count, _ = transfers_needed(mutant, most=40)
    assert count, f"{mutant.name} was not noticed"
