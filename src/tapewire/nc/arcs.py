"""Arcs and helices as chords (G02, G03)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from tapewire.errors import ProgramError

__all__ = ["RADIUS_ERROR_MM", "Arc", "chords"]

RADIUS_ERROR_MM: Final = 0.01
"""The radii at both ends of an arc may differ by so much: no control takes much more."""
MOST_CHORDS: Final = 100_000
"""Of one arc. Fewer than it needs would leave the tolerance: such an arc is refused."""
LARGEST_RADIUS: Final = 1e7
"""Ten times what a place may be; beyond it the centre swallows the decimals of the ends."""

_PLANES: Final = {17: ("X", "Y", "I", "J"), 18: ("Z", "X", "K", "I"), 19: ("Y", "Z", "J", "K")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """G02 (clockwise) or G03 in the plane G17, G18 or G19; `offsets` are its words I, J, K, R in units."""

    clockwise: bool
    plane: int
    offsets: dict[str, float]


def chords(
    arc: Arc, start: dict[str, float], end: dict[str, float], error: float, radius_error: float
) -> tuple[list[tuple[float, ...]], float]:
    """Ends of chords no farther than `error` from the arc, all axes, the last one exactly at `end`; and how much longer
    the way is than in the plane. Axes out of the plane go along in proportion. The radii at both ends may differ by
    `radius_error`. Raises ProgramError.
    """
    first, second, _, _ = _PLANES[arc.plane]
    if first not in start or second not in start:
        raise ProgramError(f"an arc in G{arc.plane} needs the axes {first} and {second}")
    centre = _centre(arc, start, end, radius_error)
    radius = math.hypot(start[first] - centre[0], start[second] - centre[1])
    at_end = math.hypot(end[first] - centre[0], end[second] - centre[1])
    if radius < 1e-9:
        raise ProgramError("an arc of radius 0")
    if not max(radius, at_end) <= LARGEST_RADIUS:
        raise ProgramError(f"an arc of radius {max(radius, at_end):g}: at most {LARGEST_RADIUS:g} is read")
    if abs(radius - at_end) > radius_error:
        raise ProgramError(f"the arc begins with the radius {radius:.4f} and ends with {at_end:.4f}")
    begin = math.atan2(start[second] - centre[1], start[first] - centre[0])
    sweep = _sweep(arc, begin, math.atan2(end[second] - centre[1], end[first] - centre[0]))
    step = 2 * math.acos(max(1 - min(error, radius) / radius, 0.0))
    count = max(math.ceil(abs(sweep) / step), 1)
    if count > MOST_CHORDS:
        raise ProgramError(f"the arc needs {count:,} chords, and {MOST_CHORDS:,} are the most: widen the tolerance")
    shares = np.arange(1, count + 1) / count
    radii = radius + (at_end - radius) * shares
    angles = begin + sweep * shares
    columns = [start[axis] + (end[axis] - start[axis]) * shares for axis in start]
    names = list(start)
    columns[names.index(first)] = centre[0] + radii * np.cos(angles)
    columns[names.index(second)] = centre[1] + radii * np.sin(angles)
    made = [tuple(float(value) for value in row) for row in np.stack(columns, axis=1)]
    made[-1] = tuple(end.values())
    flat = abs(sweep) * radius
    rest = math.sqrt(sum((end[axis] - start[axis]) ** 2 for axis in start if axis not in (first, second)))
    return made, math.hypot(flat, rest) / flat


def _centre(arc: Arc, start: dict[str, float], end: dict[str, float], radius_error: float) -> tuple[float, float]:
    first, second, along_first, along_second = _PLANES[arc.plane]
    for letter in {"I", "J", "K"} - {along_first, along_second}:
        if arc.offsets.get(letter):
            raise ProgramError(f"{letter} in an arc in G{arc.plane}, where it says nothing of the centre")
    if "R" not in arc.offsets:
        if along_first not in arc.offsets and along_second not in arc.offsets:
            raise ProgramError(f"an arc without {along_first}, {along_second} or R")
        return start[first] + arc.offsets.get(along_first, 0.0), start[second] + arc.offsets.get(along_second, 0.0)
    radius = arc.offsets["R"]
    half = (end[first] - start[first]) / 2, (end[second] - start[second]) / 2
    chord = math.hypot(*half)
    if not chord:
        raise ProgramError("a full circle with R: its centre is anywhere; use I, J and K")
    if chord > abs(radius) + radius_error:
        raise ProgramError(f"an arc with R{radius:g} cannot span a chord of {2 * chord:.4f}")
    height = math.sqrt(max(radius**2 - chord**2, 0.0))
    side = 1 if arc.clockwise == (radius < 0) else -1
    middle = start[first] + half[0], start[second] + half[1]
    return middle[0] - side * height * half[1] / chord, middle[1] + side * height * half[0] / chord


def _sweep(arc: Arc, begin: float, end: float) -> float:
    """Clockwise is negative; an arc that ends where it began is a full circle."""
    sweep = (end - begin) % (2 * math.pi)
    if sweep < 1e-9 or 2 * math.pi - sweep < 1e-9:
        sweep = 2 * math.pi
        return -sweep if arc.clockwise else sweep
    return sweep - 2 * math.pi if arc.clockwise else sweep
