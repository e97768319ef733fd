"""What a control of protocol B does not say, or says too late to be told from something else (6.1.1, 6.1.2, 6.4).

For `undetectable.py`, which gives these their names.
"""

from __future__ import annotations

from typing import Final

from tapewire.engine import SECOND, Nanos, Outcome
from tapewire.line.pacing import character_time
from tapewire.line.paths import PATHS
from tapewire.protocols.delivery import HEARD_LATE
from tapewire.sim.evidence import Attempt, Evidence, Job, Wait
from tapewire.sim.scenarios import Act, Direction, Scenario

__all__ = [
    "CLOSING",
    "LEAVING",
    "cut_while_paused",
    "ends_alike",
    "er_was_hidden",
    "heard_late",
    "looks_like_a_stop",
    "with_the_last",
]

LEAVING: Final[Nanos] = 1 * SECOND
"""Between what ends a job and its end: what had been handed over leaves, or is called back."""

CLOSING: Final[Nanos] = 6 * SECOND
"""The same where the host waits whether a DC3 is the end: the longest `closing_time`."""

LONGEST_BLINK: Final[Nanos] = 2 * SECOND
"""So long a worn pin of DSR has no contact (`loose-dsr`)."""

_DC3: Final = b"\x13"


def heard_late(evidence: Evidence, job: Job, ends_within: Nanos) -> bool:
    """What ended the job was held back by an adapter, or was said while the host's computer slept for longer than a
    host reckons with.
    """
    late_stop = any(job.covers(hit.moment) for hit in evidence.damages if hit.kind == "late stop")
    sleeps = [until for since, until in evidence.sleeps if until - since > HEARD_LATE]
    return late_stop or any(until <= job.ended <= until + ends_within for until in sleeps)


def _posts_nothing(scenario: Scenario) -> bool:
    return scenario.settings.host.get("posting") == "off"


def ends_alike(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """Without posting the end of a reading, an alarm and a reset say DC3 and turn ER OFF alike (6.1.1)."""
    sends = scenario.direction is Direction.SEND
    return sends and _posts_nothing(scenario) and evidence.control_ended(job, Outcome.FAILED, Outcome.CANCELLED)


def with_the_last(scenario: Scenario, evidence: Evidence, attempt: Attempt) -> bool:
    """DC3 may be heard late, and the last characters may stand in a FIFO or an adapter that does not say so."""
    missing = len(evidence.program) - attempt.got
    return missing <= max(HEARD_LATE // character_time(scenario.baud), PATHS[scenario.path].out_of_reach)


def cut_while_paused(scenario: Scenario, evidence: Evidence, wait: Wait) -> bool:
    """6.1.2 NOTE: while CS is OFF nothing ends a punch-out that is cut short, nor does it follow later."""
    if "control" in wait.who or scenario.settings.host.get("pause") != "cs":
        return False
    pauses = [(act.moment, act.moment + act.span) for act in scenario.acts if act.act is Act.PAUSE]
    ends = [at for at, how in evidence.control_ends if how is not Outcome.COMPLETE]
    return any(on <= at <= off and wait.job.covers(at) for on, off in pauses for at in ends)


def er_was_hidden(evidence: Evidence, attempt: Attempt | None) -> bool:
    """The pin had no contact when the reading began, or lost it in the middle."""
    since = attempt.began - LONGEST_BLINK if attempt is not None else 0
    ends = [at for at, _ in evidence.control_ends if attempt is not None and at >= attempt.began]
    moments = [damage.moment for damage in evidence.damages if damage.kind.startswith("DSR")]
    return any(since <= moment <= min(ends, default=moment) for moment in moments)


def looks_like_a_stop(scenario: Scenario, evidence: Evidence, wait: Wait) -> bool:
    """A reset says DC3. A control that still works is reset only by who ends the waiting."""
    ended = "control" not in wait.who and evidence.control_ended(wait.job, Outcome.FAILED, Outcome.CANCELLED)
    return _posts_nothing(scenario) and ended and wait.heard.endswith(_DC3)
