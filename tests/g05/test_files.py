"""`tapewire g05`: files in, files out, refusals without a traceback."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tapewire.errors import ProgramError
from tapewire.g05.check import Asked, check
from tapewire.g05.layout import AuxiliaryUse, Layout, RecordFormat, UnitTime
from tapewire.g05.records import decode, encode
from tests.cli.helpers import Finished, invoke
from tests.g05.programs import finishing
from tests.g05.test_sections import AFTER, BEFORE, section

SPECIAL: Final = Layout(axis_count=3)
FAST_AXES: Final = tuple(word for axis in "XYZ" for word in ("--axis", f"{axis}:mm:12000:2000:50000"))


def checked(data: bytes, **words: Any) -> Any:
    return check(io.BytesIO(data).read, Asked(**words))


def small() -> bytes:
    """Three axes, a few records whose numbers are easy."""
    travel = np.array([[10, 0, 0], [30, -5, 0], [30, -5, 1], [10, 0, 0]])
    return encode(travel, SPECIAL).tobytes() + SPECIAL.exit_record


def test_what_a_section_does() -> None:
    result = checked(BEFORE + small() * 1 + AFTER, unit_time=UnitTime.MS_2)
    assert result.sound
    (found,) = result.sections
    assert (found.line, found.offset, found.records, found.seconds) == (3, len(BEFORE), 4, 0.008)
    assert (found.layout, found.required_baud) == (SPECIAL, 38500)
    x, y, z = found.axes
    assert (x.travel, x.lowest, x.highest) == (0.08, 0.01, 0.08) or (x.lowest, x.highest) == (0.0, 0.08)
    assert (y.travel, y.lowest) == (-0.01, -0.01)
    assert x.velocity == pytest.approx(0.03 / 0.002)
    assert x.acceleration == pytest.approx(0.02 / 0.002**2)
    assert z.jerk == pytest.approx(0.002 / 0.002**3)


def test_every_section_is_found() -> None:
    data = BEFORE + section(SPECIAL, 3000) + b"G01X1.\nN7 G05\n" + section(SPECIAL, 20, seed=3) + AFTER
    result = checked(data)
    assert result.sound
    assert [found.records for found in result.sections] == [3000, 20]
    assert result.sections[1].line == data[: data.index(b"N7 G05")].count(b"\n") + 1


@pytest.mark.parametrize("known", [True, False])
def test_each_wrong_record_is_named(known: bool) -> None:
    data = bytearray(section(SPECIAL, 200))
    for record in (3, 60, 61):
        data[7 * record + 2] ^= 0x10
    result = checked(BEFORE + data + AFTER, layout=SPECIAL if known else None)
    assert result.problem_count == 3
    assert [problem.split(":")[0] for problem in result.sections[0].problems] == ["record 4", "record 61", "record 62"]


def test_a_section_that_is_cut_off() -> None:
    data = section(SPECIAL, 200)
    for end in (200 * 7, 150 * 7 + 3):
        result = checked(BEFORE + data[:end], layout=SPECIAL)
        assert any("without the exit record" in problem for problem in result.sections[0].problems)


def test_the_wrong_number_of_axes_is_clear() -> None:
    result = checked(BEFORE + section(SPECIAL, 100) + AFTER, layout=Layout(axis_count=4))
    assert not result.sound
    assert "check byte" in result.sections[0].problems[0] or "bits 8 and 0" in result.sections[0].problems[0]


@pytest.mark.parametrize(
    ("before", "data", "words", "what"),
    [
        (b"%\nG41D1\nG05\n", small(), {}, "SR891: cutter compensation"),
        (BEFORE, small(), {"baud": 19200, "unit_time": UnitTime.MS_2}, "19,200 baud is too slow: 38,500"),
        (
            BEFORE,
            section(Layout(axis_count=3, format=RecordFormat.GENERAL)),
            {"protocol": "fanuc-a"},
            "protocol A carries the special format only",
        ),
        (b"%\nG05\n\r\r", small(), {"layout": SPECIAL}, "two CR behind the EOB"),
        (BEFORE, SPECIAL.exit_record, {"layout": SPECIAL}, "holds no record"),
    ],
)
def test_what_the_control_would_not_take(before: bytes, data: bytes, words: dict[str, Any], what: str) -> None:
    result = checked(before + data + AFTER, **words)
    assert not result.sound
    assert any(what in problem for problem in result.sections[0].problems), result.sections[0].problems


def test_end_codes_inside_the_records_are_counted() -> None:
    result = checked(BEFORE + section(Layout(axis_count=3, format=RecordFormat.GENERAL), 400) + AFTER)
    assert set(result.sections[0].end_codes) == {"0Dh", "8Dh", "03h"}
    assert not checked(BEFORE + section(SPECIAL, 400) + AFTER).sections[0].end_codes


def test_an_auxiliary_function_of_zero_at_rest_is_not_stated() -> None:
    layout = Layout(axis_count=1, auxiliary=AuxiliaryUse.USED)
    moving = encode(np.array([[1]]), layout, np.array([1 << 31 | 8])).tobytes()
    still = bytes.fromhex("00 00 80 00 00 00 80"), bytes.fromhex("00 00 00 00 00 0A 0A")
    result = checked(BEFORE + moving + b"".join(still) + moving + layout.exit_record + AFTER, layout=layout)
    assert result.sections[0].auxiliary_count == 3
    assert ["is not stated" in problem for problem in result.sections[0].problems] == [True, True]
    for record in still:
        with pytest.raises(ProgramError, match="no travel and no auxiliary function"):
            decode(record, layout)


def test_motion_for_a_control_that_wants_auxiliary_functions(program: Path, tmp_path: Path) -> None:
    """No. 7609#3 = 1: four bytes in every record, here none significant."""
    made, arrays = tmp_path / "made.g05", tmp_path / "out.npz"
    done = run("encode", program, made, *FAST_AXES, "--aux", "--unit-time", 2)
    assert done.status == 0, done.stderr
    assert run("check", made, *FAST_AXES, "--aux", "--unit-time", 2).status == 0
    assert run("decode", made, arrays, *FAST_AXES, "--aux").status == 0
    with np.load(arrays) as archive:
        assert not archive["auxiliary_1"].any()
        assert archive["travel_1"].any(axis=1).all()


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.binary(max_size=300), st.booleans(), st.sampled_from([None, SPECIAL, Layout(axis_count=24)]))
def test_whatever_follows_g05_there_is_an_answer(data: bytes, cut: bool, layout: Layout | None) -> None:
    program = BEFORE + data + (b"" if cut else AFTER)
    try:
        sections = checked(program, layout=layout).section_count
    except ProgramError as error:
        sections = int(str(error).startswith("line 3: "))
    assert sections


def test_memory_is_bounded_whatever_the_size() -> None:
    travel = np.random.default_rng(1).integers(-8000, 8000, (600_000, 3))
    data = BEFORE + encode(travel, SPECIAL).tobytes() + SPECIAL.exit_record + AFTER
    file = io.BytesIO(data)
    tracemalloc.start()
    try:
        assert check(file.read, Asked(pictured=True)).sound
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 40_000_000, peak


# -- the command line


def run(*words: object) -> Finished:
    return invoke("g05", *words)


@pytest.fixture
def program(tmp_path: Path) -> Path:
    file = tmp_path / "part.nc"
    file.write_text("\n".join(finishing(300)) + "\n")
    return file


def test_encode_check_and_decode(program: Path, tmp_path: Path) -> None:
    made, rows, arrays, drawn = (tmp_path / name for name in ("made.g05", "rows.csv", "rows.npz", "drawn.svg"))
    encoded = run("encode", program, made, *FAST_AXES, "--unit-time", 2, "--baud", 86400, "--json")
    assert encoded.status == 0, encoded.stderr
    fields = encoded.named("encoded")[0]
    assert fields["required_baud"] == 38500
    assert fields["report"]["contour_error"] <= 0.01
    looked = run("check", made, *FAST_AXES, "--unit-time", 2, "--baud", 86400, "--picture", drawn, "--json")
    assert looked.outcome == (0, "complete"), looked.stderr
    assert looked.named("section")[0]["records"] == fields["records"]
    assert drawn.read_text().startswith("<svg") and "Acceleration in mm/s²" in drawn.read_text()  # noqa: PT018
    assert run("decode", made, rows, *FAST_AXES, "--unit-time", 2).status == 0
    table = np.loadtxt(rows, delimiter=",", skiprows=1)
    assert table.shape == (fields["records"], 6)
    start, lines = np.array(fields["start"]), program.read_text().splitlines()
    last = [line for line in lines if line.startswith(("X", "Y", "Z"))][-1]
    end = table[-1, 2:5] + start
    assert f"X{end[0]:.3f}" in last
    assert end[2] == pytest.approx(20.0)
    assert run("decode", made, arrays).status == 0
    with np.load(arrays) as archive:
        assert np.array_equal(np.cumsum(archive["travel_1"], axis=0), np.rint(table[:, 2:5] * 1000))


def test_a_table_goes_in_and_comes_out_again(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    travel = random.integers(-8192, 8192, (20_000, 2))
    travel[(travel == 0).all(axis=1), 0] = 1
    where = np.concatenate([[[0, 0]], np.cumsum(travel, axis=0)]) / 1000
    source, made, out = tmp_path / "in.csv", tmp_path / "made.g05", tmp_path / "out.npz"
    np.savetxt(source, where, fmt="%.3f", delimiter=",", header="X,Y", comments="")
    axes = ("--axis", "X", "--axis", "Y")
    assert run("encode", source, made, "--from", "table", *axes).status == 0
    assert run("decode", made, out, *axes).status == 0
    with np.load(out) as archive:
        assert np.array_equal(archive["travel_1"], travel)


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_a_path_with_feeds(tmp_path: Path, ending: str) -> None:
    points = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 0.0]])
    feed = np.array([0.0, 600.0, 1200.0, 300.0])
    source, made = tmp_path / f"in.{ending}", tmp_path / "made.g05"
    if ending == "csv":
        np.savetxt(source, np.column_stack([feed, points]), fmt="%.3f", delimiter=",", header="f,y,x", comments="")
    else:
        np.savez(source, position=points, feed=feed)
    done = run("encode", source, made, "--axis", "Y", "--axis", "X", "--json")
    assert done.status == 0, done.stderr
    assert done.named("encoded")[0]["report"]["moves"] == 3
    assert max(done.named("encoded")[0]["report"]["velocity"]) == pytest.approx(20.0, rel=0.01)


@pytest.mark.parametrize(
    ("name", "content", "words", "what"),
    [
        ("in.nc", b"G01X1.F100\n", (), ["never says where Y, Z is", "--start"]),
        ("in.nc", b"G01X1.F100\n#5=1\n", ("--start", "X0,Y0,Z0"), ["line 2", "no word"]),
        ("in.nc", b"\x00\xff" * 500, ("--start", "X0,Y0,Z0"), ["line 1"]),
        ("in.nc", b"G01X1.F100\n", ("--start", "X0,Y0"), ["--start X0,Y0", "X, Y, Z"]),
        ("in.nc", b"G01X1.F100\n", ("--start", "X0,Y0,Z0", "--baud", 1200), ["9,625 baud", "1,200"]),
        ("in.nc", b"G01X1.F100\n", ("--start", "X0,Y0,Z0", "--tolerance", "0.001"), ["two increments"]),
        ("in.nc", b"G01X1.F100\n", ("--start", "X0,Y0,Z0,X5"), ["--start X0,Y0,Z0,X5", "each once"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "x"), ["--axis x", "capital letter"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "X:mm:1e400"), ["inf", "below 1e12"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "XY"), ["--axis XY"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "X:furlong"), ["mm, inch, deg"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "X:mm:fast"), ["numbers"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "X", "--axis", "X"), ["twice"]),
        ("in.nc", b"G01X1.F100\n", ("--protocol", "fanuc-a", "--format", "general"), ["special format only"]),
        ("in.nc", b"G01X1.F100\n", ("--axis", "X", "--axis", "Y:inch"), ["in mm and in inch"]),
        ("in.csv", b"", (), ["empty"]),
        ("in.csv", b"X,Y,Z\n1,2,3\n", (), ["F is missing"]),
        ("in.csv", b"X,Y,Z,F\n0,0,0,1\n1,2,x,9\n", (), ["line 3", "4 finite numbers"]),
        ("in.csv", b"X,Y,Z,F\n0,0,0,1\n1,2,3\n", (), ["line 3"]),
        ("in.csv", b"X,Y,Z,F\n0,0,0,1\n1,nan,3,4\n", (), ["line 3"]),
        ("in.csv", b"\xff\xfe\x00\n", (), ["no text"]),
        ("in.csv", b"X,Y,Z,F\n0,0,0,1\n1,2,3,-4\n", (), ["move 1", "speed"]),
        ("in.csv", b"0,0,0\n9,0,0\n", ("--from", "table"), ["record 1, axis 1", "9,000 increments"]),
        ("in.csv", b"0,0,0\n1,0,0\n1,0,0\n", ("--from", "table"), ["record 2", "leave it out"]),
        ("in.npz", b"PK\x03\x04 no archive at all", (), ["npz"]),
        ("in.npz", b"nothing", (), ["npz"]),
    ],
)
def test_what_cannot_be_encoded_leaves_nothing(
    tmp_path: Path, name: str, content: bytes, words: tuple[object, ...], what: list[str]
) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    done = run("encode", file, tmp_path / "out.g05", *words)
    assert done.status == 2, done.stderr
    assert all(part in done.stderr for part in what), done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == [name]


@pytest.mark.parametrize(
    ("content", "status", "what"),
    [
        (b"", 1, "there is no G05 section"),
        (b"%\nM30\n%", 1, "there is no G05 section"),
        (BEFORE + np.random.default_rng(1).bytes(5000), 2, "no binary input operation"),
        (BEFORE + section(SPECIAL, 100)[:-3], 1, "without the exit record"),
        (BEFORE + section(SPECIAL, 100) + AFTER, 0, "sound: 1 sections"),
    ],
)
def test_the_exit_status_of_check(tmp_path: Path, content: bytes, status: int, what: str) -> None:
    file = tmp_path / "in.nc"
    file.write_bytes(content)
    done = run("check", file)
    assert (done.status, what in done.stderr) == (status, True), done.stderr


def test_decode_refuses_what_is_not_sound(tmp_path: Path) -> None:
    file = tmp_path / "in.nc"
    for content, what in (
        (b"M30\n", "no G05 section"),
        (BEFORE + section(SPECIAL, 100)[:-3], "no exit record"),
        (BEFORE + np.random.default_rng(1).bytes(5000), "no binary input operation"),
    ):
        file.write_bytes(content)
        for out in ("out.csv", "out.npz"):
            done = run("decode", file, tmp_path / out)
            assert (done.status, what in done.stderr) == (2, True), done.stderr
    assert run("decode", file, tmp_path / "out.txt").status == 2
    assert [path.name for path in tmp_path.iterdir()] == ["in.nc"]


def test_what_exists_is_kept_without_force(program: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.g05"
    out.write_bytes(b"mine")
    assert run("encode", program, out).status == 2
    assert out.read_bytes() == b"mine"
    assert run("encode", program, out, "--force").status == 0
    assert out.read_bytes().startswith(b"%\nO2000")
    assert run("check", tmp_path / "none.nc").status == 2


def test_an_empty_array_is_no_table(tmp_path: Path) -> None:
    source = tmp_path / "in.npz"
    np.savez(source, position=np.zeros((0, 3)))
    for kind in ("table", "path"):
        done = run("encode", source, tmp_path / "out.g05", "--from", kind)
        assert (done.status, "expected" in done.stderr) == (2, True), done.stderr


def test_a_file_from_another_desk(tmp_path: Path) -> None:
    """A byte order mark before the names, endings in capitals."""
    points = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    np.savez(tmp_path / "in.npz", position=points, feed=np.array([0.0, 600.0]))
    (tmp_path / "in.npz").rename(tmp_path / "IN.NPZ")
    (tmp_path / "in.CSV").write_bytes(b"\xef\xbb\xbfX,Y,Z,F\r\n0,0,0,0\r\n10,0,0,600\r\n")
    for name in ("IN.NPZ", "in.CSV"):
        done = run("encode", tmp_path / name, tmp_path / f"{name}.g05")
        assert done.status == 0, done.stderr
    assert (tmp_path / "IN.NPZ.g05").read_bytes() == (tmp_path / "in.CSV.g05").read_bytes()


def test_a_program_with_a_number_gets_no_other(tmp_path: Path) -> None:
    source, out = tmp_path / "in.nc", tmp_path / "out.g05"
    for text in ("o1234(x)\nM03\nG01F100X1.\n", "M03\nO1234\nG01F100X1.\n"):
        source.write_text(text)
        assert run("encode", source, out, "--force", "--start", "X0,Y0,Z0").status == 0
        assert out.read_bytes().upper().count(b"O") == 1


def test_a_table_of_sections_has_its_head_behind_an_empty_one(tmp_path: Path) -> None:
    source, out = tmp_path / "in.nc", tmp_path / "out.csv"
    source.write_bytes(BEFORE + SPECIAL.exit_record + b"G05\n" + small() + AFTER)
    done = run("decode", source, out, "--axis", "X", "--axis", "Y", "--axis", "Z")
    assert done.status == 0, done.stderr
    assert out.read_text().splitlines()[:2] == ["section,time_ms,X,Y,Z,auxiliary", "2,8,0.010,0.000,0.000,-1"]


def test_a_slow_section_of_the_general_format_is_seen_as_such() -> None:
    """One record in fifty has an odd byte: with a sound check byte it can be of no other format."""
    travel = np.full((500, 3), 2)
    travel[::50, 0] = 3
    layout = Layout(axis_count=3, format=RecordFormat.GENERAL)
    data = bytearray(encode(travel, layout).tobytes() + layout.exit_record)
    result = checked(BEFORE + data + AFTER)
    assert (result.sound, result.sections[0].layout) == (True, layout)
    special = bytearray(section(SPECIAL, 500))
    for record in range(0, 500, 10):
        special[7 * record] ^= 1
    assert checked(BEFORE + special + AFTER).sections[0].layout == SPECIAL


def test_two_cr_behind_the_eob_are_named_without_knowing_the_axes() -> None:
    with pytest.raises(ProgramError, match="line 3: two CR behind the EOB of G05"):
        checked(BEFORE + b"\r\r" + section(SPECIAL, 100) + AFTER)


def test_decode_writes_nothing_where_the_picture_exists(tmp_path: Path) -> None:
    source, out, drawn = (tmp_path / name for name in ("in.nc", "out.csv", "drawn.svg"))
    source.write_bytes(BEFORE + section(SPECIAL, 100) + AFTER)
    drawn.write_text("mine")
    done = run("decode", source, out, "--picture", drawn)
    assert (done.status, "drawn.svg exists" in done.stderr, out.exists()) == (2, True, False), done.stderr
    assert drawn.read_text() == "mine"
    assert run("decode", source, out, "--picture", drawn, "--force").status == 0
    assert drawn.read_text().startswith("<svg")


def npy(shape: str, version: bytes = b"\x01\x00", kind: str = "<f8") -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY" + version + len(head).to_bytes(2, "little") + head


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (npy("(100000000000, 3)") + bytes(50_000_000), "more than 1 GiB"),
        (npy("(100000, 3)") + bytes(1000), "cannot be read as npz"),
        (npy("(3, 3)", b"\x09\x00") + bytes(72), "version"),
        (npy("(3, 3)", kind="|O") + bytes(72), "holds object"),
        (npy("(3, 3)", kind="<c16") + bytes(144), "holds complex128"),
        (npy("(3, 3)"), "cannot be read"),
        (npy("(-3, 3)") + bytes(72), "npz|shape"),
        (npy("(9,)") + bytes(72), "shape (rows, axes)"),
        (npy("(((((") + bytes(72), "cannot be read"),
        (b"", "cannot be read"),
    ],
)
def test_an_archive_cannot_expand_without_bound(tmp_path: Path, content: bytes, what: str) -> None:
    """50 MB of zeros are 50 KB packed; what an array would take is known before it is unpacked."""
    source = tmp_path / "in.npz"
    with zipfile.ZipFile(source, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("position.npy", content)
    tracemalloc.start()
    try:
        done = run("encode", source, tmp_path / "out.g05", "--from", "table")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert done.status == 2, done.stderr
    assert any(word in done.stderr for word in what.split("|")), done.stderr
    assert peak < 5_000_000, peak


def test_one_csv_is_not_for_sections_with_different_axes(tmp_path: Path) -> None:
    source, out = tmp_path / "in.nc", tmp_path / "out.csv"
    source.write_bytes(BEFORE + section(SPECIAL, 100) + b"G05\n" + section(Layout(axis_count=4), 100) + AFTER)
    done = run("decode", source, out)
    assert (done.status, "section 2 has 4 axes and those before it 3" in done.stderr) == (2, True), done.stderr
    assert not out.exists()
    assert run("decode", source, tmp_path / "out.npz").status == 0
