"""Options that several commands share, and the run of one job."""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from tapewire.cli.ending import ignore_signals, stop_on_signals
from tapewire.cli.output import JsonLines, Output, PeopleLines, Presenter
from tapewire.engine import Notice, Outcome
from tapewire.errors import UsageError
from tapewire.line.captures.file import DEFAULT_SIZE, MEGABYTE, CaptureSettings
from tapewire.line.driver import monotonic
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.bridgeport.profile import Profile
from tapewire.protocols.settings import End
from tapewire.transfer.reopening import WhenLost
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings

__all__ = [
    "COMPLETE",
    "INTERRUPTED",
    "NOT_COMPLETE",
    "Number",
    "capture_of",
    "capture_options",
    "caution",
    "line_options",
    "line_options_of_one_protocol",
    "parse_words",
    "run_job",
    "settings_of",
    "when_lost_option",
]

COMPLETE: Final = 0
NOT_COMPLETE: Final = 1
INTERRUPTED: Final = 130


class Number(click.FloatRange):
    """A number within its range. click itself takes `nan` for one within any range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is no number", param, ctx)
        return number


Command = TypeVar("Command", bound=Callable[..., Any])

_LINE: Final = (
    click.option(
        "--line",
        required=True,
        metavar="LINE",
        help="A tty path, socket://, listen://, rfc2217:// or rfc2217+listen://HOST:PORT, or pty:PATH.",
    ),
)
_PROTOCOL: Final = click.option("--protocol", required=True, metavar="NAME", help=f"One of {', '.join(PROTOCOLS)}.")
_CAPTURE: Final = (
    click.option(
        "--capture",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Put all that is said on the line on record in FILE, as pcapng for Wireshark and tapewire decode.",
    ),
    click.option(
        "--capture-size",
        type=click.IntRange(1, 1_000_000),
        default=DEFAULT_SIZE // MEGABYTE,
        show_default=True,
        metavar="MB",
        help="What captures of this name may take up; the oldest goes first.",
    ),
)
_REST: Final = (
    click.option("--baud", type=click.IntRange(50, 4_000_000), help="Bits a second; each protocol has its default."),
    click.option(
        "--stopbits",
        type=click.Choice([1, 2]),
        help="8E1 or 8N2, for bridgeport 7E1 or 7E2; the default is 1, for bridgeport 2.",
    ),
    click.option(
        "--set", "words", multiple=True, metavar="KEY=VALUE", help="A protocol parameter; may be given many times."
    ),
    click.option(
        "--timeout",
        type=Number(min=0, min_open=True),
        metavar="SECONDS",
        help="Not complete so long after the start of the command: failed.",
    ),
    click.option(
        "--profile",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="bridgeport: a code table, and more settings, from a file; --set comes after it.",
    ),
    *_CAPTURE,
    click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout."),
)


def line_options(command: Command) -> Command:
    """The options of every command that works a line."""
    return _with(command, (*_LINE, _PROTOCOL, *_REST))


def line_options_of_one_protocol(command: Command) -> Command:
    """The same for a command that goes with one protocol alone."""
    return _with(command, (*_LINE, *_REST))


def capture_options(command: Command) -> Command:
    """The options of a command that can put a line on record."""
    return _with(command, _CAPTURE)


def when_lost_option(command: Command) -> Command:
    """For a command that may wait for something to begin, for days if need be."""
    option = click.option(
        "--when-lost",
        type=click.Choice([what.value for what in WhenLost]),
        default=WhenLost.END.value,
        show_default=True,
        help="A line that is lost ends the command, or is waited for under its name as long as no job has begun on it.",
    )
    return option(command)


def _with(command: Command, options: Sequence[Callable[[Command], Command]]) -> Command:
    for option in reversed(options):
        command = option(command)
    return command


def parse_words(words: tuple[str, ...]) -> dict[str, str]:
    """KEY=VALUE words to settings. Raises UsageError."""
    settings: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UsageError(f"--set {word}: KEY=VALUE is expected, as in --set posting=off")
        if key in settings:
            raise UsageError(f"--set {key} is given twice, as {settings[key]} and as {value}: say which one is meant")
        settings[key] = value
    return settings


def capture_of(capture: Path | None, size_mb: int) -> CaptureSettings | None:
    """Where the capture goes; None where none was asked for."""
    return None if capture is None else CaptureSettings(path=capture, size=size_mb * MEGABYTE)


def settings_of(words: tuple[str, ...], profile: Path | None, protocol: str, end: End) -> dict[str, str]:
    """The settings of a profile, with those of `--set` over them. Raises UsageError."""
    settings = parse_words(words)
    if profile is None:
        return settings
    if protocol != "bridgeport":
        raise UsageError(f"--profile holds the codes of bridgeport: it does not go with --protocol {protocol}")
    try:
        text = profile.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise UsageError(f"{profile}: cannot be read ({reason})") from None
    return {**Profile.loads(text, str(profile)).settings_for(end), **settings}


def caution(output: Output, job: JobSettings, profile: Path | None) -> None:
    """Say what of the protocol is not known for certain, to whoever has nothing better."""
    if job.protocol.caution and profile is None:
        output.observe(Notice(text=job.protocol.caution), monotonic())


def run_job(
    title: str,
    counted: str,
    as_json: bool,
    job: Callable[[Output, asyncio.Event], Awaitable[Result]],
) -> int:
    """Run `job`, show what it reports, and return the exit status. Ctrl-C ends it in an orderly way.

    `counted` says of the bytes of an interrupted job what has happened to them.
    """
    output = Output(*_presenters(title, counted, as_json))
    try:
        result, interrupted = asyncio.run(_run(output, job))
        output.show(result)
    finally:
        output.close()
    if result.outcome is Outcome.COMPLETE:
        return COMPLETE
    return INTERRUPTED if interrupted and result.outcome is Outcome.CANCELLED else NOT_COMPLETE


def _presenters(title: str, counted: str, as_json: bool) -> list[Presenter]:
    """A command started with one of its outputs closed has none there."""
    presenters: list[Presenter] = []
    if as_json and sys.stdout is not None:
        presenters.append(JsonLines())
    if sys.stderr is not None:
        presenters.append(PeopleLines(title, counted))
    return presenters


async def _run(output: Output, job: Callable[[Output, asyncio.Event], Awaitable[Result]]) -> tuple[Result, bool]:
    stop = asyncio.Event()
    stop_on_signals(stop)
    try:
        result = await job(output, stop)
    finally:
        ignore_signals()
    return result, stop.is_set()
