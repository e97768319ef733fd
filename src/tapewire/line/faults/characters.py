"""Characters that do not arrive as they were sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, assert_never

from tapewire.engine import LineFault, Nanos
from tapewire.line.faults.chance import Stream
from tapewire.line.faults.damage import Parity, flipped, garbled
from tapewire.line.faults.plan import (
    Break,
    Burst,
    DoubleCharacter,
    Extent,
    FlipBits,
    Framing,
    LateStop,
    Lose,
    Noise,
    PerTransfer,
    Rate,
)
from tapewire.line.faults.when import NEVER, skip
from tapewire.line.transport import Fault

__all__ = ["STOP_CODES", "CharacterFault", "CharacterRule", "Late", "Passed", "StopRule"]

CharacterFault: TypeAlias = FlipBits | Burst | Lose | DoubleCharacter | Framing | Break | Noise

STOP_CODES = (0x13, 0x93)
"""DC3 as ASCII and as ISO has it."""


@dataclass(frozen=True, slots=True)
class Late:
    """This and what stands behind it comes up to `span` ns late."""

    span: Nanos


Passed: TypeAlias = tuple[int, bytes | Fault | Late]
"""What a wire brings in place of what was sent, and at which of its characters it stands."""


class CharacterRule:
    """One fault that hits characters. `due` is how many characters pass before the one it hits."""

    __slots__ = ("_draws", "_expected", "_left", "due", "fault")

    def __init__(self, fault: CharacterFault, draws: Stream, extent: Extent) -> None:
        self.fault = fault
        self.due = skip(fault.when, draws, extent.characters)
        self._draws = draws
        self._expected = extent.characters
        self._left = 0
        """Characters more of the same stroke."""

    def hit(self, byte: int, parity: Parity) -> list[bytes | Fault]:
        """What arrives in place of the character that is due; sets when the next one is."""
        self._move_on()
        match self.fault:
            case FlipBits(bits=bits):
                return [flipped(byte, bits, self._draws, parity)]
            case Burst():
                return [garbled(self._draws, parity)]
            case Lose():
                return []
            case DoubleCharacter():
                return [bytes((byte,)), bytes((byte,))]
            case Framing():
                return [Fault(fault=LineFault.FRAMING, byte=byte)]
            case Break():
                return [bytes((byte,)), Fault(fault=LineFault.BREAK)]
            case Noise():
                return [bytes((byte,)), garbled(self._draws, parity)]
            case _:
                assert_never(self.fault)

    def _move_on(self) -> None:
        if self._left:
            self._left -= 1
        else:
            self._left = self._stroke() - 1
        if self._left:
            self.due += 1
        elif isinstance(self.fault.when, Rate | PerTransfer):
            self.due += 1 + skip(self.fault.when, self._draws, self._expected)
        else:
            self.due = NEVER

    def _stroke(self) -> int:
        match self.fault:
            case Burst(longest=longest):
                return 1 + self._draws.randrange(longest)
            case Lose(characters=characters):
                return characters
            case _:
                return 1


class StopRule:
    """One fault that hits stop requests."""

    __slots__ = ("_draws", "due", "fault")

    def __init__(self, fault: LateStop, draws: Stream) -> None:
        self.fault = fault
        self.due = skip(fault.when, draws, 1)
        self._draws = draws

    def hits(self, number: int) -> bool:
        """Whether stop request `number`, counted from 0, is hit."""
        if self.due != number:
            return False
        again = isinstance(self.fault.when, Rate)
        self.due = number + 1 + skip(self.fault.when, self._draws, 1) if again else NEVER
        return True
