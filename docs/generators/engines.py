"""What holds for every protocol."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable
from typing import Final

from docs.generators.markup import block, table
from tapewire import engine
from tapewire.line.pacing import WINDOW_BAUD_PER_CHARACTER, default_window
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, PROTOCOL_B


def _windows() -> str:
    rates = (4800, 9600, 19200, 38400, 86400)
    rows = [
        [f"{baud}"] + [f"{default_window(baud, limits.overrun)}" for limits in (PROTOCOL_B, EXPANSION_B)]
        for baud in rates
    ]
    said = f"One character of window for every {WINDOW_BAUD_PER_CHARACTER} baud."
    return f"{said}\n\n" + table(("baud", "`fanuc-b`", "`fanuc-b-expansion`"), rows)


def _contract() -> str:
    """The verbs of the engine protocols, signature by signature, with what the code says of each."""
    tree = ast.parse(inspect.getsource(engine))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name.endswith("Engine")]
    return block("\n\n".join("\n".join(_class_lines(node)) for node in classes), "python")


def _class_lines(node: ast.ClassDef) -> Iterable[str]:
    yield f"class {node.name}({', '.join(ast.unparse(base) for base in node.bases)}):"
    for verb in node.body:
        if isinstance(verb, ast.FunctionDef):
            returns = f" -> {ast.unparse(verb.returns)}" if verb.returns else ""
            if verb.decorator_list:
                yield "    @property"
            yield f"    def {verb.name}({ast.unparse(verb.args)}){returns}"
            yield from (f"        # {line.strip()}" for line in (ast.get_docstring(verb) or "").splitlines() if line)


def _protocols() -> str:
    rows = [(f"`{entry.name}`", entry.title, entry.clause, f"{entry.baud}") for entry in PROTOCOLS.values()]
    return table(("name", "protocol", "manual", "baud unless told"), rows)


PARTS: Final[dict[str, Callable[[], str]]] = {
    "windows": _windows,
    "engine contract": _contract,
    "protocols": _protocols,
}
