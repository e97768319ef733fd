"""Text on its way to a control, over the whole input space and against second opinions written for it.

The inputs are built of the pieces that matter (%, line ends, G05, stray codes), so that short ones meet
every rule.
"""

from __future__ import annotations

import io
import tracemalloc
from collections.abc import Callable, Iterator
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tapewire.codes import EOB_CODES, EOR_CODES, DataCode, decode
from tapewire.errors import ProgramError, UsageError
from tapewire.fanuc import tape
from tapewire.fanuc.tape import (
    Preparation,
    RawInspection,
    TapeScanner,
    inspect_raw,
    prepare,
)

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)
EIA_SAFE = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ+-/.,& ()\t"

fragments = st.sampled_from(
    b"% \n \n \r\n \r G05 g_5 N10 / ( ) _ \t X1. M30 \0 \x13 \x1a \x7f \xc3 # 0 5".split(b" ")
).map(lambda fragment: fragment.replace(b"_", b" "))
files = st.lists(fragments, max_size=24).map(b"".join) | st.binary(max_size=40)
blocks = st.lists(st.sampled_from(EIA_SAFE), min_size=1, max_size=12).map(bytes)
programs = st.lists(blocks, min_size=1, max_size=12).map(lambda lines: b"%\n" + b"\n".join(lines) + b"\n%")
chunk_sizes = st.integers(1, 9)


def prepared(file: bytes, code: DataCode = DataCode.ASCII) -> tuple[bytes, Preparation]:
    out = bytearray()
    preparation = prepare(io.BytesIO(file).read, out.extend, code)
    assert preparation.byte_count == len(out)
    return bytes(out), preparation


def refusal(file: bytes, code: DataCode = DataCode.ASCII) -> ProgramError:
    with pytest.raises(ProgramError) as caught:
        prepared(file, code)
    return caught.value


def cut(data: bytes, at: list[int]) -> list[bytes]:
    """`data` in pieces, cut at these places (taken modulo its length), some of them empty."""
    places = sorted(place % (len(data) + 1) for place in at)
    return [data[a:b] for a, b in zip([0, *places], [*places, len(data)], strict=True)]


# -- prepare: a second opinion, byte by byte ---------------------------------------------------------------


def is_g05_alone(line: bytes) -> bool:
    """Without comments and blanks the block is G05 and nothing but a block skip and a number before it."""
    word = ""
    rest = line.decode("latin-1").removesuffix("\r")
    while rest:
        comment_end = rest.find(")")
        if rest[0] == "(" and comment_end > 0 and "(" not in rest[1:comment_end]:
            rest = rest[comment_end + 1 :]
        else:
            word += rest[0] if rest[0] not in " \t" else ""
            rest = rest[1:]
    word = word.upper()
    if word.startswith("/"):
        word = word[1:]
        word = word[1:] if word[:1] in set("123456789") else word
    if word.startswith("N") and word[1:2].isdigit():
        word = word[1:].lstrip("0123456789")
    return word.startswith("G") and word.endswith("5") and set(word[1:-1]) <= {"0"} and len(word) > 1


def spoilt(rest: bytes, sendable: bytes) -> bool:
    """What must not be sent stands in the comment of the block itself."""
    return any(byte not in sendable for byte in rest.removesuffix(b"\r"))


def first_fault(file: bytes, sendable: bytes) -> tuple[int, int] | None:
    """Line and column of the first thing that must not be sent, walking through the file once."""
    line, column, label_skip = 1, 1, file.startswith(b"%")
    g05_at: int | None = None
    for offset, byte in enumerate(file):
        if byte == ord("%") and (offset or not label_skip):
            more_follows = any(after not in b" \t\r\n\x00\x1a" for after in file[offset + 1 :])
            return (line, column) if more_follows or label_skip else None
        if column == 1 and not label_skip:
            block = file[offset:].split(b"\n")[0].split(b"%")[0]
            g05_at = offset + block.upper().rindex(b"G") if is_g05_alone(block) else None
        if offset == g05_at and not spoilt(block[column:], sendable):
            return line, column
        if byte == ord("\r") and file[offset + 1 : offset + 2] != b"\n":
            return line, column
        if byte != ord("\r") and byte not in sendable:
            return line, column
        if byte == ord("\n"):
            line, column, label_skip = line + 1, 1, False
        else:
            column += 1
    return None


def lines_to_execute(file: bytes) -> list[bytes]:
    body = file[1:].split(b"%")[0] if file.startswith(b"%") else file.split(b"%")[0]
    lines = body.replace(b"\r", b"").split(b"\n")
    return [line for line in (lines[1:] if file.startswith(b"%") else lines) if line.strip()]


def expected_output(file: bytes) -> bytes:
    label = b"%" if file.startswith(b"%") else b""
    body, found_eor, _ = file[len(label) :].partition(b"%")
    body = body.replace(b"\r\n", b"\n")
    if not label and not body.startswith(b"\n"):
        label = b"%\n"
    if not found_eor and not (label + body).endswith(b"\n"):
        body += b"\n"
    return label + body + b"%"


@settings(max_examples=600)
@given(files, st.sampled_from(TEXT_CODES), chunk_sizes)
@example(b"%\n(G05)\nM30\n%", DataCode.ASCII, 3)
@example(b"O1\n(A\x00)G05\n", DataCode.ASCII, 3)
@example(b"\nG05%", DataCode.ASCII, 9)
@example(b"\rG05", DataCode.ISO, 1)
def test_any_file_is_prepared_or_refused_as_the_second_opinion_says(
    file: bytes, code: DataCode, chunk_size: int
) -> None:
    sendable = bytes(range(0x20, 0x7F)) + b"\n\t" if code is not DataCode.EIA else EIA_SAFE + b"%\n"
    with mock.patch.object(tape, "CHUNK_BYTES", chunk_size):
        if (fault := first_fault(file, sendable)) is not None:
            error = refusal(file, code)
            assert (error.line, error.column) == fault
            assert str(error).startswith(f"line {fault[0]}, column {fault[1]}: ")
        elif not lines_to_execute(file):
            assert refusal(file, code).line is None
        else:
            out, preparation = prepared(file, code)
            assert decode(out, code) == expected_output(file)
            assert preparation.block_count == len(lines_to_execute(file))
            assert (preparation.changes == ()) == (decode(out, code) == file)


@given(files | programs, st.sampled_from(TEXT_CODES))
def test_what_is_sent_skips_no_block_and_ends_at_its_only_eor(file: bytes, code: DataCode) -> None:
    try:
        out, _ = prepared(file, code)
    except ProgramError:
        return
    assert out[0] in EOR_CODES[code] + EOB_CODES[code]
    scanner = TapeScanner(code)
    assert [scanner.feed(bytes([byte])) for byte in out] == [None] * (len(out) - 1) + [1]


@given(files | programs)
def test_prepared_text_is_prepared_already(file: bytes) -> None:
    try:
        out, preparation = prepared(file)
    except ProgramError:
        return
    again, nothing_done = prepared(out)
    assert again == out
    assert nothing_done.changes == ()
    assert nothing_done.block_count == preparation.block_count


@given(files.filter(lambda file: b"\r" not in file))
def test_line_ends_of_unix_and_windows_lead_to_the_same(file: bytes) -> None:
    windows = file.replace(b"\n", b"\r\n")
    try:
        out, preparation = prepared(file)
    except ProgramError as caught:
        error = caught
    else:
        assert prepared(windows)[0] == out
        assert prepared(windows)[1].block_count == preparation.block_count
        return
    other = refusal(windows)
    assert (other.line, other.column, str(other)) == (error.line, error.column, str(error))


def test_every_change_is_stated() -> None:
    out, preparation = prepared(b"O0001\r\nG91\r\nM30")
    assert out == b"%\nO0001\nG91\nM30\n%"
    assert preparation == Preparation(
        byte_count=17,
        block_count=3,
        changes=(
            "% and LF put before the first block, or the control would skip it",
            "CR dropped before LF in 2 blocks",
            "LF put after the last block, which had no EOB",
            "EOR (%) added at the end",
        ),
    )
    _, preparation = prepared(b"%\nM30\r\n%\r\n\x1a")
    assert preparation.changes == (
        "CR dropped before LF in 1 block",
        "3 bytes after the last % dropped (line ends, blanks, NUL or 1Ah)",
    )


def test_thousands_are_counted_as_people_read_them() -> None:
    _, preparation = prepared(b"%\r\n" + b"G1\r\n" * 1233 + b"%")
    assert preparation.changes == ("CR dropped before LF in 1,234 blocks",)


def test_a_program_that_ends_in_percent_right_after_text_is_left_so() -> None:
    assert prepared(b"%\nM30%") == (b"%\nM30%", Preparation(byte_count=6, block_count=1, changes=()))


def test_the_title_is_no_block() -> None:
    assert prepared(b"% PART 7\n\n \nM30\n%")[1].block_count == 1


def test_iso_and_eia_are_sent_in_their_codes() -> None:
    assert prepared(b"G0\n", DataCode.ISO)[0].hex(" ") == "a5 0a 47 30 0a a5"
    assert prepared(b"(G0)\n", DataCode.EIA)[0].hex(" ") == "0b 80 1a 67 20 4a 80 0b"


@pytest.mark.parametrize(
    ("file", "where", "why"),
    [
        (b"%\nM30\n%\nM30\n%", (3, 1), "% ends the program for the control"),
        (b"%\n(100% FEED)\nM30\n%", (2, 5), "in a comment too"),
        (b"%TITLE%\nM30\n%", (1, 7), "a second % before the first EOB"),
        (b"%\nM30\n%\n%\n", (3, 1), "% ends the program for the control"),
        (b"O1\rG91\rM30\r", (1, 3), "CR without LF"),
        (b"%\nM30\n\r\r%", (3, 1), "CR without LF"),
        (b"%\nG1\x00X\n%", (2, 3), "NUL (00h) is no character of an NC program: remove it, or send"),
        (b"%\nG1\n\x13%", (3, 1), "DC3 (13h) is no character"),
        (b"%\n(\xc3\x84)\n%", (2, 2), "byte C3h (not ASCII) is no character"),
        (b"\xef\xbb\xbf%\nM30\n%", (1, 1), "byte EFh (not ASCII) is no character"),
        (b"%\nM30\n\x1a", (3, 1), "SUB (1Ah) is no character"),
        (b"%\nO1\nG05\n\x01\x02\x03", (3, 1), "the control reads binary, and"),
        (b"%\nO1\n N10 G 5 (DATA)\r\nM30\n%", (3, 6), "the control reads binary, and"),
        (b"%\n/2N10G05\n%", (2, 6), "the control reads binary, and"),
    ],
)
def test_a_refusal_says_where_what_and_what_to_do(file: bytes, where: tuple[int, int], why: str) -> None:
    error = refusal(file)
    assert (error.line, error.column) == where
    assert why in str(error)


@pytest.mark.parametrize("character", [":", "#", "*", "=", "[", "a", ";"])
def test_what_eia_lacks_is_refused_there_and_sent_in_ascii(character: str) -> None:
    file = f"%\nG1\nX{character}1\n%".encode()
    error = refusal(file, DataCode.EIA)
    assert (error.line, error.column) == (3, 2)
    assert f"'{character}'" in str(error)
    assert "has no EIA code: replace it, or send the program in ISO or ASCII" in str(error)
    assert prepared(file)[0] == file


@pytest.mark.parametrize(
    "file", [b"G05P10000\n", b"G05.1Q1\n", b"G5.1 Q1\n", b"G15\n", b"X1G05\n", b"(G05\n", b"G50\n"]
)
def test_other_blocks_with_g05_in_them_are_text(file: bytes) -> None:
    assert prepared(file)[0] == b"%\n" + file + b"%"


def test_g05_in_the_title_is_skipped_by_the_control() -> None:
    assert prepared(b"%G05\nM30\n%")[0] == b"%G05\nM30\n%"


@pytest.mark.parametrize("file", [b"", b"%", b"%\n%", b"\n\n", b" \t\n", b"%\r\n\r\n%\r\n\x1a", b"%O1 M30"])
def test_a_file_without_a_block_is_refused(file: bytes) -> None:
    error = refusal(file)
    assert (error.line, error.column) == (None, None)
    assert "there is nothing" in str(error)


def test_binary_is_not_prepared() -> None:
    with pytest.raises(UsageError, match="--raw"):
        prepared(b"%\nM30\n%", DataCode.BINARY)


def test_a_file_that_never_ends_a_block_is_refused_at_its_line_and_not_collected() -> None:
    asked = 0

    def read(limit: int) -> bytes:
        nonlocal asked
        asked += limit
        return b"%\nM30\n" + b"X" * (limit - 6) if asked == limit else b"X" * limit

    with pytest.raises(ProgramError, match="more than 1 MiB without an EOB") as caught:
        prepare(read, lambda data: None, DataCode.ASCII)
    assert caught.value.line == 3
    assert asked < tape.MAX_BLOCK_BYTES + 3 * tape.CHUNK_BYTES


def test_a_long_run_of_nul_after_the_program_is_dropped() -> None:
    out, preparation = prepared(b"%\nM30\n%" + bytes(3 << 20))
    assert out == b"%\nM30\n%"
    assert preparation.changes == ("3,145,728 bytes after the last % dropped (line ends, blanks, NUL or 1Ah)",)


def repeated(data: bytes, times: int) -> Callable[[int], bytes]:
    pieces: Iterator[bytes] = iter([data] * times)
    return lambda _limit: next(pieces, b"")


def test_a_large_program_passes_in_constant_memory() -> None:
    block = b"N100 G01 X12.345 Y-67.890 Z1.234 F1200\r\n"
    piece = block * (tape.CHUNK_BYTES // len(block))
    tracemalloc.start()
    try:
        preparation = prepare(repeated(piece, 400), lambda data: None, DataCode.ISO)
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert preparation.block_count == 400 * piece.count(b"\n")
    assert peak_bytes < 2 << 20 < preparation.byte_count


# -- files sent untouched ----------------------------------------------------------------------------------


def inspected(file: bytes, code: DataCode = DataCode.ASCII) -> RawInspection:
    return inspect_raw(io.BytesIO(file).read, code)


@pytest.mark.parametrize(
    ("file", "notes"),
    [
        (b"%\nM30\n%", ()),
        (b"\x00\x00\nM30\n%", ()),
        (b"%\nM30\n", ("no EOR: the control will wait for more",)),
        (b"O1\nM30\n%", ("neither % nor an EOB at the beginning: the control will skip the first block",)),
        (b"%M30%", ("no EOB: the control will skip all of it", "no EOR: the control will wait for more")),
        (
            b"%\nM30\n%\n\n",
            ("EOR at byte 7: unless it lies in a G05 section, the control will ignore the 2 bytes after it",),
        ),
    ],
)
def test_what_the_control_will_make_of_untouched_bytes(file: bytes, notes: tuple[str, ...]) -> None:
    assert inspected(file) == RawInspection(byte_count=len(file), notes=notes)


@given(programs, st.sampled_from(TEXT_CODES), chunk_sizes)
def test_prepared_text_needs_no_note(program: bytes, code: DataCode, chunk_size: int) -> None:
    if first_fault(program, EIA_SAFE + b"%\n") is not None or not lines_to_execute(program):
        return
    out, _ = prepared(program, code)
    with mock.patch.object(tape, "CHUNK_BYTES", chunk_size):
        assert inspected(out, code) == RawInspection(byte_count=len(out), notes=())


def test_of_binary_data_only_the_length_is_known_and_an_empty_file_is_refused() -> None:
    assert inspected(b"\x01\x02%", DataCode.BINARY) == RawInspection(byte_count=3, notes=())
    with pytest.raises(ProgramError, match="the file is empty"):
        inspected(b"", DataCode.BINARY)


# -- the end as the control sees it ------------------------------------------------------------------------


def end_by_8_2(data: bytes, code: DataCode) -> int | None:
    skipping = True
    for offset, byte in enumerate(data):
        if skipping:
            skipping = byte not in EOB_CODES[code]
        elif byte in EOR_CODES[code]:
            return offset + 1
    return None


tapes = st.lists(st.sampled_from(b"%\xa5\x0b\x0a\x80\x8dX0"), max_size=30).map(bytes) | st.binary(max_size=40)


@given(tapes, st.sampled_from(DataCode), st.lists(st.integers(0, 100), max_size=6))
def test_the_end_is_found_where_8_2_puts_it_however_the_data_is_cut(
    data: bytes, code: DataCode, places: list[int]
) -> None:
    scanner, taken = TapeScanner(code), 0
    for piece in cut(data, places):
        index = scanner.feed(piece)
        taken += len(piece) if index is None else index
    end = end_by_8_2(data, code)
    assert taken == (len(data) if end is None else end)
    assert scanner.ended == (end is not None)


def test_binary_never_ends_and_iso_and_ascii_know_both_forms_of_percent() -> None:
    assert TapeScanner(DataCode.BINARY).feed(bytes(range(256)) * 2) is None
    for code in (DataCode.ISO, DataCode.ASCII):
        assert TapeScanner(code).feed(b"%\nM30\n%more") == 7
        assert TapeScanner(code).feed(b"\xa5\n\xa5more") == 3
    assert TapeScanner(DataCode.EIA).feed(b"\x0b\x80%\x0a\xa5\x0bmore") == 6
