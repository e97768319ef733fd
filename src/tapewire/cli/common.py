"""Options that several commands share, and the run of one job."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Awaitable, Callable
from typing import Any, Final, TypeVar

import click

from tapewire.cli.output import JsonLines, Output, PeopleLines, Presenter
from tapewire.engine import Outcome
from tapewire.errors import UsageError
from tapewire.protocols import PROTOCOLS
from tapewire.transfer.reports import Result

__all__ = ["COMPLETE", "INTERRUPTED", "NOT_COMPLETE", "line_options", "parse_words", "run_job", "stop_on_signals"]

COMPLETE: Final = 0
NOT_COMPLETE: Final = 1
INTERRUPTED: Final = 130

Command = TypeVar("Command", bound=Callable[..., Any])

_OPTIONS: Final = (
    click.option(
        "--line",
        required=True,
        metavar="LINE",
        help="A tty path, socket://HOST:PORT, listen://HOST:PORT, or pty:PATH.",
    ),
    click.option("--protocol", required=True, metavar="NAME", help=f"One of {', '.join(PROTOCOLS)}."),
    click.option("--baud", type=click.IntRange(50, 4_000_000), help="Bits a second; each protocol has its default."),
    click.option(
        "--stopbits", type=click.Choice(["1", "2"]), default="1", help="1 is 8E1, 2 is 8N2.", show_default=True
    ),
    click.option(
        "--set", "words", multiple=True, metavar="KEY=VALUE", help="A protocol parameter; may be given many times."
    ),
    click.option(
        "--timeout",
        type=click.FloatRange(min=0, min_open=True),
        metavar="SECONDS",
        help="Not complete so long after the start of the command: failed.",
    ),
    click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout."),
)


def line_options(command: Command) -> Command:
    """The options of every command that works a line."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def parse_words(words: tuple[str, ...]) -> dict[str, str]:
    """KEY=VALUE words to settings. Raises UsageError."""
    settings = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UsageError(f"--set {word}: KEY=VALUE is expected, as in --set posting=off")
        settings[key] = value
    return settings


def run_job(
    title: str,
    as_json: bool,
    job: Callable[[Output, asyncio.Event], Awaitable[Result]],
) -> int:
    """Run `job`, show what it reports, and return the exit status. Ctrl-C ends it in an orderly way."""
    presenters: list[Presenter] = [PeopleLines(title)]
    if as_json:
        presenters.insert(0, JsonLines())
    output = Output(*presenters)
    try:
        result, interrupted = asyncio.run(_run(output, job))
        output.show(result)
    finally:
        output.close()
    if result.outcome is Outcome.COMPLETE:
        return COMPLETE
    return INTERRUPTED if interrupted and result.outcome is Outcome.CANCELLED else NOT_COMPLETE


async def _run(output: Output, job: Callable[[Output, asyncio.Event], Awaitable[Result]]) -> tuple[Result, bool]:
    stop = asyncio.Event()
    stop_on_signals(stop)
    result = await job(output, stop)
    return result, stop.is_set()


def stop_on_signals(stop: asyncio.Event) -> None:
    """Ctrl-C and SIGTERM set `stop` from now on. Called inside a running loop."""
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
