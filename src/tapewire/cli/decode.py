"""`tapewire decode`"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

import click

from tapewire.cli.common import COMPLETE, NOT_COMPLETE, parse_words
from tapewire.cli.output import give_up_unwritable_output
from tapewire.errors import UsageError
from tapewire.line.captures.reader import Problem, is_capture
from tapewire.line.captures.records import Side
from tapewire.protocols import PROTOCOLS
from tapewire.transfer.decoding.chart import Chart
from tapewire.transfer.decoding.reading import Decoded, Figures
from tapewire.transfer.decoding.reading import decode as decode_file
from tapewire.transfer.decoding.recognise import Asked
from tapewire.transfer.decoding.text import fields_of, line_of

__all__ = ["decode"]


@click.command()
@click.argument("file", type=click.Path(path_type=Path, allow_dash=True))
@click.option(
    "--protocol", metavar="NAME", help=f"One of {', '.join(PROTOCOLS)}; without it what the capture says, or a guess."
)
@click.option(
    "--set", "words", multiple=True, metavar="KEY=VALUE", help="A protocol parameter; may be given many times."
)
@click.option(
    "--side",
    type=click.Choice([side.value for side in Side]),
    help="Who wrote the capture, where it does not say so: what it calls sent is what this side said.",
)
@click.option("--svg", type=click.Path(path_type=Path), metavar="FILE", help="Draw the dialogue as a sequence chart.")
@click.option("--force", is_flag=True, help="Replace a picture that exists.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
def decode(
    file: Path,
    protocol: str | None,
    words: tuple[str, ...],
    side: str | None,
    svg: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Tell in the words of its protocol what was said in the capture FILE, and what of it was against the rules.

    FILE is pcapng or pcap of link type RTAC serial, from Tapewire or any other program; - is standard input.
    """
    asked = Asked(protocol=protocol, settings=parse_words(words), side=None if side is None else Side(side))
    if svg is not None and svg.exists() and not force:
        raise UsageError(f"{svg} exists; name another file, or say --force to replace it")
    with _opened(file) as stream:
        chart = None if svg is None else Chart(file.name)
        hashed = _Hashed(stream)
        teller = _Teller(as_json)
        try:
            for decoded in decode_file(hashed, asked):
                teller.tell(decoded)
                if chart is not None:
                    chart.add(decoded)
            if chart is not None and svg is not None:
                _write(svg, chart.svg())
            return teller.end(hashed.hexdigest())
        except BrokenPipeError:
            # Whoever reads has seen enough.
            give_up_unwritable_output()
            return NOT_COMPLETE


@contextmanager
def _opened(file: Path) -> Iterator[BufferedReader]:
    """Raises UsageError for what cannot be read or is no capture."""
    try:
        stream = file.open("rb") if str(file) != "-" else os.fdopen(os.dup(sys.stdin.fileno()), "rb")
    except OSError as error:
        raise UsageError(f"{file}: cannot be read ({error.strerror})") from error
    with stream:
        try:
            beginning = stream.peek(4)
        except OSError as error:
            raise UsageError(f"{file}: cannot be read ({error.strerror})") from error
        if not is_capture(beginning):
            raise UsageError(f"{file} is no capture: pcapng or pcap is expected, as --capture writes it")
        yield stream


def _write(path: Path, picture: str) -> None:
    try:
        path.write_text(picture, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from error


class _Hashed:
    """A file that is read, and what of it was."""

    def __init__(self, file: BufferedReader) -> None:
        self._file = file
        self._digest = hashlib.sha256()

    def read(self, size: int, /) -> bytes:
        data = self._file.read(size)
        self._digest.update(data)
        return data

    def hexdigest(self) -> str:
        """Of what was read; it belongs to the file that was decoded when that was read to its end."""
        return self._digest.hexdigest()


class _Teller:
    """Puts what is decoded on stdout: the dialogue is what was asked for."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._characters = 0
        self._violations = 0
        self._problems: list[str] = []

    def tell(self, decoded: Decoded) -> None:
        match decoded:
            case Figures(characters=characters, violations=violations):
                self._characters += characters
                self._violations += violations
            case Problem(what=what):
                self._problems = [*self._problems, what][:1]
            case _:
                pass
        if self._as_json:
            name, at, fields = fields_of(decoded)
            self._say(json.dumps({"event": name, "time_ns": time.time_ns() if at is None else at, **fields}))
        else:
            self._say(line_of(decoded))

    def end(self, sha256: str) -> int:
        """Say the last word; the exit status."""
        if self._as_json:
            self._say(self._last_line(sha256))
        sys.stdout.flush()
        return NOT_COMPLETE if self._problems else COMPLETE

    def _last_line(self, sha256: str) -> str:
        reason = self._problems[0] if self._problems else "the capture was read to its end"
        fields = {
            "outcome": "failed" if self._problems else "complete",
            "bytes": self._characters,
            "bytes_handed": self._characters,
            "sha256": sha256,
            "reason": reason,
            "violations": self._violations,
        }
        return json.dumps({"event": "end", "time_ns": time.time_ns(), **fields})

    @staticmethod
    def _say(text: str) -> None:
        # A name in a foreign capture may hold what this terminal cannot show.
        encoding = sys.stdout.encoding or "utf-8"
        sys.stdout.write(text.encode(encoding, "replace").decode(encoding) + "\n")
