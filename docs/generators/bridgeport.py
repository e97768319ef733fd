"""REMOTE LOAD and DNC LINK."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from docs.generators.markup import (
    block,
    constants,
    dialogues,
    law_rows,
    members_said,
    names_of,
    settings,
    states_said,
    table,
)
from tapewire.codes import name_of
from tapewire.protocols import bridgeport
from tapewire.protocols.bridgeport import (
    cnc,
    cnc_law,
    host,
    host_job,
    host_law,
    host_reception,
    host_sending,
    host_text,
    host_transmission,
    messages,
    profile,
    records,
)
from tapewire.protocols.bridgeport.code_table import ROLES, hex_of
from tapewire.protocols.bridgeport.profile import CODE_KEYS, LINK_CONFIDENCE, RECONSTRUCTION
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, lrc_of
from tapewire.protocols.settings import describe_settings

_HEX: Final = re.compile(r"[0-9A-F]{2}")


def _roles() -> str:
    """The code table, and how sure of each row anybody can be."""
    header = ("code", "character", "from", "meaning", "sure", "else perhaps")
    rows = [
        (f"`{key}`", _named(RECONSTRUCTION.settings[key]), role.says, role.meaning, _percent(role.confidence), other)
        for key, role in ROLES.items()
        for other in [_named(role.instead)]
    ]
    return table(header, rows)


def _named(characters: str) -> str:
    """`04 14` as `EOT 04h, DC4 14h`; words stay."""
    words = characters.replace(",", " ").split()
    return ", ".join(f"{name_of(int(word, 16)).split()[0]} {word}h" if _HEX.fullmatch(word) else word for word in words)


def _percent(confidence: int | None) -> str:
    return "our choice" if confidence is None else f"{confidence} %"


def _uncertain_settings() -> str:
    described = {key: (values, default) for key, values, default, *_ in describe_settings(bridgeport.Params)}
    rows = [
        (f"`{key}`", f"`{described[key][1]}`", _percent(confidence), described[key][0])
        for key, confidence in LINK_CONFIDENCE.items()
    ]
    return table(("setting", "taken for true", "sure", "what it may be"), rows)


def _settings() -> str:
    return settings(row for row in describe_settings(bridgeport.Params) if row[0] not in CODE_KEYS)


def _lrc_candidates() -> str:
    """The check character of three records by every candidate."""
    etb = bridgeport.Params().rec_end
    texts = (b"N10G1X1F5\r\n", b"N20Y1\r\n", b"N30M2\r\n")
    header = ("`lrc`", *(f"`{text.decode().strip()}` CR LF" for text in texts))
    return table(
        header, [(f"`{lrc}`", *(f"{hex_of([lrc_of(text, etb, lrc)])}h" for text in texts)) for lrc in LRC_CANDIDATES]
    )


def _dnc_ends() -> str:
    said = members_said(DncEnd)
    return table(("`dnc_end`", "meaning"), [(f"`{end}`", said[end.name]) for end in DncEnd])


def _host_law() -> str:
    law, states, heard = host_law.LAW, host_law.State, host_law.Heard
    rows = [
        [f"`{state.name}`"] + [names_of(law.get((state, what), frozenset()), states) or "-" for what in heard]
        for state in states
    ]
    return table(("state", *(f"`{what.name}`" for what in heard)), rows)


def _cnc_law() -> str:
    causes = (*cnc_law.Act, *cnc_law.Word)
    return law_rows(cnc_law.LAW, cnc_law.State, causes)


def _profile() -> str:
    return block((Path(profile.__file__).parent / "reconstruction.toml").read_text(), "toml")


PARTS: Final[dict[str, Callable[[], str]]] = {
    "bridgeport codes": _roles,
    "bridgeport uncertain settings": _uncertain_settings,
    "bridgeport settings": _settings,
    "bridgeport lrc candidates": _lrc_candidates,
    "bridgeport endings": _dnc_ends,
    "bridgeport host states": partial(states_said, host_law.State),
    "bridgeport host law": _host_law,
    "bridgeport control states": partial(states_said, cnc_law.State),
    "bridgeport control law": _cnc_law,
    "bridgeport constants": partial(
        constants,
        messages,
        records,
        host,
        host_sending,
        host_job,
        host_text,
        host_reception,
        host_transmission,
        cnc,
    ),
    "bridgeport profile": _profile,
    **dialogues("bridgeport", "bridgeport dialogue"),
}
