"""Writes the parts of the docs that are taken from the code, each between its two markers:

    <!-- begin generated: NAME -->
    <!-- end generated: NAME -->

`scripts/docs` runs it; a test of the house fails when a page lags behind the code.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from enum import Enum
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Final

import click

from tapewire import engine
from tapewire.cli import main as command_line
from tapewire.engine import MILLISECOND, SECOND
from tapewire.line.pacing import WINDOW_BAUD_PER_CHARACTER, default_window
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.fanuc_b import cnc, cnc_law, host, host_delivery, host_law, messages
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, PROTOCOL_B, CodeSystem, ControlCode, Params, encode
from tapewire.protocols.settings import describe_settings

ROOT: Final = Path(__file__).parents[1]
DOCS: Final = ROOT / "docs"
TRANSCRIPTS: Final = ROOT / "tests" / "transcripts"
HELP_WIDTH: Final = 80

_MARKED: Final = re.compile(
    r"(?P<begin><!-- begin generated: (?P<name>[^\n]+?) -->\n).*?(?P<end><!-- end generated: (?P=name) -->)", re.S
)


def main() -> None:
    for page in sorted(DOCS.glob("**/*.md")):
        page.write_text(regenerated(page.read_text()))


def regenerated(text: str) -> str:
    """A page with every marked part written anew. Raises KeyError for a name that nobody makes."""
    return _MARKED.sub(lambda found: f"{found['begin']}{PARTS[found['name']]()}\n{found['end']}", text)


def marked_names(text: str) -> list[str]:
    return [found["name"] for found in _MARKED.finditer(text)]


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _block(text: str, language: str = "") -> str:
    return f"```{language}\n{text.rstrip()}\n```"


# what the source says of its own names


def _said_of(tree: ast.Module | ast.ClassDef) -> dict[str, str]:
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


def _members_said(words: type[Enum]) -> dict[str, str]:
    tree = ast.parse(inspect.getsource(words)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return _said_of(tree)


# the command line


def _help(name: str) -> str:
    context = _context(command_line, "tapewire")
    if name:
        command = command_line.get_command(context, name)
        assert command is not None
        context = _context(command, name, context)
    return _block(context.command.get_help(context), "text")


def _context(command: click.Command, name: str, parent: click.Context | None = None) -> click.Context:
    options = {**command.context_settings, "terminal_width": HELP_WIDTH, "max_content_width": HELP_WIDTH}
    return click.Context(command, info_name=name, parent=parent, **options)


def command_names() -> list[str]:
    return command_line.list_commands(_context(command_line, "tapewire"))


# the lines


def _windows() -> str:
    rates = (4800, 9600, 19200, 38400, 86400)
    rows = [
        [f"{baud}"] + [f"{default_window(baud, limits.overrun)}" for limits in (PROTOCOL_B, EXPANSION_B)]
        for baud in rates
    ]
    said = f"One character of window for every {WINDOW_BAUD_PER_CHARACTER} baud."
    return f"{said}\n\n" + _table(("baud", "`fanuc-b`", "`fanuc-b-expansion`"), rows)


# the engines


def _contract() -> str:
    """The verbs of the engine protocols, signature by signature, with what the code says of each."""
    tree = ast.parse(inspect.getsource(engine))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name.endswith("Engine")]
    return _block("\n\n".join("\n".join(_class_lines(node)) for node in classes), "python")


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
    return _table(("name", "protocol", "manual", "baud unless told"), rows)


# protocol B


def _control_codes() -> str:
    """The columns of 6.2, and what each code means from either end, as messages.py tells it."""
    meanings = dict(_meanings_of_codes())
    rows = [
        (code.name, _hex(code, CodeSystem.ISO), _hex(code, CodeSystem.ASCII), *meanings[code.name])
        for code in ControlCode
    ]
    header = ("code", "5000#2 = 0, `code=iso`", "5000#2 = 1, `code=ascii`", "from the control", "from the host")
    return _table(header, rows)


def _meanings_of_codes() -> Iterable[tuple[str, tuple[str, str]]]:
    for line in (messages.__doc__ or "").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and cells[0] in ControlCode.__members__:
            yield cells[0], (cells[1], cells[2])


def _hex(code: ControlCode, system: CodeSystem) -> str:
    return f"{encode(code, system).hex().upper()}h"


def _limits() -> str:
    names = {
        "stop_at_free": "The control sends DC3 when so little of its buffer is free",
        "start_at_free": "It sends DC1 when so much is free",
        "overrun": "Characters it tolerates after its DC3 has left",
        "first_stop": "Fewer characters than this from the start cannot have filled the buffer",
        "next_stop": "Fewer than this after a later DC1 cannot have filled it again",
    }
    rows = [
        (f"`{name}`", text, f"{getattr(PROTOCOL_B, name)}", f"{getattr(EXPANSION_B, name)}")
        for name, text in names.items()
    ]
    return _table(("name", "meaning, in characters", "protocol B", "expansion B"), rows)


def _settings() -> str:
    rows = [
        (f"`{key}`", values, f"`{default}`", whose, why)
        for key, values, default, whose, why in describe_settings(Params)
    ]
    return _table(("key", "values", "default", "end", "meaning"), rows)


def _states(states: type[Enum]) -> str:
    said = _members_said(states)
    return _table(
        ("state", "in words"),
        [
            (f"`{state.name}`", f"{state.value}{'. ' + said[state.name] if said[state.name] else ''}")
            for state in states
        ],
    )


def _names(states: AbstractSet[Enum], order: type[Enum]) -> str:
    return ", ".join(f"`{state.name}`" for state in order if state in states)


def _host_law() -> str:
    rows = [
        [f"`{state.name}`"]
        + [_names(host_law.LAW.get((state, code), frozenset()), host_law.State) or "-" for code in ControlCode]
        for state in host_law.State
    ]
    return _table(("state", *(code.name for code in ControlCode)), rows)


def _cnc_law() -> str:
    causes = [*cnc_law.Act, *ControlCode]
    rows = [
        (f"`{state.name}`", _cause(cause), _names(cnc_law.LAW[state, cause], cnc_law.State))
        for state in cnc_law.State
        for cause in causes
        if (state, cause) in cnc_law.LAW
    ]
    return _table(("state", "what happens", "then"), rows)


def _cause(cause: cnc_law.Cause) -> str:
    return cause.name if isinstance(cause, ControlCode) else f"`{cause.name}` {cause.value}"


def _constants(*modules: ModuleType) -> str:
    rows = []
    for module in modules:
        said = _said_of(ast.parse(inspect.getsource(module)))
        rows += [
            (f"`{name}`", module.__name__.rpartition(".")[2], _quantity(module, name), text)
            for name, text in said.items()
            if text and not name.startswith("_") and isinstance(getattr(module, name), int)
        ]
    return _table(("name", "file", "value", "meaning"), rows)


def _quantity(module: ModuleType, name: str) -> str:
    value: int = getattr(module, name)
    if "Nanos" not in str(module.__annotations__[name]):
        return f"{value}"
    return f"{value / SECOND:g} s" if value >= SECOND else f"{value / MILLISECOND:g} ms"


def _dialogue(path: Path) -> str:
    return f"```\n{path.read_text()}```"


PARTS: Final[dict[str, Callable[[], str]]] = {
    "tapewire --help": partial(_help, ""),
    **{f"tapewire {name} --help": partial(_help, name) for name in command_names()},
    "windows": _windows,
    "engine contract": _contract,
    "protocols": _protocols,
    "fanuc_b control codes": _control_codes,
    "fanuc_b limits": _limits,
    "fanuc_b settings": _settings,
    "fanuc_b host states": partial(_states, host_law.State),
    "fanuc_b host law": _host_law,
    "fanuc_b control states": partial(_states, cnc_law.State),
    "fanuc_b control law": _cnc_law,
    "fanuc_b constants": partial(_constants, host, host_delivery, cnc),
    **{f"dialogue {path.stem}": partial(_dialogue, path) for path in sorted((TRANSCRIPTS / "fanuc_b").glob("*.txt"))},
}


if __name__ == "__main__":
    main()
