"""`tapewire convert` and `tapewire fanuc tape`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tapewire.codes import DataCode, encode
from tests.cli.helpers import printed

TEXT = b"%SHAFT\nO0001(PART)\nG91G01X1.\nM30\n%"


@pytest.fixture
def tape(tmp_path: Path) -> Path:
    path = tmp_path / "a.nc"
    path.write_bytes(TEXT)
    return path


@pytest.mark.parametrize("code", [DataCode.ISO, DataCode.EIA])
def test_there_and_back(tape: Path, code: DataCode) -> None:
    there, back = tape.with_name("b"), tape.with_name("c")
    assert printed("convert", tape, there, "--to", code).status == 0
    assert there.read_bytes() == encode(TEXT, code)
    told = printed("convert", there, back, "--to", "ascii")
    assert f"b is {code.upper()}" in told.stderr
    assert back.read_bytes() == TEXT
    assert sorted(path.name for path in tape.parent.iterdir()) == ["a.nc", "b", "c"]


def test_what_exists_is_not_replaced_without_force(tape: Path) -> None:
    out = tape.with_name("b")
    out.write_bytes(b"mine")
    told = printed("convert", tape, out, "--to", "iso")
    assert told.status == 2
    assert "exists" in told.stderr
    assert out.read_bytes() == b"mine"
    assert printed("convert", tape, out, "--to", "iso", "--force").status == 0
    assert out.read_bytes() == encode(TEXT, DataCode.ISO)


def test_a_refusal_leaves_nothing_behind(tape: Path) -> None:
    tape.write_bytes(b"%\nX1.\n#100=1\n%")
    told = printed("convert", tape, tape.with_name("b"), "--to", "eia")
    assert told.status == 2
    assert "line 3, column 1: '#' (23h) has no EIA code" in told.stderr
    assert [path.name for path in tape.parent.iterdir()] == ["a.nc"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--from", "iso", "--to", "eia"), "wrong parity"),
        (("--to", "eia", "--eob", "lf-cr-cr"), "EIA has one code"),
        (("--to", "eia", "--assign", "#=61"), "the EIA code of 'A'"),
        (("--to", "morse"), "morse"),
        ((), "--to"),
    ],
)
def test_what_cannot_be_is_refused(tape: Path, words: tuple[str, ...], why: str) -> None:
    told = printed("convert", tape, tape.with_name("b"), *words)
    assert told.status == 2
    assert why in told.stderr


def test_files_that_cannot_be_read_or_written(tape: Path) -> None:
    folder = tape.parent
    assert printed("convert", folder / "gone", folder / "b", "--to", "iso").status == 2
    assert printed("convert", folder, folder / "b", "--to", "iso").status == 2
    assert printed("convert", tape, folder / "no" / "b", "--to", "iso").status == 2
    tape.write_bytes(bytes(range(256)))
    assert "name its code with --from" in printed("convert", tape, folder / "b", "--to", "iso").stderr


def test_tape_says_what_a_control_would_find(tape: Path) -> None:
    told = printed("fanuc", "tape", tape)
    assert told.stdout.splitlines() == [
        "code: ASCII (no eighth bit)",
        "label: 'SHAFT'",
        "program: O0001 (PART), line 2",
        "blocks: 4; EOR on line 5",
    ]


def test_tape_names_the_block_that_fails_the_tv_check(tape: Path) -> None:
    told = printed("fanuc", "tape", tape, "--tv")
    assert told.status == 0
    assert told.stdout.endswith("TV check: every block has an even number of characters\n")
    tape.write_bytes(b"%\nX1\nX1.\n")
    told = printed("fanuc", "tape", tape, "--tv")
    assert told.status == 1
    assert "TV check: block 1 at byte 2 has 3 characters, an odd number: X1" in told.stdout
    assert "no EOR" in told.stdout
    assert printed("fanuc", "tape", tape, "--no-comments").status == 2
