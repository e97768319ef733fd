"""The tables of 12.1, written down a second time."""

from __future__ import annotations

import pytest

from tapewire.errors import UsageError
from tapewire.fanuc.leds import (
    RED_MEANINGS,
    STATUSES,
    SYSTEM_MESSAGES,
    BoardStatus,
    Led,
    Red,
    SystemFault,
    read_leds,
)

ON, OFF = Led.ON, Led.OFF


@pytest.mark.parametrize(
    ("status", "green", "code"),
    [
        (BoardStatus.POWER_ON, (ON, ON), 3),
        (BoardStatus.INITIALISING, (OFF, OFF), 0),
        (BoardStatus.IDLE, (ON, OFF), 1),
        (BoardStatus.HANDLING, (OFF, ON), 2),
        (BoardStatus.STOPPING, (ON, ON), 3),
    ],
)
def test_12_1_1_normal_states(status: BoardStatus, green: tuple[Led, Led], code: int) -> None:
    row = STATUSES[status]
    assert (row.green, row.code, row.is_normal, row.message) == (green, code, True, False)
    assert code == (green[0] is ON) + 2 * (green[1] is ON), "the code is the number that the LEDs make"


def test_12_1_1_flashing_is_no_normal_state() -> None:
    for row in STATUSES.values():
        assert row.is_normal is not any(led in (Led.FLASHING, Led.ALTERNATING) for led in row.green)


def test_12_1_2_a_system_errors() -> None:
    errors = {status: row for status, row in STATUSES.items() if not row.is_normal}
    assert [row.code for row in errors.values()] == [None, 1, 2, None]
    assert [status for status, row in errors.items() if not row.message] == [BoardStatus.NMI]
    assert errors[BoardStatus.SYSTEM_ALARM].green == (Led.ALTERNATING, Led.ALTERNATING)
    assert [status for status, row in errors.items() if not row.reconstructed] == [BoardStatus.SYSTEM_ALARM]


def test_12_1_2_b_red_leds() -> None:
    assert [red.value for red in Red] == [0, 1, 2, 3]
    assert "held in reset" in RED_MEANINGS[Red.RESET]
    assert "L-BUS" in RED_MEANINGS[Red.L_BUS]
    assert "DRAM" in RED_MEANINGS[Red.DRAM_PARITY]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (SystemFault.DRAM_CHECK_SUM, "DRAM CHECK SUM ERROR"),
        (SystemFault.HARD, "HARD ERROR"),
        (SystemFault.ILLEGAL_INTERRUPT, "UNDEF IRT 00nn(aaaaaaaa) ERR-CODE:cccc"),
        (SystemFault.F_BUS, "F-BUS ERROR(aaaaaaaa)"),
        (SystemFault.DRAM_PARITY, "DRAM PARITY 000n(aaaaaaaa)"),
        (SystemFault.ARES_BUS, "BUS ERROR(ARES) (aaaaaaaa)"),
        (SystemFault.LFP_BUS, "BUS ERROR(LFP) (aaaaaaaa)"),
        (SystemFault.F_BUS_WRITE, "WRITE BUS ERROR(F-BUS) (aaaaaaaa)"),
        (SystemFault.OTHER_WRITE, "WRITE BUS ERROR(aaaaaaaa)"),
    ],
)
def test_12_1_2_c_messages(fault: SystemFault, message: str) -> None:
    assert SYSTEM_MESSAGES[fault][0] == message


def test_12_1_2_c_every_code_has_its_message() -> None:
    assert {fault.value for fault in SystemFault} == {1, 4, 5, 6, 7, 8, 9, 0xA, 0xB}
    assert set(SYSTEM_MESSAGES) == set(SystemFault)


def test_what_somebody_sees_is_read() -> None:
    assert read_leds("off,on") == (BoardStatus.HANDLING,)
    assert read_leds(" ON , on") == (BoardStatus.POWER_ON, BoardStatus.STOPPING)
    for status, row in STATUSES.items():
        assert status in read_leds(",".join(row.green))


@pytest.mark.parametrize("words", ["", "on", "on,on,on", "red,green", "on,flashing", "alternating,on"])
def test_what_nobody_can_see_is_refused(words: str) -> None:
    with pytest.raises(UsageError, match="LEDs"):
        read_leds(words)
