"""The committed example is what its generator makes, and is the kind of program it says it is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from examples.make_surfacing import format_mm, program

SURFACING = Path(__file__).parents[1] / "examples" / "surfacing.nc"


@pytest.fixture(scope="module")
def made() -> bytes:
    return program()


def test_surfacing_is_reproduced_byte_for_byte(made: bytes) -> None:
    assert made == SURFACING.read_bytes(), "run: python examples/make_surfacing.py examples/surfacing.nc"


def test_surfacing_has_the_size_the_demo_counts_on() -> None:
    assert 210_000 <= SURFACING.stat().st_size <= 260_000


def test_surfacing_is_framed_as_a_control_wants_it(made: bytes) -> None:
    blocks = made.decode("ascii").split("\n")
    assert blocks[0] == "%"
    assert re.match(r"O\d{4}\(", blocks[1])
    assert blocks[-3:] == ["M30", "%", ""]
    assert not any("%" in block for block in blocks[1:-2])


def test_every_block_of_surfacing_is_one_a_control_can_read(made: bytes) -> None:
    word = r"[GMNSTHXYZFO]-?\d+(?:\.\d*)?"
    block = re.compile(rf"(?:{word})*(?:\([A-Z0-9. -]+\))?")
    unreadable = [line for line in made.decode("ascii").split("\n")[1:-2] if not (line and block.fullmatch(line))]
    assert unreadable == []


def test_surfacing_repeats_no_modal_word(made: bytes) -> None:
    """Two X in a row with one value would be a block too many: the wire is the scarce thing."""
    said: dict[str, str] = {}
    for line in made.decode("ascii").split("\n"):
        if line.startswith(("(", "G91", "G28", "G43")):
            said.clear()
            continue
        for letter, value in re.findall(r"([XYZF])(-?[\d.]+)", line):
            assert said.get(letter) != value, line
            said[letter] = value


def test_another_seed_is_another_surface(made: bytes) -> None:
    assert program(seed=7) != made


def test_a_small_negative_number_gets_no_sign() -> None:
    assert format_mm(-0.0004) == "0.000"
    assert format_mm(-0.0006) == "-0.001"
