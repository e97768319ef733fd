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
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, Lrc
from tests.protocols.bridgeport.combinations import (
    ARRIVED,
    CANCELS,
    COMBINATIONS,
    DISTURBANCES,
    HOST,
    LINK_CHARACTERS,
    NAME_ENDS,
    OPERATIONS,
    SAVE_ENDS,
    disturbed_link,
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


def disturbed(disturbance: str) -> list[int]:
    """Byte-exact transfers by check character, one for each place."""
    return [sum(_arrives(place, disturbance, lrc) for place in range(LINK_CHARACTERS)) for lrc in LRC_CANDIDATES]


def _arrives(place: int, disturbance: str, lrc: Lrc) -> bool:
    try:
        return disturbed_link(place, disturbance, lrc) == ARRIVED
    except AssertionError as error:
        print(f"FAILED {disturbance} of character {place}, {lrc}: {error}", file=sys.stderr, flush=True)
        return False


def main() -> int:
    failed = combinations()
    return disturbances() or failed


def disturbances() -> int:
    with Pool() as pool:
        counts = pool.map(disturbed, DISTURBANCES)
    rows = [
        [name, *(f"{count} of {LINK_CHARACTERS}" for count in row)]
        for name, row in zip(DISTURBANCES, counts, strict=True)
    ]
    text = (
        "By the same command. A program of three records by DNC LINK, and one character of what the host sends "
        f"disturbed once: at each of {LINK_CHARACTERS} places, from the DC1 that answers the name to the last check "
        "character. How often the program arrived byte-exact and both ends called it complete. A flipped bit is not "
        "shown by parity here, so the check character alone has to find it.\n\n"
    )
    text += table(["disturbance", *LRC_CANDIDATES], rows)
    text += (
        "\n\nThe 33rd character is the EOT behind the last ACK. Where that is lost or becomes another, the control has "
        "all of the program and waits for more, and the host, which nobody tells, says complete.\n"
    )
    write_section("bridgeport-disturbances", "Bridgeport, one disturbed character", text, PAGE)
    return 1 if any(count != LINK_CHARACTERS for row in counts for count in row) else 0


def combinations() -> int:
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
