"""Both ends on one simulated cable: every reading of the lost codes against one host that does not change."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from io import BytesIO

import pytest

from tapewire.engine import SECOND, AfterStop, LineFault, Nanos, Outcome
from tapewire.line.transport import Fault, LineItem
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, Lrc, lrc_of
from tapewire.sim.world import World
from tests.protocols.bridgeport.combinations import (
    CANCELS,
    COMBINATIONS,
    DISTURBANCES,
    LINK_CHARACTERS,
    LINK_PROGRAM,
    NAME_ENDS,
    OPERATIONS,
    SAVE_ENDS,
    begin_read,
    begin_save,
    cancel,
    disturbed_link,
    finish,
    pair_of,
    read,
    save_to_host,
)
from tests.protocols.bridgeport.disturbed import Disturbed
from tests.protocols.bridgeport.host_rig import P, surfacing

THINNED = 23
"""Prime to the size of every dimension, so that each value meets each other value."""

SHORT = P * 3
"""54 bytes."""


@pytest.mark.parametrize("part", range(16))
def test_one_host_against_every_reading_of_the_lost_codes(part: int) -> None:
    """Every 23rd of the 5,120 combinations, each with a load, a link, a save, and a cancel of each."""
    for combination in COMBINATIONS[::THINNED][part::16]:
        for name, operation in OPERATIONS.items():
            try:
                operation(combination)
            except AssertionError as error:
                raise AssertionError(f"{name} {combination}: {error}") from error


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
@pytest.mark.parametrize("ends", list(itertools.product(DncEnd, DncEnd)), ids="-".join)
def test_every_pair_of_endings_arrives_or_is_refused(ends: tuple[DncEnd, DncEnd], lrc: str) -> None:
    host_end, cnc_end = ends
    world, pair = pair_of({"lrc": lrc}, {"dnc_end": host_end}, mode="D", dnc_end=cnc_end, nak_limit="20")
    host, cnc = read(world, pair, SHORT)
    if cnc.outcome is Outcome.COMPLETE:
        assert host.outcome is Outcome.COMPLETE
        assert pair.program.getvalue() == SHORT
    else:
        assert host_end is not cnc_end
        assert host.outcome is Outcome.CANCELLED
        assert cnc.reason
        assert SHORT.startswith(pair.program.getvalue())


@pytest.mark.parametrize("pair", CANCELS)
@pytest.mark.parametrize("what", ["L", "D", "save"])
def test_cancel_by_every_pair_in_every_transfer(what: str, pair: str) -> None:
    combination = {"operator_cancel": pair, "dnc_end": DncEnd.EOT_ON_ACK}
    assert cancel(combination, what)


@pytest.mark.parametrize("name", NAME_ENDS)
@pytest.mark.parametrize("ending", SAVE_ENDS)
def test_a_save_with_every_ending(name: str, ending: str) -> None:
    save_to_host({"name_trailer": name, "save_trailer": ending})


@pytest.mark.parametrize("mode", ["L", "D"])
@pytest.mark.parametrize("number", ["1", "999999", "-1"])
@pytest.mark.parametrize("parity", ["line", "software"])
def test_every_kind_of_request(number: str, mode: str, parity: str) -> None:
    world, pair = pair_of({"parity": parity}, {"parity": parity}, mode=mode, program=number)
    host, cnc = read(world, pair, SHORT)
    assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert pair.program.getvalue() == SHORT


def test_the_long_program_by_dnc_link() -> None:
    program = surfacing()
    world, pair = pair_of({}, {"lrc": "xor7_etb", "record_bytes": "256"}, mode="D")
    host, cnc = read(world, pair, program)
    assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert pair.program.getvalue() == program
    assert host.bytes_low == host.bytes_high == 12300


@pytest.mark.parametrize("baud", [300, 1200, 2400, 4800, 9600])
@pytest.mark.parametrize("hold", ["ack", "xoff"])
def test_3_2_at_most_three_characters_after_xoff(baud: int, hold: str) -> None:
    world = World()
    cnc = {"mode": "D", "hold": hold, "buffer": "600"}
    pair = world.pair("bridgeport", baud=baud, cnc_settings=cnc, blocks_per_second=baud / 11 / 22 * 0.6)
    program = surfacing(2000)
    host, cnc_end = read(world, pair, program)
    assert (host.outcome, cnc_end.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert pair.program.getvalue() == program
    after = [event.count for _, event in pair.cnc_events if isinstance(event, AfterStop)]
    assert max(after, default=0) <= 3
    assert bool(after) is (hold == "xoff")


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_link_disturbed_anywhere_arrives_byte_exact(disturbance: str, lrc: Lrc) -> None:
    """All places by the first candidate, a third of them by each other; all of all by the campaign."""
    step = 1 if lrc is LRC_CANDIDATES[0] else 3
    for position in range(LRC_CANDIDATES.index(lrc) % step, LINK_CHARACTERS, step):
        assert disturbed_link(position, disturbance, lrc)


@pytest.mark.parametrize("disturbance", [name for name in DISTURBANCES if name != "noise"])
def test_an_end_that_is_disturbed_leaves_the_control_waiting_with_all_of_the_program(disturbance: str) -> None:
    """No rule of the text tells the host, which says complete."""
    world, pair = pair_of({}, {"lrc": "xor7_etb"}, mode="D")
    pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, LINK_CHARACTERS, DISTURBANCES[disturbance])
    begin_read(world, pair, LINK_PROGRAM)
    world.run_for(60 * SECOND)
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE
    assert pair.cnc_end is None
    assert pair.program.getvalue() == LINK_PROGRAM


def faulty(fault: LineFault, bit: int) -> Callable[[int], LineItem]:
    return lambda byte: Fault(fault=fault, byte=byte ^ 1 << bit)


@pytest.mark.parametrize("nak_quiet", ["0", "0.2"])
def test_a_character_that_becomes_etb_doubles_nothing(nak_quiet: str) -> None:
    """A control that says NAK at once says it twice, for the record and for its rest, and gets two copies."""
    program = surfacing(300)
    for position in range(1, 290, 7):
        world, pair = pair_of({}, {"record_bytes": "256"}, mode="D", nak_quiet=nak_quiet)
        pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, position, lambda byte: b"\x17")
        begin_read(world, pair, program)
        world.run_for(60 * SECOND)
        assert pair.host_end is not None, position
        if pair.host_end.outcome is Outcome.COMPLETE:
            assert pair.program.getvalue() == program, (position, str(pair.transcript))
        else:
            assert "an ACK came inside" in pair.host_end.reason


def test_an_etb_that_fits_by_chance_is_no_complete_program() -> None:
    """The control acknowledges a part of the record, and refuses the rest."""
    program = surfacing(250)
    fits = [at for at in range(1, 240) if lrc_of(program[:at], 0x17, Lrc.XOR7_ETB) == program[at + 1]]
    assert fits
    for at in fits:
        world, pair = pair_of({}, {"record_bytes": "256", "lrc": "xor7_etb"}, mode="D")
        pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, at + 1, lambda byte: b"\x17")
        begin_read(world, pair, program)
        world.run_for(60 * SECOND)
        assert pair.host_end is not None
        assert pair.host_end.outcome is Outcome.FAILED, (at, str(pair.transcript))


NAME_CHARACTERS = 6
"""DC2 and `77;D`, which the host hears before DC4."""


@pytest.mark.parametrize("fault", [LineFault.PARITY, LineFault.FRAMING, LineFault.UART_OVERRUN])
def test_a_damaged_name_never_brings_another_program(fault: LineFault) -> None:
    for position, bit, mode in itertools.product(range(NAME_CHARACTERS), range(7), "LD"):
        world, pair = pair_of({}, mode=mode, program="77")
        pair.host_link.transport = Disturbed(pair.host_link.transport, position, faulty(fault, bit))
        pair.host.start(BytesIO(LINK_PROGRAM), world.now)
        pair.cnc.cycle_start(world.now)
        world.run_for(40 * SECOND)
        assert pair.program.getvalue() == (LINK_PROGRAM if position == 0 else b""), (position, str(pair.transcript))


@pytest.mark.parametrize("window", [1, 2, 3, 4, 16])
@pytest.mark.parametrize("after_stop", [0, 1, 3])
def test_3_2_a_save_stops_within_three_characters_or_within_what_its_uart_holds(window: int, after_stop: int) -> None:
    """Counted on the line: what the control still sends once it has received DC3."""
    world = World()
    settings = {"program": "1234", "mode": "L", "after_stop": str(after_stop)}
    pair = world.pair("bridgeport", cnc_settings=settings, cnc_window=window)
    sent: list[tuple[int, int]] = []
    listen = pair.cnc_link.on_item

    def count(item: LineItem, now: Nanos) -> None:
        if isinstance(item, bytes) and 0x13 in item:
            sent.append((pair.cnc_link.characters_sent, pair.cnc_link.transport.in_flight(now)))
        if listen is not None:
            listen(item, now)

    pair.cnc_link.on_item = count
    begin_save(world, pair, surfacing(400))
    world.run_until(lambda: pair.host.progress > 100)
    pair.host.hold_reception(world.now)
    world.run_for(SECOND)
    ((before, in_uart),) = sent
    assert in_uart <= window
    assert pair.cnc_link.characters_sent - before + in_uart == max(in_uart, after_stop)
    assert window > 3 or pair.cnc_link.characters_sent - before + in_uart <= 3
    pair.host.release(world.now)
    host, _ = finish(world, pair)
    assert host.outcome is Outcome.COMPLETE
    assert pair.received.getvalue() == surfacing(400)


@pytest.mark.parametrize("position", [1, 20, 54])
def test_4_1_1_a_load_with_a_damaged_character_is_cancelled(position: int) -> None:
    world, pair = pair_of({}, mode="L")
    pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, position, DISTURBANCES["parity error"])
    host, cnc = read(world, pair, SHORT)
    assert host.outcome is Outcome.CANCELLED
    assert cnc.outcome is Outcome.FAILED
    assert host.bytes_low <= cnc.bytes_high
