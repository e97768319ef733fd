"""A file that does not fit into a head, and a function that does not fit on a screen, hide something."""

from __future__ import annotations

import ast

import pytest

from tests.house.sources import ROOT, python_files

MOST_FILE_LINES = 500
MOST_FUNCTION_LINES = 70


def too_long_files(sources: dict[str, str]) -> list[str]:
    counts = {name: len(source.splitlines()) for name, source in sources.items()}
    return [f"{name}: {count} lines" for name, count in counts.items() if count > MOST_FILE_LINES]


def too_long_functions(sources: dict[str, str]) -> list[str]:
    found = []
    for name, source in sources.items():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                count = (node.end_lineno or node.lineno) - node.lineno + 1
                if count > MOST_FUNCTION_LINES:
                    found.append(f"{name}, line {node.lineno}: {node.name} has {count} lines")
    return found


def read(*folders: str) -> dict[str, str]:
    return {str(path.relative_to(ROOT)): path.read_text() for path in python_files(*folders)}


def test_files_are_short() -> None:
    assert too_long_files(read("src", "tests", "benchmarks", "examples", "docs")) == []


def test_functions_are_short() -> None:
    assert too_long_functions(read("src")) == []


@pytest.mark.parametrize(("lines", "found"), [(500, 0), (501, 1)])
def test_a_long_file_is_found(lines: int, found: int) -> None:
    assert len(too_long_files({"long.py": "x = 1\n" * lines})) == found


@pytest.mark.parametrize("opening", ["def f():", "async def f():"])
@pytest.mark.parametrize(("lines", "found"), [(70, 0), (71, 1)])
def test_a_long_function_is_found(opening: str, lines: int, found: int) -> None:
    method = f"class C:\n  {opening}\n" + "    x = 1\n" * (lines - 1)
    assert len(too_long_functions({"long.py": method})) == found
