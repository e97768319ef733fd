"""`tapewire monitor`"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

import click

from tapewire.cli.common import (
    COMPLETE,
    INTERRUPTED,
    NOT_COMPLETE,
    capture_of,
    capture_options,
    parse_words,
    when_lost_option,
)
from tapewire.cli.ending import ignore_signals, stop_on_signals
from tapewire.cli.output import JsonLines, Output, PeopleLines, Presenter, Shown
from tapewire.engine import Outcome
from tapewire.errors import UsageError
from tapewire.line.captures.records import Side
from tapewire.line.open import parse_line
from tapewire.line.relay import Damaged
from tapewire.protocols import PROTOCOLS
from tapewire.protocols import protocol as protocol_called
from tapewire.protocols.settings import End
from tapewire.transfer.decoding.entry import Entry
from tapewire.transfer.decoding.recognise import Asked
from tapewire.transfer.decoding.text import entry_fields, entry_line, unix_time
from tapewire.transfer.monitoring import MonitorSettings
from tapewire.transfer.monitoring import monitor as watch
from tapewire.transfer.reopening import WhenLost
from tapewire.transfer.reports import Result

__all__ = ["monitor"]


@click.command()
@click.option(
    "--line",
    "lines",
    required=True,
    multiple=True,
    metavar="LINE",
    help="The line to the host, and a second time the line to the control; or one line alone, to listen to.",
)
@click.option("--protocol", metavar="NAME", help=f"One of {', '.join(PROTOCOLS)}; without it, a guess.")
@click.option("--baud", type=click.IntRange(50, 4_000_000), help="Bits a second; each protocol has its default.")
@click.option("--stopbits", type=click.Choice([1, 2]), help="8E1 or 8N2, for bridgeport 7E1 or 7E2.")
@click.option(
    "--set", "words", multiple=True, metavar="KEY=VALUE", help="A protocol parameter; may be given many times."
)
@click.option(
    "--hears",
    type=click.Choice([side.value for side in Side]),
    default=Side.CONTROL.value,
    show_default=True,
    help="Who speaks on a single line.",
)
@click.option(
    "--damaged",
    type=click.Choice([what.value for what in Damaged]),
    default=Damaged.STOP.value,
    show_default=True,
    help="A character that arrives damaged closes both lines, or is left out.",
)
@when_lost_option
@capture_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout.")
def monitor(
    lines: tuple[str, ...],
    protocol: str | None,
    baud: int | None,
    stopbits: int | None,
    words: tuple[str, ...],
    hears: str,
    damaged: str,
    when_lost: str,
    capture: Path | None,
    capture_size: int,
    as_json: bool,
) -> int:
    """Tell what is said on a line while it is said: between a host and a control, or on one line alone.

    With two lines all that either side says is passed on to the other, its control lines too. Ctrl-C ends it.
    """
    asked = Asked(protocol=protocol, settings=parse_words(words))
    rate, stops, data_bits = _framing(asked, baud, stopbits)
    settings = MonitorSettings(
        lines=tuple(map(parse_line, lines)),
        baud=rate,
        stopbits=stops,
        data_bits=data_bits,
        asked=asked,
        damaged=Damaged(damaged),
        hears=Side(hears),
        when_lost=WhenLost(when_lost),
        capture=capture_of(capture, capture_size),
    )
    output = Output(*_presenters(as_json))
    try:
        result = asyncio.run(_run(settings, output))
        output.show(result)
    finally:
        output.close()
    if result.outcome is Outcome.CANCELLED:
        return INTERRUPTED
    return COMPLETE if result.outcome is Outcome.COMPLETE else NOT_COMPLETE


def _framing(asked: Asked, baud: int | None, stopbits: int | None) -> tuple[int, int, int]:
    """Rate, stop bits and data bits. Raises UsageError."""
    if asked.protocol is None:
        if baud is None:
            raise UsageError("without --protocol the rate is not known: give --baud")
        return baud, stopbits or 1, 8
    entry = protocol_called(asked.protocol)
    stops = stopbits or entry.stopbits
    return baud or entry.baud, stops, entry.data_bits(entry.params(asked.settings, End.HOST), stops)


async def _run(settings: MonitorSettings, output: Output) -> Result:
    stop = asyncio.Event()
    stop_on_signals(stop)
    try:
        return await watch(settings.observed_by(output.observe, output.show, stop))
    finally:
        ignore_signals()


def _presenters(as_json: bool) -> list[Presenter]:
    """The dialogue is what was asked for: it goes to stdout. What there is to know besides goes to stderr."""
    presenters: list[Presenter] = []
    if sys.stdout is not None:
        presenters.append(_JsonDialogue() if as_json else _Dialogue())
    if sys.stderr is not None:
        presenters.append(PeopleLines("monitor", "passed on"))
    return presenters


class _JsonDialogue(JsonLines):
    """Entries among the events of every command."""

    def show(self, shown: Shown, time_ns: int) -> None:
        if isinstance(shown, Entry):
            event = {"event": shown.kind.value, "time_ns": time_ns, "at_ns": shown.at, **entry_fields(shown)}
            sys.stdout.write(json.dumps(event) + "\n")
            sys.stdout.flush()
        else:
            super().show(shown, time_ns)


class _Dialogue:
    """One line for each entry; times count from the first."""

    def __init__(self) -> None:
        self._began: int | None = None

    def show(self, shown: Shown, time_ns: int) -> None:
        if isinstance(shown, Entry):
            if self._began is None:
                self._began = shown.at
                sys.stdout.write(f"== times count from {unix_time(shown.at)}\n")
            sys.stdout.write(entry_line(shown, self._began) + "\n")
            sys.stdout.flush()

    def close(self) -> None:
        sys.stdout.flush()
