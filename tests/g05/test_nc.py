"""NC programs as moves: what is read, what stays text, what is refused with its line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tapewire.errors import ProgramError
from tapewire.nc.reader import NcReader, Reading


def read(text: str, **words: Any) -> tuple[NcReader, NDArray[np.float64], NDArray[np.float64]]:
    reader = NcReader([text], Reading(**{"axes": ("X", "Y", "Z"), "start": (0.0, 0.0, 0.0), **words}))
    pieces = list(reader.moves())
    ends = np.concatenate([piece.ends for piece in pieces]) if pieces else np.empty((0, 3))
    speeds = np.concatenate([piece.speeds for piece in pieces]) if pieces else np.empty(0)
    return reader, ends, speeds


def test_straight_moves() -> None:
    _, ends, speeds = read("G01X1.F600\nY-2.5\nG91X1.Z.5\nG90G0X0Y0Z0")
    assert ends.tolist() == [[1, 0, 0], [1, -2.5, 0], [2, -2.5, 0.5], [0, 0, 0]]
    assert speeds.tolist() == [10, 10, 10, np.inf]


def test_blanks_and_tabs_part_words_and_say_nothing() -> None:
    _, ends, _ = read("\tG01\tX 1.5\tF600 \nX2.\t\n")
    assert ends[:, 0].tolist() == [1.5, 2.0]


def test_header_and_trailer_stay_text() -> None:
    program = "%\nO7(PART)\nG21 G90 G54\nM03 S900\nG00X1.Y2.Z3.\n(FINISH)\nG01X5.F100\nY6.\nM05\nG28Z0\nM30\n%\nrest"
    reader, ends, _ = read(program, start=None)
    assert reader.header == ["O7(PART)", "G21 G90 G54", "M03 S900", "G00X1.Y2.Z3."]
    assert reader.start == (1, 2, 3)
    assert ends.tolist() == [[5, 2, 3], [5, 6, 3]]
    assert reader.trailer == ["G01G17G21G90F100", "M05", "G28Z0", "M30"]


@pytest.mark.parametrize(
    ("text", "unit"),
    [("G21\nG01X10F600", 0.01), ("G21\nG01X10.F600", 10.0), ("G20\nG01X10.F10.", 254.0), ("G20\nG01X10F10.", 0.0254)],
)
def test_numbers_without_a_point_count_increments(text: str, unit: float) -> None:
    _, ends, _ = read(text)
    assert ends[0, 0] == pytest.approx(unit)


def test_words_of_a_block_hold_whatever_their_order() -> None:
    _, ends, speeds = read("G01X10.F600\nF60.Y1.G91G20")
    assert ends[1] == pytest.approx((10.0, 25.4, 0.0))
    assert speeds[1] == pytest.approx(25.4)


def test_an_inch_machine_and_a_rotary_axis() -> None:
    _, ends, speeds = read(
        "G20\nG01X1.C90.F60.\nG21\nX25.4C0F1524.",
        axes=("X", "C"),
        start=(0.0, 0.0),
        inch_machine=True,
        rotary=frozenset("C"),
    )
    assert ends == pytest.approx(np.array([[1, 90], [1, 0]]))
    assert speeds[0] == 1


@pytest.mark.parametrize(
    ("block", "centre"),
    [
        ("G02X10.Y0R5.", (5, 0)),
        ("G03X10.Y0I5.J0K0", (5, 0)),
        ("G02X0Y0I5.", (5, 0)),
        ("G02X5.Y5.R5.", (5, 0)),
        ("G03X5.Y5.R5.", (0, 5)),
        ("G02X5.Y5.R-5.", (0, 5)),
        ("G17G03X-5.Y5.J5.", (0, 5)),
    ],
)
def test_arcs(block: str, centre: tuple[float, float]) -> None:
    """Every chord's end is on the circle, and the middle of each no farther from it than a thousandth."""
    _, ends, _ = read(f"F600\n{block}")
    path = np.concatenate([np.zeros((1, 3)), ends])
    radius = np.hypot(path[:, 0] - centre[0], path[:, 1] - centre[1])
    assert radius == pytest.approx(5.0)
    middle = (path[1:] + path[:-1]) / 2
    assert np.abs(np.hypot(middle[:, 0] - centre[0], middle[:, 1] - centre[1]) - 5.0).max() <= 0.001 + 1e-9
    steps = np.diff(path, axis=0)
    turned = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    assert (turned < 0).all() if "G02" in block else (turned > 0).all()


def test_a_helix_and_other_planes() -> None:
    _, ends, speeds = read("F600\nG03X0Y0Z6.2831853I-1.")
    assert ends[:, 2] == pytest.approx(np.linspace(0, 6.2831853, len(ends) + 1)[1:])
    assert speeds[0] == pytest.approx(10 * np.sqrt(2))
    _, ends, _ = read("G18F600\nG02X0Z2.K1.")
    assert np.hypot(ends[:, 0], ends[:, 2] - 1) == pytest.approx(1.0)
    _, ends, _ = read("G19F600\nG02Y2.Z0J1.")
    assert np.hypot(ends[:, 1] - 1, ends[:, 2]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("G01X1.F100\nM08\n" + "X2.\n" * 21, "line 2: 'M08' is more than a move, and over 20 moves follow"),
        ("G01X1.F100\nG04P500\n" + "X2.\n" * 21, "line 2: 'G04P500' is more than a move"),
        ("G01X1.F100\nX2.M08\n" + "X2.\n" * 21, "line 2: 'X2.M08' is more than a move"),
        ("G02X2.R1.F100\nM30", "line 2: follows an arc without a straight move between"),
        ("G01X1.F100\n#1=5\nX#1", "line 2: holds something that is no word"),
        ("G01X1.F100\n/X5.", "line 2: has a block skip"),
        ("G01X1.F100\nXY2.", "line 2: has a letter without a number"),
        ("G01X1.", "line 1: moves at a feed that no F has given"),
        ("F100X5.", "holds no move|moves before any of G00"),
        ("G01X1.F0", "line 1: has the feed F0"),
        ("G01X1.F100\nG02X2.", "line 2: an arc without I, J or R"),
        ("G01X1.F100\nG02X2.I5.", "line 2: the arc begins with the radius 5.0000 and ends with 4.0000"),
        ("G01X1.F100\nG02X9.R1.", "line 2: an arc with R1 cannot span a chord of 8.0000"),
        ("G01X1.F100\nG02R1.", "line 2: a full circle with R"),
        ("G-X1.", "line 1: has a letter without a number"),
        ("G01X1.F100\nG02X2.R1000000000000000.", "line 2: an arc of radius 1e.15"),
        ("G01X1.F100\nG02X2.I" + "9" * 400, "line 2: an arc of radius inf"),
        ("G01X1.F100R2.", "line 1: has R in a straight move"),
        ("G01X1.F100\nX2.I1.K2.", "line 2: has I, K in a straight move"),
        ("G01X1.F100\nG02X3.I1.K.5", "line 2: K in an arc in G17, where it says nothing"),
        ("G20\nG01X1.F10", "line 2: has the feed F10 in G20: without a point"),
        ("G20G01X1.F1.\n" + "X2.\n" * 30 + "X3.F2\n" + "X1.\n" * 30, "line 32: has the feed F2 in G20"),
        ("G01X1.F100\n(AT 50% FEED)\nX2.", "line 2: holds %, which ends the data"),
        ("G01X1.F100\nX2.%\n", "line 2: holds %, which ends the data"),
        ("G93\nG01X1.F100", "line 2: moves while the feed is that of G93, inverse time"),
        ("G95\nM03\nG01X1.F.2", "line 3: moves while the feed is that of G95, per revolution"),
        ("O1\nN5 G05(BINARY)\nG01X1.F100", "line 2: is G05 already"),
        ("G01X1.F100\nG5\nX2.", "line 2: is G05 already"),
        ("G41D1\nG01X1.F100", "line 2: would be binary input operation while cutter compensation is on"),
        ("M30", "line 1: 'M30' ends the program before a move"),
        ("M05", "it holds no move"),
        ("", "it holds no move"),
        ("X" * 5000, "line 1: is longer than 4,096 characters"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(text: str, words: str) -> None:
    with pytest.raises(ProgramError, match=words):
        read(text)


def test_the_way_home_stays_text_behind_what_is_modal() -> None:
    reader, ends, _ = read("G00X1.\nG91G01X1.F200\nM09\nZ50.\nG90X0\nM30")
    assert ends.tolist() == [[1, 0, 0], [2, 0, 0]]
    assert reader.trailer == ["G01G17G21G91F200", "M09", "Z50.", "G90X0", "M30"]


def test_a_place_that_nobody_says_is_asked_for() -> None:
    with pytest.raises(ProgramError, match="never says where Y, Z is; say so with --start"):
        read("G90G00X1.\nG01X2.F100", start=None)


def test_a_return_to_the_reference_point_loses_the_place() -> None:
    with pytest.raises(ProgramError, match="never says where X, Y, Z is"):
        read("G00X1.Y1.Z1.M05\nG28X0Y0Z0\nG91G01X1.F100", start=None)


def test_feed_per_minute_after_another_kind() -> None:
    _, ends, _ = read("G95\nG94\nG01X1.F100")
    assert ends.tolist() == [[1, 0, 0]]


def test_another_work_coordinate_system_is_no_mere_move() -> None:
    """X20 of G55 is another place than X20 of G54: it stays text, and the modal block does not hide it."""
    reader, ends, _ = read("G54G00X0Y0Z0\nG01X10.F100\nG55X20.\nM30", start=None)
    assert ends.tolist() == [[10, 0, 0]]
    assert reader.trailer == ["G01G17G21G90F100", "G55X20.", "M30"]
    with pytest.raises(ProgramError, match=r"line 3: 'G55X20\.' is more than a move"):
        read("G54G00X0Y0Z0\nG01X10.F100\nG55X20.\n" + "X1.\n" * 21, start=None)


def test_a_place_is_lost_in_another_work_coordinate_system() -> None:
    with pytest.raises(ProgramError, match="never says where Y, Z is"):
        read("G54G00X0Y0Z0\nG55\nX5.\nG01X1.F100", start=None)
    reader, _, _ = read("G54G00X0Y0Z0\nG54G49\nG01X1.F100", start=None)
    assert reader.start == (0, 0, 0)


def test_the_end_of_tool_length_compensation_stays_text() -> None:
    reader, ends, _ = read("G01X1.F100\nG49\nZ5.")
    assert ends.tolist() == [[1, 0, 0]]
    assert reader.trailer == ["G01G17G21G90F100", "G49", "Z5."]


def test_an_arc_of_too_many_chords_is_refused_and_not_coarser() -> None:
    with pytest.raises(ProgramError, match=r"line 2: the arc needs .* chords"):
        read("F600\nG02X0Y0I500000.", chord_error=1e-6)
