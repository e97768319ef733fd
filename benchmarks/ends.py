"""The two ends of a line as real processes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).parent.parent / "examples" / "surfacing.nc"
LINES = ("TCP", "pty")


def tapewire(*words: str) -> subprocess.Popen[str]:
    """A tapewire process with its JSON lines on a pipe."""
    command = [sys.executable, "-m", "tapewire", *words, "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def first_event(process: subprocess.Popen[str], name: str) -> dict[str, Any]:
    """The next event called `name`."""
    assert process.stdout is not None
    for line in process.stdout:
        event: dict[str, Any] = json.loads(line)
        if event["event"] == name:
            return event
    raise RuntimeError(f"the process ended without {name}")


@contextmanager
def control_line(kind: str) -> Iterator[tuple[str, str]]:
    """The LINE of the end that makes the line, and a function's worth of the other: for TCP it comes with `ready`."""
    with tempfile.TemporaryDirectory() as folder:
        yield ("listen://127.0.0.1:0", "") if kind == "TCP" else (f"pty:{folder}/line", f"{folder}/line")


def other_line(kind: str, ready: dict[str, Any], path: str) -> str:
    """The LINE of the end that opens what the first one made."""
    return str(ready["line"]).replace("listen://", "socket://") if kind == "TCP" else path


def program_of(size: int, folder: str) -> Path:
    """The first blocks of the example, about `size` bytes, as a program of its own."""
    text = EXAMPLE.read_bytes()[:size]
    path = Path(folder) / f"first-{size}.nc"
    path.write_bytes(text[: text.rfind(b"\n") + 1] + b"M30\n%")
    return path
