"""Binary input operation at the control: one record every unit of time, straight to the axes (B-63322EN-1 chapter 9).

The control behind the remote buffer hands over from the block G05 on. Each record is taken out, checked and moved; a
record that is not there when its time has come interrupts the pulse distribution (9.2), and that is told.
"""

from __future__ import annotations

from typing import Final

from tapewire.codes import TABLES, DataCode
from tapewire.engine import MILLISECOND, Alarm, Event, Events, Nanos, Notice
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.g05.layout import BinaryInput, Layout, RecordFormat
from tapewire.g05.modes import ModalWatch
from tapewire.g05.sections import find_g05

__all__ = ["BinaryOperation", "binary_operation"]

LONGEST_BLOCK: Final = 256
"""What the control takes of a block ahead (12.2): no longer one reaches this place whole."""


class BinaryOperation:
    """Takes records while it is `active`. What it has to tell waits in `next_event`.

    `stopped` is set by an alarm: the control executes nothing more.
    """

    def __init__(self, parameters: BinaryInput, to_ascii: bytes) -> None:
        layout = parameters.layout
        assert layout is not None, "a control knows its axes"
        self.layout: Layout = layout
        self.unit_time: Nanos = parameters.unit_time * MILLISECOND
        self.active = False
        self.stopped = False
        self.position = [0] * layout.axis_count
        """Sum of all travel so far, in increments, by axis."""
        self.records_executed = 0
        self.interruptions = 0
        """How often the pulse distribution had to wait for a record."""
        self.interrupted: Nanos = 0
        """For how long in all."""
        self.longest_interruption: Nanos = 0
        self.due: Nanos | None = None
        """When the record being moved is done."""
        self._starving = False
        self._waited: Nanos = 0
        """How long the interruption that goes on has lasted before a feed hold."""
        self._rest: Nanos | None = None
        """Of the unit of time in which the axes were held."""
        self._told = 0
        self._to_ascii = to_ascii
        self._modes = ModalWatch()
        self._events = Events()

    def next_event(self) -> Event | None:
        return self._events.get()

    def sees(self, block: bytes) -> None:
        """The control executes a block of text: G05 alone begins binary input operation, unless a mode forbids it."""
        text = block[:LONGEST_BLOCK].translate(self._to_ascii)
        if find_g05(text) is None:
            self._modes.feed(text)
        elif self._modes.forbidden:
            self._stop(AlarmNumber.SR891, ", ".join(self._modes.forbidden))
        else:
            self.active = True

    def reset(self) -> None:
        """RESET, or an alarm: normal NC format again. Positions stay."""
        self._leave()
        self.stopped = False
        self._modes = ModalWatch()

    def next_deadline(self) -> Nanos | None:
        """When the next record is due, unless it is being waited for, or the axes are held."""
        return self.due if self.active and not self._starving else None

    def hold(self, now: Nanos) -> None:
        """FEED HOLD, which is enabled (9.3 note 4): the rest of the unit of time waits for `go`.

        An interruption lasts on behind it; the hold itself is none.
        """
        if self.due is not None:
            self._rest = max(0, self.due - now)
            if self._starving:
                self._waited += now - self.due
            self.due = None

    def go(self, now: Nanos) -> None:
        """CYCLE START after a feed hold."""
        if self._rest is not None:
            self.due, self._rest = now + self._rest, None

    def step(self, records: bytearray, now: Nanos) -> bool:
        """Take the record whose time has come from the front of `records`; False when there is nothing to do yet."""
        if self.due is not None and self.due > now:
            return False
        size = self.layout.record_bytes
        if len(records) < size:
            self._starve()
            return False
        record = bytes(records[:size])
        del records[:size]
        self._end_interruption(now)
        if (sum(record[:-1]) - record[-1]) & 0xFF:
            self._stop(AlarmNumber.SR890, f"record {self.records_executed + 1:,}: {record.hex(' ')}")
        elif not any(record):
            self._leave()
        else:
            self._move(record, now)
        return True

    def _starve(self) -> None:
        """The first record of a section may take its time: nothing moves yet."""
        if self.due is None or self._starving:
            return
        self._starving = True
        self.interruptions += 1
        if self.interruptions == self._told + 1:
            self._events.put(
                Notice(
                    text=f"G05: after record {self.records_executed:,} the next one is late: the pulse distribution is "
                    "interrupted, and the axes stand still (9.2)"
                )
            )

    def _end_interruption(self, now: Nanos) -> None:
        if self._starving and self.due is not None:
            waited = self._waited + now - self.due
            self.interrupted += waited
            self.longest_interruption = max(self.longest_interruption, waited)
            self.due, self._starving, self._waited = now, False, 0

    def _move(self, record: bytes, now: Nanos) -> None:
        began = now if self.due is None else self.due
        for axis in range(self.layout.axis_count):
            self.position[axis] += self._travel(record[2 * axis], record[2 * axis + 1])
        self.records_executed += 1
        self.due = began + self.unit_time

    def _travel(self, high: int, low: int) -> int:
        if self.layout.format is RecordFormat.SPECIAL:
            value, sign = (high >> 1) << 7 | low >> 1, 1 << 13
        else:
            value, sign = high << 8 | low, 1 << 15
        return (value ^ sign) - sign

    def _leave(self) -> None:
        if self.active and self.interruptions > self._told:
            times = self.interruptions - self._told
            self._events.put(
                Notice(
                    text=f"G05: the pulse distribution was interrupted {times:,} time{'s' * (times != 1)}, so far for "
                    f"{self.interrupted / MILLISECOND:.1f} ms, at most {self.longest_interruption / MILLISECOND:.1f} ms"
                )
            )
            self._told = self.interruptions
        self.active, self.due, self._starving, self._rest, self._waited = False, None, False, None, 0

    def _stop(self, number: AlarmNumber, detail: str) -> None:
        self._leave()
        self.stopped = True
        self._events.put(Alarm(number=number, text=text_of(number, detail)))


def binary_operation(parameters: tuple[BinaryInput, DataCode] | None) -> BinaryOperation | None:
    """That of a control with these parameters and the code of its programs; None for a control without it."""
    if parameters is None or parameters[0].layout is None or parameters[1] is DataCode.BINARY:
        return None
    binary, code = parameters
    return BinaryOperation(binary, TABLES[code].to_ascii)
