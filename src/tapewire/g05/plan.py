"""From a path to the records of binary input operation: look-ahead, smoothing, rounding, in pieces of bounded size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.g05.contour import beyond_limits, chord_errors, contour_errors
from tapewire.g05.corners import Bounds, corner_speeds
from tapewire.g05.limits import Floats, Planning
from tapewire.g05.path import BLOCK_MOVES, FARTHEST, Moves, Path, blocks_of
from tapewire.g05.profile import Samples, sample, sweep
from tapewire.g05.quantise import Quantiser
from tapewire.g05.smoothing import smooth

__all__ = ["Plan", "Report"]

SLOWER: Final = 0.8
"""A place that breaks a limit is taken slower by this, again and again; what the sums foresee seldom needs it."""

MOST_ROUNDS: Final = 40
"""0.8^40 is a ten-thousandth: a place that is still wrong then is wrong by its nature."""

LONGEST_PIECE_TICKS: Final = 1 << 14
"""Longer moves are planned in pieces."""

LONGEST_MOVE_S: Final = 24 * 3600.0
"""No move lasts a day; a forgotten decimal point makes one that does."""

BENT: Final = 0.02
"""Corners that change the direction by more than this (in length of the difference, one degree) are looked at
themselves: their tips might be missed with no point far from the path."""


@dataclass(slots=True, kw_only=True)
class Report:
    """What a plan came to. Peaks are by axis, in units, of the exact motion."""

    moves: int = 0
    records: int = 0
    path_length: float = 0.0
    contour_error: float = 0.0
    """Largest distance from the path, rounding included."""
    velocity: Floats = field(default_factory=lambda: np.zeros(0))
    acceleration: Floats = field(default_factory=lambda: np.zeros(0))
    jerk: Floats = field(default_factory=lambda: np.zeros(0))
    slowed: int = 0
    """Times a block of moves was planned again because a place in it broke a limit."""
    left_out: int = 0
    moved_ahead: int = 0


@dataclass(slots=True)
class _Attempt:
    """Moves planned at certain speeds, as far as they are settled, of which the first `moves` and `ticks` go out."""

    entry: float
    """Speed at the end of those that go out."""
    moves: int
    ticks: int
    first_s: float
    raw: Floats
    raw_moves: NDArray[np.intp]
    points: Floats
    slower: NDArray[np.bool_]
    error: float
    peaks: list[Floats]


class Plan:
    """Plans the moves handed to `travel`, from `start` (units). `report` is complete when that has ended."""

    def __init__(self, planning: Planning, start: Floats) -> None:
        if not (np.abs(start) <= FARTHEST).all():
            raise ProgramError(
                f"the axes stand at {start.tolist()} before the first move: positions are finite and below a million"
            )
        machine, tick = planning.machine, planning.tick_s
        self.planning = planning
        self.report = Report()
        self._ticks, self._tick_s = planning.ticks, tick
        self._per_unit = machine.per_unit
        self._rounding = float(np.linalg.norm(0.5 / self._per_unit) + 0.5 / self._per_unit.min())
        self._tolerance = planning.tolerance - self._rounding
        if self._tolerance <= 0.2 * planning.tolerance:
            raise ProgramError(
                f"a path tolerance of {planning.tolerance:g} leaves nothing for the motion: rounding to increments "
                f"takes {self._rounding:g}"
            )
        self._bounds = Bounds.of(planning, self._tolerance)
        self._velocity = self._slowest_limit(planning)
        self._limits = (
            self._velocity * tick * (1 + 1e-9),
            machine.acceleration * tick**2 * (1 + 1e-6),
            machine.jerk * tick**3 * (1 + 1e-5),
        )
        self._behind = Path.empty(len(start))
        self._pending = Path.empty(len(start))
        self._slow = np.ones(0)
        """By how much each pending move is slower than the sums would have it."""
        self._entry, self._first_s = 0.0, tick
        self._raw = np.repeat(start[:, None], 2 * self._ticks - 2, axis=1)
        self._raw_moves = np.zeros(2 * self._ticks - 2, np.intp)
        self._out = np.repeat(start[:, None], 3 + self._ticks, axis=1)
        self._quantiser = Quantiser(np.rint(start * self._per_unit).astype(np.int64))
        self._peaks = [np.zeros(len(start)) for _ in range(3)]
        self._end = start

    def _slowest_limit(self, planning: Planning) -> Floats:
        """One increment per unit time is kept free, so that rounding breaks no limit; nor does a record's range."""
        machine = planning.machine
        room = np.minimum(machine.velocity * planning.tick_s * self._per_unit, planning.layout.travel_limits[1]) - 1
        if room.min() < 2:
            axis = machine.names[int(np.argmin(room))]
            raise ProgramError(
                f"axis {axis} may travel {room.min() + 1:.2f} increments per unit time: too coarse to plan with; "
                "take a longer unit time or a finer increment system"
            )
        limit: Floats = room / (planning.tick_s * self._per_unit)
        return limit

    def travel(self, moves: Iterable[Moves]) -> Iterator[NDArray[np.int64]]:
        """(records, axes) of increments, piece by piece. Raises ProgramError for what cannot be planned."""
        shortest = 1e-3 / float(self._per_unit.max())
        start = self._raw[:, -1].copy()
        self._end = start
        for block in blocks_of(self._watched(moves), start, shortest):
            self._refuse_creeping(block)
            self.report.moves += len(block)
            self.report.path_length += float(block.lengths.sum())
            for part in self._in_pieces(block):
                self._pending = self._pending.joined(part)
                self._slow = np.concatenate([self._slow, np.ones(len(part))])
                while len(self._pending) >= 2 * BLOCK_MOVES:
                    yield self._quantised(self._advance(last=False))
        while len(self._pending):
            yield self._quantised(self._advance(last=len(self._pending) < 2 * BLOCK_MOVES))
        yield self._counted(self._quantiser.finish(self._end * self._per_unit))
        self._close()

    def _watched(self, moves: Iterable[Moves]) -> Iterator[Moves]:
        """Where they end, moves too short to be planned included."""
        for block in moves:
            if len(block):
                self._end = block.ends[-1]
            yield block

    def _refuse_creeping(self, path: Path) -> None:
        """A feed below an increment per unit time would need units of time without motion."""
        creeping = self._creeping(path)
        slow = np.flatnonzero(path.speeds < creeping * (1 - 1e-9))
        if len(slow):
            index = int(slow[0])
            raise ProgramError(
                f"the move to {np.round(path.ends[index], 4).tolist()} at {path.speeds[index] * 60:.4g} a minute is "
                f"slower than one increment per unit time ({creeping[index] * 60:.4g} a minute): records "
                "without motion cannot be sent; take a longer unit time or a finer increment system"
            )

    def _in_pieces(self, path: Path) -> Iterator[Path]:
        """Moves of many units of time are cut up, so that what is planned at once is bounded. Refuses endless ones."""
        fastest = self._fastest(path)
        accelerations = self._bounds.accelerations(path)
        seconds = path.lengths / fastest + 2 * np.sqrt(path.lengths / accelerations)
        if seconds.max() > LONGEST_MOVE_S:
            index = int(np.argmax(seconds))
            raise ProgramError(
                f"the move to {np.round(path.ends[index], 4).tolist()} takes {seconds[index] / 3600:,.0f} hours: no "
                "program means that; look for a missing decimal point, or a feed or a limit that is too low"
            )
        counts = np.ceil(seconds / (LONGEST_PIECE_TICKS * self._tick_s)).astype(np.int64)
        return iter([path]) if counts.max() == 1 else path.in_pieces(counts)

    def _quantised(self, points: Floats) -> NDArray[np.int64]:
        return self._counted(self._quantiser.travel(points * self._per_unit[:, None]))

    def _counted(self, travel: NDArray[np.int64]) -> NDArray[np.int64]:
        self.report.records += len(travel)
        return travel

    def _close(self) -> None:
        report, tick = self.report, self._tick_s
        report.velocity, report.acceleration, report.jerk = (
            peak / tick**order for order, peak in enumerate(self._peaks, 1)
        )
        report.contour_error = report.contour_error + self._rounding if report.records else 0.0
        report.left_out, report.moved_ahead = self._quantiser.left_out, self._quantiser.moved_ahead

    def _advance(self, *, last: bool) -> Floats:
        """Plan what is pending, settle as much of it as no later move can change, and smooth it."""
        path = self._pending
        fastest = self._fastest(path)
        around = self._behind.joined(path)
        gains = self._bounds.accelerations(around)
        accelerations = gains[len(self._behind) :]
        speeds_around = np.concatenate([self._fastest(self._behind), fastest])
        corners = corner_speeds(around, self._bounds, speeds_around, gains)[len(self._behind) :]
        corners = np.maximum(corners, self._creeping(path)[1:])
        seen = len(path) if last else self._seen(path, fastest, accelerations)
        for _ in range(MOST_ROUNDS):
            attempt = self._attempt(around, path, seen, corners, fastest, accelerations, last)
            if not attempt.slower.any():
                return self._settle(around, path, attempt)
            self._slow = np.where(attempt.slower, self._slow * SLOWER, self._slow)
            self.report.slowed += 1
        where = path.ends[int(np.argmax(attempt.slower))]
        raise ProgramError(
            f"no speed is slow enough near {np.round(where, 4).tolist()}: widen the tolerance or the limits"
        )

    def _fastest(self, path: Path) -> Floats:
        with np.errstate(divide="ignore"):
            axes: Floats = (self._velocity / np.abs(path.directions)).min(axis=1) if len(path) else path.lengths
        return np.minimum(path.speeds, axes)

    def _creeping(self, path: Path) -> Floats:
        """The speed at which the fastest axis travels one increment per unit time: below, records would be empty."""
        creeping: Floats = 1 / ((np.abs(path.directions) * self._per_unit).max(axis=1) * self._tick_s)
        return creeping

    def _seen(self, path: Path, fastest: Floats, accelerations: Floats) -> int:
        """How many moves have all their neighbourhood in sight; the rest waits for what follows."""
        reach = float(fastest.max()) * self._bounds.span_s + float(accelerations.max()) * self._bounds.span_s**2
        along = np.cumsum(path.lengths)
        return max(int(np.searchsorted(along, along[-1] - reach)), len(path) // 2)

    def _attempt(
        self,
        around: Path,
        path: Path,
        seen: int,
        corners: Floats,
        fastest: Floats,
        accelerations: Floats,
        last: bool,
    ) -> _Attempt:
        slow = self._slow[:seen]
        accelerations = accelerations[:seen] * slow**2
        speeds = sweep(
            path.part(0, seen), corners[: seen - 1] * np.minimum(slow[:-1], slow[1:]), accelerations, self._entry
        )
        settled = seen if last else max(speeds.settled, 1)
        samples = sample(
            path.part(0, settled),
            speeds.at[: settled + 1],
            fastest[:settled] * slow[:settled],
            accelerations[:settled],
            self._tick_s,
            self._first_s,
        )
        last = last and len(samples.begins_s) > settled
        settled = len(samples.begins_s) - 1
        moves, ticks = (settled, samples.points.shape[1]) if last else self._going_out(samples, settled)
        raw = np.concatenate([self._raw, samples.points], axis=1)
        raw_moves = np.concatenate([self._raw_moves, samples.moves + len(self._behind)])
        if last:
            rest = 2 * self._ticks
            ticks += rest
            raw = np.concatenate([raw, np.repeat(path.ends[-1][:, None], rest, axis=1)], axis=1)
            raw_moves = np.concatenate([raw_moves, np.full(rest, len(around) - 1)])
        points = smooth(raw, self._ticks)
        wrong, error, peaks = self._judge(points, raw_moves, around)
        return _Attempt(
            entry=0.0 if last else float(speeds.at[moves]),
            moves=moves,
            ticks=ticks,
            first_s=self._first_s + ticks * self._tick_s - float(samples.begins_s[moves]),
            raw=raw,
            raw_moves=raw_moves,
            points=points,
            slower=self._moves_of(wrong, raw_moves, len(self._behind), len(path)),
            error=error,
            peaks=peaks,
        )

    def _going_out(self, samples: Samples, settled: int) -> tuple[int, int]:
        """(moves, ticks) that no later move can change, smoothing included: what is judged about them is final."""
        total = samples.points.shape[1]
        moves = int(samples.moves[total - 2 * self._ticks]) if total > 2 * self._ticks else 0
        if not moves:
            return settled, total
        return moves, int(np.searchsorted(samples.moves, moves))

    def _moves_of(
        self, wrong: NDArray[np.bool_], moves: NDArray[np.intp], behind: int, count: int
    ) -> NDArray[np.bool_]:
        """The moves that a wrong point is made of, and those beside them."""
        marks = np.zeros(count + 1, np.int64)
        at = np.flatnonzero(wrong)
        first = np.clip(moves[at] - behind - 1, 0, count)
        last = np.clip(moves[at + 2 * self._ticks - 2] - behind + 2, 0, count)
        np.add.at(marks, first, 1)
        np.add.at(marks, last, -1)
        marked: NDArray[np.bool_] = np.cumsum(marks)[:-1] > 0
        if len(at) and not marked.any():
            marked[:1] = True
        return marked

    def _judge(
        self, points: Floats, moves: NDArray[np.intp], around: Path
    ) -> tuple[NDArray[np.bool_], float, list[Floats]]:
        """Which points break a limit of the axes or the tolerance."""
        with_before = np.concatenate([self._out[:, -3:], points], axis=1)
        wrong, peaks = beyond_limits(with_before, self._limits)
        if not points.shape[1]:
            return wrong, 0.0, peaks
        span = 2 * self._ticks - 2
        middle = moves[self._ticks - 1 : len(moves) - self._ticks + 1]
        first, last = moves[: len(moves) - span], moves[span:]
        errors = contour_errors(points, around, middle, first, last, self._tolerance)
        turning = np.flatnonzero(first[:-1] != last[1:])
        halfway = (points[:, turning] + points[:, turning + 1]) / 2
        halfway_errors = contour_errors(
            halfway, around, middle[turning], first[turning], last[turning + 1], self._tolerance
        )
        wrong |= errors > self._tolerance
        wrong[turning] |= halfway_errors > self._tolerance
        error = max(float(errors.max()), float(halfway_errors.max(initial=0.0)))
        tips, missed = self._missed(points, moves, around)
        wrong[tips[missed > self._tolerance]] = True
        return wrong, max(error, float(missed.max(initial=0.0))), peaks

    def _missed(self, points: Floats, moves: NDArray[np.intp], around: Path) -> tuple[NDArray[np.intp], Floats]:
        """Of the corners passed by now: the point nearest to each in time, and how far the motion stays off."""
        turns = np.diff(around.directions, axis=0)
        bent = np.flatnonzero(np.einsum("ij,ij->i", turns, turns) > BENT**2) + 1
        at = np.searchsorted(moves, bent) - (self._ticks - 1)
        near = (at >= 0) & (at < points.shape[1] - self._ticks) & (bent > moves[0])
        bent, at = bent[near], at[near]
        if not len(bent):
            return at, np.zeros(0)
        before = np.concatenate([self._out[:, -self._ticks :], points], axis=1)
        missed = chord_errors(before, around.starts[bent].T, at + self._ticks, self._ticks, self._tolerance)
        return np.clip(at, 0, points.shape[1] - 1), missed

    def _settle(self, around: Path, path: Path, attempt: _Attempt) -> Floats:
        """Let go what goes out, and keep of it what the next block needs."""
        report, kept = self.report, 2 * self._ticks - 2
        report.contour_error = max(report.contour_error, attempt.error)
        self._peaks = [np.maximum(old, new) for old, new in zip(self._peaks, attempt.peaks, strict=True)]
        self._entry, self._first_s = attempt.entry, attempt.first_s
        raw_moves = attempt.raw_moves[attempt.ticks : attempt.ticks + kept]
        done = len(self._behind) + attempt.moves
        keep = self._keep_from(around, done, int(raw_moves[0]))
        self._raw = attempt.raw[:, attempt.ticks : attempt.ticks + kept].copy()
        self._raw_moves = raw_moves - keep
        self._behind, self._pending = around.part(keep, done), path.part(attempt.moves)
        self._slow = self._slow[attempt.moves :]
        points = attempt.points[:, : attempt.ticks]
        self._out = np.concatenate([self._out, points], axis=1)[:, -(3 + self._ticks) :].copy()
        return points

    def _keep_from(self, around: Path, done: int, oldest: int) -> int:
        """The first move that a corner still to come may feel, or that a position still to be smoothed lies on."""
        back = np.cumsum(around.lengths[:done][::-1])
        reach = float(self._velocity.max()) * len(self._velocity) ** 0.5 * self._bounds.span_s * 2
        felt = done - 1 - int(np.searchsorted(back, reach))
        return max(0, min(oldest, max(felt, done - BLOCK_MOVES)))
