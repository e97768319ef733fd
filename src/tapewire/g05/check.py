"""What is wrong with the G05 sections of an NC program, and what they would do (B-63322EN-1 chapter 9).

The program is read once, in constant memory. Nothing is repaired and nothing is passed over: every record is looked at,
the first faults of each section are named and the others counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tapewire.g05.layout import SIGNIFICANT, IncrementSystem, Layout, RecordFormat, UnitTime, required_baud
from tapewire.g05.limits import Axis, Machine
from tapewire.g05.modes import ModalWatch
from tapewire.g05.motion import Motion, Sketch
from tapewire.g05.reading import DECISION_BYTES, Pieces, found_layout
from tapewire.g05.records import Records, decode_as_they_are, faults
from tapewire.g05.sections import BlockWatch, ExitFinder, find_g05_with_point, has_odd_byte

__all__ = ["Asked", "AxisMotion", "Checked", "SectionChecked", "check"]

LONGEST_LINE: Final = 4096
"""A text without LF must not end up in memory; its modes are then looked for in its end."""
MOST_NAMED: Final = 20
MOST_SECTIONS: Final = 1000
"""More sections than this are checked and counted, and no longer listed one by one."""
FEW_RECORDS: Final = 16
"""So many of the general format have an odd byte, but by a chance below one in 65,000."""
END_CODES: Final = (0x0D, 0x8D, 0x03)
"""CR in ASCII and in ISO, ETX (4.2): what ends every message of protocol A."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What the user knows of the control. `layout` and `machine` None: found, or numbered."""

    layout: Layout | None = None
    machine: Machine | None = None
    increments: IncrementSystem = IncrementSystem.IS_B
    unit_time: UnitTime = UnitTime.MS_8
    baud: int | None = None
    protocol: str | None = None
    pictured: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMotion:
    """What one axis does in a section, in its units; `lowest` and `highest` count from where it stands before."""

    name: str
    unit: str
    travel: float
    lowest: float
    highest: float
    velocity: float
    acceleration: float
    jerk: float


@dataclass(slots=True, kw_only=True)
class SectionChecked:
    """One section. Peaks are lists by axis in units a second, a second squared and cubed, of the records."""

    line: int
    offset: int
    """Of its first record in the file."""
    layout: Layout
    assumed: str
    """How the layout was found, where it was not given."""
    records: int = 0
    seconds: float = 0.0
    ended: bool = False
    fault_count: int = 0
    auxiliary_count: int = 0
    end_codes: dict[str, int] = field(default_factory=dict)
    axes: list[AxisMotion] = field(default_factory=list)
    required_baud: int = 0
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class Checked:
    """A whole program. It is sound when it holds a section and `problem_count` is 0."""

    sections: list[SectionChecked] = field(default_factory=list)
    section_count: int = 0
    problem_count: int = 0
    problems: list[str] = field(default_factory=list)
    """Of the text around the sections; they are in `problem_count`."""
    sketch: Sketch | None = None

    @property
    def sound(self) -> bool:
        return self.section_count > 0 and not self.problem_count


def check(read: Callable[[int], bytes], asked: Asked) -> Checked:
    """Read a program to its end. Raises ProgramError for a section whose records cannot even be guessed."""
    return _Checker(Pieces(read), asked).run()


class _Checker:
    def __init__(self, source: Pieces, asked: Asked) -> None:
        self._source = source
        self._asked = asked
        self._watch = BlockWatch()
        self._modes = ModalWatch()
        self._text = _Text()
        self._checked = Checked()

    def run(self) -> Checked:
        while data := self._source.piece():
            begins = self._watch.feed(data)
            line = self._source.line - data.count(b"\n")
            block = self._text.take(data if begins is None else data[:begins], line, self._modes)
            if begins is not None:
                self._source.give_back(data[begins:])
                self._section(block)
        if self._text.point_line:
            self._checked.problem_count += 1
            self._checked.problems.append(
                f"line {self._text.point_line}: G05 with a decimal point is not taken for G05, which has none (9.1): "
                "what follows it is read as text here; write G05"
            )
        return self._checked

    def _section(self, block: bytes) -> None:
        section = _Section(self._asked, self._source.line - 1, self._source.offset)
        if self._modes.forbidden:
            modes = ", ".join(self._modes.forbidden)
            section.problem(f"G05 in a mode in which it is an alarm, SR891: {modes} (9.3 note 2)")
        if self._text.end_line:
            section.problem(
                f"% in line {self._text.end_line} ends the data for the control (EOR), in a comment too: it never gets "
                "here"
            )
        if self._text.blocks == 1:
            section.notes.append(
                "G05 is the first block, which the control passes over (label skip): `send` puts % and an EOB before "
                "it, and with --raw the records would be read as text"
            )
        if block.endswith(b"\r\n"):
            section.notes.append("the block G05 ends with CR LF: `send` drops the CR before the records")
        head = self._source.at_least(DECISION_BYTES)
        section.begin(head)
        self._source.give_back(head)
        rest = None
        while rest is None and (data := self._source.piece()):
            rest = section.take(data)
        if rest is None:
            section.problem("the file ends without the exit record (zeros): cut off, or its records are made otherwise")
        else:
            self._source.give_back(rest)
        self._close(section)

    def _close(self, section: _Section) -> None:
        report, checked = section.report(), self._checked
        checked.section_count += 1
        checked.problem_count += section.problem_count
        if len(checked.sections) < MOST_SECTIONS:
            checked.sections.append(report)
        checked.sketch = checked.sketch or section.sketch


class _Text:
    """The text around the sections, as the control takes it: label skip at its beginning, EOR at its end."""

    def __init__(self) -> None:
        self.blocks = 0
        """How many have ended."""
        self.end_line = 0
        """Of the first % behind label skip; 0 while none has come."""
        self.point_line = 0
        """Of the first block that is G05 with a decimal point."""
        self._label_skip = True
        self._rest = b""

    def take(self, data: bytes, line: int, modes: ModalWatch) -> bytes:
        """`data` begins in `line`. Returns the end of it from the last EOB but one."""
        if not self.end_line:
            self._look_for_end(data, line)
        joined = self._rest + data
        cut = joined.rfind(b"\n") + 1
        blocks, self._rest = joined[:cut], joined[cut:][-LONGEST_LINE:]
        self.blocks += blocks.count(b"\n")
        modes.feed(blocks)
        if not self.point_line and (at := find_g05_with_point(blocks)) is not None:
            self.point_line = line + blocks.count(b"\n", 0, at)
        return blocks[blocks.rfind(b"\n", 0, max(len(blocks) - 1, 0)) + 1 :]

    def _look_for_end(self, data: bytes, line: int) -> None:
        begin = 0
        if self._label_skip:
            begin = data.find(b"\n") + 1
            self._label_skip = not begin
        if not self._label_skip and (at := data.find(b"%", begin)) >= 0:
            self.end_line = line + data.count(b"\n", 0, at)


class _Section:
    def __init__(self, asked: Asked, line: int, offset: int) -> None:
        self.notes: list[str] = []
        self.problem_count = 0
        self._problems: list[str] = []
        self._asked = asked
        self._line, self._offset = line, offset
        self._partial = b""

    def problem(self, words: str) -> None:
        self.problem_count += 1
        if len(self._problems) < MOST_NAMED:
            self._problems.append(words)

    def begin(self, head: bytes) -> None:
        """Settle how the records are made."""
        layout, assumed = self._asked.layout, ""
        if layout is None:
            layout, assumed = found_layout(head, len(head) < DECISION_BYTES, self._line)
        elif head[:2] == b"\r\r":
            self.problem("two CR behind the EOB of G05 are read as data: end the block with a single LF")
        machine = self._asked.machine or Machine(
            axes=tuple(Axis(name=f"axis {number}") for number in range(1, layout.axis_count + 1)),
            increments=self._asked.increments,
        )
        self._work = _Work(self, layout, assumed, machine, self._asked)

    @property
    def sketch(self) -> Sketch | None:
        return self._work.sketch

    def take(self, data: bytes) -> bytes | None:
        """What stands behind the section, or None while it goes on."""
        end = self._work.finder.feed(data)
        size = self._work.layout.record_bytes
        joined = self._partial + (data if end is None else data[:end])
        whole = len(joined) // size * size
        self._partial = joined[whole:]
        self._work.look(joined[:whole] if end is None else joined[: whole - size])
        if end is None:
            return None
        self._work.ended = True
        return data[end:]

    def report(self) -> SectionChecked:
        report = self._work.report(self._line, self._offset)
        report.problems, report.notes = self._problems, self.notes + report.notes
        report.fault_count = self._work.fault_count
        return report


class _Work:
    """The records of one section, piece by piece."""

    def __init__(self, section: _Section, layout: Layout, assumed: str, machine: Machine, asked: Asked) -> None:
        self.layout = layout
        self.ended = False
        self.fault_count = 0
        self.finder = ExitFinder(layout.record_bytes)
        self.sketch = Sketch(machine, asked.unit_time / 1000) if asked.pictured else None
        self._section, self._assumed, self._machine, self._asked = section, assumed, machine, asked
        self._motion = Motion(layout.axis_count)
        self._auxiliary = 0
        self._all_even = True
        self._end_codes = dict.fromkeys(END_CODES, 0)

    def look(self, data: bytes) -> None:
        if not data:
            return
        for index, what in faults(data, self.layout):
            self.fault_count += 1
            self._section.problem(f"record {self._motion.records + index + 1:,}: {what}")
        records = decode_as_they_are(data, self.layout)
        if records.auxiliary is not None:
            self._look_for_standstill(records)
            self._auxiliary += int((records.auxiliary >= SIGNIFICANT).sum())
        self._motion.add(records.travel)
        if self.sketch is not None:
            self.sketch.add(records.travel)
        self._all_even = self._all_even and not has_odd_byte(data)
        for code in END_CODES:
            self._end_codes[code] += data.count(code)

    def _look_for_standstill(self, records: Records) -> None:
        assert records.auxiliary is not None
        still = ~records.travel.any(axis=1) & (records.auxiliary <= np.uint32(SIGNIFICANT))
        for index in np.flatnonzero(still):
            self._section.problem(
                f"record {self._motion.records + int(index) + 1:,}: no travel, and no significant auxiliary "
                "function but 0: whether the control leaves binary input operation here is not stated"
            )

    def report(self, line: int, offset: int) -> SectionChecked:
        self._motion.finish()
        asked, layout = self._asked, self.layout
        needed = required_baud(layout, asked.unit_time)
        report = SectionChecked(line=line, offset=offset, layout=layout, assumed=self._assumed)
        report.records, report.ended, report.required_baud = self._motion.records, self.ended, needed
        report.seconds = self._motion.records * asked.unit_time / 1000
        report.auxiliary_count = self._auxiliary
        report.end_codes = {f"{code:02X}h": count for code, count in self._end_codes.items() if count}
        report.axes = self._axes()
        if asked.baud is not None and asked.baud < needed:
            self._section.problem(
                f"the line at {asked.baud:,} baud is too slow: {needed:,} are needed at a unit time of "
                f"{asked.unit_time.value} ms (9.2)"
            )
        if asked.protocol == "fanuc-a" and layout.format is RecordFormat.GENERAL:
            self._section.problem("protocol A carries the special format only (9.1 (5) note)")
        if report.end_codes and layout.format is RecordFormat.GENERAL:
            report.notes.append("end codes of protocol A stand among the records: it cannot carry them")
        if self._all_even and layout.format is RecordFormat.GENERAL and report.records >= FEW_RECORDS:
            report.notes.append(
                "no byte of its records is odd: they look like the special format (7609#2 = 0), in which the travel is "
                "another"
            )
        if not self._motion.records:
            self._section.problem("the section holds no record: the control leaves binary input operation at once")
        return report

    def _axes(self) -> list[AxisMotion]:
        velocity, acceleration, jerk = self._motion.peaks(self._machine, self._asked.unit_time / 1000)
        per_unit, motion = self._machine.per_unit, self._motion
        return [
            AxisMotion(
                name=axis.name,
                unit=str(axis.unit),
                travel=float(motion.position[index] / per_unit[index]),
                lowest=float(motion.lowest[index] / per_unit[index]),
                highest=float(motion.highest[index] / per_unit[index]),
                velocity=float(velocity[index]),
                acceleration=float(acceleration[index]),
                jerk=float(jerk[index]),
            )
            for index, axis in enumerate(self._machine.axes)
        ]
