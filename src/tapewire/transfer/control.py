"""Be a simulated control on a line."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

from tapewire.codes import DataCode
from tapewire.engine import Alarm, CncEngine, Nanos, Notice, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.block_check import BlockCheck
from tapewire.fanuc.memory import BufferImage
from tapewire.fanuc.parameter_check import ParameterMemory
from tapewire.fanuc.parameters import ParameterSet
from tapewire.line.driver import monotonic
from tapewire.line.faults.chance import derive
from tapewire.line.faults.damage import Parity
from tapewire.line.faults.injector import injectors
from tapewire.line.faults.plan import FaultPlan, LineEnd
from tapewire.line.faulty import FaultyTransport, made_on_a_line
from tapewire.line.open import TtyAddress
from tapewire.line.pacing import character_time
from tapewire.line.transport import Transport
from tapewire.protocols.settings import Switch
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.board import Board, BufferedEngine
from tapewire.sim.execution import BlockTime, Speeds
from tapewire.sim.machine import Control
from tapewire.sim.nc import Ground, Nc
from tapewire.sim.nc import Operation as NcOperation
from tapewire.sim.operator import Key, Operator, Press
from tapewire.sim.program_flow import ProgramFlow
from tapewire.transfer.files import StoredFile, open_save, why
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, Session

__all__ = [
    "STOP_CHARACTERS",
    "ControlTask",
    "Operation",
    "Taken",
    "block_time_for",
    "board_of",
    "faulty",
    "flow_for",
    "run_control",
]


class Operation(StrEnum):
    """What the operator of the simulated control does."""

    DNC = "dnc"
    """Execute a program as it comes in."""
    READ = "read"
    """Read a program into memory."""
    PUNCH = "punch"
    """Punch a program out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlTask:
    """What the simulated control does on its line.

    `punch` is the program it punches; without one it punches its `parameters`. `save` is where it stores what it took,
    and a control that takes nothing leaves that file as it is. `blocks_per_second` None means as fast as the program
    comes, unless `feed_override` is the share of the feed at which blocks take what their length and feed say.
    `presses` are the keys of its operator; `reset_after` and `alarm_after` bytes of program he presses RESET, or the
    control goes to alarm. Where it stops by itself (M00, M01, single block, end of a program) CYCLE START comes `stand`
    later. With `block_check` a block that it cannot execute is PS10 to PS12. `faults` happen on its line, drawn from
    `fault_seed`: the same seed on the same dialogue gives the same faults.
    """

    operation: Operation = Operation.DNC
    ground: Ground = Ground.FOREGROUND
    parameters: ParameterSet | None = None
    punch: Program | None = None
    save: Path | None = None
    blocks_per_second: float | None = None
    feed_override: float | None = None
    presses: tuple[Press, ...] = ()
    reset_after: int | None = None
    alarm_after: int | None = None
    stand: Nanos = 0
    block_check: Switch = Switch.OFF
    faults: FaultPlan | None = None
    fault_seed: int = 0

    def __post_init__(self) -> None:
        punches = self.operation is Operation.PUNCH
        if punches and self.punch is None and self.parameters is None:
            raise UsageError("a control that punches needs the program to punch, or its parameters")
        if self.punch is not None and not punches:
            raise UsageError("a control that punches needs the program to punch, and only then")
        if punches and self.save is not None:
            raise UsageError("a control that punches takes nothing that could be saved")
        if self.operation is Operation.DNC and self.ground is Ground.BACKGROUND:
            raise UsageError("DNC operation runs in the foreground: the background reads and punches")
        if self.faults is not None and self.faults.faults:
            made, missing = made_on_a_line(self.faults, LineEnd.CONTROL)
            if not made.faults:
                raise UsageError(f"nothing of {self.faults.name} can be made on a real line: {'; '.join(missing)}")

    @property
    def all_presses(self) -> tuple[Press, ...]:
        """With those of `reset_after` and `alarm_after`."""
        more = ((Key.RESET, self.reset_after), (Key.ALARM, self.alarm_after))
        return (*self.presses, *(Press(key=key, count=count) for key, count in more if count is not None))


class Taken:
    """What the control took: counted, hashed, and stored where the operator wants it.

    A file that exists is left alone until there is a first byte to put into it.
    """

    def __init__(self, path: Path | None) -> None:
        self.digest = hashlib.sha256()
        self.error = ""
        """Why it could not be stored; empty while it could."""
        self.on_error: Callable[[], object] = lambda: None
        self._file = open_save(path) if path is not None else None

    def write(self, data: bytes) -> None:
        self.digest.update(data)
        if data and self._file is not None and not self.error:
            try:
                self._store(self._file, data)
            except OSError as error:
                self.error = f"{self._file.path}: cannot be stored ({why(error)})"
                self.on_error()

    @staticmethod
    def _store(file: StoredFile, data: bytes) -> None:
        if not file.byte_count:
            file.begin()
        file.write(data)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


STOP_CHARACTERS: Final = 3
"""A control stops its punch-out within two characters of CS OFF (6.1.1 2) (3) (a)): so many may be in flight."""


def _details(cnc: CncEngine, control: Control) -> dict[str, int]:
    """What goes out with the progress of a control."""
    details: dict[str, int] = {"buffered": cnc.buffered, "blocks": control.blocks_executed}
    if control.binary is not None and control.binary.records_executed:
        details["records"] = control.binary.records_executed
        details["interruptions"] = control.binary.interruptions
    return details


def faulty(plan: FaultPlan, seed: int, job: JobSettings, line: Transport) -> Transport:
    """`line` as `plan` has it; each fault is told as it happens, and so is what no plan can do to a real line."""
    made, missing = made_on_a_line(plan, LineEnd.CONTROL)

    def tell(text: str) -> None:
        job.observer(Notice(text=text), monotonic())

    tell(f"faults on this line: {plan.name}, {plan.why}; repeat them with --fault-seed {seed}")
    for what in missing:
        tell(f"not made here: {what}")
    character = character_time(job.baud)
    parity = Parity.CHECKED if job.origin.framing[1] in "EO" else Parity.NONE
    faults = injectors(made, partial(derive, seed), character=character, parity=parity)
    faults.log.on_fault = lambda fault: tell(f"fault made: {fault}")
    return FaultyTransport(line, faults, LineEnd.CONTROL, character=character)


LINGER_S: Final = 1.0
"""After its end a control listens so long for the host to close, so that its last codes are not lost with the line."""


async def run_control(task: ControlTask, job: JobSettings) -> Result:
    """Open the line of `job`, do `task`, and say how it ended. Raises LineError, UsageError."""
    cnc = job.protocol.cnc(job.params)
    taken = Taken(task.save)
    control = _control(task, job, cnc, taken)
    nc = _nc(task.parameters, cnc, control, job)
    operator = Operator(nc, task.all_presses, task.stand, job.observer)
    try:
        nc.refuse_device(_OPERATIONS[task.operation], task.ground)
    except UsageError:
        taken.close()
        raise
    session = Session(
        job,
        cnc,
        tolerated=STOP_CHARACTERS if isinstance(job.line, TtyAddress) else job.protocol.sends_on,
        give_up=nc.give_up,
        bytes_done=lambda: cnc.progress,
        total=task.punch.byte_count if task.punch is not None else None,
        application=operator,
        paced_reception=True,
        linger_s=LINGER_S,
        details=lambda: _details(cnc, control),
        between=partial(faulty, task.faults, task.fault_seed, job) if task.faults is not None else None,
        heard=nc.heard,
        at_rest=lambda: nc.operation is NcOperation.NONE or bool(nc.alarms),
    )

    def begin(transport: Transport, now: Nanos) -> None:
        loop = asyncio.get_running_loop()
        # Later, because the control is in the middle of taking what cannot be stored.
        taken.on_error = lambda: loop.call_soon(session.abort)
        operator.begin(now)
        _begin(task, nc, now)

    try:
        ended = await session.run(begin)
    finally:
        taken.close()
    session.report_progress()
    punched = task.punch.sha256(ended.bytes_low) if task.punch is not None else None
    failed = taken.error or (ended.outcome is Outcome.COMPLETE and "; ".join(map(_alarm_text, nc.alarms)))
    return Result(
        outcome=Outcome.FAILED if failed else ended.outcome,
        reason=failed or ended.reason,
        bytes=ended.bytes_low,
        bytes_handed=ended.bytes_high,
        sha256=punched or taken.digest.hexdigest(),
        seconds=session.seconds,
        stops=session.stops,
        utilisation=None,
    )


_OPERATIONS: Final = {
    Operation.DNC: NcOperation.DNC,
    Operation.READ: NcOperation.READ,
    Operation.PUNCH: NcOperation.PUNCH,
}


def _control(task: ControlTask, job: JobSettings, cnc: CncEngine, taken: Taken) -> Control:
    is_dnc = task.operation is Operation.DNC
    return Control(
        cnc,
        taken,
        blocks_per_second=task.blocks_per_second if is_dnc else None,
        block_time=block_time_for(job.params, task.feed_override) if is_dnc else None,
        eob=job.protocol.text(job.params).eob,
        binary=binary_operation(job.protocol.binary_input(job.params)) if is_dnc else None,
        flow=flow_for(job.params, task.block_check) if is_dnc else None,
    )


def block_time_for(params: Any, feed_override: float | None) -> BlockTime | None:
    """How long blocks take by their length and feed; None where nobody asked, or where they are bytes and no text."""
    code = getattr(params, "data", DataCode.ASCII)
    if feed_override is None or code is DataCode.BINARY:
        return None
    return BlockTime(Speeds(override=feed_override), code)


def flow_for(params: Any, block_check: Switch) -> ProgramFlow | None:
    """What the blocks of a program mean; None where they are bytes and no text."""
    code = getattr(params, "data", DataCode.ASCII)
    if code is DataCode.BINARY:
        return None
    return ProgramFlow(code, check=BlockCheck() if block_check is Switch.ON else None)


def _nc(parameters: ParameterSet | None, cnc: CncEngine, control: Control, job: JobSettings) -> Nc:
    fitted = None if parameters is None else parameters.interface
    nc = Nc(None if parameters is None else ParameterMemory(parameters, fitted), fitted, tell=job.observer)
    nc.connect(cnc, control, board_of(cnc), job.params)
    return nc


def board_of(cnc: CncEngine) -> Board | None:
    """The remote buffer board of `cnc`; None for a control that has none."""
    has_board = isinstance(getattr(cnc, "buffer", None), BufferImage)
    return Board(cast(BufferedEngine, cnc)) if has_board else None


def _begin(task: ControlTask, nc: Nc, now: Nanos) -> None:
    match task.operation:
        case Operation.DNC:
            nc.cycle_start(now)
        case Operation.READ:
            nc.read(now, task.ground)
        case Operation.PUNCH if task.punch is not None:
            task.punch.rewind()
            nc.punch(task.punch, now, task.ground)
        case Operation.PUNCH:
            nc.punch_parameters(now, task.ground)


def _alarm_text(alarm: Alarm) -> str:
    return f"{alarm.number} {alarm.text}".strip()
