"""The control behind the remote buffer as its communication sees it: one operation, and the buffer (B-63322EN-1 8.2,
12.2).
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from tapewire.codes import DataCode
from tapewire.engine import Ended, Events, Notice, Outcome, Violation
from tapewire.fanuc.tape import TapeScanner
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_a.status import Parameters

__all__ = ["BUFFER_BYTES", "Job", "Phase"]

BUFFER_BYTES: Final = 8192
"""Size of the remote buffer (12.2)."""


class Phase(Enum):
    """Where the operation stands."""

    NONE = "no operation"
    WAITING = "it waits for the line to be initialised"
    READING = "the control reads"
    CLOSING = "it is over, and the host is still to hear of it"


class Job:
    """One operation at a time, from cycle start until the host has been told of its end.

    `received` and `taken` count bytes of program, with EOR, into the buffer and out of it.
    """

    def __init__(self, events: Events, code: DataCode, record_bytes: int | None = None) -> None:
        self._events = events
        self._code = code
        self._record_bytes = record_bytes
        self._buffer = bytearray()
        self._end: Ended | None = None
        self._begin(Phase.NONE)

    def _begin(self, phase: Phase) -> None:
        self.phase = phase
        self.started = False
        self.received = 0
        self.taken = 0
        self.program_ended = False
        self.read_whole = False
        """As `program_ended`, until RESET."""
        self.no_more = False
        """GTD does not go out: the host has nothing more for it."""
        self._scanner = TapeScanner(self._code, self._record_bytes)
        self._after_eor = 0
        self._said_after_eor = False
        self._said_after_end = False
        self._buffer.clear()

    def begin(self) -> None:
        self._begin(Phase.WAITING)

    def link_up(self) -> None:
        """The line is initialised. A host that begins anew is not asked for what is here already."""
        if self.phase is Phase.WAITING:
            self.phase = Phase.READING
        self.no_more = self._scanner.ended

    def link_down(self) -> None:
        """The line is to be initialised anew; nothing of the program has been asked for yet."""
        assert not self.received
        self.phase = Phase.WAITING

    # the buffer

    @property
    def buffered(self) -> int:
        return len(self._buffer)

    @property
    def held(self) -> bytes:
        return bytes(self._buffer)

    @property
    def free(self) -> int:
        return BUFFER_BYTES - len(self._buffer)

    @property
    def room(self) -> int:
        """What can be taken in: everything, when it is not kept."""
        return self.free if self.stores else BUFFER_BYTES

    @property
    def stores(self) -> bool:
        """Data that comes in belongs to the program."""
        return self.phase is Phase.READING and not self._scanner.ended

    @property
    def runs(self) -> bool:
        return self.phase in (Phase.WAITING, Phase.READING)

    @property
    def complete(self) -> bool:
        """The control has read the whole program, and the host is still to hear of it."""
        return self._end is not None and self._end.outcome is Outcome.COMPLETE

    @property
    def safe(self) -> bool:
        """The whole program is here: the control reads the rest of it without the host."""
        return self._scanner.ended and (self.phase is Phase.READING or self.complete)

    @property
    def operating(self) -> bool:
        """State 2 of SAT. GTD goes out once more when EOR is here: EOD answers what it was made for (4.4.1)."""
        return self.phase is Phase.READING or (self.complete and not self.no_more)

    def store(self, data: bytes, parameters: Parameters) -> None:
        """The data of a DAT or of a packet as transmitted (4.4.2 1) note, 8.2). It fits: the caller has looked."""
        if not self.stores:
            self._ignore(len(data))
            return
        if parameters.convert_from != parameters.convert_to:
            data = data.replace(bytes([parameters.convert_from]), bytes([parameters.convert_to]))
        end = self._scanner.feed(data)
        part, rest = data[:end], data[len(data) if end is None else end :]
        self._buffer += part
        assert len(self._buffer) <= BUFFER_BYTES
        self.received += len(part)
        if not (parameters.n and _is_padding(rest)):
            self._after_eor += len(rest)

    def _ignore(self, count: int) -> None:
        """8.2: all data after EOR is ignored."""
        if self._said_after_eor:
            # One answer that holds data instead of EOD must do: a host that sends another program is not to lose it.
            self.no_more = True
        if self.safe:
            self._after_eor += count
        elif count and self.phase is Phase.NONE:
            self._events.put(Violation(what="NC data that no program is read from: ignored", count=count))

    def take(self, count: int, *, connected: bool) -> bytes:
        """Out of the buffer. While not `connected` the host cannot be told that the end was read."""
        if self.phase is not Phase.READING or count <= 0:
            return b""
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        self.taken += len(data)
        if self._scanner.ended and not self._buffer and not self.program_ended:
            self.program_ended = self.read_whole = True
            self.finish(Outcome.COMPLETE, "the program has been read to its EOR")
            if not connected:
                self.let_go()
        return data

    def clear(self) -> None:
        """CLB: what is in the buffer is gone, and an EOR among it too."""
        count = len(self._buffer)
        self._buffer.clear()
        if count and self.phase is Phase.READING:
            self._events.put(Notice(text=f"CLB: {count} bytes are gone that the control had not read"))
            self._scanner.ended = False
            self.no_more = self._said_after_eor = False

    def lose_buffer(self) -> None:
        """8.2: in DNC operation a CNC reset loses what was received."""
        self._buffer.clear()
        self.read_whole = False

    # its end

    def finish(self, outcome: Outcome, reason: str) -> None:
        """The operation is over. It ends when the host has answered what tells it so: SAT, RST or ALM."""
        assert self.runs
        self.phase = Phase.CLOSING
        self._end = Ended(outcome=outcome, reason=reason, bytes_low=self.taken, bytes_high=self.received)
        self._said_after_end = False
        if self._after_eor:
            self._events.put(Notice(text=f"{self._after_eor} characters after EOR were ignored (8.2)"))

    def spoke(self, command: Command) -> None:
        """Something new is said to the host. GTD tells it nothing of an end."""
        self._said_after_eor = self.safe
        self._said_after_end = self._end is not None and command is not Command.GTD

    def answered(self) -> None:
        """The host has given a good answer to what was said last."""
        if self.complete and self._said_after_eor:
            self.no_more = True
        if self._said_after_end:
            self.let_go()

    def exhausted(self) -> None:
        """EOD. Before EOR has come in the control still wants data: it asks again, but not before the next SAT."""
        self.no_more = True

    def session_ended(self) -> None:
        """The end packet: what EOD says, when the program ended in it or before it."""
        self.no_more = self.safe

    def ask_again(self) -> None:
        """A SAT was answered."""
        if not self._scanner.ended:
            self.no_more = False

    def let_go(self) -> None:
        """The operation ends here, if it is over, whether the host has heard of it or not."""
        if self._end is None:
            return
        end, self._end = self._end, None
        self.phase = Phase.NONE
        self._events.put(end)


def _is_padding(data: bytes) -> bool:
    """One byte over and over, which fills the last packet (5.2)."""
    return not data.strip(data[:1])
