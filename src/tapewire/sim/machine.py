"""The control behind the remote buffer: it takes the program out of the buffer and executes it block by block.

The buffer belongs to the CNC engine. What the control has taken but not executed sits in its own send buffer of 256
characters (B-63322EN-1 12.2).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Final

from tapewire.engine import SECOND, Alarm, CncEngine, Event, Events, Nanos, Sink
from tapewire.fanuc.alarms import text_of
from tapewire.protocols.settings import Switch
from tapewire.sim.binary_operation import BinaryOperation
from tapewire.sim.program_flow import After, ProgramFlow

__all__ = ["Control", "Motion", "Work"]

SEND_BUFFER: Final = 256
"""Characters the control takes ahead of what it executes (B-63322EN-1 12.2)."""


class Motion(Enum):
    """Whether blocks are executed."""

    RUNNING = "running"
    HELD = "feed hold"
    """In the middle of a block: the rest of it waits for CYCLE START."""
    STOPPED = "single block"
    """Between two blocks: the next one waits for CYCLE START."""
    PROGRAM_STOP = "program stop (M00, M01)"
    ENDED = "end of program (M02, M30)"
    """Another program is on the tape: it waits for CYCLE START."""


class Work(Enum):
    """What becomes of blocks that are taken."""

    EXECUTE = "executed, in DNC operation"
    STORE = "stored, when a program is read into the memory"


class Control:
    """Executes `blocks_per_second`, or as `block_time` says of each block; with neither it executes, or stores, as
    fast as the program comes in.

    `sink` gets the program as taken from the buffer, up to and including EOR. `eob` is the end of block of the code
    in use. An operator presses RESET, or the control goes to alarm, once `reset_after` or `alarm_after` bytes of
    program have been taken, or punched. With `binary` it executes the
    records of G05 sections, each in its unit time. With `single_block` it stops after each block until `go`. With
    `flow` it obeys M00, M01, M02 and M30, and goes to alarm at a block that it cannot execute.
    """

    def __init__(
        self,
        engine: CncEngine,
        sink: Sink,
        *,
        blocks_per_second: float | None = None,
        block_time: Callable[[bytes], Nanos] | None = None,
        eob: bytes = b"\n",
        reset_after: int | None = None,
        alarm_after: int | None = None,
        binary: BinaryOperation | None = None,
        single_block: bool = False,
        flow: ProgramFlow | None = None,
    ) -> None:
        self._engine = engine
        self.sink = sink
        if blocks_per_second is not None:
            each = round(SECOND / blocks_per_second)
            block_time = lambda block: each  # noqa: E731
        self._block_time = block_time
        self._eob = eob
        self._acts: list[tuple[int, Callable[[Nanos], None]]] = []
        if reset_after is not None:
            self.at(reset_after, self.reset)
        if alarm_after is not None:
            self.at(alarm_after, self.alarm)
        self.binary = binary
        self._send_buffer = bytearray()
        self._block_done: Nanos | None = None
        self._at_eob = 0
        """1 while what is executed ends with an EOB; an EOR is no block."""
        self._rest_of_block: Nanos = 0
        self.single_block = single_block
        """The operator's switch."""
        self.stops_among_records = Switch.OFF
        """Whether single block counts in binary input operation (2007#3, 9.3 note 3)."""
        self._stopped_behind = 0
        self.motion = Motion.RUNNING
        self.flow = flow
        self.work = Work.EXECUTE
        self._after = After.GO_ON
        self._events = Events()
        self.bytes_taken = 0
        self.blocks_executed = 0

    @property
    def idle(self) -> bool:
        """Nothing taken is left to execute."""
        moves = self._block_done is not None or self._rest_of_block or (self.binary and self.binary.active)
        return not moves and not self._send_buffer

    @property
    def moving(self) -> bool:
        """A block is under execution, or held in the middle."""
        return self._block_done is not None or self._rest_of_block > 0

    @property
    def bytes_begun(self) -> int:
        """Of what was taken, so much is executed or under execution."""
        return self.bytes_taken - len(self._send_buffer)

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
        event = self._events.get()
        return self.binary.next_event() if event is None and self.binary is not None else event

    # the operator

    def at(self, count: int, act: Callable[[Nanos], None]) -> None:
        """Have somebody act when `count` bytes of program have been taken, or punched, and no byte more is taken."""
        self._acts.append((count, act))

    def cycle_start(self, now: Nanos) -> None:
        """The control begins to read a program. Raises UsageError where it cannot."""
        self._engine.cycle_start(now)
        self._forget()

    def feed_hold(self, now: Nanos) -> None:
        """The axes stop where they are."""
        if self.motion is Motion.RUNNING and self._block_done is not None:
            self._rest_of_block = max(0, self._block_done - now)
            self._block_done = None
        if self.motion is Motion.RUNNING and self.binary is not None:
            self.binary.hold(now)
        self.motion = Motion.HELD

    def go(self, now: Nanos) -> None:
        """CYCLE START in the middle of a tape: go on after a hold, a stop or the end of a program."""
        if self._rest_of_block:
            self._block_done = now + self._rest_of_block
            self._rest_of_block = 0
        if self.binary is not None:
            self.binary.go(now)
        self.motion = Motion.RUNNING

    def reset(self, now: Nanos) -> None:
        """RESET: what was taken and not executed is lost (8.2)."""
        self._forget()
        self._engine.reset(now)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm by itself, and stops."""
        self._forget()
        self._engine.alarm(now)

    def _forget(self) -> None:
        self._send_buffer.clear()
        self._block_done = None
        self._rest_of_block = 0
        self.motion = Motion.RUNNING
        self._after = After.GO_ON
        if self.binary is not None and not self.binary.stopped:
            self.binary.reset()

    def _take(self, now: Nanos) -> int:
        room = SEND_BUFFER - len(self._send_buffer)
        for at, _ in self._acts:
            room = min(room, max(0, at - self.bytes_taken))
        data = self._engine.take(room, now) if room else b""
        if data:
            self.sink.write(data)
            self._send_buffer += data
            self.bytes_taken += len(data)
        if self._acts:
            self._act(now)
        return len(data)

    def _act(self, now: Nanos) -> None:
        for entry in [entry for entry in self._acts if entry[0] <= max(self.bytes_taken, self._engine.progress)]:
            self._acts.remove(entry)
            entry[1](now)

    def _execute(self, now: Nanos) -> bool:
        """One step of execution; True if it changed anything."""
        if self.motion is not Motion.RUNNING:
            return False
        if self.work is Work.STORE or self._executes_at_once:
            self.blocks_executed += self._send_buffer.count(self._eob)
            changed = bool(self._send_buffer)
            self._send_buffer.clear()
            return changed
        if self._block_done is not None:
            if self._block_done > now:
                return False
            self.blocks_executed += self._at_eob
            began, self._block_done = self._block_done, None
            if self._stops(now):
                return True
        else:
            began = now
        changed = self._begin_record(now) if self.binary and self.binary.active else self._begin_block(began)
        if self.binary is not None and self.binary.stopped:
            self.alarm(now)
            return False
        return changed or began != now

    @property
    def _executes_at_once(self) -> bool:
        return self._block_time is None and self.binary is None and not self.single_block and self.flow is None

    def _stops(self, now: Nanos) -> bool:
        """A block is done: does the control stop behind it?"""
        if self._after is After.STOP:
            self.motion, self._after = Motion.PROGRAM_STOP, After.GO_ON
        elif self.single_block:
            self.motion = Motion.STOPPED
        return self.motion is not Motion.RUNNING

    def _begin_record(self, now: Nanos) -> bool:
        binary = self.binary
        assert binary is not None
        is_done = binary.due is not None and binary.due <= now and binary.records_executed != self._stopped_behind
        if is_done and self.single_block and self.stops_among_records is Switch.ON:
            self._stopped_behind = binary.records_executed
            self.motion = Motion.STOPPED
            binary.hold(now)
            return True
        return binary.step(self._send_buffer, now)

    def _begin_block(self, began: Nanos) -> bool:
        """The next whole block, or what stands before the end of the program, starts to execute at `began`."""
        end = self._send_buffer.find(self._eob)
        if end < 0 and not self._engine.program_ended and len(self._send_buffer) < SEND_BUFFER:
            return False
        length = end + len(self._eob) if end >= 0 else len(self._send_buffer)
        if not length:
            return False
        block = bytes(self._send_buffer[:length])
        if self.flow is not None and not self._may_begin(block, self.flow, began):
            return False
        if self.binary is not None:
            self.binary.sees(block)
        del self._send_buffer[:length]
        self._at_eob = int(end >= 0)
        self._block_done = began + (self._block_time(block) if self._block_time is not None else 0)
        return True

    def _may_begin(self, block: bytes, flow: ProgramFlow, now: Nanos) -> bool:
        """Not behind the end of a program, when more than its EOR follows, and not what cannot be executed."""
        if self._after is After.END and not flow.is_blank(block):
            self.motion, self._after = Motion.ENDED, After.GO_ON
            return False
        judgement = flow.judge(block)
        if judgement.complaint is not None:
            number, what = judgement.complaint.number, judgement.complaint.what
            text = text_of(number, f"{what} (after {self.blocks_executed:,} blocks)")
            self._events.put(Alarm(number=number, text=text))
            self.alarm(now)
            return False
        if self._after is not After.END:
            self._after = judgement.after
        return True
