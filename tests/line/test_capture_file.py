"""The ring on disk: bounded, whole at every moment, never in the way of the line, and honest about what it lost."""

from __future__ import annotations

import os
import resource
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tapewire.errors import UsageError
from tapewire.line.captures import file as capture_file
from tapewire.line.captures.file import KEPT_FAILED, LEAST_SIZE, CaptureFile, CaptureSettings, older_of
from tapewire.line.captures.reader import Packet, Problem, read_capture
from tapewire.line.captures.records import Happening, Origin, Record

ORIGIN = Origin(line="a line", baud=9600, protocol="fanuc-b")


def record(number: int, size: int = 100) -> Record:
    return Record(at=number * 1000, what=Happening.SENT, data=number.to_bytes(4, "big") + bytes(size - 4))


def start(path: Path, size: int = LEAST_SIZE) -> CaptureFile:
    return CaptureFile(CaptureSettings(path=path, size=size), ORIGIN)


def put_on_record(path: Path, *records: Record, size: int = LEAST_SIZE, keep: bool = False) -> Path | None:
    file = start(path, size)
    for each in records:
        file.put(each)
    kept = file.close(keep=keep)
    assert file.troubles() == []
    return kept


def numbers(*paths: Path) -> list[int]:
    found = []
    for path in paths:
        with path.open("rb") as stream:
            for item in read_capture(stream):
                assert isinstance(item, Packet), item
                if item.record.what is Happening.SENT:
                    found.append(int.from_bytes(item.record.data[:4], "big"))
    return found


def whole_of(path: Path) -> list[int]:
    return numbers(*(each for each in (older_of(path), path) if each.exists()))


def test_one_job_makes_one_file(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    assert put_on_record(path, *map(record, range(100))) is None
    assert numbers(path) == list(range(100))
    assert [each.name for each in tmp_path.iterdir()] == ["a.pcapng"]


def test_the_ring_goes_on_from_job_to_job(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    for job in range(4):
        put_on_record(path, record(2 * job), record(2 * job + 1))
    assert numbers(path) == list(range(8))


def test_the_ring_keeps_its_size_and_the_newest(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    put_on_record(path, *map(record, range(3000)))
    assert {each.name for each in tmp_path.iterdir()} == {"a.pcapng", "a.older.pcapng"}
    assert sum(each.stat().st_size for each in tmp_path.iterdir()) <= LEAST_SIZE
    kept = whole_of(path)
    assert kept == list(range(kept[0], 3000))
    assert len(kept) > LEAST_SIZE // 4 // 180


def test_a_failed_job_keeps_its_own(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    put_on_record(path, *map(record, range(50)))
    kept = put_on_record(path, *map(record, range(50, 60)), keep=True)
    assert kept is not None
    assert numbers(kept) == list(range(50, 60))
    put_on_record(path, *map(record, range(60, 3000)))
    assert numbers(kept) == list(range(50, 60))


def test_a_failed_job_over_both_halves_keeps_both(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    put_on_record(path, *map(record, range(100)))
    kept = put_on_record(path, *map(record, range(100, 250)), keep=True)
    assert kept is not None
    assert older_of(path).exists()
    assert numbers(kept) == list(range(100, 250))


def test_a_failed_job_longer_than_the_ring_says_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    file = start(path)
    for each in map(record, range(3000)):
        file.put(each)
    kept = file.close(keep=True)
    assert kept is not None
    assert numbers(kept) == whole_of(path)
    (trouble,) = file.troubles()
    assert "beginning of this job" in trouble


def test_a_job_that_said_nothing_keeps_nothing(tmp_path: Path) -> None:
    assert put_on_record(tmp_path / "a.pcapng", keep=True) is None


def test_captures_of_failed_jobs_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "a[1].pcapng"
    other = tmp_path / "a1.failed-1.pcapng"
    other.touch()
    kept = []
    for number in range(KEPT_FAILED + 2):
        file = start(path)
        file.put(record(number))
        kept.append(file.close(keep=True))
        assert len(file.troubles()) == (number >= KEPT_FAILED)
    left = {each.name for each in tmp_path.glob("*.failed-*")}
    assert left == {each.name for each in kept[2:] if each is not None} | {other.name}


def test_a_ring_that_a_power_failure_cut_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    put_on_record(path, record(1), record(2))
    with path.open("r+b") as stream:
        stream.truncate(path.stat().st_size - 3)
    cut = path.read_bytes()
    put_on_record(path, record(3))
    assert older_of(path).read_bytes() == cut
    assert numbers(path) == [3]


@pytest.mark.parametrize("content", [b"G0 X1\n", bytes.fromhex("d4c3b2a1") + bytes(40)])
def test_what_is_no_capture_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "program.nc"
    path.write_bytes(content)
    with pytest.raises(UsageError, match="no capture; give another name"):
        start(path)
    assert path.read_bytes() == content


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for path in (tmp_path, tmp_path / "gone" / "a.pcapng", fifo, Path("/dev/null")):
        with pytest.raises(UsageError, match="no capture can be written there"):
            start(path)
    with pytest.raises(UsageError, match="too small"):
        CaptureSettings(path=tmp_path / "a", size=100)


def test_two_jobs_do_not_write_one_ring(tmp_path: Path) -> None:
    path = tmp_path / "a.pcapng"
    file = start(path)
    with pytest.raises(UsageError, match="another job writes this capture"):
        start(path)
    file.close(keep=False)
    start(path).close(keep=False)


def test_a_link_is_followed_and_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    link = tmp_path / "a.pcapng"
    link.symlink_to(tmp_path / "real" / "b.pcapng")
    put_on_record(link, *map(record, range(400)))
    assert link.is_symlink()
    assert {each.name for each in (tmp_path / "real").iterdir()} == {"b.pcapng", "b.older.pcapng"}


@contextmanager
def disk_of(size: int) -> Iterator[None]:
    """No file grows beyond `size` bytes in here."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def wait_for(condition: threading.Event) -> None:
    assert condition.wait(10)


def test_a_full_disk_is_told_once_and_what_is_missing_is_marked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.pcapng"
    stored = threading.Event()
    batch = CaptureFile._store

    def store(self: CaptureFile, records: list[Record]) -> None:
        try:
            batch(self, records)
        finally:
            if records:
                stored.set()

    monkeypatch.setattr(CaptureFile, "_store", store)
    file = start(path)

    def write(first: int, count: int) -> None:
        stored.clear()
        for each in map(record, range(first, first + count)):
            file.put(each)
        wait_for(stored)
        while not file._queue.empty():
            stored.wait(0.01)

    with disk_of(1000):
        write(0, 20)
        write(20, 20)
    write(40, 5)
    file.close(keep=False)
    troubles = file.troubles()
    assert len([text for text in troubles if "the transfer goes on without it" in text]) == 1
    assert f"{file.lost} records are missing" in troubles[-1]
    with path.open("rb") as stream:
        items = list(read_capture(stream))
    assert not [item for item in items if isinstance(item, Problem)]
    marks = [
        item.record.remark for item in items if isinstance(item, Packet) and item.record.what is Happening.DATA_LOST
    ]
    assert marks == [f"{file.lost} records lost"]
    assert numbers(path)[-5:] == list(range(40, 45))
    assert len(numbers(path)) == 45 - file.lost


def test_a_disk_that_hangs_stops_nothing_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hanging = threading.Event()
    monkeypatch.setattr(CaptureFile, "_store", lambda self, records: hanging.wait(20))
    monkeypatch.setattr(capture_file, "MAX_WAITING", 10)
    monkeypatch.setattr(capture_file, "CLOSE_LIMIT_S", 0.05)
    file = start(tmp_path / "a.pcapng")
    for each in map(record, range(100)):
        file.put(each)
    assert file.lost >= 80
    assert "too slow" in file.troubles()[0]
    assert file.close(keep=True) is None
    assert "not done" in file.troubles()[0]
    hanging.set()
    file._thread.join(10)
    file._file.close()
