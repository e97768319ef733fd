"""What these protocols cannot carry is refused before a line is opened, wherever in the program it stands."""

from __future__ import annotations

from io import BytesIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import ProgramError, UsageError
from tapewire.protocols.fanuc_a import refuse_program
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.settings import End


@pytest.mark.parametrize(
    ("settings", "end"),
    [({}, 0x0D), ({"code": "iso"}, 0x8D), ({"end": "etx"}, 0x03), ({"end": "etx", "code": "iso"}, 0x03)],
)
@given(before=st.integers(0, 140_000))
def test_4_1_the_end_code_is_refused_at_its_byte(settings: dict[str, str], end: int, before: int) -> None:
    params = Params.for_protocol_a(settings, End.HOST)
    program = b"X" * before + bytes([end]) + b"\n%"
    with pytest.raises(ProgramError, match=rf"byte {before + 1:,} is {end:02X}h"):
        refuse_program(params, BytesIO(program).read)
    refuse_program(params, BytesIO(program.replace(bytes([end]), b"")).read)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_5_2_a_program_without_eor_must_fill_its_packets(n: int) -> None:
    params = Params.for_expansion_a({"n": str(n)}, End.HOST)
    refuse_program(params, BytesIO(b"X\r" * 128 * n * 3).read)
    refuse_program(params, BytesIO(b"%\n" + b"X" * 100 + b"%").read)
    with pytest.raises(ProgramError, match="no EOR, and 301 bytes do not fill packets"):
        refuse_program(params, BytesIO(b"X" * 301).read)


@pytest.mark.parametrize(("source", "target"), [(0x3B, 0x25), (0x25, 0x20), (0x3B, 0xA5)])
def test_4_2_a_conversion_that_makes_or_takes_an_eor_is_refused(source: int, target: int) -> None:
    with pytest.raises(UsageError, match="EOR"):
        Params.for_protocol_a({"convert_from": str(source), "convert_to": str(target)}, End.HOST)
