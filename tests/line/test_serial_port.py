"""Terminals on a pseudo terminal: who may open them, how they are set up, and what comes through."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from tapewire.engine import Closure
from tapewire.errors import LineBusy, LineError, LineNotFound
from tapewire.line.ports.kernel import TtyKernel
from tapewire.line.ports.serial_port import open_tty
from tests.line.helpers import Clock, Seen, read_until_closed, settings

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
    got = TtyKernel().settings(fd)
    assert got.input_flags == termios.INPCK | termios.PARMRK
    assert got.output_flags == 0
    assert got.local_flags == 0
    assert not got.control_flags & (termios.HUPCL | termios.CRTSCTS)
    assert got.control_flags & termios.CLOCAL
    return got.output_baud, got.control_flags & termios.CSIZE


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
