"""What excuses a character that the ends of Bridgeport took for another, and what does not."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, LineFault, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.line.transport import Fault
from tapewire.sim.evidence import Damage, Evidence, Wait
from tapewire.sim.mistaken import gained, lost
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import draw
from tapewire.sim.undetectable import Excuses
from tests.sim.test_undetectable import PROGRAM, case

RECORD = PROGRAM + b"\x17\x55"
END = 1 + len(RECORD) + 1
"""Where the end code stands, counted from 1: the DC1 that answers DC2, the record, and it."""
BREAK = Fault(fault=LineFault.BREAK, byte=None)


def behind_the_end(got: int = len(PROGRAM), **damage: Any) -> str:
    """The host of a DNC LINK is complete, the control has said ACK and waits; `damage` hit what the host said."""
    evidence, excuses = case("bridgeport", cnc={"mode": "D"}, **damage)
    evidence.host.sent[:] = b"\x11" + RECORD + b"\x04"
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    job.complete, attempt.got = True, got
    wait = Wait(who=("control",), job=job, attempt=attempt, said=b"", heard=b"", told=END)
    return excuses.waiting("control", wait)


NOTHING: dict[str, Any] = {"place": 0, "sent": b""}


@pytest.mark.parametrize(
    "damage",
    [
        {"place": END, "sent": b"\x04", "arrived": ()},
        {"place": END, "sent": b"\x04", "arrived": (b"D",)},
        {"place": END, "sent": b"\x04", "arrived": (BREAK,)},
        {"place": END - 2, "sent": b"\x17\x55\x04", "arrived": ()},
        {"place": END - 1, "sent": b"\x55", "arrived": (b"\x55\x55",)},
        {**NOTHING, "arrived": (BREAK,), "told": END - 1},
        {**NOTHING, "arrived": (b"\x17",), "told": END},
        {**NOTHING, "arrived": (b"X",), "told": END},
    ],
)
def test_an_end_code_is_lost_or_is_a_character_of_a_record_that_noise_began(damage: dict[str, Any]) -> None:
    assert behind_the_end(**damage) == Undetectable.END_CODE


@pytest.mark.parametrize(
    "damage",
    [
        {**NOTHING, "arrived": (BREAK,), "told": END - 2},
        {**NOTHING, "arrived": (BREAK,), "told": END + 1},
        {**NOTHING, "arrived": (BREAK,), "told": END, "moment": 25 * SECOND},
        {**NOTHING, "arrived": (BREAK,), "told": END, "wire": Wire.FROM_CONTROL},
        {"place": END - 2, "sent": b"\x17", "arrived": (BREAK,)},
        {"place": END, "sent": b"\x04", "arrived": (), "got": len(PROGRAM) - 1},
    ],
)
def test_damage_elsewhere_hides_no_end_code(damage: dict[str, Any]) -> None:
    assert behind_the_end(**damage) != Undetectable.END_CODE


def unarmed(delivered: bytes, got: int | None = None, **damage: Any) -> tuple[Evidence, Excuses]:
    """A control asks from 10 to 20 s, nothing is armed, and it takes `delivered`."""
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, **damage)
    evidence.attempts[0] = dataclasses.replace(
        evidence.attempts[0], armed=False, delivered=bytearray(delivered), got=len(delivered) if got is None else got
    )
    evidence.control_ends.append((20 * SECOND, Outcome.CANCELLED))
    return evidence, excuses


FORGED: dict[str, Any] = {"wire": Wire.FROM_CONTROL, "place": 0, "sent": b"", "arrived": (b"\x12",)}
"""A DC2 of nobody: its answer is a DC1."""


@pytest.mark.parametrize(
    ("delivered", "damage", "name"),
    [
        (b"\x11", FORGED, Undetectable.READ_AS_TEXT),
        (b"\x11", {**FORGED, "moment": 10 * SECOND - 50 * MILLISECOND}, Undetectable.READ_AS_TEXT),
        (b"\x11", {**FORGED, "place": 2, "sent": b"\x12", "arrived": (b"\x12\x12",)}, Undetectable.READ_AS_TEXT),
        (b"X", {**NOTHING, "arrived": (b"X",)}, Undetectable.OUT_OF_NOTHING),
        (b"X", {"place": 3, "sent": b"\x13", "arrived": (b"X",)}, Undetectable.FLIP),
        (b"\x11", {"place": 3, "sent": b"\x11", "arrived": (b"\x11\x11",)}, Undetectable.DOUBLED),
    ],
)
def test_a_host_with_nothing_armed_says_codes_and_they_are_read_as_text(
    delivered: bytes, damage: dict[str, Any], name: Undetectable
) -> None:
    evidence, excuses = unarmed(delivered, **damage)
    assert excuses.out_of_nothing(evidence.attempts[0]) == name


@pytest.mark.parametrize(
    ("delivered", "got", "damage"),
    [
        (b"N", 1, FORGED),
        (b"\x11\x11", 2, FORGED),
        (b"\x11", 2, FORGED),
        (b"\x11", 1, {**FORGED, "moment": 9 * SECOND}),
        (b"\x11", 1, {**FORGED, "moment": 21 * SECOND}),
        (b"\x11", 1, {**FORGED, "arrived": (b"X",)}),
        (b"\x11", 1, {**FORGED, "arrived": (BREAK,)}),
        (b"X", 2, {**NOTHING, "arrived": (b"X",)}),
        (b"XN", 2, {**NOTHING, "arrived": (b"X",)}),
        (b"N", 1, {**NOTHING, "arrived": (b"X",)}),
        (b"X", 1, {**NOTHING, "arrived": (b"X",), "moment": 21 * SECOND}),
    ],
)
def test_no_more_is_read_as_text_than_was_made_or_answered(delivered: bytes, got: int, damage: dict[str, Any]) -> None:
    evidence, excuses = unarmed(delivered, got, **damage)
    assert excuses.out_of_nothing(evidence.attempts[0]) == ""


@pytest.mark.parametrize(("slept", "excused"), [((8, 12), True), ((8, 9), False), ((12, 15), False)])
def test_a_computer_in_its_sleep_answers_later(slept: tuple[int, int], excused: bool) -> None:
    evidence, excuses = unarmed(b"\x11", **{**FORGED, "moment": 9 * SECOND})
    evidence.sleeps.append((slept[0] * SECOND, slept[1] * SECOND))
    assert (excuses.out_of_nothing(evidence.attempts[0]) == Undetectable.READ_AS_TEXT) is excused


@pytest.mark.parametrize(
    ("protocol", "arrived", "missing", "excused"),
    [
        ("bridgeport", b"\x00", 1, True),
        ("bridgeport", b"\xff", 1, True),
        ("bridgeport", b"\x04", 1, True),
        ("bridgeport", b"Y", 1, False),
        ("bridgeport", b"\x00", 2, False),
        ("fanuc-b", b"\x00", 1, False),
    ],
)
def test_what_is_blank_tape_by_a_flip_is_missing(protocol: str, arrived: bytes, missing: int, excused: bool) -> None:
    """A control passes NUL and DEL over, and one bit makes NUL of a space."""
    evidence, excuses = case(protocol, cnc={"mode": "L"} if protocol == "bridgeport" else None, arrived=(arrived,))
    assert (excuses.less(evidence.attempts, evidence.jobs[0], missing) == Undetectable.LOST) is excused


@pytest.mark.parametrize("code", [b"\x11", b"\x13", b"\x04"])
@pytest.mark.parametrize("arrived", [(), (b"\x00",), (b"X",)])
def test_a_code_of_the_host_that_is_gone_is_no_character_of_the_program(
    code: bytes, arrived: tuple[bytes, ...]
) -> None:
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, place=len(PROGRAM) + 1, sent=code, arrived=arrived)
    assert excuses.less(evidence.attempts, evidence.jobs[0], 1) == ""


@pytest.mark.parametrize(
    ("sent", "arrived", "more", "fewer"),
    [
        (b"X", b"", 0, 1),
        (b"X", b"XX", 1, 0),
        (b"X", b"\x04", 0, 1),
        (b"\x11", b"", 0, 0),
        (b"\x11", b"X", 1, 0),
        (b"\x11", b"\x11\x11", 1, 0),
        (b"\x04", b"\x04X", 1, 0),
        (b"\x11\x11X", b"\x11YZ", 1, 0),
        (b"\x11X\x13", b"\x11", 0, 0),
        (b"XY\x04", b"X", 0, 1),
        (b"", b"\x11", 1, 0),
    ],
)
def test_a_code_counts_as_a_character_only_where_it_was_made(
    sent: bytes, arrived: bytes, more: int, fewer: int
) -> None:
    codes = draw("bridgeport", "clean", 1).codes
    damage = Damage(0, "x", Wire.FROM_HOST, 5, sent, (arrived,))
    assert (gained(damage, codes), lost(damage, codes)) == (more, fewer)


@pytest.mark.parametrize(
    ("sent", "arrived", "surplus", "excused"),
    [(b"\x04", b"D", 1, True), (b"\x04", b"D", 2, False), (b"\x04", b"\x00", 1, False), (b"X", b"Y", 1, False)],
)
def test_a_code_that_came_as_a_character_is_one_more(sent: bytes, arrived: bytes, surplus: int, excused: bool) -> None:
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, place=len(PROGRAM) + 1, sent=sent, arrived=(arrived,))
    assert (excuses.more(evidence.attempts, surplus) == Undetectable.FLIP) is excused


@pytest.mark.parametrize(
    ("taken", "closing_dc3", "excused"), [(b"K\x13", "on", True), (b"K\x13", "off", False), (b"K\x13\x13", "on", False)]
)
def test_the_dc3_that_closes_a_name_is_text_where_noise_has_begun_one(
    taken: bytes, closing_dc3: str, excused: bool
) -> None:
    """Given up at the host, with nothing of the program sent."""
    evidence, excuses = case(
        "bridgeport", host={"closing_dc3": closing_dc3}, cnc={"mode": "L"}, **{**NOTHING, "arrived": (b"K",)}
    )
    attempt = evidence.attempts[0]
    attempt.delivered[:], attempt.got = taken, len(taken)
    assert (excuses.more(evidence.attempts, len(taken)) == Undetectable.READ_AS_TEXT) is excused


@pytest.mark.parametrize(
    ("damage", "excused"),
    [
        ({**NOTHING, "arrived": (b"\x04",), "told": END}, True),
        ({**NOTHING, "arrived": (b"\x04",), "told": END - 300}, False),
        ({"place": END - 9, "sent": b"N", "arrived": (b"\x04",), "told": END - 9}, True),
        ({**NOTHING, "arrived": (b"X",), "told": END}, False),
        ({**NOTHING, "arrived": (b"\x04",), "told": END, "moment": 19 * SECOND}, False),
        ({**NOTHING, "arrived": (b"\x04",), "told": END, "wire": Wire.FROM_CONTROL}, False),
    ],
)
def test_an_end_code_out_of_noise_in_place_of_an_answer_leaves_the_host_waiting(
    damage: dict[str, Any], excused: bool
) -> None:
    evidence, excuses = case("bridgeport", cnc={"mode": "D"}, **damage)
    evidence.control_ends.append((18 * SECOND, Outcome.COMPLETE))
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    wait = Wait(who=("host",), job=job, attempt=attempt, said=b"", heard=b"", told=END)
    assert (excuses.waiting("host", wait) == Undetectable.FORGED_END) is excused


@pytest.mark.parametrize(("delivered", "surplus", "excused"), [(3, 1, True), (3, 2, False), (19, 1, False)])
def test_a_code_that_stood_in_the_buffer_of_a_control_that_failed(delivered: int, surplus: int, excused: bool) -> None:
    """REMOTE LOAD: the answer to a DC2 of nobody came behind the text, and was not taken any more."""
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, **FORGED)
    del evidence.attempts[0].delivered[delivered:]
    assert (excuses.more(evidence.attempts, surplus) == Undetectable.READ_AS_TEXT) is excused
