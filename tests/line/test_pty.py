"""A pseudo terminal: its link, its other side, and when it speaks."""

from __future__ import annotations

import os
import termios
from pathlib import Path

import pytest

from tapewire.engine import MILLISECOND, SECOND, Closure
from tapewire.errors import LineBusy, LineError
from tapewire.line.pty import create_pty
from tests.line.helpers import Clock, Seen, read_until_closed, settings


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "line")


def _open_slave(path: str) -> int:
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def test_nothing_is_said_before_the_other_side_is_there(path: str) -> None:
    line, clock = create_pty(path, settings()), Clock()
    for _ in range(3):
        assert line.read(clock.now) == []
        assert line.room(clock.now) == 0
        assert not line.connected
        assert line.watched is None
        assert line.next_deadline() == clock.now + 20 * MILLISECOND
        clock.advance(20 * MILLISECOND)
    slave = _open_slave(path)
    assert line.read(clock.now) == []
    assert line.connected
    assert line.room(clock.now) == 216
    assert line.watched is not None
    os.close(slave)
    line.close(0)


def test_the_other_side_going_is_the_end(path: str) -> None:
    line, clock = create_pty(path, settings()), Clock()
    slave = _open_slave(path)
    os.write(slave, b"short")
    os.close(slave)
    seen = read_until_closed(line, clock)
    assert seen.data == b"short"
    assert seen.ends[0].closure is Closure.ORDERLY
    assert line.room(clock.now) == 0
    line.close(0)


def test_the_slave_is_raw_before_it_can_be_found(path: str) -> None:
    line = create_pty(path, settings())
    slave = _open_slave(path)
    iflag, oflag, _, lflag, *_ = termios.tcgetattr(slave)
    assert not iflag & (termios.IXON | termios.IXOFF | termios.ICRNL | termios.ISTRIP)
    assert not oflag & termios.OPOST
    assert not lflag & (termios.ECHO | termios.ICANON | termios.ISIG)
    os.close(slave)
    line.close(0)


def test_the_link_goes_with_the_line(path: str) -> None:
    line = create_pty(path, settings())
    assert os.readlink(path).startswith("/dev/pts/")
    line.close(0)
    assert not os.path.lexists(path)
    line.close(0)


def test_a_link_that_is_not_ours_any_more_stays(path: str) -> None:
    line = create_pty(path, settings())
    os.unlink(path)
    os.symlink("/dev/pts/999999", path)
    line.close(0)
    assert os.path.lexists(path)


def test_a_link_of_a_killed_run_is_replaced(path: str) -> None:
    os.symlink("/dev/pts/999999", path)
    line = create_pty(path, settings())
    os.close(_open_slave(path))
    line.close(0)


@pytest.mark.parametrize("what", ["file", "folder", "link to a file", "dangling link elsewhere"])
def test_what_is_there_already_is_left_alone(path: str, what: str) -> None:
    match what:
        case "file":
            Path(path).write_text("a program")
        case "folder":
            Path(path).mkdir()
        case "link to a file":
            os.symlink(__file__, path)
        case _:
            os.symlink("/nowhere", path)
    before = os.lstat(path)
    with pytest.raises(LineBusy, match="give another path"):
        create_pty(path, settings())
    assert os.lstat(path) == before


def test_a_link_in_use_is_not_taken_over(path: str) -> None:
    line = create_pty(path, settings())
    with pytest.raises(LineBusy, match="in use"):
        create_pty(path, settings())
    assert os.path.exists(path)
    line.close(0)


def test_a_folder_that_is_not_there_leaves_nothing_open(tmp_path: Path) -> None:
    before = set(os.listdir("/proc/self/fd"))
    with pytest.raises(LineError, match="folder"):
        create_pty(str(tmp_path / "no" / "line"), settings())
    assert set(os.listdir("/proc/self/fd")) == before


def test_what_the_other_side_has_not_read_is_in_flight(path: str) -> None:
    """So that whoever waits for 0 before closing loses nothing."""
    line, clock = create_pty(path, settings()), Clock()
    slave = _open_slave(path)
    line.read(clock.now)
    line.room(clock.now)
    line.write(b"0123456789", clock.now)
    for now in clock.looks():
        if line.in_flight(now) == 10:
            break
    assert line.in_flight(clock.advance(SECOND)) == 10
    assert os.read(slave, 4) == b"0123"
    assert line.in_flight(clock.advance()) == 6
    seen = os.read(slave, 100)
    assert seen == b"456789"
    assert line.in_flight(clock.advance()) == 0
    os.close(slave)
    assert Seen(line.read(clock.advance())).ends
    line.close(0)
