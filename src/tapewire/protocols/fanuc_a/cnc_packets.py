"""The control's end of expansion protocol A: packets in, monitor packets out (B-63322EN-1 chapter 5).

    R: GTD    H: P30 P31x P32 [R: NAK 31 during P32]   H: P31 P32 P33 ..
    R: GTD    H: P30 P31 [R: DC3 during P31]           R: DC1   H: P32 ..
    R: GTD    H: P30 P31 [R: CAN during P31]           H: PFF (dummy)   R: RST

A session lasts from a GTD to the end packet. It accepts the packet whose number is next and nothing else. There is no
positive answer: what is wrong is asked for again by NAK, once for each error unless a setting has it, and until that
comes everything is passed over.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from tapewire.engine import AfterStop, Events, Violation
from tapewire.protocols.fanuc_a.cnc_job import Job
from tapewire.protocols.fanuc_a.messages import MessageReader
from tapewire.protocols.fanuc_a.packets import (
    END_NUMBER,
    FIRST_NUMBER,
    NUMBERS,
    BadPacket,
    Kind,
    Monitor,
    Packet,
    PacketReader,
    encode_monitor,
    next_number,
)
from tapewire.protocols.fanuc_a.params import AmongPackets, GtdAnswers, NakNumber, Naks, Params
from tapewire.protocols.fanuc_a.status import Parameters
from tapewire.protocols.settings import Switch

__all__ = ["LONGEST_AMONG_PACKETS", "MOST_STALE", "PacketSession", "Verdict"]

MOST_STALE: Final = 4
"""With `monitors_again=on`: packets passed over before the control says its NAK, or its CAN, again.

A host finishes the packet it is sending and then obeys, so one or two are stale, or a few where much is under way.
Nine would bring the awaited number back on a packet ten later: a NAK that was lost must not go unnoticed so long.

So far behind the packet asked for, a host that goes back to it obeys the same NAK once more. Farther on, packets are
missing.
"""

LONGEST_AMONG_PACKETS: Final = 78
"""Characters in which a message must have ended to be taken for one: the longest but DAT (4.4.2)."""


class Verdict(Enum):
    """What a packet means for the line."""

    GO_ON = "the session goes on"
    END = "the end packet"
    TOO_MANY = "more NAKs than Ne"
    OVERFLOW = "the buffer cannot take it"


class PacketSession:
    """From one GTD to the end packet.

    The engine feeds `reader`, and `peek` with the first characters of a packet, which may be a message of protocol A.
    `peek` is None where none can begin, or none would be heard.
    """

    def __init__(self, params: Params, parameters: Parameters, job: Job, events: Events) -> None:
        self._params = params
        self._parameters = parameters
        self._job = job
        self._events = events
        self.reader = PacketReader(parameters.n)
        self.peek: MessageReader | None = None
        self.at_start = True
        """Nothing has come yet: a host that did not get the GTD may still say so."""
        self.stopping = False
        """CAN was said: only the end packet counts, and its data does not (5.2 2) b))."""
        self._wanted: list[tuple[Monitor, int | None]] = []
        self._expected = FIRST_NUMBER
        self._awaiting = False
        self._end_was_bad = False
        self._stale = 0
        self._last_stale: int | None = None
        self._asked_for: int | None = None
        self._rewinds = 0
        self._naks = 0
        self.holding = False
        """DC3 was said, or is to be said."""
        self._held_nak: int | None = None
        self._counting = False
        self._after_stop = 0
        self._allowed = 0
        self.look_for_message()

    # what comes in

    def look_for_message(self) -> None:
        """A packet begins with the next character, or where a setting has it, a message of protocol A."""
        params = self._params
        answers = self.at_start and params.gtd_answers is GtdAnswers.MESSAGES
        among = params.among_packets
        heard = answers or among is AmongPackets.SYN or (self.at_start and among is AmongPackets.RTY)
        self.peek = MessageReader(params.coding, longest=LONGEST_AMONG_PACKETS) if heard else None

    def heard(self, count: int) -> None:
        """Characters have come in, whatever they are."""
        if self._counting:
            self._after_stop += count

    def receive(self, reading: Packet | BadPacket) -> Verdict:
        self.at_start = False
        self.peek = None
        if self.stopping:
            return self._await_end(reading.number)
        if isinstance(reading, BadPacket):
            if not self._awaiting or self._all_again:
                # 5.2 2) a): a bad FFh behind a bad effective packet is stale too, and so is the good one that follows.
                self._end_was_bad = reading.number == END_NUMBER
            return self._nak(reading.number, f"packet {reading.number:02X}: {reading.why}")
        self.look_for_message()
        if reading.kind is Kind.INVALID:
            return Verdict.GO_ON
        if self._is_next(reading):
            return self._accept(reading)
        return self._pass_over(reading.number) if self._awaiting else self._out_of_order(reading.number)

    def _is_next(self, packet: Packet) -> bool:
        if packet.kind is Kind.EFFECTIVE:
            return packet.number == self._expected
        if not self._awaiting or self._end_was_bad:
            return True
        # Not stated: behind a bad effective packet FFh is stale too. Only where the host goes through packets
        # again that are here already may FFh follow the last of them.
        return self._all_again

    def _accept(self, packet: Packet) -> Verdict:
        if self._job.stores and len(packet.data) > self._job.free:
            return Verdict.OVERFLOW
        self._job.store(packet.data, self._parameters)
        if self._awaiting:
            self._held_nak = None
            if self._unwant(Monitor.NAK):
                self._rewinds -= 1
        self._naks = 0
        self._awaiting = self._end_was_bad = False
        if packet.kind is Kind.END:
            return Verdict.END
        self._expected = next_number(self._expected)
        if self._ahead > MOST_STALE:
            self._rewinds = 0
        if self._job.stores and self._job.free <= self._params.dc3_free and not self.holding:
            self.holding = True
            self._want(Monitor.DC3)
        return Verdict.GO_ON

    # 5.3 2): retransmission

    @property
    def _again(self) -> bool:
        """What was not obeyed is said again."""
        return self._params.monitors_again is Switch.ON

    @property
    def _naks_repeat(self) -> bool:
        """NAK may be said more than once for one error, and what is then obeyed twice is no error."""
        return self._again or self._params.naks is Naks.PACKET

    @property
    def _rewinding(self) -> bool:
        """The host goes through packets again that are here already: nothing is missing."""
        return self._awaiting and not self._naks

    @property
    def _all_again(self) -> bool:
        """It has come to the last of them."""
        return self._rewinding and self._last_stale is not None and next_number(self._last_stale) == self._expected

    @property
    def _ahead(self) -> int:
        """How many packets have been accepted from the one that was asked for."""
        return (self._expected - (self._asked_for or 0)) % len(NUMBERS)

    def _out_of_order(self, number: int) -> Verdict:
        self._last_stale = number
        if self._naks_repeat and self._rewinds and number == self._asked_for:
            # The host obeys a NAK for what has come meanwhile: nothing is missing, and a NAK for what it has not sent
            # yet would name a packet ten before.
            self._rewinds -= 1
            self._awaiting = True
            self._stale = 1
            return Verdict.GO_ON
        self._rewinds = 0
        self._end_was_bad = False
        return self._nak(number, f"packet {number:02X} where {self._expected:02X} is next")

    def _pass_over(self, number: int) -> Verdict:
        follows = self._last_stale is not None and number in (next_number(self._last_stale), self._asked_for)
        self._last_stale = number if number in NUMBERS else None
        self._stale += 1
        # What does not follow in a repetition shows that something is missing in it.
        at_once = not follows if self._rewinding else self._params.naks is Naks.PACKET
        if at_once or (self._naks_repeat and self._stale > MOST_STALE):
            return self._nak(number, f"packet {number:02X} where {self._expected:02X} was asked for")
        return Verdict.GO_ON

    def _nak(self, received: int, why: str) -> Verdict:
        self._events.put(Violation(what=why))
        self._rewinds = self._rewinds + 1 if self._awaiting and self._asked_for == self._expected else 1
        self._awaiting = True
        self._asked_for = self._expected
        self._stale = 0
        self._naks += 1
        if self._naks > self._parameters.ne:
            return Verdict.TOO_MANY
        as_received = self._params.nak_number is NakNumber.RECEIVED and received in NUMBERS
        number = received if as_received else self._expected
        if self.holding:
            # NAK would lift the stop (5.4 6)), so it waits for the room that DC1 waits for, and stands for it.
            self._held_nak = number
        else:
            self._want(Monitor.NAK, number)
        return Verdict.GO_ON

    # 5.3 1): stop

    def stop(self) -> None:
        """RESET or an alarm. The packet under way is finished (5.3 1)), so a second one that comes behind CAN shows
        that it was not heard: a RESET then says it again.
        """
        if self.stopping:
            if self._stale > 1:
                self._stale = 0
                self._want(Monitor.CAN)
            return
        self.stopping = True
        self._stale = 0
        self.holding = False
        self._held_nak = None
        self._end_counting()
        self._wanted.clear()
        self._want(Monitor.CAN)

    def _await_end(self, number: int) -> Verdict:
        """A dummy end packet that came damaged is as good as another."""
        if number == END_NUMBER:
            return Verdict.END
        self._stale += 1
        if self._again and self._stale > MOST_STALE:
            self._stale = 0
            self._events.put(Violation(what=f"more than {MOST_STALE} packets after CAN"))
            self._want(Monitor.CAN)
        return Verdict.GO_ON

    # 5.3 3), 4): interruption and restart

    def freed(self) -> None:
        """The control has taken something out of the buffer."""
        if not self.holding or self._job.free < self._params.dc1_free:
            return
        self.holding = False
        self._end_counting()
        if self._held_nak is None:
            self._want(Monitor.DC1)
        else:
            number, self._held_nak = self._held_nak, None
            self._unwant(Monitor.DC3)
            self._want(Monitor.NAK, number)

    def hold_left(self) -> None:
        """DC3 has left: what comes from here on counts."""
        if self.holding and not self._counting:
            self._counting = True
            self._after_stop = 0
            self._allowed = max(0, self._job.free - self.reader.pending)

    def end(self) -> None:
        """No more packets are expected."""
        self._end_counting()
        self._wanted.clear()

    def _end_counting(self) -> None:
        if self._counting:
            self._counting = False
            self._events.put(AfterStop(count=self._after_stop, allowed=self._allowed))

    # what goes out

    def next_monitor(self) -> tuple[Monitor, bytes] | None:
        """The next monitor packet and its name; from here on it cannot be unsaid."""
        if not self._wanted:
            return None
        monitor, number = self._wanted.pop(0)
        params = self._params
        return monitor, encode_monitor(monitor, number=number, code=params.monitor, sum_covers=params.monitor_sum)

    def _want(self, monitor: Monitor, number: int | None = None) -> None:
        """DC3 and DC1 that have not begun undo each other; a newer NAK stands for an older one."""
        opposite = {Monitor.DC1: Monitor.DC3, Monitor.DC3: Monitor.DC1}.get(monitor)
        if opposite is not None and self._unwant(opposite):
            return
        self._unwant(monitor)
        self._wanted.append((monitor, number))

    def _unwant(self, monitor: Monitor) -> bool:
        kept = [entry for entry in self._wanted if entry[0] is not monitor]
        changed = len(kept) != len(self._wanted)
        self._wanted = kept
        return changed
