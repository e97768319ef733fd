"""What is a violation in protocol A and what is none: judged by what happened, and not by what the ends say."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from tapewire.engine import SECOND, LineFault, Outcome
from tapewire.line.faults.plan import FaultPlan, Wire
from tapewire.line.transport import Fault
from tapewire.sim.checkers import judge
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job
from tapewire.sim.frames import last_data
from tapewire.sim.scenarios import Act, Direction, Finish, Scenario, draw
from tapewire.sim.switches import Settings
from tapewire.sim.trial import Trial

PROGRAM = b"%\nN1 X1\nN2 X2\nM30\n%"

Words = dict[str, str]


def scenario(protocol: str = "fanuc-a", host: Words | None = None) -> Scenario:
    drawn = draw(protocol, "clean", 1)
    plain = Settings(host=host or {}, cnc={}, data=drawn.settings.data)
    return dataclasses.replace(drawn, direction=Direction.SEND, settings=plain, has_signals=True)


def transfer(**job: Any) -> Evidence:
    """A job from 10 to 20 s, and all of PROGRAM out of the buffer."""
    evidence = Evidence(program=PROGRAM, expected=PROGRAM)
    evidence.host.sent += PROGRAM
    evidence.cnc.brought += PROGRAM
    whole = len(PROGRAM)
    attempt = Attempt(
        began=10 * SECOND, armed=True, place=0, heard=0, brought=0, got=whole, delivered=bytearray(PROGRAM)
    )
    evidence.attempts.append(attempt)
    ended = {
        "complete": True,
        "low": whole,
        "high": whole,
        "got_at_end": whole,
        "delivered_at_end": whole,
        "handed": whole,
    }
    evidence.jobs.append(Job(**{"began": 10 * SECOND, "attempts_before": 0, "ended": 20 * SECOND, **ended, **job}))
    return evidence


def failed() -> Evidence:
    """A job of which nothing came."""
    evidence = transfer(complete=False, low=0, high=0, got_at_end=0, delivered_at_end=0)
    evidence.attempts[0].delivered.clear()
    evidence.attempts[0].got = 0
    return evidence


def rules(evidence: Evidence, protocol: str = "fanuc-a", host: Words | None = None) -> list[str]:
    return [finding.rule for finding in judge(scenario(protocol, host), evidence) if not finding.undetectable]


EMPTY = ["complete means taken out of the buffer"]
UNDISTURBED = ["what nothing disturbs completes"]
REPEATED = ["what can be asked for again is"]
CERTAIN = ["what was asked behind is certain"]
NO_ALARM = ["what nothing disturbs ends in no alarm"]


@pytest.mark.parametrize(
    ("pressed", "word", "broken"),
    [
        (None, "cancelled", EMPTY),
        (None, "complete", EMPTY),
        (Act.RESET, "cancelled", EMPTY),
        (Act.RESET, "complete", []),
        (Act.ABORT, "complete", EMPTY),
    ],
)
def test_complete_means_that_the_buffer_is_empty(pressed: Act | None, word: str, broken: list[str]) -> None:
    evidence = transfer(delivered_at_end=len(PROGRAM) - 1)
    if pressed is not None:
        evidence.note_act(pressed.value, 19 * SECOND)
    assert rules(evidence, host={"rst_at_end": word}) == broken
    assert rules(transfer()) == []
    assert EMPTY[0] not in rules(transfer(delivered_at_end=0), "fanuc-b"), "protocol B says nothing of its buffer"


@pytest.mark.parametrize(
    ("acts", "broken"),
    [
        ((), UNDISTURBED),
        ((Act.FEED_HOLD, Act.SINGLE_BLOCK), UNDISTURBED),
        ((Act.STALL, Act.FEED_HOLD), UNDISTURBED),
        ((Act.STALL, Act.STALL), []),
        ((Act.RESET,), []),
        ((Act.FEED_HOLD, Act.ABORT), []),
    ],
)
def test_an_operator_who_holds_the_feed_disturbs_nothing(acts: tuple[Act, ...], broken: list[str]) -> None:
    evidence = failed()
    for act in acts:
        evidence.note_act(act.value, 15 * SECOND)
    assert rules(evidence) == broken


def test_what_the_operator_ends_because_it_does_not_end_was_left_alone() -> None:
    evidence = failed()
    evidence.note_tidying(Act.ABORT.value, 20 * SECOND)
    assert rules(evidence) == UNDISTURBED


@pytest.mark.parametrize(
    ("first", "second", "armed", "broken"),
    [
        (Act.ABORT.value, None, True, UNDISTURBED),
        (Act.RESET.value, None, True, UNDISTURBED),
        (Act.ABORT.value, Act.RESET.value, True, []),
        (Act.ABORT.value, None, False, []),
        ("power cut: control", None, True, []),
    ],
)
def test_a_second_job_completes_whatever_persons_did_to_the_first(
    first: str, second: str | None, armed: bool, broken: list[str]
) -> None:
    evidence = failed()
    evidence.note_act(first, 15 * SECOND)
    evidence.jobs.append(Job(began=30 * SECOND, attempts_before=1, complete=False, ended=40 * SECOND))
    evidence.attempts.append(Attempt(began=30 * SECOND, armed=armed, place=0, heard=0, brought=0))
    if second is not None:
        evidence.note_act(second, 35 * SECOND)
    assert rules(evidence) == broken


@pytest.mark.parametrize(
    ("outcome", "act", "broken"),
    [
        (Outcome.FAILED, Act.RESET, NO_ALARM),
        (Outcome.CANCELLED, Act.RESET, []),
        (Outcome.FAILED, Act.ALARM, []),
    ],
)
def test_an_alarm_has_a_reason(outcome: Outcome, act: Act, broken: list[str]) -> None:
    evidence = failed()
    evidence.note_act(act.value, 15 * SECOND)
    evidence.control_ends.append((50 * SECOND, outcome))
    assert rules(evidence) == broken


MARK = Fault(fault=LineFault.FRAMING, byte=0x41)


@pytest.mark.parametrize(
    ("protocol", "wire", "kind", "sent", "arrived", "broken"),
    [
        ("fanuc-a", Wire.FROM_HOST, "bit flip", b"X", (b"Z",), REPEATED),
        ("fanuc-a", Wire.FROM_HOST, "lost character", b"X", (), REPEATED),
        ("fanuc-a", Wire.FROM_HOST, "noise", b"", (b"X",), REPEATED),
        ("fanuc-a", Wire.FROM_HOST, "noise", b"", (b"\x00",), []),
        ("fanuc-a", Wire.FROM_HOST, "lost character", b"\r", (), []),
        ("fanuc-a", Wire.FROM_HOST, "framing error", b"X", (MARK,), []),
        ("fanuc-a", Wire.FROM_CONTROL, "framing error", b"X", (MARK,), REPEATED),
        ("fanuc-a", Wire.FROM_CONTROL, "lost character", b"\r", (), REPEATED),
        ("fanuc-a", Wire.FROM_CONTROL, "burst", b"XY", (b"ZZ",), []),
        ("fanuc-a", Wire.FROM_CONTROL, "pulled cable", b"X", (), []),
        ("fanuc-a-expansion", Wire.FROM_HOST, "lost character", b"X", (), []),
        ("fanuc-a-expansion", Wire.FROM_CONTROL, "framing error", b"X", (MARK,), []),
        ("fanuc-a-expansion", Wire.FROM_HOST, "bit flip", b"X", (b"Z",), REPEATED),
    ],
)
def test_one_character_costs_no_job(
    protocol: str, wire: Wire, kind: str, sent: bytes, arrived: tuple[bytes | Fault, ...], broken: list[str]
) -> None:
    evidence = failed()
    evidence.damages.append(Damage(15 * SECOND, kind, wire, 5 if sent else 0, sent, arrived))
    assert rules(evidence, protocol) == broken


def test_noise_arms_no_host_of_protocol_a() -> None:
    """Of protocol B a character on the line is one of a program."""
    evidence = transfer()
    attempt = dataclasses.replace(
        evidence.attempts[0], began=30 * SECOND, armed=False, got=1, delivered=bytearray(b"X")
    )
    evidence.attempts.append(attempt)
    evidence.damages.append(Damage(35 * SECOND, "noise", Wire.FROM_HOST, 0, b"", (b"X",)))
    unarmed = "nothing is sent that was not armed"
    assert unarmed in rules(evidence)
    assert unarmed not in rules(evidence, "fanuc-b")


LOST = Damage(15 * SECOND, "lost character", Wire.FROM_CONTROL, 5, b"X", ())


@pytest.mark.parametrize(
    ("protocol", "count", "ne", "broken"),
    [
        ("fanuc-a", 3, "10", REPEATED),
        ("fanuc-a", 4, "10", []),
        ("fanuc-a", 2, "3", []),
        ("fanuc-a", 1, "3", REPEATED),
        ("fanuc-a", 1, "0", []),
        ("fanuc-a-expansion", 1, "10", []),
    ],
)
def test_some_characters_cost_no_job_where_many_repetitions_are_allowed(
    protocol: str, count: int, ne: str, broken: list[str]
) -> None:
    evidence = failed()
    evidence.damages += [LOST] * count
    assert rules(evidence, protocol, {"Ne": ne}) == broken


def test_two_characters_that_cancel_in_a_message_may_cost_a_job() -> None:
    evidence = failed()
    evidence.damages += [LOST] * 2
    evidence.cnc.sent += b"ECGTD\r"
    evidence.host.brought += b"ECGUC\r"
    assert rules(evidence) == []


def test_the_last_dat_is_found_in_both_codes_and_by_its_end() -> None:
    iso = bytes((0x30, 0x30, 0x44, 0x41, 0xD4))
    assert last_data(b"07SYN\r00DAT12345\r00SET\r", b"\r") == 5
    assert last_data(b"07SYN\r00DAT12345\r00DAT1", b"\r") == 1
    assert last_data(b"07SYN\x03" + iso + b"12\r45\x03", b"\x03") == 5
    assert last_data(b"07SYN\r", b"\r") == 0


@pytest.mark.parametrize(("low", "broken"), [(0, CERTAIN), (11, CERTAIN), (12, [])])
def test_what_the_control_has_asked_behind_is_certain(low: int, broken: list[str]) -> None:
    """Of 19 bytes the last DAT holds 7."""
    evidence = transfer(complete=False, low=low)
    evidence.host.sent[:] = b"07SYN\r00DAT" + PROGRAM[:12] + b"\r00DAT" + PROGRAM[12:] + b"\r"
    evidence.note_act(Act.ABORT.value, 15 * SECOND)
    assert rules(evidence) == broken
    assert rules(evidence, "fanuc-a-expansion") == []
    evidence.damages.append(LOST)
    assert rules(evidence) == []


@pytest.mark.parametrize("protocol", ["fanuc-a", "fanuc-a-expansion"])
def test_a_control_that_asks_and_was_given_nothing_gets_what_is_armed_later(protocol: str) -> None:
    drawn = dataclasses.replace(
        draw(protocol, "clean", 1), size=300, baud=9600, acts=(), finish=Finish.START_UNARMED, direction=Direction.SEND
    )
    evidence = Trial(drawn, FaultPlan(name="clean", why="for the test")).run()
    assert [job.complete for job in evidence.jobs] == [True, True]
    assert [bytes(attempt.delivered) for attempt in evidence.attempts] == [drawn.expected] * 2
    assert judge(drawn, evidence) == []
