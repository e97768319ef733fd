"""The far side of the soak: simulated controls in one process, and cables that can be pulled out of a serial port.

Commands come as JSON, one a line on stdin, answers go to stdout. `python -m benchmarks.soak_far` is started by
`benchmarks/soak.py`, which knows the words.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import sys
import tty
from pathlib import Path
from typing import Any, Final

from tapewire.engine import Alarm, Nanos, Notice, Violation
from tapewire.errors import LineError
from tapewire.line.faults.plan import FaultPlan, FlipBits, PerTransfer, Wire
from tapewire.protocols.settings import End
from tapewire.transfer.control import ControlTask, Operation, run_control
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report, Result
from tapewire.transfer.session import settings_for

PARITY_ERRORS: Final = FaultPlan(
    name="parity-errors",
    why="one bit of a character turned on its way to the control, which parity shows",
    faults=(FlipBits(when=PerTransfer(0.4), wire=Wire.FROM_HOST),),
)

OPEN_POLL_S: Final = 0.02
"""How often a port is looked at that nobody has opened yet."""

GIVE_UP_S: Final = 4.0
"""A control that was told to end is dropped after so long."""


class Cable:
    """A port of the near side as a pseudo terminal at a stable name, joined to a control by TCP.

    With `marks` it says of damaged characters what a driver with PARMRK says: FF 00 and the character; FF is doubled.
    """

    def __init__(self, path: Path, marks: bool) -> None:
        self._path = path
        self._marks = marks
        self._master: int | None = None
        self._control: socket.socket | None = None
        self._waiting: int | None = None
        """Where a control listens that has not been joined yet."""
        self._damage: set[int] = set()
        self._passed = 0
        self._is_open = False
        self.damaged = 0

    def plug(self) -> None:
        if self._master is not None:
            return
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(slave))
        os.close(slave)

    def unplug(self) -> None:
        """The near side sees its port vanish, the control its line end."""
        self.part()
        if self._master is not None:
            self._path.unlink(missing_ok=True)
            if self._is_open:
                asyncio.get_running_loop().remove_reader(self._master)
            os.close(self._master)
            self._master, self._is_open = None, False

    def join(self, port: int, damage: list[int]) -> None:
        """Put a control at the other end; the characters of these numbers come from it damaged.

        It sees somebody only when the port is open: what it said before would be lost.
        """
        self._waiting = port
        self._damage, self._passed, self.damaged = set(damage), 0, 0
        self._meet()

    def _meet(self) -> None:
        if self._waiting is not None and self._is_open:
            self._control = socket.create_connection(("127.0.0.1", self._waiting))
            self._waiting = None
            self._control.setblocking(False)
            asyncio.get_running_loop().add_reader(self._control, self._from_control)

    def part(self) -> None:
        self._waiting = None
        if self._control is not None:
            asyncio.get_running_loop().remove_reader(self._control)
            self._control.close()
            self._control = None

    async def watch(self) -> None:
        """Notice when the near side opens the port: it hangs up all the time until then."""
        while True:
            await asyncio.sleep(OPEN_POLL_S)
            if self._master is not None and not self._is_open and self._from_port():
                self._is_open = True
                asyncio.get_running_loop().add_reader(self._master, self._port_has_something)
                self._meet()

    def _port_has_something(self) -> None:
        if self._master is not None and not self._from_port():
            asyncio.get_running_loop().remove_reader(self._master)
            self._is_open = False
            self.part()

    def _from_port(self) -> bool:
        """False while nobody has the port open."""
        assert self._master is not None
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            return True
        except OSError:
            return False
        with contextlib.suppress(OSError):
            if self._control is not None:
                self._control.sendall(data)
        return True

    def _from_control(self) -> None:
        assert self._control is not None
        try:
            data = self._control.recv(4096)
        except OSError:
            data = b""
        if not data:
            self.part()
        elif self._master is not None and self._is_open:
            with contextlib.suppress(OSError):
                os.write(self._master, self._marked(data) if self._marks else data)

    def _marked(self, data: bytes) -> bytes:
        out = bytearray()
        for byte in data:
            self._passed += 1
            if self._passed in self._damage:
                self.damaged += 1
                out += bytes((0xFF, 0x00, byte ^ 0x04))
            else:
                out += b"\xff\xff" if byte == 0xFF else bytes((byte,))
        return bytes(out)


class FarJob:
    """One operation of one control."""

    def __init__(self, words: dict[str, Any], cable: Cable | None) -> None:
        self.words = words
        self.cable = cable
        self.stop = asyncio.Event()
        self.made = self.seen = 0
        self.result: Result | None = None
        self.trouble = ""

    def observe(self, report: Report, now: Nanos) -> None:
        match report:
            case Ready(line=line):
                if self.cable is not None:
                    self.cable.join(int(line.rpartition(":")[2]), self.words["damage"])
                say(job=self.words["job"], ready=line)
            case Notice(text=text) if text.startswith("fault made: "):
                self.made += 1
            case Violation(what=what, count=count) if "parity error" in what:
                self.seen += count
            case Alarm(text=text) if "parity error" in text:
                self.seen += 1
            case _:
                pass

    async def run(self) -> None:
        """What goes wrong here is the answer to whoever waits for this job."""
        try:
            await self._run()
        except Exception as error:
            self.trouble = f"{error!r}"
            say(job=self.words["job"], refused=self.trouble)

    async def _run(self) -> None:
        words = self.words
        job = settings_for(
            End.CONTROL,
            "listen://127.0.0.1:0" if self.cable is not None else f"pty:{words['path']}",
            words["protocol"],
            baud=words["baud"],
            stopbits=words["stopbits"],
            settings=words["settings"],
        ).observed_by(self.observe, self.stop)
        punch = words["punch"]
        program = Program.from_file(punch, job.protocol.text(job.params)) if punch else None
        task = ControlTask(
            operation=Operation.PUNCH if program is not None else Operation.DNC,
            punch=program,
            save=None if program is not None else Path(words["save"]),
            blocks_per_second=words["blocks_per_second"],
            faults=PARITY_ERRORS if words["parity_errors"] else None,
            fault_seed=words["seed"],
        )
        try:
            self.result = await run_control(task, job)
        except LineError as error:
            self.trouble = str(error)
        finally:
            if program is not None:
                program.close()

    @property
    def answer(self) -> dict[str, Any]:
        result, cable = self.result, self.cable
        return {
            "job": self.words["job"],
            "outcome": result.outcome.value if result is not None else "failed",
            "reason": result.reason if result is not None else self.trouble or "dropped",
            "made": self.made,
            "seen": self.seen,
            "damaged": cable.damaged if cable is not None else 0,
        }


def say(**words: object) -> None:
    print(json.dumps(words), flush=True)


class Far:
    """All controls and cables."""

    def __init__(self) -> None:
        self._cables: dict[str, Cable] = {}
        self._jobs: dict[str, tuple[FarJob, asyncio.Task[None]]] = {}
        self._watches: list[asyncio.Task[None]] = []

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        commands = asyncio.StreamReader()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(commands), sys.stdin)
        while line := await commands.readline():
            await self._do(json.loads(line))
        for task in (*self._watches, *(task for _, task in self._jobs.values())):
            task.cancel()

    async def _do(self, words: dict[str, Any]) -> None:
        match words["do"]:
            case "cable":
                cable = self._cables[words["path"]] = Cable(Path(words["path"]), words["marks"])
                cable.plug()
                self._watches.append(asyncio.create_task(cable.watch()))
            case "plug":
                self._cables[words["path"]].plug()
            case "unplug":
                self._cables[words["path"]].unplug()
            case "start":
                job = FarJob(words, self._cables.get(words["path"]))
                self._jobs[words["job"]] = job, asyncio.create_task(job.run())
            case "end":
                self._watches = [task for task in self._watches if not task.done()]
                self._watches.append(asyncio.create_task(self._end(words["job"], words["patience_s"])))
            case "size":
                say(job="size", memory=memory_bytes(), descriptors=descriptors())

    async def _end(self, name: str, patience_s: float) -> None:
        job, task = self._jobs[name]
        if patience_s:
            await asyncio.wait([task], timeout=patience_s)
        job.stop.set()
        await asyncio.wait([task], timeout=GIVE_UP_S)
        task.cancel()
        await asyncio.wait([task])
        if job.cable is not None:
            job.cable.part()
        if not task.cancelled():
            task.result()
        del self._jobs[name]
        say(**job.answer)


def memory_bytes() -> int:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def descriptors() -> int:
    """Open descriptors of this process, without the one that looks."""
    return len(os.listdir("/proc/self/fd")) - 1


if __name__ == "__main__":
    asyncio.run(Far().run())
