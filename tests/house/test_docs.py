"""The docs show nothing that is not there: commands, options, links, files, words of the glossary."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from tests.house.markdown import anchors, fenced_blocks, link_targets, shell_commands
from tests.house.sources import PACKAGE, ROOT, python_files

README = ROOT / "README.md"
ARCHITECTURE = ROOT / "docs" / "architecture.md"
GLOSSARY = ROOT / "docs" / "glossary.md"

# A path of one machine means nothing on another, and tells about the one who wrote it.
MACHINE_PATH = re.compile(r"(?<![\w.])/(?:work|root|Users|home/\w+)/[\w.]*")


def pages() -> list[Path]:
    return [
        *sorted(ROOT.glob("*.md")),
        *sorted(ROOT.glob("docs/**/*.md")),
        *sorted(ROOT.glob("examples/*.md")),
    ]


def load_cli() -> click.Group:
    main = importlib.import_module("tapewire.cli").main
    assert isinstance(main, click.Group)
    return main


def wrong_commands(text: str, cli: click.Group) -> list[str]:
    found = []
    for words in shell_commands(text):
        arguments = tapewire_arguments(words)
        if arguments is not None:
            found += [f"{' '.join(words)}: {reason}" for reason in wrong_arguments(arguments, cli)]
    return found


def tapewire_arguments(words: list[str]) -> list[str] | None:
    """What follows the name of our command, or None where it is another command."""
    match words:
        case ["tapewire" | ".venv/bin/tapewire", *arguments]:
            return arguments
        case [python, "-m", "tapewire", *arguments] if Path(python).name.startswith("python"):
            return arguments
        case ["scripts/demo", *arguments]:
            return ["demo", *arguments]
    return None


def wrong_arguments(arguments: list[str], cli: click.Group) -> Iterator[str]:
    context = click.Context(cli, **cli.context_settings)
    words = iter(arguments)
    for word in words:
        if word.startswith("-") and word != "-":
            name, equals, _ = word.partition("=")
            option = options_of(context).get(name)
            if option is None:
                yield f"there is no option {name}"
            elif not equals and not (option.is_flag or option.count):
                next(words, None)
        elif isinstance(context.command, click.Group):
            command = context.command.get_command(context, word)
            if command is None:
                yield f"there is no command {word}"
                return
            context = click.Context(command, parent=context, **command.context_settings)


def options_of(context: click.Context) -> dict[str, click.Option]:
    options = [option for option in context.command.get_params(context) if isinstance(option, click.Option)]
    return {name: option for option in options for name in (*option.opts, *option.secondary_opts)}


def broken_links(page: Path) -> list[str]:
    found = []
    for target in link_targets(page.read_text()):
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        if not file.exists():
            found.append(f"{page.name}: {target}: no such file")
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text()):
            found.append(f"{page.name}: {target}: no such heading")
    return found


def machine_paths(text: str) -> list[str]:
    return [match[0] for match in MACHINE_PATH.finditer(text)]


def unnamed_files(layout: str) -> list[str]:
    """Source files whose name, or whose folder's name, the layout does not say."""
    return [
        str(path.relative_to(PACKAGE))
        for path in python_files("src")
        if path.name not in layout or not all(part in layout for part in path.relative_to(PACKAGE).parts[:-1])
        if path.name != "__init__.py"
    ]


def invented_files(layout: str) -> list[str]:
    there = {path.name for path in python_files("src", "tests", "benchmarks", "examples", "docs")}
    return [name for name in re.findall(r"\b\w+\.py\b", layout) if name not in there]


def layout_of(architecture: str) -> str:
    return "\n".join(body for _, body in fenced_blocks(architecture) if "src/tapewire" in body)


def unknown_identifiers(glossary: str, sources: str) -> list[str]:
    """Identifiers in back quotes that no source file holds."""
    names = re.findall(r"`([A-Za-z_][\w.]*)`", glossary)
    return [name for name in names if not re.search(rf"\b{re.escape(name.rpartition('.')[2])}\b", sources)]


def test_every_command_and_option_shown_exists() -> None:
    cli = load_cli()
    wrong = [f"{page.name}: {line}" for page in pages() for line in wrong_commands(page.read_text(), cli)]
    assert wrong == []
    assert any(tapewire_arguments(words) for words in shell_commands(README.read_text()))


def test_the_first_two_commands_of_the_readme_do_all_the_setting_up() -> None:
    assert shell_commands(README.read_text())[:2] == [["scripts/demo"], ["scripts/test"]]


def test_links_lead_somewhere() -> None:
    assert [broken for page in pages() for broken in broken_links(page)] == []


def test_nothing_names_a_path_of_somebodys_machine() -> None:
    folders = ("src", "tests", "benchmarks", "examples", "docs", "scripts", ".ci")
    texts = [path for folder in folders for path in (ROOT / folder).rglob("*") if is_text(path)]
    named = [(path.name, found) for path in [*pages(), *texts] for found in machine_paths(path.read_text())]
    assert named == []


def is_text(path: Path) -> bool:
    return path.is_file() and (path.suffix in (".py", ".md", ".txt", ".nc", ".html", ".toml") or not path.suffix)


def test_the_layout_names_every_source_file_and_no_other() -> None:
    layout = layout_of(ARCHITECTURE.read_text())
    assert unnamed_files(layout) == []
    assert invented_files(layout) == []


def test_the_glossary_names_what_is_in_the_code() -> None:
    sources = "\n".join(path.read_text() for path in python_files("src"))
    assert unknown_identifiers(GLOSSARY.read_text(), sources) == []


@click.group()
def small_cli() -> None:
    """A command line as the checker of commands needs it."""


@small_cli.command()
@click.argument("file")
@click.option("--line", "-l")
@click.option("--json/--text", "as_json")
def send(file: str, line: str, as_json: bool) -> None:
    """One command with one option of each kind."""


@pytest.mark.parametrize(
    "command",
    [
        "tapewire sned FILE",
        "tapewire --wrong send",
        "tapewire send FILE --lien x",
        "tapewire send --line --wrong --wrong FILE",
        "cat x | tapewire sned",
        "tapewire send \\\n  --wrong",
        "A=b python3 -m tapewire sned",
        "scripts/demo --fast",
    ],
)
def test_a_wrong_command_is_found(command: str) -> None:
    assert wrong_commands(f"```sh\n{command}\n```\n", small_cli)
    assert wrong_commands(f"```console\n$ {command.replace(chr(10), '')}\n```\n", small_cli)


@pytest.mark.parametrize(
    "block",
    [
        "```sh\ntapewire send a.nc --line=pty:x --json  # --wrong\ntapewire --help\n```\n",
        "```sh\ntapewire send a.nc -l --wrong --text && tapewirex --wrong\n```\n",
        "```console\n$ tapewire send a.nc\ntapewire sned is printed here\n```\n",
        "```python\ntapewire = sned\n```\n",
        "Say `tapewire sned`, or not.\n",
    ],
)
def test_a_right_command_is_not(block: str) -> None:
    assert wrong_commands(block, small_cli) == []


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    (tmp_path / "other.md").write_text("# The other page: DC1\n")
    page.write_text(
        "[a](other.md#the-other-page-dc1) [b](https://example.org/x) [c](#gone) [d](gone.md) [e](other.md#x)"
    )
    assert broken_links(page) == [
        "page.md: #gone: no such heading",
        "page.md: gone.md: no such file",
        "page.md: other.md#x: no such heading",
    ]


@pytest.mark.parametrize("folder", ["work", "root", "home/me", "Users"])
def test_a_path_of_a_machine_is_found(folder: str) -> None:
    assert machine_paths(f"see /{folder}/notes.md")
    assert machine_paths(f"see net/{folder}/notes.md") == []


def test_a_layout_that_lags_is_found() -> None:
    named = " ".join(str(path.relative_to(PACKAGE)) for path in python_files("src"))
    assert unnamed_files(named) == []
    assert "__main__.py" in unnamed_files(named.replace("__main__.py", ""))
    assert invented_files("engine.py gone.py") == ["gone.py"]
    assert layout_of("```\nsrc/tapewire/\n  engine.py\n```\ngone.py\n") == "src/tapewire/\n  engine.py\n"


def test_a_word_that_is_not_in_the_code_is_found() -> None:
    glossary = "held: `Held`, `engine.Held`; `No`; `x + y`; gone: `Gone`"
    assert unknown_identifiers(glossary, "class Held: ...\nNo = 256") == ["Gone"]
