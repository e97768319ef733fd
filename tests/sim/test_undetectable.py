"""What excuses a deviation, and what does not: the damage that explains it, in the time of the job and at the place."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, Ended, LineFault, Nanos, Outcome
from tapewire.line.faults.plan import FaultPlan, Wire
from tapewire.line.transport import Fault
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job, Wait
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Act, Direction, OperatorAct, draw
from tapewire.sim.switches import Settings
from tapewire.sim.trial import Trial
from tapewire.sim.undetectable import Excuses

PROGRAM = b"%\nN1 X1\nN2 X2\nM30\n%"


Words = dict[str, str] | None


def case(protocol: str = "fanuc-b", host: Words = None, cnc: Words = None, **damage: Any) -> tuple[Evidence, Excuses]:
    """A transfer of PROGRAM of which the control has all, and one damage, in a job from 10 to 20 s."""
    drawn = draw(protocol, "clean", 1)
    plain = Settings(host=host or {}, cnc=cnc or {}, data=drawn.settings.data)
    scenario = dataclasses.replace(drawn, direction=Direction.SEND, settings=plain, has_signals=True)
    evidence = Evidence(program=PROGRAM, expected=PROGRAM)
    evidence.host.sent += PROGRAM
    evidence.cnc.brought += PROGRAM
    attempt = Attempt(began=10 * SECOND, armed=True, place=0, heard=0, brought=0, got=len(PROGRAM))
    attempt.delivered += PROGRAM
    evidence.attempts.append(attempt)
    evidence.jobs.append(Job(began=10 * SECOND, attempts_before=0, complete=False, ended=20 * SECOND))
    if damage:
        plan: dict[str, Any] = {
            "moment": 15 * SECOND,
            "kind": "test",
            "wire": Wire.FROM_HOST,
            "place": 5,
            "sent": b"X",
            "arrived": (),
        }
        evidence.damages.append(Damage(**{**plan, **damage}))
    return evidence, Excuses(scenario, evidence)


def spoil(evidence: Evidence, place: int, byte: bytes, *, brought: bool) -> bytes:
    """The control delivers another character; `brought`: because it came so."""
    spoilt = PROGRAM[:place] + byte + PROGRAM[place + 1 :]
    evidence.attempts[0].delivered[:] = spoilt
    if brought:
        evidence.cnc.brought[:] = spoilt
    return spoilt


def test_a_flip_excuses_what_came_of_it_and_nothing_that_the_control_made_of_itself() -> None:
    flip: dict[str, Any] = {"place": 6, "sent": b"X", "arrived": (b"Z",)}
    evidence, excuses = case(**flip)
    got = spoil(evidence, 5, b"Z", brought=True)
    assert excuses.content(evidence.attempts[0], 5, got) == "flip without parity"
    evidence, excuses = case(**flip)
    got = spoil(evidence, 5, b"Z", brought=False)
    assert excuses.content(evidence.attempts[0], 5, got) == ""


def test_a_flip_excuses_no_host_that_sent_another_program() -> None:
    evidence, excuses = case(place=6, sent=b"X", arrived=(b"Z",))
    got = spoil(evidence, 5, b"Z", brought=True)
    evidence.host.sent[:] = PROGRAM[6:] + PROGRAM
    assert excuses.content(evidence.attempts[0], 5, got) == ""


@pytest.mark.parametrize(("moment", "excused"), [(5 * SECOND, False), (15 * SECOND, True), (25 * SECOND, False)])
def test_a_lost_code_counts_in_the_time_of_its_job(moment: Nanos, excused: bool) -> None:
    evidence, excuses = case(moment=moment, wire=Wire.FROM_CONTROL, place=1, sent=b"\x11")
    assert bool(excuses.told_wrongly(evidence.jobs[0])) is excused


@pytest.mark.parametrize(("missing", "excused"), [(1, True), (2, False)])
def test_no_more_is_missing_than_was_lost(missing: int, excused: bool) -> None:
    evidence, excuses = case(sent=b"X", arrived=())
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], missing)) is excused


@pytest.mark.parametrize(("surplus", "excused"), [(1, True), (2, False)])
def test_no_more_is_there_than_was_made(surplus: int, excused: bool) -> None:
    evidence, excuses = case(sent=b"X", arrived=(b"XX",))
    assert excuses.more(evidence.attempts, surplus) == "doubled character" * excused


@pytest.mark.parametrize(("moment", "excused"), [(5, False), (25, True), (35, False)])
def test_what_is_made_counts_as_long_as_the_control_reads(moment: int, excused: bool) -> None:
    """The host has ended at 20 s, the control does at 30 s."""
    evidence, excuses = case(moment=moment * SECOND, place=0, sent=b"", arrived=(b"X",))
    evidence.control_ends.append((30 * SECOND, Outcome.CANCELLED))
    assert excuses.more(evidence.attempts, 1) == "character out of nothing" * excused


@pytest.mark.parametrize(("heard", "excused"), [(b"\x11\x13", True), (b"\x11\x13\x11", False)])
def test_who_waits_for_ever_must_not_have_heard_what_was_said_last(heard: bytes, excused: bool) -> None:
    lost = Fault(fault=LineFault.PARITY, byte=0x10)
    evidence, excuses = case(wire=Wire.FROM_CONTROL, place=3, sent=b"\x11", arrived=(lost,))
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    wait = Wait(who=("host", "control"), job=job, attempt=attempt, said=b"\x11\x13\x11", heard=heard)
    assert bool(excuses.waiting("host", wait)) is excused
    assert bool(excuses.waiting("control", wait)) is excused


def test_a_control_alone_waits_for_reset_only_behind_a_job_that_is_not_complete() -> None:
    evidence, excuses = case()
    wait = Wait(who=("control",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"", heard=b"")
    assert excuses.waiting("control", wait) == "the host's job is over, and the control waits for RESET"
    evidence.jobs[0].complete = True
    assert excuses.waiting("control", wait) == ""


@pytest.mark.parametrize(
    ("told", "alarm", "got", "excused"),
    [
        ("at-reset", 15, len(PROGRAM), True),
        ("at-once", 15, len(PROGRAM), False),
        ("at-reset", 5, len(PROGRAM), False),
        ("at-reset", 15, len(PROGRAM) - 1, False),
    ],
)
def test_an_alarm_behind_a_program_that_is_whole(told: str, alarm: int, got: int, excused: bool) -> None:
    """6.4 note 1: nothing of it is told before RESET, and the host is complete."""
    evidence, excuses = case(cnc={"alarm": told})
    evidence.jobs[0].complete = True
    evidence.attempts[0].got = got
    evidence.note_act("alarm", alarm * SECOND)
    wait = Wait(who=("control",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"", heard=b"")
    assert (excuses.waiting("control", wait) == Undetectable.SILENT_ALARM) is excused


@pytest.mark.parametrize(
    ("pulled", "said", "er", "excused"),
    [
        (15, b"\x11", "hidden", True),
        (15, b"\x11", "wired", False),
        (15, b"\x11\x13", "hidden", True),
        (5, b"\x11", "hidden", False),
        (14, b"\x11\x13", "hidden", False),
        (14, b"\x11", "hidden", True),
        (18, b"\x11", "hidden", False),
    ],
)
def test_the_end_of_a_reading_whose_cable_was_pulled(pulled: int, said: bytes, er: str, excused: bool) -> None:
    """The control ends at 17 s, and its last word may be a stop. The cable is out for 2 s.

    Where ER shows the end, nothing is excused.
    """
    evidence, excuses = case(host={"er": er}, moment=pulled * SECOND, kind="pulled cable", place=0, sent=b"")
    evidence.control_ends.append((17 * SECOND, Outcome.COMPLETE))
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=said, heard=said)
    assert bool(excuses.waiting("host", wait)) is excused


def test_a_control_that_left_while_it_held_its_host() -> None:
    evidence, excuses = case("fanuc-a-expansion", place=0, sent=b"", arrived=(Fault(fault=LineFault.BREAK),))
    noise = b"\x15\x11 "
    evidence.host.brought += b"\x11 31\r\x13 33\r" + noise
    brought = len(evidence.host.brought)
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"", heard=b"", brought=brought)
    assert excuses.waiting("host", wait) == "", "it has not left"
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    gave_up = "a control that gave up the line while it held the host"
    assert excuses.waiting("host", wait) == gave_up
    evidence.host.brought += b"\x11 31\r"
    assert excuses.waiting("host", wait) == gave_up, "what comes to the next job is not of this wait"
    wait = dataclasses.replace(wait, brought=len(evidence.host.brought))
    assert excuses.waiting("host", wait) == "", "it has let go"


def test_a_damage_outside_the_job_did_not_make_the_control_give_up_the_line() -> None:
    broken = Fault(fault=LineFault.BREAK)
    evidence, excuses = case("fanuc-a-expansion", moment=5 * SECOND, place=0, sent=b"", arrived=(broken,))
    evidence.host.brought += b"\x13 33\r"
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"", heard=b"", brought=5)
    assert excuses.waiting("host", wait) == ""


@pytest.mark.parametrize(("sent", "excused"), [(len(PROGRAM), True), (len(PROGRAM) - 1, False)])
def test_what_is_sent_in_the_next_attempt_is_not_what_was_handed_over_in_this_one(sent: int, excused: bool) -> None:
    evidence, excuses = case(sent=b"%", arrived=())
    evidence.host.sent[:] = PROGRAM[:sent]
    evidence.attempts[0].delivered[:] = PROGRAM[:-1]
    evidence.attempts.append(Attempt(began=30 * SECOND, armed=True, place=sent, heard=0, brought=0))
    evidence.host.sent += PROGRAM
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"\x11", heard=b"\x11")
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(
    ("came", "delivered", "excused"),
    [(b"\x12", b"\x11", True), (b"X", b"\x11", True), (b"", b"\x11Z", False), (None, b"\x11", False)],
)
def test_a_code_of_the_host_read_as_text(came: bytes | None, delivered: bytes, excused: bool) -> None:
    """Bridgeport: the host answered what the control had not said."""
    damage: dict[str, Any] = (
        {} if came is None else {"wire": Wire.FROM_CONTROL, "sent": b"\x14", "arrived": (came,) if came else ()}
    )
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, **damage)
    attempt = evidence.attempts[0]
    attempt.delivered[:] = delivered
    attempt.got = len(delivered)
    evidence.host.sent[:] = evidence.cnc.brought[:] = b"\x11"
    assert bool(excuses.content(attempt, 0, delivered)) is excused
    assert bool(excuses.more([attempt], 1)) is excused


@pytest.mark.parametrize(
    ("delivered", "excused"),
    [(b"%\n*\x11", True), (b"%*\n\x11", True), (b"%\n*\x11\x11", False), (b"%\n*#\x11", False), (b"%\n*", False)],
)
def test_a_code_of_the_host_read_as_text_among_what_was_made(delivered: bytes, excused: bool) -> None:
    """One code was forged, one character made."""
    damage: dict[str, Any] = {"wire": Wire.FROM_CONTROL, "place": 0, "sent": b"", "arrived": (b"\x12",)}
    evidence, excuses = case("bridgeport", cnc={"mode": "L"}, **damage)
    evidence.damages.append(Damage(16 * SECOND, "noise", Wire.FROM_HOST, 0, b"", (b"*",)))
    attempt = evidence.attempts[0]
    attempt.delivered[:] = delivered
    attempt.got = len(delivered)
    assert bool(excuses.more([attempt], 2)) is excused
    assert not excuses.more([attempt], 3)


@pytest.mark.parametrize(
    ("after_ms", "asked", "excused"),
    [(5, 10, True), (5000, 10, False), (4000, 14, True), (4000, 0, False), (4500, 14, False)],
)
def test_a_name_that_came_otherwise(after_ms: int, asked: int, excused: bool) -> None:
    """The control asks when the host has answered its DC2, which may take it seconds."""
    moment = 10 * SECOND + after_ms * MILLISECOND
    evidence, excuses = case("bridgeport", moment=moment, wire=Wire.FROM_CONTROL, place=0, sent=b"", arrived=(b"~",))
    evidence.attempts[0].asked = asked * SECOND
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], 10)) is excused
    assert bool(excuses.short(evidence.attempts[0], evidence.jobs[0])) is excused


@pytest.mark.parametrize(("cut_short", "excused"), [([14], True), ([0], False), ([], False)])
def test_a_dat_whose_host_ended_in_the_middle(cut_short: list[int], excused: bool) -> None:
    """4.1: no mark says where a message begins, so the SYN of the next process ends the DAT, and here the sum fits."""
    evidence, excuses = case("fanuc-a")
    body = b"DAT%\nN1 X1\n07SYN\r"
    evidence.host.sent[:] = evidence.cnc.brought[:] = b"%02X" % (sum(body) & 0xFF) + body
    evidence.cut_short += cut_short
    attempt = evidence.attempts[0]
    attempt.delivered[:] = body[3:-1]
    assert bool(excuses.content(attempt, 8, body[3:-1])) is excused


@pytest.mark.parametrize(("last", "excused"), [(3, True), (4, False)])
def test_the_last_of_many_like_codes_was_lost(last: int, excused: bool) -> None:
    evidence, excuses = case("bridgeport", wire=Wire.FROM_CONTROL, place=3, sent=b"\x06", arrived=())
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    wait = Wait(who=("host",), job=job, attempt=attempt, said=b"\x06" * 3, heard=b"\x06" * 3, last_place=last)
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(
    ("before", "record", "lost", "excused"),
    [
        (b"\x11", b"M2\r\n\x17\x33", 6, True),
        (b"\x11", b"M2\r\n\x17\x33", 5, False),
        (b"\x11M2\r\n\x17\x33", b"\x17\x17", 2, True),
        (b"\x11M2\r\n\x17\x33", b"\x17\x17", 1, False),
        (b"\x11M2\r\n\x17\x33", b"M2\r\n", 4, False),
        (b"\x11", b"M2\r\n\x17\x33\x04", 7, True),
        (b"\x11", b"M2\r\n\x17\x33", 0, False),
    ],
)
def test_a_record_of_which_nothing_came(before: bytes, record: bytes, lost: int, excused: bool) -> None:
    evidence, excuses = case("bridgeport", place=1, sent=b"\x11", arrived=(b"\x11\x11",))
    evidence.host.sent[:] = sent = before + record
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    if lost:
        place = len(sent) - lost + 1
        evidence.damages.append(Damage(15 * SECOND, "pulled cable", Wire.FROM_HOST, place, sent[-lost:], ()))
    evidence.host.sent += b"\x11\x13"
    told = len(sent)
    wait = Wait(who=("host", "control"), job=job, attempt=attempt, said=b"\x06", heard=b"\x06", told=told)
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(
    ("after_ms", "sent", "excused"), [(5, b"\x11", True), (5, b"N1", False), (5000, b"\x11", False)]
)
def test_a_name_that_came_damaged_gets_nothing(after_ms: int, sent: bytes, excused: bool) -> None:
    broken = Fault(fault=LineFault.BREAK)
    moment = 10 * SECOND + after_ms * MILLISECOND
    evidence, excuses = case("bridgeport", moment=moment, wire=Wire.FROM_CONTROL, place=0, sent=b"", arrived=(broken,))
    evidence.host.sent[:] = sent
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"\x11", heard=b"\x11")
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(("lost", "excused"), [(b"\x11 31\r", True), (b"\x13 33\r", False)])
def test_a_control_that_left_after_its_dc1_was_lost(lost: bytes, excused: bool) -> None:
    evidence, excuses = case("fanuc-a-expansion", wire=Wire.FROM_CONTROL, sent=lost, arrived=())
    evidence.host.brought += b"\x13 33\r"
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=b"", heard=b"", brought=5)
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(
    ("told", "arrived", "excused"),
    [(2, (b"\x12",), True), (2, (), True), (3, (b"\x12",), False), (2, (b"\x11",), False)],
)
def test_the_code_that_resumes_a_punch_out_came_otherwise(told: int, arrived: tuple[bytes, ...], excused: bool) -> None:
    """It is the last one that the host said, and nobody says it again."""
    evidence, _ = case(place=2, sent=b"\x11", arrived=arrived)
    scenario = dataclasses.replace(draw("fanuc-b", "clean", 1), direction=Direction.RECEIVE)
    wait = Wait(who=("host", "control"), job=evidence.jobs[0], attempt=None, said=b"\x12", heard=b"\x12", told=told)
    assert bool(Excuses(scenario, evidence).waiting("host", wait)) is excused


@pytest.mark.parametrize(("who", "excused"), [(("host",), True), (("host", "control"), False)])
def test_a_reset_that_ended_the_waiting_is_not_what_the_host_took_for_a_stop(
    who: tuple[str, ...], excused: bool
) -> None:
    evidence, excuses = case(host={"er": "hidden", "posting": "off"})
    evidence.control_ends.append((20 * SECOND, Outcome.CANCELLED))
    heard = b"\x11\x13"
    wait = Wait(who=who, job=evidence.jobs[0], attempt=evidence.attempts[0], said=heard, heard=heard)
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(
    ("paused", "er", "who", "excused"),
    [
        (14, "hidden", ("host",), True),
        (14, "auto", ("host",), False),
        (16, "hidden", ("host",), False),
        (14, "hidden", ("host", "control"), False),
    ],
)
def test_a_punch_out_that_is_cut_short_while_cs_is_off(
    paused: int, er: str, who: tuple[str, ...], excused: bool
) -> None:
    """6.1.2 note. The control ends at 15 s, and the host holds it for two."""
    evidence, _ = case()
    drawn = draw("fanuc-b", "clean", 1)
    words = {"posting": "off", "pause": "cs", "er": er}
    drawn = dataclasses.replace(
        drawn,
        direction=Direction.RECEIVE,
        has_signals=True,
        settings=Settings(host=words, cnc={}, data=drawn.settings.data),
        acts=(OperatorAct(moment=paused * SECOND, act=Act.PAUSE, span=2 * SECOND),),
    )
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    wait = Wait(who=who, job=evidence.jobs[0], attempt=None, said=b"\x12", heard=b"\x12")
    assert bool(Excuses(drawn, evidence).waiting("host", wait)) is excused


@pytest.mark.parametrize(("at", "excused"), [(9, True), (7, False), (16, False)])
def test_er_that_no_pin_showed(at: int, excused: bool) -> None:
    """The reading lasts from 10 to 15 s, and such a pin has no contact for 2 s at the most."""
    evidence, excuses = case(host={"posting": "off"}, moment=at * SECOND, kind="DSR OFF", place=0, sent=b"")
    evidence.control_ends.append((15 * SECOND, Outcome.FAILED))
    heard = b"\x11\x13"
    wait = Wait(who=("host",), job=evidence.jobs[0], attempt=evidence.attempts[0], said=heard, heard=heard)
    assert bool(excuses.waiting("host", wait)) is excused


@pytest.mark.parametrize(("place", "stored", "excused"), [(1, b"", True), (2, b"", False), (1, b"O", False)])
def test_a_punch_out_whose_dc2_did_not_come(place: int, stored: bytes, excused: bool) -> None:
    evidence, _ = case(wire=Wire.FROM_CONTROL, place=place, sent=b"\x12", arrived=())
    evidence.jobs[0].stored += stored
    drawn = dataclasses.replace(draw("fanuc-b", "clean", 1), direction=Direction.RECEIVE)
    job, attempt = evidence.jobs[0], evidence.attempts[0]
    wait = Wait(who=("host",), job=job, attempt=attempt, said=b"\x14", heard=b"\x14")
    assert bool(Excuses(drawn, evidence).waiting("host", wait)) is excused


def test_a_control_does_not_say_of_itself_what_came_to_it() -> None:
    """What it claims to have at its end counts as far as so much was brought to it in this reading."""
    trial = Trial(
        dataclasses.replace(draw("fanuc-b", "clean", 1), direction=Direction.SEND),
        FaultPlan(name="none", why="nothing happens"),
    )
    trial.evidence.attempts.append(Attempt(began=0, armed=True, place=0, heard=0, brought=3))
    trial.evidence.cnc.brought += b"%\nN1 X1\n"
    trial._busy = True
    trial._cnc_event(Ended(outcome=Outcome.FAILED, reason="test", bytes_low=0, bytes_high=5000), 0)
    assert trial.evidence.attempts[0].got == 5


@pytest.mark.parametrize(
    ("came", "mode", "ended", "outcome", "excused"),
    [
        (b"\x04", "L", 15, Outcome.COMPLETE, True),
        (b"\x05", "L", 15, Outcome.COMPLETE, False),
        (b"\x04", "D", 15, Outcome.COMPLETE, False),
        (b"\x04", "L", 17, Outcome.COMPLETE, False),
        (b"\x04", "L", 15, Outcome.FAILED, False),
    ],
)
def test_an_end_code_out_of_noise(came: bytes, mode: str, ended: int, outcome: Outcome, excused: bool) -> None:
    """REMOTE LOAD: the control ends there and then, and its host goes on."""
    evidence, excuses = case("bridgeport", cnc={"mode": mode}, place=0, sent=b"", arrived=(came,))
    attempt = evidence.attempts[0]
    del attempt.delivered[3:]
    attempt.got = 3
    evidence.control_ends.append((ended * SECOND, outcome))
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], 8)) is excused


@pytest.mark.parametrize(
    ("brought", "who", "excused"),
    [(b"SET0200", "control", False), (b"SET2000", "control", True), (b"SET2000", "host", False)],
)
def test_a_control_whose_to_came_otherwise_may_go_on_behind_its_reset(brought: bytes, who: str, excused: bool) -> None:
    """Two characters of a SET changed places, and its sum is right."""
    total = b"%02X" % (sum(b"SET0200\r") & 0xFF)
    evidence, excuses = case("fanuc-a")
    evidence.host.sent[:] = total + b"SET0200\r"
    evidence.cnc.brought[:] = total + brought + b"\r"
    assert (excuses.stuck(who) == Undetectable.SUM) is excused
