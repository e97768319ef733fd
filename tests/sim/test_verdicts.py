"""What a host must have heard before it says complete, what it must not have heard, and what it counts."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from tapewire.engine import MILLISECOND, SECOND, LineFault, Nanos, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.line.transport import Fault
from tapewire.sim.checkers import judge
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job, Tap
from tapewire.sim.hearing import MOST_OBJECTIONS, Hearing, Objection, What
from tapewire.sim.scenarios import Act, Direction, Scenario, draw
from tapewire.sim.switches import Settings

PROGRAM = b"%\nN1 X1\nN2 X2\nM30\n%"
WHOLE = len(PROGRAM)

Words = dict[str, str]

BEGAN, STOP, ENDED = 11 * SECOND, 15 * SECOND, 16 * SECOND
"""DC1, or DC2, the last DC3, and the end of the job."""


def scenario(direction: Direction, protocol: str = "fanuc-b", host: Words | None = None) -> Scenario:
    drawn = draw(protocol, "clean", 1)
    plain = Settings(host=host or {}, cnc={}, data=drawn.settings.data)
    line = dataclasses.replace(drawn, baud=9600, path="uart-16550", window=2, has_signals=True)
    return dataclasses.replace(line, direction=direction, settings=plain)


def sent(*objections: Objection, **job: Any) -> Evidence:
    """PROGRAM is with the control, and the job complete."""
    evidence = Evidence(program=PROGRAM, expected=PROGRAM)
    evidence.host.sent += PROGRAM
    evidence.cnc.brought += PROGRAM
    attempt = Attempt(began=10 * SECOND, armed=True, place=0, heard=0, brought=0, got=WHOLE)
    attempt.delivered += PROGRAM
    evidence.attempts.append(attempt)
    ended = {"complete": True, "low": WHOLE, "high": WHOLE, "got_at_end": WHOLE, "handed": WHOLE}
    heard = {"ended": ENDED, "begun": BEGAN, "stop": STOP}
    evidence.jobs.append(Job(**{"began": 10 * SECOND, "attempts_before": 0, **ended, **heard, **job}))
    evidence.hearing.objections.extend(objections)
    return evidence


def stored(*objections: Objection, heard: bytes = b"\x12" + PROGRAM + b"\x14", **job: Any) -> Evidence:
    """The control has punched PROGRAM out, and it is stored."""
    evidence = sent(*objections, stored=bytearray(PROGRAM), reported=WHOLE, brought=len(heard), **job)
    evidence.host.brought += heard
    return evidence


def rules(evidence: Evidence, direction: Direction, protocol: str = "fanuc-b", host: Words | None = None) -> list[str]:
    found = judge(scenario(direction, protocol, host), evidence)
    return [finding.rule for finding in found if not finding.undetectable]


AGAINST = ["complete means that nothing was said against it"]
UNHEARD = ["complete means that its end was heard"]
AS_ONE = ["complete means that it came as one program"]


def objection(what: What, moment: Nanos, *, begun: Nanos = BEGAN, stop: Nanos = STOP) -> Objection:
    return Objection(what, moment, begun, stop)


def test_what_nobody_speaks_against_is_complete() -> None:
    assert rules(sent(), Direction.SEND) == []
    assert rules(stored(), Direction.RECEIVE) == []


@pytest.mark.parametrize("what", [What.RESET, What.REFUSAL])
@pytest.mark.parametrize(
    ("moment", "host", "found"),
    [
        (ENDED - 1, {}, True),
        (ENDED, {}, False),  # STOP and the half second of notice_time are long over
        (ENDED - 1, {"posting": "off"}, True),
    ],
)
def test_6_1_2_a_host_that_heard_syn_or_nak_does_not_say_complete(
    what: What, moment: Nanos, host: Words, found: bool
) -> None:
    assert rules(sent(objection(what, moment)), Direction.SEND, host=host) == AGAINST * found


@pytest.mark.parametrize(
    ("after", "host", "found"),
    [
        (400, {}, True),
        (600, {}, False),
        (400, {"notice_time": "0.2"}, False),
        (400, {"posting": "off"}, False),
    ],
)
def test_6_1_2_it_listens_for_them_behind_the_last_dc3(after: int, host: Words, found: bool) -> None:
    heard = objection(What.REFUSAL, STOP + after * MILLISECOND)
    early = {"ended": STOP + 10 * MILLISECOND}
    assert rules(sent(heard, **early), Direction.SEND, host=host) == AGAINST * found
    cut = sent(heard, **early)
    cut.note_act("power cut: control", STOP)
    assert AGAINST[0] not in rules(cut, Direction.SEND, host=host), "ER fell, and nothing more is to come"


def test_what_is_said_of_another_transfer_is_not_said_of_this_one() -> None:
    assert rules(sent(objection(What.REFUSAL, ENDED - 1, begun=9 * SECOND)), Direction.SEND) == []
    assert rules(sent(objection(What.RESET, ENDED - 1)), Direction.SEND, host={"syn_at_end": "complete"}) == []


def test_what_comes_behind_a_syn_that_is_the_end_comes_too_late() -> None:
    early = {"ended": STOP + 10 * MILLISECOND}
    nak = objection(What.REFUSAL, STOP + 10 * MILLISECOND)
    syn = objection(What.RESET, STOP + 10 * MILLISECOND)
    host = {"syn_at_end": "complete"}
    assert rules(sent(syn, nak, **early), Direction.SEND, host=host) == []
    assert rules(sent(nak, **early), Direction.SEND, host=host) == AGAINST


def test_nothing_of_remote_load_is_certain_before_the_control_says_something() -> None:
    load = dataclasses.replace(
        scenario(Direction.SEND, "bridgeport"),
        settings=Settings(host={}, cnc={"mode": "L"}, data=scenario(Direction.SEND).settings.data),
    )
    assert [finding.rule for finding in judge(load, failed())] == []
    link = dataclasses.replace(load, settings=dataclasses.replace(load.settings, cnc={}))
    assert [finding.rule for finding in judge(link, failed())] == LONG_BEFORE
    assert [finding.rule for finding in judge(link, failed(low=4000 - 256))] == []


def test_damage_behind_the_last_dc3_may_have_been_a_word_and_before_it_was_none() -> None:
    heard = objection(What.DAMAGE, ENDED - 1)
    assert rules(sent(heard), Direction.SEND) == AGAINST
    assert rules(sent(heard), Direction.SEND, host={"posting": "off"}) == []
    before = objection(What.DAMAGE, STOP - 1, stop=12 * SECOND)
    assert rules(sent(before), Direction.SEND) == []


def test_damage_anywhere_in_a_punch_out_leaves_none_complete() -> None:
    damaged = objection(What.DAMAGE, 12 * SECOND, stop=-1)
    assert rules(stored(damaged, stop=-1), Direction.RECEIVE) == AGAINST
    of_the_name = objection(What.DAMAGE, 12 * SECOND, begun=10 * SECOND + 1, stop=-1)
    assert rules(stored(of_the_name, stop=-1), Direction.RECEIVE) == [], "another DC2 came behind it"


def test_6_1_1_a_reading_ends_with_a_dc3_behind_the_last_dc1() -> None:
    assert rules(sent(stop=BEGAN - 1), Direction.SEND) == UNHEARD
    assert rules(sent(stop=BEGAN - 1), Direction.SEND, host={"syn_at_end": "complete"}) == []


@pytest.mark.parametrize("code", [b"\x11", b"\x12", b"\x13", b"\x16", b"\x95"])
def test_6_2_a_punch_out_that_holds_a_code_is_not_complete(code: bytes) -> None:
    assert rules(stored(heard=b"\x12" + PROGRAM[:9] + code + PROGRAM[9:] + b"\x14"), Direction.RECEIVE) == AS_ONE


@pytest.mark.parametrize(("behind", "found"), [(b"", False), (b"\x00\x7f\r\n", False), (b"N3", True), (b"\x16", False)])
def test_a_punch_out_with_text_behind_its_dc4_is_not_complete(behind: bytes, found: bool) -> None:
    heard = b"\x12" + PROGRAM + b"\x14" + behind
    assert rules(stored(heard=heard), Direction.RECEIVE) == AS_ONE * found


def test_what_comes_when_the_job_has_ended_belongs_to_none() -> None:
    evidence = stored()
    evidence.host.brought += b"N3"
    assert rules(evidence, Direction.RECEIVE) == []


def test_a_complete_job_counts_all_of_it() -> None:
    for low, high in ((WHOLE - 1, WHOLE), (WHOLE - 1, WHOLE - 1)):
        assert rules(sent(low=low, high=high), Direction.SEND) == ["complete counts the whole program"]


def test_what_is_reported_is_what_is_stored() -> None:
    rule = ["what is reported is what is stored"]
    assert rules(_reported(WHOLE - 1), Direction.RECEIVE) == rule
    assert rules(_reported(WHOLE + 1), Direction.RECEIVE) == rule


def _reported(count: int) -> Evidence:
    evidence = stored()
    evidence.jobs[0].reported = count
    return evidence


def failed(**job: Any) -> Evidence:
    """4,000 characters are with the control, and the job is not complete."""
    got = {"complete": False, "low": 0, "high": 4000, "handed": 4000, "got_at_end": 4000}
    evidence = sent(**{**got, **job})
    evidence.program = evidence.expected = b"X" * 5000
    evidence.attempts[0].delivered[:] = b"X" * 4000
    evidence.attempts[0].got = 4000
    evidence.note_act(Act.RESET.value, ENDED - 1)
    return evidence


LONG_BEFORE = ["what came long before the end is certain"]


def test_what_had_come_long_before_the_end_is_certain() -> None:
    assert rules(failed(), Direction.SEND) == LONG_BEFORE
    assert rules(failed(low=3800), Direction.SEND) == [], "what the line carries in 300 ms may be under way"
    slept = failed()
    slept.sleeps.append((12 * SECOND, 13 * SECOND))
    assert rules(slept, Direction.SEND) == []
    hit = failed()
    hit.damages.append(Damage(12 * SECOND, "test", Wire.FROM_CONTROL, 1, b"\x13", (Fault(fault=LineFault.PARITY),)))
    assert rules(hit, Direction.SEND) == [], "it may have been the end"


def test_no_more_counts_than_was_handed_over() -> None:
    evidence = failed(low=3900, handed=3999)
    assert rules(evidence, Direction.SEND) == ["no more counts than was handed over"]


def test_only_a_person_or_the_control_gives_a_job_up() -> None:
    evidence = failed(low=3900, given_up=True)
    assert rules(evidence, Direction.SEND) == []
    evidence.acts.clear()
    assert rules(evidence, Direction.SEND) == ["what nothing disturbs completes", "what counts as given up was"]
    evidence.control_ends.append((ENDED - 1, Outcome.FAILED))
    assert rules(evidence, Direction.SEND) == ["what nothing disturbs completes"]


def test_a_punch_out_stops_when_its_host_says_so() -> None:
    """16 characters may follow DC3, and the four of its end."""
    evidence = stored()
    for run, found in ((20, 0), (21, 1)):
        evidence.cnc.longest_run = run
        assert rules(evidence, Direction.RECEIVE) == ["a punch-out stops when it is told to"] * found


def test_each_stop_counts_for_itself_and_dc2_begins_anew() -> None:
    tap = Tap(stops=frozenset(b"\x13"), goes=frozenset(b"\x11"), announces=frozenset(b"\x12"))
    for heard, written in ((b"\x13", b"abc"), (b"\x13", b"d"), (b"\x11\x13", b"ef"), (b"\x13", b"\x12ghijkl")):
        tap._hear(heard, 0)
        tap._write(written)
    assert tap.longest_run == 4


def test_what_is_heard_is_bounded_and_says_behind_what_it_came() -> None:
    hearing = Hearing(begins=frozenset(b"\x11"), stops=frozenset(b"\x13"), refuses=frozenset(b"\x15\x16\x96"))
    hearing.hear(b"\x16", 1)
    hearing.hear(b"\x11AB\x13", 2)
    hearing.hear(b"\x96\x15", 3)
    hearing.hear(Fault(fault=LineFault.PARITY), 4)
    reset, refusal, damage = (What.RESET, What.REFUSAL, What.DAMAGE)
    expected = [(reset, 1, -1, -1), (reset, 3, 2, 2), (refusal, 3, 2, 2), (damage, 4, 2, 2)]
    assert hearing.objections == [Objection(*each) for each in expected]
    for moment in range(2 * MOST_OBJECTIONS):
        hearing.hear(b"\x15", moment)
    assert len(hearing.objections) == MOST_OBJECTIONS


def second(**job: Any) -> Evidence:
    """Behind a complete job another one, from 20 to 30 s, in which the control has begun, and which fails."""
    evidence = sent()
    evidence.attempts.append(Attempt(began=21 * SECOND, armed=True, place=WHOLE, heard=0, brought=WHOLE))
    failed = {"complete": False, "begun": 22 * SECOND, "stop": 23 * SECOND}
    evidence.jobs.append(Job(**{"began": 20 * SECOND, "attempts_before": 1, "ended": 30 * SECOND, **failed, **job}))
    return evidence


def test_what_happened_to_one_job_costs_no_later_one() -> None:
    rule = ["what nothing disturbs completes"]
    evidence = second()
    evidence.note_act(Act.RESET.value, 12 * SECOND)
    evidence.sleeps.append((12 * SECOND, 13 * SECOND))
    for protocol in ("fanuc-b", "fanuc-b-expansion", "bridgeport"):
        assert rules(evidence, Direction.SEND, protocol) == rule
    assert rule[0] in rules(evidence, Direction.SEND, "fanuc-a")


def test_a_later_job_that_something_touched_may_fail() -> None:
    acted, slept, hit, unasked = second(), second(), second(), second()
    acted.note_act(Act.ABORT.value, 25 * SECOND)
    slept.sleeps.append((15 * SECOND, 25 * SECOND))
    hit.damages.append(Damage(25 * SECOND, "test", Wire.FROM_HOST, 1, b"X", (b"Y",)))
    unasked.attempts[1].armed = False
    for evidence in (acted, slept, hit, unasked):
        assert rules(evidence, Direction.SEND) == []
