"""The progress bar: bytes, rate, share of the line's capacity, time left, held or running."""

from __future__ import annotations

from datetime import timedelta
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as RichProgress
from rich.text import Text

from tapewire.transfer.reports import Progress

__all__ = ["Bar"]

REASON_WIDTH: Final = 24
"""Of the reason why it is held, so much fits in; a longer one has been told in a line of its own."""


class Bar:
    """One line at the bottom of the terminal."""

    def __init__(self, title: str) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._progress = RichProgress(
            TextColumn("{task.fields[state]}"),
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=None),
            TextColumn("{task.fields[figures]}"),
            console=self._console,
            auto_refresh=False,
            # Else --json would be drawn into the bar.
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._task = self._progress.add_task(title, total=None, state="waiting", figures="", start=False)
        self._progress.start()
        self._closed = False

    def show(self, progress: Progress, held_by: str) -> None:
        """`held_by` is the reason of the last stop that was told."""
        if progress.bytes:
            self._progress.start_task(self._task)
        state = f"[yellow]{escape(_held(held_by))}[/]" if progress.held else "[green]running[/]"
        self._progress.update(
            self._task,
            total=progress.total,
            completed=progress.bytes,
            state=state if progress.bytes else "waiting",
            figures=_figures(progress),
        )
        self._progress.refresh()

    def say(self, text: str) -> None:
        self._console.print(Text(text))

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._progress.stop()


def _held(held_by: str) -> str:
    reason = held_by if len(held_by) <= REASON_WIDTH else held_by[: REASON_WIDTH - 1] + "…"
    return f"held: {reason}" if reason else "held"


def _figures(progress: Progress) -> str:
    parts = [f"{progress.bytes:,}" + (f" of {progress.total:,} bytes" if progress.total else " bytes")]
    if progress.rate:
        parts += [f"{progress.rate:,.0f}/s", f"{progress.share:.0%} of the line"]
    if progress.buffered is not None:
        parts += [f"buffer {progress.buffered:,}", f"{progress.blocks:,} blocks"]
    if progress.left_s is not None:
        parts.append(f"{timedelta(seconds=round(progress.left_s))} left")
    return "  ".join(parts)
