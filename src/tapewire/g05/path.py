"""A path as straight moves with a speed for each, in blocks of arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.g05.limits import Floats

__all__ = ["BLOCK_MOVES", "FARTHEST", "Moves", "Path", "blocks_of"]

BLOCK_MOVES: Final = 16_384
"""Moves planned at a time: large against the cost of a call, small against any memory."""

FARTHEST: Final = 1e6
"""No axis is longer; beyond it the decimals of a position would suffer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """Straight moves one after the other. `ends` (moves, axes) in units, `speeds` (moves,) in units a second.

    Speeds are those along the path, all axes counted alike; infinity is as fast as the axes can.
    """

    ends: Floats
    speeds: Floats

    def __len__(self) -> int:
        return len(self.ends)


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """A block of moves with what the planner needs of their geometry; none of them has the length 0.

    `starts`, `ends`, `directions` are (moves, axes), `lengths` and `speeds` (moves,).
    """

    starts: Floats
    ends: Floats
    lengths: Floats
    directions: Floats
    speeds: Floats

    def __len__(self) -> int:
        return len(self.lengths)

    def part(self, begin: int, end: int | None = None) -> Path:
        cut = slice(begin, end)
        return Path(
            starts=self.starts[cut],
            ends=self.ends[cut],
            lengths=self.lengths[cut],
            directions=self.directions[cut],
            speeds=self.speeds[cut],
        )

    def joined(self, other: Path) -> Path:
        return Path(
            starts=np.concatenate([self.starts, other.starts]),
            ends=np.concatenate([self.ends, other.ends]),
            lengths=np.concatenate([self.lengths, other.lengths]),
            directions=np.concatenate([self.directions, other.directions]),
            speeds=np.concatenate([self.speeds, other.speeds]),
        )

    def in_pieces(self, counts: NDArray[np.int64]) -> Iterator[Path]:
        """Each move in so many equal pieces one behind the other, in paths of at most `BLOCK_MOVES`."""
        total, ends = int(counts.sum()), np.cumsum(counts)
        for begin in range(0, total, BLOCK_MOVES):
            numbers = np.arange(begin, min(begin + BLOCK_MOVES, total))
            moves = np.searchsorted(ends, numbers, "right")
            done = numbers - (ends - counts)[moves]
            steps = self.directions[moves] * self.lengths[moves, None]
            shares = np.stack([done, done + 1]) / counts[moves]
            starts, stops = self.starts[moves] + steps * shares[..., None]
            last = done + 1 == counts[moves]
            stops[last] = self.ends[moves[last]]
            yield Path(
                starts=starts,
                ends=stops,
                lengths=self.lengths[moves] / counts[moves],
                directions=self.directions[moves],
                speeds=self.speeds[moves],
            )

    @classmethod
    def empty(cls, axis_count: int) -> Path:
        none, nowhere = np.empty(0), np.empty((0, axis_count))
        return cls(starts=nowhere, ends=nowhere, lengths=none, directions=nowhere, speeds=none)


def blocks_of(moves: Iterable[Moves], start: Floats, shortest: float) -> Iterator[Path]:
    """The path of `moves` from `start`. Moves shorter than `shortest` join the next one. Raises ProgramError."""
    here, count = start.astype(np.float64), 0
    for block in moves:
        _refuse_nonsense(block, count)
        count += len(block)
        path, here = _path(block, here, shortest)
        if len(path):
            yield path


def _path(block: Moves, here: Floats, shortest: float) -> tuple[Path, Floats]:
    ends = np.concatenate([here[None], block.ends])
    steps = np.diff(ends, axis=0)
    lengths = np.sqrt(np.einsum("ij,ij->i", steps, steps))
    if lengths.size and lengths.min() < shortest:
        kept = _long_enough(ends, lengths, shortest)
        ends = ends[np.concatenate([[True], kept])]
        steps = np.diff(ends, axis=0)
        lengths = np.sqrt(np.einsum("ij,ij->i", steps, steps))
        speeds = block.speeds[kept]
    else:
        speeds = block.speeds
    directions = steps / lengths[:, None]
    return Path(starts=ends[:-1], ends=ends[1:], lengths=lengths, directions=directions, speeds=speeds), ends[-1]


def _long_enough(ends: Floats, lengths: Floats, shortest: float) -> NDArray[np.bool_]:
    """Which moves are kept: those that are long, and of short ones in a row each that takes the way to `shortest`."""
    kept: NDArray[np.bool_] = lengths >= shortest
    last = 0
    for index in np.flatnonzero(~kept).tolist():
        if not index or kept[index - 1]:
            last = index
        way = ends[index + 1] - ends[last]
        kept[index] = way @ way >= shortest**2
    return kept


def _refuse_nonsense(block: Moves, before: int) -> None:
    wrong = ~np.isfinite(block.ends).all(axis=1) | (np.abs(block.ends) > FARTHEST).any(axis=1) | ~(block.speeds > 0)
    if wrong.any():
        index = int(np.argmax(wrong))
        raise ProgramError(
            f"move {before + index + 1:,}: position {block.ends[index].tolist()} and speed {block.speeds[index]:g} a "
            "second are no move; positions are finite and below a million, speeds above 0"
        )
