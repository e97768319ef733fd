"""The alarm: rings once, at its moment and not before, and only for the moment set last."""

from __future__ import annotations

import select
from collections.abc import Iterator

import pytest

from tapewire.engine import MILLISECOND, SECOND
from tapewire.line.alarm import Alarm
from tapewire.line.driver import monotonic


@pytest.fixture
def alarm() -> Iterator[Alarm]:
    made = Alarm()
    yield made
    made.close()


def rings(alarm: Alarm, limit_s: float) -> bool:
    return bool(select.select([alarm.fd], [], [], limit_s)[0])


def test_it_rings_at_its_moment_and_once(alarm: Alarm) -> None:
    at = monotonic() + 5 * MILLISECOND
    alarm.set(at)
    assert rings(alarm, 10)
    assert monotonic() >= at
    alarm.clear()
    alarm.clear()
    assert not rings(alarm, 0.01)


def test_a_moment_that_has_passed_rings_at_once(alarm: Alarm) -> None:
    alarm.set(-5)
    assert rings(alarm, 10)


def test_the_moment_set_last_counts(alarm: Alarm) -> None:
    alarm.set(monotonic() + 5 * MILLISECOND)
    alarm.set(monotonic() + 3600 * SECOND)
    assert not rings(alarm, 0.05)
