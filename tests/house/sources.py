"""What the house tests look at: the source files, and what each of them imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "tapewire"


@dataclass(frozen=True, slots=True)
class Import:
    """One imported name. `module` is as deep as the name is known to be a module."""

    module: str
    line: int


@dataclass(frozen=True, slots=True)
class Module:
    """A source file under the name it is imported by."""

    name: str
    imports: tuple[Import, ...]


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def package_modules() -> list[Module]:
    names = {module_name(path) for path in python_files("src")}
    return [
        read_module(module_name(path), path.read_text(), names, is_package=path.name == "__init__.py")
        for path in python_files("src")
    ]


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def read_module(name: str, source: str, known: set[str], *, is_package: bool = False) -> Module:
    """`known` holds the names of all modules: they tell `from a import module` from `from a import name`."""
    folder = name if is_package else name.rpartition(".")[0]
    return Module(name, tuple(_imports(ast.parse(source), folder, known)))


def _imports(tree: ast.AST, folder: str, known: set[str]) -> Iterator[Import]:
    """Every import of a file: also within a function, under TYPE_CHECKING, and by import_module."""
    for node in ast.walk(tree):
        match node:
            case ast.Import():
                yield from (Import(alias.name, node.lineno) for alias in node.names)
            case ast.ImportFrom():
                base = _absolute(node, folder)
                for alias in node.names:
                    deeper = f"{base}.{alias.name}"
                    yield Import(deeper if deeper in known else base, node.lineno)
            case ast.Call(args=[ast.Constant(value=str(target)), *_]) if _is_import_call(node):
                yield Import(target, node.lineno)


def _absolute(node: ast.ImportFrom, folder: str) -> str:
    if node.level == 0:
        return node.module or ""
    parents = folder.split(".")
    base = parents[: len(parents) - (node.level - 1)]
    return ".".join(base + ([node.module] if node.module else []))


def _is_import_call(node: ast.Call) -> bool:
    match node.func:
        case ast.Name(id="__import__" | "import_module") | ast.Attribute(attr="import_module"):
            return True
    return False
