"""`tapewire fanuc`"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import click

from tapewire.cli.common import COMPLETE, NOT_COMPLETE, Number
from tapewire.cli.convert import ASSIGN, SOURCE, source_of
from tapewire.codes import EiaSigns
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import BEGIN_AGAIN, AlarmRecord, alarm_named
from tapewire.fanuc.diagnosis import Case, Seen, diagnose
from tapewire.fanuc.host_settings import HostSettings, control_settings, host_settings
from tapewire.fanuc.leds import Red, read_leds
from tapewire.fanuc.parameter_check import Weight
from tapewire.fanuc.parameter_file import (
    LONGEST_FILE_BYTES,
    ParameterFile,
    read_parameters,
    write_punch,
    write_toml,
)
from tapewire.fanuc.parameters import CATALOGUE, Interface, ParameterSet, PowerRule
from tapewire.fanuc.tv_check import Comments
from tapewire.transfer.converting import TapeReport, inspect_tape
from tapewire.transfer.recordings import heard_in

__all__ = ["fanuc", "parameters_of"]

_INTERFACES: Final = {"rs-232-c": Interface.RS_232_C, "rs-422": Interface.RS_422}
_INDENT: Final = "  "
_LONG: Final = re.compile(r"(?:0x)?[0-9A-F]{1,8}", re.I | re.A)


@click.group()
def fanuc() -> None:
    """What only FANUC controls with a remote buffer need: parameters, alarms, LEDs."""


def parameters_of(path: Path) -> ParameterFile:
    """A parameter file in either form. Raises UsageError."""
    try:
        with path.open("rb") as file:
            data = file.read(LONGEST_FILE_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    if len(data) > LONGEST_FILE_BYTES:
        raise UsageError(f"{path}: longer than {LONGEST_FILE_BYTES:,} bytes, which no parameter file is")
    try:
        return read_parameters(data.decode("ascii"))
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{path}: byte {data[error.start]:02X}h at offset {error.start} is not ASCII; "
            "a punch-out in ISO or EIA code goes through `tapewire convert` first"
        ) from None
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


_PARAMS: Final = click.argument("params", type=click.Path(path_type=Path))
_INTERFACE: Final = click.option(
    "--interface",
    type=click.Choice(list(_INTERFACES)),
    help="What the board has, where No. 5000 does not say it.",
)


@fanuc.command("host-settings")
@_PARAMS
@_INTERFACE
@click.option("--protocol", metavar="NAME", help="fanuc-a or fanuc-a-expansion: the control leaves it to the host.")
@click.option("--cable-length", type=Number(min=0), metavar="METRES", help="Is the cable short enough for the rate?")
@click.option("--simulated", is_flag=True, help="Print the command of a simulated control with these parameters too.")
def host_settings_command(
    params: Path, interface: str | None, protocol: str | None, cable_length: float | None, simulated: bool
) -> int:
    """Print the commands that suit a control with the parameters in the file PARAMS.

    PARAMS holds lines such as `N5074 P3`, as the control punches them, or TOML. The exit status is 1 where something
    must be seen to first.
    """
    values = parameters_of(params).parameters
    try:
        settings = host_settings(
            values,
            board=_INTERFACES[interface] if interface else None,
            protocol=protocol,
            cable_length_m=cable_length,
        )
    except UsageError as error:
        raise UsageError(f"{params}: {error}") from None
    for verb in ("send", "receive") if settings.receives else ("send",):
        click.echo(settings.command(verb))
    if simulated:
        click.echo(settings.control_command(control_settings(values, settings.interface)))
    _tell(settings)
    warned = any(finding.weight is Weight.WARNING for finding in settings.findings)
    return NOT_COMPLETE if warned else COMPLETE


def _tell(settings: HostSettings) -> None:
    frame = "8E1" if settings.stopbits == 1 else "8N2"
    click.echo(f"{settings.protocol} on {settings.interface}, {settings.baud} baud, {frame}", err=True)
    for other in settings.alternatives:
        click.echo(f"{other} goes with the same parameters: the host chooses", err=True)
    for finding in settings.findings:
        click.echo(f"{finding.weight}: {finding}", err=True)


@fanuc.command()
@_PARAMS
@click.option(
    "--to",
    "form",
    type=click.Choice(["text", "punch", "toml"]),
    default="text",
    show_default=True,
    help="For people, as the control punches them, or TOML.",
)
def parameters(params: Path, form: str) -> int:
    """Show the remote buffer's parameters in the file PARAMS, or write them in the other form."""
    file = parameters_of(params)
    match form:
        case "punch":
            click.echo(write_punch(file.parameters), nl=False)
        case "toml":
            click.echo(write_toml(file.parameters), nl=False)
        case _:
            click.echo("\n".join(_explained(file.parameters)))
    if file.others:
        click.echo(f"{file.others:,} other parameters are left out", err=True)
    return COMPLETE


def _explained(values: ParameterSet) -> list[str]:
    lines = []
    for number, value in sorted(values.values.items()):
        record = CATALOGUE[number]
        meaning = record.values.get(value, record.unit)
        shown = f"{value:08b}" if record.is_bits else f"{value} {meaning}".rstrip()
        power = "" if record.power is PowerRule.AT_ONCE else f" [{record.power}]"
        lines.append(f"{number:04d} {record.title}: {shown}{power}")
        for bit in record.bits:
            on = values.bit(number, bit.position)
            lines.append(f"{_INDENT}#{bit.position} {bit.name} = {on}: {bit.one if on else bit.zero}")
    return lines


@fanuc.command()
@click.argument("number")
def alarm(number: str) -> int:
    """Explain an alarm of the remote buffer: why it comes, what is seen, what to do. SR945, sr0945 or 945."""
    click.echo("\n".join(_alarm_text(alarm_named(number))))
    return COMPLETE


def _alarm_text(record: AlarmRecord) -> list[str]:
    return [
        f"{record.number} {record.message}",
        "",
        "Why:",
        *(f"{_INDENT}- {cause}" for cause in record.causes),
        f"{_INDENT}Fault of {record.fault_of}. Raised in {record.protocols}.",
        "What is seen:",
        f"{_INDENT}{record.seen}",
        "What to do:",
        *(f"{_INDENT}{place}. {remedy}" for place, remedy in enumerate((*record.remedies, BEGIN_AGAIN), 1)),
    ]


@fanuc.command()
@click.argument("file", type=click.Path(path_type=Path))
@SOURCE
@ASSIGN
@click.option("--tv", is_flag=True, help="Check that every block has an even number of characters (0000#0 = 1).")
@click.option("--no-comments", is_flag=True, help="With --tv: comments do not count (0000#1 = 1).")
def tape(file: Path, source: str, words: tuple[str, ...], tv: bool, no_comments: bool) -> int:
    """Say what the program in FILE is to a control: its code, label, programs and end; whether it passes a TV check."""
    if no_comments and not tv:
        raise UsageError("--no-comments says how to count in a TV check: say --tv too")
    comments = Comments.NOT_COUNTED if no_comments else Comments.COUNTED
    report = inspect_tape(
        file, source=source_of(source), comments=comments if tv else None, signs=EiaSigns.parse(words)
    )
    click.echo("\n".join(_tape_text(report)))
    if tv and not report.failures:
        click.echo("TV check: every block has an even number of characters")
    return NOT_COMPLETE if report.failures else COMPLETE


def _tape_text(report: TapeReport) -> list[str]:
    headers = report.headers
    code = report.recognition.code
    end = "no EOR: a control waits for more" if headers.eor_line is None else f"EOR on line {headers.eor_line:,}"
    return [
        f"code: {code.upper() if code else 'unknown'} ({report.recognition.why})",
        f"label: {headers.label!r}" if headers.label else "label: none",
        *(f"program: {program}, line {program.line:,}" for program in headers.programs),
        f"blocks: {report.blocks:,}; {end}",
        *map(str, report.failures),
    ]


@fanuc.command("diagnose")
@click.option("--params", type=click.Path(path_type=Path), help="The control's parameters, as for host-settings.")
@click.option("--green", metavar="LED1,LED2", help="The two green LEDs: on, off, flashing, or alternating.")
@click.option("--red", type=click.IntRange(0, 3), default=0, help="The red LED that is on; 0 for none.")
@click.option("--read-pointer", metavar="HEX", help="The long at 4n810500.")
@click.option("--write-pointer", metavar="HEX", help="The long at 4n810504.")
@click.option("--alarm", "number", metavar="NUMBER", help="The alarm on the screen.")
@click.option("--capture", type=click.Path(path_type=Path), metavar="FILE", help="A capture of the line.")
def diagnose_command(
    params: Path | None,
    green: str | None,
    red: int,
    read_pointer: str | None,
    write_pointer: str | None,
    number: str | None,
    capture: Path | None,
) -> int:
    """Find out why an operation does not start or does not go on, by the maker's own procedure (12.2).

    Say what is known; it says which case that is, or what to look at next. The exit status is 1 while the case is open.
    """
    seen = Seen(
        parameters=parameters_of(params).parameters if params else None,
        green=read_leds(green) if green else (),
        red=Red(red),
        pointers=_pointers(read_pointer, write_pointer),
        alarm=alarm_named(number).number if number else None,
        recording=heard_in(capture) if capture else (),
    )
    diagnosis = diagnose(seen)
    for step in diagnosis.steps:
        click.echo(f"- {step}")
    click.echo(f"case: {diagnosis.case.value}")
    for place, remedy in enumerate(diagnosis.remedies, 1):
        click.echo(f"{_INDENT}{place}. {remedy}")
    return NOT_COMPLETE if diagnosis.case is Case.UNKNOWN else COMPLETE


def _pointers(read_pointer: str | None, write_pointer: str | None) -> tuple[int, int] | None:
    if read_pointer is None and write_pointer is None:
        return None
    if read_pointer is None or write_pointer is None:
        raise UsageError("--read-pointer and --write-pointer say something only together")
    if not all(map(_LONG.fullmatch, (read_pointer, write_pointer))):
        raise UsageError(f"{read_pointer}, {write_pointer}: hexadecimal numbers of at most eight digits are expected")
    return int(read_pointer, 16), int(write_pointer, 16)
