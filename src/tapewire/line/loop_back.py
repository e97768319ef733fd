"""What a loop-back plug tells of a line: what comes back damaged, how fast, and how much still comes after a stop.

It is an engine as any other, so that what it measures is what a job gets. A character that comes back stands for the
stop request of a control: what comes back behind it had left this computer's hands before the request was read.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Closure, Event, LineFault, Nanos, SignalsIn, SignalsOut

__all__ = ["LoopBack"]

SETTLE: Final[Nanos] = 200 * MILLISECOND
"""How long is listened after a stop; an adapter that holds more than that of a line is no drip feed port."""

SILENCE: Final[Nanos] = 3 * SECOND
"""Nothing has come back for so long: there is no plug."""


class LoopBack:
    """Sends `length` characters, stops `stops` times on the way, and compares what comes back."""

    def __init__(self, length: int, stops: int, data_bits: int, character: Nanos) -> None:
        values = range(1 << data_bits)
        self._pattern = bytes(values[(7 * index) % len(values)] for index in range(length))
        self._stop_at = [length * (number + 1) // (stops + 1) for number in range(stops)]
        self._settle = SETTLE + 16 * character
        self._sent = 0
        self._came = bytearray()
        self._damaged = 0
        self._held_until: Nanos | None = None
        self._stopped_at = 0
        self._began: Nanos | None = None
        self._held_for: Nanos = 0
        self._last: Nanos = 0
        self.after_stops: list[int] = []
        self.closed: str | None = None

    @property
    def is_over(self) -> bool:
        """All has come back, or nothing comes any more."""
        return self.closed is not None or (len(self._came) + self._damaged >= len(self._pattern) and not self._stop_at)

    @property
    def is_echo(self) -> bool:
        return bool(self._came) and self._pattern.startswith(bytes(self._came[:16]))

    @property
    def came(self) -> int:
        return len(self._came)

    @property
    def sent(self) -> int:
        return self._sent

    @property
    def wrong(self) -> int:
        """Characters that came damaged, differently, or not at all."""
        different = sum(one != other for one, other in zip(self._came, self._pattern[: self._sent], strict=False))
        return max(different + self._damaged, abs(self._sent - len(self._came)))

    def rate(self, character: Nanos) -> float:
        """Characters that came back over what the line carries in the time it was not stopped."""
        if self._began is None or not self._came:
            return 0.0
        took = self._last - self._began - self._held_for
        return min(1.0, (len(self._came) * character) / took) if took > 0 else 0.0

    # The engine's contract.

    signals = SignalsOut()
    recall = False

    def receive_data(self, data: bytes, now: Nanos) -> None:
        self._came += data
        self._last = now
        if self._held_until is None and self._stop_at and len(self._came) >= self._stop_at[0]:
            # The request is the character at the stop's place; what came with it in one look counts as after it.
            self._stopped_at = self._stop_at.pop(0)
            self._held_until = now + self._settle

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        self._damaged += 1

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        """A plug loops these back as well; nothing hangs on them."""

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self.closed = reason

    def data_to_send(self, limit: int) -> bytes:
        return b"" if self._held_until is not None else self._pattern[self._sent : self._sent + limit]

    def data_sent(self, count: int, now: Nanos) -> None:
        if self._began is None:
            self._began = now
        self._last = max(self._last, self._began)
        self._sent += count

    def data_left(self, count: int, now: Nanos) -> None:
        """What comes back tells more."""

    def data_discarded(self, count: int, now: Nanos) -> None:
        """Nothing is called back."""

    def next_deadline(self) -> Nanos | None:
        if self._held_until is not None:
            return self._held_until
        return None if self._began is None or self.closed is not None else self._last + SILENCE

    def handle_timer(self, now: Nanos) -> None:
        if self._held_until is not None and now >= self._held_until:
            self.after_stops.append(len(self._came) - self._stopped_at)
            self._held_for += now - (self._held_until - self._settle)
            self._held_until = None
        elif self._began is not None and self._held_until is None and now >= self._last + SILENCE:
            self.closed = "nothing comes back: is the plug on?" if not self._came else "it stopped coming back"

    def next_event(self) -> Event | None:
        return None
