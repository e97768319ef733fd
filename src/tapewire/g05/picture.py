"""A picture of binary input operation as SVG: the path, and speed and acceleration over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from tapewire.g05.motion import Sketch

__all__ = ["picture"]

WIDTH: Final = 900
LEFT: Final = 80
RIGHT: Final = 30
MOST_PLOT: Final = 480
LEAST_PLOT: Final = 90
STRIP: Final = 150
ABOVE: Final = 44
"""Room over a plot for its heading, below what belongs to the one before."""
BELOW: Final = 40

_STYLE: Final = (
    "text{font:12px sans-serif;fill:#333}.head{font-weight:bold}.frame{stroke:#888;fill:none}"
    ".grid{stroke:#ddd;fill:none}.right{text-anchor:end}.middle{text-anchor:middle}.line{fill:none;stroke-width:1.2}"
    ".path{stroke:#0a7d3c}.speed{stroke:#0b5fc4}.acceleration{stroke:#c0390b}.begin{fill:#0a7d3c}"
    ".end{fill:#fff;stroke:#0a7d3c;stroke-width:2}"
)

HEIGHTS: Final = 32 + MOST_PLOT + 2 * STRIP + 3 * (ABOVE + BELOW)
"""No picture is higher."""


def picture(sketch: Sketch, title: str) -> str:
    """An SVG document. `title` is text and not markup."""
    seconds, unit = sketch.records * sketch.tick_s, " and ".join(dict.fromkeys(sketch.units))
    parts = [f'<text class="head" x="{LEFT}" y="22">{escape(title)}</text>']
    top = 22.0 + ABOVE
    for plot in (
        _path(sketch, seconds),
        _strip(sketch.speed.values, "speed", "Speed in {}/s", unit, seconds),
        _strip(sketch.acceleration.values, "acceleration", "Acceleration in {}/s², rounding included", unit, seconds),
    ):
        parts += plot.drawn(top)
        top += plot.height + BELOW + ABOVE
    height = math.ceil(top - ABOVE + 10)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
            'style="max-width:100%;height:auto">',
            f"<style>{_STYLE}</style>",
            f'<rect width="{WIDTH}" height="{height}" fill="#fff"/>',
            *parts,
            "</svg>\n",
        ]
    )


@dataclass(frozen=True, slots=True)
class _Span:
    """Numbers from `low` to `high` along `size` pixels."""

    low: float
    high: float
    size: float

    def at(self, value: float) -> float:
        return (value - self.low) / (self.high - self.low) * self.size

    def ticks(self, apart: float) -> list[float]:
        """Round numbers, no closer together than so many pixels."""
        least = (self.high - self.low) / max(self.size / apart, 1)
        step = 10.0 ** math.floor(math.log10(least))
        step *= next(factor for factor in (1, 2, 5, 10) if factor * step >= least * (1 - 1e-9))
        first = math.ceil(self.low / step - 1e-9)
        return [round(number * step, 12) for number in range(first, math.floor(self.high / step + 1e-9) + 1)]


@dataclass(frozen=True, slots=True)
class _Plot:
    """A frame with round numbers at its edges, a line in it, and marks at its beginning and its end if it has any."""

    kind: str
    heading: str
    x: _Span
    y: _Span
    x_label: str
    line: Sequence[tuple[float, float]]
    marks: Sequence[tuple[str, tuple[float, float]]] = ()

    @property
    def height(self) -> float:
        return self.y.size

    def drawn(self, top: float) -> Iterable[str]:
        bottom, right = top + self.y.size, LEFT + self.x.size
        yield _text(LEFT, top - 10, self.heading, "head")
        for value in self.x.ticks(70):
            at = LEFT + self.x.at(value)
            yield f'<path class="grid" d="M{at:.1f},{top:.1f}V{bottom:.1f}"/>'
            yield _text(at, bottom + 15, f"{value:.10g}", "middle")
        for value in self.y.ticks(28):
            at = bottom - self.y.at(value)
            yield f'<path class="grid" d="M{LEFT},{at:.1f}H{right:.1f}"/>'
            yield _text(LEFT - 6, at + 4, f"{value:.10g}", "right")
        yield f'<rect class="frame" x="{LEFT}" y="{top:.1f}" width="{self.x.size:.1f}" height="{self.y.size:.1f}"/>'
        drawn = " ".join(f"{LEFT + self.x.at(x):.1f},{bottom - self.y.at(y):.1f}" for x, y in self.line)
        yield f'<polyline class="line {self.kind}" points="{drawn}"/>'
        for name, (x, y) in self.marks:
            yield f'<circle class="{name}" cx="{LEFT + self.x.at(x):.1f}" cy="{bottom - self.y.at(y):.1f}" r="4"/>'
        yield _text(right, bottom + 32, self.x_label, "right")
        if self.marks:
            yield f'<circle class="begin" cx="{LEFT + 6}" cy="{bottom + 28:.1f}" r="4"/>'
            yield _text(LEFT + 16, bottom + 32, "begins")
            yield f'<circle class="end" cx="{LEFT + 76}" cy="{bottom + 28:.1f}" r="4"/>'
            yield _text(LEFT + 86, bottom + 32, "ends")


def _path(sketch: Sketch, seconds: float) -> _Plot:
    """The first two axes to one scale; of a single axis where it is over time."""
    width, names = WIDTH - LEFT - RIGHT, [escape(name) for name in sketch.names]
    if len(names) == 1:
        last = max(len(sketch.points) - 1, 1)
        line = [(index / last * seconds, place) for index, (place, _) in enumerate(sketch.points)]
        low, high = _apart(min(y for _, y in line), max(y for _, y in line))
        x, y = _Span(0.0, max(seconds, 1e-9), width), _Span(low, high, STRIP)
        return _Plot("path", f"{names[0]} in {sketch.units[0]}, from where it stands before", x, y, "time, s", line)
    points = sketch.points
    left, right = _apart(min(x for x, _ in points), max(x for x, _ in points))
    low, high = _apart(min(y for _, y in points), max(y for _, y in points))
    scale = min(width / (right - left), MOST_PLOT / (high - low))
    height = max((high - low) * scale, LEAST_PLOT)
    across, upwards = _Span(*_wide(left, right, width / scale), width), _Span(*_wide(low, high, height / scale), height)
    heading = f"Path, {names[1]} in {sketch.units[1]} upwards, from where the axes stand before"
    marks = (("begin", (0.0, 0.0)), ("end", sketch.end))
    return _Plot("path", heading, across, upwards, f"{names[0]}, {sketch.units[0]}", points, marks)


def _apart(low: float, high: float) -> tuple[float, float]:
    """A little room at both ends, and some between two that are the same."""
    room = max((high - low) * 0.04, abs(high) * 1e-6, 1e-6)
    return low - room, high + room


def _wide(low: float, high: float, size: float) -> tuple[float, float]:
    middle = (low + high) / 2
    return middle - size / 2, middle + size / 2


def _strip(values: Sequence[float], kind: str, heading: str, unit: str, seconds: float) -> _Plot:
    peak = max(values, default=0.0)
    last = max(len(values) - 1, 1)
    line = [(index / last * seconds, value) for index, value in enumerate(values)]
    x, y = _Span(0.0, max(seconds, 1e-9), WIDTH - LEFT - RIGHT), _Span(0.0, max(peak * 1.05, 1e-9), STRIP)
    return _Plot(kind, f"{heading.format(unit)}, at most {peak:.6g}", x, y, "time, s", line)


def _text(x: float, y: float, words: str, kind: str = "") -> str:
    attribute = f' class="{kind}"' if kind else ""
    return f'<text{attribute} x="{x:.1f}" y="{y:.1f}">{words}</text>'
