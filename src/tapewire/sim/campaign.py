"""A campaign: transfer after transfer by seed, each judged, all added up.

Where they run, on how many processors and for how long, is the caller's; here is no clock.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from tapewire.engine import Nanos
from tapewire.line.faults.presets import PRESETS, preset
from tapewire.protocols import PROTOCOLS, protocol
from tapewire.sim.checkers import Finding, judge
from tapewire.sim.evidence import Evidence
from tapewire.sim.scenarios import Direction, draw
from tapewire.sim.trial import Trial

__all__ = ["KEPT_FAILURES", "Case", "Report", "Totals", "cases", "names_of", "run_case"]

KEPT_FAILURES: Final = 1000
"""Failed transfers of a campaign that are kept singly; more are only counted."""

TRANSCRIPT_LINES: Final = 100_000


@dataclass(frozen=True, slots=True)
class Case:
    """One transfer of a campaign: everything about it follows from these three."""

    protocol: str
    preset: str
    seed: int

    @property
    def command(self) -> str:
        """Repeats it, to the byte."""
        seeds = f"{self.seed}..{self.seed}"
        return f"tapewire simulate --protocol {self.protocol} --faults {self.preset} --seeds {seeds} --transcript"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """How one transfer went."""

    case: Case
    direction: Direction
    outcome: str
    program_bytes: int
    simulated: Nanos
    faults: Counter[str]
    findings: tuple[Finding, ...]
    transcript: str = ""

    @property
    def violations(self) -> list[Finding]:
        return [finding for finding in self.findings if not finding.undetectable]


def run_case(case: Case, *, transcript: bool = False) -> Report:
    """Run one transfer and judge it. Raises UsageError for a protocol or a preset that there is not."""
    entry, plan = protocol(case.protocol), preset(case.preset)
    path = plan.path.name if plan.path is not None else None
    scenario = draw(case.protocol, case.preset, case.seed, path=path, punches_out=entry.punches_out)
    trial = Trial(scenario, plan, kept_lines=TRANSCRIPT_LINES if transcript else 0)
    evidence = trial.run()
    faults = Counter(trial.pair.line.log.counts)
    faults.update(what for _, what in evidence.acts)
    return Report(
        case=case,
        direction=scenario.direction,
        outcome=_outcome(evidence),
        program_bytes=len(evidence.program),
        simulated=trial.world.now,
        faults=faults,
        findings=tuple(judge(scenario, evidence)),
        transcript=f"{scenario}\n{trial.pair.transcript}" if transcript else "",
    )


def _outcome(evidence: Evidence) -> str:
    """Of the first job."""
    job = evidence.jobs[0] if evidence.jobs else None
    if job is None or evidence.broken:
        return "broken off"
    if job.killed:
        return "host's process ended"
    if any("host" in wait.who for wait in evidence.waits):
        return "ended by hand"
    return "complete" if job.complete else "not complete, and told so"


def names_of(word: str, names: Sequence[str]) -> list[str]:
    """`word` is one of `names`, or `all`."""
    return list(names) if word == "all" else [word]


def cases(protocols: str, presets: str, first: int, last: int) -> Iterator[Case]:
    """Every protocol under every preset with the first seed, then with the next: cut anywhere, all had their share."""
    for seed in range(first, last + 1):
        for protocol_name in names_of(protocols, list(PROTOCOLS)):
            for preset_name in names_of(presets, list(PRESETS)):
                yield Case(protocol_name, preset_name, seed)


@dataclass(slots=True)
class Totals:
    """What a campaign adds up to."""

    transfers: int = 0
    program_bytes: int = 0
    simulated: Nanos = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    undetectable: Counter[tuple[str, str]] = field(default_factory=Counter)
    """By protocol and name."""
    violations: Counter[str] = field(default_factory=Counter)
    """By rule."""
    failed: int = 0
    failures: list[Report] = field(default_factory=list)

    def add(self, report: Report) -> None:
        self.transfers += 1
        self.program_bytes += report.program_bytes
        self.simulated += report.simulated
        self.outcomes[report.outcome] += 1
        self.faults.update(report.faults)
        self.undetectable.update({(report.case.protocol, finding.undetectable) for finding in report.findings} - _NONE)
        if violations := report.violations:
            self.failed += 1
            self.violations.update(finding.rule for finding in violations)
            if len(self.failures) < KEPT_FAILURES:
                self.failures.append(report)


_NONE: Final = {(name, "") for name in PROTOCOLS}
