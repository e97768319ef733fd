"""A terminal of this computer as a line: a UART, a USB adapter, or the slave of a pseudo terminal.

Software flow control stays off, because DC1 and DC3 are commands of these protocols; hardware flow control stays off,
because RTS belongs to the engine and output held by the kernel blocks a close. Damaged characters come marked in their
place (PARMRK). DTR stays as it is when the port is closed: a control that still executes would raise an alarm.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.errors import LineError
from tapewire.line.closed_loop import CLOSED_LOOP_WINDOW, ClosedLoop
from tapewire.line.descriptor import DescriptorLine, LineSettings, Signals
from tapewire.line.ports.files import Port
from tapewire.line.ports.kernel import Counters, TtyKernel
from tapewire.line.ports.marks import Damage, decode_marks
from tapewire.line.ports.modem import SignalWatch, can_interrupt
from tapewire.line.ports.standstill import STANDSTILL, Standstill
from tapewire.line.transport import Closed, Fault, LineItem, StopDistance

__all__ = ["TtyLine"]

UART_FIFO: Final = 16
"""Characters in the transmit FIFO of a 16550, where nothing says how many there are."""

SIGNALS_POLL: Final[Nanos] = 10 * MILLISECOND
"""How often the control lines are looked at where nobody tells; between two looks at 86400 baud lie 79 characters."""

SIGNALS_CHECK: Final[Nanos] = 250 * MILLISECOND
"""How often they are looked at where the driver tells of changes, in case it forgets one."""

NO_SIGNALS: Final = frozenset({errno.ENOTTY, errno.EINVAL, errno.ENOSYS})


class TtyLine(DescriptorLine):
    """An open, raw terminal, which it owns. `port` is what the kernel shows of it, None for a pseudo terminal.

    A pseudo terminal is paced like any other line, since it swallows what it is given; nothing can be called back from
    it, and it has no control lines.
    """

    def __init__(
        self, fd: int, settings: LineSettings, *, path: str, kernel: TtyKernel, is_pseudo: bool, port: Port | None
    ) -> None:
        super().__init__(fd, settings)
        self._path = path
        self._kernel = kernel
        self._is_pseudo = is_pseudo
        self._port = port
        self._carry = b""
        likely = LineFault.PARITY if settings.has_parity else LineFault.FRAMING
        # Without parity a damaged character can only be one whose stop bit is missing.
        self._damage = Damage(likely, self.counters())
        self._has_signals = not is_pseudo and self._signals_answer(fd)
        self._hears_signals = self._has_signals and settings.signals is Signals.USED
        self._watch = SignalWatch(fd, kernel) if self._hears_signals and can_interrupt() else None
        self._both = None if self._watch is None else _both(fd, self._watch.fd)
        self._loop = self._closed_loop(fd)
        self._standstill = Standstill()

    @property
    def watched(self) -> int | None:
        """Characters and changes of the control lines alike."""
        watched = super().watched
        return watched if watched is None or self._both is None else self._both.fileno()

    @property
    def stop_distance(self) -> StopDistance:
        window, baud = self._settings.window, self._settings.baud
        if self._is_pseudo:
            return StopDistance(
                characters=window, guaranteed=False, how=f"a pseudo terminal, paced by time at {baud} baud"
            )
        if self._loop is not None:
            return StopDistance(
                characters=window,
                guaranteed=True,
                how=f"a closed loop: {window} at a time, and only when the transmitter says that it is empty",
            )
        fifo = self._port.fifo if self._port is not None else None
        is_uart = self._port is not None and self._port.uart is not None
        return StopDistance(
            characters=window + (fifo or UART_FIFO),
            guaranteed=is_uart and fifo is not None,
            how=f"a window of {window}, kept by the driver's queue, and {fifo or UART_FIFO} in the FIFO"
            + (" of the UART" if is_uart else "; an adapter of an unknown kind may hold more"),
        )

    @property
    def waits_for_proof(self) -> bool:
        """It would run in a closed loop, but its transmitter has never said that it is empty: not every driver that
        answers knows.
        """
        return self._loop is not None and not self._is_empty()

    def run_without_asking(self) -> None:
        """Its driver answers, and the answer means nothing: the window is kept as on other ports."""
        self._loop = None

    def counters(self) -> Counters | None:
        """What the driver has counted; None where it does not count."""
        if self._fd is None or self._is_pseudo:
            return None
        with contextlib.suppress(OSError):
            return self._kernel.counters(self._fd)
        return None

    def read(self, now: Nanos) -> list[LineItem]:
        self._watch_transmitter(now)
        return super().read(now)

    def write(self, data: bytes, now: Nanos) -> None:
        if self._loop is not None:
            self._loop.hand_over(len(data), now)
        self._standstill.hand_over(len(data))
        super().write(data, now)

    def in_flight(self, now: Nanos) -> int:
        """In a closed loop what the transmitter has not got rid of, by asking it."""
        if self._loop is None:
            return super().in_flight(now)
        return 0 if self._fd is None or self._ended else self._loop.in_flight(now, self._is_empty)

    def on_its_way(self, now: Nanos) -> int:
        return super().on_its_way(now) if self._loop is None else self.in_flight(now)

    def discard(self, now: Nanos) -> int:
        count = super().discard(now)
        if self._loop is not None:
            self._loop.call_back(count)
        self._standstill.call_back(count)
        return count

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        if self._fd is None or not self._has_signals:
            return
        wanted = {termios.TIOCM_RTS: signals.rts, termios.TIOCM_DTR: signals.dtr}
        on = sum(bit for bit, state in wanted.items() if state)
        with contextlib.suppress(OSError):  # a port that is gone says so when it is read
            self._kernel.set_signals(self._fd, on, sum(wanted) - on)

    def _watch_transmitter(self, now: Nanos) -> None:
        """One that holds characters and sends none ends the line: the job would wait for it without end."""
        if self._is_pseudo or self._failure is not None:
            return
        held = self._held(now) if self._loop is None else self.in_flight(now)
        lasts = self._standstill.lasts(held, now)
        if lasts >= STANDSTILL:
            self._failure = Closed(
                closure=Closure.LOST,
                reason=f"{self._path} was lost: its transmitter holds {held} characters and has sent none for"
                f" {lasts // SECOND} s; unplug the adapter and plug it in again",
            )

    def _closed_loop(self, fd: int) -> ClosedLoop | None:
        if self._is_pseudo or self._settings.window > CLOSED_LOOP_WINDOW:
            return None
        try:
            self._kernel.transmitter_is_empty(fd)
        except OSError:
            return None
        late = 0
        if self._port is not None and self._port.uart is None:
            # An adapter reports its state over USB, one latency timer after the characters got there.
            late = self._port.chip.says_late_ms + (self._port.latency_timer_ms or 0)
        return ClosedLoop(self._settings.character, late * MILLISECOND)

    def _is_empty(self) -> bool:
        if self._unsent or self._fd is None:
            return False
        with contextlib.suppress(OSError):
            return not self._kernel.queued(self._fd) and self._kernel.transmitter_is_empty(self._fd)
        return False

    def _next_room(self) -> Nanos | None:
        return super()._next_room() if self._loop is None else self._loop.next_question(self._now)

    def _decode(self, data: bytes) -> list[LineItem]:
        counters = self.counters() if not self._is_pseudo else None
        lost = self._damage.count(counters) if counters is not None else 0
        marked, self._carry = decode_marks(self._carry + data)
        items: list[LineItem] = [item if isinstance(item, bytes) else self._damage.of(item) for item in marked]
        return [*items, Fault(fault=LineFault.UART_OVERRUN)] if lost else items

    def _closed_by(self, error: OSError) -> Closed:
        if self._is_pseudo and error.errno == errno.EIO:
            return self._closed_at_end()
        reason = os.strerror(error.errno or errno.EIO)
        return Closed(closure=Closure.LOST, reason=f"{self._path} was lost: {reason}")

    def _closed_at_end(self) -> Closed:
        if self._is_pseudo:
            return Closed(closure=Closure.ORDERLY, reason=f"the other side closed {self._path}")
        return Closed(closure=Closure.LOST, reason=f"{self._path} was lost: it hung up or was unplugged")

    def _queued(self, fd: int) -> int:
        if self._is_pseudo:
            return 0  # which is what it says whatever it holds
        with contextlib.suppress(OSError):
            return self._kernel.queued(fd)
        return 0

    def _recall(self, fd: int) -> int:
        """Empty the driver's queue, and count it while nothing moves.

        A driver that still holds characters afterwards did not empty it: then all of them leave, and none counts.
        """
        if self._is_pseudo:
            return 0
        with contextlib.suppress(OSError):
            self._kernel.hold_output(fd)
            try:
                queued = self._queued(fd)
                self._kernel.flush_output(fd)
                return 0 if self._queued(fd) else queued
            finally:
                self._kernel.release_output(fd)
        return 0

    def _signals_answer(self, fd: int) -> bool:
        try:
            self._kernel.signals(fd)
        except OSError as error:
            if error.errno not in NO_SIGNALS:
                raise LineError(f"the control lines cannot be read: {error.strerror}") from error
            return False
        return True

    def _ask_signals(self, fd: int) -> SignalsIn | None:
        if not self._hears_signals:
            return None
        if self._watch is not None:
            self._watch.changed()
        with contextlib.suppress(OSError):
            bits = self._kernel.signals(fd)
            return SignalsIn(
                cts=bool(bits & termios.TIOCM_CTS),
                dsr=bool(bits & termios.TIOCM_DSR),
                cd=bool(bits & termios.TIOCM_CD),
                ri=bool(bits & termios.TIOCM_RI),
            )
        return None

    def _poll_interval(self) -> Nanos | None:
        if not self._hears_signals:
            return None
        told = self._watch is not None and not self._watch.failed and self.watched is not None
        return SIGNALS_CHECK if told else SIGNALS_POLL

    @property
    def can_break(self) -> bool:
        return not self._is_pseudo

    def _begin_break(self, fd: int) -> None:
        with contextlib.suppress(OSError):  # a port that is gone says so when it is read
            self._kernel.begin_break(fd)

    def _end_break(self, fd: int) -> None:
        with contextlib.suppress(OSError):
            self._kernel.end_break(fd)

    def _release(self, fd: int) -> None:
        if self._watch is not None and self._both is not None:
            self._both.close()
            self._watch.close()
        if not self._is_pseudo:
            with contextlib.suppress(OSError):
                if self._break_ends is not None:
                    self._kernel.end_break(fd)
                # A close would wait up to 30 s for what is still queued, and it would leave after the job's end.
                self._kernel.flush_output(fd)
                self._kernel.disclaim(fd)
        os.close(fd)


def _both(port: int, signals: int) -> select.epoll:
    """One descriptor that is readable when either is."""
    both = select.epoll()
    both.register(port, select.EPOLLIN)
    both.register(signals, select.EPOLLIN)
    return both
