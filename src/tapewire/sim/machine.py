"""The control behind the remote buffer: it takes the program out of the buffer and executes it block by block.

The buffer belongs to the CNC engine. What the control has taken but not executed sits in its own send buffer of 256
characters (B-63322EN-1 12.2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tapewire.engine import SECOND, CncEngine, Event, Nanos, Sink
from tapewire.sim.binary_operation import BinaryOperation

__all__ = ["Control"]

SEND_BUFFER: Final = 256
"""Characters the control takes ahead of what it executes (B-63322EN-1 12.2)."""


class Control:
    """Executes `blocks_per_second`; None executes, or stores, as fast as the program comes in.

    `sink` gets the program as taken from the buffer, up to and including EOR. `eob` is the end of block of the code
    in use. An operator presses RESET, or the control goes to alarm, once `reset_after` or `alarm_after` bytes of
    program have been taken, or punched. With `binary` it executes the records of G05 sections, each in its unit time.
    """

    def __init__(
        self,
        engine: CncEngine,
        sink: Sink,
        *,
        blocks_per_second: float | None = None,
        eob: bytes = b"\n",
        reset_after: int | None = None,
        alarm_after: int | None = None,
        binary: BinaryOperation | None = None,
    ) -> None:
        self._engine = engine
        self._sink = sink
        self._block_time: Nanos | None = None if blocks_per_second is None else round(SECOND / blocks_per_second)
        self._eob = eob
        self._acts: list[tuple[int, Callable[[Nanos], None]]] = []
        if reset_after is not None:
            self._acts.append((reset_after, engine.reset))
        if alarm_after is not None:
            self._acts.append((alarm_after, engine.alarm))
        self.binary = binary
        self._send_buffer = bytearray()
        self._block_done: Nanos | None = None
        self.bytes_taken = 0
        self.blocks_executed = 0

    @property
    def idle(self) -> bool:
        """Nothing taken is left to execute."""
        return self._block_done is None and not self._send_buffer and not (self.binary and self.binary.active)

    def step(self, now: Nanos) -> None:
        if self.binary is not None and self.binary.stopped:
            if self._engine.progress:
                return
            self.binary.reset()
        while self._take(now) or self._execute(now):
            pass

    def next_deadline(self) -> Nanos | None:
        if self._block_done is None and self.binary is not None:
            return self.binary.next_deadline()
        return self._block_done

    def next_event(self) -> Event | None:
        return None if self.binary is None else self.binary.next_event()

    def _take(self, now: Nanos) -> int:
        room = SEND_BUFFER - len(self._send_buffer)
        for at, _ in self._acts:
            room = min(room, max(0, at - self.bytes_taken))
        data = self._engine.take(room, now) if room else b""
        self._sink.write(data)
        self._send_buffer += data
        self.bytes_taken += len(data)
        self._act(now)
        return len(data)

    def _act(self, now: Nanos) -> None:
        for entry in [entry for entry in self._acts if entry[0] <= max(self.bytes_taken, self._engine.progress)]:
            self._acts.remove(entry)
            self._forget()
            if self.binary is not None:
                self.binary.reset()
            entry[1](now)

    def _forget(self) -> None:
        self._send_buffer.clear()
        self._block_done = None

    def _execute(self, now: Nanos) -> bool:
        """One step of execution; True if it changed anything."""
        if self._block_time is None and self.binary is None:
            self.blocks_executed += self._send_buffer.count(self._eob)
            changed = bool(self._send_buffer)
            self._send_buffer.clear()
            return changed
        if self._block_done is not None:
            if self._block_done > now:
                return False
            self.blocks_executed += 1
            began, self._block_done = self._block_done, None
        else:
            began = now
        changed = self._begin_record(now) if self.binary and self.binary.active else self._begin_block(began)
        if self.binary is not None and self.binary.stopped:
            self._forget()
            self._engine.alarm(now)
            return False
        return changed or began != now

    def _begin_record(self, now: Nanos) -> bool:
        assert self.binary is not None
        return self.binary.step(self._send_buffer, now)

    def _begin_block(self, began: Nanos) -> bool:
        """The next whole block, or what stands before the end of the program, starts to execute at `began`."""
        end = self._send_buffer.find(self._eob)
        if end < 0 and not self._engine.program_ended and len(self._send_buffer) < SEND_BUFFER:
            return False
        length = end + len(self._eob) if end >= 0 else len(self._send_buffer)
        if not length:
            return False
        if self.binary is not None:
            self.binary.sees(bytes(self._send_buffer[:length]))
        del self._send_buffer[:length]
        self._block_done = began + (self._block_time or 0)
        return True
