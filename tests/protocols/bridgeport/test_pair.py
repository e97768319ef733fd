"""Both ends on one simulated cable: every reading of the lost codes against one host that does not change."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from tapewire.engine import AfterStop, LineFault, Outcome
from tapewire.line.transport import Fault, LineItem
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tapewire.sim.world import World
from tests.protocols.bridgeport.combinations import (
    CANCELS,
    COMBINATIONS,
    NAME_ENDS,
    OPERATIONS,
    SAVE_ENDS,
    cancel,
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


DISTURBANCES: dict[str, Callable[[int], LineItem]] = {
    **{f"bit {bit}": lambda byte, bit=bit: bytes([byte ^ 1 << bit]) for bit in range(7)},  # type: ignore[misc]
    "parity error": lambda byte: Fault(fault=LineFault.PARITY, byte=byte ^ 1),
    "framing error": lambda byte: Fault(fault=LineFault.FRAMING, byte=0),
    "lost": lambda byte: b"",
    "noise": lambda byte: bytes([byte, 0x7E]),
}
LINK_PROGRAM = b"N10G1X1F5\r\nN20Y1\r\nN30M2\r\n"
LINK_CHARACTERS = 33
"""DC1 to the name, three records with ETB and LRC, and EOT."""


@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_record_disturbed_anywhere_arrives_byte_exact(disturbance: str) -> None:
    """Every character from the first of the first record to the last check character."""
    for position in range(1, LINK_CHARACTERS - 1):
        world, pair = pair_of({}, {"record_bytes": "12", "lrc": "xor7_etb"}, mode="D")
        disturbed = Disturbed(pair.cnc_link.transport, position, DISTURBANCES[disturbance])
        pair.cnc_link.transport = disturbed
        host, cnc = read(world, pair, LINK_PROGRAM)
        assert disturbed.done
        assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE), (position, pair.transcript)
        assert pair.program.getvalue() == LINK_PROGRAM, (position, str(pair.transcript))


@pytest.mark.parametrize("position", [1, 20, 54])
def test_4_1_1_a_load_with_a_damaged_character_is_cancelled(position: int) -> None:
    world, pair = pair_of({}, mode="L")
    pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, position, DISTURBANCES["parity error"])
    host, cnc = read(world, pair, SHORT)
    assert host.outcome is Outcome.CANCELLED
    assert cnc.outcome is Outcome.FAILED
    assert host.bytes_low <= cnc.bytes_high
