"""What is FANUC and no protocol: parameters, alarms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from docs.generators.markup import table
from tapewire.fanuc.alarms import ALARMS
from tapewire.fanuc.parameters import CATALOGUE, Parameter


def _parameters() -> str:
    rows = [
        (f"{record.number:04d}", record.title, _range(record), record.entry.split()[0], record.power, _values(record))
        for record in CATALOGUE.values()
    ]
    return table(("no.", "meaning", "range", "input", "takes effect", "values"), rows)


def _range(record: Parameter) -> str:
    return "bits" if record.is_bits else f"{record.low} to {record.high} {record.unit}".rstrip()


def _values(record: Parameter) -> str:
    if record.is_bits:
        return "; ".join(f"#{bit.position} {bit.name}: 0 {bit.zero}, 1 {bit.one}" for bit in record.bits)
    return "; ".join(f"{value} {meaning}" for value, meaning in record.values.items())


def _alarms() -> str:
    rows = [
        (number, record.message, " ".join(record.causes), record.seen, " ".join(record.remedies))
        for number, record in ALARMS.items()
    ]
    return table(("alarm", "message", "why", "what is seen", "what to do"), rows)


PARTS: Final[dict[str, Callable[[], str]]] = {"fanuc parameters": _parameters, "fanuc alarms": _alarms}
