"""What must hold of every transfer, and how what a protocol cannot see is told from what an engine did wrong.

Each rule looks at the evidence and either is satisfied, or names what the protocol's own rules cannot detect
(`undetectable.py` decides that from what was injected), or reports a violation. Nothing is waved through: an excuse
has a name, and is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tapewire.engine import Nanos, Outcome
from tapewire.line.faults.plan import Burst, DoubleCharacter, FlipBits, Framing, Lose, Noise, Wire
from tapewire.line.pacing import character_time
from tapewire.line.paths import PATHS, TransmitterEmpty
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.bridgeport.records import RECORD_BYTES
from tapewire.protocols.delivery import HEARD_LATE, HEARD_LATE_CHARACTERS
from tapewire.protocols.settings import End
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job
from tapewire.sim.frames import last_data
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Act, Direction, Scenario
from tapewire.sim.undetectable import Excuses, first_difference
from tapewire.sim.unnumbered import never_repeated, packets_n
from tapewire.sim.verdicts import against, end_unheard, left_alone_at_last, reported_well, unlike_what_came

__all__ = ["FOOTPRINT_BYTES", "NO_ENGINE_BREAKS", "Finding", "judge"]

NO_ENGINE_BREAKS: Final = "no engine breaks"

_END_CODES: Final = frozenset(b"\x0d\x8d\x03")

_OUTWAITED: Final = frozenset({Act.FEED_HOLD.value, Act.SINGLE_BLOCK.value, Act.STALL.value})
"""A hold of protocol A lasts as long as it lasts (4.3 (5), 5.3 3)), and no computer stalls for as long as To (4.5)."""

_PERSONS: Final = frozenset(act.value for act in Act)

_OF_ONE_CHARACTER: Final = frozenset(fault.kind for fault in (FlipBits, Burst, Lose, DoubleCharacter, Framing, Noise))

_FAR_BELOW_NE: Final = 3
"""So many characters that are hit cost six repetitions at the most: 10 are allowed (Ne, 4.5)."""

_PRESSED: Final = frozenset(act.value for act in (Act.RESET, Act.ALARM, Act.FEED_HOLD, Act.SINGLE_BLOCK, Act.ABORT))
_GIVING_UP: Final = frozenset({Act.ABORT.value, Act.RESET.value})

FOOTPRINT_BYTES: Final = 300 * 1024
"""An engine holds no more beside the program: buffers of 8 KB, ten packets, tables, its last events."""


@dataclass(frozen=True, slots=True)
class Finding:
    """`rule` did not hold. `undetectable` names why nobody could have noticed; empty: it is a violation."""

    rule: str
    what: str
    undetectable: str = ""


def judge(scenario: Scenario, evidence: Evidence) -> list[Finding]:
    """Everything that does not hold."""
    excuses = Excuses(scenario, evidence)
    return [
        Finding(rule, what, excuse)
        for rules in (_always, _send if scenario.direction is Direction.SEND else _receive)
        for rule, what, excuse in rules(scenario, evidence, excuses)
    ]


Broken = tuple[str, str, str]


def _always(scenario: Scenario, evidence: Evidence, excuses: Excuses) -> Iterator[Broken]:
    if evidence.broken:
        yield NO_ENGINE_BREAKS, evidence.broken, ""
    if evidence.disagreement:
        yield "both ends believe the same parameters", evidence.disagreement, excuses.told_wrongly(evidence.jobs[-1])
    if evidence.footprint > FOOTPRINT_BYTES:
        yield "memory is bounded", f"{evidence.footprint:,} bytes", ""
    if evidence.host.after_stop:
        yield "nothing is handed over after a stop", f"{evidence.host.after_stop} characters", ""
    for job in evidence.jobs:
        if not job.complete and _nothing_disturbs(scenario, evidence, job):
            yield "what nothing disturbs completes", f"not complete: {job.reason}", ""
    if _alarm_of_nothing(scenario, evidence):
        yield "what nothing disturbs ends in no alarm", "the control's reading ended in one", ""
    if _must_be_repeated(scenario, evidence) and not evidence.jobs[0].complete:
        what = f"not complete after {evidence.damages[0].name}: {evidence.jobs[0].reason}"
        yield "what can be asked for again is", what, excuses.hit_twice(evidence.jobs[0])
    for wait in evidence.waits:
        for who in wait.who:
            yield "nobody waits for ever", f"the {who} waits, and nothing more is to come", excuses.waiting(who, wait)
    for who in evidence.stuck:
        yield "what is ended by hand ends", f"the {who} did not end after RESET and giving up", excuses.stuck(who)
    for moment, count, allowed in evidence.overruns:
        if count > allowed:
            what = f"{count} characters after a stop at {moment / 1e9:.3f} s, {allowed} allowed"
            excuse = _overrun_excuse(scenario, allowed, moment, excuses)
            yield "no more comes after a stop than is allowed", what, excuse


def _nothing_disturbs(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """Nobody did anything to `job`, or nothing but what protocol A outwaits. There a second one completes too, whatever
    persons did to the first.
    """
    if evidence.damages or evidence.overruns_beyond:
        return False
    if not scenario.protocol.startswith("fanuc-a"):
        return job is evidence.jobs[0] and evidence.left_alone
    acts = evidence.acts_during(job)
    began = any(attempt.armed for attempt in evidence.attempts[job.attempts_before :])
    return began and _by_persons(evidence) and _OUTWAITED.issuperset(acts)


def _by_persons(evidence: Evidence) -> bool:
    """Both ends had power all the time, and no computer stalled for as long as two stalls may last together."""
    acts = [what for _, what in evidence.acts]
    return acts.count(Act.STALL.value) <= 1 and _PERSONS.issuperset(acts)


def _alarm_of_nothing(scenario: Scenario, evidence: Evidence) -> bool:
    """A control of protocol A ended a reading in an alarm that is nobody's doing: nothing happened on the line."""
    if evidence.damages or evidence.overruns_beyond or evidence.happened(Act.ALARM.value):
        return False
    failed = any(outcome is Outcome.FAILED for _, outcome in evidence.control_ends)
    return failed and _by_persons(evidence) and scenario.protocol.startswith("fanuc-a")


def _must_be_repeated(scenario: Scenario, evidence: Evidence) -> bool:
    """Single characters were hit, and nothing else, in a protocol whose ends ask again for what came damaged."""
    ne = scenario.settings.host.get("Ne", "10")
    # A NAK for the packet behind a bad one is one more retry (4.5, 5.3 2)).
    at_once = ne == "1" and scenario.settings.cnc.get("naks") == "packet"
    repeats = scenario.protocol.startswith("fanuc-a") and ne != "0" and not at_once
    if not repeats or not evidence.jobs or not evidence.damages or evidence.overruns_beyond:
        return False
    if evidence.acts_during(evidence.jobs[0]):
        return False
    n = packets_n(scenario)
    if not n:
        most = _FAR_BELOW_NE if ne == "10" else 1
        return len(evidence.damages) <= most and all(map(_costs_a_repetition, evidence.damages))
    damage = evidence.damages[0]
    turned = damage.unseen and len(damage.plain) == len(damage.sent) == 1
    by_end = set(damage.sent + damage.plain) & _END_CODES
    return len(evidence.damages) == 1 and turned and not by_end and not never_repeated(evidence, n, damage)


def _costs_a_repetition(damage: Damage) -> bool:
    """Of a message of protocol A, and nothing more (4.6 2)). A sum does not show a NUL more or less."""
    if damage.kind not in _OF_ONE_CHARACTER or len(damage.sent) > 1 or not any(damage.sent + damage.plain):
        return False
    if damage.wire is Wire.FROM_CONTROL:
        # The host hears that a message does not go on, and asks for it before To is over.
        return True
    # A marked one is an open line (4.6 1)). There is no length and no other mark: a message without its end is over
    # when To is (4.1, 4.6 1)).
    return damage.unseen and not set(damage.sent + damage.plain) & _END_CODES


def _overrun_excuse(scenario: Scenario, allowed: int, moment: Nanos, excuses: Excuses) -> str:
    """A receive FIFO tells a lone DC3 some characters late; what is on the line then comes all the same."""
    path = PATHS[scenario.path]
    late_told = path.timeout_characters + scenario.cnc_window
    if path.transmitter_empty is not TransmitterEmpty.ASKED or in_flight(scenario) + late_told > allowed:
        return Undetectable.NO_STOP_DISTANCE
    return excuses.overrun(moment)


def in_flight(scenario: Scenario) -> int:
    """Characters the host allows itself on the line."""
    return scenario.window or scenario.default_window


def _send(scenario: Scenario, evidence: Evidence, excuses: Excuses) -> Iterator[Broken]:
    for number, attempt in enumerate(evidence.attempts):
        if not attempt.armed and attempt.got:
            yield "nothing is sent that was not armed", f"{attempt.got} bytes came", excuses.out_of_nothing(attempt)
        got = bytes(attempt.delivered)
        wrong = first_difference(got, evidence.expected)
        if wrong is not None and attempt.armed:
            what = f"attempt {number + 1}: byte {wrong} of {len(got)} delivered differs"
            yield "what is delivered is a prefix of the program", what, excuses.content(attempt, wrong, got)
    for job in evidence.jobs:
        yield from _job_sent(scenario, evidence, job, excuses)
        yield from _told_well(scenario, evidence, job, excuses)
        if job.complete and end_unheard(scenario, job):
            yield "complete means that its end was heard", f"no stop behind the last DC1: {job.reason}", ""


def _job_sent(scenario: Scenario, evidence: Evidence, job: Job, excuses: Excuses) -> Iterator[Broken]:
    if job.complete is None:
        return
    attempts = _attempts_of(evidence, job)
    got, whole = job.got_at_end, len(evidence.program)
    most = max((attempt.got for attempt in attempts), default=0)
    if job.complete:
        # The last characters may still be on the line, or in an adapter that does not say so.
        if most != whole or got + in_flight(scenario) < whole:
            what = f"{got}, at last {most}, of {whole} bytes were with the control: {job.reason}"
            yield "complete means delivered whole", what, excuses.short(_last(attempts), job)
        elif job.delivered_at_end < whole and _waits_for_empty(scenario, evidence, job):
            what = f"{job.delivered_at_end} of {whole} bytes were out of the buffer: {job.reason}"
            yield "complete means taken out of the buffer", what, excuses.told_wrongly(job)
        if not job.low == job.high == whole:
            yield "complete counts the whole program", f"{job.low} to {job.high} of {whole} bytes counted", ""
        return
    if job.low > got:
        what = f"{job.low} bytes certain, {got} with the control: {job.reason}"
        yield "what is certain is with the control", what, excuses.less(attempts, job, job.low - got)
    least = _least_certain(scenario, evidence, job, attempts)
    if job.low < least:
        yield "what was asked behind is certain", f"{job.low} bytes certain, {least} asked behind: {job.reason}", ""
    if (late := _long_before(scenario, evidence, job, attempts)) > job.low:
        yield "what came long before the end is certain", f"{job.low} bytes certain, {late} came long before", ""
    if job.high > job.handed:
        yield "no more counts than was handed over", f"{job.high} bytes at most, {job.handed} handed over", ""
    if job.high < most:
        what = f"{job.high} bytes at most, {most} with the control: {job.reason}"
        yield "no more is with the control than can be", what, excuses.more(attempts, most - job.high)


def _least_certain(scenario: Scenario, evidence: Evidence, job: Job, attempts: list[Attempt]) -> int:
    """What the control had before the last DAT, for which it has said GTD (4.4.1). 0 where anything may have kept the
    host from hearing that, and for packets, of which nothing says that they are there.
    """
    if scenario.protocol != "fanuc-a" or evidence.damages or len(attempts) != 1 or not _by_persons(evidence):
        return 0
    # The first message of all is SYN, of six characters.
    sent = bytes(evidence.host.sent)
    until = min((other.place for other in evidence.jobs if other.began >= job.ended), default=None)
    return job.got_at_end - last_data(sent[job.place : until], sent[5:6]) if sent else 0


def _waits_for_empty(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """SAT tells a host of protocol A what is in the buffer (4.4.2 1)). One that was told to takes the RST of a person
    for that of M30.
    """
    pressed = Act.RESET.value in evidence.acts_during(job)
    by_rst = pressed and scenario.settings.host.get("rst_at_end") == "complete"
    return scenario.protocol.startswith("fanuc-a") and not by_rst


_LONG_BEFORE: Final[Nanos] = 3 * HEARD_LATE
_LONG_BEFORE_CHARACTERS: Final = 3 * HEARD_LATE_CHARACTERS


def _long_before(scenario: Scenario, evidence: Evidence, job: Job, attempts: list[Attempt]) -> int:
    """Characters that the control had long before it can have said what ended the job, of which its host heard all.

    0 where something happened to a character or to the host, which may then have to doubt it, in protocol A, and in
    REMOTE LOAD, where nothing is certain but by what the control says next.
    """
    known = scenario.protocol.startswith("fanuc-b") or scenario.is_linked
    if not known or evidence.damages or evidence.sleeps or len(attempts) != 1:
        return 0
    if not all(what in _PRESSED for _, what in evidence.acts):
        return 0
    # An ACK proves a record (4.2.1), and one of them may be on its way.
    if scenario.is_linked:
        return job.got_at_end - RECORD_BYTES
    character, path = character_time(scenario.baud), PATHS[scenario.path]
    recent = max(_LONG_BEFORE // character, _LONG_BEFORE_CHARACTERS)
    return job.got_at_end - recent - in_flight(scenario) - path.out_of_reach - path.timeout_characters


def _receive(scenario: Scenario, evidence: Evidence, excuses: Excuses) -> Iterator[Broken]:
    program = evidence.program
    for number, job in enumerate(evidence.jobs):
        attempts = _attempts_of(evidence, job)
        stored = bytes(job.stored)
        wrong = first_difference(stored, program)
        if wrong is not None and (job.complete or not evidence.on(Wire.FROM_CONTROL)):
            # What came damaged is stored as it was read, so that its place can be found; it is just not complete.
            what = f"job {number + 1}: byte {wrong} of {len(stored)} stored differs"
            yield "what is stored is a prefix of what was sent", what, excuses.content(_last(attempts), wrong, stored)
        if job.complete and stored != program and wrong is None:
            what = f"{len(stored)} of {len(program)} bytes are stored: {job.reason}"
            yield "complete means stored whole", what, excuses.short(_last(attempts), job)
        if job.complete is not None and job.low != len(stored):
            yield "the count is what is stored", f"{job.low} counted, {len(stored)} stored", ""
        if job.complete is not None and not reported_well(job):
            yield "what is reported is what is stored", f"{job.reported} reported, {len(stored)} stored", ""
        yield from _told_well(scenario, evidence, job, excuses)
        if job.complete and (attempt := _last(attempts)) is not None:
            for what in unlike_what_came(scenario, evidence, attempt, job):
                yield "complete means that it came as one program", what, ""
    allowed = _punched_behind_a_stop(scenario)
    if allowed is not None and evidence.cnc.longest_run > allowed:
        what = f"{evidence.cnc.longest_run} characters behind the stop of the host, {allowed} allowed"
        yield "a punch-out stops when it is told to", what, ""


_LAST_WORDS: Final = 4
"""What a control that is stopped says to end its punch-out: DC4 and SYN, or a cancel pair and the end of a text."""


def _punched_behind_a_stop(scenario: Scenario) -> int | None:
    """6.1.1 2) (3), 3.2: what a control may still say when its host has stopped it; None where that has no bound."""
    table = PROTOCOLS[scenario.protocol].params(scenario.settings.cnc, End.CONTROL)
    match scenario.protocol:
        case "fanuc-b" | "fanuc-b-expansion":
            return int(table.punch_overrun) + _LAST_WORDS
        case "bridgeport":
            return int(table.after_stop) + _LAST_WORDS
        case _:
            return None


def _told_well(scenario: Scenario, evidence: Evidence, job: Job, excuses: Excuses) -> Iterator[Broken]:
    """Who reads that a job was cancelled takes it for the doing of a person, and a complete one for in order. In
    protocol A the control tells its state by one digit (4.4.2), which may come otherwise.
    """
    ended = evidence.control_ended(job, Outcome.FAILED, Outcome.CANCELLED)
    acted = any(what in _GIVING_UP and moment <= job.ended for moment, what in evidence.acts)
    if job.given_up and not (acted or ended or scenario.protocol.startswith("fanuc-a")):
        yield "what counts as given up was", f"nobody did: {job.reason}", excuses.told_wrongly(job)
    if not job.complete and left_alone_at_last(scenario, evidence, job):
        yield "what nothing disturbs completes", f"a later job is not complete: {job.reason}", ""
    for what in against(scenario, evidence, job) if job.complete else ():
        yield "complete means that nothing was said against it", what, ""


def _attempts_of(evidence: Evidence, job: Job) -> list[Attempt]:
    """Those that began while the job was armed."""
    later = evidence.attempts[job.attempts_before :]
    return [attempt for attempt in later if attempt.armed and (not job.ended or attempt.began <= job.ended)]


def _last(attempts: list[Attempt]) -> Attempt | None:
    return attempts[-1] if attempts else None
