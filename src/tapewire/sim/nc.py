"""The control as its operator works it: parameters, devices, program memory, DNC operation, read, punch, PMC, keys.

`Nc` stands behind one engine and its `Control`, in the simulated world and on a real line. It knows what the
communication does not: which device an operation uses (0020 to 0023), what is in the memory, and what the keys mean in
the foreground and in the background. It is the application of its link, and the sink of what the control takes.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, Final, Protocol, cast

from tapewire.codes import DataCode
from tapewire.engine import Alarm, CncEngine, Ended, Event, Nanos, Notice, Outcome, Source
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.conversion import EobForm
from tapewire.fanuc.parameter_check import ParameterMemory, Weight, check
from tapewire.fanuc.parameter_file import write_punch
from tapewire.fanuc.parameters import REMOTE_BUFFER_DEVICE, Interface, ParameterSet
from tapewire.fanuc.program_memory import ProgramMemory, PunchForm, Registration, punch_form, tape_of
from tapewire.fanuc.punch import PunchReader
from tapewire.fanuc.tv_check import Comments, TvCheck
from tapewire.protocols.settings import Switch
from tapewire.sim.board import Board, Request
from tapewire.sim.machine import SEND_BUFFER, Control, Work

__all__ = ["Ground", "Nc", "Operation"]

MEMORY_BYTES: Final = 4 << 20
"""A longer tape is not registered."""

MOST_ALARMS: Final = 20


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


class _Bytes:
    """A tape that is there in one piece."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def read(self, size: int) -> bytes:
        piece = self._data[self._at : self._at + size]
        self._at += len(piece)
        return piece


class _Tape:
    """What is being punched. STOP ends it once what the control and the remote buffer hold has gone out."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._position = 0
        self.limit: int | None = None

    def read(self, size: int) -> bytes | None:
        room = size if self.limit is None else min(size, self.limit - self._position)
        piece = self._source.read(room) if room else None
        self._position += len(piece or b"")
        return piece

    def stop(self) -> None:
        """Pressed again it changes nothing: what was in the buffers then is what goes out."""
        if self.limit is None:
            self.limit = self._position + SEND_BUFFER


class Nc:
    """One control. `fitted` is what its remote buffer has, None where none is fitted; `parameters` None: nobody has
    told them, and every device is the remote buffer. `tell` gets what it has to say beside the events of its engine.
    """

    def __init__(
        self,
        parameters: ParameterMemory | None,
        fitted: Interface | None,
        *,
        tell: Callable[[Event, Nanos], object] = lambda event, now: None,
    ) -> None:
        self.parameters = parameters
        self.memory = ProgramMemory()
        self.alarms: list[Alarm] = []
        """What is on the screen, until RESET."""
        self.selected = Operation.NONE
        """The operation under way, or the last one."""
        self.ground = Ground.FOREGROUND
        self.registration: Registration | None = None
        """What the last reading has put into the memory."""
        self.single_block = Switch.OFF
        self.optional_stop = Switch.OFF
        self.communicating = False
        self.cnc: CncEngine
        self.control: Control
        self.board: Board | None
        self._fitted = fitted
        self._tell = tell
        self._tape: _Tape | None = None
        self._reading: bytearray | None = None

    def connect(self, cnc: CncEngine, control: Control, board: Board | None, params: Any) -> None:
        """Work by this engine from now on. `params` are its protocol's; a control without a board has no memory that
        tapes are registered in."""
        self.cnc, self.control, self.board = cnc, control, board
        self._code = getattr(params, "data", DataCode.ASCII)
        self._posts = getattr(params, "posting", Switch.OFF) is Switch.ON
        self._sink, control.sink = control.sink, self
        self.communicating, self._tape, self._reading = False, None, None
        self._apply_switches()

    # operations

    @property
    def operation(self) -> Operation:
        """DNC operation goes on until what was taken has been executed, though the communication is over."""
        executing = self.selected is Operation.DNC and not self.control.idle
        return self.selected if self.communicating or executing else Operation.NONE

    def cycle_start(self, now: Nanos) -> None:
        """CYCLE START: go on where the control stands still, or begin DNC operation through the input device."""
        if self.operation is Operation.DNC and not self.alarms:
            self.control.go(now)
        elif self.may_begin(Operation.DNC, Ground.FOREGROUND, now):
            self._take_in(Operation.DNC, Ground.FOREGROUND, Work.EXECUTE, now)

    def read(self, now: Nanos, ground: Ground = Ground.FOREGROUND) -> None:
        """Read a tape into the memory (8.2)."""
        if self.may_begin(Operation.READ, ground, now):
            self._take_in(Operation.READ, ground, Work.STORE, now)
            self._reading = bytearray() if self.board is not None else None

    def punch_programs(self, now: Nanos, *numbers: int, ground: Ground = Ground.FOREGROUND) -> None:
        """Punch these programs, or all. Raises UsageError for one that is not there."""
        self.punch(_Bytes(tape_of(self.memory.text(numbers), self._form)), now, ground)

    def punch_parameters(self, now: Nanos, ground: Ground = Ground.FOREGROUND) -> None:
        """Punch the parameters of chapter 10 as they were entered. Raises UsageError where there are none."""
        if self.parameters is None:
            raise UsageError("nobody has told the control its parameters: there are none to punch")
        text = write_punch(self.parameters.entered).rstrip("\n").encode()
        self.punch(_Bytes(tape_of(text, self._form)), now, ground)

    def punch(self, source: Source, now: Nanos, ground: Ground = Ground.FOREGROUND) -> None:
        """Punch what `source` has, as it is."""
        if self.may_begin(Operation.PUNCH, ground, now):
            self._tape = _Tape(source)
            self.cnc.punch(self._tape, now)
            self._begin(Operation.PUNCH, ground, Request.PUNCH)

    def refuse_device(self, operation: Operation, ground: Ground) -> None:
        """Raises UsageError where `operation` would be SR807."""
        wrong = [] if self.parameters is None else self._wrong(self.parameters.in_force, operation, ground)
        if wrong:
            raise UsageError(f"{AlarmNumber.SR807} {text_of(AlarmNumber.SR807, '; '.join(wrong))}")

    @property
    def _form(self) -> PunchForm:
        if self.parameters is None:
            return PunchForm(code=self._code, eob=EobForm.LF, feed=0)
        return punch_form(self.parameters.in_force)

    def _take_in(self, operation: Operation, ground: Ground, work: Work, now: Nanos) -> None:
        self.control.cycle_start(now)
        self.control.work = work
        self._begin(operation, ground, Request.READ)

    def _begin(self, operation: Operation, ground: Ground, request: Request) -> None:
        self.selected, self.ground, self.communicating, self._reading = operation, ground, True, None
        self._apply_switches()
        self._ask(request)

    def may_begin(self, operation: Operation, ground: Ground, now: Nanos) -> bool:
        """The control is free, and the device is the remote buffer, and works; else SR807. Raises UsageError where the
        control is at work or in alarm."""
        if self.alarms:
            raise UsageError("an alarm is on: RESET first")
        if self.operation is not Operation.NONE:
            text = f"the remote buffer is at work: {self.operation.value}, in the {self.ground.value}"
            raise UsageError(f"{text}: wait for its end, or RESET")
        wrong = [] if self.parameters is None else self._wrong(self.parameters.in_force, operation, ground)
        if wrong:
            self._raise(AlarmNumber.SR807, "; ".join(wrong), now)
        return not wrong

    def _wrong(self, values: ParameterSet, operation: Operation, ground: Ground) -> list[str]:
        device = (_OUTPUT if operation is Operation.PUNCH else _INPUT)[ground]
        number = values.get(device)
        wrong = [finding.text for finding in check(values, self._fitted) if finding.weight is Weight.ALARM]
        if number is not None and number != REMOTE_BUFFER_DEVICE:
            # Chapter 11: an interface that is not fitted. A real control has others; this one has not.
            wrong.append(f"No. {device:04d} is {number}: this control has the remote buffer alone, which is 10")
        return wrong or (["the remote buffer is not fitted"] if self._fitted is None else [])

    # keys and switches

    def feed_hold(self, now: Nanos) -> None:
        if self.operation is Operation.DNC:
            self.control.feed_hold(now)

    def reset(self, now: Nanos) -> None:
        """RESET clears the alarms and ends the operation; what was taken and not executed is lost (8.2). In the
        background it does not end a communication that posts (6.4 note 1 (2))."""
        self.alarms.clear()
        if self.operation is not Operation.NONE and self.ground is Ground.BACKGROUND and self._posts:
            text = "in the background RESET ends no communication that posts (6.4 note 1): STOP does"
            self._tell(Notice(text=text), now)
            return
        self.give_up(now)

    def give_up(self, now: Nanos) -> None:
        """End whatever is under way, in the background too."""
        self.control.reset(now)
        self._ask(Request.RESET)

    def stop(self, now: Nanos) -> None:
        """The soft key STOP. A punch-out ends when what is in the buffers has gone out (6.4 note 2)."""
        if self._tape is not None and self.operation is Operation.PUNCH:
            self._tape.stop()
        elif self.operation is not Operation.NONE:
            self.give_up(now)

    def alarm(self, now: Nanos) -> None:
        """The control goes to alarm for a reason of its own."""
        self.control.alarm(now)
        self._ask(Request.ALARM)

    def turn_single_block(self, switch: Switch) -> None:
        self.single_block = switch
        self._apply_switches()

    def turn_optional_stop(self, switch: Switch) -> None:
        self.optional_stop = switch
        self._apply_switches()

    def _apply_switches(self) -> None:
        self.control.single_block = self.single_block is Switch.ON
        among_records = self.parameters is not None and self.parameters.in_force.bit(2007, 3)
        self.control.stops_among_records = Switch.ON if among_records else Switch.OFF
        if self.control.flow is not None:
            self.control.flow.optional_stop = self.optional_stop

    def _ask(self, request: Request) -> None:
        if self.board is not None:
            self.board.asked(request)

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
    def has_images(self) -> bool:
        return hasattr(self.cnc, "do")

    @property
    def _images(self) -> _Images:
        if not self.has_images:
            raise UsageError("only protocol A carries DI and DO: this control has none")
        return cast(_Images, self.cnc)

    # as the application of its link, and as a sink

    def step(self, now: Nanos) -> None:
        self.control.step(now)
        self.step_behind(now)

    def step_behind(self, now: Nanos) -> None:
        """What is due when the control has been stepped."""
        tape = self._tape
        if tape is not None and tape.limit is not None and self.cnc.progress >= tape.limit:
            self._tape = None
            self.control.reset(now)

    def next_deadline(self) -> Nanos | None:
        return self.control.next_deadline()

    def next_event(self) -> Event | None:
        return self.control.next_event()

    def write(self, data: bytes) -> object:
        """What the control takes out of the buffer."""
        self._sink.write(data)
        if self._reading is not None and len(self._reading) <= MEMORY_BYTES:
            self._reading += data
        return None

    # what becomes of it

    def heard(self, event: Event, now: Nanos) -> None:
        """An event of the engine, or of the control."""
        if isinstance(event, Alarm):
            self.show(event)
            self.control.feed_hold(now)
        elif isinstance(event, Ended):
            reading, self._reading = self._reading, None
            self.communicating, self._tape = False, None
            if reading is not None and event.outcome is Outcome.COMPLETE:
                self._register(bytes(reading), now)

    def _register(self, tape: bytes, now: Nanos) -> None:
        """A damaged tape is not registered, nor one that fails the TV check (0000#0); the manual has no number for
        either alarm."""
        text = bytearray()
        reader = PunchReader(self._code, text.extend)
        reader.feed(tape)
        faults = [str(damage) for damage in reader.finish()] or self._tv_failures(tape)
        if len(tape) > MEMORY_BYTES:
            faults = [f"a tape of more than {MEMORY_BYTES:,} bytes"]
        done = Registration(registered=(), refused=tuple(faults)) if faults else self.memory.read(bytes(text))
        self.registration = done
        for why in done.refused:
            self._tell(Notice(text=f"not registered: {why}"), now)
        if done.registered:
            numbers = ", ".join(f"O{number:04d}" for number in done.registered)
            self._tell(Notice(text=f"registered {numbers}"), now)
        if done.alarm is not None:
            self._raise(done.alarm, "; ".join(done.refused), now)

    def _tv_failures(self, tape: bytes) -> list[str]:
        values = ParameterSet() if self.parameters is None else self.parameters.in_force
        if not values.bit(0, 0):
            return []
        comments = Comments.NOT_COUNTED if values.bit(0, 1) else Comments.COUNTED
        return [str(failure) for failure in TvCheck(self._code, comments=comments).feed(tape)]

    def _raise(self, number: AlarmNumber, what: str, now: Nanos) -> None:
        alarm = Alarm(number=number, text=text_of(number, what))
        self.show(alarm)
        self._tell(alarm, now)

    def show(self, alarm: Alarm) -> None:
        """Put it on the screen, behind those that are there."""
        self.alarms = [*self.alarms, alarm][-MOST_ALARMS:]
