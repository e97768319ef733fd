"""Dialogues as lines of text, in the form of every transcript, and as fields for programs."""

from __future__ import annotations

import datetime
from typing import Any, Final

from tapewire.engine import SECOND, Nanos
from tapewire.line.captures.reader import Problem
from tapewire.line.captures.records import Side
from tapewire.transfer.decoding.entry import Entry, Kind
from tapewire.transfer.decoding.reading import Began, Decoded, Figures, Told

__all__ = ["NAMES", "entry_fields", "entry_line", "fields_of", "line_of", "program_text", "unix_time"]

NAMES: Final = {Side.HOST: "host", Side.CONTROL: "cnc"}
"""The sides as transcripts write them."""

_MARKS: Final = {Kind.VIOLATION: "!! ", Kind.SIGNALS: "-- ", Kind.FAULT: "!! ", Kind.NOTE: "-- "}


def line_of(decoded: Decoded) -> str:
    """One line of text, several for figures."""
    match decoded:
        case Began(at=at, origin=origin, known=known):
            who = f"written by the {origin.side}" if origin.side is not None else "written by an unknown side"
            where = origin.line or "a line without a name"
            return f"== {where}; {who}\n== {known}\n== times count from {unix_time(at)}"
        case Told(began=began, entry=entry):
            return entry_line(entry, began)
        case Figures(lines=lines):
            return "\n".join(f"== {line}" for line in lines)
        case Problem(offset=offset, what=what):
            return f"== at byte {offset} of the file: {what}"


def entry_line(entry: Entry, began: Nanos) -> str:
    """An entry of a dialogue whose times count from `began`."""
    who = "" if entry.side is None else NAMES[entry.side]
    text = program_text(entry) if entry.kind is Kind.PROGRAM else entry.text
    return f"{(entry.at - began) / SECOND:12.6f}  {who:4}  {_MARKS.get(entry.kind, '')}{text}"


def program_text(entry: Entry) -> str:
    """A run of program bytes: how many, how they begin, how long it took."""
    noun = "byte" if entry.count == 1 else "bytes"
    took = f"  in {(entry.until - entry.at) / SECOND:.3f} s" if entry.until > entry.at else ""
    return f"{entry.count:,} {noun}  {entry.text}{took}"


def unix_time(at: Nanos) -> str:
    """A moment as people write it, in UTC: captures of several computers are compared."""
    moment = datetime.datetime.fromtimestamp(at // SECOND, datetime.UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{at % SECOND // 1000:06} UTC"


def fields_of(decoded: Decoded) -> tuple[str, Nanos | None, dict[str, Any]]:
    """The event, its moment where it has one, and its fields, for `--json`."""
    match decoded:
        case Began(stream=stream, at=at, origin=origin, known=known):
            fields = {"stream": stream, "line": origin.line, "side": origin.side, "read_as": known}
            return "stream", at, fields
        case Told(stream=stream, entry=entry):
            return entry.kind.value, entry.at, {"stream": stream, **entry_fields(entry)}
        case Figures(stream=stream, lines=lines, violations=violations):
            return "figures", None, {"stream": stream, "lines": list(lines), "violations": violations}
        case Problem(offset=offset, what=what):
            return "problem", None, {"offset": offset, "what": what}


def entry_fields(entry: Entry) -> dict[str, Any]:
    """The same for programs."""
    fields: dict[str, Any] = {"side": entry.side, "text": entry.text}
    if entry.kind is Kind.PROGRAM:
        fields |= {"bytes": entry.count, "until_ns": entry.until}
    return fields
