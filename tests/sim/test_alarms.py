"""Chapter 11: every alarm, brought about by a real fault on the cable, in the program, or in the control."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Final

import pytest

from tapewire.codes import DataCode
from tapewire.engine import MILLISECOND, SECOND, Alarm
from tapewire.fanuc.alarms import ALARMS, AlarmNumber
from tapewire.fanuc.block_check import BlockCheck
from tapewire.fanuc.parameters import Interface
from tapewire.line.faults.plan import FaultPlan, Framing, Nth, Wire
from tapewire.protocols.fanuc_a.messages import checksum
from tapewire.sim.nc_world import WorldNc, nc_of
from tapewire.sim.program_flow import ProgramFlow
from tapewire.sim.world import World
from tests.sim.test_nc import A, B

LONG: Final = b"%\nO0001\n" + b"G91G01X1.F100\n" * 500 + b"M30\n%"
A_ALONE: Final = ("fanuc-a", "fanuc-a-expansion")
EVERY: Final = (*A_ALONE, "fanuc-b", "fanuc-b-expansion")
PARAMETERS: Final = {"fanuc-a": A, "fanuc-a-expansion": A, "fanuc-b": B, "fanuc-b-expansion": B.with_values({5074: 2})}


class Bench:
    """A control in DNC operation, and whatever goes wrong with it."""

    def __init__(self, protocol: str, **operator: object) -> None:
        flow = ProgramFlow(DataCode.ASCII, check=BlockCheck())
        self.world = World()
        self.nc: WorldNc = nc_of(
            self.world, PARAMETERS[protocol], Interface.RS_422, flow=flow, protocol=protocol, **operator
        )
        self.pair = self.nc.pair
        self.said = bytearray()
        self.pair.cnc_link.on_write = self.said.extend

    @property
    def shown(self) -> list[str]:
        return [alarm.number for alarm in (*self.nc.alarms, *self.nc.board.alarms)]

    def run(self, tape: bytes = LONG) -> None:
        self.pair.host.start(BytesIO(tape), self.world.now)
        self.nc.cycle_start(self.world.now)

    def until_half_way(self) -> None:
        self.run()
        self.world.run_until(lambda: self.pair.cnc.progress > 500, limit=60 * SECOND)

    def say(self, data: bytes) -> None:
        """In place of the host's engine, as fast as the line takes it."""
        self.pair.host_side.off = True
        transport = self.pair.host_link.transport
        while data:
            room = transport.room(self.world.now)
            transport.write(data[:room], self.world.now)
            data = data[room:]
            self.world.run_for(MILLISECOND)

    def until_gtd(self) -> None:
        """The host's engine never hears it."""
        self.run()
        self.world.run_until(lambda: b"GTD\x03" in self.said, limit=60 * SECOND)
        self.pair.host_side.off = True


def bad_block(block: bytes) -> Callable[[str], Bench]:
    def bring(protocol: str) -> Bench:
        bench = Bench(protocol)
        bench.run(b"%\nO1\nX1.\n" + block + b"\nX2.\nM30\n%")
        return bench

    return bring


def records(before: bytes, record: bytes) -> Callable[[str], Bench]:
    def bring(protocol: str) -> Bench:
        bench = Bench(protocol)
        bench.run(b"%\nO1\n" + before + b"G05\n" + record * 100 + bytes(7) + b"\nM30\n%")
        return bench

    return bring


def parameter_out_of_range(protocol: str) -> Bench:
    bench = Bench(protocol)
    bench.nc.parameters.enter(5073, 16)
    bench.nc.parameters.power_off_and_on()
    bench.run()
    return bench


def host_loses_its_power(protocol: str) -> Bench:
    bench = Bench(protocol)
    bench.until_half_way()
    bench.pair.cut_power(bench.pair.host_side, bench.world.now)
    return bench


def host_does_not_stop(protocol: str) -> Bench:
    bench = Bench(protocol)
    bench.until_half_way()
    bench.nc.feed_hold(bench.world.now)
    bench.say(b"G91G01X1.F100\n" * 1500)
    return bench


def program_of_the_host_hangs(protocol: str) -> Bench:
    """Its control lines stay ON."""
    bench = Bench(protocol)
    bench.until_half_way()
    bench.pair.host_side.off = True
    return bench


def every_block_is_damaged(protocol: str) -> Bench:
    bench = Bench(protocol)
    transport = bench.pair.host_link.transport
    write = transport.write
    transport.write = lambda data, now: write(data.replace(b"G", b"H"), now)  # type: ignore[method-assign]
    bench.run()
    return bench


def a_character_is_damaged(protocol: str) -> Bench:
    plan = FaultPlan(name="one", why="a test", faults=(Framing(when=Nth(900), wire=Wire.FROM_HOST),))
    bench = Bench(protocol, faults=plan)
    bench.run()
    return bench


def wrong_answer(command: bytes) -> Callable[[str], Bench]:
    def bring(protocol: str) -> Bench:
        bench = Bench(protocol)
        bench.until_gtd()
        bench.say(checksum(command + b"\x03") + command + b"\x03")
        return bench

    return bring


def request_that_there_is_none_of(protocol: str) -> Bench:
    bench = Bench(protocol)
    bench.until_half_way()
    bench.nc.board.request(0x99, bench.world.now)
    return bench


WRONG: Final = bytes((0, 2, 0, 0, 0, 0, 9))
FAULTS: Final[dict[AlarmNumber, tuple[tuple[str, ...], Callable[[str], Bench]]]] = {
    AlarmNumber.PS10: (EVERY, bad_block(b"G123")),
    AlarmNumber.PS11: (EVERY, bad_block(b"E5.")),
    AlarmNumber.PS12: (EVERY, bad_block(b"X1..2")),
    AlarmNumber.SR807: (EVERY, parameter_out_of_range),
    AlarmNumber.SR855: (EVERY, host_loses_its_power),
    AlarmNumber.SR856: (EVERY[2:], host_does_not_stop),
    AlarmNumber.SR890: (EVERY, records(b"", WRONG)),
    AlarmNumber.SR891: (EVERY, records(b"G41\n", WRONG)),
    AlarmNumber.SR941: (EVERY, request_that_there_is_none_of),
    AlarmNumber.SR944: (A_ALONE, program_of_the_host_hangs),
    AlarmNumber.SR945: (A_ALONE, every_block_is_damaged),
    AlarmNumber.SR946: (EVERY, a_character_is_damaged),
    AlarmNumber.SR947: (A_ALONE[:1], wrong_answer(b"ARS")),
    AlarmNumber.SR948: (A_ALONE[:1], wrong_answer(b"XYZ")),
}


def test_11_no_alarm_is_left_out() -> None:
    assert FAULTS.keys() == ALARMS.keys()


@pytest.mark.parametrize(
    ("number", "protocol"), [(number, protocol) for number, (protocols, _) in FAULTS.items() for protocol in protocols]
)
def test_11_every_alarm_by_a_real_fault(number: AlarmNumber, protocol: str) -> None:
    bench = FAULTS[number][1](protocol)
    assert bench.world.advance(lambda: bench.shown, bench.world.now + 300 * SECOND), "no alarm at all"
    assert bench.shown == [number]
    told = [event.number for _, event in bench.pair.cnc_events if isinstance(event, Alarm)]
    assert set(told) <= {number}
    bench.nc.reset(bench.world.now)
    assert bench.nc.alarms == []
