"""The host's packets in expansion protocol A (B-63322EN-1 5.2, 5.3): what to send next, and what to send again.

    cnc   GTD
    host  packet 30, packet 31, ...     without waiting
    cnc   NAK 31                        it arrived damaged, or did not arrive
    host  packet 31, packet 32, ...     once the packet under way is finished
    host  packet FF                     the end packet, with the last data

Nothing says that a packet has arrived. A number comes round every ten packets, so what has been handed over must stay
well under nine: never more than the packet under way.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

from tapewire.protocols.fanuc_a.host_job import Job, Supply, end_of_record
from tapewire.protocols.fanuc_a.host_outbox import Span
from tapewire.protocols.fanuc_a.packets import (
    END_NUMBER,
    FIRST_NUMBER,
    NUMBERS,
    data_bytes,
    encode_packet,
)
from tapewire.protocols.fanuc_a.params import Params

__all__ = ["KEPT_PACKETS", "PacketStream"]

KEPT_PACKETS: Final = len(NUMBERS)
"""A NAK names one of the last ten: an older packet has the number of a younger one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kept:
    wire: bytes
    span: Span


class PacketStream:
    """One transfer by packets, from GTD to the end packet. Packets are counted from 0; number 30h + count mod 10.

    Without a job it has nothing but invalid packets to send.
    """

    def __init__(self, n: int, params: Params, job: Job | None) -> None:
        self._n = n
        self._params = params
        self._size = data_bytes(n)
        self._kept: dict[int, _Kept] = {}
        self._built = 0
        self._position = 0
        self._sent = self._sent_before = 0
        """Packets that have gone out, or begun to; the same without the one given out last."""
        self._given: int | None = None
        self._asked_again: Counter[int] = Counter()
        self._proven = 0
        self._end_built = False
        self._suspect: int | None = None
        self._went_back: int | None = None
        self.job = job
        self.held = False
        """By DC3, or because a monitor packet could not be read."""
        self.stopped = False
        """By CAN."""
        self.end_begun = False
        """The end packet, true or dummy, has been given out to be sent."""
        self.late = False
        """The source had nothing when it was last asked."""
        self.verdict_due = False
        """The packet given out last may draw a NAK although nothing is missing."""
        self.problem = ""
        """Why the job cannot go on; empty while it can."""

    @classmethod
    def end_only(cls, n: int, params: Params) -> PacketStream:
        """A transfer of one packet that holds EOR: there is nothing left to send."""
        stream = cls(n, params, None)
        stream._build(END_NUMBER, end_of_record(params.data))
        return stream

    @property
    def proven(self) -> int:
        """Bytes of the program that stand before a packet that was asked for, or could no longer be asked for when the
        control last said DC3 or DC1. Silence proves nothing: after an open-line error a control hears no packets and
        says so to nobody (4.6 1)).
        """
        return self._proven

    def control_is_there(self) -> None:
        """DC3, DC1: the control takes packets in, so what it can no longer ask for it has."""
        oldest = next(iter(self._kept.values()), None)
        if oldest is not None:
            self._proven = max(self._proven, oldest.span.base)

    def give_up(self) -> None:
        """No more of the program is sent, new or again."""
        self.job = None
        self.problem = self.problem or "given up"

    def next(self) -> tuple[bytes, Span | None] | None:
        """What to send after the packet before has gone; None for nothing now."""
        self.late = False
        if self.stopped:
            return None if self.end_begun else self._dummy_end()
        if self.held or self.problem:
            return None
        if self._position == self._built and not self._build_next():
            return None
        kept = self._kept[self._position]
        self.verdict_due = self._position == self._suspect
        self._suspect = None
        self._given = self._position
        self._position += 1
        self._sent_before, self._sent = self._sent, max(self._sent, self._position)
        self.end_begun = kept.wire[0] == END_NUMBER
        return kept.wire, kept.span

    def take_back(self) -> None:
        """What was given out last has not been begun: it is not sent, or sent later."""
        if self._given is not None:
            self._position = self._given
            self._sent = self._sent_before
        self._given = None
        self.end_begun = False

    def invalid(self) -> bytes | None:
        """A packet that only says that we are there (5.2 2) c)); None when it would not be in order."""
        if self.held or self.stopped or self.end_begun:
            return None
        self._given = None
        return encode_packet(self._params.invalid, bytes([self._params.pad]) * self._size, self._n)

    def go_back(self, number: int | None, most: int, *, under_way: bool) -> str | None:
        """NAK: send again from packet `number` on. Returns why that is impossible.

        What arrives twice draws NAK for the one behind it, and if that finds the one behind it sent too, each packet to
        the end goes out twice. So a packet is suspected that is asked for while it is `under_way`, or right behind the
        one that was asked for before: nothing follows it until NAK has had the time to come.
        """
        self.held = False
        self.verdict_due = False
        if self.stopped:
            return None
        if number is None or number not in NUMBERS:
            return f"NAK for packet {number or 0:02X}h, which is no number of a packet"
        count = self._youngest(number)
        if count is None:
            return f"NAK for packet {number:02X}h, which was not sent"
        self._asked_again[count] += 1
        if self._asked_again[count] > most:
            return f"packet {number:02X}h was asked for again more than {most} times (Ne)"
        behind = self._went_back is not None and count == self._went_back + 1
        self._suspect = count if behind or (under_way and count == self._position - 1) else None
        self._went_back = count
        if count != self._position:
            self._proven = max(self._proven, self._base(count))
            self._position = count
            self.end_begun = False
        return None

    def _base(self, count: int) -> int:
        """Bytes of the program before this packet."""
        kept = self._kept.get(count)
        return kept.span.base if kept is not None else self._taken

    def stop(self) -> None:
        """CAN: after the packet under way comes an end packet with dummy data, unless that was the end packet."""
        self.stopped = True

    def _youngest(self, number: int) -> int | None:
        """The youngest packet that bears `number`: the first one that has not been sent, or one that has. After a NAK
        that was not needed it may lie ahead: the control has what is being sent again, and says so.
        """
        youngest = min(self._sent, self._built - 1) if self._end_built else self._sent
        for count in range(youngest, max(-1, self._built - KEPT_PACKETS - 1), -1):
            if FIRST_NUMBER + count % KEPT_PACKETS == number:
                return count
        return None

    def _build_next(self) -> bool:
        job = self.job
        if job is None or self._end_built:
            return False
        supply = job.supply(self._size)
        self.problem = self.problem or job.refusal
        match supply:
            case _ if self.problem:
                return False
            case Supply.LATE:
                self.late = True
                return False
            case Supply.FULL:
                self._build(FIRST_NUMBER + self._built % KEPT_PACKETS, job.take(self._size))
            case Supply.LAST:
                return self._build_last(job)
        return True

    def _build_last(self, job: Job) -> bool:
        """What fills the end packet behind the data must not be program: EOR stands before it (8.2)."""
        rest = job.take(self._size)
        if 0 < len(rest) < self._size and not job.has_ended_the_tape:
            self.problem = (
                f"the program does not fill its last packet ({len(rest)} of {self._size} bytes) and has no EOR "
                "that would end it there: add % or use protocol A (n=0)"
            )
            return False
        self._build(END_NUMBER, rest or end_of_record(self._params.data))
        return True

    @property
    def _taken(self) -> int:
        return self.job.taken if self.job is not None else 0

    def _build(self, number: int, data: bytes) -> None:
        fill = bytes([self._params.pad]) * (self._size - len(data))
        length = len(data) if self._taken else 0
        self._kept[self._built] = _Kept(
            wire=encode_packet(number, data + fill, self._n),
            span=Span(base=self._taken - length, header=1, length=length),
        )
        self._kept.pop(self._built - KEPT_PACKETS, None)
        self._end_built = number == END_NUMBER
        self._built += 1

    def _dummy_end(self) -> tuple[bytes, Span | None]:
        self._given = None
        self.end_begun = True
        return encode_packet(END_NUMBER, bytes([self._params.pad]) * self._size, self._n), None
