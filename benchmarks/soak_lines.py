"""The near side of the soak: one line after another gets jobs, is disturbed, and every byte delivered is compared."""

from __future__ import annotations

import asyncio
import json
import random
import re
import signal
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from benchmarks.soak_ends import ANSWER_LIMIT_S, Far, SerialServer
from tapewire.engine import Nanos, Outcome, Violation
from tapewire.errors import LineError
from tapewire.protocols import protocol
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.protocols.settings import End
from tapewire.transfer.api import receive, send
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Report, Result
from tapewire.transfer.session import settings_for

BITS: Final = 11
FINISH_S: Final = 20.0
"""So long a control may take for what it has and has not executed: at most its buffers, at 70 % of the line."""


@dataclass
class Tally:
    """What happened, of all lines together."""

    jobs: Counter[str] = field(default_factory=Counter)
    """By kind of line."""
    complete: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)
    bytes: int = 0
    plugs: int = 0
    unplugs: int = 0
    restarts: int = 0
    to_control: int = 0
    to_control_seen: int = 0
    to_host: int = 0
    to_host_seen: int = 0
    other_faults: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One job: what is sent or punched out, and what happens meanwhile."""

    name: str
    program: Path
    punch: bool
    seconds: float
    """What the line alone takes."""
    disturb_after_s: float | None


def program_text(chance: random.Random, name: str, size: int, framed: bool) -> bytes:
    """About `size` bytes that no other job has."""
    blocks = [f"(SOAK {name.upper()})"]
    length = 0
    while length < size:
        number = chance.randrange(1_000_000)
        blocks.append(f"N{len(blocks)}G01X{number / 1000:.3f}Y-{number % 997 / 10:.1f}F{number % 31}00")
        length += len(blocks[-1]) + 1
    text = "\n".join([*blocks, "M30"]) + "\n"
    return (f"%\nO0001{text}%" if framed else text).encode()


def as_sent(path: Path, name: str) -> bytes:
    entry = protocol(name)
    job = settings_for(End.HOST, "pty:/tmp/none", name, settings={})
    program = Program.from_file(path, entry.text(job.params))
    try:
        program.rewind()
        return program.read(program.byte_count)
    finally:
        program.close()


def without_figures(reason: str) -> str:
    """Reasons are counted by what they say, not by the figures and names in them."""
    reason = re.sub(r"(socket|rfc2217)://\S+?:\d+|/\S*/\S+", "LINE", reason)
    return re.sub(r"\d[\d,.]*", "N", reason)


class Line:
    """One line and its jobs. Subclasses say what stands at the other end, and how it is disturbed."""

    kind = ""
    stopbits = 1
    parity_errors = True
    disturbed = 0.25
    """Share of the jobs in the middle of which the line goes."""

    def __init__(self, number: int, folder: Path, protocol_name: str, baud: int, tally: Tally) -> None:
        self.number = number
        self.folder = folder / f"line-{number}"
        self.folder.mkdir()
        self.protocol = protocol_name
        self.baud = baud
        self.tally = tally
        self.chance = random.Random(f"soak {number}")
        self.seen = 0

    async def run(self, until: Callable[[], bool]) -> None:
        count = 0
        while not until():
            count += 1
            try:
                await self._job(f"{self.number}-{count}")
            except Exception as error:
                # An hour of the other lines is worth more than this job.
                self.tally.trouble.append(f"line {self.number} ({self.kind}), job {count}: {error!r}")
            await asyncio.sleep(0.3 + self.chance.random())

    async def _job(self, name: str) -> None:
        case = self._case(name)
        saved = self.folder / ("received.nc" if case.punch else "saved.nc")
        for path in (saved, saved.with_name(f"{saved.name}.part")):
            path.unlink(missing_ok=True)
        self.seen = 0
        self.tally.jobs[self.kind] += 1
        where = await self.begin(case, saved)
        disturbing = asyncio.create_task(self._disturb(case))
        result: Result | None = None
        try:
            result = await self._transfer(case, saved, where)
            outcome, reason = result.outcome, result.reason
        except LineError as error:
            outcome, reason = Outcome.FAILED, f"not opened: {error}"
        disturbing.cancel()
        with suppress(asyncio.CancelledError):
            await disturbing
        # A control that has all of the program may still execute its last blocks: RESET now would throw them away.
        control = await self.end(case, FINISH_S if outcome is Outcome.COMPLETE else 0.0)
        await self.restore()
        self._judge(case, saved, result, outcome, reason, control)

    def _case(self, name: str) -> Case:
        chance = self.chance
        seconds = chance.uniform(5, 20)
        punch = self.protocol.startswith("fanuc-b") and chance.random() < 0.25
        path = self.folder / "program.nc"
        size = int(seconds * self.baud / BITS)
        path.write_bytes(program_text(chance, name, size, self.protocol.startswith("fanuc")))
        disturb = chance.uniform(0.1, 0.8) * seconds if chance.random() < self.disturbed else None
        return Case(name=name, program=path, punch=punch, seconds=seconds, disturb_after_s=disturb)

    async def _transfer(self, case: Case, saved: Path, where: str) -> Result:
        # A Bridgeport line stands still for every record's answer; a slow control makes any line slower.
        words: dict[str, Any] = {
            "line": where, "protocol": self.protocol, "baud": self.baud, "stopbits": self.stopbits,
            "timeout_s": 6 * case.seconds + 40, "observer": self._observe,
        }  # fmt: skip
        if case.punch:
            return await receive(saved, **words)
        return await send(case.program, **words)

    def _observe(self, report: Report, now: Nanos) -> None:
        if isinstance(report, Violation) and "parity error" in report.what:
            self.seen += report.count

    async def _disturb(self, case: Case) -> None:
        if case.disturb_after_s is not None:
            await asyncio.sleep(case.disturb_after_s)
            await self.disturb()

    def _judge(
        self, case: Case, saved: Path, result: Result | None, outcome: Outcome, reason: str, control: dict[str, Any]
    ) -> None:
        tally = self.tally
        tally.to_control += control["made"]
        tally.to_control_seen += control["seen"]
        tally.to_host += control["damaged"]
        tally.to_host_seen += self.seen
        tally.other_faults += control.get("other", 0)
        meant = case.program.read_bytes() if case.punch else as_sent(case.program, self.protocol)
        got = saved.read_bytes() if saved.exists() else b""
        tally.bytes += len(got)
        whole = outcome is Outcome.COMPLETE or (not case.punch and control["outcome"] == "complete")
        if whole and got != meant:
            self._wrong(case, f"said to be complete: {reason}", got, meant)
        elif not case.punch and not meant.startswith(got):
            self._wrong(case, f"not a prefix: {reason}", got, meant)
        elif not case.punch and result is not None and len(got) > result.bytes_handed:
            self._wrong(case, f"more than the {result.bytes_handed} told: {reason}", got, meant)
        elif not reason:
            self._wrong(case, "no reason", got, meant)
        if outcome is Outcome.COMPLETE:
            tally.complete[self.kind] += 1
        else:
            tally.reasons[without_figures(reason)] += 1
            disturbed = "left alone" if case.disturb_after_s is None else f"gone after {case.disturb_after_s:.1f} s"
            print(f"line {self.number}, {self.kind}, {self.protocol}, {disturbed}: {reason}", flush=True)

    def _wrong(self, case: Case, what: str, got: bytes, meant: bytes) -> None:
        same = next((at for at, (one, other) in enumerate(zip(got, meant, strict=False)) if one != other), len(got))
        operation = "punch-out" if case.punch else "send"
        self.tally.wrong.append(
            f"line {self.number} ({self.kind}, {self.protocol}), job {case.name}, {operation}, {what};"
            f" {len(got):,} of {len(meant):,} bytes, the first {same:,} alike"
        )

    # What kinds of line do differently.

    async def open(self) -> None:
        """Before the first job."""

    async def close(self) -> None:
        """After the last."""

    async def begin(self, case: Case, saved: Path) -> str:
        """Have the control wait, and say where."""
        raise AssertionError("a kind of line says this")

    async def end(self, case: Case, patience_s: float) -> dict[str, Any]:
        """The control's own account: it has so long to end by itself."""
        raise AssertionError("a kind of line says this")

    async def disturb(self) -> None:
        """Take the line away."""

    async def restore(self) -> None:
        """And give it back."""


class FarLine(Line):
    """Its control is one of the process with all controls."""

    def __init__(self, number: int, folder: Path, protocol_name: str, baud: int, tally: Tally, far: Far) -> None:
        super().__init__(number, folder, protocol_name, baud, tally)
        self.far = far
        self.device = self.folder / "port"

    async def begin(self, case: Case, saved: Path) -> str:
        chance, is_slow = self.chance, self.chance.random() < 0.3
        settings = {"mode": Mode.LINK.value, "program": "77"} if self.protocol == "bridgeport" else {}
        await self.far.ask(
            do="start", job=case.name, path=str(self.device), protocol=self.protocol, baud=self.baud,
            stopbits=self.stopbits, settings=settings, punch=str(case.program) if case.punch else None,
            save=str(saved), seed=chance.randrange(1 << 30), parity_errors=self.parity_errors,
            blocks_per_second=self.baud / BITS / 25 * 0.7 if is_slow else None,
            damage=[chance.randrange(1, 40)] if chance.random() < 0.5 else [],
        )  # fmt: skip
        return self.where

    @property
    def where(self) -> str:
        return str(self.device)

    async def end(self, case: Case, patience_s: float) -> dict[str, Any]:
        return await self.far.ask(do="end", job=case.name, patience_s=patience_s)


class PluggedLine(FarLine):
    """A port of this computer that is pulled out and plugged in again under its stable name."""

    kind = "pseudo terminal"
    marks = False

    async def open(self) -> None:
        self.far.tell(do="cable", path=str(self.device), marks=self.marks)

    async def disturb(self) -> None:
        self.far.tell(do="unplug", path=str(self.device))
        self.tally.unplugs += 1
        await asyncio.sleep(self.chance.uniform(0.5, 3))
        await self.restore()

    async def restore(self) -> None:
        self.far.tell(do="plug", path=str(self.device))

    async def close(self) -> None:
        self.far.tell(do="unplug", path=str(self.device))


class MarkedLine(PluggedLine):
    """The same, with the marks of a driver where a character came damaged."""

    kind = "played serial port"
    marks = True


class ServerLine(FarLine):
    """Raw TCP to a serial server."""

    kind = "ser2net, raw"
    accepter = "tcp"
    scheme = "socket"
    behind = ""

    async def open(self) -> None:
        self.server = SerialServer(self.folder, "server", self.accepter, self.device, self.baud)
        await self.server.start()

    @property
    def where(self) -> str:
        return f"{self.scheme}://localhost:{self.server.port}{self.behind}"

    async def disturb(self) -> None:
        await asyncio.shield(self._restart())

    async def _restart(self) -> None:
        await self.server.kill()
        self.tally.restarts += 1
        await asyncio.sleep(0.5)
        await self.server.start()

    async def close(self) -> None:
        await self.server.kill()


class Rfc2217ServerLine(ServerLine):
    """The same server by RFC 2217, 8N2: a pseudo terminal has no parity to set."""

    kind = "ser2net, RFC 2217"
    accepter = "telnet(rfc2217),tcp"
    scheme = "rfc2217"
    behind = "?signals=ignored"
    stopbits = 2
    parity_errors = False


class CommandLine(Line):
    """`tapewire cnc --faults` as a process of its own, ended by a signal in the middle of some jobs."""

    kind = "tapewire cnc --faults"
    presets: tuple[str, ...] = ("pulled-cable",)
    """What protocol A finds by its checksum; nothing that a protocol cannot see."""
    scheme = "listen"

    async def begin(self, case: Case, saved: Path) -> str:
        words = ["--operation", "punch", "--file", str(case.program)] if case.punch else ["--save", str(saved)]
        self._other = 0
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "tapewire", "cnc", "--line", f"{self.scheme}://127.0.0.1:0",
            "--protocol", self.protocol, "--baud", str(self.baud), "--json", "--faults",
            self.chance.choice(self.presets), *words,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            ready = await asyncio.wait_for(self._event("ready"), ANSWER_LIMIT_S)
            if "line" not in ready:
                raise RuntimeError(f"tapewire cnc: {ready}")
        except BaseException:
            await self._end_after(0.0, self._process.kill)
            await self._process.wait()
            raise
        self._rest = asyncio.create_task(self._event("end"))
        return str(ready["line"]).replace("rfc2217+listen", "rfc2217").replace("listen", "socket")

    async def _event(self, name: str) -> dict[str, Any]:
        assert self._process.stdout is not None
        while line := await self._process.stdout.readline():
            event: dict[str, Any] = json.loads(line)
            self._other += str(event.get("text", "")).startswith("fault made: ")
            if event["event"] == name:
                return event
        return {"outcome": "failed", "reason": "ended by a signal"}

    async def disturb(self) -> None:
        with suppress(ProcessLookupError):
            self._process.kill()
        self.tally.unplugs += 1

    async def end(self, case: Case, patience_s: float) -> dict[str, Any]:
        await self._end_after(max(patience_s, 1.5), lambda: self._process.send_signal(signal.SIGINT))
        await self._end_after(5.0, self._process.kill)
        await self._process.wait()
        rest: dict[str, Any] = await self._rest
        return {**rest, "made": 0, "seen": 0, "damaged": 0, "other": self._other}

    async def _end_after(self, limit_s: float, act: Callable[[], object]) -> None:
        """`act` when the control has not ended by itself by then."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), limit_s)
            return
        with suppress(ProcessLookupError):
            act()


class Rfc2217CommandLine(CommandLine):
    """The same as a serial server with control lines."""

    scheme = "rfc2217+listen"
    presets = ("stuck-cts", "loose-dsr")
