"""Programs from one code into another: nothing is lost, or it is refused at the first place."""

from __future__ import annotations

import io
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode, EiaSigns, decode, encode
from tapewire.errors import ProgramError, UsageError
from tapewire.fanuc import conversion
from tapewire.fanuc.conversion import Conversion, EobForm, convert, read_text
from tapewire.fanuc.headers import LONGEST_LIST, HeaderReader

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)
EIA_SAFE = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ+-/.,& ()\t"

codes = st.sampled_from(TEXT_CODES)
blocks = st.lists(st.sampled_from(EIA_SAFE), max_size=12).map(bytes)
texts = st.lists(blocks, min_size=1, max_size=8).map(lambda lines: b"%TITLE\nO0001\n" + b"\n".join(lines) + b"\nM30\n%")
chunk_sizes = st.integers(1, 9)


def converted(
    data: bytes, source: DataCode, target: DataCode, **options: EobForm | int | EiaSigns | None
) -> tuple[bytes, Conversion]:
    out = bytearray()
    done = convert(io.BytesIO(data).read, out.extend, source, target, **options)  # type: ignore[arg-type]
    assert done.byte_count == len(out)
    return bytes(out), done


def text_of(data: bytes, code: DataCode) -> bytes:
    text = bytearray()
    read_text(io.BytesIO(data).read, code, text.extend)
    return bytes(text)


@given(texts, codes, codes, codes, st.integers(0, 9), chunk_sizes)
def test_a_round_trip_gives_the_same_bytes(
    text: bytes, source: DataCode, over: DataCode, back: DataCode, feed: int, size: int
) -> None:
    tape = bytes(feed) + encode(text, source) + bytes(feed)
    with mock.patch.object(conversion, "CHUNK_BYTES", size):
        first, _ = converted(tape, source, over)
        second, _ = converted(first, over, back)
        assert converted(second, back, source)[0] == tape
        assert first == bytes(feed) + encode(text, over) + bytes(feed)


@given(texts, codes, st.sampled_from((DataCode.ISO, DataCode.ASCII)), st.sampled_from(EobForm), chunk_sizes)
def test_every_form_of_eob_is_the_same_text(
    text: bytes, source: DataCode, target: DataCode, eob: EobForm, size: int
) -> None:
    with mock.patch.object(conversion, "CHUNK_BYTES", size):
        made, done = converted(encode(text, source), source, target, eob=eob)
        assert text_of(made, target) == text
        assert converted(made, target, source)[0] == encode(text, source)
    form = {EobForm.LF: b"\n", EobForm.LF_CR_CR: b"\n\r\r", EobForm.CR_LF: b"\r\n"}[eob]
    assert decode(made, target) == text.replace(b"\n", form)
    assert done.blocks == text.count(b"\n")


@given(st.binary(max_size=60), codes, codes, chunk_sizes)
def test_any_bytes_are_converted_without_loss_or_refused(
    data: bytes, source: DataCode, target: DataCode, size: int
) -> None:
    with mock.patch.object(conversion, "CHUNK_BYTES", size):
        try:
            made, _ = converted(data, source, target)
        except ProgramError:
            return
    assert text_of(made, target) == text_of(data, source)


@given(texts, st.sampled_from(b"abc#=*[]:;<>@'\""), st.data())
def test_what_has_no_eia_code_is_refused_with_its_place(text: bytes, sign: int, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(text) - 1))
    spoilt = text[:at] + bytes([sign]) + text[at:]
    line, column = 1 + spoilt.count(b"\n", 0, at), at - spoilt.rfind(b"\n", 0, at)
    with pytest.raises(ProgramError, match=rf"^line {line}, column {column}: .* has no EIA code$") as caught:
        converted(encode(spoilt, DataCode.ISO), DataCode.ISO, DataCode.EIA)
    assert (caught.value.line, caught.value.column) == (line, column)


def test_an_assigned_sign_goes_both_ways() -> None:
    signs = EiaSigns.parse(("#=4F",))
    made, _ = converted(b"%\n#1\n%", DataCode.ASCII, DataCode.EIA, signs=signs)
    assert made == b"\x0b\x80\x4f\x01\x80\x0b"
    assert converted(made, DataCode.EIA, DataCode.ASCII, signs=signs)[0] == b"%\n#1\n%"
    with pytest.raises(ProgramError, match="line 2: byte that is no character"):
        converted(made, DataCode.EIA, DataCode.ASCII)


@pytest.mark.parametrize(
    ("data", "source", "why"),
    [
        (b"", DataCode.ASCII, "the file is empty"),
        (bytes(70), DataCode.ASCII, "the file is empty"),
        (b"%\nX\xb1\n", DataCode.ASCII, "line 2: byte that is no character"),
        (b"%\nX1\n", DataCode.ISO, "line 1: character with wrong parity at byte 0"),
        (b"%\nX\x00Y\n", DataCode.ASCII, "line 2: NUL or DEL inside a block"),
        (b"%\nX\rY\n", DataCode.ASCII, "line 2: CR without LF"),
        (b"%\nX\r", DataCode.ASCII, "line 2: CR without LF"),
        (b"%\nG05\n\x01\x02", DataCode.ASCII, "G05 come binary records"),
    ],
)
def test_what_is_no_text_is_refused_with_its_line(data: bytes, source: DataCode, why: str) -> None:
    for target in (DataCode.ASCII, DataCode.ISO):
        with pytest.raises(ProgramError, match=why.replace("(", r"\(")):
            converted(data, source, target)


def test_a_block_without_end_is_refused() -> None:
    with pytest.raises(ProgramError, match="more than 1 MiB without an EOB"):
        converted(b"%\n" + b"X" * (2 << 20), DataCode.ASCII, DataCode.EIA)


def test_binary_is_no_code_and_eia_has_one_eob() -> None:
    with pytest.raises(UsageError, match="binary is no code"):
        converted(b"%\n%", DataCode.ASCII, DataCode.BINARY)
    with pytest.raises(UsageError, match="EIA has one code for EOB"):
        converted(b"%\n%", DataCode.ASCII, DataCode.EIA, eob=EobForm.LF_CR_CR)


def test_leader_and_trailer_are_kept_or_made() -> None:
    tape = bytes(70000) + b"%\nM30\n%" + bytes(3)
    made, done = converted(tape, DataCode.ASCII, DataCode.ISO)
    assert (done.leader, done.trailer, len(made)) == (70000, 3, len(tape))
    made, done = converted(tape, DataCode.ASCII, DataCode.ISO, feed=70001)
    assert (done.leader, done.trailer, len(made)) == (70001, 70001, 2 * 70001 + 7)
    assert converted(tape, DataCode.ASCII, DataCode.ASCII, feed=0)[0] == b"%\nM30\n%"


# -- program numbers and comments ----------------------------------------------------------------------------


def headers(text: bytes) -> HeaderReader:
    reader = HeaderReader()
    for line in text.splitlines(keepends=True):
        reader.take(line)
    return reader


def test_8_2_programs_between_the_label_and_eor() -> None:
    reader = headers(b"%SHAFT\nO0001(FIRST)\nM02\n:12 (SECOND)\nN1O5\nM02\no3\nM30\n%\nO9999\n")
    assert [str(program) for program in reader.programs] == ["O0001 (FIRST)", "O0012 (SECOND)", "O0003"]
    assert [program.line for program in reader.programs] == [2, 4, 7]
    assert (reader.label, reader.eor_line) == ("SHAFT", 9)


def test_8_2_the_first_block_without_a_label_is_skipped() -> None:
    reader = headers(b"O0001\nO0002\n")
    assert [program.number for program in reader.programs] == [2]
    assert (reader.label, reader.eor_line) == ("O0001", None)


def test_an_eor_in_a_comment_ends_the_list() -> None:
    assert [program.number for program in headers(b"%\nO1(50%)\nO2\n").programs] == [1]


def test_the_list_has_a_bound() -> None:
    assert len(headers(b"\n" + b"O1\n" * (LONGEST_LIST + 5)).programs) == LONGEST_LIST
