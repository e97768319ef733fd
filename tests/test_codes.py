"""The three codes: every table derived a second time, and what happens outside it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire import codes
from tapewire.codes import EOB_CODES, EOR_CODES, TABLES, DataCode, decode, encode, first_outside, name_of
from tapewire.errors import UsageError

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)


def ones(byte: int) -> int:
    return f"{byte:b}".count("1")


def eia_by_channels(character: str) -> int:
    """RS-244 by its design: a zone in channels 6 and 7, a digit in 1 to 4, and 5 makes the count odd."""
    if character == "0":
        return 0x20
    for zone, letters, first_digit in (
        (0x00, "123456789", 1),
        (0x60, "ABCDEFGHI", 1),
        (0x40, "JKLMNOPQR", 1),
        (0x20, "STUVWXYZ", 2),
    ):
        if character in letters:
            bare = zone + letters.index(character) + first_digit
            return bare if ones(bare) % 2 else bare + 0x10
    raise AssertionError(character)


def test_eia_letters_and_digits_follow_the_zones() -> None:
    for character in "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ":
        assert encode(character.encode(), DataCode.EIA) == bytes([eia_by_channels(character)])


def test_eia_signs() -> None:
    assert encode(b"+-/.,& ()%\n\t", DataCode.EIA).hex(" ") == "70 40 31 6b 3b 0e 10 1a 4a 0b 80 3e"


def test_eia_codes_are_odd_and_distinct_and_only_blank_tape_has_no_hole() -> None:
    table = TABLES[DataCode.EIA]
    assert len(table.codes) == 51  # 36 letters and digits, 11 signs with EOR, EOB, TAB, BS, DEL, and blank
    assert len(set(table.codes)) == len(set(table.characters)) == len(table.codes)
    assert [code for code in table.codes if ones(code) % 2 == 0] == [0]


def test_eia_has_no_code_that_ends_a_message_of_protocol_a() -> None:
    assert not {0x0D, 0x8D, 0x03} & set(TABLES[DataCode.EIA].codes)


@given(st.integers(0, 0x7F))
def test_iso_is_ascii_with_an_even_count_of_ones(byte: int) -> None:
    (code,) = encode(bytes([byte]), DataCode.ISO)
    assert code & 0x7F == byte
    assert ones(code) % 2 == 0


def test_iso_codes_of_the_manual() -> None:
    assert encode(b"\r\n% \x03\x11\x12\x13\x14\x15\x16\x18", DataCode.ISO).hex(" ") == (
        "8d 0a a5 a0 03 11 12 93 14 95 96 18"
    )
    assert encode(b"0123456789ABCDEF", DataCode.ISO).hex(" ").upper() == (
        "30 B1 B2 33 B4 35 36 B7 B8 39 41 42 C3 44 C5 C6"
    )


def test_control_codes_are_what_they_are_called() -> None:
    for name in (
        "NUL",
        "ETX",
        "TAB",
        "LF",
        "CR",
        "DC1",
        "DC2",
        "DC3",
        "DC4",
        "NAK",
        "SYN",
        "CAN",
        "SUB",
        "DEL",
    ):
        assert name_of(getattr(codes, name)).startswith(f"{name} (")


@given(st.sampled_from(DataCode), st.binary())
def test_any_text_is_encoded_and_comes_back_or_is_refused_at_its_first_foreign_character(
    code: DataCode, text: bytes
) -> None:
    foreign = [offset for offset, byte in enumerate(text) if byte not in TABLES[code].characters]
    if foreign:
        with pytest.raises(UsageError, match=rf"at offset {foreign[0]} has no {code.upper()} code"):
            encode(text, code)
    else:
        assert decode(encode(text, code), code) == text


@given(st.sampled_from(DataCode), st.binary())
def test_any_bytes_are_decoded_and_come_back_or_are_refused_at_the_first_that_is_no_code(
    code: DataCode, data: bytes
) -> None:
    foreign = [offset for offset, byte in enumerate(data) if byte not in TABLES[code].codes]
    if foreign:
        with pytest.raises(UsageError, match=rf"{data[foreign[0]]:02X}h at offset {foreign[0]} is not"):
            decode(data, code)
    else:
        assert encode(decode(data, code), code) == data


def test_iso_refuses_exactly_the_odd_bytes() -> None:
    refused = [byte for byte in range(256) if byte not in TABLES[DataCode.ISO].codes]
    assert refused == [byte for byte in range(256) if ones(byte) % 2]


def test_binary_is_left_as_it_is() -> None:
    everything = bytes(range(256))
    assert encode(everything, DataCode.BINARY) == decode(everything, DataCode.BINARY) == everything


def test_the_error_names_the_character() -> None:
    with pytest.raises(UsageError, match=r"^'#' \(23h\) at offset 2 has no EIA code$"):
        encode(b"X1#", DataCode.EIA)
    with pytest.raises(UsageError, match=r"^byte C3h \(not ASCII\) at offset 0 has no ISO code$"):
        encode("Ä".encode(), DataCode.ISO)


@pytest.mark.parametrize("code", TEXT_CODES)
def test_eob_and_eor_are_the_codes_of_lf_and_percent(code: DataCode) -> None:
    assert EOB_CODES[code] == encode(b"\n", code)
    assert EOR_CODES[code][:1] == encode(b"%", code)


@given(st.binary(), st.binary())
def test_first_outside_is_the_first(data: bytes, allowed: bytes) -> None:
    offsets = [offset for offset, byte in enumerate(data) if byte not in allowed]
    assert first_outside(data, allowed) == (offsets[0] if offsets else None)
