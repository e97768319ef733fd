"""What a control punches, read back as text: the same for any cutting, and every spoilt byte is told."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.errors import ProgramError, UsageError
from tapewire.fanuc.punch import Damage, DamageKind, PunchReader
from tapewire.fanuc.tape import prepare

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)
EIA_SAFE = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ+-/.,& ()\t"

blocks = st.lists(st.sampled_from(EIA_SAFE), min_size=1, max_size=12).map(bytes)
programs = st.lists(blocks, min_size=1, max_size=12).map(lambda lines: b"%\n" + b"\n".join(lines) + b"\n%")


def cut(data: bytes, at: list[int]) -> list[bytes]:
    """`data` in pieces, cut at these places (taken modulo its length), some of them empty."""
    places = sorted(place % (len(data) + 1) for place in at)
    return [data[a:b] for a, b in zip([0, *places], [*places, len(data)], strict=True)]


EOB_FORMS = (b"\n", b"\n\r\r", b"\r\n")
feeds = st.integers(0, 5).map(bytes)


def read_back(pieces: list[bytes], code: DataCode) -> tuple[bytes, tuple[Damage, ...]]:
    out = bytearray()
    reader = PunchReader(code, out.extend)
    for piece in pieces:
        reader.feed(piece)
    damage = reader.finish()
    return bytes(out), damage


def whole(data: bytes, code: DataCode) -> tuple[bytes, tuple[Damage, ...]]:
    return read_back([data], code)


@given(programs, st.sampled_from(TEXT_CODES), st.sampled_from(EOB_FORMS), feeds, feeds)
def test_a_punched_program_comes_back_as_it_was(
    program: bytes, code: DataCode, eob: bytes, leader: bytes, trailer: bytes
) -> None:
    text = program if code is DataCode.EIA else program.replace(b"\n", eob)
    assert whole(leader + encode(text, code) + trailer, code) == (program, ())


telling_bytes = st.sampled_from(b"\x00\x7f\xff\n\r\x8dXX%\xa5\x80\x0b\x13\x7c\x0f\x81")
punched = st.lists(telling_bytes, max_size=30).map(bytes) | st.binary(max_size=40)
cuts = st.lists(st.integers(0, 100), max_size=6)


@given(punched, st.sampled_from(TEXT_CODES), cuts)
def test_any_cutting_of_any_bytes_reads_the_same(data: bytes, code: DataCode, places: list[int]) -> None:
    assert read_back(cut(data, places), code) == whole(data, code)
    assert read_back([bytes([byte]) for byte in data], code) == whole(data, code)


@given(punched, st.sampled_from(TEXT_CODES))
def test_what_is_read_without_damage_holds_nothing_but_text(data: bytes, code: DataCode) -> None:
    text, damage = whole(data, code)
    if not damage:
        assert set(text) <= {*range(0x20, 0x7F), ord("\n"), ord("\t")}


@given(programs, st.sampled_from((DataCode.ISO, DataCode.EIA)), st.data())
def test_one_flipped_bit_is_damage_at_its_place(program: bytes, code: DataCode, data: st.DataObject) -> None:
    tape_bytes = bytearray(encode(program, code))
    offset = data.draw(st.integers(0, len(tape_bytes) - 1))
    tape_bytes[offset] ^= 1 << data.draw(st.integers(0, 7))
    text, damage = whole(bytes(tape_bytes), code)
    if tape_bytes[offset] == 0 and code is DataCode.EIA:
        inside = offset > 0 and program[offset - 1] != ord("\n")
        blank = Damage(kind=DamageKind.FEED_IN_BLOCK, first_offset=offset, count=1)
        assert damage == ((blank,) if inside else ())
    else:
        assert Damage(kind=DamageKind.PARITY, first_offset=offset, count=1) in damage
        assert len(text) in {len(program), len(program) - 1}  # a bit can turn a character into CR or feed


def test_spoilt_characters_are_kept_and_counted_from_the_first() -> None:
    spoilt = b"\xa5\n\xb0\xb0\x93\n\xa5"
    assert whole(spoilt, DataCode.ISO) == (
        b"%\n00\x13\n%",
        (
            Damage(kind=DamageKind.PARITY, first_offset=2, count=2),
            Damage(kind=DamageKind.NO_CODE, first_offset=4, count=1),
        ),
    )
    assert str(whole(spoilt, DataCode.ISO)[1][0]) == "character with wrong parity at byte 2, 2 times"
    assert str(whole(spoilt, DataCode.ISO)[1][1]) == "byte that is no character of the code at byte 4"


def test_an_eia_byte_without_meaning_becomes_sub_which_no_program_may_hold() -> None:
    text, damage = whole(b"\x0b\x80\x67\x7c\x01\x80\x0b", DataCode.EIA)
    assert text == b"%\nG\x1a1\n%"
    assert damage == (Damage(kind=DamageKind.NO_CODE, first_offset=3, count=1),)
    with pytest.raises(ProgramError, match=r"line 2, column 2: SUB"):
        prepare(io.BytesIO(text).read, lambda data: None, DataCode.ASCII)


@pytest.mark.parametrize(
    ("data", "text", "first_offset", "count"),
    [
        (b"G1\rX1\n", b"G1\rX1\n", 2, 1),
        (b"G1\r\r\n", b"G1\r\n", 2, 1),
        (b"G1\n\r\r\rX1\n", b"G1\n\rX1\n", 5, 1),
        (b"G1\r\rX1\r", b"G1\r\rX1\r", 2, 3),
    ],
)
def test_a_cr_that_belongs_to_no_eob_is_kept_and_is_damage(
    data: bytes, text: bytes, first_offset: int, count: int
) -> None:
    assert whole(data, DataCode.ASCII) == (
        text,
        (Damage(kind=DamageKind.LONE_CR, first_offset=first_offset, count=count),),
    )


def test_feed_between_blocks_is_left_out_and_inside_a_block_it_is_damage() -> None:
    assert whole(b"%\n\r\r\x00\x00\x7fO1\n\x00%\x00\x00", DataCode.ASCII) == (b"%\nO1\n%", ())
    assert whole(b"%\nO\x00\x001\x00\n%", DataCode.ASCII) == (
        b"%\nO1\n%",
        (Damage(kind=DamageKind.FEED_IN_BLOCK, first_offset=3, count=3),),
    )


@pytest.mark.parametrize("code", [DataCode.ASCII, DataCode.ISO])
def test_the_wrong_code_shows_as_damage(code: DataCode) -> None:
    other = DataCode.ISO if code is DataCode.ASCII else DataCode.ASCII
    _, damage = whole(encode(b"%\nO1234 M30\n%", other), code)
    assert damage[0].first_offset == 0


def test_a_binary_punch_out_is_not_read_as_text() -> None:
    with pytest.raises(UsageError, match="--raw"):
        PunchReader(DataCode.BINARY, lambda data: None)
