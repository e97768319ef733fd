"""Bridgeport through every kind of path, on a computer that wakes late: what comes after DC3, how full the line is."""

from __future__ import annotations

import pytest

from benchmarks.strict_line import program_of, run_link
from tapewire.engine import MICROSECOND, MILLISECOND
from tapewire.line.faults.chance import derive
from tapewire.line.lateness import Lateness
from tapewire.line.pacing import Pacing, pacing_for
from tapewire.line.paths import PATHS, PathKind, TransmitterEmpty

BAUDS = (300, 600, 1200, 2400, 4800, 9600)


@pytest.mark.parametrize(
    ("window", "transmitter", "pacing"),
    [
        (2, TransmitterEmpty.ASKED, Pacing.CLOSED_LOOP),
        (16, TransmitterEmpty.ASKED, Pacing.CLOSED_LOOP),
        (17, TransmitterEmpty.ASKED, Pacing.WINDOW),
        (2, TransmitterEmpty.UNKNOWN, Pacing.WINDOW),
    ],
)
def test_who_is_paced_how(window: int, transmitter: TransmitterEmpty, pacing: Pacing) -> None:
    assert pacing_for(window, transmitter) is pacing


def test_lateness_is_what_was_measured() -> None:
    lateness = Lateness(derive(7, "host"))
    late = sorted(lateness.wake(10 * MILLISECOND, 0) - 10 * MILLISECOND for _ in range(20_000))
    assert late[10_000] == pytest.approx(570 * MICROSECOND, rel=0.05)
    assert 140 < sum(span > 1120 * MICROSECOND for span in late) < 260
    assert 1800 * MICROSECOND < late[-1] <= 1900 * MICROSECOND
    assert all(0 <= lateness.wake(50 * MICROSECOND, 0) - 50 * MICROSECOND <= 50 * MICROSECOND for _ in range(1000))


@pytest.mark.parametrize("baud", BAUDS)
def test_three_characters_after_dc3_and_a_full_line_on_a_computer_that_wakes_late(baud: int) -> None:
    """Bridgeport 3.2, by DNC LINK, through a FIFO of 16."""
    run = run_link(program_of(2500), baud, PATHS["uart-16550"], blocks_per_second=baud / 10 / 22 * 0.6)
    print(f"{baud} baud: {run.in_records:.2%} of the line, at most {max(run.after_stop)} after DC3")
    assert run.whole
    assert len(run.after_stop) >= 2
    assert max(run.after_stop) <= run.stated.characters <= 3
    assert run.stated.guaranteed
    assert run.in_records >= 0.98


@pytest.mark.parametrize("path", PATHS.values(), ids=lambda path: path.name)
@pytest.mark.parametrize("baud", [1200, 9600])
def test_what_a_path_states_is_what_it_keeps(path: PathKind, baud: int) -> None:
    speed = baud / 10 / 22 * 0.6
    run = run_link(program_of(2500), baud, path, closed_loop=False, blocks_per_second=speed)
    assert run.whole
    assert max(run.after_stop) <= run.stated.characters
    assert run.stated.guaranteed is ("uart" in run.stated.how.lower())


@pytest.mark.parametrize("percent", [-15.0, 2.0])
def test_the_closed_loop_needs_no_true_clock(percent: float) -> None:
    path = PATHS["uart-16550"]
    run = run_link(program_of(2500), 9600, path, blocks_per_second=20, clock_percent=percent)
    assert run.whole
    assert 0 < max(run.after_stop) <= 3


def test_without_it_a_slow_clock_piles_up_what_nobody_sees() -> None:
    """The reason for the closed loop: a window by time alone on a line 15 % slow."""
    usb = PATHS["usb-1ms"]
    run = run_link(program_of(2500), 9600, usb, blocks_per_second=20, clock_percent=-15.0)
    assert not run.stated.guaranteed
    assert max(run.after_stop) > run.stated.characters
