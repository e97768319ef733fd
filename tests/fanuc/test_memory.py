"""The memory map of 12.2, on a buffer whose every byte is known."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tapewire.errors import UsageError
from tapewire.fanuc.memory import BUFFER_BYTES, SEND_BYTES, Address, BoardMemory, Cause, pointers_say
from tapewire.fanuc.screens import Module, alarm_screen, configuration_screen, slot_on_screen


@dataclass
class Buffer:
    """A buffer that remembers all."""

    history: bytearray = field(default_factory=bytearray)
    taken: int = 0

    @property
    def received(self) -> int:
        return len(self.history)

    @property
    def held(self) -> bytes:
        return bytes(self.history[self.taken :])

    def put(self, count: int) -> None:
        self.history += bytes((self.received + place) % 251 for place in range(count))


def memory_of(buffer: Buffer, slot: int = 9) -> BoardMemory:
    return BoardMemory(lambda: buffer, slot)


def test_12_2_addresses_for_slot_n() -> None:
    for slot in range(16):
        memory = memory_of(Buffer(), slot)
        digits = f"4{slot:X}"
        assert f"{memory.address(Address.READ_POINTER):X}" == f"{digits}810500"
        assert f"{memory.address(Address.WRITE_POINTER):X}" == f"{digits}810504"
        assert f"{memory.address(Address.BUFFER):X}" == f"{digits}810508"
        assert f"{memory.address(Address.BUFFER) + BUFFER_BYTES - 1:X}" == f"{digits}812507"
        assert f"{memory.address(Address.SEND_POINTER):X}" == f"{digits}823100"
        assert f"{memory.address(Address.SEND_BUFFER):X}" == f"{digits}823104"
        assert f"{memory.address(Address.SEND_BUFFER) + SEND_BYTES - 1:X}" == f"{digits}823203"
        assert f"{memory.address(Address.ERROR_RECORD):X}" == f"{digits}80E014"


@given(st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 4000)), max_size=12))
def test_12_2_the_buffer_between_the_pointers_is_what_the_control_has_not_taken(
    steps: list[tuple[int, int]],
) -> None:
    buffer = Buffer()
    memory = memory_of(buffer)
    for come, go in steps:
        buffer.put(min(come, BUFFER_BYTES - 1 - len(buffer.held)))
        memory.refresh()
        buffer.taken += min(go, len(buffer.held))
    read = memory.long(memory.address(Address.READ_POINTER))
    write = memory.long(memory.address(Address.WRITE_POINTER))
    base = memory.address(Address.BUFFER)
    between = range(read, write if write >= read else write + BUFFER_BYTES)
    assert len(between) == len(buffer.held)
    assert (pointers_say(read, write) is Cause.HOST_OR_BUFFER) is (not buffer.held)
    shown = [memory.byte(base + place % BUFFER_BYTES) for place in (*between[:40], *between[-40:])]
    assert bytes(shown) == buffer.held[:40] + buffer.held[-40:]


@given(st.lists(st.binary(max_size=400), max_size=8))
@example([bytes(range(SEND_BYTES))])
def test_12_2_the_send_buffer_holds_the_latest_256(pieces: list[bytes]) -> None:
    memory = memory_of(Buffer())
    latest: deque[int] = deque(maxlen=SEND_BYTES)
    for piece in pieces:
        memory.sent(piece)
        latest.extend(piece)
    assert memory.latest_sent == bytes(latest)
    pointer = memory.long(memory.address(Address.SEND_POINTER))
    assert pointer <= SEND_BYTES
    if latest:
        assert memory.byte(memory.address(Address.SEND_BUFFER) + pointer - 1) == latest[-1]


def test_12_2_note_an_address_outside_the_dram_is_a_system_error() -> None:
    memory = memory_of(Buffer())
    assert memory.byte(0x49800000) == memory.byte(0x499FFFFF) == 0
    for address in (0x497FFFFF, 0x49A00000, 0x48810500, 0, -1, 0x149810500):
        with pytest.raises(UsageError, match="raises a system error"):
            memory.byte(address)


def test_a_slot_has_one_digit() -> None:
    with pytest.raises(UsageError, match="one hexadecimal digit"):
        memory_of(Buffer(), 16)


def test_a_dump_is_as_the_memory_display_shows_it() -> None:
    buffer = Buffer()
    buffer.put(18)
    assert memory_of(buffer).dump(Address.BUFFER, 18) == (
        "49810508 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F\n49810518 10 11"
    )


# -- 12.3 ----------------------------------------------------------------------------------------------------

MODULES = (
    Module(physical=0, logical=0, name="MOTHER BOARD", module_id=0x1234),
    Module(physical=2, logical=9, name="REMOTE BUFFER", module_id=0x10E1),
)


def test_12_3_1_the_second_half_of_the_slot_is_the_logical_number() -> None:
    screen = alarm_screen(MODULES, at="1999/03/12 12:34:56")
    assert "02:09  REMOTE BUFFER  10E1" in screen
    assert slot_on_screen(screen) == 9


def test_12_3_1_the_screen_as_a_person_copies_it() -> None:
    assert slot_on_screen("..00:00. MOTHER BOARD . 1234.\n..02:0A. REMOTE BUFFER   10E1. 0000") == 0xA


def test_12_3_2_the_physical_number_is_the_one_in_parentheses() -> None:
    screen = configuration_screen(MODULES)
    assert "09(02)  REMOTE BUFFER" in screen
    assert slot_on_screen(screen) == 9


@given(st.text(max_size=200))
def test_any_screen_has_a_slot_or_is_refused(screen: str) -> None:
    with pytest.raises(UsageError, match="names the REMOTE BUFFER"):
        slot_on_screen(screen)
