"""Terminals: marks of damaged characters, who may open them, and how they are set up.

A pseudo terminal stands in for the port; what only a real driver has is put under the one function that asks it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, SignalsIn, SignalsOut
from tapewire.errors import LineBusy, LineError, LineNotFound
from tapewire.line import serial_port
from tapewire.line.descriptor import LineSettings
from tapewire.line.serial_port import decode_marks, open_tty
from tapewire.line.transport import Fault
from tests.line.helpers import Clock, Seen, read_until_closed, settings

BREAK = Fault(fault=LineFault.BREAK)


def _parity(byte: int) -> Fault:
    return Fault(fault=LineFault.PARITY, byte=byte)


@pytest.mark.parametrize(
    ("data", "items", "carry"),
    [
        (b"", [], b""),
        (b"plain\x00\x11", [b"plain\x00\x11"], b""),
        (b"a\xff\xffb", [b"a\xffb"], b""),
        (b"a\xff\x00Xb", [b"a", _parity(ord("X")), b"b"], b""),
        (b"\xff\x00\x00", [BREAK], b""),
        (b"\xff\x00\xff", [_parity(0xFF)], b""),
        (b"\xff\xff\x00\x11", [b"\xff\x00\x11"], b""),
        (b"\xff\xff\xff\x00\x11", [b"\xff", _parity(0x11)], b""),
        (b"a\xff", [b"a"], b"\xff"),
        (b"a\xff\x00", [b"a"], b"\xff\x00"),
        (b"a\xff\x41", [b"a\xffA"], b""),
    ],
)
def test_marks(data: bytes, items: list[bytes | Fault], carry: bytes) -> None:
    assert decode_marks(data, LineFault.PARITY) == (items, carry)


def _decoded(pieces: list[bytes]) -> tuple[list[object], bytes]:
    flat: list[object] = []
    carry = b""
    for piece in pieces:
        items, carry = decode_marks(carry + piece, LineFault.PARITY)
        assert b"" not in items
        for item in items:
            flat += item if isinstance(item, bytes) else [item]
    return flat, carry


Marked = st.lists(st.sampled_from([b"\xff", b"\x00", b"\x11", b"A", b"\xff\xff", b"\xff\x00"])).map(b"".join)


@given(data=Marked, cuts=st.lists(st.integers(0, 60)))
def test_cutting_does_not_matter(data: bytes, cuts: list[int]) -> None:
    places = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    assert _decoded([data[start:end] for start, end in pairwise(places)]) == _decoded([data])


@given(st.lists(st.one_of(st.integers(0, 255), st.builds(_parity, st.integers(1, 255)), st.just(BREAK))))
@example([0xFF, BREAK, 0xFF, 0xFF, _parity(0xFF), 0x00])
def test_what_a_driver_marks_is_understood(line: list[int | Fault]) -> None:
    wire = bytearray()
    for item in line:
        match item:
            case Fault(byte=byte):
                wire += bytes((0xFF, 0, byte or 0))
            case 0xFF:
                wire += b"\xff\xff"
            case byte:
                wire.append(byte)
    assert _decoded([bytes(wire)]) == (line, b"")


Port = tuple[int, str]


@pytest.fixture
def port() -> Iterator[Port]:
    """(master, path of the slave); the master stays open to the end."""
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    os.set_blocking(master, False)
    yield master, path
    os.close(master)


def test_the_terminal_is_set_up_raw_at_any_rate(port: Port) -> None:
    line = open_tty(port[1], settings(baud=76800))
    control = _control(line.watched)
    assert control == (76800, termios.CS8)
    line.close(0)


def _control(fd: int | None) -> tuple[int, int]:
    assert fd is not None
    iflag, oflag, cflag, lflag, _, _, _, speed = serial_port.TERMIOS2.unpack(
        fcntl.ioctl(fd, serial_port.TCGETS2, bytes(serial_port.TERMIOS2.size))
    )
    assert iflag == termios.INPCK | termios.PARMRK
    assert oflag == 0
    assert lflag == 0
    assert not cflag & (termios.HUPCL | termios.CRTSCTS)
    assert cflag & termios.CLOCAL
    return int(speed), int(cflag & termios.CSIZE)


def test_opening_flushes_nothing(port: Port) -> None:
    os.write(port[0], b"\x11")
    line, clock, seen = open_tty(port[1], settings()), Clock(), Seen()
    os.write(port[0], b"\x11")
    for now in clock.looks():
        seen.read(line, now)
        if seen.data.endswith(b"\x11"):
            break
    assert seen.data[-1:] == b"\x11"
    line.close(0)


def test_all_characters_pass_marks_and_all(port: Port) -> None:
    line, clock, seen = open_tty(port[1], settings()), Clock(), Seen()
    os.write(port[0], bytes(range(256)))
    for now in clock.looks():
        seen.read(line, now)
        if len(seen.data) == 256:
            break
    assert seen.data == bytes(range(256))
    line.close(0)


def test_a_port_is_opened_once(port: Port) -> None:
    line = open_tty(port[1], settings())
    with pytest.raises(LineBusy, match="another program"):
        open_tty(port[1], settings())
    line.close(0)
    open_tty(port[1], settings()).close(0)


def test_a_port_held_by_another_process_is_busy(port: Port) -> None:
    hold = "import fcntl, sys; f = open(sys.argv[1]); fcntl.flock(f, 2); print(flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", hold, port[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout
        other.stdout.readline()
        with pytest.raises(LineBusy, match="close that one first"):
            open_tty(port[1], settings())


def test_what_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("O1234")
    with pytest.raises(LineNotFound, match="plugged in"):
        open_tty(str(tmp_path / "none"), settings())
    with pytest.raises(LineNotFound):
        open_tty("/dev/pts/999999", settings())
    for path in (tmp_path, tmp_path / "file", Path("/dev/null")):
        with pytest.raises(LineError, match="not a serial port"):
            open_tty(str(path), settings())
    assert (tmp_path / "file").read_text() == "O1234"


@pytest.mark.parametrize(
    ("number", "kind", "advice"),
    [(errno.EACCES, LineError, "dialout"), (errno.EBUSY, LineBusy, "close"), (errno.ENXIO, LineNotFound, "plugged")],
)
def test_why_a_port_cannot_be_opened(
    monkeypatch: pytest.MonkeyPatch, port: Port, number: int, kind: type[LineError], advice: str
) -> None:
    def refuse(*_: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(LineError, match=advice) as refusal:
        open_tty(port[1], settings())
    assert type(refusal.value) is kind


def test_the_other_side_of_a_pseudo_terminal_going_is_orderly() -> None:
    master, slave = os.openpty()
    line = open_tty(os.ttyname(slave), settings())
    os.close(slave)
    os.close(master)
    clock = Clock()
    seen = read_until_closed(line, clock)
    assert [end.closure for end in seen.ends] == [Closure.ORDERLY]
    assert line.room(clock.now) == 0
    assert line.in_flight(clock.now) == 0
    line.close(0)


class FakeDriver:
    """What a real driver answers, behind a pseudo terminal."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.signals = 0
        self.queued = 0
        self.flushes = True
        self.driven: list[tuple[int, int]] = []
        self.speed: Callable[[int], int] = lambda speed: speed
        self._ioctl = fcntl.ioctl
        monkeypatch.setattr(serial_port, "SLAVE_MAJORS", range(0))
        monkeypatch.setattr(serial_port, "_ioctl_int", self._ask)
        monkeypatch.setattr(fcntl, "ioctl", self._tell)
        monkeypatch.setattr(termios, "tcflush", self._flush)

    def _ask(self, fd: int, request: int) -> int:
        return {termios.TIOCMGET: self.signals, termios.TIOCOUTQ: self.queued}[request]

    def _tell(self, fd: int, request: int, argument: bytes = b"") -> bytes | int:
        if request in (termios.TIOCMBIS, termios.TIOCMBIC):
            self.driven.append((request, struct.unpack("i", argument)[0]))
            return 0
        answer = self._ioctl(fd, request, argument)
        if request == serial_port.TCGETS2:
            *flags, in_speed, out_speed = serial_port.TERMIOS2.unpack(answer)
            return serial_port.TERMIOS2.pack(*flags, in_speed, self.speed(out_speed))
        return answer

    def _flush(self, fd: int, queue: int) -> None:
        assert queue == termios.TCOFLUSH
        if self.flushes:
            self.queued = 0


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> FakeDriver:
    return FakeDriver(monkeypatch)


EIGHT_N_TWO = settings(stopbits=2)


def test_a_rate_the_driver_changes_is_refused_with_the_nearest(port: Port, driver: FakeDriver) -> None:
    driver.speed = lambda speed: 115200
    with pytest.raises(LineError, match="86400 baud: the nearest rate of its driver is 115200"):
        open_tty(port[1], EIGHT_N_TWO)


def test_a_rate_within_two_percent_is_taken(port: Port, driver: FakeDriver) -> None:
    driver.speed = lambda speed: round(speed * 1.004)
    open_tty(port[1], EIGHT_N_TWO).close(0)


def test_a_driver_without_parity_is_refused(port: Port, driver: FakeDriver) -> None:
    before = set(os.listdir("/proc/self/fd"))
    with pytest.raises(LineError, match="8E1"):
        open_tty(port[1], settings(stopbits=1))
    assert set(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize(("stopbits", "framing"), [(1, "7E1"), (2, "7E2")])
def test_seven_bits_have_parity_with_any_stop_bits(port: Port, driver: FakeDriver, stopbits: int, framing: str) -> None:
    seven = LineSettings(baud=9600, window=2, stopbits=stopbits, data_bits=7)
    assert (seven.framing, seven.has_parity) == (framing, True)
    with pytest.raises(LineError, match=framing):
        open_tty(port[1], seven)


def test_control_lines_are_polled_and_told_at_every_change(port: Port, driver: FakeDriver) -> None:
    line, clock = open_tty(port[1], EIGHT_N_TWO), Clock()
    assert line.read(clock.now) == [SignalsIn(cts=False, dsr=False, cd=False)]
    assert line.room(clock.now) == 0
    assert line.next_deadline() == clock.now + 10 * MILLISECOND
    driver.signals = termios.TIOCM_CTS | termios.TIOCM_DSR
    assert line.read(clock.advance(10 * MILLISECOND)) == [SignalsIn(cts=True, dsr=True, cd=False)]
    assert line.read(clock.advance(10 * MILLISECOND)) == []
    assert line.room(clock.now) == 216
    driver.signals |= termios.TIOCM_CD
    assert line.read(clock.advance(10 * MILLISECOND)) == [SignalsIn()]
    line.close(0)


def test_control_lines_are_driven(port: Port, driver: FakeDriver) -> None:
    line = open_tty(port[1], EIGHT_N_TWO)
    line.set_signals(SignalsOut(rts=True, dtr=False), SECOND)
    assert driver.driven == [
        (termios.TIOCMBIS, termios.TIOCM_RTS),
        (termios.TIOCMBIC, termios.TIOCM_DTR),
    ]
    line.close(0)


def test_the_queue_of_the_driver_counts_as_in_flight_and_is_called_back(port: Port, driver: FakeDriver) -> None:
    driver.signals = termios.TIOCM_CTS
    line, clock = open_tty(port[1], EIGHT_N_TWO), Clock()
    line.read(clock.now)
    line.room(clock.now)
    line.write(bytes(200), clock.now)
    driver.queued = 184
    assert line.in_flight(clock.now) == 200
    assert line.in_flight(clock.advance(SECOND)) == 184
    line.read(clock.now)
    assert line.room(clock.now) == 0
    deadline = line.next_deadline()
    assert deadline is not None
    assert deadline - clock.now <= 5 * MILLISECOND
    assert line.discard(clock.now) == 184
    assert line.in_flight(clock.now) == 0
    line.close(0)


def test_a_driver_that_empties_nothing_calls_nothing_back(port: Port, driver: FakeDriver) -> None:
    driver.signals, driver.flushes = termios.TIOCM_CTS, False
    line, clock = open_tty(port[1], EIGHT_N_TWO), Clock()
    line.read(clock.now)
    line.room(clock.now)
    line.write(bytes(100), clock.now)
    driver.queued = 90
    assert line.discard(clock.now) == 0
    assert line.in_flight(clock.now) == 100
    line.close(0)


def test_a_port_that_hangs_up_is_lost(driver: FakeDriver) -> None:
    master, slave = os.openpty()
    line = open_tty(os.ttyname(slave), EIGHT_N_TWO)
    os.close(slave)
    os.close(master)
    (end,) = read_until_closed(line, Clock()).ends
    assert end.closure is Closure.LOST
    assert "unplugged" in end.reason or "lost" in end.reason
    line.close(0)


def test_damage_is_parity_with_parity_and_framing_without(port: Port, driver: FakeDriver) -> None:
    line = open_tty(port[1], EIGHT_N_TWO)
    assert line._decode(b"a\xff") == [b"a"]
    assert line._decode(b"\x00") == []
    assert line._decode(b"X") == [Fault(fault=LineFault.FRAMING, byte=ord("X"))]
    line.close(0)


def test_the_fifo_is_part_of_the_stop_distance(port: Port, driver: FakeDriver) -> None:
    line = open_tty(port[1], EIGHT_N_TWO)
    assert line.stop_distance.characters == 216 + 16
    assert "FIFO" in line.stop_distance.how
    line.close(0)
