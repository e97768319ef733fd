"""What `tapewire demo` shows: both ends of the line, live, and at the end the proof."""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Final

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tapewire.cli.output import give_up_unwritable_output
from tapewire.engine import AfterStop, Held, Nanos, Resumed
from tapewire.protocols.fanuc_b.messages import BUFFER_BYTES
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Progress, Report, Result
from tapewire.transfer.session import JobSettings

__all__ = ["DemoView"]

PLAIN_INTERVAL_S: Final = 5.0
"""Without a terminal a line is printed this often."""

REFRESHES_PER_S: Final = 5


class _Paper(Console):
    """Where it is drawn. Once nothing can be written there, nothing is; the demo goes on, and its status tells."""

    def on_broken_pipe(self) -> None:
        """The console's own way is to exit."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    def try_to(self, draw: Callable[[], None]) -> None:
        if self.quiet:
            return
        try:
            draw()
        except OSError:
            self.quiet = True
            give_up_unwritable_output()


class DemoView:
    """Collects what both ends report and draws it, from a thread of its own."""

    def __init__(self, program: Program, host: JobSettings) -> None:
        self._console = _Paper(highlight=False)
        self._title = f"{program.name}, {program.byte_count:,} bytes, {host.protocol.title}, {host.baud} baud"
        self._total = program.byte_count
        self._host: Progress | None = None
        self._cnc: Progress | None = None
        self._held = 0
        self._resumed = 0
        self._after_stop = 0
        self._allowed = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(
            target=self._console.try_to, args=(self._work,), name="tapewire-demo-view", daemon=True
        )

    def observe_host(self, report: Report, now: Nanos) -> None:
        match report:
            case Progress():
                self._host = report
            case Held():
                self._held += 1
            case Resumed():
                self._resumed += 1
            case _:
                pass

    def observe_cnc(self, report: Report, now: Nanos) -> None:
        match report:
            case Progress():
                self._cnc = report
            case AfterStop(count=count, allowed=allowed):
                self._after_stop, self._allowed = max(self._after_stop, count), allowed
            case _:
                pass

    def __enter__(self) -> DemoView:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.set()
        self._thread.join()

    def _work(self) -> None:
        if not self._console.is_terminal:
            self._console.print(self._title, soft_wrap=True)
            while not self._closing.wait(PLAIN_INTERVAL_S):
                self._console.print(self._line(), soft_wrap=True)
            return
        with Live(self._picture(), console=self._console, auto_refresh=False) as live:
            while not self._closing.wait(1 / REFRESHES_PER_S):
                live.update(self._picture(), refresh=True)
            live.update(self._picture(), refresh=True)

    def _line(self) -> str:
        sent = self._host.bytes if self._host else 0
        buffered, blocks = (self._cnc.buffered or 0, self._cnc.blocks or 0) if self._cnc else (0, 0)
        share = self._host.share if self._host else 0.0
        return (
            f"{time.strftime('%H:%M:%S')}  sent {sent:,} of {self._total:,}, {share:.1%} of the line; "
            f"buffer {buffered:,} of {BUFFER_BYTES:,}; DC3 {self._held}, DC1 {self._resumed}; {blocks:,} blocks"
        )

    def _picture(self) -> Table:
        table = Table.grid(padding=(0, 2))
        table.title, table.title_justify, table.title_style = self._title, "left", "bold"
        host, cnc = self._host, self._cnc
        state = Text("waiting") if host is None else Text("held", "yellow") if host.held else Text("running", "green")
        sent, buffered = (host.bytes if host else 0), (cnc.buffered or 0 if cnc else 0)
        share = f"{host.share:.1%} of the line while not held" if host and host.share else ""
        table.add_row("host", state, ProgressBar(self._total, sent, width=30), f"sent {sent:,} bytes", share)
        table.add_row("", "", "", f"DC3 {self._held}, DC1 {self._resumed}", "")
        blocks = cnc.blocks or 0 if cnc else 0
        after = f"at most {self._after_stop} characters after DC3" if self._after_stop else ""
        table.add_row("control", "buffer", ProgressBar(BUFFER_BYTES, buffered, width=30), f"{buffered:,} bytes", after)
        table.add_row("", "", "", f"{blocks:,} blocks executed", "")
        return table

    def conclude(self, sent: Result, taken: Result) -> bool:
        """Print the outcome of both ends; True when the control has exactly what the host sent."""
        identical = sent.sha256 == taken.sha256 and taken.bytes == self._total
        self._console.try_to(lambda: self._print_outcome(sent, taken, identical))
        return identical

    def _print_outcome(self, sent: Result, taken: Result, identical: bool) -> None:
        say = self._console.print
        say(f"host     {sent.outcome}: {sent.bytes:,} bytes, sha256 {sent.sha256}", soft_wrap=True)
        say(f"control  {taken.outcome}: {taken.bytes:,} bytes, sha256 {taken.sha256}", soft_wrap=True)
        if sent.utilisation is not None:
            say(f"line utilisation {sent.utilisation:.2%} over the time not held, first window left out")
        after = f"; at most {self._after_stop} characters after DC3, {self._allowed} allowed" if sent.stops else ""
        say(f"stopped {sent.stops} times by DC3{after}")
        say("byte-identical" if identical else f"NOT identical: {sent.reason}; {taken.reason}", soft_wrap=True)
