"""`tapewire g05`"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from tapewire.cli.common import COMPLETE, NOT_COMPLETE
from tapewire.cli.output import json_end
from tapewire.errors import UsageError
from tapewire.g05.layout import AuxiliaryUse, IncrementSystem, Layout, RecordFormat, Unit, UnitTime
from tapewire.protocols import PROTOCOLS

if TYPE_CHECKING:
    from tapewire.g05.check import Asked, Checked, SectionChecked
    from tapewire.g05.limits import Axis, Machine
    from tapewire.transfer.binary import Encoded

__all__ = ["g05"]

Command = TypeVar("Command", bound=Callable[..., Any])

SYSTEMS: Final = {system.title: system for system in IncrementSystem}
DEFAULT_AXES: Final = ("X", "Y", "Z")
SUFFIXES: Final = {".csv": "path", ".npz": "path"}

_RECORD_OPTIONS: Final = (
    click.option(
        "--axis",
        "axes",
        multiple=True,
        metavar="AXIS",
        help="NAME[:mm|inch|deg[:VELOCITY[:ACCELERATION[:JERK]]]], in the order of the control, one for each axis: "
        "units a minute, a second squared, a second cubed. The defaults are mm:6000:1000:20000.",
    ),
    click.option(
        "--format",
        "form",
        type=click.Choice([str(form) for form in RecordFormat]),
        help="No. 7609#2; special where nothing else is known.",
    ),
    click.option("--aux", is_flag=True, help="The records carry auxiliary functions (No. 7609#3)."),
    click.option(
        "--unit-time",
        type=click.Choice([time.value for time in UnitTime]),
        default=8,
        show_default=True,
        help="Milliseconds of a record (No. 7618).",
    ),
    click.option(
        "--increments", type=click.Choice(list(SYSTEMS)), default="IS-B", show_default=True, help="Increment system."
    ),
    click.option("--baud", type=click.IntRange(50, 4_000_000), help="What the line carries: too little is told."),
    click.option("--protocol", type=click.Choice(list(PROTOCOLS)), help="Whose rules the records shall keep."),
)


def _record_options(command: Command) -> Command:
    for option in reversed(_RECORD_OPTIONS):
        command = option(command)
    return command


@click.group()
def g05() -> None:
    """Binary input operation: check, make and read records of travel per unit time."""


@g05.command()
@click.argument("file", type=click.Path(path_type=Path))
@_record_options
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE.svg", help="Draw the first section.")
@click.option("--force", is_flag=True, help="Replace the picture if it exists.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout.")
def check(file: Path, picture: Path | None, force: bool, as_json: bool, **words: Any) -> int:
    """Verify the G05 sections of the NC program in FILE: exit status 0 when they are sound."""
    from tapewire.transfer.binary import check_file

    checked = check_file(file, _asked(words, pictured=picture is not None), picture, force=force)
    for section in checked.sections:
        if as_json:
            _say_json("section", **_plain(section))
        _say_section(section)
    more = checked.section_count - len(checked.sections)
    if more:
        _say(f"and {more:,} more sections")
    for problem in checked.problems:
        _say(problem)
    verdict = _verdict(checked)
    _say(verdict)
    if as_json:
        click.echo(json_end("complete" if checked.sound else "failed", verdict))
    return COMPLETE if checked.sound else NOT_COMPLETE


@g05.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--from",
    "source",
    type=click.Choice(["nc", "path", "table"]),
    help="What FILE is: an NC program; positions with the feed of the move to each (CSV, npz); positions at every unit "
    "of time (CSV, npz). Without it .csv and .npz are paths, everything else is an NC program.",
)
@_record_options
@click.option(
    "--tolerance",
    type=click.FloatRange(0, min_open=True),
    default=0.01,
    show_default=True,
    help="How far from the path.",
)
@click.option("--smoothing", type=click.IntRange(2, 512), metavar="UNITS", help="Units of time of each average.")
@click.option("--start", metavar="POSITION", help="Where the axes are before an NC program, as in X0,Y0,Z50.")
@click.option("--number", type=click.IntRange(1, 9999), default=1, show_default=True, help="O number of a new program.")
@click.option("--force", is_flag=True, help="Replace OUT if it exists.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout.")
def encode(
    file: Path,
    out: Path,
    source: str | None,
    tolerance: float,
    smoothing: int | None,
    start: str | None,
    number: int,
    force: bool,
    as_json: bool,
    **words: Any,
) -> int:
    """Plan the motion in FILE and write it as a program with a G05 section to OUT."""
    from tapewire.g05.limits import Planning
    from tapewire.transfer.binary import Encoding, encode_file

    machine = _machine(words, DEFAULT_AXES)
    planning = Planning(
        machine=machine,
        layout=_layout(words, len(machine.axes)),
        unit_time=UnitTime(words["unit_time"]),
        tolerance=tolerance,
        smoothing_ticks=smoothing,
    )
    encoding = Encoding(
        source=source or SUFFIXES.get(file.suffix.lower(), "nc"),
        planning=planning,
        baud=words["baud"],
        protocol=words["protocol"],
        start=_place(start, machine.names) if start is not None else None,
        number=number,
    )
    made = encode_file(file, out, encoding, force=force)
    _say_encoded(out, made, machine)
    if as_json:
        _say_json("encoded", **_plain(made))
        click.echo(json_end("complete", f"{made.records:,} records"))
    return COMPLETE


@g05.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@_record_options
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE.svg", help="Draw the first section.")
@click.option("--force", is_flag=True, help="Replace OUT, or the picture, if it exists.")
def decode(file: Path, out: Path, picture: Path | None, force: bool, **words: Any) -> int:
    """Write the G05 sections of FILE as positions to OUT.csv, or as arrays of travel to OUT.npz."""
    from tapewire.transfer.binary import check_file, decode_file

    if picture is not None and os.path.lexists(picture) and not force:
        raise UsageError(f"{picture} exists; name another file, or say --force to replace it")
    done = decode_file(file, out, _asked(words, pictured=False), force=force)
    if picture is not None:
        check_file(file, _asked(words, pictured=True), picture, force=force)
    _say(f"{out.name}: {done.records:,} records of {done.section_count:,} sections, {done.seconds:.3f} s")
    return COMPLETE


def _asked(words: dict[str, Any], *, pictured: bool) -> Asked:
    from tapewire.g05.check import Asked

    machine = _machine(words, ()) if words["axes"] else None
    if machine is None and (words["aux"] or words["form"]):
        raise UsageError("--aux and --format say how the records of known axes are made: name each of them with --axis")
    return Asked(
        layout=_layout(words, len(machine.axes)) if machine is not None else None,
        machine=machine,
        increments=SYSTEMS[words["increments"]],
        unit_time=UnitTime(words["unit_time"]),
        baud=words["baud"],
        protocol=words["protocol"],
        pictured=pictured,
    )


def _layout(words: dict[str, Any], axis_count: int) -> Layout:
    return Layout(
        axis_count=axis_count,
        format=RecordFormat(words["form"] or RecordFormat.SPECIAL),
        auxiliary=AuxiliaryUse.USED if words["aux"] else AuxiliaryUse.UNUSED,
    )


def _machine(words: dict[str, Any], default: tuple[str, ...]) -> Machine:
    from tapewire.g05.limits import Machine

    axes = tuple(_axis(word) for word in (words["axes"] or default))
    if len({axis.name for axis in axes}) < len(axes):
        raise UsageError("--axis names an axis twice")
    return Machine(axes=axes, increments=SYSTEMS[words["increments"]])


def _axis(word: str) -> Axis:
    from tapewire.g05.limits import Axis

    name, *rest = word.split(":")
    if not (len(name) == 1 and "A" <= name <= "Z") or name in "FGIJKMNORST" or len(rest) > 4:
        raise UsageError(
            f"--axis {word}: NAME[:mm|inch|deg[:VELOCITY[:ACCELERATION[:JERK]]]] is expected, NAME the capital letter "
            "of an axis"
        )
    if rest and rest[0] not in list(Unit):
        raise UsageError(f"--axis {word}: the unit is one of {', '.join(Unit)}")
    try:
        numbers = [float(text) for text in rest[1:]]
    except ValueError:
        raise UsageError(f"--axis {word}: velocity, acceleration and jerk are numbers") from None
    limits = dict(zip(("velocity_per_min", "acceleration", "jerk"), numbers, strict=False))
    return Axis(name=name, unit=Unit(rest[0]) if rest else Unit.MM, **limits)


def _place(text: str, names: tuple[str, ...]) -> tuple[float, ...]:
    values: dict[str, float] = {}
    words = text.split(",")
    for word in words:
        try:
            values[word[:1]] = float(word[1:])
        except ValueError:
            raise UsageError(f"--start {text}: a position such as X0,Y0,Z50 is expected") from None
    if len(words) != len(names) or set(values) != set(names) or not all(abs(value) < 1e6 for value in values.values()):
        raise UsageError(f"--start {text}: it says where {', '.join(names)} are, each once, within a million units")
    return tuple(values[name] for name in names)


# words for people


def _say(words: str) -> None:
    click.echo(words, err=True)


def _say_json(event: str, **fields: Any) -> None:
    click.echo(json.dumps({"event": event, "time_ns": time.time_ns(), **fields}))


def _plain(record: Any) -> dict[str, Any]:
    """A record as JSON takes it: arrays as lists, the layout in words."""
    fields = asdict(record)
    if fields.get("report") is not None:
        fields["report"] = {
            key: value.tolist() if hasattr(value, "tolist") else value for key, value in fields["report"].items()
        }
    if "layout" in fields:
        fields["layout"] = str(record.layout)
    return fields


def _say_section(section: SectionChecked) -> None:
    _say(f"line {section.line}: {section.records:,} records, {section.layout}, {section.seconds:.3f} s")
    if section.assumed:
        _say(f"  made as found: {section.assumed}")
    for axis in section.axes:
        unit = axis.unit
        _say(
            f"  {axis.name}: travel {axis.travel:.6g}, from {axis.lowest:.6g} to {axis.highest:.6g} {unit}; at most "
            f"{axis.velocity:.6g} {unit}/s, {axis.acceleration:.6g} {unit}/s², {axis.jerk:.6g} {unit}/s³"
        )
    if section.auxiliary_count:
        _say(f"  {section.auxiliary_count:,} significant auxiliary functions")
    _say(f"  the line must keep up {section.required_baud:,} baud (9.2)")
    for note in section.notes:
        _say(f"  note: {note}")
    for problem in section.problems:
        _say(f"  problem: {problem}")


def _verdict(checked: Checked) -> str:
    if not checked.section_count and not checked.problems:
        return "there is no G05 section: no block that is G05 alone"
    if checked.problem_count:
        return f"not sound: {checked.problem_count:,} problems in {checked.section_count:,} sections"
    return f"sound: {checked.section_count:,} sections"


def _say_encoded(out: Path, made: Encoded, machine: Machine) -> None:
    _say(f"{out.name}: {made.byte_count:,} bytes, {made.records:,} records, {made.seconds:.3f} s of motion")
    _say(f"begins at {', '.join(f'{n}{v:.6g}' for n, v in zip(machine.names, made.start, strict=True))}")
    _say(f"the line must keep up {made.required_baud:,} baud (9.2)")
    report = made.report
    if report is None:
        return
    for index, axis in enumerate(machine.axes):
        _say(
            f"  {axis.name}: at most {report.velocity[index] * 60:.6g} {axis.unit}/min, "
            f"{report.acceleration[index]:.6g} {axis.unit}/s², {report.jerk[index]:.6g} {axis.unit}/s³"
        )
    moves = "1 move" if report.moves == 1 else f"{report.moves:,} moves"
    _say(f"{moves}; at most {report.contour_error:.4g} from the path, rounding included")
    if report.left_out or report.moved_ahead:
        _say(f"units of time without motion: {report.left_out:,} left out, {report.moved_ahead:,} filled in advance")
