"""`tapewire convert`"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from tapewire.cli.common import COMPLETE
from tapewire.codes import DataCode, EiaSigns
from tapewire.fanuc.conversion import EobForm
from tapewire.transfer.converting import convert_file

__all__ = ["CODES", "convert", "source_of"]

CODES: Final = ("iso", "eia", "ascii")
LONGEST_FEED: Final = 1_000_000
"""2.5 km of tape: longer than any leader."""

SOURCE: Final = click.option(
    "--from",
    "source",
    type=click.Choice(["auto", *CODES]),
    default="auto",
    show_default=True,
    help="The code FILE is in.",
)
ASSIGN: Final = click.option(
    "--assign",
    "words",
    multiple=True,
    metavar="SIGN=HH",
    help="An EIA code that the control's parameters assign, as in #=1C; may be given many times.",
)


def source_of(word: str) -> DataCode | None:
    """None for a code that is to be recognised."""
    return None if word == "auto" else DataCode(word)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@SOURCE
@click.option("--to", "target", type=click.Choice(CODES), required=True, help="The code OUT shall be in.")
@click.option(
    "--eob",
    type=click.Choice([str(form) for form in EobForm]),
    default="lf",
    show_default=True,
    help="The end of block in iso and ascii; eia has one code for it.",
)
@click.option(
    "--feed",
    type=click.IntRange(0, LONGEST_FEED),
    metavar="COUNT",
    help="Blank tape before and after the program; without it as much as there was.",
)
@ASSIGN
@click.option("--force", is_flag=True, help="Replace OUT if it exists.")
def convert(
    file: Path,
    out: Path,
    source: str,
    target: str,
    eob: str,
    feed: int | None,
    words: tuple[str, ...],
    force: bool,
) -> int:
    """Write the program in FILE to OUT in another punched-tape code, losing nothing, or refuse with the place.

    OUT is read back and compared before it gets its name.
    """
    made = convert_file(
        file,
        out,
        source=source_of(source),
        target=DataCode(target),
        eob=EobForm(eob),
        feed=feed,
        signs=EiaSigns.parse(words),
        force=force,
    )
    told = f" ({made.recognition.why})" if made.recognition is not None else ""
    done = made.conversion
    click.echo(
        f"{file.name} is {made.source.upper()}{told}; {out.name}: {done.blocks:,} blocks, {done.byte_count:,} bytes "
        f"in {target.upper()}, {done.leader:,} bytes of leader, {done.trailer:,} of trailer",
        err=True,
    )
    return COMPLETE
