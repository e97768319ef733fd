"""Profiles: the code table, and what else is uncertain, as a text file that users edit and share.

A profile is words for `--set`, with the confidence in each beside it. `reconstruction.toml` is the one that ships:
exactly the defaults. A session at a real control writes another. Whatever a profile says are characters and words of
a fixed list: nothing in it becomes a path or a command.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from tapewire.codes import name_of
from tapewire.errors import UsageError
from tapewire.protocols.bridgeport.code_table import CODE, CODES, ROLES, CodeTable
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.settings import End, describe_settings

__all__ = ["LINK_CONFIDENCE", "RECONSTRUCTION", "Profile"]

FORMAT: Final = "tapewire bridgeport profile 1"

MOST_TITLE: Final = 200

CODE_KEYS: Final = tuple(field.name for field in dataclasses.fields(CodeTable))

LINK_CONFIDENCE: Final[Mapping[str, int]] = {"lrc": 70, "dnc_end": 70, "first_record": 85}
"""The settings that are as uncertain as the codes, in percent."""

_HEAD: Final = """\
# Control codes of Bridgeport REMOTE LOAD and DNC LINK, and what else the protocol's text does not say.
# Codes are hexadecimal characters of seven bits, or names as DC2. [settings] takes what --set takes.
# [confidence] is in percent; 100 means said by the text, or seen at the control named in the title.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """`settings` are words by key, as `--set` takes them; `confidence` is in percent by the same keys."""

    title: str
    settings: Mapping[str, str]
    confidence: Mapping[str, int]

    def __post_init__(self) -> None:
        Params.for_bridgeport(self.settings, End.HOST)

    @classmethod
    def loads(cls, text: str, name: str = "the profile") -> Profile:
        """A profile from TOML; what it leaves out keeps its default. Raises UsageError naming `name` and the place."""
        try:
            tables = tomllib.loads(text)
            return cls._from(tables)
        except UsageError as error:
            raise UsageError(f"{name}: {error}") from None
        except RecursionError:
            raise UsageError(f"{name}: no valid TOML: brackets within brackets without end") from None
        except ValueError as error:
            # A number of thousands of digits is an error of Python's own, and no TOMLDecodeError.
            raise UsageError(f"{name}: no valid TOML: {str(error).partition(';')[0]}") from None

    @classmethod
    def _from(cls, tables: dict[str, Any]) -> Profile:
        if tables.get("format") != FORMAT:
            raise UsageError(f'format = "{FORMAT}" is expected at its beginning')
        if strange := set(tables) - {"format", "title", "codes", "settings", "confidence"}:
            raise UsageError(f"{min(strange)} is nothing that belongs into a profile")
        title = tables.get("title", "")
        if not isinstance(title, str) or len(title) > MOST_TITLE or not title.isprintable():
            raise UsageError(f"title: one line of at most {MOST_TITLE} characters is expected")
        codes = _words(tables, "codes")
        settings = _words(tables, "settings")
        for key in codes:
            if key not in CODE_KEYS:
                raise UsageError(f"[codes] {key}: there is no such code; the codes are {', '.join(CODE_KEYS)}")
        for key in settings:
            if key in CODE_KEYS:
                raise UsageError(f"[settings] {key}: this is a code and belongs into [codes]")
        return cls(title=title, settings={**codes, **settings}, confidence=_confidence(tables))

    def settings_for(self, end: End) -> dict[str, str]:
        """What of it concerns `end`."""
        whose = {key: whose for key, _, _, whose, _ in describe_settings(Params)}
        return {key: word for key, word in self.settings.items() if whose[key] in (End.BOTH, end)}

    def dumps(self) -> str:
        """The TOML file, with the meaning of every code beside it."""
        described = {key: (values, default) for key, values, default, _, _ in describe_settings(Params)}
        table = Params.for_bridgeport(self.settings, End.HOST)
        codes = {key: _code_word(getattr(table, key)) for key in CODE_KEYS}
        others = [key for key in (*LINK_CONFIDENCE, *self.settings) if key not in CODE_KEYS]
        settings = {key: self.settings.get(key, described[key][1]) for key in dict.fromkeys(others)}
        lines = [_HEAD, f"format = {_quoted(FORMAT)}", f"title = {_quoted(self.title)}", "", "[codes]"]
        lines += [_line(key, word, _explained(key, word)) for key, word in codes.items()]
        lines += ["", "[settings]"]
        lines += [_line(key, word, described[key][0]) for key, word in settings.items()]
        lines += ["", "[confidence]", *(f"{key} = {percent}" for key, percent in self.confidence.items()), ""]
        return "\n".join(lines)


def _words(tables: dict[str, Any], name: str) -> dict[str, str]:
    table = tables.get(name, {})
    if not isinstance(table, dict) or not all(isinstance(value, str) for value in table.values()):
        raise UsageError(f'[{name}]: lines as key = "word" are expected, the word in quotes')
    return table


def _confidence(tables: dict[str, Any]) -> dict[str, int]:
    table = tables.get("confidence", {})
    known = {*CODE_KEYS, *LINK_CONFIDENCE}
    if not isinstance(table, dict):
        raise UsageError("[confidence]: lines as key = 80 are expected")
    for key, percent in table.items():
        if key not in known:
            raise UsageError(f"[confidence] {key}: there is no such code or setting")
        if not isinstance(percent, int) or isinstance(percent, bool) or not 0 <= percent <= 100:
            raise UsageError(f"[confidence] {key}: a number from 0 to 100 is expected")
    return table


def _code_word(code: int | frozenset[int]) -> str:
    return CODE.word(code) if isinstance(code, int) else CODES.word(code)


def _line(key: str, word: str, explained: str) -> str:
    return f"{key} = {_quoted(word)}".ljust(30) + f" # {explained}"


def _explained(key: str, word: str) -> str:
    names = " ".join(name_of(int(part, 16)).split()[0] for part in word.split() if part != "none")
    role = ROLES[key]
    return f"{names or 'nothing'}, {role.says}: {role.meaning}"


def _quoted(text: str) -> str:
    """A TOML basic string. Only printable text gets here."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


RECONSTRUCTION: Final = Profile(
    title="Reconstructed from the protocol's text and related links; seen at no control",
    settings={
        key: default
        for key, _, default, _, _ in describe_settings(Params)
        if key in CODE_KEYS or key in LINK_CONFIDENCE
    },
    confidence={key: role.confidence for key, role in ROLES.items() if role.confidence is not None}
    | dict(LINK_CONFIDENCE),
)
"""The profile that ships."""
