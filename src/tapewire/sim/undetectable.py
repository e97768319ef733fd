"""What the protocols cannot detect by their own rules, by name, decided from what was really injected.

An excuse is as narrow as it can be made: it wants the damage that explains this very deviation, unseen by the UART, on
the wire, at the place and in the time where it matters; and an end that handed on what it did not get is not excused by
it. docs/simulator.md says in words what stands here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from tapewire.engine import Nanos, Outcome
from tapewire.line.faults.plan import Wire
from tapewire.line.pacing import character_time
from tapewire.line.paths import PATHS
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job, Wait
from tapewire.sim.frames import (
    cancelled_sums,
    ends_with_stop,
    forged_records,
    rest_fits,
    text_of,
)
from tapewire.sim.mistaken import (
    answered_unasked,
    beside,
    end_was_hidden,
    ended_unanswered,
    gained,
    lost,
    record_never_came,
    text_ended_early,
    while_read,
)
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Act, Direction, Scenario
from tapewire.sim.unnumbered import lost_packets, packets_n, went_round
from tapewire.sim.unposted import (
    CLOSING,
    LEAVING,
    alarm_behind,
    announcement_was_hit,
    cut_while_paused,
    end_like_reset,
    ended_unplugged,
    ends_alike,
    ends_in_eor,
    eor_came_otherwise,
    er_was_hidden,
    forged_start,
    heard_late,
    is_silent_alarm,
    looks_like_a_stop,
    resume_was_hit,
    with_the_last,
)

__all__ = ["Excuses", "first_difference"]


def first_difference(got: bytes, program: bytes) -> int | None:
    """Where `got` is no beginning of `program` any more; None where it is one."""
    if program.startswith(got):
        return None
    return next((at for at, (one, other) in enumerate(zip(got, program, strict=False)) if one != other), len(program))


_BRIDGEPORT_NAME: Final = frozenset(b"0123456789;LD")

_NAME_CHARACTERS: Final = 24
"""DC2, its answer, a name, DC4 and DC1 on the line, and what a serial server adds to them."""

_LETS_GO: Final = frozenset(b"\x11\x15\x18")
"""DC1, NAK, CAN: what a host that is held by DC3 obeys (5.3)."""

_STALLS: Final = frozenset({Act.STALL.value, "clock step: host"})


class Excuses:
    """For one transfer. Each method returns the name of what nobody could have detected, or nothing."""

    def __init__(self, scenario: Scenario, evidence: Evidence) -> None:
        self._scenario = scenario
        self._evidence = evidence
        self._sends = scenario.direction is Direction.SEND
        self._is_a = scenario.protocol.startswith("fanuc-a")
        self._is_b = scenario.protocol.startswith("fanuc-b")
        self._data_wire = Wire.FROM_HOST if self._sends else Wire.FROM_CONTROL
        self._frame = 4 if self._is_b else 20
        """Characters a place may be off by the codes between program and wire: DC2, DC3; DC2 again and a name."""
        self._is_bridgeport = scenario.protocol == "bridgeport"
        cnc = scenario.settings.cnc
        named = cnc.get("program") != "-1"
        self._linked = self._is_bridgeport and cnc.get("mode", "D") == "D" and named
        self._loads = self._is_bridgeport and not self._linked and self._sends
        self._codes = scenario.codes

    # what happened, and would not have been noticed

    def _unseen(self, wire: Wire, job: Job | None = None) -> list[Damage]:
        """Those in the time of `job`, where one is given."""
        damages = self._evidence.unseen(wire)
        if self._scenario.settings.host.get("parity") == "software":
            # The engines check parity themselves: an odd number of bits turned is noticed.
            damages = [damage for damage in damages if not _odd(damage)]
        return [damage for damage in damages if job is None or job.covers(damage.moment)]

    def _program_damage(self, attempt: Attempt, until: int) -> Damage | None:
        """Unseen damage of the program's characters at or before byte `until` of an attempt."""
        before = attempt.place if self._sends else attempt.heard
        for damage in self._unseen(self._data_wire):
            is_before = not damage.place or damage.place - 1 - before <= until + self._frame
            if is_before and damage.moment >= attempt.began:
                return damage
        return None

    def _codes_hit(self, wire: Wire, codes: Iterable[int], job: Job) -> Damage | None:
        """Unseen damage that took one of `codes` away or made one, in the time of `job`."""
        wanted = frozenset(codes)
        for damage in self._unseen(wire, job):
            if wanted & (set(damage.sent) | set(damage.plain)):
                return damage
        return None

    def _dark_control(self, job: Job) -> str:
        """What ended the control's operation in the time of `job` and reached no host to which ER says nothing."""
        evidence = self._evidence
        if not self._er_unseen:
            return ""
        if any(what == "power cut: control" and job.covers(moment) for moment, what in evidence.acts):
            return Undetectable.DARK_CONTROL
        failed = self._evidence.control_ended(job, Outcome.FAILED)
        pulled = [damage for damage in evidence.damages if damage.kind == "pulled cable"]
        if not self._is_a and failed and any(job.covers(damage.moment) for damage in pulled):
            # SR855; and while DR is OFF neither SYN nor NAK is posted (6.1.2).
            return Undetectable.ALARM_UNPLUGGED
        return ""

    # what both ends did with what they had

    def _host_is_faithful(self, attempt: Attempt, wrong: int) -> bool:
        """What it handed over from the start of the attempt on is the program, as far as that matters."""
        sent = text_of(self._evidence.handed_over(attempt, attempt.place))
        program = text_of(self._evidence.program)
        differs = first_difference(sent[: len(program)], program)
        return differs is None or differs > wrong + self._frame

    def _receiver_is_faithful(self, attempt: Attempt, got: bytes) -> bool:
        """What came out of it had come in."""
        tap = self._evidence.cnc if self._sends else self._evidence.host
        return text_of(got) in text_of(bytes(tap.brought[attempt.brought :]))

    # the rules

    def content(self, attempt: Attempt | None, wrong: int, got: bytes) -> str:
        """Other bytes than the program's came through, from byte `wrong` of `got` on."""
        if attempt is None:
            return ""
        if self._is_a:
            return self._content_a(attempt, wrong)
        if self._linked and self._sends:
            return self._content_linked(attempt, got)
        if self._beside_the_program(attempt):
            return Undetectable.READ_AS_TEXT
        damage = self._program_damage(attempt, wrong)
        if self._is_b and self._began_too_early(attempt, got):
            return Undetectable.CODE
        faithful = not self._sends or self._host_is_faithful(attempt, wrong)
        if damage is None or not faithful or not self._receiver_is_faithful(attempt, got):
            return ""
        return damage.name

    def _began_too_early(self, attempt: Attempt, got: bytes) -> bool:
        """Where something made other characters of the program on the way, what came before it shows where the control
        began.
        """
        since = forged_start(self._scenario, self._evidence, attempt, self._unseen(Wire.FROM_CONTROL))
        if since is None or not self._receiver_is_faithful(attempt, got):
            return False
        begun_at = range(max(0, since - self._on_the_way), since + 1)
        damage = self._program_damage(attempt, len(self._evidence.program))
        clean = len(got) if damage is None else max(0, damage.place - 1 - attempt.place)
        return bool(got) and any(self._evidence.program.startswith(got[:clean], at) for at in begun_at)

    @property
    def _on_the_way(self) -> int:
        """Characters that may come in when a reading begins, though they were handed over before."""
        window = self._scenario.window or self._scenario.default_window
        return window + PATHS[self._scenario.path].out_of_reach

    def _content_a(self, attempt: Attempt, wrong: int) -> str:
        evidence = self._evidence
        if not (evidence.on(Wire.FROM_HOST) or evidence.on(Wire.FROM_CONTROL) or evidence.cut_short):
            return ""
        brought = bytes(evidence.cnc.brought[attempt.brought :])
        if cancelled_sums(evidence.host_lives, brought, self._n):
            return Undetectable.SUM
        return lost_packets(evidence, self._n, attempt, wrong)

    @property
    def _n(self) -> int:
        return packets_n(self._scenario)

    def _content_linked(self, attempt: Attempt, got: bytes) -> str:
        cnc = self._scenario.settings.cnc
        brought = bytes(self._evidence.cnc.brought[attempt.brought :])
        ends = self._codes.record_ends
        if forged_records(bytes(self._evidence.host.sent), brought, cnc.get("lrc", "xor7_etb"), ends):
            return Undetectable.CHECK
        stalls = [moment for moment, what in self._evidence.acts if what in _STALLS]
        holds = [damage.moment for damage in self._evidence.damages if damage.kind == "CTS OFF"]
        paused = any(moment >= attempt.began for moment in stalls + holds)
        text, program = text_of(got), text_of(self._evidence.expected)
        wrong = first_difference(text, program)
        lrc = cnc.get("lrc", "xor7_etb")
        if paused and wrong is not None and rest_fits(brought, text, program, wrong, lrc, ends):
            return Undetectable.REST
        for damage in self._unseen(Wire.FROM_CONTROL):
            if damage.moment >= attempt.began and self._codes.answers & (set(damage.sent) | set(damage.plain)):
                return Undetectable.ANSWER
        return ""

    def short(self, attempt: Attempt | None, job: Job) -> str:
        """Complete was said, and the program is not there whole."""
        if attempt is not None:
            got = bytes(attempt.delivered)
            wrong = first_difference(got, self._evidence.expected)
            if wrong is not None and (excuse := self.content(attempt, wrong, got)):
                return excuse
            damage = None if self._is_a else self._program_damage(attempt, len(self._evidence.program))
            if damage is not None:
                return damage.name
        if dark := self._dark_control(job):
            return dark
        if attempt is not None and (late := self._end_heard_late(attempt, job)):
            return late
        hit = self._name_changed(attempt) or self._codes_hit(Wire.FROM_CONTROL, _BRIDGEPORT_NAME, job)
        if self._is_bridgeport and hit:
            return Undetectable.OTHER_NAME
        return self.told_wrongly(job)

    def _end_heard_late(self, attempt: Attempt, job: Job) -> str:
        """The control was stopped, and its host heard that as the end, or when it had ended."""
        scenario, evidence = self._scenario, self._evidence
        missing = len(evidence.program) - attempt.got
        if self._is_b and ends_alike(scenario, evidence, job):
            if with_the_last(scenario, missing):
                return Undetectable.WITH_THE_LAST
            return Undetectable.LATE_WORD if heard_late(scenario, evidence, job, missing, CLOSING) else ""
        # DNC LINK answers the last record, so that its host knows what is whole; and a SYN may be said to be an end.
        syn_ends = self._is_b and scenario.settings.host.get("syn_at_end") == "complete"
        counts = syn_ends or not (self._is_a or self._is_b or self._linked)
        return Undetectable.LATE_WORD if counts and heard_late(scenario, evidence, job, missing, 0) else ""

    def _name_changed(self, attempt: Attempt | None) -> bool:
        """Bridgeport: the letter says which of the two the control wants (2.1.2, 2.2.2)."""
        if self._is_a or self._is_b or attempt is None:
            return False
        damages = self._unseen(Wire.FROM_CONTROL)
        return any(self._says_its_name(damage.moment, attempt) for damage in damages)

    def _says_its_name(self, moment: Nanos, attempt: Attempt) -> bool:
        """The control names the program, and asks for it, which it does later where a host that stalls answers late."""
        on_the_line = _NAME_CHARACTERS * character_time(self._scenario.baud)
        return attempt.began <= moment <= max(attempt.began, attempt.asked) + on_the_line

    def told_wrongly(self, job: Job) -> str:
        """What the control said of itself in the time of `job` came otherwise."""
        if self._is_a:
            heard = bytes(self._evidence.host.brought)
            return Undetectable.SUM if cancelled_sums([bytes(self._evidence.cnc.sent)], heard, 0) else ""
        return Undetectable.CODE if self._codes_hit(Wire.FROM_CONTROL, self._codes.all, job) else ""

    def less(self, attempts: list[Attempt], job: Job, missing: int) -> str:
        """`missing` characters fewer are with the control than the host holds for certain."""
        attempt = attempts[-1] if attempts else None
        if dark := self._dark_control(job):
            return dark
        gone = 0 if self._is_a else sum(map(self._lost, self._unseen(Wire.FROM_HOST, job)))
        if attempt is not None and not self._is_a:
            if 0 < missing <= gone:
                return Undetectable.LOST
            if self._eor_came_otherwise(attempt):
                return Undetectable.EOR
            unseen = self._unseen(Wire.FROM_HOST)
            if self._loads and text_ended_early(self._evidence, attempt, unseen, self._codes.ends):
                return Undetectable.FORGED_END
        if attempt is not None and self._is_a:
            got = bytes(attempt.delivered)
            wrong = first_difference(got, self._evidence.expected)
            if wrong == len(got) - 1 and ends_in_eor(self._scenario, got):
                return self.content(attempt, wrong, got)
            if wrong is not None and (packets := lost_packets(self._evidence, self._n, attempt, wrong)):
                return packets
            if went_round(self._evidence, self._n, attempt, job, missing):
                return Undetectable.TEN_PACKETS
        acknowledged = self._is_a or self._linked
        if not acknowledged and heard_late(self._scenario, self._evidence, job, missing - gone, self._ends_within(job)):
            return Undetectable.LATE_WORD
        return Undetectable.OTHER_NAME if self._name_changed(attempt) else self.told_wrongly(job)

    def _ends_within(self, job: Job) -> Nanos:
        """So long after what ended the control's operation. Where that looks like a stop, until somebody acts."""
        taken_for_a_stop = any(
            wait.job.began == job.began and looks_like_a_stop(self._scenario, self._evidence, wait)
            for wait in self._evidence.waits
        )
        return job.ended if self._is_b and taken_for_a_stop else LEAVING

    def more(self, attempts: list[Attempt], surplus: int) -> str:
        """`surplus` characters more are with the control than were handed over. It reads on when its host has ended."""
        attempt = max(attempts, key=lambda attempt: attempt.got)
        if self._is_a or surplus <= 0:
            return ""
        makers = self._makers(attempt)
        if surplus <= sum(map(self._gained, makers)):
            return makers[0].name
        beside_it = self._beside_the_program(attempt)
        if self._loads:
            # In the buffer of a control that did not come to the end stand codes that were not looked at.
            beside_it = max(beside_it, min(self._answers(attempt), attempt.got - len(attempt.delivered)))
        return Undetectable.READ_AS_TEXT if surplus <= beside_it else ""

    def _makers(self, attempt: Attempt) -> list[Damage]:
        """What made characters for the control while it was in this reading."""
        damages = [damage for damage in self._unseen(Wire.FROM_HOST) if self._while_read(damage, attempt)]
        return [damage for damage in damages if self._gained(damage)]

    def _gained(self, damage: Damage) -> int:
        """Characters that the control has more by it."""
        if self._is_bridgeport:
            return gained(damage, self._codes)
        return max(0, len(damage.plain) - len(damage.sent))

    def _lost(self, damage: Damage) -> int:
        """Characters that it has fewer by it."""
        if self._is_bridgeport:
            return lost(damage, self._codes)
        return max(0, len(damage.sent) - len(damage.plain))

    def _while_read(self, damage: Damage, attempt: Attempt) -> bool:
        return while_read(self._evidence, damage.moment, attempt)

    def _beside_the_program(self, attempt: Attempt) -> int:
        """Bridgeport: so many characters were taken beside those of the program, codes of the host and what was made on
        the wire. The host answered what the control had not said, and that waited for text. 0: it is not so.
        """
        if not (self._is_bridgeport and self._sends):
            return 0
        program, made = self._evidence.program, self._makers(attempt)
        count, answered = beside(attempt, program, made, self._answers(attempt), self._codes)
        return count if answered else 0

    def _answers(self, attempt: Attempt) -> int:
        """Codes of the host that may be read as text. Behind a character that noise made also the DC3 by which it
        closes a name, as the text has begun.
        """
        unasked = answered_unasked(self._evidence, attempt, self._unseen(Wire.FROM_CONTROL), self._codes)
        closes = self._scenario.settings.host.get("closing_dc3") == "on"
        return unasked + (closes and any(not hit.place for hit in self._makers(attempt)))

    def out_of_nothing(self, attempt: Attempt) -> str:
        """Something of a program that was not armed came."""
        unseen = self._unseen(Wire.FROM_HOST)
        if self._is_bridgeport:
            return self._text_of_codes(attempt, [hit for hit in unseen if hit.plain and self._while_read(hit, attempt)])
        for damage in unseen:
            if damage.moment >= attempt.began and not damage.place:
                return damage.name
        return ""

    def _text_of_codes(self, attempt: Attempt, made: list[Damage]) -> str:
        """A host that has nothing to send says codes only; they, or what came in their place, were read as text."""
        answers = self._answers(attempt)
        count, answered = beside(attempt, b"", made, answers, self._codes)
        if count < len(attempt.delivered) or attempt.got > sum(len(hit.plain) for hit in made) + answers:
            return ""
        return made[0].name if made and not answered else Undetectable.READ_AS_TEXT

    def undisturbed(self, attempt: Attempt | None) -> str:
        """Nothing happened, and it is not complete. Posting and ER together tell a reset."""
        told = self._scenario.settings.host.get("posting") != "off" and not self._er_unseen
        doubtful = self._is_b and self._sends and not told
        job = self._evidence.jobs[0]
        return Undetectable.END_LIKE_RESET if doubtful and end_like_reset(self._evidence, job, attempt) else ""

    def stuck(self, who: str) -> str:
        """Given up at one end, RESET at the other, and this one has not ended: a To that came otherwise (4.5)."""
        if not self._is_a or who != "control":
            return ""
        brought = bytes(self._evidence.cnc.brought)
        return Undetectable.SUM if cancelled_sums(self._evidence.host_lives, brought, self._n) else ""

    def overrun(self, moment: Nanos) -> str:
        """Too many characters came after a stop, on a path that would have stopped; told at `moment`."""
        since = max((attempt.began for attempt in self._evidence.attempts if attempt.began <= moment), default=0)
        # A host of protocol B stops at a damaged character too.
        damages = self._unseen(Wire.FROM_CONTROL) if self._is_b else self._evidence.on(Wire.FROM_CONTROL)
        late = [damage for damage in self._evidence.damages if damage.kind == "late stop"]
        if any(since <= damage.moment <= moment for damage in damages + late):
            return Undetectable.STOP_REQUEST
        return ""

    # nobody moves any more until a person does something

    def waiting(self, who: str, wait: Wait) -> str:
        if who == "host" or "host" in wait.who:
            return self._lost_the_thread(wait)
        if not wait.job.complete:
            # The rest of its work is its operator's.
            return Undetectable.OVER_AT_HOST
        if self._is_b and alarm_behind(self._scenario, self._evidence, wait):
            return Undetectable.SILENT_ALARM
        if self._linked and end_was_hidden(self._evidence, wait, self._codes.ends):
            return Undetectable.END_CODE
        return self.short(wait.attempt, wait.job)

    def _lost_the_thread(self, wait: Wait) -> str:
        job = wait.job
        if self._is_a:
            return self._left_while_holding(wait)
        if dark := self._dark_control(job):
            return dark
        if self._is_b and is_silent_alarm(self._scenario, self._evidence, job):
            return Undetectable.SILENT_ALARM
        # A second reading begins where the first one led the machine.
        if self._sends and wait.moving and self._scenario.override is not None and self._unseen(Wire.FROM_HOST):
            return Undetectable.LONG_BLOCK
        if self._is_b and self._sends and self._er_unseen and ended_unplugged(self._evidence, wait):
            return Undetectable.END_UNPLUGGED
        silent = self._is_b and self._er_unseen
        if silent and cut_while_paused(self._scenario, self._evidence, wait):
            return Undetectable.CS_OFF
        blind = silent or (self._is_b and er_was_hidden(self._evidence, wait.attempt))
        if blind and looks_like_a_stop(self._scenario, self._evidence, wait):
            return Undetectable.LOOKS_LIKE_STOP
        unseen = self._unseen(Wire.FROM_HOST, job)
        lost = (wait.said != wait.heard and self._touched(job)) or self._last_was_hit(wait)
        if lost or self._punch_out_was_hit(wait):
            return Undetectable.CODE
        if self._linked and self._sends and record_never_came(self._evidence, wait, self._codes.record_ends):
            return Undetectable.NO_RECORD
        if self._linked and self._sends and ended_unanswered(self._evidence, wait, unseen, self._codes.ends):
            return Undetectable.FORGED_END
        if self._name_was_hit(wait):
            return Undetectable.DAMAGED_NAME
        if self._is_b and self._sends and wait.attempt is not None:
            return Undetectable.EOR if self._eor_came_otherwise(wait.attempt) else ""
        return ""

    def _punch_out_was_hit(self, wait: Wait) -> bool:
        """What announces it, or lets it go on."""
        if self._sends:
            return False
        resume = resume_was_hit(self._unseen(Wire.FROM_HOST, wait.job), wait)
        return resume or (self._is_b and announcement_was_hit(self._evidence, wait))

    def _eor_came_otherwise(self, attempt: Attempt) -> bool:
        sent = len(self._evidence.handed_over(attempt, attempt.place))
        return eor_came_otherwise(self._scenario, self._evidence, attempt, sent, self._unseen(Wire.FROM_HOST))

    def _last_was_hit(self, wait: Wait) -> bool:
        """One ACK of many looks like another: what the control said last of all is what its host waits for."""
        ends = [damage.place + len(damage.sent) - 1 for damage in self._evidence.on(Wire.FROM_CONTROL) if damage.place]
        return wait.last_place in ends and not self._is_a

    def _name_was_hit(self, wait: Wait) -> bool:
        """Bridgeport: a damaged name is no name, so nothing is sent until the operator asks again."""
        attempt, evidence = wait.attempt, self._evidence
        if self._is_a or self._is_b or not self._sends or attempt is None:
            return False
        fell = [damage for damage in evidence.damages if damage.kind.startswith("DSR")]
        hits = evidence.on(Wire.FROM_CONTROL) + fell
        hit = any(self._says_its_name(damage.moment, attempt) for damage in hits)
        return hit and not text_of(self._evidence.handed_over(attempt, attempt.place))

    def _touched(self, job: Job) -> bool:
        """Something happened to what the control says, marked or not."""
        return any(job.covers(damage.moment) for damage in self._evidence.on(Wire.FROM_CONTROL))

    @property
    def _er_unseen(self) -> bool:
        return not self._scenario.has_signals or self._scenario.settings.host.get("er") == "hidden"

    def _left_while_holding(self, wait: Wait) -> str:
        """5.3 3): a host that was told to wait waits for the next monitor packet, and an open line says nothing."""
        job = wait.job
        held = self._n and ends_with_stop(bytes(self._evidence.host.brought[: wait.brought]))
        unheard = [damage for damage in self._evidence.on(Wire.FROM_CONTROL) if _LETS_GO & set(damage.sent)]
        why = any(job.covers(hit.moment) for hit in self._evidence.on(Wire.FROM_HOST) + unheard)
        if held and self._evidence.control_ended(job, Outcome.FAILED) and why:
            return Undetectable.GAVE_UP_HOLDING
        return ""


def _odd(damage: Damage) -> bool:
    return any(byte.bit_count() % 2 for byte in damage.plain)
