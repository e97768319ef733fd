"""The host while packets are on: when the next one goes out, and what monitor packets do to it
(B-63322EN-1 5.2, 5.3; the examples of 5.4).
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Events, Held, Nanos, Notice, Resumed, Timers, Violation
from tapewire.protocols.fanuc_a.host_agreement import Agreement
from tapewire.protocols.fanuc_a.host_job import Job
from tapewire.protocols.fanuc_a.host_law import Timer
from tapewire.protocols.fanuc_a.host_outbox import Outbox
from tapewire.protocols.fanuc_a.host_packets import PacketStream
from tapewire.protocols.fanuc_a.packets import Monitor, MonitorPacket, MonitorSum, packet_bytes
from tapewire.protocols.fanuc_a.params import Params

__all__ = ["LONGEST_SOURCE_POLL", "SOURCE_POLL", "SourcePoll", "Streaming"]

SOURCE_POLL: Final[Nanos] = 10 * MILLISECOND
"""How soon a source that had nothing is asked again; each time in vain doubles it."""

LONGEST_SOURCE_POLL: Final[Nanos] = 1280 * MILLISECOND

KEEP_ALIVE_SHARE: Final = 0.6
"""An invalid packet goes out when so much of To has passed: its own time and ours fit into the rest."""

LEAST_LOOKAHEAD: Final = 16
"""A packet is begun when fewer characters than this of the one before are on their way, or fewer than `lookahead` of
line, so that NAK, DC3 and CAN find no more than one packet under way (5.3) and the beginning of the next one.
"""

VERDICT_TIME: Final[Nanos] = 100 * MILLISECOND
"""There and back through two USB adapters or a serial server, and the five characters of a NAK."""

LOOKAHEAD_SHARE: Final = 4
"""Never more than one fourth of a packet."""


class SourcePoll:
    """Asks a late source again, ever less often."""

    def __init__(self, timers: Timers) -> None:
        self._timers = timers
        self._wait = SOURCE_POLL

    def begin(self) -> None:
        """The source had something."""
        self._wait = SOURCE_POLL
        self._timers.stop(Timer.SOURCE)

    def again(self, now: Nanos) -> None:
        """The source had nothing; harmless when it is to be asked again anyway."""
        if not self._timers.running(Timer.SOURCE):
            self._timers.start(Timer.SOURCE, now + self._wait)
            self._wait = min(2 * self._wait, LONGEST_SOURCE_POLL)


class Streaming:
    """The packets of one GTD at a time."""

    def __init__(
        self, params: Params, agreement: Agreement, outbox: Outbox, timers: Timers, poll: SourcePoll, events: Events
    ) -> None:
        self._params = params
        self._agreement = agreement
        self._outbox = outbox
        self._timers = timers
        self._poll = poll
        self._events = events
        self._stream: PacketStream | None = None
        self._first_wait = 0
        self._forms: set[tuple[MonitorSum, int]] = set()

    @property
    def active(self) -> bool:
        """Packets are on: a GTD was answered by them and the control has said no message since."""
        return self._stream is not None

    @property
    def our_turn(self) -> bool:
        """The control waits for packets, or holds us: its silence is in order (4.3 of the protocol's page)."""
        return self._stream is not None and not (self._stream.end_begun and self._outbox.empty)

    @property
    def end_gone(self) -> bool:
        """The true end packet has been handed over."""
        stream = self._stream
        return stream is not None and stream.end_begun and not stream.stopped and self._outbox.empty

    @property
    def stopped(self) -> bool:
        """CAN has come."""
        return self._stream is not None and self._stream.stopped

    @property
    def held(self) -> bool:
        """By DC3, or because what the control said could not be read."""
        return self._stream is not None and self._stream.held

    @property
    def proven(self) -> int:
        return self._stream.proven if self._stream is not None else 0

    @property
    def waits_for_job(self) -> bool:
        """Nothing but invalid packets has gone out since GTD: a program may still begin. Not while we are held: nothing
        says that the control is still there, and a hold has no end.
        """
        stream = self._stream
        over = stream is None or stream.problem or stream.stopped or stream.end_begun
        return stream is not None and not over and stream.job is None and not stream.held

    def begin(self, job: Job | None) -> None:
        """Answer GTD by packets: those of `job`, or invalid ones."""
        self._open(PacketStream(self._agreement.n, self._params, job))
        self._first_wait = min(round(self._params.wat_after * SECOND), self._keep_alive_time)

    def begin_end_only(self) -> None:
        """Answer GTD by an end packet that holds EOR: there is nothing left."""
        self._open(PacketStream.end_only(self._agreement.n, self._params))

    def _open(self, stream: PacketStream) -> None:
        """A control that has said GTD waits for the rest of no message; what ended one would spoil the packets."""
        self.close()
        self._outbox.begin_anew()
        self._stream = stream

    def take_up(self, job: Job) -> None:
        """A program for a GTD that got invalid packets so far."""
        assert self._stream is not None
        assert self.waits_for_job
        self._stream.job = job

    def give_up(self) -> None:
        """Nothing of the program any more, also not again; invalid packets and the dummy end packet remain."""
        if self._stream is not None:
            self._take_back(self._stream)
            self._stream.give_up()
        self._timers.stop(Timer.SOURCE)
        self._timers.stop(Timer.DAMAGED)

    def close(self) -> None:
        """Back to protocol A; what was left of a packet is not sent any more."""
        if self._stream is not None:
            self._outbox.put(b"")
        self._stream = None
        self._first_wait = 0
        for timer in (Timer.KEEP_ALIVE, Timer.DAMAGED, Timer.SOURCE, Timer.NEXT, Timer.VERDICT):
            self._timers.stop(timer)

    @property
    def _keep_alive_time(self) -> Nanos:
        return round(KEEP_ALIVE_SHARE * self._agreement.to)

    @property
    def _lookahead(self) -> int:
        """Characters of the packet before that are still to leave when the next one is begun."""
        wanted = round(self._outbox.rate * self._params.lookahead / 1000)
        return max(LEAST_LOOKAHEAD, min(wanted, packet_bytes(self._agreement.n) // LOOKAHEAD_SHARE))

    def _is_time(self, stream: PacketStream, now: Nanos) -> bool:
        """For the next packet."""
        if stream.verdict_due and not stream.end_begun:
            if not self._outbox.in_flight and not self._timers.running(Timer.VERDICT):
                self._timers.start(Timer.VERDICT, now + VERDICT_TIME)
            return False
        early = self._outbox.in_flight - self._lookahead
        if early < 0:
            self._timers.stop(Timer.NEXT)
        elif self._outbox.rate:
            self._timers.start(Timer.NEXT, now + (early + 1) * SECOND // self._outbox.rate)
        return early < 0

    def no_verdict(self) -> None:
        """Timer.VERDICT."""
        if self._stream is not None:
            self._stream.verdict_due = False

    def pump(self, now: Nanos, *, hearing: bool) -> str:
        """Begin the next packet when it is time, and not while a monitor packet is coming in (`hearing`), which may be
        DC3. Returns why the job cannot go on; empty while it can.
        """
        stream = self._stream
        if stream is None or hearing or not self._outbox.empty or not self._is_time(stream, now):
            return ""
        found = stream.next()
        if found is not None:
            self._outbox.put(*found)
            self._first_wait = 0
            self._poll.begin()
            self._timers.stop(Timer.KEEP_ALIVE)
            return ""
        if stream.late:
            self._poll.again(now)
        if not self._timers.running(Timer.KEEP_ALIVE) and not stream.held and not stream.end_begun:
            self._timers.start(Timer.KEEP_ALIVE, now + (self._first_wait or self._keep_alive_time))
            self._first_wait = 0
        return stream.problem if stream.job is not None else ""

    def keep_alive(self) -> None:
        """Timer.KEEP_ALIVE."""
        packet = self._stream.invalid() if self._stream is not None and self._outbox.empty else None
        if packet is not None:
            self._outbox.put(packet)

    def obey(self, packet: MonitorPacket) -> str:
        """A monitor packet while packets are on. Returns why the job cannot go on; empty while it can."""
        stream = self._stream
        assert stream is not None
        self._tell_form(packet)
        self._take_back(stream)
        self._timers.stop(Timer.DAMAGED)
        self._timers.stop(Timer.VERDICT)
        stream.verdict_due = False
        match packet.monitor:
            case Monitor.DC3:
                stream.control_is_there()
                self._hold("DC3")
            case Monitor.DC1:
                stream.control_is_there()
                self._go_on("DC1")
            case Monitor.CAN:
                self._timers.stop(Timer.KEEP_ALIVE)
                self._events.put(Notice(text="the control stops the transfer (CAN)"))
                stream.stop()
            case Monitor.NAK:
                number = packet.number or 0
                self._events.put(Violation(what=f"packet {number:02X} did not arrive well (NAK)"))
                self._go_on("NAK")
                return stream.go_back(packet.number, self._agreement.ne, under_way=not self._outbox.idle) or ""
        return ""

    def hold_damaged(self, now: Nanos) -> None:
        """What could not be read may have been DC3, NAK or CAN: whatever goes out now may be too much, or in vain."""
        assert self._stream is not None
        self._take_back(self._stream)
        self._hold("what the control sent could not be read; it may have been DC3")
        if not self._timers.running(Timer.DAMAGED):
            self._timers.start(Timer.DAMAGED, now + self._agreement.to + SECOND)

    def _take_back(self, stream: PacketStream) -> None:
        """A packet of which nothing has been handed over is not under way (5.3)."""
        if self._outbox.untouched:
            self._outbox.put(b"")
            stream.take_back()

    def _hold(self, why: str) -> None:
        assert self._stream is not None
        self._timers.stop(Timer.KEEP_ALIVE)
        self._timers.stop(Timer.SOURCE)
        if not self._stream.held:
            self._stream.held = True
            self._events.put(Held(why=why))

    def _go_on(self, why: str) -> None:
        assert self._stream is not None
        if self._stream.held:
            self._stream.held = False
            self._events.put(Resumed(why=why))

    def _tell_form(self, packet: MonitorPacket) -> None:
        """The manual leaves the sum open, and prints DC3 in another code than NAK: say what this control does."""
        form = packet.sum_covers, packet.first_byte
        if form not in self._forms:
            self._forms.add(form)
            covers = "the end code too" if packet.sum_covers is MonitorSum.WITH_END else "bytes 1 and 2"
            name = packet.monitor.name
            self._events.put(
                Notice(text=f"this control sends {name} as {packet.first_byte:02X}h; its sum covers {covers}")
            )
