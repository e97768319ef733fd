"""What a command shows while a job runs: JSON lines for programs, a progress bar or plain lines for people.

Each output is written by a thread of its own: a terminal that is stopped, or a pipe that nobody reads, never holds up
the line, nor the other output.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import queue
import re
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

from tapewire.engine import (
    AfterStop,
    Alarm,
    Event,
    Held,
    Nanos,
    Notice,
    Outcome,
    Received,
    Requested,
    Resumed,
    Started,
    Violation,
)
from tapewire.transfer.decoding.entry import Entry
from tapewire.transfer.reports import Progress, Ready, Report, Result, StopDistanceTold

if TYPE_CHECKING:
    from tapewire.cli.bar import Bar

__all__ = [
    "JsonLines",
    "Output",
    "PeopleLines",
    "Presenter",
    "Shown",
    "give_up_unwritable_output",
    "json_end",
    "summary",
]

WAITING_REPORTS: Final = 2000
"""More than this many unwritten reports: nobody reads, and further ones are dropped."""

PLAIN_PROGRESS_S: Final = 5.0
"""Without a terminal, progress is told this often."""

EVERYDAY: Final = frozenset({"DC1", "DC2", "DC3"})
"""Reasons to stop and to go on that need no line of their own: every long program has hundreds of them."""

CLOSE_LIMIT_S: Final = 2.0
"""A stopped terminal does not keep the command from ending."""


Shown: TypeAlias = Report | Result | Entry
"""An entry of a dialogue is shown by the command that listens to one, and by no other."""


class Presenter(Protocol):
    """Puts one report on paper. Runs in a thread of its own; `time_ns` is the Unix time of what it reports."""

    def show(self, shown: Shown, time_ns: int) -> None: ...

    def close(self) -> None: ...


class Output:
    """Hands reports to presenters, each in a thread of its own."""

    def __init__(self, *presenters: Presenter) -> None:
        self._desks = [_Desk(presenter) for presenter in presenters]

    def observe(self, report: Report, now: Nanos) -> None:
        self.show(report)

    def show(self, shown: Shown) -> None:
        time_ns = time.time_ns()
        for desk in self._desks:
            desk.put(shown, time_ns)

    def close(self) -> None:
        limit = time.monotonic() + CLOSE_LIMIT_S
        for desk in self._desks:
            desk.end()
        for desk in self._desks:
            desk.wait(limit)


class _Desk:
    """One presenter and its thread. A presenter that cannot write any more is given nothing else; the job goes on."""

    def __init__(self, presenter: Presenter) -> None:
        self._presenter = presenter
        self._queue: queue.SimpleQueue[tuple[Shown, int] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="tapewire-output", daemon=True)
        self._thread.start()

    def put(self, shown: Shown, time_ns: int) -> None:
        if isinstance(shown, Result) or self._queue.qsize() < WAITING_REPORTS:
            self._queue.put((shown, time_ns))

    def end(self) -> None:
        self._queue.put(None)

    def wait(self, limit: float) -> None:
        """Until all is written, or the monotonic clock says `limit`."""
        self._thread.join(max(0.0, limit - time.monotonic()))

    def _work(self) -> None:
        writable = True
        while (entry := self._queue.get()) is not None:
            writable = writable and self._try(self._presenter.show, *entry)
        if writable:
            self._try(self._presenter.close)

    @staticmethod
    def _try(act: Callable[..., None], *what: object) -> bool:
        try:
            act(*what)
        except (OSError, ValueError):
            return False
        return True


def give_up_unwritable_output() -> None:
    """When stdout takes nothing any more (a full disk, a reader that is gone), what is left for it goes nowhere:
    Python would try again when it exits, and complain.
    """
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _event_name(report: object) -> str:
    names: dict[type, str] = {StopDistanceTold: "stop_distance", AfterStop: "after_dc3"}
    return names.get(type(report)) or re.sub(r"(?<!^)(?=[A-Z])", "_", type(report).__name__).lower()


def _json_line(name: str, time_ns: int, fields: dict[str, Any]) -> str:
    return json.dumps({"event": name, "time_ns": time_ns, **fields})


def json_end(outcome: str, reason: str) -> str:
    """The last line of a JSON stream whose job never began."""
    nothing = hashlib.sha256().hexdigest()
    fields = {"outcome": outcome, "bytes": 0, "bytes_handed": 0, "sha256": nothing, "reason": reason}
    return _json_line("end", time.time_ns(), fields)


class JsonLines:
    """One JSON object a line on stdout, flushed."""

    def show(self, shown: Shown, time_ns: int) -> None:
        match shown:
            case Received() | Entry():
                return
            case Result():
                line = _json_line("end", time_ns, dataclasses.asdict(shown))
            case _:
                line = _json_line(_event_name(shown), time_ns, dataclasses.asdict(shown))
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    def close(self) -> None:
        sys.stdout.flush()


class PeopleLines:
    """Text on stderr; with a terminal, a bar below it."""

    def __init__(self, title: str, counted: str) -> None:
        self._counted = counted
        self._bar = _bar(title) if sys.stderr.isatty() else None
        self._last_progress = time.monotonic()
        self._held_by = ""

    def show(self, shown: Shown, time_ns: int) -> None:
        match shown:
            case Progress():
                self._show_progress(shown)
            case Entry():
                return
            case Result():
                if self._bar is not None:
                    self._bar.close()
                self._say(summary(shown, self._counted))
            case Held(why=why):
                self._held_by = why
                if why not in EVERYDAY:
                    self._say(f"held: {why}")
            case Resumed(why=why):
                stopped_by, self._held_by = self._held_by, ""
                if why not in EVERYDAY or stopped_by not in {"", *EVERYDAY}:
                    self._say(f"resumed: {why}")
            case _:
                text = _text(shown)
                if text:
                    self._say(text)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
        sys.stderr.flush()

    def _say(self, text: str) -> None:
        if self._bar is not None:
            self._bar.say(text)
        else:
            sys.stderr.write(text + "\n")
            sys.stderr.flush()

    def _show_progress(self, progress: Progress) -> None:
        if self._bar is not None:
            self._bar.show(progress, self._held_by)
        elif time.monotonic() - self._last_progress >= PLAIN_PROGRESS_S:
            self._last_progress = time.monotonic()
            total = "" if progress.total is None else f" of {progress.total:,}"
            reason = f": {self._held_by}" if self._held_by else ""
            held = f", held{reason}" if progress.held else ""
            share = f", {progress.share:.0%} of the line" if progress.share else ""
            self._say(f"{progress.bytes:,}{total} bytes{share}{held}")


def _bar(title: str) -> Bar:
    """Only a terminal needs what draws it."""
    from tapewire.cli.bar import Bar

    return Bar(title)


def _text(shown: Ready | StopDistanceTold | Event) -> str:
    """A report in one line; empty for what the bar shows or nobody needs to read."""
    match shown:
        case Notice(text=text):
            return text
        case Ready(line=line):
            return f"ready: {line}"
        case StopDistanceTold():
            return _stop_distance(shown)
        case Requested(number=number, served=False):
            return (
                "the control asked for a program, but none is armed: nothing is sent"
                if number is None
                else f"the control asked for program {number}, which is not to be had: nothing is sent yet"
            )
        case Started(why=why):
            return f"started: {why}"
        case Alarm(number=number, text=text):
            return f"alarm {number}: {text}"
        case Violation(what=what, count=count):
            return f"violation: {what}" + (f" ({count} times)" if count > 1 else "")
        case AfterStop(count=count, allowed=allowed) if count > allowed:
            return f"{count} characters came after DC3, {allowed} are allowed"
        case _:
            return ""


def _stop_distance(told: StopDistanceTold) -> str:
    distance = f"stop distance: {told.characters} characters, the control tolerates {told.needed}; {told.how}"
    if told.characters > told.needed:
        return f"WARNING: {distance}: this line can overrun the control"
    return distance if told.guaranteed else f"{distance} (not guaranteed)"


def summary(result: Result, counted: str) -> str:
    """The last line for people; `counted` says what has happened to the bytes of an interrupted job."""
    if result.outcome is Outcome.COMPLETE:
        used = "" if result.utilisation is None else f", {result.utilisation:.1%} of the line while not held"
        stops = f", stopped {result.stops} times" if result.stops else ""
        return f"complete: {result.bytes:,} bytes in {result.seconds:.1f} s{used}{stops}\nsha256 {result.sha256}"
    span = f"{result.bytes:,}"
    if result.bytes != result.bytes_handed:
        span = f"at least {result.bytes:,} and at most {result.bytes_handed:,}"
    return f"{result.outcome}: {result.reason}\n{span} bytes {counted}"
