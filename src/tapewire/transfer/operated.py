"""A simulated control under the hands of its operator: one operation after another, on a line that comes and goes.

`run_control` is one operation and its line. Here the line is kept until one side lets it go, and is opened again then;
the keys of the control are methods.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
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
    Violation,
)
from tapewire.errors import LineError, UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.parameter_check import ParameterMemory, Weight, check
from tapewire.fanuc.parameters import ParameterSet, PowerRule
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.faults.plan import FaultPlan
from tapewire.line.link import Link
from tapewire.line.open import TtyAddress, open_line
from tapewire.line.pacing import default_window
from tapewire.line.transport import Transport
from tapewire.protocols.settings import Switch
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.machine import Control, Motion
from tapewire.sim.nc import Ground, Nc, Operation
from tapewire.transfer.capturing import JobCapture
from tapewire.transfer.control import STOP_CHARACTERS, Taken, block_time_for, board_of, faulty, flow_for
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report
from tapewire.transfer.session import JobSettings, undo
from tapewire.transfer.tape_window import TapeWindow

__all__ = ["OperatedControl", "OperatedTask", "Plug", "RunState"]

REOPEN_PAUSE_S: Final = 1.0
"""A line that could not be opened again is tried again so long after."""

MOST_MESSAGES: Final = 50


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
    the protocol's parameters for reading into the memory, None for those of the job. `parameters` None: nobody has told
    them; else `job_of` makes the job of a control with these in force, and raises UsageError where there is none."""

    blocks_per_second: float | None = None
    feed_override: float | None = None
    punch: Program | None = None
    taken: Taken | None = None
    faults: FaultPlan | None = None
    fault_seed: int = 0
    parameters: ParameterSet | None = None
    job_of: Callable[[ParameterSet], JobSettings] | None = None
    read_params: Any = None
    block_check: Switch = Switch.OFF


class OperatedControl:
    """Runs by `run`; the keys may be pressed at any time, from the same loop."""

    def __init__(self, task: OperatedTask, job: JobSettings) -> None:
        self.task = task
        self.job = job.observed_by(self._report, job.stop)
        self.plug = Plug.IN
        self.messages: deque[str] = deque(maxlen=MOST_MESSAGES)
        fitted = None if task.parameters is None else task.parameters.interface
        self.parameters = None if task.parameters is None else ParameterMemory(task.parameters, fitted)
        self.nc = Nc(self.parameters, fitted, tell=self._report)
        self.ground = Ground.FOREGROUND
        """Where READ and PUNCH run."""
        self.last: Ended | None = None
        """How the last operation ended."""
        self.held = ""
        """Why the host makes a punch-out wait; empty while it does not."""
        self.ready = ""
        """The line, as the host may name it."""
        self.link: Link | None = None
        self._driver: LineDriver | None = None
        self._turned = asyncio.Event()
        self._leaving = False
        self._next_job: JobSettings | None = None
        if task.taken is not None:
            task.taken.on_error = self._not_stored
        self._power_on(job.params)

    # what it is

    @property
    def alarms(self) -> list[Alarm]:
        """What is on the screen, until RESET."""
        return self.nc.alarms

    @property
    def operation(self) -> Operation:
        return self.nc.operation

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
        is_over = self.operation is Operation.NONE and not self.alarms
        return is_stored and is_over and self.last is not None and self.last.outcome is Outcome.COMPLETE

    def _power_on(self, params: Any) -> None:
        """A new engine, and the control behind it."""
        self._params = params
        self.code = getattr(params, "data", DataCode.ASCII)
        self.text = self.job.protocol.text(params)
        self.tape = TapeWindow(self.text.eob, 0)
        self.cnc: CncEngine = self.job.protocol.cnc(params)
        binary = self.job.protocol.binary_input(params)
        self.control = Control(
            self.cnc,
            self,
            blocks_per_second=self.task.blocks_per_second,
            block_time=block_time_for(params, self.task.feed_override),
            eob=self.text.eob,
            binary=binary_operation(binary) if binary is not None else None,
            flow=flow_for(params, self.task.block_check),
        )
        self.board = board_of(self.cnc)
        self.nc.connect(self.cnc, self.control, self.board, params)

    # the line

    async def run(self) -> None:
        """Until `leave`. Raises LineError and UsageError where the line cannot be opened the first time."""
        capture = JobCapture(self.job.capture, self.job.origin, self._report)
        opened = False
        try:
            while not self._leaving:
                self._turned.clear()
                capture = await self._renewed(capture)
                if self.plug is Plug.OUT:
                    await self._turned.wait()
                    continue
                try:
                    line = await self._open()
                except LineError as error:
                    if not opened:
                        raise
                    self.say(f"the line cannot be opened: {error}")
                    await self._pause()
                    continue
                if line is not None:
                    opened = True
                    await self._serve(capture.tap(line))
                    capture.tell()
        finally:
            await capture.close(failed=not self.complete)

    async def _renewed(self, capture: JobCapture) -> JobCapture:
        """With the parameters that have come into force meanwhile. Another protocol or rate is another capture."""
        job, self._next_job = self._next_job, None
        if job is None:
            return capture
        old, self.job = self.job, job
        self._power_on(job.params)
        if job.capture is None or job.origin == old.origin:
            return capture
        await capture.close(failed=self.last is not None and self.last.outcome is not Outcome.COMPLETE)
        return JobCapture(job.capture, job.origin, self._report)

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
                on_note=self.say,
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
            await self._driver.run(lambda: link.closed or self._done_with_line)
        finally:
            transport.close(monotonic())
        link.closed = True
        self.link = None
        await self._driver.run(lambda: self.operation is Operation.NONE or bool(self.alarms) or self._leaving)
        self._power_on(self.job.params)

    @property
    def _done_with_line(self) -> bool:
        return (self._leaving and not self.nc.communicating) or (
            self._next_job is not None and self.operation is Operation.NONE
        )

    def attach(self, transport: Transport) -> Link:
        """Put the control on a line that is open. Whoever steps the link runs the control."""
        self.link = Link(
            self.cnc,
            transport,
            application=self.nc,
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
            self.nc.cycle_start(now)
            self._wake()
        else:
            self._begin(Operation.DNC, self.nc.cycle_start, now)

    def read(self, now: Nanos) -> None:
        """Read a tape into the memory."""
        self._begin(Operation.READ, lambda now: self.nc.read(now, self.ground), now)

    def punch(self, now: Nanos) -> None:
        """Punch the program that was given, or all that is in the memory."""
        self._begin(Operation.PUNCH, self._punch, now)

    def punch_parameters(self, now: Nanos) -> None:
        self._begin(Operation.PUNCH, lambda now: self.nc.punch_parameters(now, self.ground), now)

    def feed_hold(self, now: Nanos) -> None:
        self.nc.feed_hold(now)
        self._wake()

    def reset(self, now: Nanos) -> None:
        """RESET: ends the operation and clears the alarms; what was taken and not executed is lost (8.2)."""
        self.nc.reset(now)
        self.tape = TapeWindow(self.text.eob, self.control.bytes_taken)
        self._wake()

    def stop(self, now: Nanos) -> None:
        """The soft key STOP (6.4 note 2)."""
        self.nc.stop(now)
        self._wake()

    def turn_ground(self) -> None:
        self.ground = Ground.FOREGROUND if self.ground is Ground.BACKGROUND else Ground.BACKGROUND

    def turn_single_block(self) -> None:
        self.nc.turn_single_block(self.nc.single_block.other)

    def turn_optional_stop(self) -> None:
        self.nc.turn_optional_stop(self.nc.optional_stop.other)

    def enter(self, number: int, value: int) -> None:
        """The operator enters a parameter; when it takes effect is told."""
        if self.parameters is None:
            self.say("there are no parameters: --parameters FILE gives them")
            return
        try:
            rule = self.parameters.enter(number, value)
        except UsageError as error:
            self.say(str(error))
            return
        when = "at once" if rule is PowerRule.AT_ONCE else "after power off and on"
        self.say(f"No. {number:04d} takes effect {when}")
        self._renew(self.parameters.in_force)

    def power_off_and_on(self, now: Nanos) -> None:
        """The operation is gone, what was entered is in force; the memory of the control keeps its programs."""
        self.nc.alarms.clear()
        self.nc.give_up(now)
        self.say("power off and on")
        if self.parameters is not None:
            self.parameters.power_off_and_on()
            self._renew(self.parameters.in_force)
        self._next_job = self._next_job or self.job
        if self.link is not None and not self.link.closed:
            self.link.closed = True
            self.cnc.receive_closed(Closure.LOST, "the control was switched off", now)
        self._turned.set()
        self._wake()

    def _renew(self, in_force: ParameterSet) -> None:
        """The line becomes that of these parameters once nothing is under way. Bad ones leave it, and are SR807."""
        if self.task.job_of is None:
            return
        try:
            job = self.task.job_of(in_force)
        except UsageError as error:
            if Weight.ALARM not in {finding.weight for finding in check(in_force, in_force.interface)}:
                self.say(str(error))
            return
        is_other = job.origin != self.job.origin
        self._next_job = job.observed_by(self._report, self.job.stop) if is_other else None
        if is_other:
            self._turned.set()
            self._wake()

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
        if self.operation is not Operation.NONE:
            self.nc.give_up(now)
            self.last = Ended(outcome=Outcome.CANCELLED, reason="given up here", bytes_low=0, bytes_high=0)
        self._leaving = True
        self._turned.set()
        self._wake()

    def _begin(self, operation: Operation, begin: Callable[[Nanos], None], now: Nanos) -> None:
        try:
            ground = Ground.FOREGROUND if operation is Operation.DNC else self.ground
            if not self.nc.may_begin(operation, ground, now) or not self._has_line(operation):
                return
            self._set_up_for(operation, now)
            begin(now)
        except UsageError as error:
            self.say(str(error))
            return
        self.last = None
        self.tape = TapeWindow(self.text.eob, self.control.bytes_taken)
        self._wake()

    def _has_line(self, operation: Operation) -> bool:
        """Raises UsageError for what no line carries."""
        if operation is Operation.PUNCH and not self.job.protocol.punches_out:
            raise UsageError(f"{self.job.protocol.name} has no punch-out")
        if self.link is not None and not self.link.closed:
            return True
        if self.board is not None:
            self.nc.show(Alarm(number=AlarmNumber.SR855, text=text_of(AlarmNumber.SR855, "there is no host")))
        self.say("there is nobody on the line")
        return False

    def _set_up_for(self, operation: Operation, now: Nanos) -> None:
        """A control with program numbers asks in another way for what it keeps."""
        other = self.task.read_params if operation is Operation.READ else None
        params = self.job.params if other is None else other
        if params is self._params:
            return
        assert self.link is not None
        self._power_on(params)
        self.link.engine = self.cnc
        if self.link.signals_in is not None:
            self.cnc.receive_signals(self.link.signals_in, now)

    def _punch(self, now: Nanos) -> None:
        if self.task.punch is not None:
            self.task.punch.rewind()
            self.nc.punch(self.task.punch, now, self.ground)
        elif self.board is None:
            raise UsageError("there is nothing to punch: --file names a program")
        else:
            self.nc.punch_programs(now, ground=self.ground)

    # what becomes of it

    def write(self, data: bytes) -> object:
        """What the control takes out of the buffer."""
        self.tape.write(data)
        if self.task.taken is not None:
            self.task.taken.write(data)
        return None

    def _written(self, data: bytes) -> None:
        if self.board is not None:
            self.board.said(data)

    def _heard(self, event: Event, now: Nanos) -> None:
        if self.board is not None:
            self.board.heard(event)
        self.nc.heard(event, now)
        match event:
            case Held(why=why):
                self.held = why
            case Resumed():
                self.held = ""
            case Ended():
                self._ended(event)
            case _:
                self._report(event, now)

    def _ended(self, event: Ended) -> None:
        self.held, self.last = "", event
        self.say(f"{self.nc.selected.name.lower()} {event.outcome}: {event.bytes_low:,} bytes; {event.reason}")

    def _report(self, report: Report, now: Nanos) -> None:
        match report:
            case Ready(line=line):
                self.ready = line
            case Notice(text=text):
                self.say(text)
            case Violation(what=what):
                self.say(what)
            case Requested(number=number) if number is not None:
                self.say(f"asked for program {number}")
            case AfterStop(count=count, allowed=allowed) if count > allowed:
                self.say(f"{count} characters after the stop, {allowed} are allowed")
            case _:
                pass

    def _not_stored(self) -> None:
        assert self.task.taken is not None
        self.say(self.task.taken.error)

    def say(self, text: str) -> None:
        """Tell the operator."""
        self.messages.append(text)
