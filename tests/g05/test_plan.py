"""The planner: limits in every unit of time, the path within the tolerance, the end to the increment."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tapewire.errors import ProgramError, UsageError
from tapewire.g05.layout import IncrementSystem, Layout, RecordFormat, Unit, UnitTime
from tapewire.g05.limits import Axis, Machine, Planning
from tapewire.g05.path import BLOCK_MOVES, Moves, blocks_of
from tapewire.g05.plan import Plan, Report
from tests.g05.geometry import farthest, in_between
from tests.g05.programs import finishing_points

Travel = NDArray[np.int64]


def planning_of(axis_count: int = 3, **words: Any) -> Planning:
    axis = {key: words.pop(key) for key in ("velocity_per_min", "acceleration", "jerk", "unit") if key in words}
    increments = words.pop("increments", IncrementSystem.IS_B)
    limits = {"velocity_per_min": 12_000.0, "acceleration": 2000.0, "jerk": 50_000.0, **axis}
    axes = tuple(Axis(name=name, **limits) for name in "XYZABCUVW"[:axis_count])
    form = words.pop("format", RecordFormat.SPECIAL)
    return Planning(
        machine=Machine(axes=axes, increments=increments),
        layout=Layout(axis_count=axis_count, format=form),
        **{"unit_time": UnitTime.MS_2, "tolerance": 0.01, **words},
    )


def planned(planning: Planning, points: NDArray[np.float64], speeds: Any = 50.0) -> tuple[Travel, Report]:
    plan = Plan(planning, points[0])
    feeds = np.broadcast_to(np.asarray(speeds, np.float64), (len(points) - 1,))
    pieces = [Moves(ends=points[at : at + 1000], speeds=feeds[at - 1 : at + 999]) for at in range(1, len(points), 1000)]
    return np.concatenate(list(plan.travel(pieces))), plan.report


def keeps_limits(planning: Planning, travel: Travel, report: Report) -> None:
    """Every unit of time, from rest to rest. Rounding moves a position by half an increment: the travel by less than
    one, its change by less than two, the change of that by less than four; twice as much beside a unit of time that was
    left out or filled in advance.
    """
    machine, tick = planning.machine, planning.tick_s
    rest = np.zeros((3, travel.shape[1]), np.int64)
    steps = np.concatenate([rest, travel, rest])
    limits = (machine.velocity, machine.acceleration, machine.jerk)
    pauses = report.left_out + report.moved_ahead
    for order, (limit, noise) in enumerate(zip(limits, (0, 2, 4), strict=True)):
        beyond = np.abs(np.diff(steps, order, axis=0)) - limit * tick ** (order + 1) * machine.per_unit
        assert beyond.max() <= 2 * noise + 1e-6, f"order {order}: {beyond.max()} increments"
        assert (beyond.max(axis=1) > noise + 1e-6).sum() <= 4 * pauses, f"order {order}: too often"
    assert travel.any(axis=1).all(), "a record without motion"


def keeps_path(planning: Planning, travel: Travel, points: NDArray[np.float64]) -> None:
    per_unit = planning.machine.per_unit
    start = np.rint(points[0] * per_unit)
    positions = (np.concatenate([start[None], start + np.cumsum(travel, axis=0)])) / per_unit
    assert (positions[-1] == np.rint(points[-1] * per_unit) / per_unit).all(), "not at the end"
    tolerance = planning.tolerance
    assert farthest(in_between(positions), points, tolerance) <= tolerance
    assert farthest(points, positions, tolerance) <= tolerance, "a corner was cut off"


SQUARE: Final = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [0, 0, 0]], np.float64)
ANGLES: Final = np.linspace(0, 2 * np.pi, 721)
CIRCLE: Final = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


@pytest.mark.parametrize("unit_time", UnitTime)
@pytest.mark.parametrize("tolerance", [0.005, 0.05])
def test_a_square(unit_time: UnitTime, tolerance: float) -> None:
    planning = planning_of(unit_time=unit_time, tolerance=tolerance)
    travel, report = planned(planning, SQUARE)
    keeps_limits(planning, travel, report)
    keeps_path(planning, travel, SQUARE)
    assert report.contour_error <= tolerance


@pytest.mark.parametrize(
    ("points", "speed"),
    [
        (np.array([[0, 0, 0], [10, 0, 0], [0, 0, 0], [10, 0, 0]], np.float64), 50.0),
        (np.array([[0.0], [10.0], [0.0], [0.5], [0.1]]), 80.0),
        (CIRCLE * 10, 100.0),
        (CIRCLE, 100.0),
        (np.array([[0.0, 0.0], [0.002, 0.0]]), 10.0),
        (np.array([[0.0, 0.0], [300.0, 1.0]]), np.inf),
        (np.round(np.cumsum(np.random.default_rng(4).normal(size=(60, 5)), axis=0), 3), 60.0),
    ],
    ids=["spikes", "one axis", "circle", "small circle", "two increments", "rapid", "five axes"],
)
def test_paths_that_are_hard(points: NDArray[np.float64], speed: float) -> None:
    planning = planning_of(points.shape[1])
    travel, report = planned(planning, points, speed)
    keeps_limits(planning, travel, report)
    keeps_path(planning, travel, points)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    moves=st.integers(1, 60),
    axis_count=st.integers(1, 4),
    unit_time=st.sampled_from(UnitTime),
    tolerance=st.sampled_from([0.004, 0.01, 0.1]),
    acceleration=st.sampled_from([300.0, 2000.0, 20_000.0]),
    jerk=st.sampled_from([5000.0, 50_000.0, 1_000_000.0]),
)
def test_any_path(
    seed: int,
    moves: int,
    axis_count: int,
    unit_time: UnitTime,
    tolerance: float,
    acceleration: float,
    jerk: float,
) -> None:
    random = np.random.default_rng(seed)
    sizes = 10.0 ** random.uniform(-2, 1, (moves + 1, 1))
    steps: NDArray[np.float64] = random.normal(size=(moves + 1, axis_count)) * sizes
    points = np.rint(1000 * np.cumsum(steps, axis=0)) / 1000
    points[1:][(points[1:] == points[:-1]).all(axis=1)] += 0.001
    planning = planning_of(axis_count, unit_time=unit_time, tolerance=tolerance, acceleration=acceleration, jerk=jerk)
    travel, report = planned(planning, points, random.uniform(2, 150, moves))
    keeps_limits(planning, travel, report)
    keeps_path(planning, travel, points)


def test_a_path_longer_than_the_look_ahead_is_planned_as_one() -> None:
    """Cut into blocks, the plan keeps everything at their borders too, and the speed does not drop there."""
    points = finishing_points(3 * BLOCK_MOVES, 2)
    planning = planning_of()
    travel, report = planned(planning, points)
    keeps_limits(planning, travel, report)
    assert report.moves == 3 * BLOCK_MOVES
    assert report.contour_error <= planning.tolerance
    speed = np.sqrt((travel.astype(float) ** 2).sum(axis=1)) / 1000 / planning.tick_s
    assert (speed < 0.5).sum() < 50, "it stops on its way"


def test_the_plan_does_not_depend_on_how_the_moves_come() -> None:
    points = finishing_points(2000, 3)
    one, _ = planned(planning_of(), points)
    plan = Plan(planning_of(), points[0])
    single = (Moves(ends=points[at : at + 1], speeds=np.array([50.0])) for at in range(1, len(points)))
    assert np.array_equal(np.concatenate(list(plan.travel(single))), one)


@pytest.mark.parametrize("system", IncrementSystem)
@pytest.mark.parametrize("unit", Unit)
def test_every_increment_system(system: IncrementSystem, unit: Unit) -> None:
    scale = 1 / 25.4 if unit is Unit.INCH else 1.0
    limits = {
        name: value * scale for name, value in (("velocity_per_min", 600.0), ("acceleration", 500.0), ("jerk", 5000.0))
    }
    planning = planning_of(
        2,
        increments=system,
        unit=unit,
        unit_time=UnitTime.MS_8,
        tolerance=0.1 * scale,
        format=RecordFormat.GENERAL,
        **limits,
    )
    per_unit = system.per_unit(unit)
    points = np.rint(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 0.0]]) * scale * per_unit) / per_unit
    travel, report = planned(planning, points, 8.0 * scale)
    keeps_limits(planning, travel, report)
    keeps_path(planning, travel, points)


def test_a_rotary_axis_counts_like_a_linear_one() -> None:
    axes = (Axis(name="X"), Axis(name="C", unit=Unit.DEGREE, velocity_per_min=3600, acceleration=500, jerk=8000))
    planning = Planning(
        machine=Machine(axes=axes), layout=Layout(axis_count=2), unit_time=UnitTime.MS_8, tolerance=0.02
    )
    points = np.array([[0.0, 0.0], [5.0, 90.0], [5.0, 180.0], [0.0, 0.0]])
    travel, report = planned(planning, points, 30.0)
    keeps_limits(planning, travel, report)
    keeps_path(planning, travel, points)


def endless(count: int) -> Iterator[Moves]:
    """The same ten thousand moves again and again, there and back."""
    points = finishing_points(10_000, 5)
    there, back = points[1:], points[-2::-1]
    speeds = np.full(len(there), 50.0)
    for ends, _ in zip(itertools.cycle((there, back)), range(count), strict=False):
        yield Moves(ends=ends, speeds=speeds)


def test_memory_does_not_grow_with_the_program() -> None:
    plan = Plan(planning_of(), finishing_points(10_000, 5)[0])
    travel = plan.travel(endless(24))
    peaks = []
    tracemalloc.start()
    try:
        for _ in range(4):
            tracemalloc.reset_peak()
            for _ in range(2):
                next(travel)
            peaks.append(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()
    assert max(peaks[1:]) < 1.5 * peaks[0] + 1_000_000
    assert max(peaks) < 200_000_000


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ({"tolerance": 0.001}, "less than two increments"),
        ({"tolerance": -1.0}, "it is above 0"),
        ({"smoothing_ticks": 1}, "2 to 512"),
        ({"smoothing_ticks": 512, "unit_time": UnitTime.MS_4}, "1 s is the most"),
        ({"jerk": 0.0}, "its jerk limit is 0"),
        ({"acceleration": float("nan")}, "its acceleration limit is nan"),
    ],
)
def test_plans_that_are_none(words: dict[str, Any], what: str) -> None:
    with pytest.raises(UsageError, match=what):
        planning_of(**words)


def test_increments_that_are_too_coarse_are_refused() -> None:
    with pytest.raises(ProgramError, match=r"axis X may travel 1\.00 increments per unit time"):
        Plan(planning_of(velocity_per_min=60.0, unit_time=UnitTime.MS_1), np.zeros(3))


def test_a_feed_below_an_increment_per_unit_time_is_refused() -> None:
    """0.4 mm/s are 0.8 increments in 2 ms: every fifth record would be empty, and an empty record ends the section."""
    with pytest.raises(ProgramError, match=r"at 24 a minute is slower than one increment .* \(30 a minute\)"):
        planned(planning_of(1), np.array([[0.0], [1.0]]), 0.4)


def test_the_range_of_the_records_is_a_limit_too() -> None:
    """IS-D in special format: 8191 increments of 0.00001 mm per 2 ms are 2.4 m/min, whatever the axis could do."""
    planning = planning_of(1, increments=IncrementSystem.IS_D)
    travel, _ = planned(planning, np.array([[0.0], [100.0]]), np.inf)
    assert 8100 < np.abs(travel).max() <= 8191


@pytest.mark.parametrize("end", [np.nan, np.inf, 1e7])
def test_positions_that_are_none_are_named(end: float) -> None:
    plan = Plan(planning_of(1), np.zeros(1))
    moves = [Moves(ends=np.array([[1.0], [end]]), speeds=np.array([1.0, 1.0]))]
    with pytest.raises(ProgramError, match="move 2: position"):
        list(plan.travel(moves))


def test_nothing_to_do_makes_no_record() -> None:
    travel, report = planned(planning_of(1), np.zeros((3, 1)))
    assert (len(travel), report.records) == (0, 0)


def test_steps_too_short_for_a_move_add_up() -> None:
    """A hundred thousand steps of half a thousandth of an increment are fifty increments, and a curve at that."""
    angles = np.linspace(0, np.pi / 2, 100_001)
    points = np.column_stack([np.sin(angles), 1 - np.cos(angles), 0 * angles]) * 0.05 / (np.pi / 2)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 1e-3 / 1000
    planning = planning_of(unit_time=UnitTime.MS_16)
    travel, _ = planned(planning, points, 1.0)
    assert travel.sum(axis=0).tolist() == np.rint(points[-1] * 1000).astype(int).tolist()
    blocks = list(blocks_of([Moves(ends=points[1:], speeds=np.full(100_000, 1.0))], points[0], 1e-6))
    assert sum(map(len, blocks)) > 30_000


@pytest.mark.parametrize("start", [0.0, 0.0004999, -2.0004999])
@pytest.mark.parametrize("way", [0.0000002, -0.0000002, 1.0000002, 0.9999998])
def test_the_end_is_exact_to_the_increment(start: float, way: float) -> None:
    """Where it lies beside the half of an increment, and the last step is too short to be planned."""
    points = np.array([[start, 0, 0], [start + round(way), 0, 0], [start + way, 0, 0]])
    travel, _ = planned(planning_of(), points)
    ends = np.rint(points[[0, -1]] * 1000).astype(int)
    assert (travel.sum(axis=0) == ends[1] - ends[0]).all()


def test_a_move_of_many_units_of_time_is_planned_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the path it is: exact at its end, within every limit, in little memory."""
    planning = planning_of(unit_time=UnitTime.MS_1)
    points = np.array([[0, 0, 0], [10_000.0, 1.0, 0], [10_000, 2.0, 3.0]])
    tracemalloc.start()
    try:
        monkeypatch.setattr("tapewire.g05.profile.MOST_TICKS", 1 << 13)
        monkeypatch.setattr("tapewire.g05.plan.LONGEST_PIECE_TICKS", 1 << 9)
        plan = Plan(planning, points[0])
        moves = [Moves(ends=points[1:], speeds=np.full(2, 100.0))]
        travel = np.concatenate([piece.astype(np.int16) for piece in plan.travel(moves)])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(travel) > 100_000
    assert peak < 5_000_000, peak
    assert (travel.sum(axis=0, dtype=int) == points[-1] * 1000).all()
    keeps_limits(planning, travel.astype(int), plan.report)
    positions = np.cumsum(travel, axis=0, dtype=int) / 1000
    assert farthest(positions[::97], points, planning.tolerance) <= planning.tolerance
    assert farthest(points[1:], positions[-1000:], planning.tolerance) <= planning.tolerance


def test_a_move_that_lasts_a_day_is_refused() -> None:
    with pytest.raises(ProgramError, match="takes 33 hours: no program means that"):
        planned(planning_of(), np.array([[0, 0, 0], [999_999.0, 0, 0]]), 8.333)
