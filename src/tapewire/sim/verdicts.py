"""What a host must have heard before it calls a job complete, and what it must not have heard.

What the host was brought is evidence, whoever said it: noise that reads as NAK is to be obeyed like one. So nothing
here is excused by what was injected. Whether the program is there is for `checkers.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tapewire.codes import DataCode
from tapewire.engine import SECOND, Nanos
from tapewire.sim.evidence import Attempt, Evidence, Job
from tapewire.sim.frames import text_of
from tapewire.sim.hearing import Objection, What
from tapewire.sim.scenarios import Direction, Scenario

__all__ = ["against", "end_unheard", "left_alone_at_last", "reported_well", "unlike_what_came"]


def against(scenario: Scenario, evidence: Evidence, job: Job) -> Iterator[str]:
    """SYN, NAK, a cancel or damage that came to the host in the job, or while it had still to wait for that."""
    for objection in evidence.hearing.objections:
        if job.began <= objection.begun and _counts(scenario, evidence, job, objection):
            yield f"{objection.what.value} came at {objection.moment / 1e9:.3f} s, and complete: {job.reason}"


def _counts(scenario: Scenario, evidence: Evidence, job: Job, objection: Objection) -> bool:
    host = scenario.settings.host
    if objection.what is What.DAMAGE:
        return _damage_counts(scenario, job, objection)
    if objection.what is What.RESET and host.get("syn_at_end") == "complete":
        return False
    return objection.moment < job.ended or _had_to_wait(scenario, evidence, job, objection)


def _damage_counts(scenario: Scenario, job: Job, objection: Objection) -> bool:
    """In a program from the control, anywhere; behind the last DC3 where it may have been SYN or NAK (6.1.2)."""
    if objection.begun != job.begun or objection.moment >= job.ended:
        return False
    closing = objection.begun <= objection.stop == job.stop
    return scenario.direction is Direction.RECEIVE or (_posts(scenario) and closing)


def _had_to_wait(scenario: Scenario, evidence: Evidence, job: Job, objection: Objection) -> bool:
    """Behind the last DC3 a host listens for SYN and NAK, unless ER falls, or seems to."""
    if not _posts(scenario) or evidence.kinds("DSR", "pulled cable") or evidence.happened("power cut: control"):
        return False
    if any(other.what is What.RESET and other.moment == job.ended for other in evidence.hearing.objections):
        # SYN was the end: by `syn_at_end`, or the job would not be complete.
        return False
    until = objection.stop + _notice_time(scenario)
    return objection.begun <= objection.stop <= job.ended <= objection.moment < until


def _posts(scenario: Scenario) -> bool:
    return scenario.protocol.startswith("fanuc-b") and scenario.settings.host.get("posting") != "off"


def _notice_time(scenario: Scenario) -> Nanos:
    return round(float(scenario.settings.host.get("notice_time", "0.5")) * SECOND)


def end_unheard(scenario: Scenario, job: Job) -> bool:
    """Protocol B: no DC3 came behind the last DC1 (6.1.1 1) (7)), and SYN does not say as much."""
    by_reset = scenario.settings.host.get("syn_at_end") == "complete"
    return scenario.protocol.startswith("fanuc-b") and not by_reset and job.stop < job.begun


_CODES_INSIDE: Final = {
    DataCode.ASCII: b"\x11\x12\x13\x15\x16\x93\x95\x96",
    DataCode.ISO: b"\x11\x12\x13\x15\x16\x93\x95\x96",
    DataCode.EIA: b"\x11\x12\x93\x95\x96",
}
"""What is no program between DC2 and DC4; in EIA 13h, 15h and 16h are digits (6.2)."""


def unlike_what_came(scenario: Scenario, evidence: Evidence, attempt: Attempt, job: Job) -> Iterator[str]:
    """A punch-out that is complete: it holds no code, and no text came behind it."""
    heard = bytes(evidence.host.brought[attempt.brought : job.brought])
    stored = bytes(job.stored)
    data = scenario.settings.data
    is_b = scenario.protocol.startswith("fanuc-b")
    if is_b and data in _CODES_INSIDE:
        inside = heard.partition(b"\x12")[2].partition(b"\x14")[0]
        if found := inside.translate(None, bytes(set(range(256)) - set(_CODES_INSIDE[data]))):
            yield f"{found[0]:02X}h came inside it, and complete: {job.reason}"
    if not is_b or data in (DataCode.ASCII, DataCode.ISO):
        heard, stored = text_of(heard), text_of(stored)
        behind = heard[heard.find(stored) + len(stored) :].strip(b"\r\n") if stored in heard else b""
        if behind:
            yield f"{len(behind)} characters of text came behind it, and complete: {job.reason}"


def left_alone_at_last(scenario: Scenario, evidence: Evidence, job: Job) -> bool:
    """A later job of protocol B or Bridgeport that the control began, and nothing and nobody touched: what happened to
    the one before it must have left nothing behind.
    """
    if scenario.protocol.startswith("fanuc-a") or job is evidence.jobs[0] or job.complete is None:
        return False
    since = job.began - SECOND
    touched = [damage.moment for damage in evidence.damages] + [until for _, until in evidence.sleeps]
    touched += [moment for moment, count, allowed in evidence.overruns if count > allowed]
    acted = any(job.covers(moment) for moment, _ in evidence.acts)
    begun = any(attempt.armed for attempt in evidence.attempts[job.attempts_before :])
    return begun and not acted and all(moment < since for moment in touched)


def reported_well(evidence: Evidence, job: Job) -> bool:
    """What is stored was reported as it came; a character that came damaged may be stored unreported."""
    damaged = any(objection.what is What.DAMAGE for objection in evidence.hearing.objections)
    return job.reported <= len(job.stored) and (damaged or job.reported == len(job.stored))
