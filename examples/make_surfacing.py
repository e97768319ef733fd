"""Writes `surfacing.nc`: a freeform surface finished with a ball end mill on a 3-axis machining centre.

It is the kind of program that made people buy a remote buffer: some 240 KB of short moves, more than a
control of that time could hold. The same seed gives the same bytes on every machine, because only operations
that IEEE 754 rounds exactly (+, -, *, /, square root) decide about a coordinate.

    python examples/make_surfacing.py examples/surfacing.nc
"""

from __future__ import annotations

import argparse
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SEED = 1702

LENGTH_MM = 80.0
WIDTH_MM = 60.0
BALL_RADIUS_MM = 5.0
SCALLOP_MM = 0.003
CHORD_TOLERANCE_MM = 0.002

SAMPLES_PER_PASS = 390
"""389 steps: a prime number, so that points do not fall on round values, which no CAM system writes."""

LONGEST_MOVE_MM = 2.0
MOST_STEPS = 60
"""The search for the contact halves its error at each step or better, and needs about four."""

STRIPS = 3
"""The passes are cut in so many strips, with a retract between them."""

CLEARANCE_MM = 50.0
APPROACH_MM = 2.0
CUTTING_MM_PER_MINUTE = 1900
PLUNGE_MM_PER_MINUTE = 400

Point = tuple[float, float]
"""X and Z of the ball's tip in one pass, in mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bump:
    """A hill or a hollow: `height / (1 + (r / width)²)²` round its centre, all in mm."""

    x: float
    y: float
    height: float
    width: float


class Surface:
    """A sum of bumps, gentle enough that the ball touches every place of it."""

    base_mm = -14.0

    def __init__(self, seed: int) -> None:
        rng = random.Random(seed)

        def between(low: float, high: float) -> float:
            return low + (high - low) * rng.random()

        self._bumps = [
            Bump(
                x=between(-0.5, 0.5) * LENGTH_MM,
                y=between(-0.5, 0.5) * WIDTH_MM,
                height=between(-3.0, 7.0),
                width=between(15.0, 25.0),
            )
            for _ in range(6)
        ]

    def height_and_slopes(self, x: float, y: float) -> tuple[float, float, float]:
        z, slope_x, slope_y = self.base_mm, 0.0, 0.0
        for bump in self._bumps:
            dx, dy, square = x - bump.x, y - bump.y, bump.width * bump.width
            q = 1.0 / (1.0 + (dx * dx + dy * dy) / square)
            z += bump.height * q * q
            fall = -4.0 * bump.height * q * q * q / square
            slope_x += fall * dx
            slope_y += fall * dy
        return z, slope_x, slope_y

    def tip_heights(self, y: float) -> list[float]:
        """Z of the ball's tip along the pass at `y`, for every sample of X.

        The ball touches where the surface's normal, one radius long, ends in its centre. That place is found
        by walking there from the last one, which is close.
        """
        heights = []
        off_x = off_y = 0.0
        for x in sample_positions():
            for _ in range(MOST_STEPS):
                z, slope_x, slope_y = self.height_and_slopes(x - off_x, y - off_y)
                up = BALL_RADIUS_MM / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
                moved = abs(off_x + slope_x * up) + abs(off_y + slope_y * up)
                off_x, off_y = -slope_x * up, -slope_y * up
                if moved < 1e-5:
                    break
            heights.append(z + up - BALL_RADIUS_MM)
        return heights


def sample_positions() -> list[float]:
    return [LENGTH_MM * (index / (SAMPLES_PER_PASS - 1) - 0.5) for index in range(SAMPLES_PER_PASS)]


def pass_positions() -> list[float]:
    """Y of every pass: as far apart as the scallop between two passes of the ball allows."""
    widest = 2.0 * math.sqrt(SCALLOP_MM * (2.0 * BALL_RADIUS_MM - SCALLOP_MM))
    count = math.ceil(WIDTH_MM / widest) + 1
    return [WIDTH_MM * (index / (count - 1) - 0.5) for index in range(count)]


def within_tolerance(points: list[Point], first: int, last: int) -> bool:
    (x0, z0), (x1, z1) = points[first], points[last]
    run, rise = x1 - x0, z1 - z0
    limit = CHORD_TOLERANCE_MM * math.sqrt(run * run + rise * rise)
    return all(abs((x - x0) * rise - (z - z0) * run) <= limit for x, z in points[first + 1 : last])


def thinned(points: list[Point]) -> Iterator[Point]:
    """The fewest of `points`, in order and with both ends, that stay within the chord tolerance."""
    yield points[0]
    first = 0
    while first < len(points) - 1:
        last = first + 1
        while (
            last + 1 < len(points)
            and abs(points[last + 1][0] - points[first][0]) <= LONGEST_MOVE_MM
            and within_tolerance(points, first, last + 1)
        ):
            last += 1
        yield points[last]
        first = last


class Blocks:
    """Blocks of a program, in which a word that says nothing new is left out."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._said: dict[str, str] = {}

    def text(self, *lines: str) -> None:
        self.lines += lines

    def move(self, code: str, *, feed: int | None = None, after: str = "", **axes: float) -> None:
        """One motion block; `axes` are absolute positions in mm, `after` ends the block as it stands."""
        words = {"G": code[1:]} | {axis.upper(): format_mm(at) for axis, at in axes.items()}
        if feed is not None:
            words["F"] = f"{feed}."
        new = {letter: value for letter, value in words.items() if self._said.get(letter) != value}
        self._said |= new
        block = "".join(letter + value for letter, value in new.items()) + after
        if block:
            self.lines.append(block)


def format_mm(value: float) -> str:
    # -0.0004 must not become -0.000, which looks like a direction.
    return f"{round(value, 3) + 0.0:.3f}"


def write_head(blocks: Blocks) -> None:
    blocks.text(
        "%",
        "O1702(SURFACE FINISH)",
        "(BALL END MILL R5. - T05 H05)",
        f"(SCALLOP {SCALLOP_MM} - CHORD TOLERANCE {CHORD_TOLERANCE_MM})",
        "(ZERO AT CENTRE OF BLOCK - TOP FACE)",
        "G90G17G21G40G49G80",
        "G91G28Z0.",
        "G90G54",
        "N1T05M06",
        "S9500M03",
    )


def write_tail(blocks: Blocks) -> None:
    blocks.text("M05", "M09", "G91G28Z0.", "G28Y0.", "G90", "M30", "%")


def write_strip(blocks: Blocks, surface: Surface, number: int, ys: list[float]) -> None:
    """One strip: rapid to its corner, down, to and fro with a step-over at each end, up."""
    xs = sample_positions()
    blocks.text(f"(STRIP {number})")
    for index, y in enumerate(ys):
        points = list(thinned(list(zip(xs, surface.tip_heights(y), strict=True))))
        if index % 2:
            points.reverse()
        (x, z), *rest = points
        if index == 0:
            blocks.move("G00", x=x, y=y)
            # The length offset counts from the first strip on; G43 is modal too.
            if number == 1:
                blocks.text(f"G43H05Z{format_mm(CLEARANCE_MM)}M08")
            blocks.move("G00", z=z + APPROACH_MM)
            blocks.move("G01", z=z, feed=PLUNGE_MM_PER_MINUTE)
        else:
            blocks.move("G01", y=y, z=z)
        for x, z in rest:
            blocks.move("G01", x=x, z=z, feed=CUTTING_MM_PER_MINUTE)
    blocks.move("G00", z=CLEARANCE_MM)


def program(seed: int = SEED) -> bytes:
    """The whole program, LF at the end of each block."""
    blocks = Blocks()
    surface = Surface(seed)
    ys = pass_positions()
    write_head(blocks)
    for number in range(1, STRIPS + 1):
        strip = ys[len(ys) * (number - 1) // STRIPS : len(ys) * number // STRIPS]
        write_strip(blocks, surface, number, strip)
    write_tail(blocks)
    return "".join(line + "\n" for line in blocks.lines).encode("ascii")


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the surfacing example.")
    parser.add_argument("file", type=Path, help="where to write it, such as examples/surfacing.nc")
    parser.add_argument("--seed", type=int, default=SEED, help="another seed is another surface (default: %(default)s)")
    arguments = parser.parse_args()
    arguments.file.write_bytes(program(arguments.seed))


if __name__ == "__main__":
    main()
