"""`tapewire cnc`"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from contextlib import closing, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import click

from tapewire.cli.common import Number, capture_of, line_options_of_one_protocol, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.engine import SECOND
from tapewire.errors import UsageError
from tapewire.fanuc.host_settings import control_settings, host_settings
from tapewire.fanuc.parameter_check import Weight, check
from tapewire.fanuc.parameters import LINE_NUMBERS, Interface, ParameterSet
from tapewire.line.faults.plan import FaultPlan
from tapewire.line.faults.presets import preset
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.settings import End, Switch
from tapewire.sim.nc import Ground
from tapewire.sim.operator import Key, Press
from tapewire.transfer.control import ControlTask, Operation, Taken, run_control
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["cnc"]

PANEL_BLOCKS_PER_SECOND: Final = 10.0
"""Slow enough to watch, and to press keys in time."""

_COUNT = click.IntRange(min=1)


@click.command()
@line_options_of_one_protocol
@click.option("--protocol", metavar="NAME", help=f"One of {', '.join(PROTOCOLS)}; --parameters may tell it.")
@click.option(
    "--parameters",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="fanuc: the parameters of the control, as it punches them or as TOML; other options come after them.",
)
@click.option("--panel", is_flag=True, help="Show a panel with keys, for one operation after another.")
@click.option(
    "--operation",
    type=click.Choice([operation.value for operation in Operation]),
    default=Operation.DNC.value,
    show_default=True,
    help="Execute a program as it comes, read it into memory, or punch one out.",
)
@click.option(
    "--program", metavar="NUMBER", help="bridgeport: the program it asks for, or saves under; -1 asks without a name."
)
@click.option("--file", type=click.Path(readable=False), help="The program to punch out.")
@click.option("--raw", is_flag=True, help="Punch the file's bytes untouched.")
@click.option(
    "--save", type=click.Path(readable=False, path_type=Path), help="Store what the control took in this file."
)
@click.option(
    "--blocks-per-second",
    type=Number(0.001, 1_000_000),
    help="Execution speed; without it blocks take no time, on the panel a tenth of a second.",
)
@click.option(
    "--feed-override",
    type=Number(1, 200),
    metavar="PERCENT",
    help="Blocks take what their length and feed say, at so much of the feed: 100 as programmed.",
)
@click.option("--reset-after", type=_COUNT, metavar="BYTES", help="Press RESET after so many bytes of program.")
@click.option("--alarm-after", type=_COUNT, metavar="BYTES", help="Go to alarm after so many bytes of program.")
@click.option(
    "--press",
    "presses",
    multiple=True,
    metavar="KEY@WHEN",
    help=f"Press a key after so many bytes of program (hold@2000), or seconds (start@7.5s): {', '.join(Key)}; may be "
    "given many times.",
)
@click.option(
    "--stand",
    type=Number(0, 86_400),
    default=0.0,
    metavar="SECONDS",
    help="CYCLE START comes so long after each stop: M00, M01, single block, end of a program.  [default: 0]",
)
@click.option("--background", is_flag=True, help="Read or punch in the background, with its devices and its RESET.")
@click.option("--check-blocks", is_flag=True, help="PS10, PS11, PS12 at a block that the control cannot execute.")
@click.option("--faults", metavar="PRESET", help="Damage the line on purpose: worn-connector, late-xoff, …")
@click.option(
    "--fault-seed", type=click.IntRange(0, 2**64 - 1), help="Repeat the faults of another run; told at its start."
)
def cnc(**options: Any) -> int:
    """Be a simulated control on LINE for one operation, and exit; with --panel, until you leave it.

    With --parameters, --operation punch without --file punches the parameters.
    """
    chosen = _Options(**options)
    chosen.refuse_contradictions()
    told = chosen.told()
    job = chosen.job_of(told, chosen.operation)
    program = chosen.program_to_punch(job)
    with closing(program) if program is not None else nullcontext():
        return _show_panel(chosen, told, job, program) if chosen.panel else _run_once(chosen, told, job, program)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """What the parameters of a control say of its line, and which protocol it is."""

    protocol: str
    baud: int | None = None
    stopbits: int | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    parameters: ParameterSet | None = None

    @classmethod
    def of(cls, values: ParameterSet, protocol: str | None) -> _Told:
        """`protocol` chooses between A and expansion A, which the control leaves to the host. Raises UsageError, with
        what the control would raise SR807 for."""
        host = host_settings(values, protocol=protocol)
        control = control_settings(values, host.interface)
        return cls(
            protocol=host.protocol,
            baud=control.baud,
            stopbits=control.stopbits,
            settings=control.settings,
            parameters=values,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Options:
    """The options as they were given."""

    line: str
    protocol: str | None
    baud: int | None
    stopbits: int | None
    words: tuple[str, ...]
    timeout: float | None
    profile: Path | None
    capture: Path | None
    capture_size: int
    as_json: bool
    parameters: Path | None
    panel: bool
    operation: str
    program: str | None
    file: str | None
    raw: bool
    save: Path | None
    blocks_per_second: float | None
    feed_override: float | None
    reset_after: int | None
    alarm_after: int | None
    presses: tuple[str, ...]
    stand: float
    background: bool
    check_blocks: bool
    faults: str | None
    fault_seed: int | None

    def refuse_contradictions(self) -> None:
        """Raises UsageError."""
        if self.operation == Operation.PUNCH and self.save is not None:
            raise UsageError("--save stores what the control took: it does not go with --operation punch")
        if self.feed_override is not None and self.blocks_per_second is not None:
            raise UsageError("--feed-override and --blocks-per-second both say how long a block takes: leave one out")
        if not self.panel:
            return
        given = {
            "--operation": self.operation != Operation.DNC,
            "--json": self.as_json,
            "--timeout": self.timeout is not None,
            "--reset-after": self.reset_after is not None,
            "--alarm-after": self.alarm_after is not None,
            "--press": bool(self.presses),
            "--stand": self.stand > 0,
            "--background": self.background,
        }
        for option in (option for option, is_given in given.items() if is_given):
            raise UsageError(f"{option} does not go with --panel: there you are the operator, and press the keys")

    def told(self) -> _Told:
        """By the parameters, or by nothing but --protocol. A panel shows SR807, where another command is refused."""
        if self.parameters is None:
            if self.protocol is None:
                raise UsageError("--protocol is missing: it names what the control speaks, or --parameters tells it")
            return _Told(protocol=self.protocol)
        from tapewire.cli.fanuc import parameters_of

        values = parameters_of(self.parameters).parameters
        try:
            told = _Told.of(_with_a_line(values) if self.panel else values, self.protocol)
        except UsageError as error:
            raise UsageError(f"{self.parameters}: {error}") from None
        return replace(told, parameters=values)

    def told_by(self, values: ParameterSet) -> _Told:
        """The same when an operator has changed the parameters: the protocol may be another one now."""
        try:
            return _Told.of(values, self.protocol)
        except UsageError:
            return _Told.of(values, None)

    def job_of(self, told: _Told, operation: str) -> JobSettings:
        settings = {**told.settings, **settings_of(self.words, self.profile, told.protocol, End.CONTROL)}
        return settings_for(
            End.CONTROL,
            self.line,
            told.protocol,
            baud=self.baud or told.baud,
            stopbits=self.stopbits or told.stopbits,
            settings={**_asked_for(self.program, told.protocol, operation), **settings},
            timeout_s=self.timeout,
            capture=capture_of(self.capture, self.capture_size),
        )

    def program_to_punch(self, job: JobSettings) -> Program | None:
        """Raises UsageError, ProgramError."""
        punches = self.operation == Operation.PUNCH
        if self.file is None:
            if punches and self.parameters is None:
                raise UsageError(
                    "--operation punch needs --file, the program to punch, or --parameters, which it punches then"
                )
        elif not punches and not self.panel:
            raise UsageError("--file is what the control punches: it goes with --operation punch")
        if (punches or self.file is not None) and not job.protocol.punches_out:
            raise UsageError(f"{job.protocol.name} has no punch-out")
        return None if self.file is None else Program.from_file(self.file, job.protocol.text(job.params), raw=self.raw)

    @property
    def override(self) -> float | None:
        """Of the feed, as a share."""
        return None if self.feed_override is None else self.feed_override / 100

    @property
    def panel_speed(self) -> float | None:
        return self.blocks_per_second or (PANEL_BLOCKS_PER_SECOND if self.feed_override is None else None)

    @property
    def block_check(self) -> Switch:
        return Switch.ON if self.check_blocks else Switch.OFF

    @property
    def fault_plan(self) -> FaultPlan | None:
        return preset(self.faults) if self.faults is not None else None

    @property
    def seed(self) -> int:
        if self.fault_seed is None:
            return random.randrange(1_000_000)
        if self.faults is None:
            raise UsageError("--fault-seed repeats the faults of a preset: it goes with --faults")
        return self.fault_seed


def _with_a_line(values: ParameterSet) -> ParameterSet:
    """With something legal for what SR807 is raised for: 8E1 at 9600 baud by protocol B is as good as any line that
    nothing goes over."""
    wrong = {each.number for each in check(values, values.interface) if each.weight is Weight.ALARM}
    numbers = LINE_NUMBERS[values.interface or Interface.RS_232_C]
    legal = {numbers.stop_bits: 1, numbers.baud: 11, numbers.protocol: 1}
    return values.with_values({number: value for number, value in legal.items() if number in wrong})


def _run_once(chosen: _Options, told: _Told, job: JobSettings, program: Program | None) -> int:
    task = ControlTask(
        operation=Operation(chosen.operation),
        ground=Ground.BACKGROUND if chosen.background else Ground.FOREGROUND,
        parameters=told.parameters,
        punch=program,
        save=chosen.save,
        blocks_per_second=chosen.blocks_per_second,
        feed_override=chosen.override,
        presses=tuple(map(Press.parse, chosen.presses)),
        reset_after=chosen.reset_after,
        alarm_after=chosen.alarm_after,
        stand=round(chosen.stand * SECOND),
        block_check=chosen.block_check,
        faults=chosen.fault_plan,
        fault_seed=chosen.seed,
    )

    async def work(output: Output, stop: asyncio.Event) -> Result:
        return await run_control(task, job.observed_by(output.observe, stop))

    title = f"simulated control, {chosen.operation}"
    return run_job(title, "of program taken, or punched out", chosen.as_json, work)


def _show_panel(chosen: _Options, told: _Told, job: JobSettings, program: Program | None) -> int:
    from tapewire.cli.panel import refuse_terminal, run_panel
    from tapewire.transfer.operated import OperatedControl, OperatedTask

    refuse_terminal()
    is_bridgeport = told.protocol == "bridgeport"
    with closing(Taken(chosen.save)) as taken:
        task = OperatedTask(
            blocks_per_second=chosen.panel_speed,
            feed_override=chosen.override,
            punch=program,
            taken=taken,
            faults=chosen.fault_plan,
            fault_seed=chosen.seed,
            parameters=told.parameters,
            job_of=lambda values: chosen.job_of(chosen.told_by(values), Operation.DNC),
            read_params=chosen.job_of(told, Operation.READ).params if is_bridgeport else None,
            block_check=chosen.block_check,
        )
        return run_panel(lambda stop: OperatedControl(task, job.observed_by(job.observer, stop)))


def _asked_for(program: str | None, protocol: str, operation: str) -> dict[str, str]:
    """A control with program numbers asks for one to execute it (;D), or to keep it in memory (;L)."""
    if protocol != "bridgeport":
        if program is not None:
            raise UsageError(f"--program {program}: a control asks for no number by {protocol}")
        return {}
    number = {} if program is None else {"program": program}
    return {"mode": (Mode.LOAD if operation == Operation.READ else Mode.LINK).value, **number}
