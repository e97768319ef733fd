"""The help of every command."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import click

from docs.generators.markup import block
from tapewire.cli import main as command_line

HELP_WIDTH: Final = 80


def _help(name: str) -> str:
    context = _context(command_line, "tapewire")
    for word in name.split():
        assert isinstance(context.command, click.Group)
        command = context.command.get_command(context, word)
        assert command is not None
        context = _context(command, word, context)
    return block(context.command.get_help(context), "text")


def _context(command: click.Command, name: str, parent: click.Context | None = None) -> click.Context:
    options = {**command.context_settings, "terminal_width": HELP_WIDTH, "max_content_width": HELP_WIDTH}
    return click.Context(command, info_name=name, parent=parent, **options)


def command_names() -> list[str]:
    """Every command as it is typed behind `tapewire`, those of a group behind the group's name."""
    context = _context(command_line, "tapewire")
    names: list[str] = []
    for name in command_line.list_commands(context):
        command = command_line.get_command(context, name)
        names.append(name)
        if isinstance(command, click.Group):
            names += [f"{name} {under}" for under in command.list_commands(_context(command, name, context))]
    return names


PARTS: Final[dict[str, Callable[[], str]]] = {
    "tapewire --help": partial(_help, ""),
    **{f"tapewire {name} --help": partial(_help, name) for name in command_names()},
}
