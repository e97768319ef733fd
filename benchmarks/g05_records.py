"""Speed of the codec of binary input operation, beside a plain copy of the same bytes in the same minute.

python -m benchmarks.g05_records
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from benchmarks.report import spread, table, write_section
from tapewire.g05.layout import SIGNIFICANT, AuxiliaryUse, Layout, RecordFormat
from tapewire.g05.records import decode, encode

MEGABYTES: Final = 16
RUNS: Final = 25
LAYOUTS: Final = [
    Layout(axis_count=axes, format=name, auxiliary=use)
    for axes, name, use in (
        (3, RecordFormat.SPECIAL, AuxiliaryUse.UNUSED),
        (3, RecordFormat.GENERAL, AuxiliaryUse.UNUSED),
        (3, RecordFormat.SPECIAL, AuxiliaryUse.USED),
        (1, RecordFormat.SPECIAL, AuxiliaryUse.UNUSED),
        (5, RecordFormat.SPECIAL, AuxiliaryUse.UNUSED),
        (24, RecordFormat.GENERAL, AuxiliaryUse.USED),
    )
]
ABOUT: Final = (
    "Pieces of {size} MB of random records, from an array of travel (int16) to the bytes on the line and back with "
    "every check (range, check byte, bits kept 0, no record of zeros). GB/s counts bytes of records: those that come "
    "out of `encode` and go into `decode`. Median (minimum to maximum) of {runs} runs on one core, the three of a row "
    "turn by turn. Bound: `numpy.ndarray.copy` of the same bytes. Goals: encode 1, decode 0.3.\n\n"
)
BOUND: Final = """

What bounds it is numpy, which goes through the second-level cache once for every operation: records that are in the
cache already are no faster. A record of 7 bytes takes two passes to look at the range of its words (none in the general
format), four to pack them (one), two to see that it moves and four to add up its bytes, at 0.03 to 0.2 ns each, and one
load and two stores with gaps at 0.4 to 0.6 ns: eight bytes at once, over what the next record overwrites, then the
check byte. numpy copies from one odd gap to another at 2.7 ns an item, therefore the items stand side by side in
between. An auxiliary function takes eight passes and a store to pack, four to add up. The calls themselves are a tenth:
about 25 microseconds a piece of 0.4 MB. Tried, slower or no faster: a table of packed words (1.1 ns a word), sums in
columns or by lanes of eight bytes, larger and smaller pieces, a second thread, operations that load or store with gaps
by themselves. With more than four axes it takes an extra look when the first four stand still. Pieces beyond 32 MB are
slower by the page faults of fresh memory. This computer has two speeds, as others use it or not: 1.4 to 1.
"""


def rate(work: Callable[[], object], size: int) -> float:
    began = time.perf_counter()
    work()
    return size / (time.perf_counter() - began) / 1e9


def row(layout: Layout) -> list[str]:
    random = np.random.default_rng(5)
    count = MEGABYTES * 1_000_000 // layout.record_bytes
    low, high = layout.travel_limits
    travel = random.integers(low, high, (count, layout.axis_count)).astype(np.int16)
    travel[:, 0] |= 1
    words = random.integers(0, layout.largest_auxiliary, count) | SIGNIFICANT
    auxiliary = words.astype(np.uint32) if layout.uses_auxiliary else None
    data = encode(travel, layout, auxiliary)
    turns = [
        (rate(data.copy, len(data)), rate(lambda: encode(travel, layout, auxiliary), len(data)),
         rate(lambda: decode(data, layout), len(data)))
        for _ in range(RUNS)
    ]  # fmt: skip
    copied, made, read = (list(column) for column in zip(*turns, strict=True))
    share = statistics.median(made) / statistics.median(copied)
    return [str(layout), spread(copied, ".1f"), spread(made, ".2f"), f"{share:.0%}", spread(read, ".2f")]


def main() -> None:
    head = ["records", "copy", "encode", "encode, of the copy", "decode"]
    text = ABOUT.format(size=MEGABYTES, runs=RUNS) + table(head, [row(layout) for layout in LAYOUTS]) + BOUND
    write_section("g05-records", "Records of binary input operation", text)


if __name__ == "__main__":
    main()
