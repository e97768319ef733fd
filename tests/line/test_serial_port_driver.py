"""Serial ports against a driver played by the test: rates, framing, control lines, damage, the closed loop, the end."""

from __future__ import annotations

import ctypes
import errno
import os
import select
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as checks
from hypothesis import strategies as st

from tapewire.engine import MICROSECOND, MILLISECOND, SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.errors import LineBusy, LineError, UsageError
from tapewire.line import open as opening
from tapewire.line.descriptor import LineSettings, Parity
from tapewire.line.pacing import character_time
from tapewire.line.ports import tty_line
from tapewire.line.ports.kernel import Counters, SerialInfo
from tapewire.line.transport import Fault
from tests.line.fake_uart import Bench, bench
from tests.line.helpers import Clock, read_until_closed, settings

EIGHT_N_TWO = settings(stopbits=2)
STRICT = LineSettings(baud=9600, stopbits=2, window=2)
CTS = termios.TIOCM_CTS


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as made:
        made.uart.lines = CTS
        yield made


# rates and framing


def test_a_rate_the_driver_changes_is_refused_with_the_nearest(port: Bench) -> None:
    port.uart.speed = lambda speed: 115200
    with pytest.raises(LineError, match="86400 baud: the nearest rate of its driver is 115200"):
        port.open(EIGHT_N_TWO)


def test_a_rate_within_two_percent_is_taken(port: Bench) -> None:
    port.uart.speed = lambda speed: round(speed * 1.004)
    port.open(EIGHT_N_TWO).close(0)


@pytest.mark.parametrize(("baud", "real"), [(86400, 115200), (76800, 57600)])
def test_a_rate_its_clock_cannot_make_is_refused_whatever_the_driver_says(port: Bench, baud: int, real: int) -> None:
    port.uart.uart = SerialInfo(type=4, baud_base=115200, fifo=16)
    with pytest.raises(LineError, match=f"would run {real}, and has 57600 and 115200 nearest"):
        port.open(settings(baud=baud, stopbits=2))
    assert not port.uart.claimed


def test_a_refused_port_is_left_as_it_was(port: Bench) -> None:
    before, handles = port.uart.settings(port.uart.master), set(os.listdir("/proc/self/fd"))
    port.uart.framing = lambda flags: flags & ~termios.PARENB
    with pytest.raises(LineError, match="8E1"):
        port.open(settings(stopbits=1))
    assert port.uart._set == before
    assert set(os.listdir("/proc/self/fd")) == handles
    assert not port.uart.claimed


@pytest.mark.parametrize(
    ("how", "framing", "flags", "bits"),
    [
        (LineSettings(baud=9600, window=2, stopbits=1), "8E1", termios.CS8 | termios.PARENB, 11),
        (LineSettings(baud=9600, window=2, stopbits=2), "8N2", termios.CS8 | termios.CSTOPB, 11),
        (LineSettings(baud=9600, window=2, stopbits=1, data_bits=7), "7E1", termios.CS7 | termios.PARENB, 10),
        (
            LineSettings(baud=9600, window=2, stopbits=2, data_bits=7),
            "7E2",
            termios.CS7 | termios.PARENB | termios.CSTOPB,
            11,
        ),
        (
            LineSettings(baud=9600, window=2, stopbits=1, data_bits=7, parity=Parity.ODD),
            "7O1",
            termios.CS7 | termios.PARENB | termios.PARODD,
            10,
        ),
    ],
)
def test_framings(port: Bench, how: LineSettings, framing: str, flags: int, bits: int) -> None:
    assert (how.framing, how.has_parity) == (framing, how.stopbits == 1 or how.data_bits == 7)
    assert how.character == character_time(9600, bits)
    line = port.open(how)
    assert port.uart._set is not None
    mask = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB
    assert port.uart._set.control_flags & mask == flags
    line.close(0)


def test_seven_bits_alone_are_no_framing() -> None:
    with pytest.raises(UsageError, match="7N1"):
        LineSettings(baud=9600, window=2, stopbits=1, data_bits=7, parity=Parity.NONE)


def test_a_port_that_somebody_else_holds_stays_theirs(port: Bench) -> None:
    held = port.open(EIGHT_N_TWO)
    with pytest.raises(LineBusy):
        port.open(EIGHT_N_TWO)
    assert port.uart.claimed
    held.close(0)
    assert not port.uart.claimed


# control lines


def test_control_lines_are_polled_and_told_at_every_change(port: Bench) -> None:
    port.uart.lines = 0
    line, clock = port.open(EIGHT_N_TWO), port.uart.clock
    assert line.read(clock.now) == [SignalsIn(cts=False, dsr=False, cd=False)]
    assert line.room(clock.now) == 0
    wait_until_failed(line)
    assert line.next_deadline() == clock.now + 10 * MILLISECOND
    port.uart.lines = CTS | termios.TIOCM_DSR
    assert line.read(clock.advance(10 * MILLISECOND)) == [SignalsIn(cts=True, dsr=True, cd=False)]
    assert line.read(clock.advance(10 * MILLISECOND)) == []
    assert line.room(clock.now) == 216
    port.uart.lines |= termios.TIOCM_CD | termios.TIOCM_RI
    assert line.read(clock.advance(10 * MILLISECOND)) == [SignalsIn(ri=True)]
    line.close(0)


def wait_until_failed(line: tty_line.TtyLine) -> None:
    assert line._watch is not None
    line._watch._thread.join(5)
    assert line._watch.failed


def test_a_driver_that_can_wait_tells_of_changes_by_itself(port: Bench) -> None:
    port.uart.can_wait = True
    line, clock = port.open(EIGHT_N_TWO), port.uart.clock
    line.read(clock.now)
    assert line.next_deadline() == clock.now + 250 * MILLISECOND
    assert line.watched is not None
    assert not is_readable(line.watched, 0.1)
    port.uart.turn(CTS | termios.TIOCM_DSR)
    assert is_readable(line.watched, 5)
    assert line.read(clock.advance()) == [SignalsIn(cts=True, dsr=True, cd=False)]
    assert not is_readable(line.watched, 0)
    os.write(port.uart.master, b"\x13")
    assert is_readable(line.watched, 5)
    assert line.read(clock.advance()) == [b"\x13"]
    watch = line._watch
    line.close(0)
    assert watch is not None
    assert not watch._thread.is_alive()


def is_readable(fd: int, limit_s: float) -> bool:
    return bool(select.select([fd], [], [], limit_s)[0])


def test_a_wait_that_blocks_is_interrupted_at_the_end(port: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port.uart, "wait_for_signals", blocked)
    line = port.open(EIGHT_N_TWO)
    watch = line._watch
    assert watch is not None
    line.close(0)
    assert not watch._thread.is_alive()


def blocked(fd: int, bits: int) -> None:
    """Blocks as the ioctl does: a signal ends it, and nothing resumes it."""
    ctypes.CDLL(None).pause()
    raise InterruptedError


def test_control_lines_are_driven(port: Bench) -> None:
    line = port.open(EIGHT_N_TWO)
    line.set_signals(SignalsOut(rts=True, dtr=False), SECOND)
    assert port.uart.driven == [(termios.TIOCM_RTS, termios.TIOCM_DTR)]
    line.close(0)


# damage


def test_damage_is_parity_with_parity_and_framing_without(port: Bench) -> None:
    line = port.open(EIGHT_N_TWO)
    assert line._decode(b"a\xff") == [b"a"]
    assert line._decode(b"\x00") == []
    assert line._decode(b"X") == [Fault(fault=LineFault.FRAMING, byte=ord("X"))]
    line.close(0)


def test_lost_characters_are_told_behind_what_was_read(port: Bench) -> None:
    line, clock = port.open(EIGHT_N_TWO), port.uart.clock
    line.read(clock.now)
    port.uart.count = Counters(uart_overrun=2)
    os.write(port.uart.master, b"N1")
    assert line.watched is not None
    assert is_readable(line.watched, 5)
    assert line.read(clock.advance()) == [b"N1", Fault(fault=LineFault.UART_OVERRUN)]
    assert line.counters() == Counters(uart_overrun=2)
    line.close(0)


# what is in flight


def test_the_queue_of_the_driver_counts_as_in_flight_and_is_called_back(port: Bench) -> None:
    port.uart.character = SECOND
    line, clock = port.open(EIGHT_N_TWO), port.uart.clock
    line.read(clock.now)
    line.room(clock.now)
    line.write(bytes(200), clock.now)
    assert line.in_flight(clock.now) == 200
    assert line.in_flight(clock.advance(SECOND)) == 183
    line.read(clock.now)
    assert line.room(clock.now) == 0
    deadline = line.next_deadline()
    assert deadline is not None
    assert deadline - clock.now <= 5 * MILLISECOND
    assert line.discard(clock.now) == 183
    assert line.in_flight(clock.now) == 0
    assert port.uart.inside == 16
    line.close(0)


def test_a_driver_that_empties_nothing_calls_nothing_back(port: Bench) -> None:
    port.uart.character, port.uart.flushes = SECOND, False
    line, clock = port.open(EIGHT_N_TWO), port.uart.clock
    line.read(clock.now)
    line.room(clock.now)
    line.write(bytes(100), clock.now)
    assert line.discard(clock.now) == 0
    assert line.in_flight(clock.now) == 100
    line.close(0)


def test_the_fifo_is_part_of_the_stop_distance(port: Bench) -> None:
    line = port.open(EIGHT_N_TWO)
    assert line.stop_distance.characters == 216 + 16
    assert not line.stop_distance.guaranteed
    assert "FIFO" in line.stop_distance.how
    line.close(0)


def test_a_transmitter_that_can_be_asked_guarantees_the_window(port: Bench) -> None:
    line = port.open(STRICT)
    assert (line.stop_distance.characters, line.stop_distance.guaranteed) == (2, True)
    line.close(0)
    port.uart.answers_empty = False
    line = port.open(STRICT)
    assert (line.stop_distance.characters, line.stop_distance.guaranteed) == (2 + 16, False)
    line.close(0)


async def test_a_transmitter_that_never_says_empty_is_not_asked(port: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[str] = []
    monkeypatch.setattr(port.uart, "transmitter_is_empty", lambda fd: False)
    monkeypatch.setattr(opening, "EMPTY_QUESTIONS", 3)
    line = await opening._proved(port.open(STRICT), notes.append)
    assert (line.stop_distance.characters, line.stop_distance.guaranteed) == (18, False)
    assert "never says" in notes[0]
    line.close(0)


async def test_one_that_says_so_a_little_later_is(port: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([False, False, True])
    monkeypatch.setattr(port.uart, "transmitter_is_empty", lambda fd: next(answers, True))
    line = await opening._proved(port.open(STRICT), pytest.fail)
    assert line.stop_distance.guaranteed
    line.close(0)


PROGRAM = 400


def run_closed_loop(port: Bench, true: float, stop_at: Nanos, stalls: list[Nanos]) -> tuple[int, Nanos]:
    """Send until the control's DC3 is read at the first look after `stop_at`: (characters that left behind that look,
    the moment of the last one). The true line is `true` times as slow as it is set to.
    """
    uart, clock = port.uart, port.uart.clock
    uart.character = round(STRICT.character * true)
    line = port.open(STRICT)
    began, handed = clock.now, 0
    line.read(clock.now)
    looks = 0
    while clock.now < began + stop_at and handed < PROGRAM:
        if room := line.room(clock.now):
            line.write(b"N" * room, clock.now)
            uart.run()
            handed += room
        deadline = line.next_deadline()
        assert deadline is not None
        looks += 1
        stall = stalls[looks % len(stalls)] if stalls else 0
        clock.now = max(deadline, clock.now + 10 * MICROSECOND) + stall
        line.read(clock.now)
    stopped = len(uart.left) if uart.inside >= 0 else 0
    clock.advance(SECOND)
    assert uart.inside == 0
    assert len(uart.left) == handed
    line.close(0)
    return handed - stopped, uart.left[-1][0] - began


@checks(max_examples=25, deadline=None)
@given(
    true=st.floats(0.98, 1.3),
    stop_at=st.integers(MILLISECOND, 200 * MILLISECOND),
    stalls=st.lists(st.integers(0, 30 * MILLISECOND), max_size=4),
)
def test_no_more_than_the_window_leaves_after_a_stop(true: float, stop_at: Nanos, stalls: list[Nanos]) -> None:
    with bench(Path("/nonexistent")) as port:
        port.uart.lines = CTS
        after, _ = run_closed_loop(port, true, stop_at, stalls)
        assert after <= STRICT.window


def test_the_closed_loop_keeps_the_line_full_when_it_is_not_late(port: Bench) -> None:
    _, took = run_closed_loop(port, 1.0, 10 * SECOND, [])
    assert took < PROGRAM * STRICT.character * 1.03


def test_a_transmitter_that_stands_still_is_asked_less_often(port: Bench) -> None:
    line, clock = port.open(STRICT), port.uart.clock
    port.uart.character = 100 * SECOND
    line.read(clock.now)
    assert line.room(clock.now) == 2
    line.write(b"N1", clock.now)
    for span, pause in ((3 * MILLISECOND, 500 * MICROSECOND), (SECOND, 5 * MILLISECOND)):
        line.read(clock.advance(span))
        assert line.room(clock.now) == 0
        deadline = line.next_deadline()
        assert deadline is not None
        assert clock.now < deadline <= clock.now + pause
    line.close(0)


# the end


def test_a_port_that_hangs_up_is_lost_and_opens_anew_with_nothing_of_the_old_job(tmp_path: Path) -> None:
    with bench(tmp_path) as port:
        port.uart.lines, port.uart.can_wait = CTS, True
        line, clock = port.open(STRICT), port.uart.clock
        line.read(clock.now)
        assert line.room(clock.now) == 2
        line.write(b"N1", clock.now)
        os.close(port.uart.master)
        (end,) = read_until_closed(line, clock).ends
        port.uart.master = os.open("/dev/null", os.O_RDWR)
        assert end.closure is Closure.LOST
        assert "unplugged" in end.reason or "lost" in end.reason
        assert line.room(clock.now) == 0
        assert line.in_flight(clock.now) == 0
        line.close(0)
    with bench(tmp_path) as again:
        again.uart.lines = CTS
        fresh = again.open(STRICT)
        fresh.read(again.uart.clock.now)
        assert again.uart.inside == 0
        assert fresh.in_flight(again.uart.clock.now) == 0
        assert fresh.room(again.uart.clock.now) == 2
        fresh.close(0)


def test_an_error_of_the_driver_is_the_end(port: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    line = port.open(EIGHT_N_TWO)

    def gone(*_: object) -> bytes:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "read", gone)
    (end,) = read_until_closed(line, Clock()).ends
    monkeypatch.undo()
    assert end.closure is Closure.LOST
    assert port.path in end.reason
    line.close(0)
