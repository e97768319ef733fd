"""Sentences of chapters 8, 9, 10 and 12 that only the whole control shows: parameters in, and what is on the wire."""

from __future__ import annotations

import pytest

from tapewire.engine import SECOND, Outcome
from tapewire.fanuc.diagnosis import Case, Seen, diagnose
from tapewire.fanuc.host_settings import host_settings
from tapewire.fanuc.leds import read_leds
from tapewire.fanuc.parameters import Interface, ParameterSet
from tapewire.protocols.settings import End, Switch
from tapewire.sim.machine import Motion
from tapewire.transfer.session import settings_for
from tests.sim.test_nc import ALL, TAPE, A, B, Shop

RECORD = bytes((0, 2, 0, 4, 0, 6))
RECORDS = 50
SECTION = b"G05\n" + (RECORD + bytes((sum(RECORD),))) * RECORDS + bytes(7) + b"\n"
BINARY = {7609: 0, 7618: 0, 7635: 3}
RS_232_C = ParameterSet({0: 0b01100, 20: 10, 5000: 0, 5081: 3, 5082: 1, 5083: 12, 5084: 1})


def wire(parameters: ParameterSet, *, reset: bool = False) -> bytes:
    """All that the remote buffer says in one DNC operation."""
    shop = Shop(parameters, blocks_per_second=100)
    said = bytearray()
    shop.pair.cnc_link.on_write = said.extend
    shop.dnc(b"%\n" + b"X1.\n" * (5000 if reset else 10) + b"M30\n%")
    if reset:
        shop.world.run_until(lambda: shop.pair.cnc.progress > 100, limit=60 * SECOND)
        shop.nc.reset(shop.world.now)
    shop.world.run_for(30 * SECOND)
    return bytes(said)


@pytest.mark.parametrize("protocol", ["fanuc-a", "fanuc-a-expansion"])
def test_8_1_and_10_2_5074_3_the_host_chooses_the_expansion_and_the_data_is_the_same(protocol: str) -> None:
    shop = Shop(A, protocol=protocol).dnc().until(Motion.ENDED)
    shop.nc.cycle_start(shop.world.now)
    assert shop.end() is Outcome.COMPLETE
    assert shop.pair.program.getvalue() == TAPE


@pytest.mark.parametrize(("bit", "dc3"), [(0, b"\x93"), (1, b"\x13")])
@pytest.mark.parametrize("protocol", [1, 2])
def test_10_2_5000_2_is_the_form_of_the_control_codes_of_protocol_b(bit: int, dc3: bytes, protocol: int) -> None:
    said = wire(B.with_values({5000: 0b00001 | bit << 2, 5074: protocol}))
    assert said == b"\x11" + dc3


@pytest.mark.parametrize("bit", [0, 1])
@pytest.mark.parametrize(("end_bit", "end"), [(0, b"\r"), (1, b"\x03")])
def test_10_2_5000_2_and_3_are_the_code_and_the_end_code_of_protocol_a(bit: int, end_bit: int, end: bytes) -> None:
    """Behind the two characters of its sum."""
    said = wire(A.with_values({5000: 0b00001 | bit << 2 | end_bit << 3}))
    word = b"SYN" + end
    assert said[2:].startswith(bytes(byte | (byte.bit_count() % 2) << 7 for byte in word) if bit else word)


@pytest.mark.parametrize(("bit", "last"), [(0, b"\x93"), (1, b"\x93\x96")])
def test_10_2_5000_3_posts_a_reset_by_syn_or_not(bit: int, last: bytes) -> None:
    said = wire(B.with_values({5000: 0b00001 | bit << 3}), reset=True)
    assert said.endswith(last)
    assert (b"\x96" in said) is bool(bit)


@pytest.mark.parametrize(("stop_bits", "framing"), [(1, "8E1"), (2, "8N2")])
@pytest.mark.parametrize(("parameters", "number"), [(B, 5072), (RS_232_C, 5082)])
def test_10_2_5072_and_5082_one_stop_bit_goes_with_parity(
    parameters: ParameterSet, number: int, stop_bits: int, framing: str
) -> None:
    host = host_settings(parameters.with_values({number: stop_bits}))
    job = settings_for(End.HOST, "pty:x", host.protocol, stopbits=host.stopbits, settings=host.settings)
    assert job.origin.framing == framing


@pytest.mark.parametrize("board", Interface)
def test_10_2_5000_0_the_board_decides_which_numbers_count(board: Interface) -> None:
    both = B.with_values({5081: 3, 5082: 2, 5083: 9, 5084: 1})
    host = host_settings(both, board=board)
    assert (host.baud, host.stopbits) == ((19200, 1) if board is Interface.RS_422 else (2400, 2))


# -- 9.3: binary input operation at the control --------------------------------------------------------------


def moved(shop: Shop) -> tuple[int, list[int]]:
    assert shop.pair.control.binary is not None
    return shop.pair.control.binary.records_executed, shop.pair.control.binary.position


@pytest.mark.parametrize("parameters", ALL)
@pytest.mark.parametrize("modal", [b"G00", b"G02", b"G03", b"G90"])
def test_9_3_note_1_records_are_incremental_moves_whatever_was_modal_before(
    parameters: ParameterSet, modal: bytes
) -> None:
    shop = Shop(parameters.with_values(BINARY), blocks_per_second=100)
    shop.dnc(b"%\n" + modal + b"\n" + SECTION + b"X5.\nM30\n%")
    assert shop.end() is Outcome.COMPLETE
    assert moved(shop) == (RECORDS, [RECORDS, 2 * RECORDS, 3 * RECORDS])
    assert shop.blocks == len(b"%|G00|G05||X5.|M30".split(b"|"))


@pytest.mark.parametrize("among_records", [0, 1])
def test_9_3_note_3_and_10_3_2007_single_block_stops_between_records_or_not(among_records: int) -> None:
    shop = Shop(B.with_values({**BINARY, 2007: among_records << 3}), blocks_per_second=100)
    shop.nc.turn_single_block(Switch.ON)
    shop.dnc(b"%\n" + SECTION + b"X5.\nM30\n%")
    stops = []
    while shop.pair.cnc_end is None or not shop.pair.control.idle:
        shop.world.advance(lambda: shop.pair.control.motion is Motion.STOPPED, shop.world.now + SECOND)
        stops.append(moved(shop)[0])
        shop.nc.cycle_start(shop.world.now)
    assert sorted(set(stops)) == ([*range(RECORDS + 1)] if among_records else [0, RECORDS])
    assert moved(shop)[1] == [RECORDS, 2 * RECORDS, 3 * RECORDS]


def test_9_3_note_4_feed_hold_holds_the_records() -> None:
    shop = Shop(B.with_values(BINARY), blocks_per_second=100).dnc(b"%\n" + SECTION + b"M30\n%")
    shop.world.run_until(lambda: moved(shop)[0] == 10, limit=60 * SECOND)
    shop.nc.feed_hold(shop.world.now)
    shop.world.run_for(60 * SECOND)
    assert moved(shop)[0] == 10
    shop.nc.cycle_start(shop.world.now)
    assert shop.end() is Outcome.COMPLETE
    assert moved(shop)[0] == RECORDS


# -- 12.2: the procedure on a control that stands still ------------------------------------------------------


def looked_at(shop: Shop) -> Case:
    """What somebody finds who reads the LEDs and the pointers."""
    green = shop.nc.board.panel.partition(";")[0].removeprefix("green ")
    memory = shop.nc.board.memory
    pointers = (memory.read_pointer, memory.write_pointer)
    return diagnose(Seen(parameters=shop.nc.parameters.in_force, green=read_leds(green), pointers=pointers)).case


@pytest.mark.parametrize("parameters", ALL)
def test_12_2_1_nothing_is_asked_then_the_host_is_silent_then_the_nc_stands(parameters: ParameterSet) -> None:
    shop = Shop(parameters, blocks_per_second=5)
    assert looked_at(shop) is Case.NOT_ASKED
    shop.nc.cycle_start(shop.world.now)
    shop.world.run_for(15 * SECOND)
    assert looked_at(shop) is Case.HOST_OR_BUFFER
    shop.nc.reset(shop.world.now)
    shop.world.run_for(5 * SECOND)
    shop.dnc(b"%\n" + b"X1.\n" * 500 + b"M30\n%")
    shop.world.run_until(lambda: shop.pair.cnc.buffered > 300, limit=60 * SECOND)
    shop.nc.feed_hold(shop.world.now)
    shop.world.run_for(SECOND)
    assert looked_at(shop) is Case.CONTROL
