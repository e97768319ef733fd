"""Where the figures go: one section of docs/performance.md, or of another page, a benchmark, written by itself."""

from __future__ import annotations

import os
import platform
import re
import statistics
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

PAGE = Path(__file__).parent.parent / "docs" / "performance.md"


def write_section(name: str, title: str, text: str, page_path: Path = PAGE) -> None:
    """Print `text` and put it into its place in the page; a new section goes to the end."""
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    body = f"## {title}\n\n{text.strip()}\n\n*Measured {datetime.now(UTC).date().isoformat()} on {machine}.*\n"
    print(body)
    block = f"<!-- begin {name} -->\n{body}<!-- end {name} -->\n"
    page = page_path.read_text()
    pattern = re.compile(rf"<!-- begin {name} -->\n.*?<!-- end {name} -->\n", re.DOTALL)
    page_path.write_text(pattern.sub(lambda _: block, page) if pattern.search(page) else f"{page.rstrip()}\n\n{block}")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def spread(values: Sequence[float], form: str) -> str:
    """Median, then minimum and maximum."""
    low, middle, high = min(values), statistics.median(values), max(values)
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"
