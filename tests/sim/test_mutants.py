"""The campaign notices deliberate bugs. Those that show within some transfers are planted at every run of the tests;
`python -m benchmarks.mutants` plants them all.
"""

from __future__ import annotations

import pytest

from benchmarks.mutants import transfers_needed
from tests.sim.mutants import MUTANTS, Mutant
from tests.sim.mutants_fanuc_a import MUTANTS_OF_A
from tests.sim.mutants_verdicts import MUTANTS_OF_WORDS

SLOW = {
    "B: resume repeats a byte",
    "B: giving up ends the tape",
    "B: damage behind DC4 is passed over",
    "B: text behind DC4 is passed over",
    "B: a code inside a punch-out is passed over",
    "Bridgeport: bytes_low is always 0",
    "A: RST answered, and the job goes on",
    "expansion A: end packet not repeated",
    "expansion A: DC3 ignored",
    "Bridgeport: XOFF ignored",
}
"""These need dozens."""

ALL = (*MUTANTS, *MUTANTS_OF_A, *MUTANTS_OF_WORDS)

QUICK = [mutant for mutant in ALL if mutant.name not in SLOW]


def test_the_list_is_long_enough_and_names_differ() -> None:
    names = {mutant.name for mutant in ALL}
    assert len(names) == len(ALL) >= 20
    assert names >= SLOW


@pytest.mark.parametrize("mutant", QUICK, ids=lambda mutant: mutant.name)
def test_a_deliberate_bug_is_noticed(mutant: Mutant) -> None:
    count, _ = transfers_needed(mutant, most=40)
    assert count, f"{mutant.name} was not noticed"
