"""A picture of binary input operation as SVG: the path, and speed and acceleration over time."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from tapewire.g05.motion import Sketch

__all__ = ["picture"]

WIDTH: Final = 900
PLOT: Final = 420
STRIP: Final = 150
MARGIN: Final = 60

_STYLE: Final = (
    "text{font:12px sans-serif;fill:#333}.axis{stroke:#999;fill:none}.path{stroke:#0b5;fill:none}"
    ".speed{stroke:#06c;fill:none}.acceleration{stroke:#c30;fill:none}"
)


def picture(sketch: Sketch, title: str, unit: str) -> str:
    """An SVG document. `unit` is that of the axes; `title` is text and not markup."""
    height = PLOT + 2 * STRIP + 4 * MARGIN
    seconds = sketch.records * sketch.tick_s
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}">',
        f"<style>{_STYLE}</style>",
        f'<rect width="{WIDTH}" height="{height}" fill="#fff"/>',
        f'<text x="{MARGIN}" y="24">{escape(title)}</text>',
        *_path(sketch, unit),
        *_strip(sketch.speed.values, PLOT + 2 * MARGIN, "speed", f"speed, {unit}/s", seconds),
        *_strip(
            sketch.acceleration.values,
            PLOT + STRIP + 3 * MARGIN,
            "acceleration",
            f"acceleration, {unit}/s² (rounding to increments included)",
            seconds,
        ),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _path(sketch: Sketch, unit: str) -> list[str]:
    points = sketch.points
    left, right = min(x for x, _ in points), max(x for x, _ in points)
    low, high = min(y for _, y in points), max(y for _, y in points)
    scale = min((WIDTH - 2 * MARGIN) / max(right - left, 1e-9), PLOT / max(high - low, 1e-9))
    drawn = " ".join(f"{MARGIN + (x - left) * scale:.1f},{MARGIN + PLOT - (y - low) * scale:.1f}" for x, y in points)
    names = [escape(name) for name in (*sketch.names, "")[:2]]
    label = f"path: {names[0]} {left:.3f} to {right:.3f} {unit}"
    if len(sketch.names) > 1:
        label += f", {names[1]} {low:.3f} to {high:.3f} {unit}, from the start of the section"
    return [f'<polyline class="path" points="{drawn}"/>', _text(MARGIN, MARGIN + PLOT + 18, label)]


def _strip(values: Sequence[float], top: int, kind: str, label: str, seconds: float) -> list[str]:
    peak = max(values, default=0.0)
    step = (WIDTH - 2 * MARGIN) / max(len(values) - 1, 1)
    bottom = top + STRIP
    drawn = " ".join(
        f"{MARGIN + index * step:.1f},{bottom - value / max(peak, 1e-12) * STRIP:.1f}"
        for index, value in enumerate(values)
    )
    return [
        f'<path class="axis" d="M{MARGIN},{top}V{bottom}H{WIDTH - MARGIN}"/>',
        f'<polyline class="{kind}" points="{drawn}"/>',
        _text(MARGIN, top - 6, f"{label}; peak {peak:.3f}"),
        _text(MARGIN, bottom + 16, f"0 to {seconds:.3f} s"),
    ]


def _text(x: int, y: int, words: str) -> str:
    return f'<text x="{x}" y="{y}">{words}</text>'
