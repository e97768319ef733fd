"""The picture: well-formed, in its frame, its numbers those of the motion, small and large."""

from __future__ import annotations

from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from tapewire.g05.layout import Unit
from tapewire.g05.limits import Axis, Machine
from tapewire.g05.motion import Sketch
from tapewire.g05.picture import HEIGHTS, WIDTH, picture

SVG = "{http://www.w3.org/2000/svg}"


def drawn(travel: list[list[int]], unit: Unit = Unit.MM) -> ElementTree.Element:
    machine = Machine(axes=tuple(Axis(name=name, unit=unit) for name in "XYZ"[: len(travel[0]) if travel else 3]))
    sketch = Sketch(machine, 0.008)
    if travel:
        sketch.add(np.array(travel))
    return ElementTree.fromstring(picture(sketch, '<b>&"'))


def numbers(root: ElementTree.Element, kind: str) -> list[float]:
    return [float(text.text or "") for text in root.iter(f"{SVG}text") if text.get("class") == kind and _is(text.text)]


def _is(word: str | None) -> bool:
    return word is not None and word.lstrip("-")[:1].isdigit()


@pytest.mark.parametrize(
    "travel",
    [
        [],
        [[1]],
        [[1, 0]],
        [[0, -1, 0]],
        [[8191, 8191, 0]] * 5000,
        [[1, 0, 0], [-1, 0, 0]] * 3000,
        [[8191, 0, 0]] * 100_000 + [[0, 1, 0]],
        [[-8000, 3], [1, 2], [1, -900]],
    ],
    ids=["none", "one axis", "one step", "down", "diagonal", "to and fro", "long and flat", "small"],
)
@pytest.mark.parametrize("unit", Unit)
def test_everything_lies_in_its_frame(travel: list[list[int]], unit: Unit) -> None:
    root = drawn(travel, unit)
    height = float(root.attrib["height"])
    assert height <= HEIGHTS
    assert next(text.text for text in root.iter(f"{SVG}text")) == '<b>&"'
    frames = list(root.iter(f"{SVG}rect"))[1:]
    for frame, line in zip(frames, root.iter(f"{SVG}polyline"), strict=True):
        left, top = float(frame.attrib["x"]), float(frame.attrib["y"])
        right, bottom = left + float(frame.attrib["width"]), top + float(frame.attrib["height"])
        assert 0 < left < right < WIDTH
        assert 0 < top < bottom < height
        for pair in line.attrib["points"].split():
            x, y = map(float, pair.split(","))
            assert left - 0.2 <= x <= right + 0.2
            assert top - 0.2 <= y <= bottom + 0.2
    assert len(frames) == 3
    for one, other in pairwise(frames):
        assert float(one.attrib["y"]) + float(one.attrib["height"]) < float(other.attrib["y"]) - 30


def test_numbers_and_units_at_the_edges() -> None:
    """1 s at 40 mm/s in X, then in Y."""
    root = drawn([[320, 0, 0]] * 125 + [[0, 320, 0]] * 125)
    words = [text.text for text in root.iter(f"{SVG}text")]
    assert "Path, Y in mm upwards, from where the axes stand before" in words
    assert "Speed in mm/s, at most 40" in words
    assert {"X, mm", "time, s", "begins", "ends"} <= set(words)
    assert {0.0, 20.0, 40.0} <= set(numbers(root, "middle"))
    assert {0.0, 20.0, 40.0} <= set(numbers(root, "right"))
    assert 2.0 in numbers(root, "middle")
    (begins, _), (ends, _) = [
        (mark, mark.attrib["cx"]) for mark in root.iter(f"{SVG}circle") if mark.get("class") in ("begin", "end")
    ][:2]
    assert float(ends.attrib["cx"]) > float(begins.attrib["cx"])
    assert float(ends.attrib["cy"]) < float(begins.attrib["cy"])
