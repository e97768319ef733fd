"""How many transfers the campaign needs to notice each of the deliberate bugs of tests/sim/mutants.py.

    python -m benchmarks.mutants [--most N] [WORD ...]

Without a WORD all of them. Writes the table of docs/reliability.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.report import table, write_section
from tapewire.sim.campaign import Case, run_case
from tapewire.sim.checkers import NO_ENGINE_BREAKS
from tests.sim.mutants import MUTANTS, Mutant

PAGE = Path(__file__).parent.parent / "docs" / "reliability.md"

MOST_TRANSFERS = 10_000

ABOUT = """\
Each bug is planted alone, and transfers are run with the seeds 1, 2, 3 ... under the faults named until a checker
reports a violation; what it reported is the rule. A transfer in which an engine broke does not count: that is noticed
by the engine's own assertions.

"""


def transfers_needed(mutant: Mutant, most: int) -> tuple[int, str]:
    """Transfers until it is noticed, and by which rule; 0 when it never is. An engine that broke was not judged."""
    count = 0
    with mutant.alive():
        for seed in range(1, most + 1):
            for preset in mutant.presets:
                count += 1
                rules = [finding.rule for finding in run_case(Case(mutant.protocol, preset, seed)).violations]
                if rules and NO_ENGINE_BREAKS not in rules:
                    return count, rules[0]
                if count >= most:
                    return 0, ""
    return 0, ""


def main(arguments: Sequence[str]) -> int:
    most, words = MOST_TRANSFERS, list(arguments)
    if "--most" in words:
        at = words.index("--most")
        most = int(words[at + 1])
        del words[at : at + 2]
    rows, missed = [], 0
    for mutant in MUTANTS:
        if words and not any(word in mutant.name for word in words):
            continue
        count, rule = transfers_needed(mutant, most)
        missed += not count
        rows.append([mutant.name, ", ".join(mutant.presets), f"{count:,}" if count else "not noticed", rule])
        print(*rows[-1], sep=" | ", flush=True)
    if not words:
        text = ABOUT + table(["bug", "faults", "transfers", "rule that noticed it"], rows)
        write_section("mutants", "Deliberate bugs", text, PAGE)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
