"""Files of binary input operation: checked, made, and turned back into numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from tapewire.errors import ProgramError, UsageError
from tapewire.g05.check import Asked, Checked, check
from tapewire.g05.layout import RecordFormat, Unit, required_baud
from tapewire.g05.limits import Floats, Machine, Planning
from tapewire.g05.path import Moves
from tapewire.g05.picture import picture
from tapewire.g05.plan import Plan, Report
from tapewire.g05.reading import sections_of
from tapewire.g05.records import Records, encode
from tapewire.g05.table import read_csv, read_npz
from tapewire.nc.reader import NcReader, Reading
from tapewire.transfer.files import StoredFile, check_name, open_part, why

__all__ = ["Decoded", "Encoded", "Encoding", "Source", "check_file", "decode_file", "encode_file"]

CHORDS: Final = 0.1
"""Of the path tolerance, for the chords of arcs."""

TEXT_BYTES: Final = 1 << 18


class Source:
    """What the numbers to encode are: words of the command line."""

    NC = "nc"
    PATH = "path"
    TABLE = "table"


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoding:
    """What is to be encoded, and how. `baud` None: nobody has said what the line carries."""

    source: str
    planning: Planning
    baud: int | None = None
    protocol: str | None = None
    start: tuple[float, ...] | None = None
    number: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoded:
    """What came of it. `report` is None for a table, which is encoded as it stands."""

    records: int
    seconds: float
    required_baud: int
    byte_count: int
    report: Report | None
    start: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoded:
    section_count: int
    records: int
    seconds: float


def check_file(path: Path, asked: Asked, out: Path | None = None, *, force: bool = False) -> Checked:
    """Check the program in `path`, and draw its first section to `out`. Raises UsageError, ProgramError."""
    with _reading(path) as file:
        checked = check(file.read, asked)
    if out is not None:
        if checked.sketch is None:
            raise UsageError(f"{path}: holds no G05 section that could be drawn")
        with _writing(out, force) as part:
            part.write(picture(checked.sketch, f"{path.name}: first G05 section").encode())
    return checked


def encode_file(path: Path, out: Path, encoding: Encoding, *, force: bool = False) -> Encoded:
    """Make the program `out` of the table, the path or the NC program in `path`. Raises UsageError, ProgramError.

    Nothing gets the name `out` before all of it is there; a line that cannot carry it is refused before.
    """
    layout, planning = encoding.planning.layout, encoding.planning
    needed = required_baud(layout, planning.unit_time)
    _refuse_line(encoding, needed)
    with _reading(path) as file, _writing(out, force) as part:
        try:
            made = _making(file, path.name, encoding)
            count = 0
            part.write(made.before)
            for travel in made.pieces:
                idle = np.zeros(len(travel), np.uint32) if layout.uses_auxiliary else None
                part.write(encode(travel, layout, idle, first_record=count + 1).tobytes())
                count += len(travel)
            if not count:
                raise ProgramError("nothing moves: there is no record to make")
            part.write(layout.exit_record + made.after())
        except ProgramError as error:
            raise ProgramError(f"{path}: {error}", line=error.line, column=error.column) from None
        byte_count = part.byte_count
    return Encoded(
        records=count,
        seconds=count * planning.tick_s,
        required_baud=needed,
        byte_count=byte_count,
        report=made.report,
        start=made.start,
    )


def decode_file(path: Path, out: Path, asked: Asked, *, force: bool = False) -> Decoded:
    """Write what all sections in `path` do as positions (CSV) or travel (npz). Raises UsageError, ProgramError."""
    as_arrays = out.suffix == ".npz"
    if not as_arrays and out.suffix != ".csv":
        raise UsageError(f"{out}: is written as .csv or .npz; give it one of these endings")
    with _reading(path) as file, _writing(out, force) as part:
        try:
            write = _write_arrays if as_arrays else _write_rows
            return write(part, sections_of(file.read, asked.layout), asked)
        except ProgramError as error:
            raise ProgramError(f"{path}: {error}", line=error.line) from None


@dataclass(slots=True)
class _Made:
    before: bytes
    pieces: Iterator[NDArray[np.int64]]
    after: Callable[[], bytes]
    report: Report | None
    start: tuple[float, ...]


def _making(file: IO[bytes], name: str, encoding: Encoding) -> _Made:
    match encoding.source:
        case Source.NC:
            return _from_nc(file, encoding)
        case Source.PATH:
            start, moves = _path(file, name, encoding.planning.machine)
        case _:
            return _from_table(file, name, encoding)
    plan = Plan(encoding.planning, start)
    return _Made(_beginning(encoding), plan.travel(moves), _ending, plan.report, _place(start))


def _beginning(encoding: Encoding) -> bytes:
    return f"%\nO{encoding.number:04d}\nG05\n".encode()


def _ending() -> bytes:
    return b"M30\n%"


def _place(start: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in start)


def _from_nc(file: IO[bytes], encoding: Encoding) -> _Made:
    planning, machine = encoding.planning, encoding.planning.machine
    if {Unit.MM, Unit.INCH} <= {axis.unit for axis in machine.axes}:
        raise UsageError("axes in mm and in inch: a machine that executes NC programs has one of them")
    reading = Reading(
        axes=machine.names,
        start=encoding.start,
        chord_error=CHORDS * planning.tolerance,
        decimals=machine.increments.value,
        inch_machine=any(axis.unit is Unit.INCH for axis in machine.axes),
        rotary=frozenset(axis.name for axis in machine.axes if axis.unit is Unit.DEGREE),
    )
    reader = NcReader(_text(file), reading)
    kept = Planning(
        machine=machine,
        layout=planning.layout,
        unit_time=planning.unit_time,
        tolerance=(1 - CHORDS) * planning.tolerance,
        smoothing_ticks=planning.smoothing_ticks,
    )
    plan = Plan(kept, np.array(reader.start))
    header = "".join(f"{line}\n" for line in reader.header)
    numbered = any(line.startswith(("O", "o")) for line in reader.header)
    before = header if numbered else f"O{encoding.number:04d}\n{header}"

    def after() -> bytes:
        trailer = "".join(f"{line}\n" for line in reader.trailer)
        return (trailer or "M30\n").encode("ascii", "replace") + b"%"

    text = f"%\n{before}G05\n".encode("ascii", "replace")
    return _Made(text, plan.travel(reader.moves()), after, plan.report, reader.start)


def _text(file: IO[bytes]) -> Iterator[str]:
    while piece := file.read(TEXT_BYTES):
        yield piece.decode("latin-1")


def _path(file: IO[bytes], name: str, machine: Machine) -> tuple[Floats, Iterator[Moves]]:
    """Positions with the feed, in units a minute, of the move that leads to each."""
    axis_count = len(machine.axes)
    if name.lower().endswith(".npz"):
        arrays = read_npz(file, name, "position")
        feed = arrays.get("feed")
        points = arrays["position"]
        if feed is None or points.shape[1] != axis_count or len(points) < 2 or feed.shape != points.shape[:1]:
            raise ProgramError(f"'position' of shape (rows, {axis_count}) and 'feed' of shape (rows,) are expected")
        return points[0], iter([Moves(ends=points[1:], speeds=feed[1:] / 60)])
    pieces = _columns(file, name, (*machine.names, "F"))
    first = next(pieces, None)
    if first is None:
        raise ProgramError("the table holds no row")
    return first[0, :axis_count], _moves(first[1:], pieces, axis_count)


def _moves(first: Floats, rest: Iterator[Floats], axis_count: int) -> Iterator[Moves]:
    for piece in _chained(first, rest):
        if len(piece):
            yield Moves(ends=piece[:, :axis_count], speeds=piece[:, axis_count] / 60)


def _chained(first: Floats, rest: Iterator[Floats]) -> Iterator[Floats]:
    yield first
    yield from rest


def _columns(file: IO[bytes], name: str, wanted: tuple[str, ...]) -> Iterator[Floats]:
    """The wanted columns in this order, by their names or, without names, as they stand."""
    table = read_csv(file, name)
    if not table.names:
        order = list(range(len(wanted)))
    else:
        names = [word.upper() for word in table.names]
        missing = [word for word in wanted if word not in names]
        if missing:
            raise ProgramError(f"the table has the columns {', '.join(table.names)}: {', '.join(missing)} is missing")
        order = [names.index(word) for word in wanted]
    for piece in table.pieces:
        if piece.shape[1] < len(wanted):
            raise ProgramError(f"the table has {piece.shape[1]} columns; {', '.join(wanted)} are expected")
        yield piece[:, order]


def _from_table(file: IO[bytes], name: str, encoding: Encoding) -> _Made:
    """Positions at every unit of time, encoded as they stand: the first row is where the axes are."""
    machine = encoding.planning.machine
    if name.lower().endswith(".npz"):
        pieces: Iterator[Floats] = iter([read_npz(file, name, "position")["position"]])
    else:
        pieces = _columns(file, name, machine.names)
    first = next(pieces, None)
    if first is None or not len(first) or first.shape[1] != len(machine.axes):
        raise ProgramError(f"positions of {len(machine.axes)} axes are expected")
    return _Made(_beginning(encoding), _steps(first, pieces, machine.per_unit), _ending, None, _place(first[0]))


def _steps(first: Floats, rest: Iterator[Floats], per_unit: Floats) -> Iterator[NDArray[np.int64]]:
    last: NDArray[np.int64] | None = None
    for piece in _chained(first, rest):
        if not np.isfinite(piece).all() or (np.abs(piece * per_unit) > 2**53).any():
            raise ProgramError("the table holds a position that is no finite number of increments")
        whole = np.rint(piece * per_unit).astype(np.int64)
        joined = whole if last is None else np.concatenate([last[None], whole])
        last = whole[-1]
        yield np.diff(joined, axis=0)


def _refuse_line(encoding: Encoding, needed: int) -> None:
    layout, unit_time = encoding.planning.layout, encoding.planning.unit_time
    if encoding.protocol == "fanuc-a" and layout.format is RecordFormat.GENERAL:
        raise UsageError("protocol A carries the special format only (9.1 (5) note): leave --format out")
    if encoding.baud is not None and encoding.baud < needed:
        raise UsageError(
            f"records of {layout.record_bytes} bytes every {unit_time.value} ms need {needed:,} baud, and the line has "
            f"{encoding.baud:,}: take a longer unit time, fewer axes, or a faster line (9.2)"
        )


def _write_rows(part: StoredFile, sections: Iterator[tuple[int, Iterator[Records]]], asked: Asked) -> Decoded:
    """section, time in ms, position of each axis from the start of the section, auxiliary word or -1."""
    tick, count, number, axis_count = asked.unit_time.value, 0, 0, 0
    for number, pieces in sections:
        here, done = None, 0
        for records in pieces:
            travel = records.travel.astype(np.int64)
            if not count + done:
                part.write(_head(asked, travel.shape[1]).encode())
                axis_count = travel.shape[1]
            elif travel.shape[1] != axis_count:
                raise ProgramError(
                    f"section {number} has {travel.shape[1]} axes and those before it {axis_count}: the columns of one "
                    "CSV cannot be both; decode to .npz, where each section is an array of its own"
                )
            here = np.zeros(travel.shape[1], np.int64) if here is None else here
            where = np.cumsum(travel, axis=0) + here
            here = where[-1]
            per_unit, decimals = _scale(asked, travel.shape[1])
            times = (np.arange(done + 1, done + len(travel) + 1) * tick)[:, None]
            extra = np.full(len(travel), -1) if records.auxiliary is None else records.auxiliary.astype(np.int64)
            part.write(_rows(number, times, where / per_unit, extra, decimals))
            done += len(travel)
        count += done
    return Decoded(section_count=number, records=count, seconds=count * tick / 1000)


def _head(asked: Asked, axis_count: int) -> str:
    names = asked.machine.names if asked.machine is not None else [f"axis{n}" for n in range(1, axis_count + 1)]
    return ",".join(("section", "time_ms", *names, "auxiliary")) + "\n"


def _scale(asked: Asked, axis_count: int) -> tuple[Floats, int]:
    """Units of the axes if the user has named them, else increments."""
    if asked.machine is None:
        return np.ones(axis_count), 0
    per_unit = asked.machine.per_unit
    return per_unit, len(str(int(per_unit.max()))) - 1


def _rows(number: int, times: NDArray[np.int64], where: Floats, extra: NDArray[np.int64], decimals: int) -> bytes:
    form = ",".join(["%d", "%d", *[f"%.{decimals}f"] * where.shape[1], "%d"])
    table = np.concatenate([np.full((len(where), 1), number), times, where, extra[:, None]], axis=1)
    return "".join(form % tuple(row) + "\n" for row in table.tolist()).encode()


def _write_arrays(part: StoredFile, sections: Iterator[tuple[int, Iterator[Records]]], asked: Asked) -> Decoded:
    """`travel_1`, `auxiliary_1`, ... by section, and `unit_time_ms`; as large in memory as in the file."""
    from io import BytesIO

    arrays: dict[str, NDArray[np.generic]] = {"unit_time_ms": np.array(asked.unit_time.value)}
    count = number = 0
    for number, pieces in sections:
        taken = list(pieces)
        if taken:
            arrays[f"travel_{number}"] = np.concatenate([records.travel for records in taken])
            words = [records.auxiliary for records in taken if records.auxiliary is not None]
            if words:
                arrays[f"auxiliary_{number}"] = np.concatenate(words)
            count += sum(len(records) for records in taken)
    packed = BytesIO()
    np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
    part.write(packed.getvalue())
    return Decoded(section_count=number, records=count, seconds=count * asked.unit_time.value / 1000)


@contextmanager
def _reading(path: Path) -> Iterator[IO[bytes]]:
    try:
        file = path.open("rb")
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({why(error)})") from None
    with file:
        try:
            yield file
        except OSError as error:
            raise UsageError(f"{path}: cannot be read ({why(error)})") from None


@contextmanager
def _writing(out: Path, force: bool) -> Iterator[StoredFile]:
    """A file that gets its name when all of it is there."""
    check_name(out, force=force)
    part_path = out.with_name(out.name + ".part")
    part = open_part(part_path)
    try:
        part.begin()
        yield part
        part.sync()
        part_path.replace(out)
    finally:
        part.close()
        part_path.unlink(missing_ok=True)
