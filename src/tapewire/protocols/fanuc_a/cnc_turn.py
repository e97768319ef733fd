"""What the control's end of protocol A says, and when (B-63322EN-1 4.3, 4.4.1, 5.3)."""

from __future__ import annotations

import dataclasses

from tapewire.engine import MILLISECOND, SECOND, Events, Nanos, Started, Timers
from tapewire.protocols.fanuc_a.cnc_job import Job
from tapewire.protocols.fanuc_a.cnc_law import AWAITED, DEAF, State, Timer
from tapewire.protocols.fanuc_a.cnc_packets import PacketSession
from tapewire.protocols.fanuc_a.cnc_room import Room
from tapewire.protocols.fanuc_a.cnc_sender import Sender
from tapewire.protocols.fanuc_a.messages import Command, Message, MessageReader, encode_message
from tapewire.protocols.fanuc_a.packets import Monitor
from tapewire.protocols.fanuc_a.params import AfterEnd, Params, Retries
from tapewire.protocols.fanuc_a.status import AlarmCause, BufferState, Parameters, Status
from tapewire.protocols.settings import Switch

__all__ = ["Turn", "legal_n"]


class Turn:
    """The turn of the remote buffer: it waits for Tx, says what is due, and waits for the answer."""

    def __init__(self, params: Params, job: Job, events: Events) -> None:
        self._params = params
        self._job = job
        self._events = events
        self.timers = Timers()
        self.state = State.NOT_READY
        self.reader = MessageReader(params.coding)
        self.room = Room(events)
        self.session: PacketSession | None = None
        self.parameters = legal_n(params.wanted)
        self.switching = "0"
        """Position 1 of the last SET."""
        self.nc_alarm = False
        self._sender = Sender()
        self._monitor: Monitor | None = None
        self._status = BufferState.NOT_READY
        self._cause = AlarmCause.NC_ALARM
        self._host_here = True
        self._broken = False
        self._said = self._asked = b""
        self._awaited = State.SYN_SENT
        self._due: bytes | None = None
        self._initialising: Command | None = None
        self._notices: list[Command] = []
        self._poll_now = False
        self._heard_at: Nanos = 0
        self._ask_at: Nanos = 0
        self._retries = 0

    @property
    def up(self) -> bool:
        """SYN and RDY have been exchanged."""
        return self._status in (BufferState.RESET, BufferState.ALARM)

    @property
    def in_alarm(self) -> bool:
        return self.nc_alarm or self._status is BufferState.ALARM

    @property
    def status(self) -> BufferState:
        """Position 2 of SAT."""
        if self._status is not BufferState.RESET:
            return self._status
        stays = self._params.after_end is AfterEnd.OPERATING and self._job.read_whole
        return BufferState.OPERATING if self._job.operating or stays else BufferState.RESET

    # whose turn it is

    @property
    def _tp(self) -> Nanos:
        return self.parameters.tp_ms * MILLISECOND

    @property
    def _tx(self) -> Nanos:
        return self.parameters.tx * MILLISECOND

    def answered(self, now: Nanos) -> None:
        """The host has given a good answer, and the turn is ours."""
        if self._params.retries is Retries.EXCHANGE:
            self._retries = 0
        self._said = self._asked
        self._job.answered()
        self.rest(now)

    def polled(self, now: Nanos) -> None:
        """SAT has been answered."""
        self._job.ask_again()
        self.answered(now)

    def wait_tw(self, now: Nanos) -> None:
        self._ask_at = now + self.parameters.tw * SECOND
        self.answered(now)

    def rest(self, now: Nanos) -> None:
        """The turn is ours; nothing is said before Tx has passed (4.3 (4))."""
        self.state = State.RESTING
        self._heard_at = now
        for timer in (Timer.TO, Timer.QUIET, Timer.TP, Timer.TW):
            self.timers.stop(timer)
        if self._tx:
            self.timers.start(Timer.TX, now + self._tx)
        else:
            self.speak(now)

    def speak(self, now: Nanos) -> None:
        """Say what is due, or wait until something is."""
        if self.state is not State.RESTING or self.timers.running(Timer.TX):
            return
        if self._due is not None:
            self._transmit(self._due)
        elif self._initialising is not None:
            if now >= self._ask_at:
                self.say(self._initialising)
            else:
                self.timers.start(Timer.TP, self._ask_at)
        elif self._notices:
            self.say(self._notices.pop(0))
        elif self._poll_now:
            self.say(Command.SAT)
        else:
            self._ask_or_poll(now)

    def _ask_or_poll(self, now: Nanos) -> None:
        """4.4.1: GTD when more than Nb is free, SAT when there is nothing else to say for Tp."""
        poll_at = self._heard_at + self._tp
        asks = self._asks
        if asks and now >= self._ask_at:
            self.say(Command.GTD)
        elif now >= poll_at:
            self.say(Command.SAT)
        else:
            self.timers.start(Timer.TP, poll_at)
            if asks:
                self.timers.start(Timer.TW, self._ask_at)

    @property
    def _asks(self) -> bool:
        """4.4.1: in the remote operation status, when more than Nb is free."""
        wanted = self.status is BufferState.OPERATING and not self._job.no_more
        return wanted and self._job.free > self.parameters.nb

    def say(self, command: Command) -> None:
        data = b""
        if command is Command.SAT:
            self._poll_now = False
            data = self._status_data()
        self._job.spoke(command)
        self._awaited = AWAITED[command]
        self._asked = encode_message(Message(command=command, data=data), self._params.coding)
        self._transmit(self._asked)

    def send_di(self, image: bytes, now: Nanos) -> None:
        """RDI: the image of this moment; after it the answer to SAT or GTD is still owed (4.4.1)."""
        self._awaited = State.SDI_FOR_SAT if self.state is State.SAT_SENT else State.SDI_FOR_GTD
        self._asked = self._due = encode_message(Message(command=Command.SDI, data=image), self._params.coding)
        self.rest(now)

    def _status_data(self) -> bytes:
        echo = self._params.echo is Switch.ON
        status = Status(
            switching=self.switching if echo else "0",
            state=self.status,
            cause=self._cause if self._status is BufferState.ALARM else AlarmCause.NC_ALARM,
            stored=self._job.buffered,
            parameters=self.parameters,
        )
        return status.encode(int(self._params.sat_length), self._params.filler)

    def _transmit(self, message: bytes) -> None:
        for timer in (Timer.TP, Timer.TW, Timer.TO, Timer.QUIET):
            self.timers.stop(timer)
        self._due = None
        self._said = message
        self.reader.break_off()
        self.state = State.SENDING
        self._sender.queue(message)

    # characters on their way out

    @property
    def _gaps(self) -> bool:
        return self.parameters.ti > 0

    def look(self, limit: int) -> bytes:
        return self._sender.look(limit, self._gaps) if self._host_here else b""

    def sent(self, count: int, now: Nanos) -> None:
        self._sender.sent(count, self._gaps)
        if self._sender.busy:
            return
        if self.session is not None and self.state is State.PACKETS:
            self._monitor_handed_over(now)
        elif self.state is State.SENDING:
            self._message_handed_over(now)

    def left(self, count: int, now: Nanos) -> None:
        if not self._sender.left(count):
            return
        if self._gaps:
            self.timers.start(Timer.TI, now + self.parameters.ti * MILLISECOND)
        else:
            self._sender.gap_over()
        if self._sender.busy:
            return
        if self.timers.running(Timer.TO) and self._monitor is None:
            self.watch(now)
        if self.session is not None and self._monitor is Monitor.DC3:
            self.session.hold_left()

    def discarded(self, count: int) -> None:
        self._sender.discarded(count)

    def _message_handed_over(self, now: Nanos) -> None:
        """4.3 (3): ready to receive at once. A line that cannot say when a character has left must not cost the
        beginning of the answer, so handing over is enough."""
        self.state = self._awaited
        if self.state is State.GTD_SENT and not self._job.started and self._job.runs:
            self._job.started = True
            self._events.put(Started(why="GTD asks the host for the program"))
        if self.state in (State.GTD_SENT, State.SDI_FOR_GTD) and self.parameters.n:
            self.state = State.PACKETS
            self.session = PacketSession(self._params, self.parameters, self._job, self._events)
            if self._notices:
                self.session.stop()
                self.pump()
        self.watch(now)

    def watch(self, now: Nanos) -> None:
        """To begins."""
        self.timers.start(Timer.TO, now + self.parameters.to * SECOND)

    def packet_in(self, now: Nanos) -> None:
        """5.4 note: the time from one packet to the next."""
        if not self._held:
            self.watch(now)

    @property
    def _held(self) -> bool:
        """Not stated: the time in which the control itself holds the host does not count."""
        return self.session is not None and self.session.holding and self._params.time_out_in_hold is Switch.OFF

    def _monitor_handed_over(self, now: Nanos) -> None:
        if self._held:
            self.timers.stop(Timer.TO)
        elif not self.timers.running(Timer.TO):
            self.watch(now)
        self.pump()

    def pump(self) -> None:
        """The next monitor packet, when the one before has been handed over."""
        if self.session is None or self._sender.busy:
            return
        wanted = self.session.next_monitor()
        if wanted is not None:
            self._monitor = wanted[0]
            self._sender.queue(wanted[1])

    def leave_packets(self) -> None:
        """Back to protocol A."""
        if self.session is not None:
            self.session.end()
        self.session = None
        self._monitor = None

    def room_freed(self, now: Nanos) -> None:
        """The buffer has more room: RS, DC1 or GTD may follow."""
        if self.session is not None:
            self.session.freed()
            self.pump()
        if self.room.freed(self._job.room, self.parameters) and self.state not in DEAF:
            self.watch(now)
        self.speak(now)


def legal_n(parameters: Parameters) -> Parameters:
    """5.2 1): n is 0 when it is anything but 1, 2 and 4."""
    return dataclasses.replace(parameters, n=parameters.packet_n)
