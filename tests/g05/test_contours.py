"""NC programs with arcs, from their text to increments, against curves that are made here and nowhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tapewire.g05.layout import Layout, UnitTime
from tapewire.g05.limits import Axis, Machine, Planning
from tapewire.g05.reading import sections_of
from tapewire.transfer.binary import Encoding, Source, encode_file
from tests.g05.geometry import farthest, in_between

Points = NDArray[np.float64]

TOLERANCE = 0.01
PLANNING = Planning(
    machine=Machine(axes=tuple(Axis(name=name) for name in "XYZ")),
    layout=Layout(axis_count=3),
    unit_time=UnitTime.MS_4,
    tolerance=TOLERANCE,
)


def turn(centre: tuple[float, float], radius: float, begin: float, end: float, down: float = 0.0) -> Points:
    """A helix about Z from one angle to another in degrees, with chords that are off by 0.00002 at most."""
    angles = np.radians(np.linspace(begin, end, 1500))
    heights = np.linspace(0, down, len(angles))
    return np.stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles), heights], axis=1)


CASES = {
    "full circle": ("G02X0Y0I5.", turn((5, 0), 5, 180, -180)),
    "full circle the other way": ("G03X0Y0J-2.5", turn((0, -2.5), 2.5, 90, 450)),
    "tiny": ("G03X.02Y.02R.02", turn((0, 0.02), 0.02, -90, 0)),
    "more than half": ("G02X3.Y3.R-3.", turn((0, 3), 3, -90, -360)),
    "helix": ("G03X0Y0Z-4.I-3.", turn((-3, 0), 3, 0, 360, -4)),
    "steep helix": ("G02X1.Y1.Z20.R1.", turn((1, 0), 1, 180, 90, 20)),
    "there and back": ("G01X8.\nX0", np.array([[0, 0, 0], [8, 0, 0], [0, 0, 0]])),
    "spikes": (
        "G01X4.\nX1.\nX1.\nY.003\nX3.",
        np.array([[0, 0, 0], [4, 0, 0], [1, 0, 0], [1, 0.003, 0], [3, 0.003, 0]]),
    ),
    "moves of nothing": ("G01X0\nY0\nX0Y0\nX2.\nX2.\nG02X2.0001I.00005", np.array([[0, 0, 0], [2.0001, 0, 0]])),
    "tangent": ("G01X5.\nG03X7.Y2.R2.\nG01Y6.", np.concatenate([[[0, 0, 0]], turn((5, 2), 2, -90, 0), [[7, 6, 0]]])),
}


@pytest.mark.parametrize("case", CASES)
def test_the_contour_is_kept(case: str, tmp_path: Path) -> None:
    text, curve = CASES[case]
    source, out = tmp_path / "in.nc", tmp_path / "out.g05"
    source.write_text(f"G90G21G17G94\nG00X0Y0Z0\nF1200\n{text}\nG01\nM30\n")
    encode_file(source, out, Encoding(source=Source.NC, planning=PLANNING))
    with out.open("rb") as file:
        travel = np.concatenate(
            [piece.travel for _, pieces in sections_of(file.read, PLANNING.layout) for piece in pieces]
        )
    positions = np.concatenate([np.zeros((1, 3)), np.cumsum(travel, axis=0, dtype=int)]) / 1000
    assert positions[-1].tolist() == np.round(curve[-1], 3).tolist()
    assert farthest(in_between(positions), curve, TOLERANCE) <= TOLERANCE
    assert farthest(curve, positions, TOLERANCE) <= TOLERANCE
