"""What the ends of Bridgeport take for something else: a character is told by its place, and by nothing beside it.

For `undetectable.py`, which gives these their names.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

from tapewire.engine import SECOND, Nanos, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.protocols.bridgeport.records import RECORD_BYTES
from tapewire.protocols.delivery import HEARD_LATE
from tapewire.sim.evidence import Attempt, Damage, Evidence, Wait
from tapewire.sim.frames import ends_record, text_of
from tapewire.sim.scenarios import Codes

__all__ = [
    "answered_unasked",
    "beside",
    "end_was_hidden",
    "ended_unanswered",
    "gained",
    "lost",
    "record_never_came",
    "text_ended_early",
    "while_read",
]

_FRAMING: Final = 3
"""Characters of a record beside its text: STX or none, ETB, LRC."""

_BLANK_TAPE: Final = b"\x00\x7f\x80\xff"
"""What a control passes over in a text, with and without the parity bit (`ignore_rx`)."""


def _of_text(data: bytes, others: Iterable[int] = ()) -> int:
    """Characters that a control takes in a text; `others` is what it does not take, besides blank tape."""
    return len(data.translate(None, _BLANK_TAPE + bytes(others)))


def lost(damage: Damage, codes: Codes) -> int:
    """So many characters fewer are with the control: gone, or blank tape, or the end of the text in place of one. What
    was a code of the host was none.
    """
    return max(0, _of_text(damage.sent, codes.all) - _of_text(damage.plain, codes.ends))


def gained(damage: Damage, codes: Codes) -> int:
    """So many characters more are with it: made, or read in place of a code or of blank tape. A code that stands among
    what arrived has come.
    """
    came = (Counter(damage.sent) & Counter(damage.plain)).elements()
    codes_that_came = sum(byte in codes.all for byte in came)
    return max(0, _of_text(damage.plain) - _of_text(damage.sent, codes.all) - codes_that_came)


def while_read(evidence: Evidence, moment: Nanos, attempt: Attempt) -> bool:
    """The control was in this reading."""
    return attempt.began <= moment <= _read_until(evidence, attempt, moment)


def _read_until(evidence: Evidence, attempt: Attempt, default: Nanos) -> Nanos:
    ends = [ended for ended, _ in evidence.control_ends if ended >= attempt.began]
    later = [other.began for other in evidence.attempts if other.began > attempt.began]
    return min(ends + later, default=default)


def answered_unasked(evidence: Evidence, attempt: Attempt, unseen: Sequence[Damage], codes: Codes) -> int:
    """So many codes the host may have said in this reading to what the control had not said. `unseen` is damage of
    that. What comes right before the reading is answered in it, and what a computer in its sleep does not hear, behind
    that.
    """
    since = attempt.began - HEARD_LATE
    slept = [begun for begun, until in evidence.sleeps if begun <= attempt.began and until >= since]
    since = min([since, *(begun - HEARD_LATE for begun in slept)])
    return sum(
        bool(codes.all & (set(damage.sent) | set(damage.plain)))
        and since <= damage.moment <= _read_until(evidence, attempt, damage.moment)
        for damage in unseen
    )


def beside(attempt: Attempt, program: bytes, made: Sequence[Damage], answers: int, codes: Codes) -> tuple[int, int]:
    """How many characters were taken beside those of `program`, and how many of them are codes of the host. It has said
    at most `answers` that nobody wanted, and all others come from `made`; (0, 0): it is not so.
    """
    of_noise = Counter(byte & 0x7F for damage in made for byte in damage.plain)
    at = count = answered = 0
    for byte in attempt.delivered:
        if program[at : at + 1] == bytes((byte,)):
            at += 1
            continue
        count += 1
        if of_noise[byte & 0x7F]:
            of_noise[byte & 0x7F] -= 1
        elif byte in codes.all:
            answered += 1
        else:
            return 0, 0
    return (count, answered) if answered <= answers else (0, 0)


def text_ended_early(evidence: Evidence, attempt: Attempt, unseen: Sequence[Damage], ends: frozenset[int]) -> bool:
    """REMOTE LOAD: noise ended the text, and the control says nothing when it has all of one (3.1). `unseen` is damage
    of what the host says.
    """
    whole = [ended for ended, outcome in evidence.control_ends if outcome is Outcome.COMPLETE]
    return any(
        ends & (set(damage.plain) - set(damage.sent))
        and any(attempt.began <= damage.moment <= ended <= damage.moment + SECOND for ended in whole)
        for damage in unseen
    )


def record_never_came(evidence: Evidence, wait: Wait, ends: frozenset[int]) -> bool:
    """DNC LINK: what did not even begin cannot be refused, and 4.2 sets no time in which it must begin."""
    attempt, sent = wait.attempt, bytes(evidence.host.sent[: wait.told])
    if attempt is None:
        return False
    begins = len(sent)
    for damage in reversed(evidence.on(Wire.FROM_HOST)):
        if damage.arrived or damage.place + len(damage.sent) - 1 != begins:
            break
        begins = damage.place - 1
    first = not text_of(sent[attempt.place : begins])
    return (first or ends_record(sent[:begins], ends)) and ends_record(sent[begins:], ends)


def ended_unanswered(evidence: Evidence, wait: Wait, unseen: Sequence[Damage], ends: frozenset[int]) -> bool:
    """DNC LINK: an end code was forged in the last record the host has said, or behind it, and a control that has all
    answers nothing more; nor does one that is told by it, before anything has come, that there is no such program.
    `unseen` is damage of what the host says.
    """
    refused = wait.attempt is not None and not wait.attempt.got
    told = (Outcome.COMPLETE, Outcome.FAILED) if refused else (Outcome.COMPLETE,)
    over = [ended for ended, outcome in evidence.control_ends if outcome in told]
    record = wait.told - RECORD_BYTES - _FRAMING
    forged = [hit for hit in unseen if hit.told >= record and ends & (set(hit.plain) - set(hit.sent))]
    return any(hit.moment <= ended and wait.job.covers(ended) for hit in forged for ended in over)


def end_was_hidden(evidence: Evidence, wait: Wait, ends: frozenset[int]) -> bool:
    """DNC LINK: the last check character was answered, and nothing answers the end code behind it (4.2). It came
    otherwise; or something of no record came between the two, and began one of which it is a character (2.2.4).
    """
    attempt = wait.attempt
    if attempt is None:
        return False
    sent = bytes(evidence.host.sent[: wait.told])
    end = max(map(sent.rfind, (bytes((code,)) for code in ends))) + 1
    if end <= attempt.place or attempt.got < len(evidence.program):
        return False
    return any(_between(damage, end) and wait.job.covers(damage.moment) for damage in evidence.on(Wire.FROM_HOST))


def _between(damage: Damage, end: int) -> bool:
    """At the end code, at the check character in front of it, or out of nothing when just that had been said."""
    if not damage.place:
        return damage.told in (end - 1, end)
    return damage.place <= end and damage.place + len(damage.sent) - 1 >= end - 1
