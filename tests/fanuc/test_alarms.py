"""The table of chapter 11; docs/compliance.md names for each alarm the test that raises it by a real fault."""

from __future__ import annotations

import pytest

from tapewire.errors import UsageError
from tapewire.fanuc.alarms import ALARMS, AlarmNumber, alarm_named, text_of

MANUAL = {
    "PS10": "IMPROPER G-CODE",
    "PS11": "IMPROPER NC-ADDRESS",
    "PS12": "INVALID BREAK POINT OF WORDS",
    "SR807": "PARAMETER SETTING ERROR",
    "SR855": "DATA SET READY DOWN (RMT-BUF)",
    "SR856": "BUFFER OVERFLOW (RMT-BUF)",
    "SR890": "CHECK SUM ERROR (G05)",
    "SR891": "ILLEGAL COMMAND G05",
    **dict.fromkeys(("SR941", "SR944", "SR945", "SR946", "SR947", "SR948"), "COMMUNICATION ERROR (RMT-BUF)"),
}


def test_11_every_alarm_and_its_message() -> None:
    assert {str(number): record.message for number, record in ALARMS.items()} == MANUAL


@pytest.mark.parametrize("number", AlarmNumber)
def test_11_every_alarm_says_why_what_is_seen_and_what_to_do(number: AlarmNumber) -> None:
    record = ALARMS[number]
    assert record.causes
    assert record.seen
    assert record.remedies
    assert all(text.endswith((".", "wrong.")) for text in (*record.causes, record.seen, *record.remedies))


def test_11_sr948_has_three_causes() -> None:
    assert len(ALARMS[AlarmNumber.SR948].causes) == 3


@pytest.mark.parametrize("name", ["SR945", "sr945", "SR 945", "SR0945", "945", " sr 0945 "])
def test_an_alarm_by_any_of_its_names(name: str) -> None:
    assert alarm_named(name).number is AlarmNumber.SR945


@pytest.mark.parametrize("name", ["", "SR", "SR999", "PS945", "945x", "9" * 400])
def test_a_name_that_is_none(name: str) -> None:
    with pytest.raises(UsageError, match="its alarms are PS10"):
        alarm_named(name)


def test_the_text_is_that_of_the_screen_with_what_the_simulation_knows() -> None:
    assert text_of(AlarmNumber.SR946, "framing error") == "COMMUNICATION ERROR (RMT-BUF): framing error"
