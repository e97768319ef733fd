"""Faults of a line as values: what goes wrong, when, and on which wire.

A `FaultPlan` says what shall happen to a line and holds no state; `injector.py` carries it out. Scripted faults
("lose byte 17 from the host": `Lose(when=Nth(17), wire=Wire.FROM_HOST)`) and random ones ("one character in ten
thousand": `Lose(when=Rate(1e-4))`) are the same values. What hits an end and not the wire (`EndFault`) is carried out
by whoever runs the ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, TypeAlias

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.paths import PathKind

__all__ = [
    "At",
    "BaudMismatch",
    "Break",
    "Burst",
    "CutPower",
    "DoubleCharacter",
    "EndFault",
    "Every",
    "Extent",
    "FaultPlan",
    "FlipBits",
    "Framing",
    "HoldSignal",
    "LateStop",
    "Level",
    "LineEnd",
    "LinePlan",
    "Lose",
    "Noise",
    "Nth",
    "PerTransfer",
    "PlannedFault",
    "PullCable",
    "Rate",
    "RestartProcess",
    "Sight",
    "Signal",
    "StepClock",
    "When",
    "Wire",
]


class Wire(StrEnum):
    """The two wires of a line. Control lines and breaks go with the characters of the end that drives them."""

    FROM_HOST = "from the host"
    FROM_CONTROL = "from the control"
    BOTH = "both wires"


class LineEnd(StrEnum):
    """Whom a fault of an end hits."""

    HOST = "host"
    CONTROL = "control"


class Signal(StrEnum):
    """A control line as the end that reads it names it."""

    CTS = "CTS"
    DSR = "DSR"
    CD = "CD"


class Level(StrEnum):
    """What a control line shows while it is held."""

    ON = "ON"
    OFF = "OFF"
    STAYS = "as it was"


class Sight(StrEnum):
    """Whether the ends can see that the cable is gone."""

    SEEN = "the control lines fall"
    UNSEEN = "the control lines are looped back in the plugs"


@dataclass(frozen=True, slots=True)
class Nth:
    """Scripted: the nth of what the fault can hit, counted from 1: a character, an edge, a stop request."""

    number: int


@dataclass(frozen=True, slots=True)
class Rate:
    """Each of what the fault can hit, with this probability."""

    probability: float


@dataclass(frozen=True, slots=True)
class PerTransfer:
    """So many in a transfer on the average, however long it is (`Extent`)."""

    mean: float


@dataclass(frozen=True, slots=True)
class At:
    """Scripted: at this moment after the beginning, ns."""

    moment: Nanos


@dataclass(frozen=True, slots=True)
class Every:
    """At any moment, so many ns apart on the average."""

    mean: Nanos


When: TypeAlias = Nth | Rate | PerTransfer | At | Every


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """How long a transfer is expected to be: what `PerTransfer` counts by."""

    characters: int = 20_000
    span: Nanos = 30 * SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipBits:
    """`bits` different bits of a character arrive turned over, the parity bit among them.

    A UART that checks parity reports an odd number of them and lets an even number pass.
    """

    kind: ClassVar[str] = "bit flip"
    when: When
    wire: Wire = Wire.BOTH
    bits: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Burst:
    """From 1 to `longest` characters running arrive as chance has it: any bits turned, some without a stop bit."""

    kind: ClassVar[str] = "burst"
    when: When
    wire: Wire = Wire.BOTH
    longest: int = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Lose:
    """`characters` running never arrive."""

    kind: ClassVar[str] = "lost character"
    when: When
    wire: Wire = Wire.BOTH
    characters: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class DoubleCharacter:
    """A character arrives twice."""

    kind: ClassVar[str] = "doubled character"
    when: When
    wire: Wire = Wire.BOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class Framing:
    """A character arrives without its stop bit."""

    kind: ClassVar[str] = "framing error"
    when: When
    wire: Wire = Wire.BOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """A break behind a character, or at a moment."""

    kind: ClassVar[str] = "break"
    when: When
    wire: Wire = Wire.BOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """A character that nobody sent: behind a character, or at a moment at which the wire is idle."""

    kind: ClassVar[str] = "noise"
    when: When
    wire: Wire = Wire.BOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class LateStop:
    """A stop request (DC3: 13h, 93h), and what is behind it, is handed on `characters` character times late.

    So it looks to the control when the sender goes on for so long after DC3, wherever those characters wait.
    `when` counts stop requests.
    """

    kind: ClassVar[str] = "late stop"
    when: Nth | Rate
    wire: Wire = Wire.FROM_CONTROL
    characters: int = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class BaudMismatch:
    """The receiver's clock is `percent` faster than the sender's, all the time; slower when negative."""

    kind: ClassVar[str] = "baud mismatch"
    wire: Wire = Wire.BOTH
    percent: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldSignal:
    """A control line shows `level` for `span` ns, whatever the other end drives. `when` counts its edges.

    A wire's signals are those that its receiving end sees.
    """

    kind: ClassVar[str] = "held signal"
    when: When
    signal: Signal
    level: Level = Level.OFF
    wire: Wire = Wire.FROM_CONTROL
    span: Nanos = 100 * MILLISECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class PullCable:
    """Nothing arrives either way for `span` ns, then the cable is plugged again."""

    kind: ClassVar[str] = "pulled cable"
    when: At | Every | PerTransfer
    span: Nanos = 2 * SECOND
    sight: Sight = Sight.SEEN


@dataclass(frozen=True, slots=True, kw_only=True)
class CutPower:
    """An end is dead for `off` ns from the middle of the character it is sending; nothing of its state is left."""

    kind: ClassVar[str] = "power cut"
    when: At | Every | PerTransfer
    end: LineEnd
    off: Nanos = 3 * SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class RestartProcess:
    """The program at an end is killed and started again `off` ns later. Its computer and its port stay powered:
    what the driver holds still leaves, and DTR stays as it was.
    """

    kind: ClassVar[str] = "restarted process"
    when: At | Every | PerTransfer
    end: LineEnd = LineEnd.HOST
    off: Nanos = 1 * SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class StepClock:
    """The clock of an end jumps forward by `step` ns: a computer that slept, a virtual machine that was moved."""

    kind: ClassVar[str] = "clock step"
    when: At | Every | PerTransfer
    end: LineEnd = LineEnd.HOST
    step: Nanos = 1 * SECOND


LinePlan: TypeAlias = (
    FlipBits
    | Burst
    | Lose
    | DoubleCharacter
    | Framing
    | Break
    | Noise
    | LateStop
    | BaudMismatch
    | HoldSignal
    | PullCable
)
"""What happens on the wire: the injector carries it out."""

EndFault: TypeAlias = CutPower | RestartProcess | StepClock
"""What happens to an end: whoever runs the ends carries it out, at the moments of `end_faults`."""

PlannedFault: TypeAlias = LinePlan | EndFault


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultPlan:
    """What goes wrong on a line: a name, the reason in words, the faults, and the path where they come from one."""

    name: str
    why: str
    faults: tuple[PlannedFault, ...] = ()
    path: PathKind | None = None
    """What stands between the host and the wire; None: whatever the line has."""

    @property
    def line_faults(self) -> tuple[LinePlan, ...]:
        return tuple(fault for fault in self.faults if not isinstance(fault, EndFault))

    @property
    def end_faults(self) -> tuple[EndFault, ...]:
        return tuple(fault for fault in self.faults if isinstance(fault, EndFault))
