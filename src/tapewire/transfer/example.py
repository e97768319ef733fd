"""The program that `tapewire demo` feeds: examples/surfacing.nc, wherever this installation keeps it."""

from __future__ import annotations

from pathlib import Path

from tapewire.errors import UsageError

__all__ = ["example_program"]


def example_program() -> Path:
    """In an installed package it lies beside the code, in a checkout in `examples/`. Raises UsageError without it."""
    package = Path(__file__).parent.parent
    for folder in (package / "examples", package.parent.parent / "examples"):
        path = folder / "surfacing.nc"
        if path.exists():
            return path
    raise UsageError("examples/surfacing.nc is missing from this installation; install Tapewire again")
