"""Faults of a line, presets and paths."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Final, get_args

from docs.generators.markup import table
from tapewire.engine import MILLISECOND, SECOND
from tapewire.line.faults.plan import (
    Every,
    FaultPlan,
    LineEnd,
    PerTransfer,
    PlannedFault,
    Rate,
    When,
    Wire,
)
from tapewire.line.faults.presets import PRESETS
from tapewire.line.faulty import made_on_a_line
from tapewire.line.paths import PATHS, PathKind, TransmitterEmpty


def _kinds() -> str:
    rows = [(kind.kind, _doc(kind), _numbers(kind)) for kind in get_args(PlannedFault)]
    return table(("fault", "what it is", "its numbers, with the default"), rows)


def _doc(kind: type) -> str:
    return " ".join((inspect.getdoc(kind) or "").split())


def _numbers(kind: type) -> str:
    told = [field for field in dataclasses.fields(kind) if field.name not in ("when", "wire")]
    return ", ".join(
        f"`{field.name}`" + ("" if field.default is dataclasses.MISSING else f" {_value(field.name, field.default)}")
        for field in told
    )


def _value(name: str, value: object) -> str:
    if name in ("span", "off", "step"):
        assert isinstance(value, int)
        return _span(value)
    return str(value)


def _span(span: int) -> str:
    return f"{span / SECOND:g} s" if span >= SECOND else f"{span / MILLISECOND:g} ms"


def _presets() -> str:
    return table(("preset", "what happens", "why so"), [(f"`{p.name}`", _plan(p), p.why) for p in PRESETS.values()])


def _plan(plan: FaultPlan) -> str:
    told = [_fault(fault) for fault in plan.faults]
    if plan.path is not None:
        told.append(f"path `{plan.path.name}`")
    return "; ".join(told) or "nothing"


def _fault(fault: PlannedFault) -> str:
    words = [fault.kind]
    for field in dataclasses.fields(fault):
        value = getattr(fault, field.name)
        match field.name:
            case "when":
                continue
            case "wire" if value is Wire.BOTH:
                continue
            case "wire":
                words.append(str(value))
            case "end":
                words.append(f"of the {value}")
            case "signal" | "level" | "sight":
                words.append(str(value))
            case name:
                words.append(f"{name} {_value(name, value)}")
    when = getattr(fault, "when", None)
    return f"{_when(when)}{', '.join(words)}"


def _when(when: When | None) -> str:
    match when:
        case PerTransfer(mean=mean):
            return f"{mean:g} a transfer: "
        case Rate(probability=probability):
            return f"{probability:.0%} of all: "
        case Every(mean=mean):
            return f"every {_span(mean)}: "
        case _:
            return "always: "


def _missing() -> str:
    rows = []
    for plan in PRESETS.values():
        told = {end: made_on_a_line(plan, end)[1] for end in LineEnd}
        if any(told.values()):
            rows.append((f"`{plan.name}`", *("; ".join(told[end]) or "nothing" for end in LineEnd)))
    return table(("preset", "not made where this is the host", "not made where this is the control"), rows)


def _paths() -> str:
    head = ("path", "out of reach", "told of what comes", "asked", "network", "control lines", "empty?", "why")
    return table(head, [_path(path) for path in PATHS.values()])


def _path(path: PathKind) -> tuple[str, ...]:
    told = "each character" if path.trigger == 1 else f"each {path.trigger}, or {path.timeout_characters} later"
    return (
        f"`{path.name}`",
        f"{path.out_of_reach} characters",
        told,
        f"every {_span(path.poll)}" if path.poll else "it interrupts",
        _span(path.latency) if path.latency else "",
        "none" if path.signal_delay is None else "yes",
        "can be asked" if path.transmitter_empty is TransmitterEmpty.ASKED else "cannot be asked",
        path.why,
    )


PARTS: Final[dict[str, Callable[[], str]]] = {
    "fault kinds": _kinds,
    "fault presets": _presets,
    "faults not made": _missing,
    "paths": _paths,
}
