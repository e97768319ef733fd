"""What stands between a program and the wire: the numbers of a UART, a USB adapter, a serial server.

A path kind belongs to one end. Its figures say how many characters are out of reach once they are handed over, how
late a received character is told, and whether anybody can ask the transmitter if it is empty.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from tapewire.engine import MILLISECOND, Nanos

__all__ = ["PATHS", "PathKind", "TransmitterEmpty"]


class TransmitterEmpty(Enum):
    """Whether the end can ask its transmitter: has the last character physically left?"""

    ASKED = "can be asked"
    UNKNOWN = "cannot be asked"


@dataclass(frozen=True, slots=True, kw_only=True)
class PathKind:
    """One kind of path, as seen by the end that has it."""

    name: str
    why: str
    fifo: int
    """Characters in the transmit FIFO of the UART: they leave whatever happens."""
    buffer: int = 0
    """Characters before it, in an adapter or a server, that cannot be called back either."""
    trigger: int = 1
    """The receive FIFO tells the processor when it holds so many characters,"""
    timeout_characters: int = 4
    """or when for so many character times none has come behind them; 0: as soon as none is behind them."""
    poll: Nanos = 0
    """An adapter is asked so often for what came in, and given what goes out, ns. 0: it interrupts."""
    latency: Nanos = 0
    """A network between, one way, ns."""
    signal_delay: Nanos | None = 0
    """How late a control line is seen, ns; None: it carries none."""
    transmitter_empty: TransmitterEmpty = TransmitterEmpty.UNKNOWN

    @property
    def out_of_reach(self) -> int:
        """Characters that cannot be called back."""
        return self.fifo + self.buffer


PATHS: Final[dict[str, PathKind]] = {
    path.name: path
    for path in (
        PathKind(
            name="uart-16550",
            why="16550A on the bus: FIFOs of 16, receive trigger 8 as Linux sets it, told empty by its line status",
            fifo=16,
            trigger=8,
            transmitter_empty=TransmitterEmpty.ASKED,
        ),
        PathKind(
            name="uart-deep",
            why="16C950 on a PCIe card: FIFOs of 128, receive trigger 32, told empty by its line status",
            fifo=128,
            trigger=32,
            transmitter_empty=TransmitterEmpty.ASKED,
        ),
        PathKind(
            name="usb-1ms",
            why="USB adapter with its latency timer at 1 ms: 256 characters inside, asked at every frame of the bus",
            fifo=16,
            buffer=256,
            poll=1 * MILLISECOND,
        ),
        PathKind(
            name="usb-16ms",
            why="the same as it comes out of the box: latency timer at 16 ms, 15 characters of 9600 baud",
            fifo=16,
            buffer=256,
            poll=16 * MILLISECOND,
        ),
        PathKind(
            name="serial-server",
            why="raw TCP to a serial server: 1024 characters inside, 3 ms of network each way, no control lines",
            fifo=16,
            buffer=1024,
            trigger=16,
            latency=3 * MILLISECOND,
            signal_delay=None,
        ),
    )
}
