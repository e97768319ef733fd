"""What every generator writes with: tables, blocks, and what the source says of its own names."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from enum import Enum
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from tapewire.engine import MILLISECOND, SECOND
from tapewire.protocols.settings import describe_settings

TRANSCRIPTS: Final = Path(__file__).parents[2] / "tests" / "transcripts"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def block(text: str, language: str = "") -> str:
    return f"```{language}\n{text.rstrip()}\n```"


def said_of(tree: ast.Module | ast.ClassDef) -> dict[str, str]:
    """Names assigned in `tree`, each with the docstring under it, empty where there is none."""
    said: dict[str, str] = {}
    for node, after in zip(tree.body, [*tree.body[1:], None], strict=True):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                said[name] = _string(after)
    return said


def _string(node: ast.stmt | None) -> str:
    match node:
        case ast.Expr(value=ast.Constant(value=str(text))):
            return " ".join(text.split())
    return ""


def members_said(words: type[Enum]) -> dict[str, str]:
    tree = ast.parse(inspect.getsource(words)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return said_of(tree)


def settings(settings: Iterable[tuple[str, str, str, str, str]]) -> str:
    rows = [(f"`{key}`", values, f"`{default}`", whose, why) for key, values, default, whose, why in settings]
    return table(("key", "values", "default", "end", "meaning"), rows)


def settings_of(record: type[Any]) -> str:
    return settings(describe_settings(record))


def states_said(states: type[Enum]) -> str:
    said = members_said(states)
    return table(
        ("state", "in words"),
        [
            (f"`{state.name}`", f"{state.value}{'. ' + said[state.name] if said[state.name] else ''}")
            for state in states
        ],
    )


def names_of(states: AbstractSet[Enum], order: type[Enum]) -> str:
    return ", ".join(f"`{state.name}`" for state in order if state in states)


def law_rows(law: Mapping[Any, AbstractSet[Enum]], states: type[Enum], causes: Sequence[Enum]) -> str:
    rows = [
        (f"`{state.name}`", _cause(cause), names_of(law[state, cause], states))
        for state in states
        for cause in causes
        if (state, cause) in law
    ]
    return table(("state", "what happens", "then"), rows)


def _cause(cause: Enum) -> str:
    return f"`{cause.name}` {cause.value}" if isinstance(cause.value, str) else cause.name


def members_table(words: type[Enum], header: str) -> str:
    said = members_said(words)
    return table((header, "in words"), [(f"`{w.name}`", f"{w.value}. {said[w.name]}".rstrip(" .")) for w in words])


def constants(*modules: ModuleType) -> str:
    rows = []
    for module in modules:
        said = said_of(ast.parse(inspect.getsource(module)))
        rows += [
            (f"`{name}`", module.__name__.rpartition(".")[2], _quantity(module, name), text)
            for name, text in said.items()
            if text and not name.startswith("_") and isinstance(getattr(module, name), int)
        ]
    return table(("name", "file", "value", "meaning"), rows)


def _quantity(module: ModuleType, name: str) -> str:
    value: int = getattr(module, name)
    if not re.search(rf"^{name}: Final.*\b(MILLI)?SECOND\b", inspect.getsource(module), re.M):
        return f"{value}"
    return f"{value / SECOND:g} s" if value >= SECOND else f"{value / MILLISECOND:g} ms"


def _dialogue(path: Path) -> str:
    return f"```\n{path.read_text()}```"


def dialogues(protocol: str, name: str) -> dict[str, Callable[[], str]]:
    paths = sorted((TRANSCRIPTS / protocol).glob("*.txt"))
    return {f"{name} {path.stem}": partial(_dialogue, path) for path in paths}


def without_fonts(drawing: str) -> str:
    """A picture of a terminal that fetches no font from anywhere, and has no blanks at the ends of its lines."""
    drawing = re.sub(r"\s*@font-face \{.*?\}(?=\s)", "", drawing, flags=re.S)
    return re.sub(r"[ \t]+$", "", drawing.replace("Fira Code, ", ""), flags=re.M)
