"""What is FANUC and no protocol: parameters, alarms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from docs.generators.markup import table
from tapewire.fanuc.alarms import ALARMS
from tapewire.fanuc.leds import RED_MEANINGS, STATUSES, SYSTEM_MESSAGES
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


def _green() -> str:
    rows = [
        (
            ", ".join(row.green) + (" (reconstructed)" if row.reconstructed else ""),
            "-" if row.code is None else str(row.code),
            status.value,
            "yes" if row.message else "no",
        )
        for status, row in STATUSES.items()
    ]
    return table(("LED 1, LED 2", "code", "meaning", "message on the screen"), rows)


def _red() -> str:
    return table(("red LED", "meaning"), [(str(red.value or "none"), text) for red, text in RED_MEANINGS.items()])


def _messages() -> str:
    rows = [(f"{fault.value:X}", f"`{message}`", text) for fault, (message, text) in SYSTEM_MESSAGES.items()]
    return table(("code", "message", "meaning"), rows)


PARTS: Final[dict[str, Callable[[], str]]] = {
    "fanuc parameters": _parameters,
    "fanuc alarms": _alarms,
    "fanuc green leds": _green,
    "fanuc red leds": _red,
    "fanuc system messages": _messages,
}
