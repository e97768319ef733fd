"""`tapewire cnc`"""

from __future__ import annotations

import asyncio
import random
from contextlib import closing, nullcontext
from pathlib import Path

import click

from tapewire.cli.common import Number, capture_of, line_options, run_job, settings_of
from tapewire.cli.output import Output
from tapewire.errors import UsageError
from tapewire.line.faults.presets import preset
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.settings import End
from tapewire.transfer.control import ControlTask, Operation, run_control
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result
from tapewire.transfer.session import JobSettings, settings_for

__all__ = ["cnc"]

_COUNT = click.IntRange(min=1)


@click.command()
@line_options
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
    help="Execution speed; without it blocks take no time.",
)
@click.option("--reset-after", type=_COUNT, metavar="BYTES", help="Press RESET after so many bytes of program.")
@click.option("--alarm-after", type=_COUNT, metavar="BYTES", help="Go to alarm after so many bytes of program.")
@click.option("--faults", metavar="PRESET", help="Damage the line on purpose: worn-connector, late-xoff, …")
@click.option(
    "--fault-seed", type=click.IntRange(0, 2**64 - 1), help="Repeat the faults of another run; told at its start."
)
def cnc(
    line: str,
    protocol: str,
    baud: int | None,
    stopbits: int | None,
    words: tuple[str, ...],
    timeout: float | None,
    profile: Path | None,
    capture: Path | None,
    capture_size: int,
    as_json: bool,
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
    """Be a simulated control on LINE for one operation, and exit."""
    if operation == Operation.PUNCH and save is not None:
        raise UsageError("--save stores what the control took: it does not go with --operation punch")
    settings = settings_of(words, profile, protocol, End.CONTROL)
    settings = {**_asked_for(program, protocol, operation), **settings}
    job = settings_for(
        End.CONTROL,
        line,
        protocol,
        baud=baud,
        stopbits=stopbits,
        settings=settings,
        timeout_s=timeout,
        capture=capture_of(capture, capture_size),
    )
    task = ControlTask(
        operation=Operation(operation),
        punch=_program(file, operation, job, raw),
        save=save,
        blocks_per_second=blocks_per_second,
        reset_after=reset_after,
        alarm_after=alarm_after,
        faults=preset(faults) if faults is not None else None,
        fault_seed=_seed(faults, fault_seed),
    )

    async def work(output: Output, stop: asyncio.Event) -> Result:
        return await run_control(task, job.observed_by(output.observe, stop))

    with closing(task.punch) if task.punch is not None else nullcontext():
        return run_job(f"simulated control, {operation}", "of program taken, or punched out", as_json, work)


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
