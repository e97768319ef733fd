"""Just enough Markdown and shell to check what the docs show."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator

_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>[\w-]*)[^\n]*\n(?P<body>.*?)^(?P=indent)```", re.M | re.S)
_LINK = re.compile(r"\[[^\]]*\]\((?P<target>[^)\s]+)[^)]*\)")
_HEADING = re.compile(r"^#+ +(?P<text>.+?) *$", re.M)
_SHELLS = {"sh", "bash", "shell", "console"}
# Where one command ends and the next begins.
_BETWEEN = {"|", "||", "&", "&&", ";", "(", ")"}


def fenced_blocks(text: str) -> list[tuple[str, str]]:
    """Language and body of every fenced block."""
    return [(match["language"], match["body"]) for match in _FENCE.finditer(text)]


def without_blocks(text: str) -> str:
    return _FENCE.sub("", text)


def shell_commands(text: str) -> list[list[str]]:
    """Every command of the shell blocks as its words. In a `console` block only what follows `$ ` is one."""
    return [
        command
        for language, body in fenced_blocks(text)
        if language in _SHELLS
        for command in _commands(_typed(body) if language == "console" else body)
    ]


def _typed(body: str) -> str:
    return "\n".join(line.strip()[2:] for line in body.splitlines() if line.strip().startswith("$ "))


def _commands(body: str) -> Iterator[list[str]]:
    for line in body.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.whitespace_split = True
        command: list[str] = []
        for word in lexer:
            if word in _BETWEEN:
                yield from [command] if command else []
                command = []
            elif command or not re.fullmatch(r"\w+=.*", word):
                command.append(word)
        yield from [command] if command else []


def link_targets(text: str) -> list[str]:
    """Targets within the project: what has a scheme is somebody else's."""
    targets = (match["target"] for match in _LINK.finditer(without_blocks(text)))
    return [target for target in targets if not re.match(r"\w+:", target)]


def anchors(text: str) -> set[str]:
    """The names that headings can be linked by: lower case, punctuation dropped, spaces to hyphens."""
    headings = (match["text"].lower() for match in _HEADING.finditer(without_blocks(text)))
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in headings}


def table_rows(text: str) -> list[list[str]]:
    """Every row of every table as its cells, headers too, without the line under them."""
    lines = [line.strip() for line in without_blocks(text).splitlines()]
    rows = [re.split(r"(?<!\\)\|", line[1:-1]) for line in lines if re.fullmatch(r"\|.+\|", line)]
    cells = [[cell.strip() for cell in row] for row in rows]
    return [row for row in cells if not all(re.fullmatch(r":?-+:?", cell) for cell in row)]
