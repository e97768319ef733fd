"""The picture of the panel, without a terminal, and those in the docs."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from docs.generators.panel import PICTURES, at_work, operated, unplugged
from tapewire.cli.panel import LED_WORDS, state_of
from tapewire.cli.panel_page import ParameterPage
from tapewire.cli.panel_view import SIDE_WIDTH, Mark, Page, PanelState, Row, SoftKey, page_room, picture
from tapewire.fanuc.leds import BoardStatus
from tapewire.fanuc.parameters import CATALOGUE
from tapewire.sim.world import World
from tapewire.transfer.tape_window import TapeWindow

SIZES = [(80, 24), (120, 40)]

anything = st.text(max_size=200)
states = st.builds(
    PanelState,
    title=anything,
    clock=st.just("10:00:00"),
    mode=st.sampled_from(["RMT", "EDIT"]),
    run=st.sampled_from(["****", "STRT", "HOLD", "STOP"]),
    moving=st.booleans(),
    stands=anything,
    blocks=st.lists(anything, max_size=60).map(tuple),
    current=st.none() | st.integers(0, 59),
    program=anything,
    page=st.none()
    | st.builds(
        Page,
        title=anything,
        rows=st.lists(st.builds(Row, text=anything, mark=st.sampled_from(Mark)), max_size=30).map(tuple),
        entry=anything,
    ),
    buffered=st.integers(0, 9000),
    capacity=st.integers(1, 8192),
    held=anything,
    line=st.lists(st.tuples(anything, anything), max_size=20).map(tuple),
    alarms=st.lists(anything, max_size=20).map(tuple),
    messages=st.lists(anything, max_size=50).map(tuple),
    keys=st.just((SoftKey(key="C", label="CYCLE"), SoftKey(key="Q", label="QUIT"))),
)


def drawn(state: PanelState, width: int, height: int) -> list[str]:
    paper = Console(width=width, height=height, file=io.StringIO(), record=True, color_system=None)
    paper.print(picture(state, width, height), end="")
    return paper.export_text().split("\n")


@pytest.mark.parametrize("size", SIZES)
@given(state=states)
@settings(max_examples=60)
def test_it_fills_the_screen_and_shows_nothing_but_what_is_printable(size: tuple[int, int], state: PanelState) -> None:
    width, height = size
    lines = [line for line in drawn(state, width, height) if line]
    assert len(lines) == height
    assert max(map(len, lines)) <= width
    assert all(line.isprintable() for line in lines)
    assert "[Q]" in lines[-1]


@pytest.mark.parametrize("size", SIZES)
def test_what_an_operator_looks_for_is_on_it(size: tuple[int, int]) -> None:
    text = "\n".join(drawn(at_work(), *size))
    state = at_work()
    assert state.current is not None
    for words in (
        f"> {state.blocks[state.current]}",
        f"  {state.blocks[state.current + 1]}",
        f"{state.buffered:,} of 8,192",
        "LED 1 ○  2 ●",
        "RMT   STRT  MTN  ***   ***",
        "19200 baud, 8E1",
        "5084=1  5083=12  5082=1",
        "5000=000",
    ):
        assert words in text


@pytest.mark.parametrize("status", BoardStatus)
def test_12_1_the_meaning_of_the_leds_has_room(status: BoardStatus) -> None:
    """Of 80x24 too."""
    assert len(LED_WORDS[status]) <= SIDE_WIDTH - 4


def test_an_eob_is_shown_once_it_is_there() -> None:
    control, _ = operated(World())
    control.tape.write(b"G91\nX1.\nX2")
    assert state_of(control, "10:00:00").blocks == ("G91 ;", "X1. ;", "X2")
    control.tape.write(b".\n")
    assert state_of(control, "10:00:00").blocks == ("G91 ;", "X1. ;", "X2. ;")


@pytest.mark.parametrize("size", SIZES)
def test_an_alarm_stands_out(size: tuple[int, int]) -> None:
    text = "\n".join(drawn(unplugged(), *size))
    for words in ("─ ALARM ─", "SR855  DATA SET READY DOWN", "HOLD  ***  ***   ALM", "UNPLUGGED", "LED 1 ●  2 ○"):
        assert words in text


@pytest.mark.parametrize("size", SIZES)
def test_10_every_parameter_has_its_row_on_some_page(size: tuple[int, int]) -> None:
    control, _ = operated(World())
    page, room = ParameterPage(control), page_room(*size)
    text = ""
    page.turn(room)
    while page.number:
        lines = drawn(state_of(control, "10:00:00", page.shown(room)), *size)
        text += "\n".join(lines)
        assert len([line for line in lines if line]) == size[1]
        page.turn(room)
    assert all(f"│ {number:04d} " in text for number in CATALOGUE)


def test_a_full_gauge_and_an_empty_one() -> None:
    state = replace(at_work(), buffered=8192)
    assert "░" not in "".join(drawn(state, 80, 24))
    assert "█" not in "".join(drawn(replace(state, buffered=0), 80, 24))


def test_a_small_terminal_is_told_so() -> None:
    assert "79x24 is too small" in "".join(drawn(at_work(), 79, 24))


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.name)
def test_the_pictures_of_the_docs_are_what_is_drawn(path: Path) -> None:
    assert path.read_text() == PICTURES[path](), "python -m docs.picture draws it anew"


@given(st.lists(st.binary(max_size=80), max_size=30), st.sampled_from([b"\n", b"\r\n"]), st.integers(0, 9))
def test_the_window_cuts_a_tape_into_its_blocks(pieces: list[bytes], eob: bytes, first: int) -> None:
    tape = TapeWindow(eob, first)
    for piece in pieces:
        tape.write(piece)
    whole = b"".join(pieces)
    blocks = tape.blocks
    assert [block.data for block in blocks if block.end - block.begin <= 256] == [
        block for block in whole.split(eob) if len(block) + len(eob) <= 256
    ][: len(blocks)] or any(len(block) > 200 for block in whole.split(eob))
    assert [block.begin for block in blocks] == [first, *(block.end for block in blocks[:-1])][: len(blocks)]
    assert not blocks or blocks[-1].end == first + len(whole)
    for position in range(first, first + len(whole), 7):
        index = tape.index_at(position)
        assert index is not None
        assert blocks[index].begin <= position < blocks[index].end


def test_the_window_is_bounded() -> None:
    tape = TapeWindow(b"\n", 0)
    tape.write(b"\n" * 10_000)
    tape.write(b"G" * 1_000_000)
    assert len(tape.blocks) <= 601
    assert sum(len(block.data) for block in tape.blocks) < 1000
    assert tape.blocks[-1].end == 1_010_000
