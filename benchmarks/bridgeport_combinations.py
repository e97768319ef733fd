"""One unchanged Bridgeport host against every reading of the lost codes: the whole product, in simulated time.

A campaign, not a figure: it fails where one transfer is neither byte-exact nor refused with a reason.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from multiprocessing import Pool
from pathlib import Path
from typing import Final

from benchmarks.report import table, write_section
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tests.protocols.bridgeport.combinations import (
    CANCELS,
    COMBINATIONS,
    HOST,
    NAME_ENDS,
    OPERATIONS,
    SAVE_ENDS,
)

PAGE: Final = Path(__file__).parent.parent / "docs" / "reliability.md"

Outcomes = dict[str, str]
"""What came of each operation."""


def judged(combination: dict[str, str]) -> Outcomes:
    return {name: _judged(name, combination) for name in OPERATIONS}


def _judged(name: str, combination: dict[str, str]) -> str:
    try:
        return OPERATIONS[name](combination)
    except AssertionError as error:
        print(f"FAILED {name} {combination}: {error}", file=sys.stderr, flush=True)
        return "FAILED"


def main() -> int:
    began = time.monotonic()
    counts: dict[str, Counter[str]] = {name: Counter() for name in OPERATIONS}
    with Pool() as pool:
        for outcomes in pool.imap_unordered(judged, COMBINATIONS, chunksize=16):
            for name, outcome in outcomes.items():
                counts[name][outcome] += 1
    seconds = time.monotonic() - began
    rows = [[name, outcome, f"{count:,}"] for name in OPERATIONS for outcome, count in sorted(counts[name].items())]
    configuration = ", ".join(f"`{key}={word}`" for key, word in HOST.items())
    text = (
        f"`python -m benchmarks.bridgeport_combinations`, {seconds:.0f} s on {os.cpu_count()} cores. One host, "
        f"configured once ({configuration}), at a simulated control that says {len(NAME_ENDS)} endings of a name x "
        f"{len(SAVE_ENDS)} endings of a saved program x {len(CANCELS)} cancel pairs x {len(LRC_CANDIDATES)} check "
        f"characters x {len(DncEnd)} endings of a DNC LINK file: all {len(COMBINATIONS):,}, each with every operation "
        "below. A cancelled transfer is followed by a whole one between the same two ends. Every 23rd combination "
        "runs with the tests.\n\nBoth ends share what is taken for true of the other codes, so this shows tolerance, "
        "and no agreement with a real control.\n\n"
    )
    write_section(
        "bridgeport-combinations",
        "Bridgeport combinations",
        text + table(["operation", "outcome", "combinations"], rows),
        PAGE,
    )
    return 1 if any("FAILED" in counter for counter in counts.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
