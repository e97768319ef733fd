"""A line proves itself before the first cut: cable, characters, stop distance and rate, and a verdict in plain words.

Nothing is sent that was not asked for: without a loop-back plug and without a program the line is only looked at and
listened to.
"""

from __future__ import annotations

import asyncio
import dataclasses
import hashlib
import json
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from enum import StrEnum
from html import escape
from pathlib import Path
from typing import Any, Final

from tapewire.engine import SECOND, Notice, Outcome, SignalsIn
from tapewire.errors import LineError
from tapewire.line.address import TtyAddress
from tapewire.line.cable import DRIVEN, Wiring, wiring_of
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.guess import Heard, best_of, code_of
from tapewire.line.link import Link
from tapewire.line.loop_back import LoopBack
from tapewire.line.open import open_line
from tapewire.line.pacing import default_window
from tapewire.line.ports.files import USUAL_RATES, PortFiles
from tapewire.line.transport import Fault
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Result
from tapewire.transfer.sending import send_program
from tapewire.transfer.session import JobSettings

__all__ = ["Finding", "Plan", "Weight", "qualify_line"]

SETTLE_S: Final = 0.15
"""After a control line was driven, until a serial server has told what became of it."""

PATTERN_S: Final = 3.0
"""A loop-back plug is tried for so much of the line."""
PATTERN_LIMITS: Final = (300, 20_000)
STOPS: Final = 10

FRAMINGS: Final = ((8, 2), (8, 1), (7, 2))
"""(data bits, stop bits) that are listened with: 8N2 shows every bit, 8E1 and 7E2 are what controls use."""


class Weight(StrEnum):
    """What a finding means for the job."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was found out."""

    about: str
    text: str
    weight: Weight = Weight.NOTE


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What to do besides looking."""

    loop_back: bool = False
    program: Program | None = None
    listen_s: float = 0.0
    report: Path | None = None
    """Written as JSON here, and as a page to print beside it."""


@dataclass(slots=True)
class _Report:
    job: JobSettings
    needed: int
    findings: list[Finding] = field(default_factory=list)

    def add(self, about: str, text: str, weight: Weight = Weight.NOTE) -> None:
        finding = Finding(about=about, text=text, weight=weight)
        self.findings.append(finding)
        mark = "" if weight is not Weight.BAD else "NOT GOOD: "
        self.job.observer(Notice(text=f"{about}: {mark}{text}"), monotonic())

    @property
    def verdict(self) -> str:
        """In plain words."""
        what = f"drip feed by {self.job.protocol.name} at {self.job.baud} baud"
        bad = [finding.text for finding in self.findings if finding.weight is Weight.BAD]
        if bad:
            return f"not fit for {what}: {'; '.join(bad)}"
        if not any(finding.weight is Weight.GOOD for finding in self.findings):
            return f"nothing speaks against {what}, and nothing was proved: give it a loop-back plug or a program"
        window = default_window(self.job.baud, self.needed)
        return f"fit for {what}, with {window} characters in flight"

    @property
    def is_fit(self) -> bool:
        return not any(finding.weight is Weight.BAD for finding in self.findings)


async def qualify_line(job: JobSettings, plan: Plan) -> Result:
    """Find out what the line of `job` is worth. Raises LineError when it cannot be opened.

    `complete` means that nothing was found against it; each finding is told as a Notice, the verdict is the reason.
    """
    report = _Report(job, job.protocol.host(job.params).needs_stop_distance)
    result: Result | None = None
    began = monotonic()
    is_real = _look_at_port(report)
    # Whoever is at the far end of a connection ends with it: there a job is the only one who may open it.
    if is_real or plan.loop_back or plan.program is None:
        await _bounded(report, _look(report, plan))
    if plan.listen_s and not job.stop.is_set():
        await _bounded(report, _listen(report, plan.listen_s))
    if plan.program is not None and not job.stop.is_set():
        result = await _give_program(report, plan.program)
    stopped = job.stop.is_set()
    verdict = "given up here" if stopped else report.verdict
    if plan.report is not None:
        await asyncio.to_thread(_write, plan.report, report, verdict)
    outcome = Outcome.CANCELLED if stopped else Outcome.COMPLETE if report.is_fit else Outcome.FAILED
    if result is not None:
        return dataclasses.replace(result, outcome=outcome, reason=verdict)
    return Result(
        outcome=outcome,
        reason=verdict,
        bytes=0,
        bytes_handed=0,
        sha256=hashlib.sha256().hexdigest(),
        seconds=(monotonic() - began) / SECOND,
        stops=0,
        utilisation=None,
    )


async def _bounded(report: _Report, work: Coroutine[Any, Any, None]) -> None:
    """Until `work` is done, somebody wants to stop, or the time is up."""
    job = report.job
    working, stopping = asyncio.ensure_future(work), asyncio.ensure_future(job.stop.wait())
    left = None if job.timeout_s is None else max(0.0, job.timeout_s - (monotonic() - job.began) / SECOND)
    try:
        await asyncio.wait([working, stopping], timeout=left, return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopping.cancel()
        working.cancel()
        await asyncio.wait([working])
    if not working.cancelled():
        working.result()
    elif not job.stop.is_set():
        report.add("time", f"not complete within {job.timeout_s:g} s", Weight.BAD)


async def _look(report: _Report, plan: Plan) -> None:
    line = await _open(report.job, report)
    try:
        _stop_distance(report, line)
        await _wiring(report, line)
        if plan.loop_back:
            await _loop_back(report, line)
    finally:
        line.close(monotonic())


async def _open(job: JobSettings, report: _Report) -> DescriptorLine:
    return await open_line(
        job.line,
        baud=job.baud,
        stopbits=job.stopbits,
        data_bits=job.data_bits,
        window=default_window(job.baud, report.needed),
        on_ready=lambda line: job.observer(Ready(line=line), monotonic()),
        on_note=lambda text: report.add("port", text),
    )


def _look_at_port(report: _Report) -> bool:
    """False for what is no port of this computer."""
    if not isinstance(report.job.line, TtyAddress):
        return False
    port = PortFiles().describe(report.job.line.path)
    if port is None:
        return False
    report.add(
        "port", f"{port.chip.title}, driver {port.driver or 'unknown'}{f', {port.product}' if port.product else ''}"
    )
    for advice in port.advice:
        report.add("port", advice)
    return True


def _stop_distance(report: _Report, line: DescriptorLine) -> None:
    stated = line.stop_distance
    text = f"{stated.characters} stated, {report.needed} tolerated; {stated.how}"
    report.add("stop distance", text)
    if stated.characters > report.needed:
        report.add("stop distance", "more may be under way than the control tolerates", Weight.BAD)


async def _wiring(report: _Report, line: DescriptorLine) -> None:
    seen = {}
    now: SignalsIn | None = None
    for driven in DRIVEN:
        line.set_signals(driven, monotonic())
        await asyncio.sleep(SETTLE_S)
        now = next((item for item in reversed(line.read(monotonic())) if isinstance(item, SignalsIn)), now)
        if now is None:
            report.add(
                "cable", "this line has no control lines: a control cannot stop us by RS, nor tell that it is off"
            )
            return
        seen[driven] = now
    wiring: Wiring = wiring_of(seen)
    for word in wiring.words:
        report.add("cable", word)
    if not wiring.steady["CTS"]:
        report.add(
            "cable", "nothing is sent while CTS is OFF (?signals=ignored behind the LINE for three wires)", Weight.BAD
        )


async def _loop_back(report: _Report, line: DescriptorLine) -> None:
    settings = _line_settings(report.job)
    low, high = PATTERN_LIMITS
    length = min(max(int(PATTERN_S * SECOND) // settings.character, low), high)
    engine = LoopBack(length, STOPS, settings.data_bits, settings.character)
    driver = LineDriver(Link(engine, line))
    stop = asyncio.ensure_future(_woken_by(report.job.stop, driver))
    try:
        await driver.run(lambda: engine.is_over or report.job.stop.is_set())
    finally:
        stop.cancel()
    if not engine.came:
        report.add("loop-back", engine.closed or "nothing came back", Weight.BAD)
        return
    worst = max(engine.after_stops, default=0)
    clean = engine.wrong == 0
    text = f"{engine.came} of {engine.sent} characters came back, {engine.wrong} wrong or lost"
    report.add("loop-back", text, Weight.GOOD if clean else Weight.BAD)
    report.add("loop-back", f"{engine.rate(settings.character):.0%} of the line in use")
    text = f"after {len(engine.after_stops)} stops at most {worst} characters still came, {report.needed} are tolerated"
    report.add("stop distance", text, Weight.GOOD if worst <= report.needed else Weight.BAD)


async def _woken_by(stop: asyncio.Event, driver: LineDriver) -> None:
    await stop.wait()
    driver.wake()


def _line_settings(job: JobSettings) -> LineSettings:
    return LineSettings(baud=job.baud, stopbits=job.stopbits, data_bits=job.data_bits, window=1)


async def _listen(report: _Report, seconds: float) -> None:
    """The control talks, whatever it says: at which rate and in which framing does it make sense?"""
    heard: dict[str, Heard] = {}
    rates = sorted(USUAL_RATES, key=lambda rate: rate != report.job.baud)
    for baud in rates:
        for data_bits, stopbits in FRAMINGS:
            how = LineSettings(baud=baud, stopbits=stopbits, data_bits=data_bits, window=1)
            name = f"{baud} baud {how.framing}"
            try:
                heard[name] = await _heard(report.job, how, seconds)
            except LineError as error:
                report.add("listening", f"{name} cannot be tried: {error}")
            if report.job.stop.is_set():
                return
        if any(what.score > 0.95 for what in heard.values()):
            break
    likely = best_of(heard)
    if not likely:
        report.add("listening", "the control said nothing that makes sense at any rate")
        return
    best = likely[0]
    report.add("listening", f"the control seems to talk at {best}: {heard[best].score:.0%} of what came makes sense")
    report.add("listening", code_of(heard[best].data))


async def _heard(job: JobSettings, how: LineSettings, seconds: float) -> Heard:
    line = await open_line(job.line, baud=how.baud, stopbits=how.stopbits, data_bits=how.data_bits, window=1)
    data, damaged = bytearray(), 0
    until = monotonic() + int(seconds * SECOND)
    try:
        while monotonic() < until and not job.stop.is_set():
            for item in line.read(monotonic()):
                if isinstance(item, bytes):
                    data += item
                damaged += isinstance(item, Fault)
            await asyncio.sleep(0.02)
    finally:
        line.close(monotonic())
    return Heard(data=bytes(data), damaged=damaged)


async def _give_program(report: _Report, program: Program) -> Result:
    """A whole job, as it will be: the control asks, stops and goes on."""
    violations: list[str] = []

    def observe(event: Any, now: int) -> None:
        if type(event).__name__ == "Violation":
            violations.append(event.what)
        report.job.observer(event, now)

    result = await send_program(program, dataclasses.replace(report.job, observer=observe))
    good = result.outcome is Outcome.COMPLETE and not violations
    used = "" if result.utilisation is None else f", {result.utilisation:.1%} of the line in use"
    text = f"{result.outcome}: {result.reason}; {result.stops} stops{used}, {len(violations)} violations"
    report.add("program", text, Weight.GOOD if good else Weight.BAD)
    return result


def _write(path: Path, report: _Report, verdict: str) -> None:
    job = report.job
    facts = {
        "line": str(job.line),
        "protocol": job.protocol.name,
        "baud": job.baud,
        "framing": _line_settings(job).framing,
        "tolerated": report.needed,
        "fit": report.is_fit,
        "verdict": verdict,
        "findings": [dataclasses.asdict(finding) for finding in report.findings],
    }
    path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    path.with_suffix(".html").write_text(_page(facts, report.findings), encoding="utf-8")


def _page(facts: dict[str, Any], findings: list[Finding]) -> str:
    """One sheet, nothing loaded from anywhere."""
    rows = "".join(
        f"<tr class={finding.weight}><td>{escape(finding.about)}<td>{escape(finding.text)}<td>{finding.weight}"
        for finding in findings
    )
    names: Callable[[str], str] = lambda name: escape(str(facts[name]))  # noqa: E731
    return (
        "<!doctype html><meta charset=utf-8><title>Line qualified</title>"
        "<style>body{font:11pt sans-serif;max-width:45em;margin:2em auto}td{border-top:1px solid #999;padding:.3em}"
        ".bad td{font-weight:bold}</style>"
        f"<h1>{names('line')}</h1><p>{names('protocol')}, {names('baud')} baud, {names('framing')}."
        f"<p><b>{names('verdict')}</b><table>{rows}</table>\n"
    )
