"""Speed of planning binary input operation, what bounds it, and its memory.

python -m benchmarks.g05_plan
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable, Iterator
from cProfile import Profile
from pathlib import Path
from pstats import Stats
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from benchmarks.report import spread, table, write_section
from tapewire.g05.layout import Layout, UnitTime
from tapewire.g05.limits import Axis, Machine, Planning
from tapewire.g05.path import Moves
from tapewire.g05.plan import Plan
from tapewire.g05.records import encode
from tapewire.nc.reader import NcReader, Reading
from tapewire.transfer.binary import Encoding, Source, encode_file
from tests.g05.programs import finishing, finishing_points

MOVES: Final = 100_000
ENDLESS: Final = 10_000_000
RUNS: Final = 5
AT_A_TIME: Final = 8192
AXES: Final = tuple(Axis(name=name, velocity_per_min=12_000, acceleration=2000, jerk=50_000) for name in "XYZ")
ABOUT: Final = """
The free-form surface of `tests/g05/programs.py`, three axes, tolerance 0.01 mm, moves of 0.3 mm. Moves a second of one
core (processor time, so that waiting for other work does not count), median (minimum to maximum) of {runs} runs of
{moves:,} moves. Goal: 200,000. Every unit of time is judged (limits of each axis, distance from the path), and that is
in the figures. Bound: as many positions rounded and their differences taken by numpy, nothing planned, nothing judged.

{speeds}

What a second of planning goes into (2 ms, 50 mm/s):

{profile}

From the text of an NC program to a file of records, each stage alone and the whole of `tapewire g05 encode` (the
interpreter's start aside), 2 ms, 50 mm/s. Blocks like `X1.234Y5.678Z-.9` are read in runs, others one by
one:

{stages}

Memory: {endless:,} moves planned one after the other, {records:,} records of 8 ms; the process held at most
{before:.0f} MB after the first tenth of them and {after:.0f} MB at the end.
"""


def planning_of(unit_time: UnitTime) -> Planning:
    return Planning(machine=Machine(axes=AXES), layout=Layout(axis_count=3), unit_time=unit_time, tolerance=0.01)


def moves_of(points: np.ndarray, speed: float) -> Iterator[Moves]:
    for at in range(1, len(points), AT_A_TIME):
        ends = points[at : at + AT_A_TIME]
        yield Moves(ends=ends, speeds=np.full(len(ends), speed))


def plan_once(points: np.ndarray, unit_time: UnitTime, speed: float) -> tuple[float, int, int]:
    """(processor seconds, records, blocks planned again)."""
    plan = Plan(planning_of(unit_time), points[0])
    began = time.process_time()
    records = sum(len(piece) for piece in plan.travel(moves_of(points, speed)))
    return time.process_time() - began, records, plan.report.slowed


def bound(records: int) -> float:
    """Processor seconds of rounding so many positions and taking their differences."""
    positions = np.random.default_rng(1).normal(size=(3, records)) * 1e5
    began = time.process_time()
    np.ascontiguousarray(np.diff(np.rint(positions).astype(np.int64), axis=1).T)
    return time.process_time() - began


def speeds(points: np.ndarray) -> str:
    rows = []
    for unit_time, speed in (
        (UnitTime.MS_8, 50.0),
        (UnitTime.MS_4, 50.0),
        (UnitTime.MS_2, 50.0),
        (UnitTime.MS_2, 150.0),
    ):
        runs = [plan_once(points, unit_time, speed) for _ in range(RUNS)]
        records = runs[0][1]
        floor = min(bound(records) for _ in range(RUNS))
        rates = [MOVES / seconds for seconds, _, _ in runs]
        rows.append(
            [
                f"{unit_time.value} ms, {speed:.0f} mm/s",
                f"{records / MOVES:.1f}",
                spread(rates, ",.0f"),
                f"{statistics.median(rates) * records / MOVES:,.0f}",
                f"{MOVES / floor:,.0f}",
                str(runs[0][2]),
            ]
        )
    head = ["unit time, feed", "records a move", "moves/s", "records/s", "bound, moves/s", "blocks planned again"]
    return table(head, rows)


def profile(points: np.ndarray) -> str:
    watch = Profile()
    watch.runcall(plan_once, points, UnitTime.MS_2, 50.0)
    stats = Stats(watch).get_stats_profile()
    total = stats.total_tt
    parts = {
        "corner speeds (bisection, two searches a step)": "corner_speeds",
        "speeds along the path (two sweeps)": "sweep",
        "positions at units of time": "sample",
        "smoothing": "smooth",
        "judging: limits": "beyond_limits",
        "judging: distance from the path": "contour_errors",
        "judging: corners missed": "_missed",
        "rounding": "_quantised",
    }
    rows = [[what, f"{stats.func_profiles[name].cumtime / total:.0%}"] for what, name in parts.items()]
    return table(["part", "share"], rows)


def endless() -> tuple[int, float, float]:
    points = finishing_points(MOVES, 2)
    plan = Plan(planning_of(UnitTime.MS_8), points[0])

    def moves() -> Iterator[Moves]:
        there, back = points[1:], points[-2::-1]
        for turn in range(ENDLESS // MOVES):
            ends = back if turn % 2 else there
            for at in range(0, MOVES, AT_A_TIME):
                piece = ends[at : at + AT_A_TIME]
                yield Moves(ends=piece, speeds=np.full(len(piece), 50.0))

    before = 0.0
    for piece in plan.travel(moves()):
        if not before and plan.report.moves > ENDLESS // 10:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        del piece
    return plan.report.records, before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def stages(points: np.ndarray) -> str:
    text = "".join(f"{line}\n" for line in finishing(MOVES))
    travel = np.concatenate(list(Plan(planning_of(UnitTime.MS_2), points[0]).travel(moves_of(points, 50.0))))
    layout = Layout(axis_count=3)
    with TemporaryDirectory() as folder:
        source, out = Path(folder, "part.nc"), Path(folder, "part.g05")
        source.write_text(text)
        encoding = Encoding(source=Source.NC, planning=planning_of(UnitTime.MS_2))
        work: dict[str, Callable[[], object]] = {
            "reading, in runs": lambda: read([text]),
            "reading, block by block": lambda: read(text.splitlines(keepends=True)),
            "planning": lambda: plan_once(points, UnitTime.MS_2, 50.0),
            "records of increments": lambda: encode(travel, layout),
            "the whole": lambda: encode_file(source, out, encoding, force=True),
        }
        rows = [[what, spread(rates(stage), ",.0f")] for what, stage in work.items()]
    return table(["stage", "moves/s"], rows)


def read(text: list[str]) -> int:
    return sum(len(piece) for piece in NcReader(text, Reading(axes=("X", "Y", "Z"))).moves())


def rates(work: Callable[[], object]) -> list[float]:
    found = []
    for _ in range(RUNS):
        began = time.process_time()
        work()
        found.append(MOVES / (time.process_time() - began))
    return found


def main() -> None:
    points = finishing_points(MOVES, 2)
    text = ABOUT.format(
        runs=RUNS,
        moves=MOVES,
        speeds=speeds(points),
        profile=profile(points),
        stages=stages(points),
        endless=ENDLESS,
        **dict(zip(("records", "before", "after"), endless(), strict=True)),
    )
    write_section("g05-plan", "Planning binary input operation", text)


if __name__ == "__main__":
    main()
