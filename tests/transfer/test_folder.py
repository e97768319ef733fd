"""Programs by number in a folder: which file is which program, and where a new one goes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tapewire.errors import UsageError
from tapewire.transfer.folder import ProgramFolder


def folder(path: Path, *names: str) -> ProgramFolder:
    for name in names:
        (path / name).touch()
    return ProgramFolder(path)


@pytest.mark.parametrize("name", ["1234", "1234.nc", "O1234.txt", "o001234", "P1234.NC", "01234.tap"])
@pytest.mark.parametrize("asked", ["1234", "001234"])
def test_the_name_is_the_number(tmp_path: Path, name: str, asked: str) -> None:
    assert folder(tmp_path, name, "part.nc", "1235.nc").find(asked) == tmp_path / name


@pytest.mark.parametrize("name", ["1234567", "A1234", "1234a.nc", "1234.nc.part", ".1234", "O-1234", "١٢٣٤", "O", ""])
def test_other_names_are_no_programs(tmp_path: Path, name: str) -> None:
    found = folder(tmp_path, *([name] if name else []))
    assert all(found.find(number) is None for number in ("1234", "123456", "0", "1"))


def test_a_folder_inside_is_no_program(tmp_path: Path) -> None:
    (tmp_path / "1234").mkdir()
    assert ProgramFolder(tmp_path).find("1234") is None


def test_what_is_there_at_the_moment_counts(tmp_path: Path) -> None:
    programs = folder(tmp_path)
    (tmp_path / "7.nc").touch()
    assert programs.find("7") == tmp_path / "7.nc"
    (tmp_path / "O7").touch()
    with pytest.raises(UsageError, match=r"7\.nc and O7 in .* are both program 7"):
        programs.find("7")


def test_two_files_of_one_number_hide_no_other_number(tmp_path: Path) -> None:
    """An editor leaves 7.bak while the host runs."""
    programs = folder(tmp_path, "7.nc", "8.nc")
    (tmp_path / "7.bak").touch()
    assert programs.find("8") == tmp_path / "8.nc"
    with pytest.raises(UsageError, match="are both program 7"):
        programs.find("7")
    with pytest.raises(UsageError, match="are both program 7"):
        ProgramFolder(tmp_path)


def test_a_new_program_stands_beside_what_is_there(tmp_path: Path) -> None:
    programs = folder(tmp_path, "O0042.txt", "42.received-1.nc", "unnamed-1.nc")
    assert programs.place_for("42", force=False) == tmp_path / "42.received-2.nc"
    assert programs.place_for("42", force=True) == tmp_path / "O0042.txt"
    assert programs.place_for("43", force=False) == tmp_path / "43.nc"
    assert programs.place_for(None, force=True) == tmp_path / "unnamed-2.nc"


@pytest.mark.parametrize("number", ["../1", "1/2", "", "1234567", "-1", "１"])
def test_nothing_but_digits_gets_here(tmp_path: Path, number: str) -> None:
    with pytest.raises((AssertionError, ValueError)):
        ProgramFolder(tmp_path).find(number)


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read as a folder"):
        ProgramFolder(tmp_path / "nowhere")
