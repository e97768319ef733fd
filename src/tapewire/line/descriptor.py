"""What every line over a file descriptor has in common: reading, the bounded write, pacing, and the end.

All calls return at once and every moment comes in as `now`: the kernel is asked, the clock never. What a kind of line
does differently (how it ends, what its kernel queue says, which control lines it has) are the hooks at the bottom.
"""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from tapewire.engine import MILLISECOND, Closure, Nanos, SignalsIn, SignalsOut
from tapewire.errors import UsageError
from tapewire.line.pacing import RxPacer, TxPacer, character_time
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance

__all__ = ["BAUD_LIMITS", "BREAK_TIME", "Arrivals", "DescriptorLine", "LineSettings", "Parity", "Signals"]

BAUD_LIMITS: Final = (50, 4_000_000)
"""From the slowest teleprinter rate termios knows to the fastest."""

READ_SIZE: Final = 4096
"""Bytes asked of the kernel at once; a terminal never gives more."""

PENDING_BOUND: Final = 4096
"""Characters a paced reception takes from the kernel ahead of their time. The rest stays there and holds the sender."""

LOOK_BOUND: Final = 65536
"""Characters an unpaced reception takes in one look, so that a flood cannot keep the loop from its other lines."""

GROUP_TIME: Final[Nanos] = 2 * MILLISECOND
"""Paced characters are passed on in groups of this duration: two late wake-ups long, 16 characters at 86400."""

SLACK_SHARE: Final = 4
"""A quarter of the window may pass before a refill that is due: half of it, 13 ms, is left then before a gap."""

QUEUE_POLL: Final[Nanos] = 5 * MILLISECOND
"""How often the kernel's queue is asked while it holds more than the model of the line says it should."""


BREAK_TIME: Final[Nanos] = 250 * MILLISECOND
"""How long a break is held: the least that tcsendbreak takes, and longer than any character."""


class Parity(StrEnum):
    """The bit behind the data bits, which the UART makes and checks."""

    NONE = "none"
    EVEN = "even"
    ODD = "odd"


class Signals(StrEnum):
    """Whether the control lines that come in mean anything."""

    USED = "used"
    IGNORED = "ignored"
    """The cable has three wires, or a serial server tells of lines that nobody has connected: all count as ON."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSettings:
    """How a line is run, whatever kind it is.

    `window` is the number of characters allowed in flight. Unless `parity` is told, `stopbits` 1 means 8E1 and 2 means
    8N2 (B-63322EN-1 3.1); with seven `data_bits` they mean 7E1 and 7E2.
    With `paced_reception` characters are taken no faster than `baud`. Raises UsageError.
    """

    baud: int
    stopbits: int
    window: int
    paced_reception: bool = False
    data_bits: int = 8
    parity: Parity | None = None
    signals: Signals = Signals.USED

    @property
    def parity_bit(self) -> Parity:
        """The parity in force."""
        if self.parity is not None:
            return self.parity
        return Parity.EVEN if self.data_bits == 7 or self.stopbits == 1 else Parity.NONE

    @property
    def has_parity(self) -> bool:
        """The UART makes and checks a parity."""
        return self.parity_bit is not Parity.NONE

    @property
    def framing(self) -> str:
        """In the usual three characters."""
        return f"{self.data_bits}{self.parity_bit.value[0].upper()}{self.stopbits}"

    @property
    def character(self) -> Nanos:
        """How long one character occupies the line, start bit to last stop bit."""
        return character_time(self.baud, 1 + self.data_bits + self.has_parity + self.stopbits)

    def __post_init__(self) -> None:
        low, high = BAUD_LIMITS
        if not low <= self.baud <= high:
            raise UsageError(f"a line cannot run at {self.baud} baud: give a rate from {low} to {high}")
        if self.stopbits not in (1, 2):
            raise UsageError(f"a line cannot have {self.stopbits} stop bits: give 1 (8E1) or 2 (8N2)")
        if self.data_bits not in (7, 8):
            raise UsageError(f"a line cannot have {self.data_bits} data bits: give 7 or 8")
        if self.data_bits == 7 and self.parity is Parity.NONE and self.stopbits == 1:
            raise UsageError("a line cannot run 7N1: give it a parity, or 2 stop bits")
        if self.window < 1:
            raise UsageError(f"a line cannot run with a window of {self.window} characters: give 1 or more")


class Arrivals:
    """What came in and was not read yet, in its order. With a pacer, characters wait until a line would bring them;
    signals and the end wait behind the characters before them.
    """

    def __init__(self, pacer: RxPacer | None = None) -> None:
        self._pacer = pacer
        self._bound = LOOK_BOUND if pacer is None else PENDING_BOUND
        self._items: deque[LineItem] = deque()
        self._characters = 0

    @property
    def room(self) -> int:
        """How many more characters may be put in."""
        return max(0, self._bound - self._characters)

    def put(self, item: LineItem) -> None:
        self._items.append(item)
        self._characters += _characters(item)

    def take(self, now: Nanos) -> list[LineItem]:
        if self._pacer is None and not self._items:
            return []
        due = self._characters if self._pacer is None else self._pacer.due(self._characters, now)
        items: list[LineItem] = []
        while self._items:
            item = self._items[0]
            if isinstance(item, bytes) and len(item) > due:
                self._items[0] = item[due:]
                item = item[:due]
            elif _characters(item) <= due:
                self._items.popleft()
            else:
                break
            if item == b"":
                break
            items.append(item)
            due -= _characters(item)
            self._characters -= _characters(item)
        return items

    def clear(self) -> None:
        self._items.clear()
        self._characters = 0

    def drop_characters(self) -> None:
        """Whoever sent them has called them back; what else happened stays."""
        self._items = deque(item for item in self._items if not _characters(item))
        self._characters = 0

    def next_deadline(self) -> Nanos | None:
        """When the next group has come in; None while nothing waits."""
        if self._pacer is None or not self._characters:
            return None
        group = max(1, GROUP_TIME // self._pacer.character)
        return self._pacer.next_deadline(min(group, self._characters))


def _characters(item: LineItem) -> int:
    match item:
        case bytes():
            return len(item)
        case Fault():
            return 1
        case _:
            return 0


def _nearer(one: Nanos | None, other: Nanos | None) -> Nanos | None:
    if one is None or other is None:
        return other if one is None else one
    return one if one <= other else other


class DescriptorLine:
    """A Transport over a non-blocking file descriptor, which it owns.

    What the kernel does not take stays here in a queue no longer than the window, and can be called back; what the
    kernel took can be called back only where a kind of line says so.
    """

    def __init__(self, fd: int, settings: LineSettings) -> None:
        character = settings.character
        self._settings = settings
        self._fd: int | None = fd
        self._tx = TxPacer(character, settings.window)
        self.slack: Nanos = 0 if settings.paced_reception else settings.window * character // SLACK_SHARE
        """How much later than its deadline this line may be looked at. What is due in a closed loop, or character by
        character, is due at once: a small window has next to none."""
        self._arrivals = Arrivals(RxPacer(character) if settings.paced_reception else None)
        self._now: Nanos = 0
        self._room = 0
        self._unsent = bytearray()
        self._patience = 0
        """Characters the kernel may hold beyond the model of the line before they count as stuck."""
        self._behind = False
        """Since the last read the kernel was seen to hold more than the model of the line says: it must be looked at
        again, even if it has got rid of it since."""
        self._failure: Closed | None = None
        self._ended = False
        self._connected = True
        self._signals: SignalsIn | None = None
        self._asked: Nanos | None = None
        self._queued_then = 0
        self._is_breaking = False
        self._break_ends: Nanos | None = None

    @property
    def connected(self) -> bool:
        """The other side is there; nothing can be sent to it before."""
        return self._connected

    @property
    def watched(self) -> int | None:
        """The descriptor whose readiness means that `read` has something; None while waiting on it means nothing.

        So it is when the line has ended, when a paced reception holds all it may, and before the other side is there.
        """
        return self._fd if self._connected and not self._ended and self._arrivals.room else None

    def read(self, now: Nanos) -> list[LineItem]:
        self._now = now
        self._behind = False
        if self._fd is None:
            return []
        if self._unsent:
            self._flush()
        if self._is_breaking:
            self._go_on_with_break(self._fd, now)
        if self._signals is None:
            self._look_at_signals()
            self._collect(self._fd)
        else:
            self._collect(self._fd)
            self._look_at_signals()
        return self._arrivals.take(now)

    def room(self, now: Nanos) -> int:
        """The window less what is in flight, in pieces of at least a quarter of it."""
        self._now = now
        closed = self._fd is None or not self._connected or self._ended or self._failure is not None
        if closed or self._unsent or self._is_breaking or (self._signals is not None and not self._signals.cts):
            self._room = 0
        else:
            self._room = self._tx.offer(self._settings.window - self.in_flight(now))
        return self._room

    def write(self, data: bytes, now: Nanos) -> None:
        assert len(data) <= self._room, f"{len(data)} characters into room for {self._room}"
        self._now = now
        self._room -= len(data)
        self._tx.hand_over(len(data), now)
        self._unsent += self._encode(data)
        self._flush()

    def in_flight(self, now: Nanos) -> int:
        """By the model of a line at its rate, and at least what the kernel and this end still hold."""
        held, by_model = self._held(now) - self._patience, self._tx.in_flight(now)
        if held <= by_model:
            return by_model
        self._behind = True
        return held

    def on_its_way(self, now: Nanos) -> int:
        """What the kernel and this end still hold. The FIFO of a UART (16 characters) cannot be asked.

        A simulated control, which takes characters at the pace of a line, also says its own at that pace.
        """
        if self._settings.paced_reception:
            return self._tx.in_flight(now)
        held = self._held(now)
        self._behind = self._behind or held > 0
        return held

    def _held(self, now: Nanos) -> int:
        """The kernel is asked once for one moment, and again when it has been given more."""
        if self._fd is None or self._ended:
            return 0
        if now != self._asked:
            self._asked, self._queued_then = now, self._queued(self._fd)
        return self._queued_then + len(self._unsent)

    def discard(self, now: Nanos) -> int:
        """Call back what the kernel did not take, and of what it took as much as this kind of line can."""
        self._now = now
        if self._fd is None or self._ended:
            return 0
        count = len(self._unsent) + self._recall(self._fd)
        self._asked = None
        self._unsent.clear()
        self._tx.call_back(count)
        return count

    @property
    def can_break(self) -> bool:
        """This kind of line can send a break."""
        return False

    def send_break(self, now: Nanos) -> None:
        """Hold the wire for BREAK_TIME once all that was handed over has left; until it is over nothing else is sent.

        Asked again meanwhile it is the same break.
        """
        self._now = now
        self._is_breaking = True
        if self._fd is not None:
            self._go_on_with_break(self._fd, now)

    def _go_on_with_break(self, fd: int, now: Nanos) -> None:
        if self._break_ends is None:
            if not self.in_flight(now):
                self._break_ends = now + BREAK_TIME
                self._begin_break(fd)
        elif now >= self._break_ends:
            self._is_breaking, self._break_ends = False, None
            self._end_break(fd)

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        """Nothing: only a real port has control lines."""

    def next_deadline(self) -> Nanos | None:
        if self._fd is None:
            return None
        if self._failure is not None and not self._ended:
            return self._now
        nearest = _nearer(self._next_room(), self._arrivals.next_deadline())
        nearest = _nearer(nearest, self._break_ends)
        if not self._ended:
            poll = _nearer(self._poll_interval(), QUEUE_POLL if self._behind else None)
            if poll is not None:
                nearest = _nearer(nearest, self._now + poll)
        return nearest

    @property
    def stop_distance(self) -> StopDistance:
        return StopDistance(
            characters=self._settings.window,
            guaranteed=False,
            how=f"paced by time at {self._settings.baud} baud; what lies beyond this computer cannot be asked",
        )

    def close(self, now: Nanos) -> None:
        """Nothing is read or written any more. Whoever wants the last characters to leave waits for `in_flight` 0."""
        fd, self._fd = self._fd, None
        if fd is not None:
            self._arrivals.clear()
            self._unsent.clear()
            self._release(fd)

    def _collect(self, fd: int) -> None:
        while not self._ended and (room := self._arrivals.room):
            try:
                data = os.read(fd, min(room, READ_SIZE))
            except BlockingIOError:
                self._connected = True
                if self._failure is not None:
                    self._end(self._failure)
                return
            except InterruptedError:
                continue
            except OSError as error:
                closed = self._closed_by(error)
                if closed is None:
                    return
                self._end(self._failure or closed)
                return
            if not data:
                self._end(self._failure or self._closed_at_end())
                return
            self._connected = True
            for item in self._decode(data):
                self._arrivals.put(item)

    def _end(self, closed: Closed) -> None:
        self._ended = True
        self._unsent.clear()
        self._arrivals.put(closed)

    def _flush(self) -> None:
        self._asked = None
        while self._unsent and self._fd is not None and self._failure is None:
            try:
                del self._unsent[: os.write(self._fd, self._unsent)]
            except BlockingIOError:
                return
            except OSError as error:
                # What came in before can still be read: the end is told behind it, by `_collect`.
                self._failure = self._closed_by(error) or self._closed_at_end()

    def _look_at_signals(self) -> None:
        if self._fd is None or self._ended:
            return
        signals = self._ask_signals(self._fd)
        if signals is not None and signals != self._signals:
            self._signals = signals
            self._arrivals.put(signals)

    # What kinds of line do differently.

    def _next_room(self) -> Nanos | None:
        """When there is room again, or all has left, if nobody says so."""
        return self._tx.next_deadline(self._now)

    def _encode(self, data: bytes) -> bytes:
        """Characters as the kernel is given them."""
        return data

    def _decode(self, data: bytes) -> Sequence[LineItem]:
        return [data]

    def _closed_by(self, error: OSError) -> Closed | None:
        """The end that an errno means; None for a line that is not there yet."""
        return Closed(closure=Closure.LOST, reason=f"the line was lost: {os.strerror(error.errno or errno.EIO)}")

    def _closed_at_end(self) -> Closed:
        """The end that an end of file means."""
        return Closed(closure=Closure.ORDERLY, reason="the other side closed the line")

    def _queued(self, fd: int) -> int:
        """Characters that the kernel took and has not got rid of."""
        return 0

    def _recall(self, fd: int) -> int:
        """Call back what the kernel took. Returns how many characters will never leave."""
        return 0

    def _begin_break(self, fd: int) -> None:
        """Hold the wire; only called where `can_break`."""

    def _end_break(self, fd: int) -> None:
        """Let go of it."""

    def _ask_signals(self, fd: int) -> SignalsIn | None:
        """The control lines; None where there are none."""
        return None

    def _poll_interval(self) -> Nanos | None:
        """How often this line must be looked at because nothing announces what it has to say."""
        return None

    def _release(self, fd: int) -> None:
        os.close(fd)
