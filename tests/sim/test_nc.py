"""The control around the remote buffer: chapters 8, 10 and 11 as its operator meets them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.engine import SECOND, Alarm, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.block_check import BlockCheck
from tapewire.fanuc.leds import BoardStatus
from tapewire.fanuc.memory import Address
from tapewire.fanuc.parameter_check import ParameterMemory
from tapewire.fanuc.parameters import Interface, ParameterSet
from tapewire.fanuc.program_memory import FEED_BYTES
from tapewire.protocols.settings import Switch
from tapewire.sim.machine import Motion
from tapewire.sim.nc import Ground, Nc, Operation
from tapewire.sim.nc_world import WorldNc, nc_of
from tapewire.sim.program_flow import After, ProgramFlow
from tapewire.sim.world import World

ASCII = 0b01100
"""0000: programs without parity, EOB is LF."""
DEVICES = dict.fromkeys((20, 21, 22, 23), 10)
B = ParameterSet({0: ASCII, **DEVICES, 5000: 0b01001, 5070: 13, 5071: 3, 5072: 1, 5073: 12, 5074: 1})
A = B.with_values({5074: 3})
TAPE = b"%TITLE\nO0001(FIRST)\nG91G01X1.\nM02\nO0002\nX2.\nM30\n%"
ALL = (A, B, B.with_values({5074: 2}))


class Shop:
    """A control, its host, and the world they are in."""

    def __init__(self, parameters: ParameterSet = B, **operator: object) -> None:
        self.world = World()
        self.nc: WorldNc = nc_of(self.world, parameters, Interface.RS_422, **operator)  # type: ignore[arg-type]
        self.pair = self.nc.pair

    def arm(self, tape: bytes = TAPE) -> Shop:
        self.pair.host.start(BytesIO(tape), self.world.now)
        return self

    def dnc(self, tape: bytes = TAPE) -> Shop:
        self.arm(tape).nc.cycle_start(self.world.now)
        return self

    def until(self, *motions: Motion) -> Shop:
        self.world.run_until(lambda: self.pair.control.motion in motions)
        return self

    def end(self) -> Outcome:
        self.world.run_until(lambda: self.pair.cnc_end is not None and self.nc.operation is Operation.NONE)
        assert self.pair.cnc_end is not None
        return self.pair.cnc_end.outcome

    def both_end(self) -> tuple[Outcome, Outcome]:
        self.world.run_until(lambda: self.pair.host_end is not None and self.pair.cnc_end is not None)
        assert self.pair.host_end is not None
        return self.pair.host_end.outcome, self.end()

    @property
    def blocks(self) -> int:
        return self.pair.control.blocks_executed

    @property
    def alarms(self) -> list[str]:
        return [event.number for _, event in self.pair.cnc_events if isinstance(event, Alarm)]


# -- 8: the data part ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", ALL)
def test_8_1_what_is_executed_is_the_data_part_and_nothing_of_the_control_part(parameters: ParameterSet) -> None:
    shop = Shop(parameters).dnc().until(Motion.ENDED)
    shop.nc.cycle_start(shop.world.now)
    assert shop.end() is Outcome.COMPLETE
    assert shop.pair.program.getvalue() == TAPE


@pytest.mark.parametrize("parameters", ALL)
def test_8_2_eor_is_the_end_and_what_follows_is_ignored(parameters: ParameterSet) -> None:
    tape = b"%\nO1\nX1.\nM30\n%" + b"O9\nX9.\nM30\n%" * 3
    shop = Shop(parameters).dnc(tape)
    assert shop.end() is Outcome.COMPLETE
    assert shop.pair.program.getvalue() == b"%\nO1\nX1.\nM30\n%"


@pytest.mark.parametrize("parameters", ALL)
def test_8_2_a_reset_in_dnc_operation_loses_what_was_received(parameters: ParameterSet) -> None:
    shop = Shop(parameters, blocks_per_second=5).dnc(b"%\n" + b"G91X1.\n" * 500 + b"M30\n%")
    shop.world.run_until(lambda: shop.pair.cnc.buffered > 300)
    shop.nc.reset(shop.world.now)
    assert shop.pair.cnc.buffered == 0
    assert shop.both_end()[1] is Outcome.CANCELLED


@pytest.mark.parametrize("parameters", ALL)
def test_8_2_several_programs_on_one_tape_each_wait_for_cycle_start(parameters: ParameterSet) -> None:
    shop = Shop(parameters, blocks_per_second=100).dnc().until(Motion.ENDED)
    assert shop.blocks == 4
    shop.world.run_for(10**10)
    assert shop.blocks == 4
    shop.nc.cycle_start(shop.world.now)
    assert shop.both_end() == (Outcome.COMPLETE, Outcome.COMPLETE)


# -- stops ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("block", "switch", "after"),
    [
        (b"M00\n", Switch.OFF, After.STOP),
        (b"M0\n", Switch.OFF, After.STOP),
        (b"N5 G01 X1. M01\n", Switch.ON, After.STOP),
        (b"M01\n", Switch.OFF, After.GO_ON),
        (b"M02\n", Switch.OFF, After.END),
        (b"X1.M30\n", Switch.OFF, After.END),
        (b"M300\n", Switch.OFF, After.GO_ON),
        (b"M003\n", Switch.OFF, After.GO_ON),
        (b"(M30)\n", Switch.OFF, After.GO_ON),
        (b"%", Switch.OFF, After.GO_ON),
    ],
)
@pytest.mark.parametrize("code", [DataCode.ISO, DataCode.EIA, DataCode.ASCII])
def test_what_stops_a_program(block: bytes, switch: Switch, after: After, code: DataCode) -> None:
    flow = ProgramFlow(code)
    flow.optional_stop = switch
    assert flow.judge(encode(block, code)).after is after


@pytest.mark.parametrize("switch", Switch)
def test_optional_stop(switch: Switch) -> None:
    shop = Shop(blocks_per_second=100)
    shop.nc.turn_optional_stop(switch)
    shop.dnc(b"%\nX1.\nM01\nX2.\nM30\n%")
    if switch is Switch.ON:
        shop.until(Motion.PROGRAM_STOP)
        assert shop.blocks == 3
        shop.nc.cycle_start(shop.world.now)
    assert shop.end() is Outcome.COMPLETE


def test_feed_hold_and_cycle_start() -> None:
    shop = Shop(blocks_per_second=2).dnc()
    shop.world.run_until(lambda: shop.blocks == 1)
    shop.nc.feed_hold(shop.world.now)
    shop.world.run_for(10**11)
    assert shop.blocks == 1
    shop.nc.cycle_start(shop.world.now)
    shop.until(Motion.ENDED)
    assert shop.blocks == 4


# -- 10: devices and parameters ------------------------------------------------------------------------------


ACTS: dict[str, tuple[int, Callable[[Nc], None]]] = {
    "dnc": (20, lambda nc: nc.cycle_start(0)),
    "read": (20, lambda nc: nc.read(0)),
    "read in the background": (22, lambda nc: nc.read(0, Ground.BACKGROUND)),
    "punch": (21, lambda nc: nc.punch_parameters(0)),
    "punch in the background": (23, lambda nc: nc.punch_parameters(0, Ground.BACKGROUND)),
}


@pytest.mark.parametrize("act", ACTS)
@pytest.mark.parametrize("number", DEVICES)
def test_10_1_each_ground_has_its_devices(number: int, act: str) -> None:
    nc = Shop(B.with_values({number: 4})).nc
    device, begin = ACTS[act]
    begin(nc)
    assert [alarm.number for alarm in nc.alarms] == (["SR807"] if device == number else [])
    assert all(f"No. 00{number} is 4" in alarm.text for alarm in nc.alarms)
    assert (nc.operation is Operation.NONE) is (device == number)


@pytest.mark.parametrize("number", [5072, 5073, 5074])
def test_11_sr807_comes_at_cycle_start_and_nothing_goes_over_the_line(number: int) -> None:
    shop = Shop()
    shop.nc.parameters.enter(number, 99)
    shop.nc.parameters.power_off_and_on()
    for begin in (shop.nc.cycle_start, shop.nc.read, shop.nc.punch_parameters):
        begin(0)
        assert [alarm.number for alarm in shop.nc.alarms] == ["SR807"]
        assert f"No. {number}" in shop.nc.alarms[0].text
        with pytest.raises(UsageError, match="RESET first"):
            begin(0)
        shop.nc.reset(0)
    assert shop.nc.operation is Operation.NONE
    shop.world.run_until_quiet()
    assert shop.pair.cnc_end is None


def test_11_sr807_without_a_remote_buffer() -> None:
    shop = Shop()
    nc = WorldNc(shop.pair, ParameterMemory(ParameterSet({20: 10}), None), None)
    nc.cycle_start(0)
    assert [alarm.number for alarm in nc.alarms] == ["SR807"]


def test_10_a_value_that_waits_for_power_off_and_on_changes_nothing_yet() -> None:
    shop = Shop()
    shop.nc.parameters.enter(5074, 9)
    assert shop.dnc(b"%\nM30\n%").end() is Outcome.COMPLETE
    assert shop.nc.alarms == []


# -- reading into the memory ---------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", ALL)
@pytest.mark.parametrize("ground", Ground)
def test_8_2_a_tape_is_read_into_the_memory(parameters: ParameterSet, ground: Ground) -> None:
    shop = Shop(parameters).arm()
    shop.nc.read(0, ground)
    assert shop.both_end() == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert shop.nc.memory.programs == {1: b"O0001(FIRST)\nG91G01X1.\nM02\n", 2: b"O0002\nX2.\nM30\n"}
    assert shop.nc.registration is not None
    assert shop.nc.registration.registered == (1, 2)


@pytest.mark.parametrize("byte", [0, ASCII])
def test_10_0000_2_programs_with_and_without_parity(byte: int) -> None:
    code = DataCode.ASCII if byte & 4 else DataCode.ISO
    shop = Shop(B.with_values({0: byte})).arm(encode(TAPE, code))
    shop.nc.read(0)
    assert shop.end() is Outcome.COMPLETE
    assert sorted(shop.nc.memory.programs) == [1, 2]


def test_10_0000_2_a_tape_without_parity_where_it_is_expected_is_not_registered() -> None:
    shop = Shop(B.with_values({0: 0})).arm(TAPE)
    shop.nc.read(0)
    shop.end()
    assert shop.nc.memory.programs == {}
    assert shop.nc.registration is not None
    assert "wrong parity" in shop.nc.registration.refused[0]


@pytest.mark.parametrize(("byte", "read"), [(ASCII, [1]), (ASCII | 1, []), (ASCII | 3, [1])])
def test_10_0000_0_and_1_the_tv_check_keeps_an_odd_block_out(byte: int, read: list[int]) -> None:
    """With its comment and EOB the first block has 11 characters, without the comment 6."""
    shop = Shop(B.with_values({0: byte})).arm(b"%\nO0001(ABC)\nX1.\n%")
    shop.nc.read(0)
    shop.end()
    assert shop.nc.registration is not None
    assert bool(shop.nc.registration.refused) is (read == [])
    assert sorted(shop.nc.memory.programs) == read


def test_9_3_note_7_and_11_sr891_binary_input_operation_is_not_registered() -> None:
    shop = Shop().arm(b"%\nO1\nM30\nO2\nG05\n" + bytes(7) + b"\nM30\n%")
    shop.nc.read(0)
    assert shop.end() is Outcome.COMPLETE
    assert [alarm.number for alarm in shop.nc.alarms] == ["SR891"]
    assert shop.nc.memory.programs == {1: b"O1\nM30\n"}


# -- punching ------------------------------------------------------------------------------------------------


def punched(shop: Shop) -> bytes:
    shop.world.run_until(lambda: shop.pair.host_end is not None and shop.pair.cnc_end is not None)
    return shop.pair.received.getvalue()


@pytest.mark.parametrize("ground", Ground)
@pytest.mark.parametrize("protocol", [1, 2])
def test_1_2_programs_are_uploaded(ground: Ground, protocol: int) -> None:
    shop = Shop(B.with_values({5074: protocol}))
    shop.nc.memory.read(TAPE)
    shop.pair.host.receive(shop.pair.received, 0)
    shop.nc.punch_programs(0, ground=ground)
    assert punched(shop) == TAPE.replace(b"TITLE", b"")
    assert shop.end() is Outcome.COMPLETE


def test_1_2_parameters_are_uploaded_and_suit_the_host_again() -> None:
    shop = Shop()
    shop.pair.host.receive(shop.pair.received, 0)
    shop.nc.punch_parameters(0)
    text = punched(shop).decode()
    assert text.startswith("%\nN0000 P00001100\nN0020 P10\n")
    assert text.endswith("N5074 P1\n%")


def test_10_2_5071_1_punches_feed_and_0000_lf_cr_cr() -> None:
    shop = Shop(B.with_values({0: 0b00100, 5071: 1}))
    shop.pair.host.receive(shop.pair.received, 0)
    shop.nc.punch_parameters(0)
    tape = punched(shop)
    assert tape[:FEED_BYTES] == tape[-FEED_BYTES:] == bytes(FEED_BYTES)
    assert tape[FEED_BYTES:].startswith(b"%\n\r\rN0000 P00000100\n\r\r")


def test_protocol_a_has_no_punch_out() -> None:
    shop = Shop(A)
    with pytest.raises(UsageError):
        shop.nc.punch_parameters(0)
    assert shop.dnc(b"%\nM30\n%").end() is Outcome.COMPLETE


# -- 6.4: RESET and STOP in the foreground and in the background -----------------------------------------------


LONG = b"%\nO0001\n" + b"G91G01X1.F100\n" * 300 + b"M30\n%"


@pytest.mark.parametrize(
    ("ground", "outcome"), [(Ground.FOREGROUND, Outcome.CANCELLED), (Ground.BACKGROUND, Outcome.COMPLETE)]
)
def test_6_4_note_1_a_reset_ends_a_communication_in_the_foreground_alone(ground: Ground, outcome: Outcome) -> None:
    shop = Shop().arm(LONG)
    shop.nc.read(0, ground)
    shop.world.run_until(lambda: shop.pair.cnc.progress > 100)
    shop.nc.reset(shop.world.now)
    assert shop.both_end()[1] is outcome


@pytest.mark.parametrize("ground", Ground)
def test_6_4_note_1_stop_ends_it_in_both(ground: Ground) -> None:
    shop = Shop().arm(LONG)
    shop.nc.read(0, ground)
    shop.world.run_until(lambda: shop.pair.cnc.progress > 100)
    shop.nc.stop(shop.world.now)
    assert shop.both_end()[1] is Outcome.CANCELLED


@pytest.mark.parametrize("presses", [1, 9])
def test_6_4_note_2_stop_lets_what_is_in_the_buffers_go_out(presses: int) -> None:
    shop = Shop()
    shop.nc.memory.read(LONG)
    shop.pair.host.receive(shop.pair.received, 0)
    shop.nc.punch_programs(0)
    shop.world.run_until(lambda: len(shop.pair.received.getvalue()) > 500)
    before = len(shop.pair.received.getvalue())
    for _ in range(presses):
        shop.nc.stop(shop.world.now)
        shop.world.run_for(SECOND // 20)
    shop.both_end()
    after = len(shop.pair.received.getvalue())
    assert 200 <= after - before <= 600
    assert shop.pair.host_end is not None
    assert shop.pair.host_end.outcome is not Outcome.COMPLETE


def test_one_operation_at_a_time() -> None:
    shop = Shop().arm()
    shop.nc.read(0, Ground.BACKGROUND)
    with pytest.raises(UsageError, match="at work: read into the memory, in the background"):
        shop.nc.cycle_start(0)
    with pytest.raises(UsageError, match="at work"):
        shop.nc.punch_parameters(0)
    assert shop.end() is Outcome.COMPLETE


# -- the PMC -------------------------------------------------------------------------------------------------


def test_4_4_2_the_images_are_g152_and_f152() -> None:
    shop = Shop(A)
    shop.nc.g152 = 0xA5
    assert shop.nc.g152 == 0xA5
    assert shop.nc.f152 == 0
    shop.pair.host.set_do(0x3C, 0)  # type: ignore[attr-defined]
    shop.dnc(LONG).end()
    assert shop.nc.f152 == 0x3C
    with pytest.raises(UsageError, match="only protocol A"):
        _ = Shop(B).nc.f152


# -- 11: alarms of the program -------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", ALL)
@pytest.mark.parametrize(("block", "number"), [(b"G123", "PS10"), (b"E5.", "PS11"), (b"X1.\x13", "PS12")])
def test_11_ps10_to_ps12_stop_before_the_block(parameters: ParameterSet, block: bytes, number: str) -> None:
    flow = ProgramFlow(DataCode.ASCII, check=BlockCheck())
    shop = Shop(parameters, flow=flow, blocks_per_second=100).dnc(
        b"%\nX1.\n" + block + b"\n" + b"X2.\n" * 4000 + b"M30\n%"
    )
    assert shop.both_end()[1] is Outcome.FAILED
    assert (shop.alarms, shop.blocks) == ([number], 2)


def test_11_sr890_a_wrong_check_byte() -> None:
    shop = Shop(blocks_per_second=100).dnc(b"%\nG05\n" + bytes((0, 2, 0, 0, 0, 0, 9)) * 3000 + b"\nM30\n%")
    assert shop.both_end()[1] is Outcome.FAILED
    assert shop.alarms == ["SR890"]


# -- whatever the operator does ------------------------------------------------------------------------------

KEYS: dict[str, Callable[[WorldNc, int], object]] = {
    "cycle start": lambda nc, now: nc.cycle_start(now),
    "feed hold": lambda nc, now: nc.feed_hold(now),
    "reset": lambda nc, now: nc.reset(now),
    "stop": lambda nc, now: nc.stop(now),
    "read": lambda nc, now: nc.read(now),
    "read in the background": lambda nc, now: nc.read(now, Ground.BACKGROUND),
    "punch": lambda nc, now: nc.punch_parameters(now),
    "punch programs": lambda nc, now: nc.punch_programs(now),
    "a wrong request": lambda nc, now: nc.board.request(99, now),
    "memory": lambda nc, now: nc.board.memory.byte(nc.board.memory.address(Address.BUFFER)),
}
acts = st.lists(st.tuples(st.sampled_from(sorted(KEYS)), st.integers(0, 3 * 10**9)), max_size=8)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(ALL), acts, st.booleans())
def test_whatever_the_operator_does_a_reset_brings_the_control_to_rest(
    parameters: ParameterSet, keys: list[tuple[str, int]], armed: bool
) -> None:
    shop = Shop(parameters, blocks_per_second=20)
    if armed:
        shop.arm(LONG)
    elif parameters is not A:
        shop.pair.host.receive(shop.pair.received, 0)
    for key, wait in keys:
        with suppress(UsageError):
            KEYS[key](shop.nc, shop.world.now)
        shop.world.run_for(wait)
    shop.nc.stop(shop.world.now)
    shop.pair.control.reset(shop.world.now)
    shop.world.run_for(60 * SECOND)
    shop.nc.reset(shop.world.now)
    assert shop.nc.operation is Operation.NONE
    assert shop.pair.control.idle
    assert shop.pair.cnc.buffered == 0
    assert shop.nc.alarms == []
    assert shop.nc.board.status is BoardStatus.IDLE
