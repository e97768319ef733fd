"""What a command shows while a job runs: JSON lines for programs, a progress bar or plain lines for people.

Everything is written by a thread of its own: a terminal that is stopped, or a pipe that nobody reads, never holds up
the line.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import queue
import re
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final, Protocol, TypeAlias

from tapewire.engine import AfterStop, Alarm, Event, Nanos, Notice, Outcome, Received, Started, Violation
from tapewire.transfer.reports import Progress, Ready, Report, Result, StopDistanceTold

__all__ = ["JsonLines", "Output", "PeopleLines", "Presenter", "json_end", "summary"]

WAITING_REPORTS: Final = 2000
"""More than this many unwritten reports: nobody reads, and further ones are dropped."""

PLAIN_PROGRESS_S: Final = 5.0
"""Without a terminal, progress is told this often."""

CLOSE_LIMIT_S: Final = 2.0
"""A stopped terminal does not keep the command from ending."""


Shown: TypeAlias = Report | Result


class Presenter(Protocol):
    """Puts one report on paper. Runs in the output thread."""

    def show(self, shown: Shown) -> None: ...

    def close(self) -> None: ...


class Output:
    """Hands reports to presenters in a thread of its own."""

    def __init__(self, *presenters: Presenter) -> None:
        self._presenters = list(presenters)
        self._queue: queue.SimpleQueue[Shown | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="tapewire-output", daemon=True)
        self._thread.start()

    def observe(self, report: Report, now: Nanos) -> None:
        self.show(report)

    def show(self, shown: Shown) -> None:
        if isinstance(shown, Result) or self._queue.qsize() < WAITING_REPORTS:
            self._queue.put(shown)

    def close(self) -> None:
        self._queue.put(None)
        self._thread.join(CLOSE_LIMIT_S)

    def _work(self) -> None:
        while (shown := self._queue.get()) is not None:
            for presenter in list(self._presenters):
                self._try(presenter, lambda p=presenter, s=shown: p.show(s))  # type: ignore[misc]
        for presenter in list(self._presenters):
            self._try(presenter, presenter.close)

    def _try(self, presenter: Presenter, act: Callable[[], None]) -> None:
        """Whoever cannot be written to any more is left out; the job goes on."""
        try:
            act()
        except (OSError, ValueError):
            self._presenters.remove(presenter)


def _event_name(report: object) -> str:
    names: dict[type, str] = {StopDistanceTold: "stop_distance", AfterStop: "after_dc3"}
    return names.get(type(report)) or re.sub(r"(?<!^)(?=[A-Z])", "_", type(report).__name__).lower()


def _json_line(name: str, fields: dict[str, Any]) -> str:
    return json.dumps({"event": name, "time_ns": time.time_ns(), **fields})


def json_end(outcome: str, reason: str) -> str:
    """The last line of a JSON stream whose job never began."""
    nothing = hashlib.sha256().hexdigest()
    return _json_line("end", {"outcome": outcome, "bytes": 0, "bytes_handed": 0, "sha256": nothing, "reason": reason})


class JsonLines:
    """One JSON object a line on stdout, flushed."""

    def show(self, shown: Shown) -> None:
        match shown:
            case Received():
                return
            case Result():
                line = _json_line("end", dataclasses.asdict(shown))
            case _:
                line = _json_line(_event_name(shown), dataclasses.asdict(shown))
        sys.stdout.write(line + "\n")
        sys.stdout.flush()

    def close(self) -> None:
        sys.stdout.flush()


class PeopleLines:
    """Text on stderr; with a terminal, a bar below it."""

    def __init__(self, title: str) -> None:
        from tapewire.cli.bar import Bar

        self._bar = Bar(title) if sys.stderr.isatty() else None
        self._last_progress = time.monotonic()

    def show(self, shown: Shown) -> None:
        if isinstance(shown, Progress):
            self._show_progress(shown)
        elif isinstance(shown, Result):
            if self._bar is not None:
                self._bar.close()
            self._say(summary(shown))
        else:
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
            self._bar.show(progress)
        elif time.monotonic() - self._last_progress >= PLAIN_PROGRESS_S:
            self._last_progress = time.monotonic()
            total = "" if progress.total is None else f" of {progress.total:,}"
            held = ", held" if progress.held else ""
            self._say(f"{progress.bytes:,}{total} bytes, {progress.share:.0%} of the line{held}")


def _text(shown: Ready | StopDistanceTold | Event) -> str:
    """A report in one line; empty for what the bar shows or nobody needs to read."""
    match shown:
        case Notice(text=text):
            return text
        case Ready(line=line):
            return f"ready: {line}"
        case StopDistanceTold():
            return _stop_distance(shown)
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


def summary(result: Result) -> str:
    """The last line for people."""
    if result.outcome is Outcome.COMPLETE:
        used = "" if result.utilisation is None else f", {result.utilisation:.1%} of the line while not held"
        stops = f", stopped {result.stops} times" if result.stops else ""
        return f"complete: {result.bytes:,} bytes in {result.seconds:.1f} s{used}{stops}\nsha256 {result.sha256}"
    span = f"{result.bytes:,}"
    if result.bytes != result.bytes_handed:
        span = f"at least {result.bytes:,} and at most {result.bytes_handed:,}"
    return f"{result.outcome}: {result.reason}\n{span} bytes had been delivered"
