"""`tapewire cnc`"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from contextlib import closing, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import click

from tapewire.cli.common import Number, capture_of, line_options_of_one_protocol, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.errors import UsageError
from tapewire.fanuc.host_settings import control_settings, host_settings
from tapewire.fanuc.parameters import ParameterSet
from tapewire.line.faults.plan import FaultPlan
from tapewire.line.faults.presets import preset
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.settings import End
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
@click.option("--reset-after", type=_COUNT, metavar="BYTES", help="Press RESET after so many bytes of program.")
@click.option("--alarm-after", type=_COUNT, metavar="BYTES", help="Go to alarm after so many bytes of program.")
@click.option("--faults", metavar="PRESET", help="Damage the line on purpose: worn-connector, late-xoff, …")
@click.option(
    "--fault-seed", type=click.IntRange(0, 2**64 - 1), help="Repeat the faults of another run; told at its start."
)
def cnc(
    line: str,
    protocol: str | None,
    baud: int | None,
    stopbits: int | None,
    words: tuple[str, ...],
    timeout: float | None,
    profile: Path | None,
    capture: Path | None,
    capture_size: int,
    as_json: bool,
    parameters: Path | None,
    panel: bool,
    operation: str,
    program: str | None,
    file: str | None,
    raw: bool,
    save: Path | None,
    blocks_per_second: float | None,
    reset_after: int | None,
    alarm_after: int | None,
    faults: str | None,
    fault_seed: int | None,
) -> int:
    """Be a simulated control on LINE for one operation, and exit; with --panel, until you leave it."""
    told = _Told.by(parameters, protocol)
    if operation == Operation.PUNCH and save is not None:
        raise UsageError("--save stores what the control took: it does not go with --operation punch")
    settings = {**told.settings, **settings_of(words, profile, told.protocol, End.CONTROL)}
    settings = {**_asked_for(program, told.protocol, operation), **settings}
    job = settings_for(
        End.CONTROL,
        line,
        told.protocol,
        baud=baud or told.baud,
        stopbits=stopbits or told.stopbits,
        settings=settings,
        timeout_s=timeout,
        capture=capture_of(capture, capture_size),
    )
    if panel:
        _refuse_with_panel(
            {"--operation": operation != Operation.DNC, "--json": as_json, "--timeout": timeout is not None}
            | {"--reset-after": reset_after is not None, "--alarm-after": alarm_after is not None}
        )
        punched = _panel_program(file, job, raw)
    else:
        punched = _program(file, operation, job, raw)
    plan = preset(faults) if faults is not None else None
    with closing(punched) if punched is not None else nullcontext():
        if panel:
            speed = blocks_per_second or PANEL_BLOCKS_PER_SECOND
            read = {**settings, **_asked_for(program, told.protocol, Operation.READ)}
            return _show_panel(job, read, punched, save, speed, plan, _seed(faults, fault_seed), told.parameters)
        task = ControlTask(
            operation=Operation(operation),
            punch=punched,
            save=save,
            blocks_per_second=blocks_per_second,
            reset_after=reset_after,
            alarm_after=alarm_after,
            faults=plan,
            fault_seed=_seed(faults, fault_seed),
        )

        async def work(output: Output, stop: asyncio.Event) -> Result:
            return await run_control(task, job.observed_by(output.observe, stop))

        return run_job(f"simulated control, {operation}", "of program taken, or punched out", as_json, work)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """What the parameters of a control say of its line, and which protocol it is."""

    protocol: str
    baud: int | None = None
    stopbits: int | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    parameters: ParameterSet | None = None

    @classmethod
    def by(cls, path: Path | None, protocol: str | None) -> _Told:
        """Raises UsageError, with what the control would raise SR807 for."""
        if path is None:
            if protocol is None:
                raise UsageError("--protocol is missing: it names what the control speaks, or --parameters tells it")
            return cls(protocol=protocol)
        from tapewire.cli.fanuc import parameters_of

        values = parameters_of(path).parameters
        host = host_settings(values, protocol=protocol)
        control = control_settings(values, host.interface)
        return cls(
            protocol=host.protocol,
            baud=control.baud,
            stopbits=control.stopbits,
            settings=control.settings,
            parameters=values,
        )


def _refuse_with_panel(given: dict[str, bool]) -> None:
    for option, is_given in given.items():
        if is_given:
            raise UsageError(f"{option} does not go with --panel: there you are the operator, and press the keys")


def _panel_program(file: str | None, job: JobSettings, raw: bool) -> Program | None:
    return None if file is None else _program(file, Operation.PUNCH, job, raw)


def _show_panel(
    job: JobSettings,
    read_settings: Mapping[str, str],
    punched: Program | None,
    save: Path | None,
    blocks_per_second: float,
    faults: FaultPlan | None,
    seed: int,
    parameters: ParameterSet | None,
) -> int:
    from tapewire.cli.panel import refuse_terminal, run_panel
    from tapewire.transfer.operated import OperatedControl, OperatedTask

    refuse_terminal()
    with closing(Taken(save)) as taken:
        task = OperatedTask(
            blocks_per_second=blocks_per_second,
            punch=punched,
            taken=taken,
            faults=faults,
            fault_seed=seed,
            parameters=parameters,
            read_params=job.protocol.params(read_settings, End.CONTROL) if job.protocol.name == "bridgeport" else None,
        )
        return run_panel(lambda stop: OperatedControl(task, job.observed_by(job.observer, stop)))


def _seed(faults: str | None, seed: int | None) -> int:
    if seed is None:
        return random.randrange(1_000_000)
    if faults is None:
        raise UsageError("--fault-seed repeats the faults of a preset: it goes with --faults")
    return seed


def _program(file: str | None, operation: str, job: JobSettings, raw: bool) -> Program | None:
    if operation != Operation.PUNCH:
        if file is not None:
            raise UsageError("--file is what the control punches: it goes with --operation punch")
        return None
    if file is None:
        raise UsageError("--operation punch needs --file, the program to punch")
    if not job.protocol.punches_out:
        raise UsageError(f"{job.protocol.name} has no punch-out")
    return Program.from_file(file, job.protocol.text(job.params), raw=raw)


def _asked_for(program: str | None, protocol: str, operation: str) -> dict[str, str]:
    """A control with program numbers asks for one to execute it (;D), or to keep it in memory (;L)."""
    if protocol != "bridgeport":
        if program is not None:
            raise UsageError(f"--program {program}: a control asks for no number by {protocol}")
        return {}
    number = {} if program is None else {"program": program}
    return {"mode": (Mode.LOAD if operation == Operation.READ else Mode.LINK).value, **number}
