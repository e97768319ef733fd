"""What a control of protocol B does not say, or says too late to be told from something else (6.1.1, 6.1.2, 6.4).

For `undetectable.py`, which gives these their names.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tapewire.codes import EOR_CODES
from tapewire.engine import SECOND, Nanos, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.line.pacing import character_time
from tapewire.line.paths import PATHS
from tapewire.protocols.delivery import HEARD_LATE
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job, Wait
from tapewire.sim.scenarios import Act, Direction, Scenario

__all__ = [
    "CLOSING",
    "LEAVING",
    "alarm_behind",
    "announcement_was_hit",
    "cut_while_paused",
    "end_like_reset",
    "ended_unplugged",
    "ends_alike",
    "ends_in_eor",
    "eor_came_otherwise",
    "er_was_hidden",
    "forged_start",
    "heard_late",
    "is_silent_alarm",
    "looks_like_a_stop",
    "resume_was_hit",
    "with_the_last",
]

LEAVING: Final[Nanos] = 2 * SECOND
"""Between what ends a job and its end: what had been handed over leaves, or is called back."""

CLOSING: Final[Nanos] = 6 * SECOND
"""The same where the host waits whether a DC3 is the end: the longest `closing_time`."""

LONGEST_BLINK: Final[Nanos] = 2 * SECOND
"""So long a worn pin of DSR has no contact (`loose-dsr`)."""

UNPLUGGED: Final[Nanos] = 2 * SECOND
"""So long a cable is out (`pulled-cable`)."""

_DC1: Final = b"\x11"
_DC3: Final = b"\x13"
_STOPS: Final = frozenset(b"\x13\x93")
_WITHOUT_PARITY: Final = bytes(byte & 0x7F for byte in range(256))


def heard_late(scenario: Scenario, evidence: Evidence, job: Job, missing: int, ends_within: Nanos) -> bool:
    """What ended the control's operation was held back by an adapter, or was said while the host's computer slept for
    longer than a host reckons with; and no more is `missing` than can have left meanwhile.
    """
    character, reach = character_time(scenario.baud), PATHS[scenario.path].out_of_reach
    ends = [at for at, how in evidence.control_ends if how is not Outcome.COMPLETE and job.covers(at)]
    for stop in evidence.damages:
        heard = stop.moment + stop.late + HEARD_LATE
        held_back = any(stop.moment - HEARD_LATE <= end <= heard for end in ends) and job.ended <= heard + ends_within
        if stop.kind == "late stop" and held_back and missing <= (stop.late + HEARD_LATE) // character + reach:
            return True
    for since, until in evidence.sleeps:
        slept = until - since > HEARD_LATE and until <= job.ended <= until + ends_within
        in_it = any(since - HEARD_LATE <= end <= until for end in ends)
        if slept and in_it and missing <= HEARD_LATE // character + reach:
            return True
    return False


def forged_start(scenario: Scenario, evidence: Evidence, attempt: Attempt, unseen: Sequence[Damage]) -> int | None:
    """The host obeyed a DC1 that nobody had said, and so many characters of its program had gone when the control began
    to read at its own; None: it is not so. What had gone before that DC1 it does not explain: another reading drew it,
    and the job had to end with that. `unseen` is damage of what the control says.
    """
    jobs = [job for job in evidence.jobs if job.began <= attempt.began and job.covers(attempt.began)]
    if not jobs or scenario.direction is not Direction.SEND:
        return None
    job = jobs[-1]
    forged = [hit for hit in unseen if _DC1 in hit.plain and _DC1 not in hit.sent and hit.told <= job.place]
    ends = [at for at, _ in evidence.control_ends]
    obeyed = any(
        job.began <= hit.moment <= attempt.began and not any(hit.moment <= end <= attempt.began for end in ends)
        for hit in forged
    )
    gone = bytes(evidence.host.sent[job.place : attempt.place])
    sent = evidence.handed_over(attempt, job.place)
    of_program = evidence.program.startswith(sent[: len(evidence.program)])
    return len(gone) if obeyed and gone and of_program else None


def _posts_nothing(scenario: Scenario) -> bool:
    return scenario.settings.host.get("posting") == "off"


def ends_alike(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """Without posting the end of a reading, an alarm and a reset say DC3 and turn ER OFF alike (6.1.1)."""
    sends = scenario.direction is Direction.SEND
    return sends and _posts_nothing(scenario) and evidence.control_ended(job, Outcome.FAILED, Outcome.CANCELLED)


def end_like_reset(evidence: Evidence, job: Job, attempt: Attempt | None) -> bool:
    """The host was stopped with the rest of its program on the way, and the DC3 of the end followed: so close behind
    the last characters that a reset might have thrown them away (6.1.1, 6.4). A reset later on may be posted, by SYN.
    """
    ended_well = evidence.control_ended(job, Outcome.COMPLETE)
    if attempt is None or not ended_well or evidence.control_ended(job, Outcome.FAILED, Outcome.CANCELLED):
        return False
    later = (other.heard for other in evidence.attempts if other.began > attempt.began)
    said = evidence.cnc.sent[attempt.heard : min(later, default=None)].translate(_WITHOUT_PARITY)
    return attempt.got == len(evidence.program) and said.rstrip(b"\x16").endswith(2 * _DC3)


def with_the_last(scenario: Scenario, missing: int) -> bool:
    """DC3 may be heard late, and the last characters may stand in a FIFO or an adapter that does not say so."""
    return missing <= HEARD_LATE // character_time(scenario.baud) + PATHS[scenario.path].out_of_reach


def cut_while_paused(scenario: Scenario, evidence: Evidence, wait: Wait) -> bool:
    """6.1.2 NOTE: while CS is OFF nothing ends a punch-out that is cut short, nor does it follow later."""
    if "control" in wait.who or scenario.settings.host.get("pause") != "cs":
        return False
    pauses = [(act.moment, act.moment + act.span) for act in scenario.acts if act.act is Act.PAUSE]
    ends = [at for at, how in evidence.control_ends if how is not Outcome.COMPLETE]
    return any(on <= at <= off and wait.job.covers(at) for on, off in pauses for at in ends)


def er_was_hidden(evidence: Evidence, attempt: Attempt | None) -> bool:
    """The pin had no contact when the reading began, or lost it in the middle."""
    if attempt is None:
        return False
    since = attempt.began - LONGEST_BLINK
    ends = [at for at, _ in evidence.control_ends if at >= attempt.began]
    moments = [damage.moment for damage in evidence.damages if damage.kind.startswith("DSR")]
    return any(since <= moment <= min(ends, default=moment) for moment in moments)


def looks_like_a_stop(scenario: Scenario, evidence: Evidence, wait: Wait) -> bool:
    """A reset says DC3. A control that still works is reset only by who ends the waiting."""
    ended = "control" not in wait.who and evidence.control_ended(wait.job, Outcome.FAILED, Outcome.CANCELLED)
    return _posts_nothing(scenario) and ended and wait.heard.endswith(_DC3)


def tells_at_reset(scenario: Scenario) -> bool:
    """6.4 note 1."""
    return scenario.settings.cnc.get("alarm") == "at-reset"


def alarms(evidence: Evidence) -> list[Nanos]:
    """Those of the CNC itself."""
    return [moment for moment, what in evidence.acts if what == Act.ALARM.value]


def is_silent_alarm(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """The control goes to alarm by itself, or because of a damaged character."""
    alarmed = any(job.covers(moment) for moment in alarms(evidence))
    return tells_at_reset(scenario) and (alarmed or evidence.control_ended(job, Outcome.FAILED))


def alarm_behind(scenario: Scenario, evidence: Evidence, wait: Wait) -> bool:
    """It came while the control had a program whole, or was reading the rest of it."""
    attempt = wait.attempt
    if attempt is None or attempt.got < len(evidence.program):
        return False
    return tells_at_reset(scenario) and any(moment >= attempt.began for moment in alarms(evidence))


def announcement_was_hit(evidence: Evidence, wait: Wait) -> bool:
    """DC2, and what came of the punch-out behind it is nothing to a host that waits for one (6.1.1 2) (1))."""
    if wait.attempt is None or wait.job.stored:
        return False
    place, hit = wait.attempt.heard + 1, evidence.on(Wire.FROM_CONTROL)
    return any(damage.place <= place < damage.place + len(damage.sent) for damage in hit if damage.place)


def resume_was_hit(unseen: Sequence[Damage], wait: Wait) -> bool:
    """In a punch-out the host says nothing but codes: the last one is what the control waits for (6.1.1 2) (4)). Behind
    a DC3 out of nothing it is one that its host does not know to be due.
    """
    forged = any(not damage.place and damage.told == wait.told and _STOPS & set(damage.plain) for damage in unseen)
    return forged or any(damage.place + len(damage.sent) - 1 == wait.told for damage in unseen if damage.place)


def ended_unplugged(evidence: Evidence, wait: Wait) -> bool:
    """DR was OFF when the control had the program whole: it needs its host no more, and no DC3 is said (6.1.2). What it
    said last may be one all the same, which was a stop; then the cable must be out when it ends.
    """
    ends = [moment for moment, outcome in evidence.control_ends if outcome is Outcome.COMPLETE]
    pulled = [damage.moment for damage in evidence.damages if damage.kind == "pulled cable"]
    began = wait.attempt.began if wait.attempt is not None else wait.job.began
    covered = [(pull, end) for pull in pulled for end in ends if began <= pull <= end and wait.job.covers(end)]
    stopped = wait.said.endswith(_DC3)
    return any(not stopped or end <= pull + UNPLUGGED for pull, end in covered)


def ends_in_eor(scenario: Scenario, text: bytes) -> bool:
    return text[-1:] != b"" and text[-1] in EOR_CODES[scenario.settings.data]


def eor_came_otherwise(
    scenario: Scenario, evidence: Evidence, attempt: Attempt, sent: int, unseen: Sequence[Damage]
) -> bool:
    """The control stopped before the end of the program, or reads on behind it. `sent` is what was handed over to it,
    `unseen` damage of that.
    """
    eor, got, whole = EOR_CODES[scenario.settings.data], bytes(attempt.delivered), len(evidence.program)
    reads_on = sent >= whole and not (got[1:] and got[-1] in eor)
    taken = evidence.cnc.brought[attempt.brought : attempt.brought + attempt.got]
    stopped = len(taken) < whole and ends_in_eor(scenario, bytes(taken))
    for damage in unseen:
        lost, forged = frozenset(eor) & frozenset(damage.sent), frozenset(eor) & frozenset(damage.plain)
        if damage.moment >= attempt.began and ((reads_on and lost) or (stopped and forged)):
            return True
    return False
