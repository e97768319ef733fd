"""The words of protocol B (B-63322EN-1 6.2, 6.3, chapter 7) and its parameters."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import TABLES, DataCode
from tapewire.errors import UsageError
from tapewire.protocols.fanuc_b.messages import (
    EXPANSION_B,
    PROTOCOL_B,
    CodeSystem,
    ControlCode,
    Params,
    Words,
    code_of,
    encode,
)
from tapewire.protocols.settings import End

TABLE_6_2 = {
    ControlCode.DC1: (0x11, 0x11),
    ControlCode.DC3: (0x93, 0x13),
    ControlCode.DC2: (0x12, 0x12),
    ControlCode.DC4: (0x14, 0x14),
    ControlCode.NAK: (0x95, 0x15),
    ControlCode.SYN: (0x96, 0x16),
}
"""Code: with 5000#2 = 0 (ISO), with 5000#2 = 1 (ASCII)."""


@pytest.mark.parametrize("code", ControlCode)
def test_6_2_both_forms_of_every_code(code: ControlCode) -> None:
    iso, ascii_form = TABLE_6_2[code]
    assert encode(code, CodeSystem.ISO) == bytes([iso])
    assert encode(code, CodeSystem.ASCII) == bytes([ascii_form])
    assert code_of(iso) is code_of(ascii_form) is code


@given(st.integers(0, 255))
def test_6_2_nothing_else_is_a_code(byte: int) -> None:
    assert (code_of(byte) is not None) == any(byte in forms for forms in TABLE_6_2.values())


def test_6_2_the_iso_form_is_the_ascii_form_with_even_parity() -> None:
    for iso, ascii_form in TABLE_6_2.values():
        assert iso & 0x7F == ascii_form
        assert iso.bit_count() % 2 == 0


def test_6_2_no_iso_control_code_is_an_eia_character_but_three_ascii_ones_are() -> None:
    eia = TABLES[DataCode.EIA].codes
    assert not [code for code, (iso, _) in TABLE_6_2.items() if iso in eia]
    assert {code for code, (_, form) in TABLE_6_2.items() if form in eia} == {
        ControlCode.DC3,
        ControlCode.NAK,
        ControlCode.SYN,
    }


def test_6_3_and_chapter_7_limits() -> None:
    assert (PROTOCOL_B.stop_at_free, PROTOCOL_B.start_at_free, PROTOCOL_B.overrun) == (512, 4096, 511)
    assert (EXPANSION_B.stop_at_free, EXPANSION_B.start_at_free, EXPANSION_B.overrun) == (2560, 4096, 1280)


def test_the_buffer_cannot_have_filled_before_so_many_characters() -> None:
    assert (PROTOCOL_B.first_stop, PROTOCOL_B.next_stop) == (7680, 3584)
    assert (EXPANSION_B.first_stop, EXPANSION_B.next_stop) == (5632, 1536)


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        ({"posting": "on"}, ControlCode.DC1),
        ({"posting": "off"}, ControlCode.DC2),
        ({"posting": "off", "resume": "dc1"}, ControlCode.DC1),
        ({"posting": "on", "resume": "dc2"}, ControlCode.DC2),
    ],
)
def test_resume_code_of_a_paused_punch_out(settings: dict[str, str], code: ControlCode) -> None:
    """6.1.1 2) (3) (b) says DC2, 6.1.2 (4) DC1: auto follows the clause of the posting in force."""
    assert Params.for_protocol_b(settings, End.HOST).resume_code is code


def test_6_1_2_note_a_pause_by_cs_is_refused_with_posting() -> None:
    with pytest.raises(UsageError, match="pause=cs: with posting on"):
        Params.for_protocol_b({"pause": "cs"}, End.HOST)
    assert Params.for_protocol_b({"pause": "cs", "posting": "off"}, End.HOST).pause == "cs"


def test_a_setting_of_the_other_end_is_refused() -> None:
    with pytest.raises(UsageError, match="closing_time is a setting of the host, not of the control"):
        Params.for_protocol_b({"closing_time": "1"}, End.CONTROL)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "1e99", "soon", ""])
def test_a_number_out_of_its_range_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"closing_time=.*a number is expected, 0.1 to 86400.0 s"):
        Params.for_protocol_b({"closing_time": text}, End.HOST)


@given(data=st.binary(max_size=80), cuts=st.lists(st.integers(0, 80), max_size=6), code=st.sampled_from(DataCode))
def test_words_lose_nothing_and_do_not_depend_on_the_cutting(data: bytes, cuts: list[int], code: DataCode) -> None:
    whole, parts = Words(code), Words(code)
    places = sorted({min(cut, len(data)) for cut in [0, *cuts, len(data)]})
    pieces = [data[start:end] for start, end in itertools.pairwise(places)]
    assert flat(whole.control(data)) == [word for piece in pieces for word in flat(parts.control(piece))]
    assert len(flat(whole.control(data))) == len(data)


def flat(words: list[str | bytes]) -> list[str | int]:
    return [part for word in words for part in ([word] if isinstance(word, str) else list(word))]


def test_6_2_in_an_eia_punch_out_the_digits_3_5_and_6_are_no_codes() -> None:
    assert Words(DataCode.EIA).control(b"\x12\x13\x15\x16\x14\x16") == ["DC2", b"\x13\x15\x16", "DC4", "SYN"]
    assert Words(DataCode.EIA).control(b"\x12\x13\x93") == ["DC2", b"\x13", "DC3"], "ISO: no EIA character"
    assert Words(DataCode.BINARY).control(b"\x12\x13\x93\x14") == ["DC2", b"\x13\x93", "DC4"]
    assert Words(DataCode.ASCII).control(b"\x12AB\x16") == ["DC2", b"AB", "SYN"]
