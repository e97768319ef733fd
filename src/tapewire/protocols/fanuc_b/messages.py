"""The words of protocol B and expansion protocol B (B-63322EN-1 chapters 6 and 7).

Six control codes steer the transfer; every other character is data.

| code | from the control                     | from the host          |
|------|--------------------------------------|------------------------|
| DC1  | start sending, go on sending         | resume the punch-out   |
| DC3  | stop sending; also the end of a read | pause the punch-out    |
| DC2  | a punch-out begins                   | resume the punch-out   |
| DC4  | a punch-out ends                     |                        |
| NAK  | the control has an alarm             |                        |
| SYN  | the control was reset                |                        |
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final, TypeAlias

from tapewire.codes import DataCode
from tapewire.errors import UsageError
from tapewire.g05.layout import BinaryInput
from tapewire.protocols.binary_input import binary_input
from tapewire.protocols.settings import End, Switch, parse_settings, setting

__all__ = [
    "BUFFER_BYTES",
    "EXPANSION_B",
    "PROTOCOL_B",
    "AlarmEnds",
    "ClosingAt",
    "CodeSystem",
    "ControlCode",
    "ErLine",
    "Limits",
    "Params",
    "PauseBy",
    "Resume",
    "SynAtEnd",
    "Words",
    "code_of",
    "encode",
]

BUFFER_BYTES: Final = 8192
"""Size of the remote buffer (12.2)."""


class ControlCode(Enum):
    """The control codes of 6.2; the value is the form without parity."""

    DC1 = 0x11
    DC2 = 0x12
    DC3 = 0x13
    DC4 = 0x14
    NAK = 0x15
    SYN = 0x16


class CodeSystem(StrEnum):
    """Parameter 5000#2, with the polarity it has in protocol B: 0 is ISO, 1 is ASCII."""

    ISO = "iso"
    ASCII = "ascii"


_ISO_FORM: Final = {ControlCode.DC3: 0x93, ControlCode.NAK: 0x95, ControlCode.SYN: 0x96}

_CODE_OF: Final = {code.value: code for code in ControlCode} | {byte: code for code, byte in _ISO_FORM.items()}


def encode(code: ControlCode, system: CodeSystem) -> bytes:
    """The character that stands for `code` (6.2)."""
    return bytes([_ISO_FORM.get(code, code.value) if system is CodeSystem.ISO else code.value])


def code_of(byte: int) -> ControlCode | None:
    """The control code that `byte` stands for in either form; None for any other character."""
    return _CODE_OF.get(byte)


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The buffer control of one variant (6.3, chapter 7), in characters."""

    stop_at_free: int
    """The control sends DC3 when this little is free."""
    start_at_free: int
    """It sends DC1 when this much is free."""
    overrun: int
    """Characters it tolerates after its DC3 has left."""

    @property
    def first_stop(self) -> int:
        """Fewer characters than this from the start cannot have filled the buffer."""
        return BUFFER_BYTES - self.stop_at_free

    @property
    def next_stop(self) -> int:
        """Fewer characters than this after a DC1 cannot have filled it again."""
        return self.start_at_free - self.stop_at_free


PROTOCOL_B: Final = Limits(stop_at_free=512, start_at_free=4096, overrun=511)
"""6.3: overrun less than 512."""

EXPANSION_B: Final = Limits(stop_at_free=2560, start_at_free=4096, overrun=1280)
"""6.3 says an overrun of less than 2560, chapter 7 says 1280 or less: 1280 satisfies both."""


class Resume(StrEnum):
    """The code that lets a paused punch-out go on. 6.1.1 says DC2, 6.1.2 and its figure B say DC1."""

    AUTO = "auto"
    DC1 = "dc1"
    DC2 = "dc2"


class ErLine(StrEnum):
    """Whether this line shows the control's ER."""

    AUTO = "auto"
    HIDDEN = "hidden"


class PauseBy(StrEnum):
    """How a host pauses a punch-out (6.1.1 2) (3))."""

    DC3 = "dc3"
    CS = "cs"


class SynAtEnd(StrEnum):
    """What SYN means when the whole program has been delivered and the control is still executing it."""

    CANCELLED = "cancelled"
    COMPLETE = "complete"


class ClosingAt(StrEnum):
    """When the control sends the DC3 that ends a read."""

    READ = "read"
    RECEIVED = "received"


class AlarmEnds(StrEnum):
    """When an alarm ends the communication, with posting on."""

    AT_ONCE = "at-once"
    AT_RESET = "at-reset"


@dataclass(frozen=True, slots=True, kw_only=True)
class Params:
    """The parameters of protocol B and expansion B, both ends."""

    limits: Limits = PROTOCOL_B
    code: CodeSystem = setting(
        CodeSystem.ISO,
        "What this end sends: ISO 93h 95h 96h or ASCII 13h 15h 16h (5000#2); both are understood.",
    )
    posting: Switch = setting(
        Switch.ON,
        "The control posts reset and alarm by SYN and NAK (5000#3 = 1). With off and ER not visible, a reset "
        "looks like a stop.",
    )
    resume: Resume = setting(
        Resume.AUTO,
        "The code that resumes a paused punch-out. The manual contradicts itself; auto is DC1 with posting, "
        "DC2 without.",
    )
    data: DataCode = setting(DataCode.ASCII, "The code of the program's characters on the line (0000#2).")
    g05: BinaryInput = binary_input()
    er: ErLine = setting(
        ErLine.AUTO,
        "hidden: ER is strapped or has no wire, so its state says nothing. auto: believe the line.",
        end=End.HOST,
    )
    pause: PauseBy = setting(
        PauseBy.DC3,
        "How a punch-out is paused. With posting on, CS would suppress SYN and NAK (6.1.2), so it is refused.",
        end=End.HOST,
    )
    closing_time: float = setting(
        5.0,
        "After the last byte a DC3 may be a stop or the end. It counts as the end when no DC1 follows for so long.",
        end=End.HOST,
        unit="s",
        limits=(0.1, 86400.0),
    )
    notice_time: float = setting(
        0.5,
        "After DC4 the host listens so long for a SYN or NAK, which make the punch-out incomplete.",
        end=End.HOST,
        unit="s",
        limits=(0.05, 60.0),
    )
    early_stop: float = setting(
        2.0,
        "A doubtful DC3 is believed to be a stop only if DC1 follows within this time; otherwise the job fails. "
        "A second DC3 that may be a reset just behind the last byte is doubtful. With posting on and ER not visible so "
        "is every second DC3, and one before the buffer can have filled: the control may not post at all.",
        end=End.HOST,
        unit="s",
        limits=(0.1, 86400.0),
    )
    syn_at_end: SynAtEnd = setting(
        SynAtEnd.CANCELLED,
        "A SYN after the last byte: the control was reset before it had executed all. complete where M30 resets.",
        end=End.HOST,
    )
    closing: ClosingAt = setting(
        ClosingAt.READ,
        "The simulated control ends a read when it has read EOR out of the buffer, or when EOR comes in.",
        end=End.CONTROL,
    )
    alarm: AlarmEnds = setting(
        AlarmEnds.AT_ONCE,
        "With posting on, an alarm ends the communication at once (6.1.2) or at RESET (6.4 note 1).",
        end=End.CONTROL,
    )
    cd: Switch = setting(Switch.ON, "CD is checked (5000#4 = 0). RS-422 has none (3.3).", end=End.CONTROL)
    idle_posting: Switch = setting(
        Switch.ON,
        "The simulated control posts SYN and NAK also while idle; the valid period is a lost figure (6.1.2).",
        end=End.CONTROL,
    )
    punch_overrun: int = setting(
        16,
        "Characters the simulated control still punches after it has received DC3.",
        end=End.CONTROL,
        unit="characters",
        limits=(0, 2559),
    )
    overrun: int = setting(
        0,
        "Characters after DC3 that the simulated control tolerates before SR856; 0 stands for what its protocol "
        "allows. Chapter 7 says 1280 for expansion B, 6.3 says 2560.",
        end=End.CONTROL,
        unit="characters",
        limits=(0, 2560),
    )

    def __post_init__(self) -> None:
        if self.pause is PauseBy.CS and self.posting is Switch.ON:
            raise UsageError(
                "pause=cs: with posting on the control cannot post a reset or an alarm while CS is OFF; "
                "set pause=dc3, or posting=off if the control has 5000#3 = 0"
            )

    @property
    def resume_code(self) -> ControlCode:
        """The code behind `resume`."""
        if self.resume is Resume.AUTO:
            return ControlCode.DC1 if self.posting is Switch.ON else ControlCode.DC2
        return ControlCode.DC1 if self.resume is Resume.DC1 else ControlCode.DC2

    @property
    def allowed_overrun(self) -> int:
        """Characters after DC3 that the simulated control lets pass without SR856."""
        return self.overrun or self.limits.overrun

    @classmethod
    def for_protocol_b(cls, settings: Mapping[str, str], end: End) -> Params:
        return parse_settings(cls, settings, end, {"limits": PROTOCOL_B})

    @classmethod
    def for_expansion_b(cls, settings: Mapping[str, str], end: End) -> Params:
        return parse_settings(cls, settings, end, {"limits": EXPANSION_B})


Token: TypeAlias = ControlCode | bytes


_CHARACTERS: Final = {
    DataCode.EIA: bytes(code.value for code in _ISO_FORM),
    DataCode.BINARY: bytes(byte for byte in _CODE_OF if byte != ControlCode.DC4.value),
}
"""Codes of 6.2 that are characters of a punch-out too."""


class Words:
    """Puts what one end sends into words, for transcripts: control codes by name, runs of program bytes.

    In EIA data 13h, 15h and 16h are characters, in binary data every code but DC4 (6.2). A host in the middle of a
    program says nothing but data, so its codes are named only where a control would look for them.
    """

    def __init__(self, data: DataCode) -> None:
        self._characters = _CHARACTERS.get(data, b"")
        self._punching = False

    def control(self, data: bytes) -> list[str | bytes]:
        """What the control sent."""
        return self._words(self._control_tokens(data))

    def host(self, data: bytes) -> list[str | bytes]:
        """What the host sent: a lone DC1, DC2 or DC3 is a code, everything else is program."""
        code = code_of(data[0]) if len(data) == 1 else None
        return [data] if code is None else [code.name]

    def _control_tokens(self, data: bytes) -> Iterator[Token]:
        for byte in data:
            code = code_of(byte)
            if self._punching and byte in self._characters:
                code = None
            self._punching = code is ControlCode.DC2 or (self._punching and code is not ControlCode.DC4)
            yield bytes([byte]) if code is None else code

    @staticmethod
    def _words(tokens: Iterator[Token]) -> list[str | bytes]:
        words: list[str | bytes] = []
        for token in tokens:
            if isinstance(token, ControlCode):
                words.append(token.name)
            elif words and isinstance(words[-1], bytes):
                words[-1] += token
            else:
                words.append(token)
        return words
