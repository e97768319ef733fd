"""Every reading of the lost codes: what a control may say, and one host that does not change for any of them.

A share of the product runs with the tests; `python -m benchmarks.bridgeport_combinations` runs all of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import Final

from tapewire.engine import SECOND, Ended, LineFault, Outcome, Violation
from tapewire.line.transport import Fault, LineItem
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, Lrc
from tapewire.sim.world import Pair, World
from tests.protocols.bridgeport.disturbed import Disturbed
from tests.protocols.bridgeport.host_rig import P

HOST: Final = {"lrc": "auto", "record_bytes": "12"}
"""The one configuration of the host: short records, so that a short program has several of them."""

NAME_ENDS: Final = ("14", "04", "0D 0A 14", "0D 0A 04", "04 14")
SAVE_ENDS: Final = ("04 14", "04", "14", "14 04")
CANCELS: Final = ("13 10", "10 04", "10 10", "10 13", "10 14", "10", "10 03", "10 18")
COMBINATIONS: Final = [
    {"name_trailer": name, "save_trailer": save, "operator_cancel": cancel, "lrc": lrc, "dnc_end": end}
    for name, save, cancel, lrc, end in itertools.product(NAME_ENDS, SAVE_ENDS, CANCELS, LRC_CANDIDATES, DncEnd)
]

DISTURBANCES: Final[Mapping[str, Callable[[int], LineItem]]] = {
    **{f"bit {bit}": lambda byte, bit=bit: bytes([byte ^ 1 << bit]) for bit in range(7)},  # type: ignore[misc]
    "parity error": lambda byte: Fault(fault=LineFault.PARITY, byte=byte ^ 1),
    "framing error": lambda byte: Fault(fault=LineFault.FRAMING, byte=0),
    "lost": lambda byte: b"",
    "noise": lambda byte: bytes([byte, 0x7E]),
}
"""What the line makes of one character."""

LINK_PROGRAM: Final = b"N10G1X1F5\r\nN20Y1\r\nN30M2\r\n"
LINK_CHARACTERS: Final = 32
"""DC1 to the name and three records with ETB and LRC: the host's characters before EOT."""

ARRIVED: Final = "byte-exact"
CANCELLED: Final = "cancelled, the next one byte-exact"


def pair_of(combination: Mapping[str, str], host: Mapping[str, str] | None = None, **cnc: str) -> tuple[World, Pair]:
    world = World()
    settings = {"program": "1234", **combination, **cnc}
    return world, world.pair("bridgeport", host_settings={**HOST, **(host or {})}, cnc_settings=settings)


def read(world: World, pair: Pair, program: bytes) -> tuple[Ended, Ended]:
    begin_read(world, pair, program)
    return finish(world, pair)


def begin_read(world: World, pair: Pair, program: bytes) -> None:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)


def save(world: World, pair: Pair, program: bytes) -> tuple[Ended, Ended]:
    begin_save(world, pair, program)
    return finish(world, pair)


def begin_save(world: World, pair: Pair, program: bytes) -> None:
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(program), world.now)


def finish(world: World, pair: Pair) -> tuple[Ended, Ended]:
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None, limit=7200 * SECOND)
    assert pair.host_end is not None
    assert pair.cnc_end is not None
    return pair.host_end, pair.cnc_end


def load(combination: Mapping[str, str]) -> str:
    world, pair = pair_of(combination, mode="L")
    both_complete(read(world, pair, P))
    assert pair.program.getvalue() == P
    return ARRIVED


def link(combination: Mapping[str, str]) -> str:
    """A control that expects another end than the host's has the whole text, and says why it refuses it."""
    world, pair = pair_of(combination, mode="D")
    host, cnc = read(world, pair, P)
    assert pair.program.getvalue() == P
    if combination["dnc_end"] in (DncEnd.EOT_ON_ACK, DncEnd.EOT_AFTER_LRC):
        both_complete((host, cnc))
        return ARRIVED
    assert host.outcome is Outcome.CANCELLED
    assert "sent whole, then cancelled at the control" in host.reason
    assert f"dnc_end={combination['dnc_end']}" in cnc.reason
    return f"refused: {cnc.reason}"


def save_to_host(combination: Mapping[str, str]) -> str:
    world, pair = pair_of(combination)
    both_complete(save(world, pair, P))
    assert pair.received.getvalue() == P
    return ARRIVED


def cancel_load(combination: Mapping[str, str]) -> str:
    return cancel(combination, "L")


def cancel_link(combination: Mapping[str, str]) -> str:
    return cancel(combination, "D")


def cancel_save(combination: Mapping[str, str]) -> str:
    return cancel(combination, "save")


def cancel(combination: Mapping[str, str], what: str) -> str:
    """Cancelled in the middle: both ends say so, the host is silent, and the next transfer is a new one."""
    world, pair = pair_of(combination, mode=what if what in "LD" else "L")
    (begin_save if what == "save" else begin_read)(world, pair, P)
    world.run_until(lambda: max(pair.host.progress, pair.cnc.progress) > 10)
    pair.cnc.reset(world.now)
    host, cnc = finish(world, pair)
    assert (host.outcome, cnc.outcome) == (Outcome.CANCELLED, Outcome.CANCELLED)
    sent = pair.host_link.characters_sent
    world.run_for(5 * SECOND)
    assert pair.host_link.characters_sent == sent, "the host says something after a cancel"
    strange = [event for _, event in pair.host_events if isinstance(event, Violation) and "NAK" not in event.what]
    assert not strange
    anew(world, pair, what, combination)
    return CANCELLED


def anew(world: World, pair: Pair, what: str, combination: Mapping[str, str]) -> None:
    pair.host_end = pair.cnc_end = None
    for taken in (pair.program, pair.received):
        taken.seek(0)
        taken.truncate()
    if what == "save":
        both_complete(save(world, pair, P))
        assert pair.received.getvalue() == P
        return
    host, cnc = read(world, pair, P)
    assert pair.program.getvalue() == P
    if what == "L" or combination["dnc_end"] in (DncEnd.EOT_ON_ACK, DncEnd.EOT_AFTER_LRC):
        both_complete((host, cnc))


def both_complete(ends: tuple[Ended, Ended]) -> None:
    assert [end.outcome for end in ends] == [Outcome.COMPLETE, Outcome.COMPLETE], [end.reason for end in ends]


OPERATIONS: Final[Mapping[str, Callable[[Mapping[str, str]], str]]] = {
    "load": load,
    "link": link,
    "save": save_to_host,
    "cancel of a load": cancel_load,
    "cancel of a link": cancel_link,
    "cancel of a save": cancel_save,
}


def disturbed_link(position: int, disturbance: str, lrc: Lrc) -> str:
    """One character of three records disturbed, by each of the rules alone: no parity but where it is the fault."""
    world, pair = pair_of({"lrc": lrc}, {"lrc": lrc}, mode="D")
    disturbed = Disturbed(pair.cnc_link.transport, position, DISTURBANCES[disturbance])
    pair.cnc_link.transport = disturbed
    both_complete(read(world, pair, LINK_PROGRAM))
    assert disturbed.done
    assert pair.program.getvalue() == LINK_PROGRAM, (position, disturbance, lrc, str(pair.transcript))
    return ARRIVED
