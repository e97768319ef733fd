"""A real program planned and run in simulated time, every claim checked by means of its own.

python -m benchmarks.g05_run          100,000 moves, into docs/reliability.md; about ten minutes
"""

from __future__ import annotations

import io
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import write_section
from tapewire.engine import SECOND
from tapewire.g05.layout import Layout, UnitTime
from tapewire.g05.limits import Axis, Machine, Planning
from tapewire.g05.plan import Plan, Report
from tapewire.g05.records import encode
from tapewire.nc.reader import NcReader, Reading
from tapewire.sim.world import World
from tests.g05.geometry import farthest, in_between
from tests.g05.programs import finishing

__all__ = ["Run", "run"]

PAGE: Final = Path(__file__).parent.parent / "docs" / "reliability.md"
MOVES: Final = 100_000
BAUD: Final = 86_400
UART_REPORTS: Final = 14
"""Characters the control's UART reports at once."""

MACHINE: Final = Machine(
    axes=tuple(Axis(name=name, velocity_per_min=12_000, acceleration=2000, jerk=50_000) for name in "XYZ")
)
PLANNING: Final = Planning(machine=MACHINE, layout=Layout(axis_count=3), unit_time=UnitTime.MS_2, tolerance=0.01)


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """`beyond` is how far velocity, acceleration and jerk go beyond limit and rounding at most, in increments per unit
    time, squared and cubed; 0 and less is within. `farthest` is the largest distance of a position, or of the middle
    between two, from the path; `corners` that of a corner of the path from the motion.
    """

    moves: int
    records: int
    seconds: float
    ideal_s: float
    planned_s: float
    records_executed: int
    interruptions: int
    off_the_end: list[int]
    beyond: tuple[float, float, float]
    farthest: float
    corners: float
    tolerance: float
    outcome: str
    byte_count: int
    simulated_s: float


def run(moves: int) -> Run:
    """Text, plan, records, line, control. Everything is judged by the increments that the control has summed up."""
    reader = NcReader(["".join(f"{line}\n" for line in finishing(moves))], Reading(axes=("X", "Y", "Z")))
    began = time.perf_counter()
    path = list(reader.moves())
    plan = Plan(PLANNING, np.array(reader.start))
    travel = np.concatenate(list(plan.travel(path)))
    planned_s = time.perf_counter() - began
    points = np.concatenate([[reader.start], *(block.ends for block in path)])
    header = "".join(f"{line}\n" for line in reader.header)
    records = encode(travel, PLANNING.layout).tobytes() + PLANNING.layout.exit_record
    program = f"%\n{header}G05\n".encode() + records + b"M30\n%"
    world = World()
    pair = world.pair(
        "fanuc-b-expansion", baud=BAUD, settings={"g05": "3,2ms"}, grain=UART_REPORTS, cnc_window=UART_REPORTS
    )
    pair.host.start(io.BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None and pair.control.idle)
    control = pair.control.binary
    assert control is not None
    assert pair.host_end is not None
    target = np.rint((points[-1] - points[0]) * 1000).astype(int)
    positions = (np.rint(points[0] * 1000) + np.concatenate([[[0, 0, 0]], np.cumsum(travel, axis=0)])) / 1000
    return Run(
        moves=plan.report.moves,
        records=len(travel),
        seconds=len(travel) * PLANNING.tick_s,
        ideal_s=sum(_ideal(block.ends, block.speeds) for block in path),
        planned_s=planned_s,
        records_executed=control.records_executed,
        interruptions=control.interruptions,
        off_the_end=(np.array(control.position) - target).tolist(),
        beyond=_beyond(travel, plan.report),
        farthest=farthest(in_between(positions), points, PLANNING.tolerance),
        corners=farthest(points, positions, PLANNING.tolerance),
        tolerance=PLANNING.tolerance,
        outcome=str(pair.host_end.outcome),
        byte_count=len(program),
        simulated_s=world.now / SECOND,
    )


def _ideal(ends: NDArray[np.float64], speeds: NDArray[np.float64]) -> float:
    """Seconds of the moves at their feeds, were there no acceleration; rapids at the velocity of the axes."""
    lengths = np.sqrt((np.diff(ends, axis=0) ** 2).sum(axis=1))
    return float((lengths / np.minimum(speeds[1:], 200.0)).sum())


def _beyond(travel: NDArray[np.int64], report: Report) -> tuple[float, float, float]:
    """Half an increment of rounding makes up to 0, 2 and 4; twice that beside a unit of time left out or filled in."""
    rest = np.zeros((3, 3), np.int64)
    steps = np.concatenate([rest, travel, rest])
    found = []
    for order, (limit, noise) in enumerate(
        zip((MACHINE.velocity, MACHINE.acceleration, MACHINE.jerk), (0, 2, 4), strict=True)
    ):
        over = np.abs(np.diff(steps, order, axis=0)) - limit * PLANNING.tick_s ** (order + 1) * 1000
        over = np.sort(over.max(axis=1))
        allowed = 4 * (report.left_out + report.moved_ahead)
        found.append(max(float(over[-1]) - 2 * noise, float(over[-1 - allowed]) - noise))
    return found[0], found[1], found[2]


ABOUT: Final = """
A ball cutter over a free-form surface, {moves:,} moves of about 0.3 mm at 3000 mm/min from a seed, three axes with
12 m/min, 2000 mm/s² and 50,000 mm/s³, tolerance 0.01 mm: read from its text, planned for 2 ms, and streamed over
expansion B at 86400 baud to the simulated control, which executes {records:,} records ({byte_count:,} bytes) at their
unit time.

| what | found | allowed |
|---|---|---|
| interruptions of the pulse distribution | {interruptions} | 0 |
| records executed | {records_executed:,} | {records:,} |
| end position, increments off in X, Y, Z | {off_the_end} | 0 |
| farthest position, or middle between two, from the path | {farthest:.4f} mm | {tolerance} mm |
| farthest corner of the path from the motion | {corners:.4f} mm | {tolerance} mm |
| velocity, acceleration, jerk beyond limit and rounding, increments | {beyond} | none above 0 |
| job | {outcome} | complete |

Distances are found with nothing of the planner, every position against every straight piece near it. Motion:
{seconds:.1f} s, of which the moves at their feeds without any acceleration would take {ideal_s:.1f}; in simulated time
{simulated_s:.1f} s from the first character to the last record.
`python -m benchmarks.g05_run`; 5,000 moves of it run with every test.
"""


def main() -> None:
    done = run(int(sys.argv[1]) if len(sys.argv) > 1 else MOVES)
    fields = {name: getattr(done, name) for name in Run.__dataclass_fields__}
    fields["beyond"] = ", ".join(f"{value:.1f}" for value in done.beyond)
    fields["off_the_end"] = ", ".join(str(value) for value in done.off_the_end)
    write_section("binary-input-operation", "Binary input operation", ABOUT.format(**fields), PAGE)


if __name__ == "__main__":
    main()
