"""What kinds of serial port there are, by the driver that Linux has for them, and what each can do for a DNC line.

The facts of the USB adapters are read in the source of their drivers (Linux 6.1 and 6.12) and in the makers' data
sheets; only `serial8250` and `ftdi_sio` have been run here, in a virtual machine. docs/lines.md says which is which.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["CHIPS", "UNKNOWN_CHIP", "Chip", "chip_of", "uart_name"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Chip:
    """One kind of port."""

    title: str
    fifo: int | None
    """Characters the chip may hold that no queue of the kernel counts; None where it is not known."""
    can_say_empty: bool
    """Its driver answers whether the transmitter is empty, so that it can run in a closed loop."""
    says_late_ms: int = 0
    """The answer may be so much older than the question, besides the latency timer."""
    can_wait_for_signals: bool = True
    marks_damage: bool = True
    """Damaged characters come marked at their place."""
    has_cts: bool = True
    divider_parts: int = 0
    """The rates it makes, see `Divider`; 0 where the driver reads back the real rate, or nobody says."""
    advice: tuple[str, ...] = ()


UNKNOWN_CHIP: Final = Chip(
    title="unknown",
    fifo=None,
    can_say_empty=False,
    advice=("nothing is known of this driver: qualify the port before it feeds a control that tolerates little",),
)

_NO_CLOSED_LOOP: Final = (
    "its driver cannot say whether the transmitter is empty: what the chip holds runs on after a stop request,"
    " so it is no port for a control that tolerates three characters"
)

CHIPS: Final = {
    "serial8250": Chip(title="UART of the 16550 family", fifo=16, can_say_empty=True, divider_parts=1),
    "ftdi_sio": Chip(
        title="FTDI USB adapter",
        fifo=256,
        can_say_empty=True,
        says_late_ms=2,
        divider_parts=8,
        advice=(
            "one damaged character marks the whole USB packet it came in, up to 62 characters",
            "its latency timer must be 1 ms: at the default of 16 ms a stop request waits up to 16 ms",
        ),
    ),
    "cp210x": Chip(title="Silicon Labs CP210x USB adapter", fifo=576, can_say_empty=False, advice=(_NO_CLOSED_LOOP,)),
    "ch341": Chip(
        title="WCH CH340 or CH341 USB adapter",
        fifo=32,
        can_say_empty=False,
        marks_damage=False,
        advice=(_NO_CLOSED_LOOP, "its driver reports no damaged characters: parity errors pass unseen"),
    ),
    "pl2303": Chip(title="Prolific PL2303 USB adapter", fifo=256, can_say_empty=False, advice=(_NO_CLOSED_LOOP,)),
    "cdc_acm": Chip(
        title="USB device of the class CDC ACM",
        fifo=None,
        can_say_empty=False,
        has_cts=False,
        advice=(_NO_CLOSED_LOOP, "the class has no CTS: it is always ON, and a control cannot stop us by it"),
    ),
    "mos7840": Chip(title="MosChip USB adapter", fifo=None, can_say_empty=False, advice=(_NO_CLOSED_LOOP,)),
}
"""By the name of the driver."""

_ALIASES: Final = {"ch341-uart": "ch341"}

_UARTS: Final = {
    1: "8250", 2: "16450", 3: "16550", 4: "16550A", 5: "CIRRUS", 6: "16650", 7: "16650V2", 8: "16750", 9: "16C950/954",
    10: "16C950/954", 11: "16654", 12: "16850", 13: "RSA", 14: "NS16550A", 15: "XScale", 16: "RM9000",
}  # fmt: skip
"""linux/serial_core.h: the UARTs whose divisor is a whole number of sixteenths of the clock."""


def chip_of(driver: str | None) -> Chip:
    """What is known of the ports of `driver`."""
    return CHIPS.get(_ALIASES.get(driver or "", driver or ""), UNKNOWN_CHIP)


def uart_name(number: int) -> str | None:
    """The name of a UART of the 16550 family by its number in the kernel; None for one of another family."""
    return _UARTS.get(number)
