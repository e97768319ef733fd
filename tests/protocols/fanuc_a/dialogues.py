"""The dialogues of 4.3 and 5.4, played in the simulated world. Their transcripts are kept in
tests/transcripts/fanuc_a, where the golden test and docs/protocols/fanuc_a.md find them.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Any, Final

from tapewire.engine import MILLISECOND, SECOND, Held, LineFault, Nanos, SignalsIn, Started
from tapewire.line.transport import Transport
from tapewire.protocols.fanuc_a import FanucAHost
from tapewire.sim.world import Pair, World
from tests.protocols.wire import FaultyEnd, flipped

SHORT: Final = b"%\nO0001\nG91 G01 X1. F500\nM30\n%"
LONG: Final = b"%\nO0002\n" + b"G01 X1.5 Y2.25\n" * 600 + b"M30\n%"
"""9013 bytes: more than the buffer."""
PACKETS: Final = b"%\nO0003\n" + b"G01 X1.5 Y2.25\n" * 100 + b"M30\n%"
"""1513 bytes: five effective packets of n = 1, and the end packet."""

PACKET: Final = 260
"""Characters of a packet of n = 1."""


# 4.3, 4.4: protocol A


def power_on_and_polling() -> World:
    """4.3 (1), 4.4.1: SYN after 2 s, RDY, SAT, SET; SAT again every Tp."""
    world = World()
    world.pair("fanuc-a")
    world.run_for(7 * SECOND)
    return world


def a_program() -> World:
    """4.4.1 GTD, DAT, EOD: one GTD for each DAT, as long as more than Nb is free; SAT tells the host of the end."""
    world, pair = linked()
    feed(world, pair, LONG)
    return both_end(world, pair)


def executed_slowly() -> World:
    """4.4.1: while not more than Nb is free there is no GTD, and SAT every Tp."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", blocks_per_second=60))
    feed(world, pair, LONG)
    return both_end(world, pair)


def power_on_parameters() -> World:
    """4.5: a host that asks for nothing but what is there; Ti = 10 ms between characters, Tx = 100 ms."""
    world = World()
    wanted = {"Nb": "2000", "No": "50", "Tp": "5", "Ti": "10", "Tx": "100", "Tw": "5"}
    pair = world.pair("fanuc-a", host_settings=wanted)
    feed(world, pair, SHORT)
    return both_end(world, pair)


def late_source() -> World:
    """4.4.1 WAT: the host has no data; GTD again after Tw."""
    world, pair = linked()
    source = LateSource(SHORT)
    pair.host.start(source, world.now)
    pair.cnc.cycle_start(world.now)
    world.run_for(3 * SECOND)
    source.late = False
    return both_end(world, pair)


def nothing_armed() -> World:
    """4.4.1 WAT: the control asks and no program is ready. Armed within the same reading it is sent."""
    world, pair = linked()
    pair.cnc.cycle_start(world.now)
    world.run_for(2500 * MILLISECOND)
    pair.host.start(BytesIO(SHORT), world.now)
    return both_end(world, pair)


def reset_in_the_middle() -> World:
    """4.4.1 RST, ARS; 8.2: what was received is lost."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", blocks_per_second=60, reset_after=600))
    feed(world, pair, LONG)
    return both_end(world, pair)


def alarm_in_the_middle() -> World:
    """4.4.1 ALM, AAL: alarm state 3, cause 0, until RESET."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", blocks_per_second=60, alarm_after=600))
    feed(world, pair, LONG)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    world.run_for(3 * SECOND)
    pair.cnc.reset(world.now)
    world.run_for(3 * SECOND)
    return world


def given_up_by_the_host() -> World:
    """No clause: the host ends a DAT too early and with a wrong sum, and has nothing but WAT from then on."""
    world, pair = linked()
    feed(world, pair, LONG)
    when_started(world, pair)
    world.run_for(SECOND)
    pair.host.abort(world.now)
    world.run_until(lambda: pair.host_end is not None)
    world.run_for(2 * SECOND)
    pair.cnc.reset(world.now)
    return both_end(world, pair)


def rty_by_the_control() -> World:
    """4.6 2) (1): a checksum error in a DAT."""
    world, pair = linked()
    feed(world, pair, SHORT)
    when_started(world, pair)
    spoil(pair, 20)
    return both_end(world, pair)


def rty_by_the_host() -> World:
    """4.4.1 RTY: a checksum error in a SAT."""
    world, pair = linked()
    pair.host_link.transport = FaultyEnd(pair.host_link.transport, 3, flipped)
    feed(world, pair, SHORT)
    return both_end(world, pair)


def retries_exceeded() -> World:
    """4.6 2) (1): more checksum errors than Ne; alarm state 3, cause 1, SR945."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", settings={"Ne": "2"}))
    feed(world, pair, SHORT)
    when_started(world, pair)
    for again in range(3):
        spoil(pair, again * (len(SHORT) + 6) + 20)
    return both_end(world, pair)


def clear_the_buffer() -> World:
    """4.4.1 CLB: an answer to SAT, between jobs only."""
    world, pair = linked()
    host_of(pair).clear_buffer(world.now)
    world.run_for(7 * SECOND)
    return world


def di_and_do() -> World:
    """4.4.1 RDI, SDI, SDO: in place of an answer, which is still owed after SDI."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", cnc_settings={"di": "165"}))
    host_of(pair).read_di(world.now)
    world.run_for(3 * SECOND)
    host_of(pair).read_di(world.now)
    host_of(pair).set_do(1, world.now)
    feed(world, pair, SHORT)
    return both_end(world, pair)


def syn_by_the_host() -> World:
    """4.4.1 SYN in place of SET: the host has the remote buffer initialise itself."""
    world, pair = linked()
    host_of(pair).initialise(world.now)
    world.run_for(5 * SECOND)
    return world


def syn_by_the_control() -> World:
    """4.6 1): an open-line error, and a control that then speaks first; the job is over."""
    world = World()
    pair = initialised(world, world.pair("fanuc-a", cnc_settings={"open_line": "speaks"}))
    feed(world, pair, LONG)
    when_started(world, pair)
    world.run_for(SECOND)
    pair.cnc.receive_line_fault(LineFault.PARITY, 0x47, world.now)
    return both_end(world, pair, 4 * SECOND)


def open_line_and_recovery() -> World:
    """4.6 1): an open-line error, and a control that waits for the host's SYN; a new job then."""
    world, pair = linked()
    feed(world, pair, LONG)
    when_started(world, pair)
    world.run_for(SECOND)
    pair.cnc.receive_line_fault(LineFault.FRAMING, None, world.now)
    both_end(world, pair, 4 * SECOND)
    pair.cnc.reset(world.now)
    world.run_for(SECOND)
    pair.host_end = pair.cnc_end = None
    feed(world, pair, SHORT)
    return both_end(world, pair)


def lost_end_code() -> World:
    """4.1: without its end code a DAT has no end. The host's SYN behind it makes one."""
    world, pair = linked()
    feed(world, pair, SHORT)
    when_started(world, pair)
    pair.cnc_link.transport = FaultyEnd(pair.cnc_link.transport, len(SHORT) + 5)
    return both_end(world, pair, 3 * SECOND)


def time_out() -> World:
    """4.6 1) (6): no answer within To, SR944. The DAT and the host's first three SYN are lost."""
    world, pair = linked()
    feed(world, pair, SHORT)
    when_started(world, pair)
    pair.cnc_link.transport = GapEnd(pair.cnc_link.transport, 0, len(SHORT) + 6 + 3 * 6)
    return both_end(world, pair, 6 * SECOND)


def rs_off_and_on() -> World:
    """4.3 (5): busy control of the host. RS is turned by hand: a DAT that keeps to Nb - No never makes it go OFF."""
    world, pair = linked()
    feed(world, pair, LONG)
    when_started(world, pair)
    world.run_for(200 * MILLISECOND)
    pair.host.receive_signals(SignalsIn(cts=False), world.now)
    world.run_for(SECOND)
    pair.host.receive_signals(SignalsIn(), world.now)
    return both_end(world, pair)


def cs_off_and_on() -> World:
    """4.3 (6): busy control of the control, in the middle of its SAT. CS is turned by hand: our host never does."""
    world, pair = linked()
    world.run_for(2810 * MILLISECOND)
    pair.cnc.receive_signals(SignalsIn(cts=False), world.now)
    world.run_for(SECOND)
    pair.cnc.receive_signals(SignalsIn(), world.now)
    world.run_for(SECOND)
    return world


# 5.4: expansion protocol A


def packets_normal() -> World:
    """5.4 1): numbers 30h to 39h and round; the end packet FFh."""
    world, pair = linked_packets()
    feed(world, pair, LONG[:2900] + b"M30\n%")
    return both_end(world, pair)


def packets_one() -> World:
    """5.2 2) b): a program of one packet is the end packet alone."""
    world, pair = linked_packets()
    feed(world, pair, SHORT)
    return both_end(world, pair)


def packets_stop_request() -> World:
    """5.4 2): CAN; the packet under way is finished, an end packet with dummy data follows."""
    world, pair = linked_packets(blocks_per_second=400, reset_after=600)
    feed(world, pair, LONG)
    return both_end(world, pair)


def packets_retransmission_i() -> World:
    """5.4 3) (i): a checksum error in an effective packet."""
    return one_error(PACKET + 100)


def packets_retransmission_ii() -> World:
    """5.4 3) (ii): a packet is lost, so the number of the next is improper."""
    world, pair = linked_packets()
    feed(world, pair, PACKETS)
    when_started(world, pair)
    pair.cnc_link.transport = GapEnd(pair.cnc_link.transport, PACKET, PACKET)
    return both_end(world, pair)


def packets_retransmission_iii() -> World:
    """5.4 3) (iii): a checksum error in the end packet."""
    return one_error(5 * PACKET + 100)


def packets_retransmission_of_a_lone_packet() -> World:
    """5.2 2) b): a checksum error in an end packet that is the first: NAK 30."""
    world, pair = linked_packets()
    feed(world, pair, SHORT)
    when_started(world, pair)
    spoil(pair, 100)
    return both_end(world, pair)


def packets_interruption_and_restart() -> World:
    """5.4 4): DC3, DC1."""
    world, pair = linked_packets(n=4, blocks_per_second=60)
    feed(world, pair, LONG)
    return both_end(world, pair)


def packets_interruption_and_stop() -> World:
    """5.4 5), whose title is a misprint: DC3, then CAN."""
    world, pair = linked_packets(n=4, blocks_per_second=60)
    feed(world, pair, LONG)
    when_held(world, pair)
    world.run_for(SECOND)
    pair.cnc.reset(world.now)
    return both_end(world, pair)


def packets_interruption_and_retransmission() -> World:
    """5.4 6): the packet under way when DC3 comes is damaged; NAK asks for it when there is room."""
    world, pair = linked_packets(n=4, blocks_per_second=60)
    feed(world, pair, LONG)
    when_held(world, pair)
    spoil(pair, 500)
    return both_end(world, pair)


def packets_time_out() -> World:
    """5.4 7): no packet within To, SR944. The packet and the host's first three SYN are lost."""
    world, pair = linked_packets()
    feed(world, pair, SHORT)
    when_started(world, pair)
    pair.cnc_link.transport = GapEnd(pair.cnc_link.transport, 0, PACKET + 3 * 6)
    return both_end(world, pair)


def packets_late_source() -> World:
    """5.2 2) c): invalid packets while the host has no data."""
    world, pair = linked_packets(To=5)
    source = LateSource(PACKETS)
    pair.host.start(source, world.now)
    pair.cnc.cycle_start(world.now)
    world.run_for(6 * SECOND)
    source.late = False
    return both_end(world, pair)


DIALOGUES: Final[dict[str, Callable[[], World]]] = {
    play.__name__: play
    for play in (
        power_on_and_polling,
        a_program,
        executed_slowly,
        power_on_parameters,
        late_source,
        nothing_armed,
        reset_in_the_middle,
        alarm_in_the_middle,
        given_up_by_the_host,
        rty_by_the_control,
        rty_by_the_host,
        retries_exceeded,
        clear_the_buffer,
        di_and_do,
        syn_by_the_host,
        syn_by_the_control,
        open_line_and_recovery,
        lost_end_code,
        time_out,
        rs_off_and_on,
        cs_off_and_on,
        packets_normal,
        packets_one,
        packets_stop_request,
        packets_retransmission_i,
        packets_retransmission_ii,
        packets_retransmission_iii,
        packets_retransmission_of_a_lone_packet,
        packets_interruption_and_restart,
        packets_interruption_and_stop,
        packets_interruption_and_retransmission,
        packets_time_out,
        packets_late_source,
    )
}


class LateSource:
    """A source that has nothing until it is said that it has."""

    def __init__(self, data: bytes) -> None:
        self._data = BytesIO(data)
        self.late = True

    def read(self, size: int) -> bytes | None:
        return None if self.late else self._data.read(size)


class GapEnd(FaultyEnd):
    """An end of a line where `count` characters from number `at` (from 0) never arrive."""

    def __init__(self, line: Transport, at: int, count: int) -> None:
        super().__init__(line, None)
        self._first = at
        self._count = count

    def _strike(self, data: bytes) -> bytes:
        begins = max(self._first - self.received, 0)
        ends = max(self._first + self._count - self.received, 0)
        self.received += len(data)
        return data[:begins] + data[ends:]


def initialised(world: World, pair: Pair) -> Pair:
    """Run until SYN, RDY and the first SAT are over."""
    world.run_for(2200 * MILLISECOND)
    return pair


def linked() -> tuple[World, Pair]:
    world = World()
    return world, initialised(world, world.pair("fanuc-a"))


def linked_packets(n: int = 1, To: int = 20, **operator: Any) -> tuple[World, Pair]:  # noqa: N803 the manual's name
    world = World()
    pair = world.pair("fanuc-a-expansion", host_settings={"n": str(n), "To": str(To)}, **operator)
    return world, initialised(world, pair)


def host_of(pair: Pair) -> FanucAHost:
    assert isinstance(pair.host, FanucAHost)
    return pair.host


def feed(world: World, pair: Pair, program: bytes) -> None:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)


def when_started(world: World, pair: Pair) -> None:
    """Run until the host begins the program; nothing of it has come in yet."""
    world.run_until(lambda: any(isinstance(event, Started) for _, event in pair.host_events))


def when_held(world: World, pair: Pair) -> None:
    world.run_until(lambda: any(isinstance(event, Held) for _, event in pair.host_events))


def spoil(pair: Pair, at: int) -> None:
    """The character number `at` from now on reaches the control with its lowest bit turned."""
    pair.cnc_link.transport = FaultyEnd(pair.cnc_link.transport, at, flipped)


def one_error(at: int) -> World:
    world, pair = linked_packets()
    feed(world, pair, PACKETS)
    when_started(world, pair)
    spoil(pair, at)
    return both_end(world, pair)


def both_end(world: World, pair: Pair, after: Nanos = 0) -> World:
    """Polling never ends, so the world does not fall quiet."""
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None, limit=600 * SECOND)
    world.run_for(after)
    return world
