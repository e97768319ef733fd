"""What was said on a line, in the words of its protocol, and what of it was against the rules."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from tapewire.codes import name_of
from tapewire.engine import SECOND, Nanos
from tapewire.line.captures.records import ALL_ON, FAULTS, FROM_THIS_SIDE, Happening, Lines, Record, Side, recalled
from tapewire.protocols import ProtocolEntry, Reader
from tapewire.protocols.listening import Listener, Word
from tapewire.protocols.settings import End
from tapewire.sim.transcript import quote
from tapewire.transfer.decoding.entry import Entry, Kind

__all__ = ["Dialogue", "Spoken"]

SILENCE: Final[Nanos] = 2 * SECOND
"""A run of program bytes ends when nothing more comes for so long, so that a stall can be seen."""

SHOWN: Final = 13
"""Bytes of a run that are kept: one more than is shown, so that it can be seen to go on."""

TEXT: Final = frozenset((*range(0x20, 0x7F), *range(0x80, 0x100), 0x09, 0x0A, 0x0D))
"""What is taken for text where the protocol is not known."""

_OF_ONE_SIDE: Final = {Happening.SENT, Happening.SENT_ALL}
_OF_THE_OTHER: Final = {Happening.RECEIVED, Happening.RECEIVED_ALL}
_END: Final = {Side.HOST: End.HOST, Side.CONTROL: End.CONTROL}
_NAMES: Final = {line: str(line.name) for line in Lines}


@dataclass(frozen=True, slots=True, kw_only=True)
class Spoken:
    """How a stream is read: the protocol and its parameters, None for characters as they are, and who wrote it."""

    protocol: ProtocolEntry | None
    params: Any
    side: Side

    def readers(self) -> dict[Side, Reader]:
        if self.protocol is None:
            return {Side.HOST: _plain, Side.CONTROL: _plain}
        host, control = self.protocol.words(self.params)
        return {Side.HOST: host, Side.CONTROL: control}

    def listener(self) -> Listener | None:
        return None if self.protocol is None else self.protocol.listener(self.params)


def _plain(data: bytes) -> list[Word]:
    words: list[Word] = []
    for byte in data:
        if byte not in TEXT:
            words.append(name_of(byte).split()[0])
        elif words and isinstance(words[-1], bytes):
            words[-1] += bytes([byte])
        else:
            words.append(bytes([byte]))
    return words


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


@dataclass(slots=True)
class _Run:
    """Program bytes that follow one another."""

    side: Side
    began: Nanos
    ended: Nanos
    count: int
    shown: bytes


class Dialogue:
    """Makes entries of records. Holds the run of program bytes that has not ended, and nothing that grows."""

    def __init__(self, spoken: Spoken) -> None:
        self._side = spoken.side
        self._readers = spoken.readers()
        self._listener = spoken.listener()
        self._run: _Run | None = None
        self._began: dict[Side, Nanos] = {}
        self._lines: Lines | None = None
        self._while_off = 0
        self.characters = {Side.HOST: 0, Side.CONTROL: 0}
        self.faults: Counter[str] = Counter()
        self.violations = 0

    @property
    def evidence(self) -> int:
        """How much speaks for the protocol."""
        return 0 if self._listener is None else self._listener.evidence

    def feed(self, record: Record) -> Iterator[Entry]:
        """The entries that `record` completes."""
        yield from self._look_at_lines(record)
        if record.what in FAULTS:
            yield from self._fault(record)
        elif record.what in _OF_ONE_SIDE and record.data:
            yield from self._handed_over(record)
            yield from self._said(self._side, record)
        elif record.what in _OF_THE_OTHER and record.data:
            yield from self._said(self._side.other, record)
        elif (note := self._note(record)) is not None:
            yield from self._alone(Kind.NOTE, record.at, note)

    def finish(self) -> Iterator[Entry]:
        """The run that has not ended; one that goes on after that is told as another."""
        yield from self._end_run()

    def summary(self) -> list[str]:
        """Figures of all of it."""
        counts = ", ".join(f"{count:,} from the {side}" for side, count in self.characters.items())
        said = [f"{counts} (characters)"]
        said += [] if self._listener is None else self._listener.summary()
        said += [f"{what}: {_counted(count, 'character')}" for what, count in sorted(self.faults.items())]
        said.append(_counted(self.violations, "violation") if self.violations else "no violations")
        return said

    def _said(self, side: Side, record: Record) -> Iterator[Entry]:
        at = record.at
        self.characters[side] += len(record.data)
        began = self._began.setdefault(side, at)
        words = self._readers[side](record.data)
        for word in words:
            if isinstance(word, bytes):
                yield from self._extend(side, word, began, at)
            else:
                yield from self._end_run()
                yield Entry(kind=Kind.SAID, at=began, until=at, text=word, side=side)
            yield from self._judge(side, word, began, at)
        if words:
            del self._began[side]

    def _judge(self, side: Side, word: Word, began: Nanos, at: Nanos) -> Iterator[Entry]:
        if self._listener is not None:
            for wrong in self._listener.heard(_END[side], word, began, at):
                yield from self._violation(at, wrong)

    def _extend(self, side: Side, data: bytes, began: Nanos, at: Nanos) -> Iterator[Entry]:
        run = self._run
        if not data:
            return
        if run is not None and run.side is side and at - run.ended < SILENCE:
            run.ended, run.count = at, run.count + len(data)
            run.shown = (run.shown + data)[:SHOWN]
            return
        yield from self._end_run()
        self._run = _Run(side, began, at, len(data), data[:SHOWN])

    def _end_run(self) -> Iterator[Entry]:
        run, self._run = self._run, None
        if run is not None:
            yield Entry(
                kind=Kind.PROGRAM, at=run.began, until=run.ended, text=quote(run.shown), side=run.side, count=run.count
            )

    def _look_at_lines(self, record: Record) -> Iterator[Entry]:
        before, self._lines = self._lines, record.lines
        if before is None:
            before = ALL_ON
        changed = before ^ record.lines
        if changed & Lines.CTS:
            self._while_off = 0
        if changed:
            said = (f"{_NAMES[line]} {'ON' if line in record.lines else 'OFF'}" for line in Lines if line in changed)
            yield from self._alone(Kind.SIGNALS, record.at, ", ".join(said))

    def _handed_over(self, record: Record) -> Iterator[Entry]:
        """Whoever wrote the capture saw CTS OFF when it handed these over."""
        if Lines.CTS in record.lines:
            return
        first, self._while_off = not self._while_off, self._while_off + len(record.data)
        if first:
            yield from self._violation(record.at, f"the {self._side} sends while its CTS is OFF")

    def _fault(self, record: Record) -> Iterator[Entry]:
        fault = FAULTS[record.what]
        self.faults[str(fault)] += max(1, len(record.data))
        read = f": {' '.join(name_of(byte) for byte in record.data[:4])}" if record.data else ""
        side = self._side if record.remark == FROM_THIS_SIDE else self._side.other
        yield from self._alone(Kind.FAULT, record.at, f"{fault}{read}", side)

    def _note(self, record: Record) -> str | None:
        if count := recalled(record.remark):
            return f"the last {count} characters were called back and never left"
        match record.what:
            case Happening.DATA_LOST:
                return f"missing from the capture: {record.remark or 'nobody knows how much'}"
            case Happening.COMPLETE:
                return f"the end of the line: {record.remark}" if record.remark else "the end of the line"
            case _:
                return record.remark or None

    def _violation(self, at: Nanos, text: str) -> Iterator[Entry]:
        self.violations += 1
        yield from self._alone(Kind.VIOLATION, at, text)

    def _alone(self, kind: Kind, at: Nanos, text: str, side: Side | None = None) -> Iterator[Entry]:
        yield from self._end_run()
        yield Entry(kind=kind, at=at, until=at, text=text, side=side)
