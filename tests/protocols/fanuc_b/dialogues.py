"""The dialogues of chapter 6, played in the simulated world. Their transcripts are kept in tests/transcripts/fanuc_b,
where the golden test and docs/protocols/fanuc_b.md find them.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Final

from tapewire.codes import DataCode, encode
from tapewire.engine import MILLISECOND, SECOND
from tapewire.sim.world import Pair, World

SHORT: Final = b"%\nO0001\nG91 G01 X1. F500\nM30\n%"
LONG: Final = b"%\nO0002\n" + b"G01 X1.5 Y2.25\n" * 1000 + b"M30\n%"
"""15,012 bytes: nearly twice the buffer."""


def a_program_that_fits() -> World:
    """6.1.1 1), 6.1.2: DC1, the program, DC3 at its EOR."""
    world = World()
    pair = world.pair("fanuc-b")
    feed(world, pair, SHORT)
    return both_end(world, pair)


def stopped_and_resumed() -> World:
    """6.1.1 1) (3) to (6): the buffer fills, DC3; it empties, DC1; the host goes on with the next byte."""
    world = World()
    pair = world.pair("fanuc-b", blocks_per_second=20)
    feed(world, pair, LONG)
    return both_end(world, pair)


def reset_with_posting() -> World:
    """6.1.2 (7), 6.4 (2): DC3, SYN."""
    world = World()
    pair = world.pair("fanuc-b", reset_after=2000)
    feed(world, pair, LONG)
    return both_end(world, pair)


def alarm_with_posting() -> World:
    """6.1.2 (7), 6.4 (2): DC3, NAK; ASCII control codes."""
    world = World()
    pair = world.pair("fanuc-b", settings={"code": "ascii"}, alarm_after=2000)
    feed(world, pair, LONG)
    return both_end(world, pair)


def reset_without_posting() -> World:
    """6.4 (1): DC3, then ER OFF, which the host sees."""
    world = World()
    pair = world.pair("fanuc-b", settings={"posting": "off"}, reset_after=2000)
    feed(world, pair, LONG)
    return both_end(world, pair)


def reset_without_posting_and_without_er() -> World:
    """6.4 (1) on a line that shows no ER: the DC3 comes before the buffer can have filled, so it is no stop."""
    world = World()
    pair = world.pair("fanuc-b", settings={"posting": "off"}, has_signals=False, reset_after=2000)
    feed(world, pair, LONG)
    return both_end(world, pair)


def posted_while_idle() -> World:
    """6.1.2 1): SYN and NAK while nothing is transferred."""
    world = World()
    pair = world.pair("fanuc-b")
    world.run_for(SECOND)
    pair.cnc.reset(world.now)
    world.run_for(SECOND)
    pair.cnc.alarm(world.now)
    world.run_for(SECOND)
    return world


def punch_out() -> World:
    """6.1.1 2): DC2, the program, DC4."""
    world = World()
    pair = world.pair("fanuc-b")
    punch(world, pair, SHORT)
    return both_end(world, pair)


def punch_out_paused_by_cs() -> World:
    """6.1.1 2) (3) (a), (4): CS OFF stops it within two characters."""
    world = World()
    pair = world.pair("fanuc-b", settings={"posting": "off"}, host_settings={"pause": "cs"})
    punch(world, pair, LONG[:600])
    pause_for_a_second(world, pair)
    return both_end(world, pair)


def punch_out_paused_by_dc3_with_posting() -> World:
    """6.1.2 (3) (b), (4): DC3 stops it within the overrun, DC1 lets it go on."""
    world = World()
    pair = world.pair("fanuc-b")
    punch(world, pair, LONG[:600])
    pause_for_a_second(world, pair)
    return both_end(world, pair)


def punch_out_paused_by_dc3_without_posting() -> World:
    """6.1.1 2) (3) (b): DC2 lets it go on."""
    world = World()
    pair = world.pair("fanuc-b", settings={"posting": "off"})
    punch(world, pair, LONG[:600])
    pause_for_a_second(world, pair)
    return both_end(world, pair)


def punch_out_reset() -> World:
    """6.1.2 punch-out (5): DC4, SYN."""
    world = World()
    pair = world.pair("fanuc-b", reset_after=200)
    punch(world, pair, LONG[:600])
    return both_end(world, pair)


def punch_out_alarm() -> World:
    """6.1.2 punch-out (5): DC4, NAK."""
    world = World()
    pair = world.pair("fanuc-b", alarm_after=200)
    punch(world, pair, LONG[:600])
    return both_end(world, pair)


def punch_out_in_eia() -> World:
    """6.2: with ASCII control codes the EIA digits 3, 5 and 6 look like DC3, NAK and SYN, and are data."""
    world = World()
    pair = world.pair("fanuc-b", settings={"data": "eia", "code": "ascii"})
    punch(world, pair, encode(b"%\nX3.56 Y-6.53\n%", DataCode.EIA))
    return both_end(world, pair)


DIALOGUES: Final[dict[str, Callable[[], World]]] = {
    play.__name__: play
    for play in (
        a_program_that_fits,
        stopped_and_resumed,
        reset_with_posting,
        alarm_with_posting,
        reset_without_posting,
        reset_without_posting_and_without_er,
        posted_while_idle,
        punch_out,
        punch_out_paused_by_cs,
        punch_out_paused_by_dc3_with_posting,
        punch_out_paused_by_dc3_without_posting,
        punch_out_reset,
        punch_out_alarm,
        punch_out_in_eia,
    )
}


def feed(world: World, pair: Pair, program: bytes) -> None:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)


def punch(world: World, pair: Pair, program: bytes) -> None:
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(program), world.now)


def pause_for_a_second(world: World, pair: Pair) -> None:
    world.run_for(50 * MILLISECOND)
    pair.host.hold_reception(world.now)
    world.run_for(SECOND)
    pair.host.release(world.now)


def both_end(world: World, pair: Pair) -> World:
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    world.run_until_quiet()
    return world
