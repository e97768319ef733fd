"""A simulated control under the hands of its operator: one operation after another, on a line that comes and goes.

`run_control` is one operation and its line. Here the line is kept until one side lets it go, and is opened again then;
the keys of the control are methods.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any, Final

from tapewire.codes import DataCode
from tapewire.engine import (
    AfterStop,
    Alarm,
    Closure,
    CncEngine,
    Ended,
    Event,
    Held,
    Nanos,
    Notice,
    Outcome,
    Requested,
    Resumed,
    Source,
    Violation,
)
from tapewire.errors import LineError, UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.conversion import EobForm
from tapewire.fanuc.memory import BufferImage
from tapewire.fanuc.parameters import ParameterSet
from tapewire.fanuc.program_memory import ProgramMemory, PunchForm, punch_form, tape_of
from tapewire.fanuc.punch import PunchReader
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.faults.plan import FaultPlan
from tapewire.line.link import Link
from tapewire.line.open import TtyAddress, open_line
from tapewire.line.pacing import default_window
from tapewire.line.transport import Transport
from tapewire.protocols.settings import Switch
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.board import Board, Request
from tapewire.sim.machine import Control, Motion, Work
from tapewire.sim.program_flow import ProgramFlow
from tapewire.transfer.capturing import JobCapture
from tapewire.transfer.control import STOP_CHARACTERS, Operation, Taken, faulty
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report
from tapewire.transfer.session import JobSettings, undo
from tapewire.transfer.tape_window import TapeWindow

__all__ = ["OperatedControl", "OperatedTask", "Plug", "RunState"]

REOPEN_PAUSE_S: Final = 1.0
"""A line that could not be opened again is tried again so long after."""

MEMORY_BYTES: Final = 4 << 20
"""A longer tape is not registered."""

MOST_MESSAGES: Final = 50
MOST_ALARMS: Final = 20


class RunState(StrEnum):
    """Automatic operation, as the controls print it."""

    RESET = "****"
    STOP = "STOP"
    HOLD = "HOLD"
    START = "STRT"


class Plug(Enum):
    """The cable at the control."""

    IN = "plugged in"
    OUT = "unplugged"


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatedTask:
    """What the control is made of. `punch` is a program it punches, None for what is in its memory. `read_params` are
    the protocol's parameters for reading into the memory, None for those of the job."""

    blocks_per_second: float
    punch: Program | None = None
    taken: Taken | None = None
    faults: FaultPlan | None = None
    fault_seed: int = 0
    parameters: ParameterSet | None = None
    read_params: Any = None


class OperatedControl:
    """Runs by `run`; the keys may be pressed at any time, from the same loop."""

    def __init__(self, task: OperatedTask, job: JobSettings) -> None:
        self.task = task
        self.job = job.observed_by(self._report, job.stop)
        self.plug = Plug.IN
        self.alarms: deque[Alarm] = deque(maxlen=MOST_ALARMS)
        self.messages: deque[str] = deque(maxlen=MOST_MESSAGES)
        self.memory = ProgramMemory()
        self.single_block = Switch.OFF
        self.optional_stop = Switch.OFF
        self.selected = Operation.DNC
        """The operation under way, or the last one."""
        self.last: Ended | None = None
        """How it ended."""
        self.held = ""
        """Why the host makes a punch-out wait; empty while it does not."""
        self.ready = ""
        """The line, as the host may name it."""
        self.link: Link | None = None
        self._driver: LineDriver | None = None
        self._turned = asyncio.Event()
        self._leaving = False
        self._communicating = False
        self._reading: bytearray | None = None
        if task.taken is not None:
            task.taken.on_error = self._not_stored
        self.code = getattr(job.params, "data", DataCode.ASCII)
        self.text = job.protocol.text(job.params)
        self.tape = TapeWindow(self.text.eob, 0)
        self._params = job.params
        self._power_on(job.params)

    # what it is

    @property
    def operation(self) -> Operation | None:
        """DNC operation goes on until what was taken has been executed, though the communication is over."""
        executing = self.selected is Operation.DNC and not self.control.idle
        return self.selected if self._communicating or executing else None

    @property
    def state(self) -> RunState:
        if self.operation is not Operation.DNC:
            return RunState.RESET
        match self.control.motion:
            case Motion.RUNNING:
                return RunState.START
            case Motion.HELD:
                return RunState.HOLD
            case _:
                return RunState.STOP

    @property
    def stands(self) -> str:
        """Why it stands still; empty while it does not."""
        held = self.operation is Operation.DNC and self.control.motion is not Motion.RUNNING
        return self.control.motion.value if held and not self.alarms else ""

    @property
    def complete(self) -> bool:
        """The last operation was, and nothing is under way."""
        is_stored = self.task.taken is None or not self.task.taken.error
        return is_stored and self.operation is None and self.last is not None and self.last.outcome is Outcome.COMPLETE

    def _power_on(self, params: Any) -> None:
        self._params = params
        self.cnc: CncEngine = self.job.protocol.cnc(params)
        binary = self.job.protocol.binary_input(params)
        self._flow = ProgramFlow(self.code)
        self._flow.optional_stop = self.optional_stop
        self.control = Control(
            self.cnc,
            self,
            blocks_per_second=self.task.blocks_per_second,
            eob=self.text.eob,
            binary=binary_operation(binary) if binary is not None else None,
            single_block=self.single_block is Switch.ON,
            flow=self._flow,
        )
        has_board = isinstance(getattr(self.cnc, "buffer", None), BufferImage)
        self.board = Board(self.cnc) if has_board else None  # type: ignore[arg-type]

    # the line

    async def run(self) -> None:
        """Until `leave`. Raises LineError and UsageError where the line cannot be opened the first time."""
        capture = JobCapture(self.job.capture, self.job.origin, self._report)
        opened = False
        try:
            while not self._leaving:
                self._turned.clear()
                if self.plug is Plug.OUT:
                    await self._turned.wait()
                    continue
                try:
                    line = await self._open()
                except LineError as error:
                    if not opened:
                        raise
                    self._say(f"the line cannot be opened: {error}")
                    await self._pause()
                    continue
                if line is not None:
                    opened = True
                    await self._serve(capture.tap(line))
                    capture.tell()
        finally:
            await capture.close(failed=not self.complete)

    async def _open(self) -> Transport | None:
        """None when the operator had enough of waiting."""
        tolerated = STOP_CHARACTERS if isinstance(self.job.line, TtyAddress) else self.job.protocol.sends_on
        opening = asyncio.ensure_future(
            open_line(
                self.job.line,
                baud=self.job.baud,
                stopbits=self.job.stopbits,
                data_bits=self.job.data_bits,
                window=default_window(self.job.baud, tolerated),
                paced_reception=True,
                on_ready=lambda line: self._report(Ready(line=line), monotonic()),
                on_note=self._say,
            )
        )
        turned = asyncio.ensure_future(self._turned.wait())
        try:
            await asyncio.wait([opening, turned], return_when=asyncio.FIRST_COMPLETED)
            return opening.result() if opening.done() else None
        finally:
            turned.cancel()
            if not opening.done():
                await undo(opening)

    async def _pause(self) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(self._turned.wait(), REOPEN_PAUSE_S)

    async def _serve(self, line: Transport) -> None:
        """Until the line is gone, and what was taken has been executed."""
        plan = self.task.faults
        transport = line if plan is None else faulty(plan, self.task.fault_seed, self.job, line)
        try:
            link = self.attach(transport)
            self._driver = LineDriver(link)
            await self._driver.run(lambda: link.closed or (self._leaving and not self._communicating))
        finally:
            transport.close(monotonic())
        link.closed = True
        self.link = None
        await self._driver.run(lambda: self.operation is None or bool(self.alarms) or self._leaving)
        self._power_on(self.job.params)

    def attach(self, transport: Transport) -> Link:
        """Put the control on a line that is open. Whoever steps the link runs the control."""
        self.link = Link(
            self.cnc,
            transport,
            application=self.control,
            on_event=self._heard,
            on_write=self._written,
        )
        return self.link

    def _wake(self) -> None:
        if self._driver is not None:
            self._driver.wake()

    # the keys

    def cycle_start(self, now: Nanos) -> None:
        """Go on where the control stands still, or begin DNC operation."""
        if self.operation is Operation.DNC and not self.alarms:
            self.control.go(now)
            self._wake()
        else:
            self._begin(Operation.DNC, now)

    def read(self, now: Nanos) -> None:
        """Read a tape into the memory."""
        self._begin(Operation.READ, now)

    def punch(self, now: Nanos) -> None:
        """Punch the program that was given, or all that is in the memory."""
        self._begin(Operation.PUNCH, now)

    def feed_hold(self, now: Nanos) -> None:
        if self.operation is Operation.DNC:
            self.control.feed_hold(now)
            self._wake()

    def reset(self, now: Nanos) -> None:
        """RESET: ends the operation and clears the alarms; what was taken and not executed is lost (8.2)."""
        self.control.reset(now)
        if self.board is not None:
            self.board.asked(Request.RESET)
        self.alarms.clear()
        self.tape = TapeWindow(self.text.eob, self.control.bytes_taken)
        self._wake()

    def turn_single_block(self) -> None:
        self.single_block = Switch.OFF if self.single_block is Switch.ON else Switch.ON
        self.control.single_block = self.single_block is Switch.ON

    def turn_optional_stop(self) -> None:
        self.optional_stop = Switch.OFF if self.optional_stop is Switch.ON else Switch.ON
        self._flow.optional_stop = self.optional_stop

    def turn_plug(self, now: Nanos) -> None:
        """Unplug the cable, or plug it in. The host sees the line end, the control sees it lost."""
        if self.plug is Plug.IN:
            self.plug = Plug.OUT
            if self.link is not None and not self.link.closed:
                self.link.closed = True
                self.cnc.receive_closed(Closure.LOST, "the cable was unplugged here", now)
        else:
            self.plug = Plug.IN
        self._turned.set()
        self._wake()

    def leave(self, now: Nanos) -> None:
        """`run` returns soon; what is under way is given up as by RESET."""
        if self.operation is not None:
            self.reset(now)
            self.last = Ended(outcome=Outcome.CANCELLED, reason="given up here", bytes_low=0, bytes_high=0)
        self._leaving = True
        self._turned.set()
        self._wake()

    def _begin(self, operation: Operation, now: Nanos) -> None:
        why_not = self._refusal(operation)
        if why_not:
            self._say(why_not)
            return
        try:
            self._set_up_for(operation, now)
            if operation is Operation.PUNCH:
                self.cnc.punch(self._source(), now)
            else:
                self.control.cycle_start(now)
        except UsageError as error:
            self._say(str(error))
            return
        self.control.work = Work.EXECUTE if operation is Operation.DNC else Work.STORE
        self.selected, self._communicating, self.last = operation, True, None
        self._reading = bytearray() if operation is Operation.READ and self.board is not None else None
        self.tape = TapeWindow(self.text.eob, self.control.bytes_taken)
        if self.board is not None:
            self.board.asked(Request.PUNCH if operation is Operation.PUNCH else Request.READ)
        self._wake()

    def _refusal(self, operation: Operation) -> str:
        """Why it cannot begin; empty where it can."""
        if self.alarms:
            return "an alarm is on: RESET first"
        if self.operation is not None:
            return f"{self.operation.value} is under way: wait for its end, or RESET"
        if operation is Operation.PUNCH and not self.job.protocol.punches_out:
            return f"{self.job.protocol.name} has no punch-out"
        if self.link is not None and not self.link.closed:
            return ""
        if self.board is not None:
            self.alarms.append(Alarm(number=AlarmNumber.SR855, text=text_of(AlarmNumber.SR855, "there is no host")))
        return "there is nobody on the line"

    def _set_up_for(self, operation: Operation, now: Nanos) -> None:
        """A control with program numbers asks in another way for what it keeps."""
        other = self.task.read_params if operation is Operation.READ else None
        params = self.job.params if other is None else other
        if params is self._params:
            return
        assert self.link is not None
        self._power_on(params)
        self.link.engine, self.link.application = self.cnc, self.control
        if self.link.signals_in is not None:
            self.cnc.receive_signals(self.link.signals_in, now)

    def _source(self) -> Source:
        if self.task.punch is not None:
            self.task.punch.rewind()
            return self.task.punch
        if self.board is None:
            raise UsageError("there is nothing to punch: --file names a program")
        told = self.task.parameters
        form = PunchForm(code=self.code, eob=EobForm.LF, feed=0) if told is None else punch_form(told)
        return _Tape(tape_of(self.memory.text(), form))

    # what becomes of it

    def write(self, data: bytes) -> object:
        """What the control takes out of the buffer."""
        self.tape.write(data)
        if self.task.taken is not None:
            self.task.taken.write(data)
        if self._reading is not None and len(self._reading) <= MEMORY_BYTES:
            self._reading += data
        return None

    def _written(self, data: bytes) -> None:
        if self.board is not None:
            self.board.said(data)

    def _heard(self, event: Event, now: Nanos) -> None:
        if self.board is not None:
            self.board.heard(event)
        match event:
            case Alarm():
                self.alarms.append(event)
                self.control.feed_hold(now)
            case Held(why=why):
                self.held = why
            case Resumed():
                self.held = ""
            case Ended():
                self._ended(event)
            case _:
                self._report(event, now)

    def _ended(self, event: Ended) -> None:
        self._communicating, self.held = False, ""
        if event.outcome is Outcome.COMPLETE and self._reading is not None:
            self._register(bytes(self._reading))
        self._reading = None
        self.last = event
        self._say(f"{self.selected.value} {event.outcome}: {event.bytes_low:,} bytes; {event.reason}")

    def _register(self, tape: bytes) -> None:
        if len(tape) > MEMORY_BYTES:
            self._say(f"not registered: a tape of more than {MEMORY_BYTES:,} bytes")
            return
        text = bytearray()
        reader = PunchReader(self.code, text.extend)
        reader.feed(tape)
        if damage := reader.finish():
            self._say(f"not registered: {damage[0]}")
            return
        done = self.memory.read(bytes(text))
        for refused in done.refused:
            self._say(f"not registered: {refused}")
        if done.registered:
            self._say("registered " + ", ".join(f"O{number:04d}" for number in done.registered))
        if done.alarm is not None:
            self.alarms.append(Alarm(number=done.alarm, text=text_of(done.alarm, "; ".join(done.refused))))

    def _report(self, report: Report, now: Nanos) -> None:
        match report:
            case Ready(line=line):
                self.ready = line
            case Notice(text=text):
                self._say(text)
            case Violation(what=what):
                self._say(what)
            case Requested(number=number) if number is not None:
                self._say(f"asked for program {number}")
            case AfterStop(count=count, allowed=allowed) if count > allowed:
                self._say(f"{count} characters after the stop, {allowed} are allowed")
            case _:
                pass

    def _not_stored(self) -> None:
        assert self.task.taken is not None
        self._say(self.task.taken.error)

    def _say(self, text: str) -> None:
        self.messages.append(text)


class _Tape:
    """What is punched out of the memory."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def read(self, size: int) -> bytes:
        piece = self._data[self._at : self._at + size]
        self._at += len(piece)
        return piece
