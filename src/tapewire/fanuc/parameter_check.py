"""What is wrong with the parameters of a machine, and when a changed one takes effect (B-63322EN-1/01 10, 11, 12.2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from tapewire.errors import UsageError
from tapewire.fanuc.alarms import ALARMS, AlarmNumber
from tapewire.fanuc.parameters import (
    CATALOGUE,
    LINE_NUMBERS,
    MOST_AXES,
    REMOTE_BUFFER_DEVICE,
    UNIT_TIMES_MS,
    Interface,
    Parameter,
    ParameterSet,
    PowerRule,
)

__all__ = ["Finding", "ParameterMemory", "Weight", "check", "refuse_unusable"]

_DEVICES = (20, 21, 22, 23)


class Weight(StrEnum):
    """How bad a finding is."""

    ALARM = "alarm"
    """The control raises SR807."""
    ERROR = "error"
    """The control may not complain, but no transfer can come of it."""
    WARNING = "warning"
    """Beyond what the manual allows, or work for the host to do first."""
    NOTE = "note"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing to know about a set of parameters. `number` is the parameter, None for the line as a whole."""

    weight: Weight
    text: str
    number: int | None = None

    def __str__(self) -> str:
        return f"{ALARMS[AlarmNumber.SR807].number}: {self.text}" if self.weight is Weight.ALARM else self.text


def check(
    parameters: ParameterSet, board: Interface | None, *, controlled_axes: int = MOST_AXES
) -> tuple[Finding, ...]:
    """Everything in `parameters` that a control with this remote buffer `board` would not take.

    `board` None: no remote buffer is fitted, or its option is missing. What was not told is not complained of.
    """
    return (
        *_ranges(parameters, board, controlled_axes),
        *_fixed_bits(parameters),
        *_devices(parameters, board),
        *_unit_time(parameters),
    )


def refuse_unusable(findings: tuple[Finding, ...]) -> None:
    """Raises UsageError with every alarm and error among `findings`."""
    fatal = [str(finding) for finding in findings if finding.weight in (Weight.ALARM, Weight.ERROR)]
    if fatal:
        raise UsageError("; ".join(fatal))


def _ranges(parameters: ParameterSet, board: Interface | None, controlled_axes: int) -> Iterator[Finding]:
    required = set() if board is None else set(LINE_NUMBERS[board]) - {LINE_NUMBERS[board].specification}
    for number, value in sorted(parameters.values.items()):
        record = CATALOGUE[number]
        high = controlled_axes if number == 7635 else record.high
        if not record.low <= value <= high:
            weight = Weight.ALARM if number in required else Weight.ERROR
            yield Finding(weight=weight, number=number, text=_out_of_range(record, value, high))


def _out_of_range(record: Parameter, value: int, high: int) -> str:
    return f"No. {record.number:04d} ({record.title}) is {value}: {record.low} to {high} is expected"


def _fixed_bits(parameters: ParameterSet) -> Iterator[Finding]:
    for number in sorted(parameters.values):
        for bit in CATALOGUE[number].bits:
            if bit.must_be_zero and parameters.bit(number, bit.position):
                text = f"No. {number:04d}#{bit.position} is 1: this bit must always be 0"
                yield Finding(weight=Weight.ERROR, number=number, text=text)


def _devices(parameters: ParameterSet, board: Interface | None) -> Iterator[Finding]:
    for number in _DEVICES:
        if board is None and parameters.get(number) == REMOTE_BUFFER_DEVICE:
            text = f"No. {number:04d} is {REMOTE_BUFFER_DEVICE}, the remote buffer, which is not fitted"
            yield Finding(weight=Weight.ALARM, number=number, text=text)


def _unit_time(parameters: ParameterSet) -> Iterator[Finding]:
    if parameters.unit_time_ms is None:
        bits = f"{parameters.values[7618] & 0b111:03b}"
        known = ", ".join(f"{code:03b} is {time_ms} ms" for code, time_ms in UNIT_TIMES_MS.items())
        text = f"No. 7618 has TM2 TM1 TM0 = {bits}, which is no unit time: {known}"
        yield Finding(weight=Weight.ERROR, number=7618, text=text)


class ParameterMemory:
    """The parameters inside a control: what was entered, and what is in force.

    10: some take effect only after power off and on. 10.2: 5000#0 is set by the system from the board it finds.
    """

    def __init__(self, parameters: ParameterSet, board: Interface | None) -> None:
        self._board = board
        self.entered = parameters
        self.in_force = parameters
        self.power_off_and_on()

    def power_off_and_on(self) -> None:
        if self._board is not None:
            byte = self.entered.values.get(5000, 0) & ~1 | (self._board is Interface.RS_422)
            self.entered = self.entered.with_values({5000: byte})
        self.in_force = self.entered

    def enter(self, number: int, value: int) -> PowerRule:
        """The operator enters a value; when it takes effect. Raises UsageError for one the control does not take.

        A value out of range is taken where SR807 is what becomes of it (chapter 11).
        """
        record = CATALOGUE.get(number)
        if record is None:
            raise UsageError(f"No. {number:04d} is no parameter of the remote buffer")
        changed = ParameterSet({number: value})
        refuse_unusable(tuple(finding for finding in check(changed, self._board) if finding.weight is Weight.ERROR))
        rule = self._rule(record)
        self.entered = self.entered.with_values(changed.values)
        if rule is PowerRule.AT_ONCE:
            self.in_force = self.in_force.with_values(changed.values)
        return rule

    @property
    def waiting(self) -> tuple[int, ...]:
        """Numbers whose entered value waits for power off and on."""
        return tuple(
            number for number, value in sorted(self.entered.values.items()) if self.in_force.get(number) != value
        )

    def _rule(self, record: Parameter) -> PowerRule:
        """10.2, the notes of 5000#3, 5074 and 5084: with protocol A, or when reset and alarm are posted."""
        if record.power is not PowerRule.BY_PROTOCOL:
            return record.power
        interface = record.interface
        assert interface is not None
        uses_a = self.in_force.get(LINE_NUMBERS[interface].protocol) == 3
        delayed = uses_a or self.in_force.bit(5000, 3)
        return PowerRule.POWER_OFF_AND_ON if delayed else PowerRule.AT_ONCE
