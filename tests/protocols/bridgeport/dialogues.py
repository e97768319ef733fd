"""Every kind of transfer of REMOTE LOAD and DNC LINK, played in the simulated world. The transcripts are kept in
tests/transcripts/bridgeport, where the golden test and docs/protocols/bridgeport.md find them.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, LineFault
from tapewire.line.transport import Fault
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.sim.world import Pair, World
from tests.protocols.bridgeport.disturbed import Disturbed
from tests.protocols.bridgeport.host_rig import LINK, Books, P, surfacing

NAME_CHARACTERS: Final = 1
"""What the control hears before the first record: DC1."""


def remote_load() -> World:
    """1.1, 1.2.1, 2.1: a name, a request, one text."""
    world, pair = machine(program="1234", mode="L")
    return read(world, pair, P)


def save() -> World:
    """1.1, 1.2.2: a name, and a program under it."""
    world, pair = machine(program="1234", mode="L")
    return punch(world, pair, P)


def dnc_link() -> World:
    """2.2, 4.2: records, of which the second arrives damaged once."""
    world, pair = machine({"record_bytes": "12"}, program="77", mode="D")
    in_second_record = NAME_CHARACTERS + 15
    pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, in_second_record, lambda byte: bytes([byte ^ 0x10]))
    return read(world, pair, LINK)


def dnc_link_whose_lrc_is_found() -> World:
    """2.2.4: the host tries the ways to compute the LRC; this control leaves ETB out."""
    world, pair = machine({"record_bytes": "12", "lrc": "auto"}, program="77", mode="D", lrc="xor7")
    return read(world, pair, LINK)


def dnc_link_with_eot_after_lrc() -> World:
    return dnc_link_ended_by("eot_after_lrc")


def dnc_link_with_etx_last() -> World:
    return dnc_link_ended_by("etx_last")


def dnc_link_with_empty_then_eot() -> World:
    return dnc_link_ended_by("empty_then_eot")


def dnc_link_ended_by(dnc_end: str) -> World:
    world, pair = machine({"record_bytes": "12", "dnc_end": dnc_end}, program="77", mode="D", dnc_end=dnc_end)
    return read(world, pair, LINK)


def dnc_link_whose_ends_disagree() -> World:
    """The host ends by a lone EOT, the control waits for a record that ends by ETX, and cancels."""
    world, pair = machine({"record_bytes": "12"}, program="77", mode="D", dnc_end="etx_last")
    return read(world, pair, LINK)


def load_stopped_and_resumed() -> World:
    """3.1, 3.2: XOFF and XON in the text, at most three characters behind the XOFF."""
    world, pair = machine(program="1234", mode="L", buffer="800", start_at_free="400", blocks_per_second=20)
    return read(world, pair, surfacing(2400))


def load_cancelled() -> World:
    """4.3: the operator of the control cancels, here by DC3 and DLE."""
    world, pair = machine(program="1234", mode="L", reset_after=200)
    return read(world, pair, surfacing(900))


def load_damaged() -> World:
    """4.1.1: a damaged character is fatal in REMOTE LOAD, and the control asks the remote to cancel."""
    world, pair = machine(program="1234", mode="L")
    parity = Fault(fault=LineFault.PARITY, byte=0x31)
    pair.cnc_link.transport = Disturbed(pair.cnc_link.transport, NAME_CHARACTERS + 6, lambda _: parity)
    return read(world, pair, surfacing(900))


def load_too_long() -> World:
    """2.1.1: more than 12000 characters cannot be one text. Nothing is sent, and nothing is cut off."""
    world, pair = machine(program="1234", mode="L", answer_limit="5")
    return read(world, pair, surfacing())


def load_without_a_name() -> World:
    """Program -1: DC1 alone, as to a tape reader."""
    world, pair = machine(program="-1", mode="L")
    return read(world, pair, P)


def load_with_nothing_armed() -> World:
    """1.2: nobody has armed a program, so a request, or a stray XON, gets nothing."""
    world, pair = machine(program="-1", mode="L", answer_limit="5")
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.cnc_end is not None)
    world.run_until_quiet()
    return world


def load_that_waits_for_the_operator() -> World:
    """1.2: the number is not there. The host holds the request until its operator gives a program."""
    world, pair = machine(program="43", mode="L")
    assert isinstance(pair.host, BridgeportHost)
    pair.host.serve(Books({"42": P}), world.now, policy=Policy.ONCE)
    pair.cnc.cycle_start(world.now)
    world.run_for(8 * SECOND)
    pair.host.answer(BytesIO(P), world.now)
    return both_end(world, pair)


def save_paused_by_the_host() -> World:
    """3.1: the receiving side is the host here, and the control sends at most three characters more."""
    world, pair = machine(program="1234", mode="L")
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(surfacing(400)), world.now)
    world.run_for(100 * MILLISECOND)
    pair.host.hold_reception(world.now)
    world.run_for(SECOND)
    pair.host.release(world.now)
    return both_end(world, pair)


def save_cancelled() -> World:
    """4.3 in a save: what has come in is not complete."""
    world, pair = machine(program="1234", mode="L", reset_after=100, operator_cancel="10 04")
    return punch(world, pair, surfacing(400))


DIALOGUES: Final[dict[str, Callable[[], World]]] = {
    play.__name__: play
    for play in (
        remote_load,
        save,
        dnc_link,
        dnc_link_whose_lrc_is_found,
        dnc_link_with_eot_after_lrc,
        dnc_link_with_etx_last,
        dnc_link_with_empty_then_eot,
        dnc_link_whose_ends_disagree,
        load_stopped_and_resumed,
        load_cancelled,
        load_damaged,
        load_too_long,
        load_without_a_name,
        load_with_nothing_armed,
        load_that_waits_for_the_operator,
        save_paused_by_the_host,
        save_cancelled,
    )
}


def machine(
    host: dict[str, str] | None = None,
    *,
    reset_after: int | None = None,
    blocks_per_second: float | None = None,
    **cnc: str,
) -> tuple[World, Pair]:
    world = World()
    pair = world.pair(
        "bridgeport",
        host_settings=host,
        cnc_settings=cnc,
        reset_after=reset_after,
        blocks_per_second=blocks_per_second,
    )
    return world, pair


def read(world: World, pair: Pair, program: bytes) -> World:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    return both_end(world, pair)


def punch(world: World, pair: Pair, program: bytes) -> World:
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(program), world.now)
    return both_end(world, pair)


def both_end(world: World, pair: Pair) -> World:
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    world.run_until_quiet()
    return world
