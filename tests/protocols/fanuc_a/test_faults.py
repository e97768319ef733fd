"""Protocol A and expansion A on a line that loses or spoils one character: every one, in both directions.

Whatever happens, the program arrives byte-identical or the job ends as failed with its reason; what has arrived is
never wrong; and nothing is stuck longer than To + 2 Tp + 3 s beyond the undisturbed time. Where the control gives up
before anything was sent, the program stays armed, and arrives with the next cycle start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO

import pytest

from tapewire.engine import MILLISECOND, SECOND, Nanos, Outcome
from tapewire.sim.world import Pair, World
from tests.protocols.wire import FaultyEnd, Spoil, flipped, lost

TO_S, TP_S = 20, 5
"""To and Tp at power on; the host asks for a shorter Tp, so these bound both."""

PATIENCE: Nanos = (TO_S + 2 * TP_S + 3) * SECOND
PROGRAM = b"%\nO7\nG91 G01 X1. F500\nM30\n%"
LONGER = b"%\nO8\n" + b"".join(b"N%d X%d\n" % (n, n) for n in range(40)) + b"M30\n%"
"""An effective packet of 256 bytes and an end packet."""

KIND = {"monitors_again": "on", "among_packets": "syn"}
"""A control that says NAK and CAN again, and hears messages among packets. Chapter 5 has neither."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    name: str
    program: bytes
    settings: Mapping[str, str] = field(default_factory=dict)
    cnc_settings: Mapping[str, str] = field(default_factory=dict)
    every: int = 1
    """Of the characters to the control each k-th is lost in its turn, and each third of these spoilt."""


SEVENTEEN = b"%\nO8\n" + b"".join(b"N%d X%d\n" % (n, n) for n in range(460)) + b"M30\n%"
"""Seventeen effective packets of n = 1, and the end packet."""
SYN, RDY, SET = b"07SYN\r", b"FCRDY\r", bytes(62)

SHORT_JOBS = {
    "fanuc-a": Job(name="fanuc-a", program=PROGRAM),
    "fanuc-a iso etx": Job(name="fanuc-a", program=PROGRAM, settings={"code": "iso", "end": "etx"}),
    "expansion n=1": Job(name="fanuc-a-expansion", program=LONGER, settings={"n": "1"}),
    "expansion n=1, kind": Job(
        name="fanuc-a-expansion", program=LONGER, settings={"n": "1"}, cnc_settings=KIND, every=17
    ),
    "expansion n=1 iso etx": Job(
        name="fanuc-a-expansion", program=LONGER, settings={"n": "1", "code": "iso", "end": "etx"}, every=29
    ),
}
DIRECTIONS = ("to the host", "to the control")


def play(job: Job, direction: str, at: int | None = None, spoil: Spoil = lost) -> tuple[Pair, FaultyEnd, Nanos]:
    """A transfer with the character number `at` of one direction spoilt; how it ended, and how long it took."""
    world = World()
    pair = world.pair(
        job.name, baud=86400, settings=job.settings, cnc_settings=job.cnc_settings, grain=64, cnc_window=64
    )
    link = pair.host_link if direction == DIRECTIONS[0] else pair.cnc_link
    end = FaultyEnd(link.transport, at, spoil)
    link.transport = end
    pair.host.start(BytesIO(job.program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None or gave_up(pair), limit=10 * PATIENCE)
    took = world.now
    if pair.host_end is None:
        world.run_for(2 * TP_S * SECOND)
    if pair.host_end is None:
        assert not pair.host.progress, pair.transcript
        pair.cnc.cycle_start(world.now)
        world.run_until(lambda: pair.host_end is not None, limit=PATIENCE)
    return pair, end, took


def gave_up(pair: Pair) -> bool:
    return pair.cnc_end is not None and pair.cnc_end.outcome is Outcome.FAILED


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
    every = job.every * (1 if spoil is lost else 3) if direction == DIRECTIONS[1] else 1
    for at in range(0, undisturbed.received, every):
        pair, end, took = play(job, direction, at, spoil)
        assert end.struck, at
        if judge(pair, job.program, took, usual, f"character {at} {direction} {spoil.__name__}") is Outcome.FAILED:
            failed.append(at)
    print(f"{name}, {direction}, {spoil.__name__}: failed of {at + 1}: {failed}")
    assert 2 * len(failed) * every < undisturbed.received, "retries are there to be used"


@pytest.mark.parametrize("latency", [0, 2, 30])
@pytest.mark.parametrize("cnc_settings", [{}, KIND, {"naks": "packet"}], ids=["strict", "kind", "a NAK a packet"])
@pytest.mark.parametrize("first", [0, 5, 10])
def test_a_burst_across_packets(first: int, cnc_settings: dict[str, str], latency: int) -> None:
    """Two NAKs for one packet, which then arrives twice and is in improper order: it must not go on like that."""
    world = World()
    pair = world.pair(
        "fanuc-a-expansion",
        settings={"n": "1"},
        cnc_settings=cnc_settings,
        grain=64,
        cnc_window=64,
        latency=latency * MILLISECOND,
    )
    before = len(SYN + RDY + SET) + 260 * first
    inner = FaultyEnd(pair.cnc_link.transport, before + 100, flipped)
    pair.cnc_link.transport = FaultyEnd(inner, before + 360, flipped)
    pair.host.start(BytesIO(SEVENTEEN), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None, limit=10 * PATIENCE)
    assert pair.program.getvalue() == SEVENTEEN
    assert str(pair.transcript).count("host  packet") <= 18 + 3 + 12 * bool(latency), "each packet twice would be 34"


LONG = b"%\nO9\n" + b"".join(b"N%d G01 X%d.5 Y-%d.\n" % (n, n, n) for n in range(340)) + b"M30\n%"
MESSAGE_BYTES = {"0": 1950 + 6, "1": 260, "2": 516, "4": 1028}
"""The longest DAT before a SAT has confirmed Nb and No, and the packets of n = 1, 2, 4."""


@pytest.mark.parametrize("spoil", [lost, flipped], ids=["lost", "flipped"])
@pytest.mark.parametrize("n", MESSAGE_BYTES)
def test_every_message_or_packet_spoilt_one_at_a_time(n: str, spoil: Spoil) -> None:
    """In its middle, whatever it is; the answers in the other direction are covered by the test above."""
    name = "fanuc-a" if n == "0" else "fanuc-a-expansion"
    job = Job(name=name, program=LONG, settings={"n": n})
    _, undisturbed, usual = play(job, DIRECTIONS[1])
    step = MESSAGE_BYTES[n] // 2
    outcomes = []
    for at in range(step, undisturbed.received, step):
        pair, end, took = play(job, DIRECTIONS[1], at, spoil)
        assert end.struck, at
        outcomes.append(judge(pair, LONG, took, usual, f"character {at} {spoil.__name__}"))
    print(f"n={n}, {spoil.__name__}: {outcomes.count(Outcome.COMPLETE)} of {len(outcomes)} complete")
    assert outcomes.count(Outcome.COMPLETE) >= len(outcomes) - 1
