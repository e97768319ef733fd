"""All combinations of 5000, 5070, 507x and 508x: the host they ask for, and whether it works. Goal: every legal one.

The combinations that give the same two ends share one transfer, in simulated time.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from benchmarks.report import table, write_section
from tapewire.fanuc.parameters import Interface
from tests.fanuc.working_line import Line, combinations, complaint_of, is_complete, is_legal, lines_of

PAGE = Path(__file__).parent.parent / "docs" / "reliability.md"


def kind_of(complaint: str) -> str:
    if complaint.startswith("SR807"):
        return "SR807"
    return "no DC1 (5071, 5081 = 2 or 4)" if "no DC1" in complaint else "another device (5071, 5081)"


def row(interface: Interface) -> list[str]:
    refused: Counter[str] = Counter()
    lines: set[Line] = set()
    legal = total = 0
    for parameters in combinations(interface):
        total += 1
        complaint = complaint_of(parameters)
        assert (complaint is None) is is_legal(parameters, interface), parameters
        if complaint is None:
            legal += 1
            lines.update(lines_of(parameters, interface))
        else:
            refused[kind_of(complaint)] += 1
    complete = sum(map(is_complete, sorted(lines, key=str)))
    reasons = ", ".join(f"{count:,} {reason}" for reason, count in sorted(refused.items()))
    return [str(interface), f"{total:,}", f"{legal:,}", f"{len(lines):,}", f"{complete:,}", reasons]


def main() -> None:
    head = ["interface", "combinations", "legal", "different lines", "of these complete", "refused, and why"]
    text = (
        "Every value within its range of 5000, 5070 to 5074, or 5081 to 5084: `tapewire fanuc host-settings` must "
        "derive a host from each legal combination, that completes a transfer with the simulated control of the "
        "same parameters, and must say what is wrong with each other one.\n\n"
        + table(head, [row(interface) for interface in Interface])
        + "\n\n`python -m benchmarks.parameters_to_line`. What lies outside the ranges is refused, with SR807 where "
        "it is due; a share of that, and of this, runs with every test."
    )
    write_section("parameters-to-a-working-line", "Parameters to a working line", text, PAGE)


if __name__ == "__main__":
    main()
