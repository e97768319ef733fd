"""`tapewire` processes, and what must hold for each of them whatever it was told."""

from __future__ import annotations

import json
import os
import queue
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from resource import RLIM_INFINITY
from typing import Any, Final

import pytest

from tapewire.cli import main
from tapewire.cli.ending import ENDING_SIGNALS
from tests.cli.forked import Forked

DEADLINE_S: Final = 30.0
"""Longer than any of these commands takes on a busy machine; nothing is ever measured against it."""

FAST: Final = ("--baud", "921600")

JsonObject = dict[str, Any]


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    status: int
    events: list[JsonObject]
    stdout: str
    stderr: str

    @property
    def end(self) -> JsonObject:
        return self.events[-1]

    def named(self, name: str) -> list[JsonObject]:
        return [event for event in self.events if event["event"] == name]

    @property
    def outcome(self) -> tuple[int, str]:
        return self.status, str(self.end["outcome"])


class Command:
    """A running `tapewire`. Its outputs are read by threads, so that it never waits for the test."""

    def __init__(self, *words: object, largest_file: int = RLIM_INFINITY) -> None:
        self.words = [str(word) for word in words]
        self.is_json = "--json" in self.words
        (output, write_output), (errors, write_errors) = os.pipe(), os.pipe()
        with open(os.devnull, "rb") as nothing:
            streams = (nothing.fileno(), write_output, write_errors)
            self.process = Forked(self.words, streams, largest_file=largest_file)
        os.close(write_output)
        os.close(write_errors)
        self._lines: list[str] = []
        self._arrivals: queue.Queue[JsonObject | None] = queue.Queue()
        self._errors = ""
        self._readers = [
            threading.Thread(target=self._read_output, args=(output,)),
            threading.Thread(target=self._read_errors, args=(errors,)),
        ]
        for reader in self._readers:
            reader.start()

    def _read_output(self, pipe: int) -> None:
        with open(pipe) as output:
            for line in output:
                self._lines.append(line)
                if self.is_json:
                    self._arrivals.put(json.loads(line))
        self._arrivals.put(None)

    def _read_errors(self, pipe: int) -> None:
        with open(pipe) as errors:
            self._errors = errors.read()

    def wait_for(self, name: str, **fields: object) -> JsonObject:
        """The next event called `name` with these fields."""
        deadline = time.monotonic() + DEADLINE_S
        while True:
            event = self._arrivals.get(timeout=max(0.0, deadline - time.monotonic()))
            assert event is not None, f"no {name} event before the end of {self}"
            if event["event"] == name and fields.items() <= event.items():
                return event

    def wait_for_bytes(self, count: int) -> JsonObject:
        """The first progress with at least `count` bytes."""
        while (event := self.wait_for("progress"))["bytes"] < count:
            pass
        return event

    @property
    def port(self) -> int:
        """The TCP port of a command that listens, or that has just been told to."""
        return int(self.wait_for("ready")["line"].rpartition(":")[2])

    def interrupt(self, number: signal.Signals = signal.SIGINT) -> None:
        self.process.send_signal(number)

    def finish(self) -> Finished:
        """Wait for its end, and hold it against the rules of every command."""
        status = self.process.wait(DEADLINE_S)
        if status is None:
            self.kill()
            raise AssertionError(f"no end of {self}\n{''.join(self._lines)}{self._errors}")
        for reader in self._readers:
            reader.join(DEADLINE_S)
        events = [json.loads(line) for line in self._lines] if self.is_json else []
        return check(Finished(status, events, "".join(self._lines), self._errors), self.words)

    def kill(self) -> None:
        self.process.kill(DEADLINE_S)
        for reader in self._readers:
            reader.join(DEADLINE_S)

    def __str__(self) -> str:
        return f"tapewire {' '.join(self.words)}"


def invoke(*words: object) -> Finished:
    """The same in this process, for what ends before a line is opened: many of them in the time of one."""
    return check(printed(*words), [str(word) for word in words])


def printed(*words: object) -> Finished:
    """The same of a command that works no line: what it is for goes to stdout."""
    texts = [str(word) for word in words]
    output, errors = StringIO(), StringIO()
    with own_handlers(), redirect_stdout(output), redirect_stderr(errors), pytest.raises(SystemExit) as ended:
        main(texts, prog_name="tapewire")
    assert isinstance(ended.value.code, int)
    events = [json.loads(line) for line in output.getvalue().splitlines()] if "--json" in texts else []
    return Finished(ended.value.code, events, output.getvalue(), errors.getvalue())


@contextmanager
def own_handlers() -> Iterator[None]:
    """What a command makes of its signals ends with it."""
    handlers = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def check(finished: Finished, words: list[str]) -> Finished:
    """Hold a command against the rules of every command."""
    for noise in ("Traceback", "Exception", "Warning"):
        assert noise not in finished.stderr, f"{words}\n{finished.stderr}"
    if "--json" in words:
        check_stream(finished.events)
    else:
        assert finished.stdout == ""
    return finished


END_FIELDS: Final = {"outcome", "bytes", "bytes_handed", "sha256", "reason"}


def check_stream(events: list[JsonObject]) -> None:
    """Every line an object with its event and its moment; one end, which comes last."""
    assert events, "nothing was said at all"
    assert all(isinstance(event["event"], str) and isinstance(event["time_ns"], int) for event in events)
    moments = [event["time_ns"] for event in events]
    assert moments == sorted(moments)
    assert abs(moments[-1] - time.time_ns()) < 3600 * 10**9, "not Unix time in nanoseconds"
    assert [event["event"] for event in events].count("end") == 1
    end = events[-1]
    assert end["event"] == "end"
    assert end.keys() >= END_FIELDS
    assert end["outcome"] in ("complete", "cancelled", "failed")
    assert 0 <= end["bytes"] <= end["bytes_handed"]
    assert end["reason"]
    assert "\n" not in end["reason"]
    progress = [event["time_ns"] for event in events if event["event"] == "progress"]
    crowded = [begin for begin, sixth in zip(progress, progress[5:], strict=False) if sixth - begin < 10**9]
    assert not crowded, "more than five progress events within a second"


@dataclass
class Shop:
    """Starts commands and ends them with the test, whatever became of it."""

    folder: Path
    commands: list[Command] = field(default_factory=list)

    def start(self, *words: object, largest_file: int = RLIM_INFINITY) -> Command:
        """`largest_file` is in bytes; what goes beyond it meets an error as on a full disk."""
        command = Command(*words, largest_file=largest_file)
        self.commands.append(command)
        return command

    def run(self, *words: object) -> Finished:
        return self.start(*words).finish()

    def file(self, name: str, content: bytes) -> Path:
        path = self.folder / name
        path.write_bytes(content)
        return path

    @property
    def files(self) -> set[str]:
        """What lies in the folder, without what was put there by `file` names beginning with `in`."""
        return {path.name for path in self.folder.iterdir() if not path.name.startswith("in")}


@contextmanager
def open_shop(folder: Path) -> Iterator[Shop]:
    shop = Shop(folder)
    try:
        yield shop
    finally:
        for command in shop.commands:
            if not command.process.has_ended:
                command.kill()


def program(blocks: int, *, label: bool = True) -> bytes:
    """A program that goes out as it is."""
    body = b"".join(b"N%dG01X%d.5Y-%d.25\n" % (number, number, number % 90) for number in range(1, blocks + 1))
    return (b"%\n" if label else b"") + b"O0001(TEST)\n" + body + b"M30\n%"
