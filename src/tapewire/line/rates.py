"""The rate a UART really makes when it is asked for one.

A UART divides its clock by a whole number, some adapters by a number with eighths; what the driver reads back is the
rate it was asked for. An ordinary 16550 at 1.8432 MHz asked for 86400 runs 115200 and says 86400.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["RATE_TOLERANCE", "Divider", "is_near"]

RATE_TOLERANCE: Final = 0.02
"""A rate this far off damages the last bits of an 11-bit character."""

DIVISOR_LIMIT: Final = 65535
"""A 16550 has sixteen bits for it."""


def is_near(real: float, baud: int) -> bool:
    """`real` is close enough to `baud` for both ends to understand each other."""
    return abs(real - baud) <= RATE_TOLERANCE * baud


@dataclass(frozen=True, slots=True, kw_only=True)
class Divider:
    """A UART's rates: `top` over any whole number of `parts`, in bits a second.

    16550: top is the clock over 16, parts 1. FTDI: top is 3 MHz, or 12 MHz on the fast chips, parts 8.
    """

    top: int
    parts: int = 1

    def _at(self, divisor: int) -> float:
        return self.top * self.parts / min(max(divisor, self.parts), DIVISOR_LIMIT * self.parts)

    def real_rate(self, baud: int) -> float:
        """What runs when the driver is asked for `baud`: it rounds the divisor, a half upwards."""
        return self._at((2 * self.top * self.parts + baud) // (2 * baud))

    def neighbours(self, baud: int) -> tuple[float, float]:
        """The nearest rates that can be made: not above `baud`, and not below it."""
        low = -(-self.top * self.parts // baud)
        return self._at(low), self._at(low if self.top * self.parts % baud == 0 else low - 1)
