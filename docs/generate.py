"""Writes the parts of the docs that are taken from the code, each between its two markers:

    <!-- begin generated: NAME -->
    <!-- end generated: NAME -->

`scripts/docs` runs it; a test of the house fails when a page lags behind the code. Every file in docs/generators with
a table `PARTS` takes part.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).parent

_MARKED: Final = re.compile(
    r"(?P<begin><!-- begin generated: (?P<name>[^\n]+?) -->\n).*?(?P<end><!-- end generated: (?P=name) -->)", re.S
)


def _collected() -> dict[str, Callable[[], str]]:
    parts: dict[str, Callable[[], str]] = {}
    for path in sorted((DOCS / "generators").glob("*.py")):
        module = importlib.import_module(f"docs.generators.{path.stem}")
        for name, make in getattr(module, "PARTS", {}).items():
            assert name not in parts, f"two generators make {name!r}"
            parts[name] = make
    return parts


PARTS: Final = _collected()


def main() -> None:
    for page in sorted(DOCS.glob("**/*.md")):
        page.write_text(regenerated(page.read_text()))


def regenerated(text: str) -> str:
    """A page with every marked part written anew. Raises KeyError for a name that nobody makes."""
    return _MARKED.sub(lambda found: f"{found['begin']}{PARTS[found['name']]()}\n{found['end']}", text)


def marked_names(text: str) -> list[str]:
    return [found["name"] for found in _MARKED.finditer(text)]


if __name__ == "__main__":
    main()
