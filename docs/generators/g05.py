"""Binary input operation: records, rates, units, modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from docs.generators.markup import table
from tapewire.g05.layout import (
    SIGNIFICANT,
    AuxiliaryUse,
    IncrementSystem,
    Layout,
    RecordFormat,
    Unit,
    UnitTime,
    required_baud,
)
from tapewire.g05.modes import FORBIDDEN
from tapewire.g05.records import encode

EXAMPLES: Final = (
    ("one axis, 700 increments (the manual's example)", [700], None),
    ("one axis, -700", [-700], None),
    ("the largest of the special format", [8191], None),
    ("the smallest of the special format", [-8192], None),
    ("the largest of the general format", [32767], None),
    ("three axes: 100, -250, 5", [100, -250, 5], None),
    ("the same with auxiliary function 8, significant", [100, -250, 5], SIGNIFICANT | 8),
    ("the same with an auxiliary function that is not significant", [100, -250, 5], 0),
    ("no travel, auxiliary function 1234", [0, 0, 0], SIGNIFICANT | 1234),
)


def _record(travel: list[int], word: int | None, form: RecordFormat) -> str:
    use = AuxiliaryUse.UNUSED if word is None else AuxiliaryUse.USED
    layout = Layout(axis_count=len(travel), format=form, auxiliary=use)
    low, high = layout.travel_limits
    if not low <= min(travel) <= max(travel) <= high:
        return "out of range"
    words = None if word is None else np.array([word])
    return f"`{encode(np.array([travel]), layout, words).tobytes().hex(' ').upper()}`"


def _records() -> str:
    rows = [(what, *(_record(travel, word, form) for form in RecordFormat)) for what, travel, word in EXAMPLES]
    return table(("travel per unit time", "special format", "general format"), rows)


def _rates() -> str:
    rows = []
    for axes in (1, 2, 3, 4, 5, 6, 8):
        for use in AuxiliaryUse:
            layout = Layout(axis_count=axes, auxiliary=use)
            what = f"{axes}, with auxiliary functions" if layout.uses_auxiliary else str(axes)
            rates = (f"{required_baud(layout, time):,}" for time in reversed(UnitTime))
            rows.append((what, str(layout.record_bytes), *rates))
    head = (
        "axes",
        "bytes a record",
        *(f"{time.value} ms (7618 = {time.parameter_bits})" for time in reversed(UnitTime)),
    )
    return table(head, rows)


def _units() -> str:
    def one(system: IncrementSystem, unit: Unit) -> str:
        return f"{1 / system.per_unit(unit):.7f}".rstrip("0")

    rows = [(system.title, *(one(system, unit) for unit in Unit)) for system in IncrementSystem]
    return table(("increment system", "millimetre machine, mm", "inch machine, inch", "rotary axis, deg"), rows)


def _modes() -> str:
    rows = [
        (mode.name, " ".join(mode.on), " ".join(mode.off) or "radius 0, or the axis word that ends it")
        for mode in FORBIDDEN
    ]
    return table(("mode (9.3 note 2)", "on by", "off by"), rows)


PARTS: Final[dict[str, Callable[[], str]]] = {
    "g05 records": _records,
    "g05 rates": _rates,
    "g05 units": _units,
    "g05 modes": _modes,
}
