"""Both ends on one simulated cable: every reading of the lost codes against one host that does not change."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from io import BytesIO

import pytest

from tapewire.engine import SECOND, AfterStop, Ended, LineFault, Outcome, Violation
from tapewire.line.transport import Fault, LineItem
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tapewire.sim.world import Pair, World
from tests.protocols.bridgeport.disturbed import Disturbed
from tests.protocols.bridgeport.host_rig import P, surfacing

HOST = {"lrc": "auto"}
"""The one configuration of the host."""

NAME_ENDS = ("14", "04", "0D 0A 14", "0D 0A 04", "04 14")
SAVE_ENDS = ("04 14", "04", "14", "14 04")
CANCELS = ("13 10", "10 04", "10 10", "10 13", "10 14", "10", "10 03", "10 18")
COMBINATIONS = [
    {"name_trailer": name, "save_trailer": save, "operator_cancel": cancel, "lrc": lrc, "dnc_end": end}
    for name, save, cancel, lrc, end in itertools.product(NAME_ENDS, SAVE_ENDS, CANCELS, LRC_CANDIDATES, DncEnd)
]
THINNED = 23
"""Prime to the size of every dimension, so that each value meets each other value."""

SHORT = P * 3
"""54 bytes."""


def pair_of(combination: dict[str, str], host: dict[str, str] | None = None, **cnc: str) -> tuple[World, Pair]:
    world = World()
    settings = {"program": "1234", **combination, **cnc}
    return world, world.pair("bridgeport", host_settings={**HOST, **(host or {})}, cnc_settings=settings)


def read(world: World, pair: Pair, program: bytes) -> tuple[Ended, Ended]:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    return finish(world, pair)


def save(world: World, pair: Pair, program: bytes) -> tuple[Ended, Ended]:
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(program), world.now)
    return finish(world, pair)


def finish(world: World, pair: Pair) -> tuple[Ended, Ended]:
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None, limit=7200 * SECOND)
    assert pair.host_end is not None
    assert pair.cnc_end is not None
    return pair.host_end, pair.cnc_end


def load_arrives(combination: dict[str, str]) -> None:
    world, pair = pair_of(combination, mode="L")
    host, cnc = read(world, pair, SHORT)
    assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert pair.program.getvalue() == SHORT


def link_arrives_or_is_refused(combination: dict[str, str]) -> None:
    world, pair = pair_of(combination, mode="D")
    host, cnc = read(world, pair, SHORT)
    assert pair.program.getvalue() == SHORT
    if combination["dnc_end"] in (DncEnd.EOT_ON_ACK, DncEnd.EOT_AFTER_LRC):
        assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    else:
        assert host.outcome is Outcome.CANCELLED
        assert "sent whole, then cancelled at the control" in host.reason
        assert f"dnc_end={combination['dnc_end']}" in cnc.reason


def save_arrives(combination: dict[str, str]) -> None:
    world, pair = pair_of(combination)
    host, cnc = save(world, pair, SHORT)
    assert (host.outcome, cnc.outcome) == (Outcome.COMPLETE, Outcome.COMPLETE)
    assert pair.received.getvalue() == SHORT


def cancel_is_heard(combination: dict[str, str], what: str = "D") -> None:
    world, pair = pair_of(combination, mode=what if what in "LD" else "D")
    if what == "save":
        pair.host.receive(pair.received, world.now)
        pair.cnc.punch(BytesIO(SHORT * 4), world.now)
    else:
        pair.host.start(BytesIO(SHORT * 4), world.now)
        pair.cnc.cycle_start(world.now)
    world.run_until(lambda: max(pair.host.progress, pair.cnc.progress) > 40)
    pair.cnc.reset(world.now)
    host, cnc = finish(world, pair)
    assert (host.outcome, cnc.outcome) == (Outcome.CANCELLED, Outcome.CANCELLED)
    world.run_for(5 * SECOND)
    assert not pair.host.data_to_send(16)
    assert not [event for _, event in pair.host_events if isinstance(event, Violation) and "NAK" not in event.what]


@pytest.mark.parametrize("part", range(16))
def test_one_host_against_every_reading_of_the_lost_codes(part: int) -> None:
    """Every 23rd of the 5,120 combinations, each with a load, a link, a save and a cancel."""
    for combination in COMBINATIONS[::THINNED][part::16]:
        for operation in (load_arrives, link_arrives_or_is_refused, save_arrives, cancel_is_heard):
            try:
                operation(combination)
            except AssertionError as error:
                raise AssertionError(f"{operation.__name__} {combination}: {error}") from error


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


@pytest.mark.parametrize("cancel", CANCELS)
@pytest.mark.parametrize("what", ["L", "D", "save"])
def test_cancel_by_every_pair_in_every_transfer(what: str, cancel: str) -> None:
    cancel_is_heard({"operator_cancel": cancel}, what)


@pytest.mark.parametrize("name", NAME_ENDS)
@pytest.mark.parametrize("ending", SAVE_ENDS)
def test_a_save_with_every_ending(name: str, ending: str) -> None:
    save_arrives({"name_trailer": name, "save_trailer": ending})


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
    world, pair = pair_of({}, {"lrc": "xor7_etb"}, mode="D")
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
