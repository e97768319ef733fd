"""TV check (0000#0 and #1), against a second opinion that looks at the whole tape at once."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode, encode
from tapewire.errors import UsageError
from tapewire.fanuc.tv_check import Comments, TvCheck, TvFailure

TEXT_CODES = (DataCode.ISO, DataCode.EIA, DataCode.ASCII)
pieces = st.sampled_from(("%", "\n", "\n", "G1", "X", "(", ")", "AB", "\x00", "\r", "\x7f"))
texts = st.lists(pieces, max_size=20).map("".join)


def failures(data: bytes, code: DataCode = DataCode.ASCII, comments: Comments = Comments.COUNTED) -> list[TvFailure]:
    return TvCheck(code, comments=comments).feed(data)


def odd_blocks(text: str, comments: Comments) -> list[tuple[int, int]]:
    """Number and count of each odd block: the whole text at once, by regular expressions."""
    _, eob, body = text.partition("\n")
    blocks = body.partition("%")[0].split("\n")[:-1] if eob else []
    found = []
    for number, block in enumerate(blocks, 1):
        counted = re.sub(r"[\0\x7f]", "", block)
        if comments is Comments.NOT_COUNTED:
            counted = re.sub(r"\([^)]*(\)|$)", "", counted)
        if (len(counted) + 1) % 2:
            found.append((number, len(counted) + 1))
    return found


@given(texts, st.sampled_from((DataCode.ISO, DataCode.ASCII)), st.sampled_from(Comments))
def test_0000_0_the_odd_blocks_are_those_of_the_second_opinion(text: str, code: DataCode, comments: Comments) -> None:
    told = failures(encode(text.encode(), code), code, comments)
    assert [(failure.block, failure.characters) for failure in told] == odd_blocks(text, comments)


@given(texts, st.sampled_from(Comments), st.integers(1, 5))
def test_it_does_not_depend_on_how_the_tape_is_cut(text: str, comments: Comments, size: int) -> None:
    data, check = text.encode(), TvCheck(DataCode.ASCII, comments=comments)
    told = [failure for at in range(0, len(data), size) for failure in check.feed(data[at : at + size])]
    assert [str(failure) for failure in told] == [str(failure) for failure in failures(data, comments=comments)]


@pytest.mark.parametrize("code", TEXT_CODES)
def test_0000_0_the_block_that_fails_is_named(code: DataCode) -> None:
    (failure,) = failures(encode(b"%\nN10X1\n N20X12\nM30 \n%", code), code)
    assert (failure.block, failure.offset, failure.characters, failure.text) == (3, 16, 5, "M30 ")
    assert str(failure) == "TV check: block 3 at byte 16 has 5 characters, an odd number: M30 "


def test_0000_1_comments_count_or_do_not() -> None:
    data = b"%\n(ABC)X\n%"
    assert [failure.characters for failure in failures(data)] == [7]
    assert failures(data, comments=Comments.NOT_COUNTED) == []


@given(st.integers(2, 30), st.data())
def test_a_character_lost_or_doubled_is_found(length: int, data: st.DataObject) -> None:
    block = b"X" * (length // 2 * 2 - 1)
    tape = b"%\n" + (block + b"\n") * 5 + b"%"
    assert failures(tape) == []
    at = data.draw(st.integers(2, len(tape) - 3).filter(lambda place: tape[place] != ord("\n")))
    assert len(failures(tape[:at] + tape[at + 1 :])) == 1
    assert len(failures(tape[:at] + tape[at : at + 1] + tape[at:])) == 1


def test_label_leader_and_what_follows_eor_are_exempt() -> None:
    assert failures(b"\0\0ODD LABEL\nX1.\n%X\nXX\n") == []


def test_lf_cr_cr_changes_nothing() -> None:
    assert failures(b"%\n\r\rX1.\n\r\rX1\n\r\r%")[0].text == "X1"
    assert failures(b"%\n\r\rX1.\n\r\r%") == []


def test_binary_data_has_no_blocks() -> None:
    with pytest.raises(UsageError, match="has no blocks"):
        TvCheck(DataCode.BINARY)
