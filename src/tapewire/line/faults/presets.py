"""Fault plans with a name that a shop would understand. docs/faults.md prints them from here."""

from __future__ import annotations

from typing import Final

from tapewire.engine import MILLISECOND, SECOND
from tapewire.errors import UsageError
from tapewire.line.faults.plan import (
    BaudMismatch,
    Break,
    Burst,
    CutPower,
    DoubleCharacter,
    FaultPlan,
    FlipBits,
    Framing,
    HoldSignal,
    LateStop,
    Level,
    LineEnd,
    Lose,
    Noise,
    PerTransfer,
    PullCable,
    Rate,
    RestartProcess,
    Sight,
    Signal,
    StepClock,
    Wire,
)
from tapewire.line.paths import PATHS

__all__ = ["PRESETS", "preset"]

_PLANS: Final = (
    FaultPlan(name="clean", why="nothing goes wrong: what the others are compared with"),
    FaultPlan(
        name="worn-connector",
        why="a D-sub that has been plugged for twenty years: a pin that loses contact for less than a character",
        faults=(
            FlipBits(when=PerTransfer(1.0)),
            FlipBits(when=PerTransfer(0.3), bits=2),
            Lose(when=PerTransfer(0.7)),
            Framing(when=PerTransfer(0.3)),
            HoldSignal(when=PerTransfer(0.2), signal=Signal.CTS, span=5 * MILLISECOND),
        ),
    ),
    FaultPlan(
        name="welder-next-door",
        why="arcs on the same mains and an unshielded cable: bursts of some characters, noise where there was silence",
        faults=(
            Burst(when=PerTransfer(1.0), longest=20),
            Noise(when=PerTransfer(0.5)),
            Break(when=PerTransfer(0.1)),
        ),
    ),
    FaultPlan(
        name="doubtful-driver",
        why="an adapter whose driver loses or repeats characters under load, never marked as damaged",
        faults=(Lose(when=PerTransfer(1.0)), DoubleCharacter(when=PerTransfer(1.0))),
    ),
    FaultPlan(
        name="no-parity",
        why="two bits of one character turned: what parity cannot see, and what every bit is where none is checked",
        faults=(FlipBits(when=PerTransfer(2.0), bits=2),),
    ),
    FaultPlan(
        name="deep-usb-fifo",
        why="a USB adapter as it comes out of the box, which goes on with what it holds after DC3",
        faults=(LateStop(when=Rate(0.3), characters=64),),
        path=PATHS["usb-16ms"],
    ),
    FaultPlan(
        name="loose-dsr",
        why="the DSR pin makes contact only while nobody walks by: off for a blink, some times in a transfer",
        faults=(
            HoldSignal(when=PerTransfer(1.0), signal=Signal.DSR, span=50 * MILLISECOND),
            HoldSignal(when=PerTransfer(0.3), signal=Signal.DSR, span=2 * SECOND),
        ),
    ),
    FaultPlan(
        name="stuck-cts",
        why="a driver chip that lets go late or never: CTS stays OFF, or stays ON when the control lowers it",
        faults=(
            HoldSignal(when=PerTransfer(0.7), signal=Signal.CTS, span=2 * SECOND),
            HoldSignal(when=Rate(0.3), signal=Signal.CTS, level=Level.STAYS, span=1 * SECOND),
        ),
    ),
    FaultPlan(
        name="wrong-baud",
        why="a UART that cannot make 86400 runs 115200 instead, a third too fast, and says it does not",
        faults=(BaudMismatch(percent=-25.0, wire=Wire.FROM_HOST), BaudMismatch(percent=33.3, wire=Wire.FROM_CONTROL)),
    ),
    FaultPlan(
        name="pulled-cable",
        why="somebody trips over the cable and plugs it again; every second plug has its control lines looped back",
        faults=(
            PullCable(when=PerTransfer(0.4), span=2 * SECOND),
            PullCable(when=PerTransfer(0.4), span=2 * SECOND, sight=Sight.UNSEEN),
        ),
    ),
    FaultPlan(
        name="power-cut",
        why="either end loses its power in the middle of a character and comes back with nothing in its memory",
        faults=(
            CutPower(when=PerTransfer(0.4), end=LineEnd.HOST),
            CutPower(when=PerTransfer(0.4), end=LineEnd.CONTROL),
        ),
    ),
    FaultPlan(
        name="host-restart",
        why="an update, a crash or an impatient user ends the host's program; it comes back a second later",
        faults=(RestartProcess(when=PerTransfer(0.8)),),
    ),
    FaultPlan(
        name="clock-steps",
        why="a laptop lid closed and opened, a virtual machine moved: the clock jumps while the line goes on",
        faults=(
            StepClock(when=PerTransfer(0.7), step=300 * MILLISECOND),
            StepClock(when=PerTransfer(0.3), step=30 * SECOND),
        ),
    ),
    FaultPlan(
        name="late-xoff",
        why="a loaded computer or a driver that batches: the sender goes on for 16 characters after DC3, at times 600",
        faults=(LateStop(when=Rate(0.5), characters=16), LateStop(when=Rate(0.05), characters=600)),
    ),
    FaultPlan(
        name="noisy-idle",
        why="an input left floating while the other end is off or between messages: characters out of nothing",
        faults=(Noise(when=PerTransfer(3.0)), Break(when=PerTransfer(0.5))),
    ),
)

PRESETS: Final[dict[str, FaultPlan]] = {plan.name: plan for plan in _PLANS}


def preset(name: str) -> FaultPlan:
    """The plan of that name. Raises UsageError with the names there are."""
    if name not in PRESETS:
        raise UsageError(f"there is no fault preset {name}: choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
