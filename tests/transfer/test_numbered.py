"""Programs out of a folder: what is given out, what is waited for, and what is told meanwhile."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tapewire.engine import SECOND, Nanos, Notice
from tapewire.errors import ProgramError
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.settings import End
from tapewire.transfer import numbered
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.numbered import FolderLibrary
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Report
from tapewire.transfer.session import settings_for

TEXT = b"N10G90\r\nN20M2\r\n"


class Shelf:
    """A library on the files of a folder, with a clock that a test moves."""

    def __init__(self, path: Path, monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
        self.path = path
        self.now: Nanos = 0
        self.told: list[str] = []
        monkeypatch.setattr(numbered, "monotonic", lambda: self.now)
        for name in names:
            self.write(name)
        job = settings_for(End.HOST, "socket://127.0.0.1:9", "bridgeport", settings={})
        self.job = job.observed_by(self.note, asyncio.Event())
        self.library = FolderLibrary(ProgramFolder(path), self.job, raw=False)

    def note(self, report: Report, now: Nanos) -> None:
        assert isinstance(report, Notice)
        self.told.append(report.text)

    def write(self, name: str, data: bytes = TEXT) -> None:
        (self.path / name).write_bytes(data)

    def find(self, number: str | None = "42", *, after_s: float = 0) -> bytes | None:
        self.now += round(after_s * SECOND)
        program = self.library.find(number, Mode.LOAD)
        return None if program is None else program.read(1 << 20)


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Shelf]]:
    made: list[Shelf] = []

    def make(*names: str) -> Shelf:
        made.append(Shelf(tmp_path, monkeypatch, *names))
        return made[-1]

    yield make
    for each in made:
        each.library.close()


def test_what_was_there_from_the_start_is_given_out_at_once(shelf: Callable[..., Shelf]) -> None:
    assert shelf("O0042.nc").find() == TEXT


def test_what_is_not_there_is_told_once_and_given_out_when_it_has_come_to_rest(shelf: Callable[..., Shelf]) -> None:
    waits = shelf()
    for _ in range(5):
        assert waits.find(after_s=1) is None
    waits.write("42.nc")
    assert [waits.find(after_s=1), waits.find(after_s=1)] == [None, None]
    assert waits.find(after_s=1) == TEXT
    assert len(waits.told) == 2
    assert "there is no program 42" in waits.told[0]
    assert "42.nc is new or was changed" in waits.told[1]


def test_a_file_that_grows_is_not_given_out_until_it_has_stopped(shelf: Callable[..., Shelf]) -> None:
    copied = shelf()
    for lines in range(1, 20):
        copied.write("42.nc", TEXT * lines)
        assert copied.find(after_s=1) is None
    assert copied.find(after_s=1) is None
    assert copied.find(after_s=1) == TEXT * 19


def test_a_file_that_was_changed_after_the_start_waits_too(shelf: Callable[..., Shelf]) -> None:
    edited = shelf("42.nc")
    edited.write("42.nc", TEXT * 2)
    assert edited.find() is None
    assert edited.find(after_s=2) == TEXT * 2


def test_another_file_of_the_same_length_and_time_is_another(shelf: Callable[..., Shelf]) -> None:
    swapped = shelf("42.nc", "43.nc")
    times = os.stat(swapped.path / "42.nc")
    os.utime(swapped.path / "43.nc", ns=(times.st_atime_ns, times.st_mtime_ns))
    os.replace(swapped.path / "43.nc", swapped.path / "42.nc")
    assert swapped.find() is None


def test_a_file_that_changes_while_it_is_read_is_not_given_out(
    shelf: Callable[..., Shelf], monkeypatch: pytest.MonkeyPatch
) -> None:
    busy = shelf("42.nc")
    read = Program.from_file

    def and_meanwhile(*args: object, **words: object) -> Program:
        program = read(*args, **words)  # type: ignore[arg-type]
        busy.write("42.nc", TEXT * 2)
        return program

    monkeypatch.setattr(Program, "from_file", and_meanwhile)
    assert busy.find() is None
    monkeypatch.setattr(Program, "from_file", read)
    assert busy.find(after_s=1) is None
    assert busy.find(after_s=1) == TEXT * 2


def test_a_file_that_cannot_be_sent_is_told_and_given_out_when_it_is_mended(shelf: Callable[..., Shelf]) -> None:
    forged = shelf()
    forged.write("42.nc", b"N1\x04\r\n")
    assert [forged.find(after_s=3), forged.find(after_s=3), forged.find(after_s=3)] == [None] * 3
    assert "EOT" in forged.told[-1]
    assert "mend it" in forged.told[-1]
    forged.write("42.nc")
    forged.find()
    assert forged.find(after_s=2) == TEXT


def test_two_files_of_one_number_are_told_and_neither_is_given_out(shelf: Callable[..., Shelf]) -> None:
    doubled = shelf("42.nc")
    doubled.write("O42")
    assert doubled.find() is None
    assert "are both program 42" in doubled.told[-1]


def test_without_a_number_nothing_is_given_out(shelf: Callable[..., Shelf]) -> None:
    assert shelf("42.nc").find(None) is None


def test_what_the_protocol_cannot_carry_is_refused_here_too(shelf: Callable[..., Shelf]) -> None:
    def refuse(params: object, read: Callable[[int], bytes]) -> None:
        raise ProgramError(f"{len(read(1000))} bytes cannot be carried")

    strict = shelf("42.nc")
    job = replace(strict.job, protocol=replace(strict.job.protocol, refuse=refuse))
    strict.library.close()
    strict.library = FolderLibrary(ProgramFolder(strict.path), job, raw=False)
    assert strict.find() is None
    assert f"{len(TEXT)} bytes cannot be carried" in strict.told[-1]


def test_a_folder_that_goes_away_is_told_and_comes_back(shelf: Callable[..., Shelf], tmp_path: Path) -> None:
    gone = shelf("42.nc")
    moved = tmp_path.with_name("elsewhere")
    tmp_path.rename(moved)
    assert gone.find() is None
    assert "cannot be read as a folder" in gone.told[-1]
    moved.rename(tmp_path)
    assert gone.find() == TEXT
