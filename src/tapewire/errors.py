"""Every exception of Tapewire.

Three kinds of wrong are kept apart. What the wire does wrong is an event, never an exception. What the caller
asks for wrongly, and a line or a job that fails, is one of these. What we did wrong ourselves is an assertion.

    TapewireError
     +-- UsageError (ValueError)     asked for something impossible: an option, a setting, a LINE
     |    +-- ProgramError           the program file cannot be sent as it is: where, and what to do
     +-- LineError (OSError)         the line
     |    +-- LineNotFound           no such port or host
     |    +-- LineBusy               somebody else has it
"""

from __future__ import annotations

__all__ = [
    "LineBusy",
    "LineError",
    "LineNotFound",
    "ProgramError",
    "TapewireError",
    "UsageError",
]


class TapewireError(Exception):
    """The root: catch this to catch everything Tapewire raises on purpose."""


class UsageError(TapewireError, ValueError):
    """The caller asked for something impossible. Nothing was opened and nothing was sent."""


class ProgramError(UsageError):
    """The program cannot be sent as it is.

    `line` and `column` count from 1 and are None where the fault belongs to the whole file.
    """

    def __init__(self, message: str, *, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.line = line
        self.column = column


class LineError(TapewireError, OSError):
    """The line could not be opened. One that is lost while open ends its job, and is no exception."""


class LineNotFound(LineError):
    """There is no such port, path or host."""


class LineBusy(LineError):
    """The port is held by another program."""
