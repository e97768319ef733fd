"""What must hold of every transfer, and how what a protocol cannot see is told from what an engine did wrong.

Each rule looks at the evidence and either is satisfied, or names what the protocol's own rules cannot detect
(`undetectable.py` decides that from what was injected), or reports a violation. Nothing is waved through: an excuse
has a name, and is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tapewire.engine import Nanos
from tapewire.line.faults.plan import Wire
from tapewire.line.paths import PATHS, TransmitterEmpty
from tapewire.sim.evidence import Attempt, Evidence, Job
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Direction, Scenario
from tapewire.sim.undetectable import Excuses, first_difference
from tapewire.sim.unnumbered import never_repeated, packets_n

__all__ = ["FOOTPRINT_BYTES", "NO_ENGINE_BREAKS", "Finding", "judge"]

NO_ENGINE_BREAKS: Final = "no engine breaks"

_END_CODES: Final = frozenset(b"\x0d\x8d\x03")

MOST_UNDER_WAY: Final = 2
"""Packets that follow a bad one before its NAK is obeyed."""

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
    if evidence.left_alone and not evidence.damages and not evidence.overruns_beyond and not evidence.jobs[0].complete:
        what = f"not complete: {evidence.jobs[0].reason}"
        yield (
            "what nothing disturbs completes",
            what,
            excuses.undisturbed(_last(_attempts_of(evidence, evidence.jobs[0]))),
        )
    if _must_be_repeated(scenario, evidence) and not evidence.jobs[0].complete:
        what = f"not complete after {evidence.damages[0].name}: {evidence.jobs[0].reason}"
        yield "what can be asked for again is", what, ""
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


def _must_be_repeated(scenario: Scenario, evidence: Evidence) -> bool:
    """One character turned in all, and nothing else, in a protocol whose ends ask again for what came damaged."""
    # With a NAK for each packet, those under way behind a bad one are a retry each (4.5, 5.3 2)).
    retries = MOST_UNDER_WAY if scenario.settings.cnc.get("naks") == "packet" else 0
    repeats = scenario.protocol.startswith("fanuc-a") and int(scenario.settings.host.get("Ne", "10")) > retries
    damages = evidence.damages
    one = len(damages) == 1 and damages[0].unseen and len(damages[0].plain) == len(damages[0].sent) == 1
    if one and set(damages[0].sent + damages[0].plain) & _END_CODES:
        # There is no length and no other mark: a message without its end is over when To is (4.1, 4.6 1)).
        return False
    if one and never_repeated(evidence, packets_n(scenario), damages[0]):
        return False
    return repeats and one and evidence.left_alone and not evidence.overruns_beyond


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
        return
    if job.low > got:
        what = f"{job.low} bytes certain, {got} with the control: {job.reason}"
        yield "what is certain is with the control", what, excuses.less(attempts, job, job.low - got)
    if job.high < most:
        what = f"{job.high} bytes at most, {most} with the control: {job.reason}"
        yield "no more is with the control than can be", what, excuses.more(attempts, most - job.high)


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


def _attempts_of(evidence: Evidence, job: Job) -> list[Attempt]:
    """Those that began while the job was armed."""
    later = evidence.attempts[job.attempts_before :]
    return [attempt for attempt in later if attempt.armed and (not job.ended or attempt.began <= job.ended)]


def _last(attempts: list[Attempt]) -> Attempt | None:
    return attempts[-1] if attempts else None
