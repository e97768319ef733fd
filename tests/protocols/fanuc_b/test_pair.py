"""Both ends of protocol B and expansion B on one simulated cable: 300 KB, every setting, slow and fast controls."""

from __future__ import annotations

import hashlib
import itertools
from io import BytesIO
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.engine import MILLISECOND, SECOND, AfterStop, Alarm, Ended, Held, Outcome, Resumed
from tapewire.line.pacing import character_time
from tapewire.sim.world import Pair, World

KIB = 1024
PROTOCOLS = ("fanuc-b", "fanuc-b-expansion")
AFTER_DC3_AT_MOST = {86400: 256, 19200: 64}
UART_TRIGGER = 8
"""Characters a UART reports at once in the long runs; the golden dialogues have 1."""


def program_of(size: int) -> bytes:
    """A program of exactly `size` bytes, no block like its neighbour."""
    blocks = (b"N%d X%d.%03d Y-%d.%03d\n" % (n, n % 997, n % 1000, n % 883, n * 7 % 1000) for n in itertools.count())
    body, head, tail = bytearray(), b"%\nO0300\nG90 G01 F2000\n", b"M30\n%"
    while len(head) + len(body) + len(tail) < size:
        body += next(blocks)
    body = body[: size - len(head) - len(tail) - 1] + b"\n"
    return head + bytes(body) + tail


PROGRAM = program_of(300 * KIB)


def run(world: World, pair: Pair, program: bytes) -> None:
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def counts_after_dc3(pair: Pair) -> list[int]:
    return [event.count for _, event in pair.cnc_events if isinstance(event, AfterStop)]


@pytest.mark.parametrize("speed", ["slow", "fast"])
@pytest.mark.parametrize("baud", [19200, 86400])
@pytest.mark.parametrize("posting", ["on", "off"])
@pytest.mark.parametrize("code", ["iso", "ascii"])
@pytest.mark.parametrize("name", PROTOCOLS)
def test_300_kb_arrive_byte_identical(name: str, code: str, posting: str, baud: int, speed: str) -> None:
    world = World()
    characters_a_second = SECOND / character_time(baud)
    blocks_per_second = characters_a_second / 22 * 0.5 if speed == "slow" else None
    pair = world.pair(
        name,
        baud=baud,
        settings={"code": code, "posting": posting},
        grain=UART_TRIGGER,
        blocks_per_second=blocks_per_second,
    )
    run(world, pair, PROGRAM)
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE
    assert pair.cnc_end is not None
    assert pair.cnc_end.outcome is Outcome.COMPLETE
    assert sha256(pair.program.getvalue()) == sha256(PROGRAM)
    assert pair.host_end.bytes_low == pair.host_end.bytes_high == len(PROGRAM)
    held = [event for _, event in pair.host_events if isinstance(event, Held)]
    resumed = [event for _, event in pair.host_events if isinstance(event, Resumed)]
    after = counts_after_dc3(pair)
    print(f"{len(held)} DC3, {len(resumed)} DC1, at most {max(after, default=0)} characters after DC3")
    assert max(after, default=0) <= AFTER_DC3_AT_MOST[baud]
    if speed == "slow":
        assert len(held) >= 20
        assert len(resumed) >= 20
    else:
        assert not held


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("window_ms", [200, 400])
def test_a_window_too_wide_is_seen_by_the_control(name: str, window_ms: int) -> None:
    """The check of the test above can fail: a host with half a second in flight overruns, and the control says so."""
    world = World()
    window = int(window_ms * MILLISECOND / character_time(86400))
    pair = world.pair(name, baud=86400, window=window, grain=UART_TRIGGER, blocks_per_second=100)
    run(world, pair, PROGRAM[: 60 * KIB] + b"\nM30\n%")
    allowed = 511 if name == "fanuc-b" else 1280
    count = max(counts_after_dc3(pair))
    alarms = [event.number for _, event in pair.cnc_events if isinstance(event, Alarm)]
    assert (alarms == ["SR856"]) is (count > allowed)
    assert count > allowed or (name, window_ms) == ("fanuc-b-expansion", 200) or window <= allowed


@settings(max_examples=40)
@given(
    size=st.integers(40, 20_000),
    name=st.sampled_from(PROTOCOLS),
    baud=st.sampled_from([300, 4800, 19200, 86400]),
    grain=st.integers(1, 64),
    latency=st.integers(0, 60 * MILLISECOND),
    posting=st.sampled_from(["on", "off"]),
    has_signals=st.booleans(),
    closing=st.sampled_from(["read", "received"]),
    blocks_per_second=st.none() | st.floats(5, 3000),
)
def test_any_line_and_any_speed_deliver_the_program(
    size: int,
    name: str,
    baud: int,
    grain: int,
    latency: int,
    posting: str,
    has_signals: bool,
    closing: str,
    blocks_per_second: float | None,
) -> None:
    world, program = World(), program_of(size)
    pair = world.pair(
        name,
        baud=baud,
        settings={"posting": posting},
        cnc_settings={"closing": closing},
        grain=grain,
        latency=latency,
        has_signals=has_signals,
        blocks_per_second=blocks_per_second,
    )
    run(world, pair, program)
    world.run_until(lambda: pair.control.idle)
    assert pair.program.getvalue() == program, str(pair.transcript)
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE, str(pair.transcript)


INTERRUPTIONS = ("reset_after", "alarm_after")


@settings(max_examples=60)
@given(
    at=st.integers(1, 19_000),
    how=st.sampled_from(INTERRUPTIONS),
    name=st.sampled_from(PROTOCOLS),
    posting=st.sampled_from(["on", "off"]),
    has_signals=st.booleans(),
    blocks_per_second=st.none() | st.floats(20, 2000),
    latency=st.integers(0, 40 * MILLISECOND),
)
def test_a_reset_or_alarm_anywhere_ends_the_job_with_counts_that_hold(
    at: int,
    how: str,
    name: str,
    posting: str,
    has_signals: bool,
    blocks_per_second: float | None,
    latency: int,
) -> None:
    """Never complete, never continued in the middle, and what the control has lies between the two counts.

    The one case that nothing on the line tells from a stop is said before the start: blind, after the buffer may have
    filled. There the job stays held.
    """
    world, program = World(), program_of(20_000)
    act: dict[str, Any] = {how: at}
    pair = world.pair(
        name,
        settings={"posting": posting},
        grain=UART_TRIGGER,
        latency=latency,
        has_signals=has_signals,
        blocks_per_second=blocks_per_second,
        **act,
    )
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.cnc_end is not None)
    world.run_for(20 * SECOND)
    assert pair.cnc_end is not None
    assert pair.cnc_end.outcome is not Outcome.COMPLETE
    end = pair.host_end
    blind = posting == "off" and not has_signals
    if end is None:
        assert blind
        return
    if end.outcome is Outcome.COMPLETE:
        assert posting == "off", "without posting a reset after the last byte looks like the end"
        assert pair.cnc_end.bytes_high == len(program) or latency, str(pair.transcript)
        return
    assert end.bytes_low <= pair.cnc_end.bytes_high <= end.bytes_high, str(pair.transcript)
    assert program.startswith(pair.program.getvalue())


@settings(max_examples=30)
@given(
    data=st.sampled_from([DataCode.ASCII, DataCode.ISO, DataCode.EIA]),
    code=st.sampled_from(["iso", "ascii"]),
    posting=st.sampled_from(["on", "off"]),
    resume=st.sampled_from(["auto", "dc1", "dc2"]),
    punch_overrun=st.integers(0, 511),
    pauses=st.lists(st.integers(1, 150 * MILLISECOND), max_size=3),
    by_cs=st.booleans(),
)
def test_a_punch_out_paused_anywhere_arrives_whole(
    data: DataCode, code: str, posting: str, resume: str, punch_overrun: int, pauses: list[int], by_cs: bool
) -> None:
    world, program = World(), encode(program_of(1000), data)
    host_settings = {"pause": "cs"} if by_cs and posting == "off" else {}
    pair = world.pair(
        "fanuc-b",
        settings={"data": data.value, "code": code, "posting": posting, "resume": resume},
        host_settings=host_settings,
        cnc_settings={"punch_overrun": str(punch_overrun)},
    )
    pair.host.receive(pair.received, world.now)
    pair.cnc.punch(BytesIO(program), world.now)
    for span in pauses:
        world.run_for(span)
        pair.host.hold_reception(world.now)
        world.run_for(SECOND)
        stored = pair.host.progress
        world.run_for(SECOND)
        assert pair.host.progress == stored or pair.host_end is not None, "the pause did not hold"
        pair.host.release(world.now)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    assert pair.received.getvalue() == program, str(pair.transcript)
    assert isinstance(pair.host_end, Ended)
    assert pair.host_end.outcome is Outcome.COMPLETE, str(pair.transcript)


def test_two_jobs_one_after_the_other_and_a_request_between_them_gets_nothing() -> None:
    world, program = World(), program_of(5000)
    pair = world.pair("fanuc-b")
    run(world, pair, program)
    world.run_until_quiet()
    pair.cnc.cycle_start(world.now)
    world.run_for(10 * SECOND)
    assert pair.program.getvalue() == program
    pair.cnc.reset(world.now)
    world.run_for(SECOND)
    pair.host_end = pair.cnc_end = None
    run(world, pair, program)
    assert pair.program.getvalue() == program * 2
