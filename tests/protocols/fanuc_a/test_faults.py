"""Protocol A and expansion A on a line that loses or spoils one character: every one, in both directions.

Whatever happens, the program arrives byte-identical or the job ends as failed with its reason; what has arrived is
never wrong; and nothing is stuck longer than To + 2 Tp + 3 s beyond the undisturbed time.
"""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import SECOND, Nanos, Outcome
from tapewire.sim.world import Pair, World
from tests.protocols.wire import FaultyEnd, Spoil, flipped, lost

TO_S, TP_S = 20, 5
"""To and Tp at power on; the host asks for a shorter Tp, so these bound both."""

PATIENCE: Nanos = (TO_S + 2 * TP_S + 3) * SECOND
PROGRAM = b"%\nO7\nG91 G01 X1. F500\nM30\n%"
LONGER = b"%\nO8\n" + b"".join(b"N%d X%d\n" % (n, n) for n in range(40)) + b"M30\n%"
"""An effective packet of 256 bytes and an end packet."""

SHORT_JOBS = {
    "fanuc-a": ("fanuc-a", {}, PROGRAM),
    "fanuc-a iso etx": ("fanuc-a", {"code": "iso", "end": "etx"}, PROGRAM),
    "fanuc-a-expansion n=1": ("fanuc-a-expansion", {"n": "1"}, LONGER),
}
DIRECTIONS = ("to the host", "to the control")


def play(
    job: tuple[str, dict[str, str], bytes], direction: str, at: int | None = None, spoil: Spoil = lost
) -> tuple[Pair, FaultyEnd, Nanos]:
    """A transfer with the character number `at` of one direction spoilt; how it ended, and how long it took."""
    name, settings, program = job
    world = World()
    pair = world.pair(name, baud=86400, settings=settings, grain=64, cnc_window=64)
    link = pair.host_link if direction == DIRECTIONS[0] else pair.cnc_link
    end = FaultyEnd(link.transport, at, spoil)
    link.transport = end
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None, limit=10 * PATIENCE)
    return pair, end, world.now


def judge(pair: Pair, program: bytes, took: Nanos, usual: Nanos, what: str) -> Outcome:
    """What must hold whatever was spoilt."""
    story = f"{what}:\n{pair.transcript}"
    taken = pair.program.getvalue()
    assert program.startswith(taken), story
    assert took <= usual + PATIENCE, story
    assert pair.host_end is not None
    assert pair.host_end.outcome is not Outcome.CANCELLED, story
    assert pair.host_end.reason, story
    if pair.host_end.outcome is Outcome.COMPLETE:
        assert taken == program, story
    return pair.host_end.outcome


@pytest.mark.parametrize("spoil", [lost, flipped], ids=["lost", "flipped"])
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("name", SHORT_JOBS)
def test_every_character_of_a_dialogue_lost_or_flipped_one_at_a_time(name: str, direction: str, spoil: Spoil) -> None:
    job = SHORT_JOBS[name]
    _, undisturbed, usual = play(job, direction)
    failed = []
    for at in range(undisturbed.received):
        pair, end, took = play(job, direction, at, spoil)
        assert end.struck, at
        if judge(pair, job[2], took, usual, f"character {at} {direction} {spoil.__name__}") is Outcome.FAILED:
            failed.append(at)
    complete = undisturbed.received - len(failed)
    print(f"{name}, {direction}, {spoil.__name__}: {complete} complete, failed: {failed}")
    assert complete > len(failed), "retries are there to be used"


LONG = b"%\nO9\n" + b"".join(b"N%d G01 X%d.5 Y-%d.\n" % (n, n, n) for n in range(340)) + b"M30\n%"
MESSAGE_BYTES = {"0": 1950 + 6, "1": 260, "2": 516, "4": 1028}
"""The longest DAT before a SAT has confirmed Nb and No, and the packets of n = 1, 2, 4."""


@pytest.mark.parametrize("spoil", [lost, flipped], ids=["lost", "flipped"])
@pytest.mark.parametrize("n", MESSAGE_BYTES)
def test_every_message_or_packet_spoilt_one_at_a_time(n: str, spoil: Spoil) -> None:
    """In its middle, whatever it is; the answers in the other direction are covered by the test above."""
    name = "fanuc-a" if n == "0" else "fanuc-a-expansion"
    job = (name, {} if n == "0" else {"n": n}, LONG)
    _, undisturbed, usual = play(job, DIRECTIONS[1])
    step = MESSAGE_BYTES[n] // 2
    outcomes = []
    for at in range(step, undisturbed.received, step):
        pair, end, took = play(job, DIRECTIONS[1], at, spoil)
        assert end.struck, at
        outcomes.append(judge(pair, LONG, took, usual, f"character {at} {spoil.__name__}"))
    print(f"n={n}, {spoil.__name__}: {outcomes.count(Outcome.COMPLETE)} of {len(outcomes)} complete")
    assert outcomes.count(Outcome.COMPLETE) >= len(outcomes) - 1
