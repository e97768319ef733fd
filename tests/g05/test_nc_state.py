"""What a header leaves behind: the place and the modes are exact, or the program is refused with the reason."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.errors import ProgramError
from tapewire.nc.reader import NcReader, Reading

AT_ZERO = "G90G00X0Y0Z0\n"
AND_ON = "\nG01X1.F100"


def start_of(text: str, **words: Any) -> tuple[float, ...]:
    return NcReader([text], Reading(**{"axes": ("X", "Y", "Z"), **words})).start


@pytest.mark.parametrize(
    ("block", "missing"),
    [
        ("M98P1000", "X, Y, Z"),
        ("G65P9810", "X, Y, Z"),
        ("G31X5.F50", "X, Y, Z"),
        ("M06", "X, Y, Z"),
        ("T5M6", "X, Y, Z"),
        ("G43H1", "Z"),
        ("G43H1X5.", "Z"),
        ("G43H1Z5.\nG49", "Z"),
        ("G68X0Y0R45.\nX5.Y5.\nG69", "X, Y, Z"),
        ("G16\nX5.Y30.\nG15", "X, Y, Z"),
        ("G51X0Y0P2.\nX5.\nG50", "X, Y, Z"),
        ("G51.1X0\nX5.\nG50.1X0", "X, Y, Z"),
        ("G41D1X5.\nX6.\nG40X7.Y8.", "Z"),
        ("G81X5.Y5.Z-3.R1.F100\nX6.\nG80", "X, Y, Z"),
        ("G81X5.Y5.Z-3.R1.F100\nG00X1.Y2.", "Z"),
        ("G10L2P1X5.", "X, Y, Z"),
        ("G54.1P3", "X, Y, Z"),
        ("G53X0", "X, Y, Z"),
        ("G123", "X, Y, Z"),
        ("G50X5.", "X, Y, Z"),
        ("G66P1\nX5.\nG67", "X, Y, Z"),
    ],
)
def test_a_place_that_is_lost(block: str, missing: str) -> None:
    with pytest.raises(ProgramError, match=rf"behind .* in line \d+ it never says where {missing} is"):
        start_of(AT_ZERO + block + "\nG90G21G94G17G00")


@pytest.mark.parametrize(
    ("block", "start"),
    [
        ("G04X2.", (0, 0, 0)),
        ("G04X2.5\nM08", (0, 0, 0)),
        ("G49", (0, 0, 0)),
        ("G15G69G50G40G80", (0, 0, 0)),
        ("G43H1Z5.", (0, 0, 5)),
        ("G91G43H1Z5.\nG90", (0, 0, 5)),
        ("G43H1Z5.\nG49Z7.", (0, 0, 7)),
        ("G92X1.Y2.Z3.", (1, 2, 3)),
        ("G91G92X1.Y2.Z3.\nG90", (1, 2, 3)),
        ("G96S200\nG97S1000\nX5.M03", (5, 0, 0)),
        ("G68X1.Y1.R45.\nX5.\nG69\nG00X1.Y2.Z3.M08", (1, 2, 3)),
        ("G81X5.Y5.Z-3.R1.F100\nG80\nG00X1.Y2.Z3.M08", (1, 2, 3)),
        ("M98P1000\nG90G21G94G00X1.Y2.Z3.M08", (1, 2, 3)),
        ("G22X100.Y100.Z100.I0J0K0", (0, 0, 0)),
        ("G60X5.", (5, 0, 0)),
    ],
)
def test_a_place_that_is_known(block: str, start: tuple[float, ...]) -> None:
    assert start_of(AT_ZERO + block + AND_ON) == start


@pytest.mark.parametrize(
    ("again", "words"),
    [
        ("G90G21G94", "no move|never says|G00, G01"),
        ("G00G90G21", "may have changed G94"),
        ("G00G21G94", "never says where X, Y, Z is"),
        ("G00G90G94", "never says where X, Y, Z is"),
    ],
)
def test_modes_that_a_subprogram_may_have_changed(again: str, words: str) -> None:
    text = f"{AT_ZERO}F100\nM98P1000\n{again}\nX1.Y2.Z3.M08\nX5.F100"
    with pytest.raises(ProgramError, match=words):
        list(NcReader([text], Reading(axes=("X", "Y", "Z"))).moves())


def test_an_arc_in_a_plane_that_a_subprogram_may_have_changed() -> None:
    text = f"{AT_ZERO}M98P1000\nG00G90G21G94X1.Y2.Z3.M08\nG01X5.F100\n"
    reader = NcReader([text + "M30"], Reading(axes=("X", "Y", "Z")))
    list(reader.moves())
    assert reader.trailer == ["G01G21G90F100", "M30"], "what nobody knows is not said"
    with pytest.raises(
        ProgramError, match="line 6: is an arc, and the subprogram called in line 3 may have changed G17"
    ):
        list(NcReader(["%\n" + text + "G02X7.R1."], Reading(axes=("X", "Y", "Z"))).moves())


def test_a_macro_that_is_called_with_every_move() -> None:
    with pytest.raises(ProgramError, match="never says where X is"):
        start_of("G66P1\nG90G21G94G00X1.\nG01X2.F100", axes=("X",))


@pytest.mark.parametrize("block", ["G91X1.G90M8", "G91G90X1.M8"])
def test_of_two_modes_in_a_block_the_last_holds(block: str) -> None:
    assert start_of(f"G90G00X3.Y0Z0\n{block}{AND_ON}") == (1, 0, 0)


@pytest.mark.parametrize(
    ("on", "off", "name"),
    [
        ("G43.4H1", "G49", "tool center point control"),
        ("G68.2X0Y0Z0I0J45.K0\nG53.1", "G69", "a tilted working plane"),
        ("G54.2P1", "G54.2P0", "dynamic fixture offset"),
        ("G54.4P1", "G54.4P0", "workpiece error compensation"),
        ("G41.5D1", "G40", "three-dimensional cutter compensation"),
    ],
)
def test_a_mode_in_which_words_are_no_places_of_the_axes(on: str, off: str, name: str) -> None:
    there = "G00X1.Y2.Z3.M08"
    with pytest.raises(ProgramError, match=rf"line \d: (moves|would be .*) while {name} is on"):
        start_of(f"{AT_ZERO}{on}\n{there}{AND_ON}")
    with pytest.raises(ProgramError, match="never says where Y, Z is"):
        start_of(f"{AT_ZERO}{on}\n{there}\n{off}{AND_ON}")
    assert start_of(f"{AT_ZERO}{on}\n{off}\n{there}{AND_ON}") == (1, 2, 3)


def test_a_feed_of_before_another_kind_of_feed_is_not_taken() -> None:
    with pytest.raises(ProgramError, match="moves at a feed that no F has given"):
        list(NcReader([f"{AT_ZERO}F500\nG95F.1\nG94\nG01X1."], Reading(axes=("X", "Y", "Z"))).moves())


def test_a_feed_of_before_the_change_of_units_is_not_taken() -> None:
    with pytest.raises(ProgramError, match="line 4: moves at a feed that no F has given, or one before the change"):
        list(NcReader([f"{AT_ZERO}G21F600\nG20\nG01X1."], Reading(axes=("X", "Y", "Z"))).moves())


@pytest.mark.parametrize(
    ("move", "speed"),
    [("C90.", 10.0), ("X1.", 254.0), ("X1.C1.", 10.0 * np.hypot(25.4, 1) / np.hypot(1, 1)), ("X0C0", 254.0)],
)
def test_the_feed_of_a_rotary_axis_in_inches(move: str, speed: float) -> None:
    """F600 turns 10 degrees a second in G20 too."""
    reading = Reading(axes=("X", "C"), start=(0.0, 0.0), rotary=frozenset("C"))
    (piece,) = NcReader([f"G20\nG01{move}F600."], reading).moves()
    assert piece.speeds == pytest.approx([speed])


def test_how_far_radii_may_differ_is_the_same_length_on_an_inch_machine() -> None:
    def ends(off: float, **words: Any) -> int:
        text = f"{'G20' if words else 'G21'}F10.\nG02X{2 + off:.4f}I1."
        return sum(len(piece) for piece in NcReader([text], Reading(axes=("X", "Y"), start=(0, 0), **words)).moves())

    assert ends(0.009)
    assert ends(0.0003, inch_machine=True)
    for off, words in ((0.02, {}), (0.0009, {"inch_machine": True})):
        with pytest.raises(ProgramError, match="begins with the radius"):
            ends(off, **words)


LENGTHS = st.sampled_from(["1.", "-.5", "+2.25", "0.", "12", "-7", "1234567.891", ".", "00.10"])
WORDS = st.builds(str.__add__, st.sampled_from(["X", "Y", "Z", "X", "Y", "F", "I", "N", "M"]), LENGTHS)
LINES = st.one_of(
    st.sampled_from(["G01", "G0X1.", "G1X2.F500.", "G00 X1. Y2. ", "N10G1Z.5F1", "G02X1.Y0I.5J0", "G91", "G90", "G20"]),
    st.sampled_from(
        ["G21", "", "(X1.)", "x1.y2.", "X1.X2.", "X1.Y2.F0", "X1.;", "G01G00X1.", "F9", "F9.", "X1.\r", "X 1.", "%"]
    ),
    st.lists(WORDS, min_size=1, max_size=3).map("".join),
)
PLAIN = st.sampled_from(["X1.Y2.\n", "X1.5\nY-.5Z3.\n", "G1X.1F20.\n", "X1.F8\n", "G0X5.\nG1X6.\n", "N1 X1. Y1. \r\n"])


@settings(max_examples=150, deadline=None)
@given(
    parts=st.lists(st.one_of(LINES.map(lambda line: line + "\n"), PLAIN.map(lambda line: line * 20)), max_size=8),
    cuts=st.lists(st.integers(0, 600), max_size=3),
    distance=st.sampled_from(["", "G91", "G20", "G91G20F7."]),
)
def test_runs_are_read_as_block_by_block(parts: list[str], cuts: list[int], distance: str) -> None:
    text = f"G01X0Y0Z0F100.\n{distance}X1.\n" + "".join(parts)
    places = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    whole = outcome([text[begin:end] for begin, end in itertools.pairwise(places)])
    assert whole == outcome(text.splitlines(keepends=True))


def outcome(pieces: list[str]) -> tuple[Any, ...]:
    """Moves, or the error, and what stays text."""
    ends, speeds = [], []
    reader = NcReader(pieces, Reading(axes=("X", "Y", "Z"), start=(0.0, 0.0, 0.0)))
    try:
        for piece in reader.moves():
            ends += piece.ends.tolist()
            speeds += piece.speeds.tolist()
    except ProgramError as error:
        return (str(error),)
    return ends, speeds, reader.trailer
