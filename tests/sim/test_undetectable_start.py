"""What excuses a reading that got the middle of a program, and an ER that no pin showed: protocol B."""

from __future__ import annotations

import dataclasses

import pytest

from tapewire.engine import SECOND, Outcome
from tapewire.line.faults.log import Injected
from tapewire.line.faults.plan import Wire
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job, Wait
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Direction, Scenario, draw
from tapewire.sim.switches import Settings
from tapewire.sim.undetectable import Excuses
from tapewire.sim.unposted import er_was_hidden

PROGRAM = b"%\nN1 X1\n" + b"".join(b"N%d X%d\n" % (line, line) for line in range(2, 300)) + b"M30\n%"
GONE = 500
"""Characters that the host had sent when the control began to read at its own."""


def quiet_line() -> Scenario:
    """Nothing may stand between the ends but a FIFO of 16 characters, and two characters of the host."""
    drawn = draw("fanuc-b", "clean", 1, path="uart-16550")
    plain = Settings(host={}, cnc={}, data=drawn.settings.data)
    return dataclasses.replace(drawn, direction=Direction.SEND, settings=plain, window=2)


def obeyed(moment: int, arrived: bytes, got: bytes, *, before: bytes = PROGRAM[:GONE]) -> tuple[Evidence, Excuses]:
    """A job is armed at 10 s, a character is forged at `moment`, the host sends `before`; at 30 s the reading that the
    host knows nothing of begins, and gets `got`.
    """
    evidence = Evidence(program=PROGRAM, expected=PROGRAM)
    evidence.host.sent += before + PROGRAM[GONE:]
    evidence.cnc.brought += got
    evidence.damages.append(Damage(moment * SECOND, "noise", Wire.FROM_CONTROL, 0, b"", (arrived,)))
    attempt = Attempt(began=30 * SECOND, armed=True, place=len(before), heard=0, brought=0, got=len(got))
    attempt.delivered += got
    evidence.attempts.append(attempt)
    evidence.jobs.append(Job(began=10 * SECOND, attempts_before=0, complete=False, ended=90 * SECOND))
    return evidence, Excuses(quiet_line(), evidence)


@pytest.mark.parametrize(
    ("moment", "arrived", "got", "excused"),
    [
        (20, b"\x11", PROGRAM[GONE:], True),
        (20, b"\x11", PROGRAM[GONE : GONE + 50], True),
        (20, b"\x11", PROGRAM[GONE - 18 :], True),
        (20, b"\x11", PROGRAM[GONE - 19 :], False),
        (20, b"\x11", PROGRAM[GONE + 1 :], False),
        (20, b"\x11", PROGRAM[8:], False),
        (1, b"\x11", PROGRAM[GONE:], False),
        (31, b"\x11", PROGRAM[GONE:], False),
        (20, b"\x12", PROGRAM[GONE:], False),
        (20, b"\x11", b"9", False),
        (20, b"\x11", b"", False),
    ],
)
def test_a_host_that_obeyed_a_dc1_of_nobody(moment: int, arrived: bytes, got: bytes, excused: bool) -> None:
    """What the control gets is what was left, from the character on that the host had come to."""
    evidence, excuses = obeyed(moment, arrived, got)
    assert (excuses.content(evidence.attempts[0], 0, got) == Undetectable.CODE) is excused


@pytest.mark.parametrize("before", [b"", b"X" * GONE, PROGRAM[3 : GONE + 3]])
def test_a_host_that_began_nothing_obeyed_nothing(before: bytes) -> None:
    got = PROGRAM[GONE:]
    evidence, excuses = obeyed(20, b"\x11", got, before=before)
    assert excuses.content(evidence.attempts[0], 0, got) == ""


def test_a_job_that_failed_and_stayed_armed_is_no_dc1_of_nobody() -> None:
    """The forged DC1 began a reading of its own time: it had ended when the control asked for the rest."""
    got = PROGRAM[GONE:]
    evidence, excuses = obeyed(20, b"\x11", got)
    evidence.control_ends.append((25 * SECOND, Outcome.CANCELLED))
    assert excuses.content(evidence.attempts[0], 0, got) == ""


@pytest.mark.parametrize(("told", "excused"), [(0, True), (1, False), (GONE, False)])
def test_nor_is_one_that_came_when_something_of_the_job_had_gone(told: int, excused: bool) -> None:
    """An earlier reading of the same job had drawn that, and a control that was reset may have ended it."""
    got = PROGRAM[GONE:]
    evidence, excuses = obeyed(20, b"\x11", got)
    evidence.damages[:] = [dataclasses.replace(evidence.damages[0], told=told)]
    assert (excuses.content(evidence.attempts[0], 0, got) == Undetectable.CODE) is excused


@pytest.mark.parametrize(("since", "excused"), [(GONE, True), (GONE - 18, True), (GONE - 19, False), (8, False)])
def test_damage_behind_the_beginning_hides_no_wrong_place(since: int, excused: bool) -> None:
    """What came before it shows where the control began."""
    got = bytearray(PROGRAM[since:])
    got[GONE + 100 - since] ^= 1
    evidence, excuses = obeyed(20, b"\x11", bytes(got))
    hit = GONE + 100
    flip = Damage(40 * SECOND, "noise", Wire.FROM_HOST, hit + 1, PROGRAM[hit : hit + 1], (bytes((PROGRAM[hit] ^ 1,)),))
    evidence.damages.append(flip)
    assert (excuses.content(evidence.attempts[0], 0, bytes(got)) == Undetectable.CODE) is excused


def test_the_evidence_counts_what_the_host_had_sent() -> None:
    evidence = Evidence(program=PROGRAM, expected=PROGRAM)
    evidence.host.sent += PROGRAM[:7]
    evidence.note_fault(Injected(SECOND, "noise", Wire.FROM_CONTROL, 0, b"", (b"\x11",)))
    assert evidence.damages[0].told == 7


def test_what_the_control_did_not_get_it_does_not_hand_on() -> None:
    got = PROGRAM[GONE:]
    evidence, excuses = obeyed(20, b"\x11", got)
    evidence.cnc.brought[:] = PROGRAM
    assert excuses.content(evidence.attempts[0], 0, got) != "", "it is the end of what was brought"
    evidence.cnc.brought[:] = PROGRAM[:GONE]
    assert excuses.content(evidence.attempts[0], 0, got) == ""


def test_a_reading_that_never_began_had_no_er_to_hide() -> None:
    evidence, excuses = obeyed(20, b"\x11", b"")
    evidence.damages.append(Damage(20 * SECOND, "DSR OFF", Wire.FROM_CONTROL, 0, b"", ()))
    evidence.control_ends.append((40 * SECOND, Outcome.FAILED))
    assert not er_was_hidden(evidence, None)
    job, heard = evidence.jobs[0], b"\x11\x13"
    posting_off = Settings(host={"posting": "off"}, cnc={}, data=quiet_line().settings.data)
    excuses = Excuses(dataclasses.replace(quiet_line(), settings=posting_off, has_signals=True), evidence)
    wait = Wait(who=("host",), job=job, attempt=None, said=heard, heard=heard)
    assert excuses.waiting("host", wait) == ""
