"""Protocol parameters as users set them: `--set KEY=VALUE`, checked against the fields of a frozen record.

A field declared with `setting` carries all that the parser, the error texts and the tables of the manual need.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar, Protocol, TypeVar

from tapewire.errors import UsageError

__all__ = ["End", "Form", "Switch", "describe_settings", "parse_settings", "setting"]


class End(StrEnum):
    """Whose parameter it is."""

    BOTH = "both"
    HOST = "host"
    CONTROL = "control"


class Switch(StrEnum):
    """A parameter that is on or off."""

    ON = "on"
    OFF = "off"

    @property
    def other(self) -> Switch:
        return Switch.OFF if self is Switch.ON else Switch.ON


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """How a value that is neither a number nor a word of a fixed list is written."""

    values: str
    """What may be written, for the manual and for errors."""
    parse: Callable[[str], object]
    """Raises ValueError saying what is wrong."""
    word: Callable[[Any], str]
    """The other way: what `parse` would take."""


class DataclassInstance(Protocol):
    __dataclass_fields__: ClassVar[dict[str, Any]]


Record = TypeVar("Record", bound=DataclassInstance)


def setting(
    default: Any,
    why: str,
    *,
    end: End = End.BOTH,
    key: str | None = None,
    unit: str = "",
    limits: tuple[float, float] | None = None,
    form: Form | None = None,
    control: Any = None,
) -> Any:
    """A dataclass field that `--set` can reach.

    `default` gives the type: a StrEnum member offers its words, an int or a float is a number in `unit` within
    `limits`, and anything else is written in a `form`. `why` is one sentence for the manual: what it means and why
    this default. `control` is the default at the control's end where it is another than the host's.
    """
    metadata = {
        "why": why,
        "end": end,
        "key": key,
        "unit": unit,
        "limits": limits,
        "form": form,
        "control": control,
    }
    return dataclasses.field(default=default, metadata=metadata)


def parse_settings(record: type[Record], settings: Mapping[str, str], end: End, fixed: Mapping[str, Any]) -> Record:
    """A `record` with `settings` (words as typed) over its defaults; `fixed` fills what users cannot set.

    Raises UsageError for a key that is unknown or belongs to the other end, and for a value out of its range.
    """
    fields = {_key(field): field for field in _settable(record)}
    values = _defaults_of_control(record) if end is End.CONTROL else {}
    values |= fixed
    for key, text in settings.items():
        field = fields.get(key)
        if field is None:
            known = sorted(name for name, each in fields.items() if each.metadata["end"] in (End.BOTH, end))
            raise UsageError(f"there is no setting {key!r}; the settings of the {end} are {', '.join(known)}")
        if field.metadata["end"] not in (End.BOTH, end):
            raise UsageError(f"{key} is a setting of the {field.metadata['end']}, not of the {end}; leave it out here")
        values[field.name] = _parse(field, text)
    return record(**values)


def describe_settings(record: type[DataclassInstance]) -> list[tuple[str, str, str, str, str]]:
    """(key, values, default, end, why) of every setting, in the order of declaration: the table of the manual.

    A setting whose default is not the same at both ends has a row for each.
    """
    return [
        (_key(field), _values(field), _word(field, default), str(end), field.metadata["why"])
        for field in _settable(record)
        for end, default in _ends(field)
    ]


def _ends(field: dataclasses.Field[Any]) -> tuple[tuple[End, object], ...]:
    control = field.metadata["control"]
    if control is None:
        return ((field.metadata["end"], field.default),)
    return ((End.HOST, field.default), (End.CONTROL, control))


def _defaults_of_control(record: type[DataclassInstance]) -> dict[str, Any]:
    defaults = {field.name: field.metadata["control"] for field in _settable(record)}
    return {name: default for name, default in defaults.items() if default is not None}


def _settable(record: type[DataclassInstance]) -> Iterable[dataclasses.Field[Any]]:
    return (field for field in dataclasses.fields(record) if "why" in field.metadata)


def _key(field: dataclasses.Field[Any]) -> str:
    return str(field.metadata["key"] or field.name)


def _word(field: dataclasses.Field[Any], default: object) -> str:
    form: Form | None = field.metadata["form"]
    return str(default) if form is None else form.word(default)


def _values(field: dataclasses.Field[Any]) -> str:
    if field.metadata["form"] is not None:
        return str(field.metadata["form"].values)
    if isinstance(field.default, StrEnum):
        return " ".join(type(field.default))
    low, high = field.metadata["limits"]
    return f"{low} to {high} {field.metadata['unit']}".rstrip()


def _parse(field: dataclasses.Field[Any], text: str) -> object:
    default: Any = field.default
    key = _key(field)
    form: Form | None = field.metadata["form"]
    if form is not None:
        try:
            return form.parse(text)
        except ValueError as error:
            raise UsageError(f"{key}={text}: {error} ({form.values})") from None
    if isinstance(default, StrEnum):
        words = type(default)
        if text not in list(words):
            raise UsageError(f"{key}={text}: one of {_values(field)} is expected")
        return words(text)
    try:
        value = type(default)(text)
    except ValueError:
        value = None
    low, high = field.metadata["limits"]
    if value is None or not low <= value <= high:
        raise UsageError(f"{key}={text}: a number is expected, {_values(field)}")
    return value
