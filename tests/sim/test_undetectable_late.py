"""What excuses a word of the control that was heard late, and what does not."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.line.pacing import character_time
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Direction, draw
from tapewire.sim.switches import Settings
from tapewire.sim.undetectable import Excuses
from tests.sim.test_undetectable import case


@pytest.mark.parametrize(
    ("posting", "path", "missing", "ended", "excused"),
    [
        ("off", "uart-16550", 26, 15, True),
        ("off", "uart-16550", 27, 15, False),
        ("off", "usb-16ms", 17, 15, True),
        ("on", "usb-16ms", 16, 15, False),
        ("off", "usb-16ms", 16, 25, False),
    ],
)
def test_an_alarm_behind_the_last_characters(posting: str, path: str, missing: int, ended: int, excused: bool) -> None:
    """As many may stand in the FIFO or the adapter when DC3 comes, behind those that came while it was not heard: in
    100 ms a line of 1200 baud carries ten. Without posting nothing else is said.
    """
    evidence, _ = case()
    settings = Settings(host={"posting": posting}, cnc={}, data=draw("fanuc-b", "clean", 1).settings.data)
    drawn = draw("fanuc-b", "clean", 1, path=path)
    drawn = dataclasses.replace(drawn, settings=settings, direction=Direction.SEND, baud=1200)
    attempt = evidence.attempts[0]
    attempt.got -= missing
    del attempt.delivered[-missing:]
    evidence.control_ends.append((ended * SECOND, Outcome.FAILED))
    assert bool(Excuses(drawn, evidence).short(attempt, evidence.jobs[0])) is excused


@pytest.mark.parametrize(
    ("kind", "said", "ended", "mode", "excused"),
    [
        ("late stop", 18, 19, "L", True),
        ("late stop", 18, 19, "D", False),
        ("late stop", 18, 25, "L", False),
        ("late stop", 10, 19, "L", False),
        ("late stop", 16, 19, "L", False),
        ("x", 18, 19, "L", False),
    ],
)
def test_a_cancel_that_is_heard_when_the_job_is_over(
    kind: str, said: int, ended: int, mode: str, excused: bool
) -> None:
    """What holds XOFF back for 3 s holds back the DLE behind it, and the host listens for `end_wait`. DNC LINK says of
    its last record whether it came.
    """
    damage: dict[str, Any] = {"moment": said * SECOND, "kind": kind, "wire": Wire.FROM_CONTROL, "place": 3, "sent": b""}
    evidence, excuses = case("bridgeport", cnc={"mode": mode}, **damage, late=3 * SECOND)
    evidence.control_ends.append((ended * SECOND, Outcome.FAILED))
    assert bool(excuses.short(evidence.attempts[0], evidence.jobs[0])) is excused


@pytest.mark.parametrize(
    ("since_ms", "until_ms", "excused"),
    [(19_000, 19_900, True), (19_850, 19_900, False), (17_000, 18_000, False), (19_000, 20_500, False)],
)
def test_what_ended_the_job_was_said_while_the_computer_slept(since_ms: int, until_ms: int, excused: bool) -> None:
    """The job ends at 20 s; a host reckons with 100 ms."""
    evidence, excuses = case()
    evidence.sleeps.append((since_ms * MILLISECOND, until_ms * MILLISECOND))
    assert not excuses.less(evidence.attempts, evidence.jobs[0], 5), "nothing ended the control's operation"
    evidence.control_ends.append((19_500 * MILLISECOND, Outcome.FAILED))
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], 5)) is excused
    assert not excuses.less(evidence.attempts, evidence.jobs[0], 100_000), "so many cannot have left meanwhile"


@pytest.mark.parametrize(
    ("protocol", "mode", "excused"),
    [("fanuc-a", "", False), ("fanuc-a-expansion", "", False), ("bridgeport", "D", False), ("bridgeport", "L", True)],
)
def test_a_protocol_that_acknowledges_hears_nothing_late(protocol: str, mode: str, excused: bool) -> None:
    """GTD, ACK: what is certain was said by the control."""
    evidence, excuses = case(protocol, cnc={"mode": mode} if mode else {})
    evidence.sleeps.append((19 * SECOND, 19_900 * MILLISECOND))
    evidence.control_ends.append((19_500 * MILLISECOND, Outcome.FAILED))
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], 5)) is excused


@pytest.mark.parametrize(
    ("missing", "said_ms", "excused"),
    [
        (64 + 43 + 16, 18_900, True),
        (64 + 43 + 17, 18_900, False),
        (100_000, 18_900, False),
        (5, 11_000, False),
        (5, 18_600, False),
        (5, 19_200, False),
    ],
)
def test_no_more_is_missing_than_left_while_a_stop_was_held_back(missing: int, said_ms: int, excused: bool) -> None:
    """DC3 comes 64 characters late, 43 are 100 ms, and the control ends at 19 s. A stop long before that, or behind it,
    is another one.
    """
    evidence, _ = case(moment=said_ms * MILLISECOND, kind="late stop", wire=Wire.FROM_CONTROL, place=1, sent=b"")
    drawn = dataclasses.replace(draw("fanuc-b", "clean", 1, path="uart-16550"), direction=Direction.SEND, baud=4800)
    late = 64 * character_time(4800)
    evidence.damages[0] = dataclasses.replace(evidence.damages[0], late=late)
    evidence.control_ends.append((19 * SECOND, Outcome.FAILED))
    evidence.jobs[0].ended = 19 * SECOND + late
    plain = dataclasses.replace(drawn, settings=Settings(host={}, cnc={}, data=drawn.settings.data))
    assert bool(Excuses(plain, evidence).less(evidence.attempts, evidence.jobs[0], missing)) is excused


@pytest.mark.parametrize(
    ("kind", "posting", "characters", "moment", "excused"),
    [
        ("late stop", "off", 1900, 15, True),
        ("late stop", "off", 1000, 15, False),
        ("late stop", "off", 1900, 12, False),
        ("late stop", "on", 1900, 15, False),
        ("flip", "off", 1900, 15, False),
    ],
)
def test_an_alarm_whose_dc3_is_heard_late_says_the_same_as_the_end(
    kind: str, posting: str, characters: int, moment: int, excused: bool
) -> None:
    """1,900 of 2,000 characters are not there: so many may have gone on behind DC3, and no more."""
    each = character_time(86_400)
    damage: dict[str, Any] = {"kind": kind, "wire": Wire.FROM_CONTROL, "place": 1, "sent": b"X", "arrived": (b"X",)}
    evidence, _ = case(moment=moment * SECOND, **damage, late=characters * each)
    drawn = dataclasses.replace(draw("fanuc-b", "clean", 1, path="uart-16550"), direction=Direction.SEND, baud=86_400)
    drawn = dataclasses.replace(drawn, settings=Settings(host={"posting": posting}, cnc={}, data=drawn.settings.data))
    evidence.program = evidence.expected = bytes(2000)
    evidence.attempts[0].delivered[:] = bytes(100)
    evidence.attempts[0].got = 100
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    assert bool(Excuses(drawn, evidence).short(evidence.attempts[0], evidence.jobs[0])) is excused


@pytest.mark.parametrize(
    ("said", "host", "got", "end", "excused"),
    [
        (b"\x11\x13\x13", {"posting": "off"}, 0, Outcome.COMPLETE, True),
        (b"\x11\x93\x13", {"posting": "off"}, 0, Outcome.COMPLETE, True),
        (b"\x11\x13\x13", {"er": "hidden"}, 0, Outcome.COMPLETE, True),
        (b"\x11\x13\x13", {}, 0, Outcome.COMPLETE, False),
        (b"\x11\x13\x13\x16", {"posting": "off"}, 0, Outcome.COMPLETE, True),
        (b"\x11\x13\x13\x15", {"er": "hidden"}, 0, Outcome.COMPLETE, False),
        (b"\x11\x13\x11\x13", {"posting": "off"}, 0, Outcome.COMPLETE, False),
        (b"\x11\x13\x13", {"posting": "off"}, 1, Outcome.COMPLETE, False),
        (b"\x11\x13\x13", {"posting": "off"}, 0, Outcome.FAILED, False),
        (b"\x11\x13\x13", {"posting": "off"}, 0, None, False),
    ],
)
def test_an_end_right_behind_a_stop(
    said: bytes, host: dict[str, str], got: int, end: Outcome | None, excused: bool
) -> None:
    """`got` characters are missing."""
    evidence, excuses = case(host=host)
    if end is not None:
        evidence.control_ends.append((17 * SECOND, end))
    evidence.cnc.sent += said
    evidence.attempts[0].got -= got
    assert (excuses.undisturbed(evidence.attempts[0]) == Undetectable.END_LIKE_RESET) is excused
    assert excuses.undisturbed(None) == ""


def test_what_nothing_disturbs_is_told_of_protocol_b_alone() -> None:
    evidence, excuses = case("bridgeport")
    evidence.cnc.sent += b"\x13\x13"
    assert excuses.undisturbed(evidence.attempts[0]) == ""
