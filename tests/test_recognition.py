"""Which code a tape is in, and the EIA signs that controls assign."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import EIA_SIGNS, TABLES, DataCode, EiaSigns, Recogniser, decode, encode, recognise, table_of
from tapewire.errors import UsageError

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)
EIA_SAFE = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ+-/.,& ()\t"

blocks = st.lists(st.sampled_from(EIA_SAFE), min_size=1, max_size=20).map(bytes)
programs = st.lists(blocks, min_size=1, max_size=8).map(lambda lines: b"%\nO1\n" + b"\n".join(lines) + b"\nM30\n%")


@given(programs, st.sampled_from(TEXT_CODES), st.integers(0, 20))
def test_every_program_is_recognised_in_every_code(program: bytes, code: DataCode, feed: int) -> None:
    verdict = recognise(bytes(feed) + encode(program, code) + bytes(feed))
    assert (verdict.code, verdict.foreign) == (code, 0)


@given(programs, st.sampled_from(TEXT_CODES), st.lists(st.integers(0, 500), max_size=5))
def test_it_does_not_depend_on_how_the_tape_is_cut(program: bytes, code: DataCode, at: list[int]) -> None:
    tape, whole, pieces = encode(program, code), Recogniser(), Recogniser()
    whole.feed(tape)
    places = sorted(place % (len(tape) + 1) for place in at)
    for begin, end in zip([0, *places], [*places, len(tape)], strict=True):
        pieces.feed(tape[begin:end])
    assert pieces.verdict == whole.verdict


@given(st.sampled_from((DataCode.ISO, DataCode.EIA)), st.integers(0, 10_000), st.integers(0, 7))
def test_one_damaged_byte_in_a_long_tape_is_damage_and_no_other_code(code: DataCode, at: int, channel: int) -> None:
    tape = bytearray(encode(b"%\n" + b"N100G01X12.5Y-7.25F300\n" * 20 + b"M30\n%", code))
    before = recognise(bytes(tape)).code
    tape[at % len(tape)] ^= 1 << channel
    after = recognise(bytes(tape))
    assert before is after.code is code
    assert after.foreign in (0, 1)
    assert after.foreign == 1 or tape[at % len(tape)] in (0, 0x7F, 0xFF)


@given(st.binary(max_size=200))
def test_what_is_called_a_code_without_damage_can_be_read_in_it(data: bytes) -> None:
    verdict = recognise(data)
    if verdict.code is not None and not verdict.foreign:
        decode(data.translate(None, b"\x00\x7f\xff"), verdict.code)
    assert verdict.why


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "nothing but blank tape"),
        (b"\x00\x7f\xff" * 9, "nothing but blank tape"),
        (bytes(range(256)), "no text in ISO, EIA or ASCII"),
        (b"1248", "no EOB to tell which"),
    ],
)
def test_what_cannot_be_told_is_not_guessed(data: bytes, why: str) -> None:
    verdict = recognise(data)
    assert verdict.code is None
    assert why in verdict.why


def test_text_that_is_the_same_in_iso_and_ascii_is_called_ascii() -> None:
    verdict = recognise(b"S0\n")
    assert (verdict.code, verdict.why) == (DataCode.ASCII, "the same bytes in ISO and in ASCII")


# -- EIA signs -----------------------------------------------------------------------------------------------

free = [
    code
    for code in range(1, 256)
    if code.bit_count() % 2 and code not in TABLES[DataCode.EIA].codes and code not in (0x7A, 0x7C)
]
signs = st.dictionaries(st.sampled_from("#*=[]:;@!$'\""), st.sampled_from(free), min_size=1)


@given(signs)
def test_assigned_signs_are_characters_like_others(assigned: dict[str, int]) -> None:
    if len(set(assigned.values())) < len(assigned):
        with pytest.raises(UsageError, match="this is the EIA code of"):
            EiaSigns(assigned)
        return
    table = table_of(DataCode.EIA, EiaSigns(assigned))
    for sign, code in assigned.items():
        assert sign.encode().translate(table.to_code) == bytes([code])
        assert bytes([code]).translate(table.to_ascii) == sign.encode()
    assert b"(" not in table.characters


def test_words_stand_over_fanucs_parentheses() -> None:
    assert EiaSigns.parse(()) == EIA_SIGNS
    assert EiaSigns.parse(("#=4F", "(=1c")).codes == {"(": 0x1C, ")": 0x4A, "#": 0x4F}


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("#=4C=", "in hexadecimal"),
        ("#", "in hexadecimal"),
        ("", "in hexadecimal"),
        ("#=", "in hexadecimal"),
        ("#=-1", "in hexadecimal"),
        ("#=XY", "in hexadecimal"),
        ("#=03", "an odd number of holes"),
        ("#=00", "an odd number of holes"),
        ("#=61", "the EIA code of 'A'"),
        ("#=7C", "the EIA code of UC"),
        ("#=80", "the EIA code of LF"),
        ("#=1A", "the EIA code of '('"),
        ("A=4F", "one printable sign without a code"),
        ("é=4F", "one printable sign without a code"),
    ],
)
def test_a_code_that_cannot_be_is_refused(word: str, why: str) -> None:
    with pytest.raises(UsageError) as caught:
        EiaSigns.parse((word,))
    assert why in str(caught.value)


def test_iso_and_ascii_know_no_signs() -> None:
    signs = EiaSigns.parse(("#=4F",))
    assert table_of(DataCode.ISO, signs) is TABLES[DataCode.ISO]
    assert table_of(DataCode.ASCII, signs) is TABLES[DataCode.ASCII]
