"""Which character plays which role in REMOTE LOAD and DNC LINK, as data.

The protocol's text shows its control codes as arrows whose labels are lost in every copy known. What stands here is a
reconstruction: from the few codes the text still names, from the figures, and from the related RS-491 links of other
controls. So every role has a default, a confidence in percent and what else it may be, and every one can be set.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

from tapewire.codes import CR, LF, TAB, name_of
from tapewire.errors import UsageError
from tapewire.protocols.settings import End, Form, setting

__all__ = ["CODE", "CODES", "CODE_STRING", "ROLES", "CodeTable", "Role", "hex_of"]

SPACE: Final = 0x20
SEVEN_BITS: Final = 0x7F

_BY_NAME: Final[Mapping[str, int]] = {name_of(byte).split()[0]: byte for byte in (*range(SPACE), SEVEN_BITS)}


def hex_of(characters: Iterable[int]) -> str:
    """Characters as `--set` and a profile take them: `04 14`."""
    return " ".join(f"{byte:02X}" for byte in characters)


def _character(word: str) -> int:
    byte = _BY_NAME.get(word.upper())
    if byte is not None:
        return byte
    try:
        byte = int(word.removesuffix("h"), 16)
    except ValueError:
        raise ValueError(f"{word!r} is no character: write it in hexadecimal, as 12, or by its name, as DC2") from None
    if not 0 <= byte <= SEVEN_BITS:
        raise ValueError(f"{word} is no character of seven bits: 00 to 7F")
    return byte


def _string(text: str) -> bytes:
    words = text.replace(",", " ").split()
    return b"" if words == ["none"] else bytes(map(_character, words))


def _one(text: str) -> int:
    characters = _string(text)
    if len(characters) != 1:
        raise ValueError("one character is expected, in hexadecimal, as 12, or by its name, as DC2")
    return characters[0]


CODE: Final = Form(values="a character: 12 or DC2", parse=_one, word=lambda code: hex_of([code]))
CODES: Final = Form(
    values="characters in any order, 04 14, or none",
    parse=lambda text: frozenset(_string(text)),
    word=lambda codes: hex_of(sorted(codes)) or "none",
)
CODE_STRING: Final = Form(
    values="characters in this order, 04 14, or none", parse=_string, word=lambda string: hex_of(string) or "none"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Role:
    """What is known of one entry of the table, or of one setting that is as uncertain."""

    says: str
    """Who sends it."""
    meaning: str
    confidence: int | None
    """Percent, by judgement; None for a choice of ours that nothing could confirm."""
    instead: str = ""
    """What else it may be."""

    @property
    def why(self) -> str:
        sure = "our choice" if self.confidence is None else f"{self.confidence} % sure"
        other = f"; else {self.instead}" if self.instead else ""
        sender = "both ends" if self.says == "both" else f"the {self.says}"
        return f"From {sender}: {self.meaning} ({sure}{other})."


ROLES: Final[Mapping[str, Role]] = {
    "open_write": Role(
        says="control", meaning="opens a name or a program it sends", confidence=80, instead="05, 0E, 01"
    ),
    "write_ready": Role(says="host", meaning="go ahead with the name or the program", confidence=80, instead="06"),
    "name_end": Role(says="control", meaning="either of these ends a name", confidence=90, instead="03"),
    "text_end": Role(says="both", meaning="ends the text of a program", confidence=88, instead="03"),
    "write_close": Role(says="control", meaning="closes what it sent, after text_end", confidence=85),
    "read_request": Role(says="control", meaning="send me the program", confidence=97),
    "xon": Role(says="both", meaning="go on sending", confidence=100),
    "xoff": Role(says="both", meaning="stop sending within three characters", confidence=100),
    "cancel": Role(says="control", meaning="stop and throw the rest away", confidence=99),
    "cancel_tail": Role(
        says="control",
        meaning="ignored without a word while nothing runs: the other half of a cancel pair",
        confidence=None,
    ),
    "rec_end": Role(says="host", meaning="ends a record of DNC LINK; its check character follows", confidence=98),
    "rec_end_last": Role(
        says="host", meaning="ends the last record instead, with dnc_end=etx_last", confidence=None, instead="nothing"
    ),
    "ack": Role(says="control", meaning="the record is good, send the next", confidence=99),
    "nak": Role(says="control", meaning="the record is bad, send it again", confidence=99),
    "ignore_rx": Role(
        says="control", meaning="blank and rubbed-out tape, left out of what is received", confidence=None
    ),
}


def _role(name: str, default: int | Iterable[int], end: End = End.BOTH) -> Any:
    if isinstance(default, int):
        return setting(default, ROLES[name].why, end=end, form=CODE)
    return setting(frozenset(default), ROLES[name].why, end=end, form=CODES)


_SEPARATE: Final = (
    ("what the control says at rest", ("open_write", "read_request", "cancel")),
    ("what the control says while it is sent a program", ("xon", "xoff", "cancel", "ack", "nak", "open_write")),
    ("what the control says instead of a request", ("read_request", "xoff", "cancel", "ack", "nak", "open_write")),
    ("what ends text and records", ("text_end", "rec_end", "xon", "xoff", "cancel")),
    ("what ends the records of DNC LINK", ("text_end", "rec_end", "rec_end_last")),
    ("what may stand in a program the control sends", ("text_end", "xon", "xoff", "cancel", "open_write")),
    ("what ends a program the control sends", ("write_close", "xon", "xoff", "cancel", "open_write")),
)
"""Roles that are told apart by their character alone, so it must not be the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeTable:
    """The characters of the protocol by their role, without parity. Raises UsageError where two cannot be told apart.

    The text of a program is printable ASCII with CR, LF and TAB, so none of these can be a code.
    """

    open_write: int = _role("open_write", 0x12)
    write_ready: int = _role("write_ready", 0x11)
    name_end: frozenset[int] = _role("name_end", (0x04, 0x14))
    text_end: int = _role("text_end", 0x04)
    write_close: int = _role("write_close", 0x14)
    read_request: int = _role("read_request", 0x11)
    xon: int = _role("xon", 0x11)
    xoff: int = _role("xoff", 0x13)
    cancel: int = _role("cancel", 0x10)
    cancel_tail: frozenset[int] = _role("cancel_tail", (0x03, 0x04, 0x06, 0x10, 0x13, 0x14, 0x15, 0x18), End.HOST)
    rec_end: int = _role("rec_end", 0x17)
    rec_end_last: int = _role("rec_end_last", 0x03)
    ack: int = _role("ack", 0x06)
    nak: int = _role("nak", 0x15)
    ignore_rx: frozenset[int] = _role("ignore_rx", (0x00, 0x7F))

    def __post_init__(self) -> None:
        for field in fields(CodeTable):
            value: int | frozenset[int] = getattr(self, field.name)
            single = isinstance(value, int)
            for code in (value,) if isinstance(value, int) else value:
                if not (0 < code < SPACE or (not single and code in (0, SEVEN_BITS))) or code in (CR, LF, TAB):
                    raise UsageError(f"{field.name}={hex_of([code])}: {name_of(code)} is no code but text of a program")
        for what, roles in _SEPARATE:
            _require_different(what, {role: getattr(self, role) for role in roles})
        clash = {self.xon, self.xoff, self.cancel, self.open_write, *self.ignore_rx} & self.upload_ends
        clash |= {self.text_end, self.open_write, self.cancel, self.xon, self.xoff} & self.ignore_rx
        if clash:
            what = "name_end, text_end and write_close end what the control sends and cannot also"
            raise UsageError(f"{hex_of(sorted(clash))}: {what} be xon, xoff, cancel, open_write or ignored")

    @property
    def upload_ends(self) -> frozenset[int]:
        """What ends a name or a program from the control: the host need not know which is which."""
        return self.name_end | {self.text_end, self.write_close}


def _require_different(what: str, codes: Mapping[str, int]) -> None:
    seen: dict[int, str] = {}
    for role, code in codes.items():
        if code in seen:
            raise UsageError(f"{role}={hex_of([code])}: {seen[code]} is the same, and {what} is told apart by them")
        seen[code] = role
