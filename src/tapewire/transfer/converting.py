"""A program file in another code: recognised, converted, read back, and only then given its name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, TypeVar

from tapewire.codes import EIA_SIGNS, DataCode, EiaSigns, Recogniser, Recognition
from tapewire.errors import ProgramError, UsageError
from tapewire.fanuc.conversion import Conversion, EobForm, convert, read_text
from tapewire.fanuc.headers import HeaderReader
from tapewire.fanuc.tv_check import Comments, TvCheck, TvFailure
from tapewire.transfer.files import check_name, open_part, why

__all__ = ["Converted", "TapeReport", "convert_file", "inspect_tape", "recognise_file"]

Result = TypeVar("Result")

CHUNK_BYTES: Final = 1 << 16
MOST_FAILURES: Final = 100
"""TV failures listed; a whole tape in the wrong count would fail in every second block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Converted:
    """What became of the file, and the code it was in."""

    source: DataCode
    recognition: Recognition | None
    """None where the code was told."""
    conversion: Conversion


@dataclass(frozen=True, slots=True, kw_only=True)
class TapeReport:
    """A program file as a control would see it."""

    recognition: Recognition
    blocks: int
    headers: HeaderReader
    failures: tuple[TvFailure, ...]
    """None are looked for unless asked."""


def recognise_file(path: Path, signs: EiaSigns = EIA_SIGNS) -> Recognition:
    """The code of the file at `path`. Raises UsageError when it cannot be read."""

    def read(file: IO[bytes]) -> Recognition:
        recogniser = Recogniser(signs)
        while chunk := file.read(CHUNK_BYTES):
            recogniser.feed(chunk)
        return recogniser.verdict

    return _reading(path, read)


def convert_file(
    path: Path,
    out: Path,
    *,
    source: DataCode | None,
    target: DataCode,
    eob: EobForm = EobForm.LF,
    feed: int | None = None,
    signs: EiaSigns = EIA_SIGNS,
    force: bool = False,
) -> Converted:
    """Convert the program in `path` to `out`; `source` None recognises its code.

    The result is read back and must hold the same text before it gets its name. Raises ProgramError with line and
    column for what cannot be converted, UsageError for a file that cannot be read or written, or that exists
    without `force`.
    """
    check_name(out, force=force)
    recognition = recognise_file(path, signs) if source is None else None
    code = source if recognition is None else recognition.code
    if code is None:
        assert recognition is not None
        raise _unknown(path, recognition)
    part_path = out.with_name(out.name + ".part")
    part = open_part(part_path)
    try:
        part.begin()
        told, read_back = _Digest(), _Digest()

        def work(file: IO[bytes]) -> Conversion:
            return convert(file.read, part.write, code, target, eob=eob, feed=feed, signs=signs, tell_text=told.update)

        conversion = _reading(path, work)
        part.sync()
        _reading(part_path, lambda file: read_text(file.read, target, read_back.update, signs))
        if told.value != read_back.value:
            raise ProgramError(f"{out}: the round trip lost something: the text read back is not that of {path}")
        part_path.replace(out)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({why(error)})") from None
    finally:
        part.close()
        part_path.unlink(missing_ok=True)
    return Converted(source=code, recognition=recognition, conversion=conversion)


def inspect_tape(
    path: Path,
    *,
    source: DataCode | None = None,
    comments: Comments | None = None,
    signs: EiaSigns = EIA_SIGNS,
) -> TapeReport:
    """What the file at `path` is; `comments` asks for a TV check. Raises as `convert_file` does."""
    recognition = recognise_file(path, signs) if source is None else Recognition(code=source, why="as told")
    code = recognition.code
    if code is None:
        raise _unknown(path, recognition)
    headers = HeaderReader()
    blocks = 0

    def take(text: bytes) -> None:
        nonlocal blocks
        blocks += text.count(b"\n")
        for line in text.splitlines(keepends=True):
            headers.take(line)

    _reading(path, lambda file: read_text(file.read, code, take, signs))
    failures = _tv_failures(path, TvCheck(code, comments=comments, signs=signs)) if comments is not None else ()
    return TapeReport(recognition=recognition, blocks=blocks, headers=headers, failures=failures)


def _tv_failures(path: Path, check: TvCheck) -> tuple[TvFailure, ...]:
    def read(file: IO[bytes]) -> tuple[TvFailure, ...]:
        failures: list[TvFailure] = []
        while len(failures) < MOST_FAILURES and (chunk := file.read(CHUNK_BYTES)):
            failures += check.feed(chunk)
        return tuple(failures[:MOST_FAILURES])

    return _reading(path, read)


class _Digest:
    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def update(self, text: bytes) -> None:
        self._digest.update(text)

    @property
    def value(self) -> str:
        return self._digest.hexdigest()


def _unknown(path: Path, recognition: Recognition) -> UsageError:
    return UsageError(f"{path}: {recognition.why}; name its code with --from")


def _reading(path: Path, work: Callable[[IO[bytes]], Result]) -> Result:
    try:
        with path.open("rb") as file:
            return work(file)
    except ProgramError as error:
        raise ProgramError(f"{path}: {error}", line=error.line, column=error.column) from None
    except UsageError:
        raise
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({why(error)})") from None
