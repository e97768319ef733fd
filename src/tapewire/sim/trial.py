"""Runs one scenario: arms the host, presses the buttons, lets the faults happen, and waits for the end.

Nobody waits for ever: when neither end has anything more to come, the operator ends it, and that is evidence too.
"""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import Any, Final

from tapewire.engine import SECOND, AfterStop, Ended, Event, Nanos, Outcome
from tapewire.errors import UsageError
from tapewire.line.faults.damage import Parity
from tapewire.line.faults.plan import CutPower, EndFault, Extent, FaultPlan, LineEnd, RestartProcess, StepClock, Wire
from tapewire.line.faults.when import next_moment
from tapewire.line.paths import PATHS
from tapewire.line.reception import Cut
from tapewire.line.transport import Fault
from tapewire.sim.beliefs import disagreement
from tapewire.sim.evidence import Attempt, Evidence, Job, Wait
from tapewire.sim.execution import BlockTime, Speeds
from tapewire.sim.frames import last_codes
from tapewire.sim.machine import Control
from tapewire.sim.memory import footprint
from tapewire.sim.pair import Pair
from tapewire.sim.scenarios import Act, Direction, Finish, OperatorAct, Scenario
from tapewire.sim.streams import Draws
from tapewire.sim.world import World

__all__ = ["PATIENCE", "Trial"]

PATIENCE: Final[Mapping[str, Nanos]] = {
    # Ne retries and a SYN, each after To, Tp and the turn of the line; To is 20 s at most, Ne 10.
    "fanuc-a": 600 * SECOND,
    "fanuc-a-expansion": 600 * SECOND,
    # The longest deadline of the host: DAMAGED_WAIT, 60 s. Everything else waits for a code of the control.
    "fanuc-b": 90 * SECOND,
    "fanuc-b-expansion": 90 * SECOND,
    # pause_limit and hold_limit, 600 s, and a reception's text_timeout behind it.
    "bridgeport": 700 * SECOND,
}
"""So long after the last disturbance, and the time an undisturbed transfer takes, everybody has come to an end."""

AFTER_RESET: Final[Nanos] = 60 * SECOND
"""After RESET at the control, or after the host was told to give up, it is over within this."""

QUIET: Final[Nanos] = 3 * SECOND
"""The operator looks on for so long before the next act."""

BACK: Final[Nanos] = 60 * SECOND
"""Whoever lost his power has it again by then."""

NOBODY_COMES: Final[Nanos] = 30 * SECOND
"""An armed host whose control is at rest, or a control whose host has ended, is left waiting for so long."""

HANDSHAKE: Final = 600
"""Characters of initialisation, polls and answers beside the program, about."""

CALM_AFTER: Final[Nanos] = 20 * SECOND
"""Faults go on for so long beyond the time of an undisturbed transfer."""

UNARMED: Final[Nanos] = 20 * SECOND
"""A control that asks a host with nothing armed is watched for so long."""

MOST_END_FAULTS: Final = 5
"""Power cuts and restarts in one transfer; more and nothing happens between them."""


class _Hesitant:
    """A program that has nothing yet now and then, as a slow disk or a network has."""

    def __init__(self, program: bytes, pauses: float, draws: Draws) -> None:
        self._file = BytesIO(program)
        self._pauses = pauses
        self._draws = draws

    def read(self, size: int) -> bytes | None:
        if self._pauses and self._draws.happens(self._pauses):
            return None
        return self._file.read(size)


class _Taken:
    """Where the control puts what it takes: the attempt under way."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence

    def write(self, data: bytes) -> None:
        if self._evidence.attempts:
            self._evidence.attempts[-1].delivered += data


class Trial:
    """One run of `scenario` under `plan`."""

    def __init__(self, scenario: Scenario, plan: FaultPlan, *, kept_lines: int = 0) -> None:
        self.scenario = scenario
        self.evidence = Evidence(program=scenario.program, expected=scenario.expected)
        self.world = World(scenario.seed, kept_lines=kept_lines)
        self._plan = plan
        self._draws = Draws(scenario.seed, scenario.protocol, scenario.preset, "trial")
        self._sends = scenario.direction is Direction.SEND
        self._busy = False
        """The control is in an operation."""
        self._requests = scenario.codes.requests
        self._host_gone = False
        self._taken = _Taken(self.evidence)
        self._extent = Extent(characters=scenario.size + HANDSHAKE, span=scenario.line_time + 2 * SECOND)
        self.pair = self._machine()

    # the machine

    def _machine(self) -> Pair:
        scenario = self.scenario
        pair = self.world.pair(
            scenario.protocol,
            baud=scenario.baud,
            host_settings=scenario.settings.host,
            cnc_settings=scenario.settings.cnc,
            window=scenario.window,
            cnc_window=scenario.cnc_window,
            grain=scenario.grain,
            has_signals=scenario.has_signals,
            path=PATHS[scenario.path],
            faults=self._plan,
            extent=self._extent,
            parity=Parity.CHECKED if scenario.parity else Parity.NONE,
            sink=self._taken,
            **self._operator(),
        )
        if scenario.late:
            late = Draws(scenario.seed, scenario.protocol, "late")
            pair.host_side.late = lambda: round(late.random() ** 4 * scenario.late)
        pair.on_host_event = self._host_event
        pair.on_cnc_event = self._cnc_event
        pair.on_step = self._step
        pair.line.log.on_fault = self.evidence.note_fault
        self._tap(pair)
        return pair

    def _operator(self) -> dict[str, Any]:
        scenario = self.scenario
        if scenario.override is not None:
            return {"block_time": BlockTime(Speeds(override=scenario.override)), "binary": None}
        # No program of a campaign holds G05, and without it blocks that take no time are executed all at once.
        return {"blocks_per_second": scenario.blocks_per_second, "binary": None}

    def _tap(self, pair: Pair) -> None:
        if not self.scenario.protocol.startswith("fanuc-a"):
            codes = self.scenario.codes
            self.evidence.host.codes = codes.all
            if self._sends:
                self.evidence.host.stops, self.evidence.host.goes = codes.stops, codes.goes
                self.evidence.host.opens = codes.opens
        self.evidence.host.listen(pair.host_link)
        self.evidence.cnc.listen(pair.cnc_link)

    def _step(self, now: Nanos) -> None:
        if self._sends and self._busy:
            cnc = self.pair.cnc
            attempt = self.evidence.attempts[-1]
            got = max(cnc.progress + cnc.buffered, len(attempt.delivered))
            if got > attempt.got:
                attempt.got = got
            if self._requests and not attempt.asked and self._has_asked(attempt):
                attempt.asked = now

    def _has_asked(self, attempt: Attempt) -> bool:
        return not self._requests.isdisjoint(self.evidence.cnc.sent[attempt.heard :])

    def _host_event(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Ended) and self._job is not None:
            job = self._job
            self._step(now)
            job.complete = event.outcome is Outcome.COMPLETE
            job.low, job.high, job.reason, job.ended = event.bytes_low, event.bytes_high, event.reason, now
            if job.complete:
                self.evidence.disagreement = disagreement(self.pair.host, self.pair.cnc)
            attempts = self.evidence.attempts[job.attempts_before :]
            if attempts:
                job.got_at_end = max(attempt.got for attempt in attempts)
                job.delivered_at_end = len(attempts[-1].delivered)

    def _cnc_event(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Ended):
            self._step(now)
            if self._busy and self._sends and self.scenario.protocol.startswith("fanuc-b"):
                # What came together with the damage that ends the reading was never seen in its buffer.
                attempt = self.evidence.attempts[-1]
                brought = len(self.evidence.cnc.brought) - attempt.brought
                attempt.got = max(attempt.got, min(brought, event.bytes_high))
            self.evidence.control_ends.append((now, event.outcome))
            self._busy = False
        elif isinstance(event, AfterStop):
            self.evidence.overruns.append((now, event.count, event.allowed))

    @property
    def _job(self) -> Job | None:
        """The job under way."""
        job = self.evidence.jobs[-1] if self.evidence.jobs else None
        return job if job is not None and job.complete is None and not job.killed else None

    @property
    def _calm_from(self) -> Nanos:
        """Faults have an end, so that there is something to wait for after the last one."""
        scenario = self.scenario
        return scenario.start + scenario.run_time + scenario.held + CALM_AFTER

    # the run

    def run(self) -> Evidence:
        """Everything from the arming to the end."""
        try:
            self._arm()
            self.world.at(self.scenario.start, self._press_start)
            for act in self.scenario.acts:
                self.world.at(act.moment, lambda act=act: self._act(act))  # type: ignore[misc]
            self._schedule_end_faults()
            self.world.at(self._calm_from, self.pair.calm)
            self._run_to_the_end()
            self.world.run_for(QUIET)
            self._finish()
        except Exception as error:  # whatever an engine raises is a finding, not the end of a campaign
            self.evidence.broken = f"{type(error).__name__}: {error}"
        self.evidence.footprint = self._footprint()
        return self.evidence

    def _arm(self) -> None:
        evidence = self.evidence
        job = Job(began=self.world.now, attempts_before=len(evidence.attempts), place=len(evidence.host.sent))
        if self._sends:
            source = _Hesitant(self.evidence.program, self.scenario.source_pauses, self._draws)
            self.pair.host.start(source, self.world.now)
        else:
            self.pair.host.receive(_Store(job.stored), self.world.now)
        self.evidence.jobs.append(job)

    def _press_start(self) -> None:
        """CYCLE START, or the soft key that punches."""
        now = self.world.now
        if self._busy or self.pair.cnc_side.off:
            return
        attempt = Attempt(
            began=now,
            armed=self._job is not None,
            place=len(self.evidence.host.sent),
            heard=len(self.evidence.cnc.sent),
            brought=len(self.evidence.cnc.brought if self._sends else self.evidence.host.brought),
        )
        try:
            if self._sends:
                self.pair.control.cycle_start(now)
            else:
                self.pair.cnc.punch(BytesIO(self.evidence.program), now)
        except UsageError:
            return
        self._busy = True
        self.evidence.attempts.append(attempt)

    def _is_over(self) -> bool:
        """Both are at rest, or one of them is, and the other waits for somebody who does not come."""
        job = self._job
        if job is not None and self._busy:
            return False
        if job is None and not self._busy:
            return True
        quiet_since = max(self.scenario.start, self.evidence.last_disturbance, self._last_act, self._host_over_at)
        if self.world.now <= quiet_since + NOBODY_COMES:
            return False
        return self._host_waits_for_nobody if job is not None else not self.evidence.jobs[-1].complete

    @property
    def _host_over_at(self) -> Nanos:
        return self.evidence.jobs[-1].ended

    @property
    def _last_act(self) -> Nanos:
        return max((act.moment + act.span for act in self.scenario.acts), default=0)

    def _run_to_the_end(self) -> None:
        """Until both are at rest. A control whose host has ended without being complete is reset, and a host whose job
        never began is told to give up, as their operators would.
        """
        scenario, evidence = self.scenario, self.evidence
        began = self.world.now + scenario.start
        patience = scenario.run_time + scenario.held + PATIENCE[scenario.protocol]
        while not self.world.advance(self._is_over, max(began, evidence.last_disturbance) + patience):
            if self.world.now >= max(began, evidence.last_disturbance) + patience:
                self._end_the_waiting()
                return
        if self._busy:
            self._reset()
            self.world.advance(lambda: not self._busy, self.world.now + AFTER_RESET)
            evidence.stuck += ["control"] * self._busy
        if self._job is not None:
            self._abort()

    def _end_the_waiting(self) -> None:
        evidence = self.evidence
        wait = Wait(
            who=("host",) * (self._job is not None) + ("control",) * self._busy,
            job=evidence.jobs[-1],
            attempt=evidence.attempts[-1] if evidence.attempts else None,
            said=last_codes(bytes(evidence.cnc.sent), evidence.host.codes),
            heard=evidence.host.last_codes,
            last_place=len(evidence.cnc.sent),
            brought=len(evidence.host.brought),
            told=len(evidence.host.sent),
            moving=self.pair.control.moving,
        )
        evidence.waits.append(wait)
        if not self.pair.cnc_side.off:
            self._reset()
        self.world.advance(self._is_over, self.world.now + AFTER_RESET)
        if self._job is not None:
            self._abort()
        evidence.stuck += ["host"] * (self._job is not None) + ["control"] * self._busy

    def _abort(self) -> None:
        self.evidence.note_act(Act.ABORT.value, self.world.now)
        if not self.pair.host_side.off:
            self.pair.host.abort(self.world.now)
        self.world.advance(lambda: self._job is None, self.world.now + AFTER_RESET)

    @property
    def _host_waits_for_nobody(self) -> bool:
        """It is armed, nothing of the job has begun, and the control asks for nothing: it waits for its operator."""
        return self._job is not None and not self._busy and not self.pair.host.progress

    def _reset(self) -> None:
        if self.pair.cnc_side.off:
            return
        self.evidence.note_act(Act.RESET.value, self.world.now)
        self.pair.control.reset(self.world.now)

    def _finish(self) -> None:
        match self.scenario.finish:
            case Finish.LEAVE:
                return
            case Finish.START_UNARMED if self._job is None:
                self._reset_and_wait()
                self._press_start()
                self.world.run_for(UNARMED)
                self._reset()
            case Finish.START_AGAIN if self._job is None:
                self._reset_and_wait()
                self._arm()
                self._press_start()
                self._run_to_the_end()
            case _:
                return
        self.world.run_for(QUIET)

    def _reset_and_wait(self) -> None:
        """Both ends have power, the control is reset, and the operator looks on for a while."""
        self._reset()
        self.world.run_for(QUIET)
        self.world.advance(lambda: not self.pair.host_side.off and not self.pair.cnc_side.off, self.world.now + BACK)

    # persons, and what happens to the ends

    def _act(self, act: OperatorAct) -> None:
        now, pair = self.world.now, self.pair
        control_works = not pair.cnc_side.off
        self.evidence.note_act(act.act.value, now)
        match act.act:
            case Act.RESET if control_works:
                pair.control.reset(now)
            case Act.ALARM if control_works:
                pair.control.alarm(now)
            case Act.FEED_HOLD if control_works:
                self._hold(pair.control, act.span)
            case Act.SINGLE_BLOCK if control_works:
                self._single_block(pair.control, act.span)
            case Act.ABORT if not pair.host_side.off:
                pair.host.abort(now)
            case Act.STALL:
                self._sleep(now + act.span)
            case Act.PAUSE if not pair.host_side.off:
                pair.host.hold_reception(now)
                self.world.at(now + act.span, lambda: self._release(pair.host_side.off))
            case _:
                pass

    def _hold(self, control: Control, span: Nanos) -> None:
        control.feed_hold(self.world.now)
        self.world.at(self.world.now + span, lambda: control.go(self.world.now))

    def _single_block(self, control: Control, span: Nanos) -> None:
        """The switch is on for `span`, and the operator presses CYCLE START for every block."""
        control.single_block = True
        end = self.world.now + span

        def press() -> None:
            control.single_block = self.world.now < end
            control.go(self.world.now)
            if control.single_block:
                self.world.at(self.world.now + SECOND, press)

        self.world.at(self.world.now + SECOND, press)

    def _release(self, host_is_off: bool) -> None:
        if not host_is_off:
            self.pair.host.release(self.world.now)

    def _schedule_end_faults(self) -> None:
        for number, fault in enumerate(self._plan.end_faults):
            stream = Draws(self.scenario.seed, self.scenario.protocol, "end", str(number)).stream
            moment = next_moment(fault.when, stream, 0, self._extent)
            for _ in range(MOST_END_FAULTS):
                if moment is None:
                    break
                self.world.at(moment, lambda fault=fault: self._strike(fault))  # type: ignore[misc]
                moment = next_moment(fault.when, stream, moment, self._extent)

    def _strike(self, fault: EndFault) -> None:
        now, pair = self.world.now, self.pair
        self.evidence.note_end_fault(fault, now)
        match fault:
            case StepClock(end=LineEnd.HOST, step=step):
                self._sleep(now + step)
            case RestartProcess(off=off) if not pair.host_side.off:
                self._host_dies()
                pair.kill_host(now)
                self.world.at(now + off, self._host_returns)
            case CutPower(end=LineEnd.HOST, off=off) if not pair.host_side.off:
                self._host_dies()
                self._note_cut(pair.cut_power(pair.host_side, now), Wire.FROM_HOST)
                self.world.at(now + off, self._host_returns)
            case CutPower(end=LineEnd.CONTROL, off=off) if not pair.cnc_side.off:
                self._busy = False
                self._note_cut(pair.cut_power(pair.cnc_side, now), Wire.FROM_CONTROL)
                self.world.at(now + off, self._control_returns)
            case _:
                pass

    def _sleep(self, until: Nanos) -> None:
        """The host's computer does nothing before. A sleep that falls into another is one with it; however late the
        computer is otherwise, it does something when it wakes.
        """
        sleeps, since = self.evidence.sleeps, self.world.now
        if sleeps and since <= sleeps[-1][1]:
            since, until = sleeps[-1][0], max(sleeps.pop()[1], until)
        self.pair.host_side.asleep_until = until
        sleeps.append((since, until))

    def _note_cut(self, cut: Cut, wire: Wire) -> None:
        """What was under way counts as sent if something was read of it, and as damaged if that is something else."""
        tap = self.evidence.host if wire is Wire.FROM_HOST else self.evidence.cnc
        tap.never_left(cut.lost - isinstance(cut.read, bytes))
        if cut.read is not None and cut.read != cut.was:
            place = len(tap.sent) + isinstance(cut.read, Fault)
            self.pair.line.log.note(self.world.now, "cut character", wire, place, cut.was, (cut.read,))

    def _host_dies(self) -> None:
        if (job := self._job) is not None:
            job.killed = True

    def _host_returns(self) -> None:
        """The program starts anew, with nothing armed: it resumes nothing by itself."""
        self.evidence.last_disturbance = max(self.evidence.last_disturbance, self.world.now)
        self.evidence.cut_short.append(len(self.evidence.host.sent))
        self.pair.restart_host(self.world.now)
        self.evidence.host.listen(self.pair.host_link)

    def _control_returns(self) -> None:
        self.evidence.last_disturbance = max(self.evidence.last_disturbance, self.world.now)
        self.pair.restart_control(self._taken, self.world.now, **self._operator())
        self.evidence.cnc.listen(self.pair.cnc_link)

    def _footprint(self) -> int:
        """In one transfer of sixteen: it costs more than most transfers."""
        if self.scenario.seed % 16:
            return 0
        held = max(footprint(self.pair.host), footprint(self.pair.cnc))
        return max(0, held - len(self.evidence.program))


class _Store:
    """Where the host puts what it receives."""

    def __init__(self, stored: bytearray) -> None:
        self._stored = stored

    def write(self, data: bytes) -> None:
        self._stored += data
