"""The names of what nobody can detect: one list, said by the code and explained by the page."""

from __future__ import annotations

from pathlib import Path

from tapewire.sim.names import Undetectable

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "simulator.md"
SOURCES = ROOT / "src" / "tapewire" / "sim"


def names_of_the_page() -> list[str]:
    table = PAGE.read_text().split("| protocol | name | what it is |")[1].split("\n\n")[0]
    return [row.split("|")[2].strip() for row in table.splitlines()[2:]]


def test_every_name_has_a_row_and_every_row_a_name() -> None:
    rows = names_of_the_page()
    assert len(set(rows)) == len(rows)
    assert set(rows) == {name.value for name in Undetectable}


def test_the_code_says_every_name_and_no_other() -> None:
    sources = {path.name: path.read_text() for path in SOURCES.glob("*.py") if path.name != "names.py"}
    text = "".join(sources.values())
    assert [name for name in Undetectable if f"Undetectable.{name.name}" not in text] == []
    for file, source in sources.items():
        assert [name for name in Undetectable if f'"{name.value}"' in source] == [], f"{file}: a name as a text"
