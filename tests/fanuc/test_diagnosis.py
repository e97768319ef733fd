"""The troubleshooting procedure of 12.2, step by step."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.fanuc.alarms import ALARMS, BEGIN_AGAIN, AlarmNumber
from tapewire.fanuc.diagnosis import Case, From, Heard, Seen, diagnose
from tapewire.fanuc.leds import BoardStatus, Red
from tapewire.fanuc.parameters import ParameterSet

GOOD = ParameterSet({5000: 0b1001, 5071: 3, 5072: 1, 5073: 11, 5074: 1})
HANDLING = (BoardStatus.HANDLING,)

seen = st.builds(
    Seen,
    parameters=st.sampled_from([None, GOOD]),
    green=st.lists(st.sampled_from(BoardStatus), max_size=2).map(tuple),
    red=st.sampled_from(Red),
    pointers=st.none() | st.tuples(st.integers(0, 9), st.integers(0, 9)),
    alarm=st.none() | st.sampled_from(AlarmNumber),
    recording=st.lists(st.builds(Heard, st.integers(0, 9), st.sampled_from(From), st.binary(max_size=3)), max_size=4),
)


@given(seen)
def test_any_knowledge_leads_to_a_case_and_something_to_do(known: Seen) -> None:
    diagnosis = diagnose(known)
    assert diagnosis.remedies or all((known.parameters, known.green, known.pointers, known.recording))


@pytest.mark.parametrize("number", AlarmNumber)
def test_12_2_3_an_alarm_is_its_own_case(number: AlarmNumber) -> None:
    diagnosis = diagnose(Seen(alarm=number))
    assert diagnosis.remedies == (*ALARMS[number].remedies, BEGIN_AGAIN)
    assert diagnosis.case is not Case.UNKNOWN


@pytest.mark.parametrize(
    ("number", "case"),
    [
        (AlarmNumber.SR807, Case.PARAMETERS),
        (AlarmNumber.SR855, Case.LINE),
        (AlarmNumber.SR856, Case.HOST),
        (AlarmNumber.SR941, Case.CONTROL),
        (AlarmNumber.SR946, Case.LINE),
    ],
)
def test_12_2_3_whose_fault_an_alarm_is(number: AlarmNumber, case: Case) -> None:
    assert diagnose(Seen(alarm=number)).case is case


def test_12_2_1_parameters_first() -> None:
    wrong = GOOD.with_values({5073: 16})
    diagnosis = diagnose(Seen(parameters=wrong, green=HANDLING, pointers=(0, 1)))
    assert diagnosis.case is Case.PARAMETERS
    assert "SR807: No. 5073" in diagnosis.steps[0]


def test_12_2_1_a_device_without_control_codes() -> None:
    assert diagnose(Seen(parameters=GOOD.with_values({5071: 4}))).case is Case.PARAMETERS
    assert diagnose(Seen(parameters=GOOD.with_values({5071: 4, 5074: 3}))).case is Case.UNKNOWN


@pytest.mark.parametrize(
    ("green", "case"),
    [
        ((BoardStatus.IDLE,), Case.NOT_ASKED),
        ((BoardStatus.INITIALISING,), Case.NOT_ASKED),
        ((BoardStatus.POWER_ON, BoardStatus.STOPPING), Case.NOT_ASKED),
        ((BoardStatus.DRAM_TEST,), Case.HARDWARE),
        ((BoardStatus.SYSTEM_ALARM,), Case.HARDWARE),
    ],
)
def test_12_2_1_step_1_another_led_state_than_no_4(green: tuple[BoardStatus, ...], case: Case) -> None:
    assert diagnose(Seen(green=green, pointers=(0, 1))).case is case


@pytest.mark.parametrize("red", [Red.RESET, Red.L_BUS, Red.DRAM_PARITY])
def test_12_1_2_b_a_red_led_is_the_board(red: Red) -> None:
    assert diagnose(Seen(green=HANDLING, red=red)).case is Case.HARDWARE


def test_12_2_1_step_2_equal_pointers_are_the_host_or_the_buffer() -> None:
    assert diagnose(Seen(parameters=GOOD, green=HANDLING, pointers=(5, 5))).case is Case.HOST_OR_BUFFER


def test_12_2_1_step_2_other_pointers_are_the_nc() -> None:
    assert diagnose(Seen(green=HANDLING, pointers=(5, 6))).case is Case.CONTROL


C, H = From.CONTROL, From.HOST


@pytest.mark.parametrize(
    ("recording", "case", "words"),
    [
        ([(0, H, b"")], Case.LINE, "Nothing was said"),
        ([(0, H, b"%\n")], Case.LINE, "Nothing came from the control"),
        ([(0, C, b"\x11")], Case.HOST, "Arm a program"),
        ([(0, C, b"\x11"), (1, H, b"%\nX1.\n"), (2, C, b"\x93"), (3, H, b"Y1.")], Case.CONTROL, "stopped the host"),
        ([(0, H, b"A"), (1, C, b"ECGTD\r")], Case.HOST, "The control waits for the host"),
        ([(0, C, b"ECGTD\r"), (1, H, b"F9WAT\r")], Case.CONTROL, "The host spoke last"),
    ],
)
def test_12_2_1_step_3_what_was_said_last(recording: list[tuple[int, From, bytes]], case: Case, words: str) -> None:
    diagnosis = diagnose(Seen(green=HANDLING, pointers=(0, 0), recording=[Heard(*one) for one in recording]))
    assert diagnosis.case is case
    assert words in diagnosis.remedies[0]


def test_without_knowledge_it_says_what_to_look_at() -> None:
    diagnosis = diagnose(Seen())
    assert diagnosis.case is Case.UNKNOWN
    assert len(diagnosis.remedies) == 4
