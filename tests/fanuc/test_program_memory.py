"""Tapes into the memory and out of it (8.2, 0000, 5081)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.codes import DataCode
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber
from tapewire.fanuc.conversion import EobForm
from tapewire.fanuc.parameters import ParameterSet
from tapewire.fanuc.program_memory import FEED_BYTES, Existing, ProgramMemory, PunchForm, punch_form, tape_of
from tapewire.fanuc.punch import PunchReader

TAPE = b"%SHAFT\nG90\nO0001(FIRST)\nX1.\nM02\nO0002\nM30\n%\nO0003\nM30\n"

bodies = st.lists(st.sampled_from((b"X1.", b"M02", b"G90", b"")), max_size=3)
memories = st.dictionaries(
    st.integers(1, 9999), bodies.map(lambda lines: b"".join(line + b"\n" for line in lines)), min_size=1, max_size=5
)


def test_8_2_every_program_between_the_label_and_eor() -> None:
    memory = ProgramMemory()
    assert memory.read(TAPE).registered == (1, 2)
    assert memory.programs == {1: b"O0001(FIRST)\nX1.\nM02\n", 2: b"O0002\nM30\n"}


def test_8_2_data_after_eor_is_ignored() -> None:
    memory = ProgramMemory()
    memory.read(TAPE)
    assert 3 not in memory.programs


def test_a_tape_without_a_program_number() -> None:
    assert ProgramMemory().read(b"%\nX1.\n%").refused == ("the tape holds no program number",)


@pytest.mark.parametrize(("existing", "kept"), [(Existing.KEPT, b"O1\nX1.\n"), (Existing.REPLACED, b"O1\nX2.\n")])
def test_a_number_that_is_there_already(existing: Existing, kept: bytes) -> None:
    memory = ProgramMemory(existing)
    memory.read(b"%\nO1\nX1.\n%")
    told = memory.read(b"%\nO1\nX2.\n%")
    assert memory.programs[1] == kept
    assert bool(told.refused) is (existing is Existing.KEPT)


def test_9_3_note_7_a_program_with_g05_is_not_registered() -> None:
    memory = ProgramMemory()
    told = memory.read(b"%\nO1\nM30\nO2\nG05\n%")
    assert (told.registered, told.alarm) == ((1,), AlarmNumber.SR891)
    assert list(memory.programs) == [1]


@given(memories)
def test_what_is_punched_is_registered_again(programs: dict[int, bytes]) -> None:
    memory = ProgramMemory()
    memory.programs = {number: b"O%04d\n" % number + body for number, body in programs.items()}
    again = ProgramMemory()
    assert again.read(memory.text()).registered == tuple(sorted(programs))
    assert again.programs == memory.programs


@pytest.mark.parametrize(
    ("byte", "form"),
    [
        (0b00000, (DataCode.ISO, EobForm.LF_CR_CR)),
        (0b01000, (DataCode.ISO, EobForm.LF)),
        (0b00100, (DataCode.ASCII, EobForm.LF_CR_CR)),
        (0b01100, (DataCode.ASCII, EobForm.LF)),
        (0b10000, (DataCode.EIA, EobForm.LF)),
        (0b11100, (DataCode.EIA, EobForm.LF)),
    ],
)
def test_10_0000_2_3_and_4_are_how_it_punches(byte: int, form: tuple[DataCode, EobForm]) -> None:
    made = punch_form(ParameterSet({0: byte}))
    assert (made.code, made.eob) == form


@pytest.mark.parametrize(("specification", "feed"), [(1, FEED_BYTES), (2, FEED_BYTES), (3, 0), (4, 0)])
@pytest.mark.parametrize(("bits", "number"), [(0, 5081), (1, 5071)])
def test_10_2_5071_and_5081_feed_by_punching(specification: int, feed: int, bits: int, number: int) -> None:
    assert punch_form(ParameterSet({0: 0, 5000: bits, number: specification})).feed == feed


@given(memories, st.sampled_from(list(EobForm)[:2]), st.sampled_from((DataCode.ISO, DataCode.EIA, DataCode.ASCII)))
def test_a_punched_tape_reads_as_its_text(programs: dict[int, bytes], eob: EobForm, code: DataCode) -> None:
    memory = ProgramMemory()
    memory.programs = {number: b"O%04d\n" % number + body for number, body in programs.items()}
    form = PunchForm(code=code, eob=EobForm.LF if code is DataCode.EIA else eob, feed=FEED_BYTES)
    text = bytearray()
    reader = PunchReader(code, text.extend)
    reader.feed(tape_of(memory.text(), form))
    assert reader.finish() == ()
    assert bytes(text) == memory.text()


def test_what_is_not_there_cannot_be_punched() -> None:
    memory = ProgramMemory()
    with pytest.raises(UsageError, match="is empty"):
        memory.text()
    memory.read(TAPE)
    assert memory.text((2,)) == b"%\nO0002\nM30\n%"
    with pytest.raises(UsageError, match="O0009 is not in the memory"):
        memory.text((9,))
