"""The command line: arguments in, one call of the service functions, text out."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

import click

from tapewire.cli.ending import interrupt_on_signals
from tapewire.cli.output import give_up_unwritable_output, json_end
from tapewire.errors import LineError, TapewireError, UsageError

__all__ = ["main"]

_COMMANDS: Final = {
    "demo": "tapewire.cli.demo",
    "send": "tapewire.cli.send",
    "receive": "tapewire.cli.receive",
    "cnc": "tapewire.cli.cnc",
    "decode": "tapewire.cli.decode",
    "monitor": "tapewire.cli.monitor",
    "bridgeport": "tapewire.cli.bridgeport",
    "simulate": "tapewire.cli.simulate",
    "g05": "tapewire.cli.g05",
    "ports": "tapewire.cli.ports",
    "qualify": "tapewire.cli.qualify",
    "convert": "tapewire.cli.convert",
    "fanuc": "tapewire.cli.fanuc",
}

REFUSED: Final = 2
NOT_COMPLETE: Final = 1
INTERRUPTED: Final = 130


class _Tapewire(click.Group):
    """Imports a command when it is asked for, and gives every end its exit status and its last line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        command = getattr(importlib.import_module(_COMMANDS[cmd_name]), cmd_name)
        assert isinstance(command, click.Command)
        return command

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> Any:
        words = list(sys.argv[1:] if args is None else args)
        extra["standalone_mode"] = False
        interrupt_on_signals()
        try:
            status = super().main(words, *rest, **extra)
        except click.UsageError as error:
            with suppress(OSError):
                error.show()
            status = _refused(words, error.format_message(), REFUSED)
        except UsageError as error:
            status = _refused(words, str(error), REFUSED, tell=True)
        except (LineError, TapewireError) as error:
            status = _refused(words, str(error), NOT_COMPLETE, tell=True)
        except (click.Abort, KeyboardInterrupt):
            status = _refused(words, "interrupted before anything was sent", INTERRUPTED, tell=True)
        except OSError as error:  # an output that cannot be written, no folder for temporary files
            give_up_unwritable_output()
            status = _refused(words, f"the system refuses: {error}", NOT_COMPLETE, tell=True)
        except Exception as error:
            _refused(words, f"an error of Tapewire itself: {error!r}; please report it", NOT_COMPLETE)
            raise
        sys.exit(status if isinstance(status, int) else 0)


def _refused(words: list[str], reason: str, status: int, *, tell: bool = False) -> int:
    """The command ended before a job did: say why, and end the JSON stream as every stream ends."""
    with suppress(OSError):
        if tell:
            click.echo(f"tapewire: {reason}", err=True)
    with suppress(OSError):
        if "--json" in words:
            click.echo(json_end("cancelled" if status == INTERRUPTED else "failed", reason))
    return status


@click.group(cls=_Tapewire, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="tapewire")
def main() -> None:
    """Feed NC programs to CNC controls over serial lines, take programs back, and simulate the control."""
