"""The control as its operator works it: parameters, devices, program memory, DNC operation, read, punch, PMC, keys.

`Nc` stands on a machine of the simulated world. It knows what the communication does not: which device an operation
uses (0020 to 0023), what is in the memory, and what the keys mean in the foreground and in the background. What it
raises itself, before anything goes over the line, is in `alarms`.
"""

from __future__ import annotations

from enum import Enum
from typing import Final, Protocol, cast

from tapewire.codes import DataCode
from tapewire.engine import Alarm, Ended, Event, Nanos, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.host_settings import control_settings, host_settings
from tapewire.fanuc.parameter_check import ParameterMemory, Weight, check
from tapewire.fanuc.parameter_file import write_punch
from tapewire.fanuc.parameters import LINE_NUMBERS, REMOTE_BUFFER_DEVICE, Interface, ParameterSet
from tapewire.fanuc.program_memory import ProgramMemory, Registration, punch_form, tape_of
from tapewire.fanuc.punch import PunchReader
from tapewire.fanuc.tv_check import Comments, TvCheck
from tapewire.protocols.settings import Switch
from tapewire.sim.board import Board, Request, watch
from tapewire.sim.machine import SEND_BUFFER, Motion, Work
from tapewire.sim.pair import Pair
from tapewire.sim.program_flow import ProgramFlow
from tapewire.sim.world import World

__all__ = ["Ground", "Nc", "Operation", "nc_of"]


class Ground(Enum):
    """Where an operation runs; each has its own devices."""

    FOREGROUND = "foreground"
    BACKGROUND = "background"


class Operation(Enum):
    """What the control does with the remote buffer."""

    NONE = "nothing"
    DNC = "DNC operation"
    READ = "read into the memory"
    PUNCH = "punch"


_INPUT: Final = {Ground.FOREGROUND: 20, Ground.BACKGROUND: 22}
_OUTPUT: Final = {Ground.FOREGROUND: 21, Ground.BACKGROUND: 23}


class _Images(Protocol):
    di: int

    @property
    def do(self) -> int: ...


class _Tape:
    """What is being punched. STOP ends it once what the control and the remote buffer hold has gone out."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0
        self.limit: int | None = None

    def read(self, size: int) -> bytes | None:
        end = self.position + size if self.limit is None else min(self.position + size, self.limit)
        piece = self._data[self.position : end]
        self.position += len(piece)
        return None if not piece and self.limit is not None and self.position < len(self._data) else piece

    def stop(self) -> None:
        self.limit = min(self.position + SEND_BUFFER, len(self._data))


class Nc:
    """One control. `board` is None where no remote buffer is fitted."""

    def __init__(self, pair: Pair, parameters: ParameterMemory, board: Interface | None) -> None:
        self.pair = pair
        self.parameters = parameters
        self.memory = ProgramMemory()
        self.alarms: list[Alarm] = []
        self._operation = Operation.NONE
        self._ended = True
        self.ground = Ground.FOREGROUND
        self.registration: Registration | None = None
        """What the last reading has put into the memory."""
        self.board: Board = watch(pair)
        self._fitted = board
        self._read_from = 0
        self._tape: _Tape | None = None
        tell = pair.on_cnc_event

        def on_event(event: Event, now: Nanos) -> None:
            if tell is not None:
                tell(event, now)
            self._heard(event)

        pair.on_cnc_event = on_event
        pair.on_step = self._step

    # operations

    @property
    def operation(self) -> Operation:
        """DNC operation goes on until what was taken has been executed, though the communication is over."""
        executing = self._operation is Operation.DNC and not self.pair.control.idle
        return Operation.NONE if self._ended and not executing else self._operation

    def cycle_start(self, now: Nanos) -> None:
        """CYCLE START: go on where the control stands still, or begin DNC operation through the input device."""
        if self._operation is Operation.DNC and self.pair.control.motion is not Motion.RUNNING:
            self.pair.control.go(now)
        elif self._ready(_INPUT[Ground.FOREGROUND]):
            self._take_in(Operation.DNC, Ground.FOREGROUND, Work.EXECUTE, now)

    def read(self, now: Nanos, ground: Ground = Ground.FOREGROUND) -> None:
        """Read a tape into the memory (8.2)."""
        if self._ready(_INPUT[ground]):
            self._read_from = len(self.pair.program.getvalue())
            self._take_in(Operation.READ, ground, Work.STORE, now)

    def punch_programs(self, now: Nanos, *numbers: int, ground: Ground = Ground.FOREGROUND) -> None:
        """Punch these programs, or all. Raises UsageError for one that is not there."""
        self._punch(self.memory.text(numbers), now, ground)

    def punch_parameters(self, now: Nanos, ground: Ground = Ground.FOREGROUND) -> None:
        """Punch the parameters of chapter 10 as they were entered."""
        self._punch(write_punch(self.parameters.entered).rstrip("\n").encode(), now, ground)

    def _take_in(self, operation: Operation, ground: Ground, work: Work, now: Nanos) -> None:
        self._require_free()
        self.pair.control.cycle_start(now)
        self.pair.control.work = work
        self._operation, self.ground, self._ended = operation, ground, False
        self.board.asked(Request.READ)

    def _punch(self, text: bytes, now: Nanos, ground: Ground) -> None:
        if self._ready(_OUTPUT[ground]):
            self._require_free()
            tape = _Tape(tape_of(text, punch_form(self.parameters.in_force)))
            self.pair.cnc.punch(tape, now)
            self._tape = tape
            self._operation, self.ground, self._ended = Operation.PUNCH, ground, False
            self.board.asked(Request.PUNCH)

    def _require_free(self) -> None:
        if self.operation is not Operation.NONE:
            raise UsageError(f"the remote buffer is at work: {self.operation.value}, in the {self.ground.value}")

    def _ready(self, device: int) -> bool:
        """The device is the remote buffer, and works; else SR807. Raises UsageError for another device."""
        values = self.parameters.in_force
        number = values.get(device)
        if number is not None and number != REMOTE_BUFFER_DEVICE:
            raise UsageError(f"No. {device:04d} is {number}: this control has the remote buffer alone, which is 10")
        wrong = [finding.text for finding in check(values, self._fitted) if finding.weight is Weight.ALARM]
        if self._fitted is None:
            wrong = wrong or ["the remote buffer is not fitted"]
        if wrong:
            self.alarms.append(Alarm(number=AlarmNumber.SR807, text=text_of(AlarmNumber.SR807, "; ".join(wrong))))
        return not wrong

    # keys and switches

    def feed_hold(self, now: Nanos) -> None:
        self.pair.control.feed_hold(now)

    def reset(self, now: Nanos) -> None:
        """RESET. In the background it does not end a communication that posts (6.4 note 1 (2))."""
        if self.operation is not Operation.NONE and self.ground is Ground.BACKGROUND and self._posts:
            return
        self.pair.control.reset(now)
        self.board.asked(Request.RESET)

    def stop(self, now: Nanos) -> None:
        """The soft key STOP. A punch-out ends when what is in the buffers has gone out (6.4 note 2)."""
        if self._tape is not None and self.operation is Operation.PUNCH:
            self._tape.stop()
        elif self.operation is not Operation.NONE:
            self.pair.control.reset(now)
            self.board.asked(Request.RESET)

    @property
    def optional_stop(self) -> Switch:
        flow = self.pair.control.flow
        return Switch.OFF if flow is None else flow.optional_stop

    @optional_stop.setter
    def optional_stop(self, switch: Switch) -> None:
        if self.pair.control.flow is not None:
            self.pair.control.flow.optional_stop = switch

    @property
    def _posts(self) -> bool:
        """5000#3 with protocol B."""
        values = self.parameters.in_force
        interface = self._fitted
        uses_b = interface is not None and values.get(LINE_NUMBERS[interface].protocol) in (1, 2)
        return uses_b and bool(values.bit(5000, 3))

    # the PMC

    @property
    def g152(self) -> int:
        """The DI byte that the host reads by RDI (4.4.2 4))."""
        return self._images.di

    @g152.setter
    def g152(self, image: int) -> None:
        self._images.di = image

    @property
    def f152(self) -> int:
        """The DO byte that the host sets by SDO (4.4.2 5))."""
        return self._images.do

    @property
    def _images(self) -> _Images:
        if not hasattr(self.pair.cnc, "do"):
            raise UsageError(f"{self.pair.entry.title} carries no DI and no DO: that is protocol A")
        return cast(_Images, self.pair.cnc)

    # what becomes of it

    def _heard(self, event: Event) -> None:
        if not isinstance(event, Ended):
            return
        if self._operation is Operation.READ and event.outcome is Outcome.COMPLETE:
            self._register()
        self._ended = True
        self._tape = None

    def _register(self) -> None:
        """A damaged tape is not registered, nor one that fails the TV check (0000#0); the manual has no number for
        either alarm."""
        code = DataCode(self.pair.cnc_params.data)
        tape = self.pair.program.getvalue()[self._read_from :]
        text = bytearray()
        reader = PunchReader(code, text.extend)
        reader.feed(tape)
        faults = [str(damage) for damage in reader.finish()] or self._tv_failures(tape, code)
        if faults:
            self.registration = Registration(registered=(), refused=tuple(faults))
            return
        self.registration = self.memory.read(bytes(text))
        if self.registration.alarm is not None:
            alarm = Alarm(number=self.registration.alarm, text="; ".join(self.registration.refused))
            self.alarms.append(alarm)

    def _tv_failures(self, tape: bytes, code: DataCode) -> list[str]:
        values = self.parameters.in_force
        if not values.bit(0, 0):
            return []
        comments = Comments.NOT_COUNTED if values.bit(0, 1) else Comments.COUNTED
        return [str(failure) for failure in TvCheck(code, comments=comments).feed(tape)]

    def _step(self, now: Nanos) -> None:
        tape = self._tape
        if tape is not None and tape.limit is not None and self.pair.cnc.progress >= tape.limit:
            self._tape = None
            self.pair.control.reset(now)


def nc_of(
    world: World,
    parameters: ParameterSet,
    board: Interface,
    *,
    flow: ProgramFlow | None = None,
    protocol: str | None = None,
    **operator: object,
) -> Nc:
    """A control with these parameters, and the host that suits it, on a cable. Raises UsageError where none does.

    `flow` None obeys the M codes and executes every block. `operator` goes to `World.pair`.
    """
    memory = ParameterMemory(parameters, board)
    host = host_settings(memory.in_force, board=board, protocol=protocol)
    control = control_settings(memory.in_force, board)
    words = {**host.settings, **({} if host.data_to_control is None else {"data": str(host.data_to_control)})}
    flow = flow or ProgramFlow(DataCode(control.settings["data"]))
    pair = world.pair(
        host.protocol,
        baud=host.baud,
        host_settings=words,
        cnc_settings=dict(control.settings),
        flow=flow,
        **operator,  # type: ignore[arg-type]
    )
    return Nc(pair, memory, board)
