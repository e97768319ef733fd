"""What the soak talks to: the process with the controls, real serial servers, and a port that is played."""

from __future__ import annotations

import asyncio
import errno
import json
import socket
import sys
from pathlib import Path
from typing import Any, Final

from tapewire.line.ports.kernel import Counters, SerialInfo, Settings, TtyKernel

ANSWER_LIMIT_S: Final = 40.0
LISTEN_POLL_S: Final = 0.05
TCP_LISTEN: Final = "0A"


class MarkedPort(TtyKernel):
    """A pseudo terminal that answers like a serial port, and whose other side writes the marks of a driver itself."""

    def __init__(self) -> None:
        self._set: Settings | None = None

    def is_pseudo(self, fd: int) -> bool:
        return False

    def settings(self, fd: int) -> Settings:
        return self._set or super().settings(fd)

    def set(self, fd: int, wanted: Settings) -> None:
        self._set = wanted

    def signals(self, fd: int) -> int:
        return 0x160  # CTS, DSR, CD

    def set_signals(self, fd: int, on: int, off: int) -> None:
        """There is nobody who would see them."""

    def counters(self, fd: int) -> Counters:
        raise OSError(errno.ENOTTY, "not offered")

    def info(self, fd: int) -> SerialInfo:
        raise OSError(errno.ENOTTY, "not offered")

    def transmitter_is_empty(self, fd: int) -> bool:
        raise OSError(errno.ENOTTY, "not offered")

    def wait_for_signals(self, fd: int, bits: int) -> None:
        raise OSError(errno.ENOTTY, "not offered")

    def claim(self, fd: int) -> None:
        """It would outlive this end."""


class Far:
    """The process with the controls."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._waiting: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._reader = asyncio.create_task(self._read())

    @classmethod
    async def start(cls) -> Far:
        return cls(
            await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "benchmarks.soak_far",
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
            )
        )

    async def _read(self) -> None:
        assert self._process.stdout is not None
        while line := await self._process.stdout.readline():
            said = json.loads(line)
            if (waiting := self._waiting.pop(said["job"], None)) is not None:
                waiting.set_result(said)

    def tell(self, **words: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(words).encode() + b"\n")

    async def ask(self, **words: Any) -> dict[str, Any]:
        """Tell, and wait for the next that is said of that job."""
        answer = self._waiting[words["job"]] = asyncio.get_running_loop().create_future()
        self.tell(**words)
        said: dict[str, Any] = await asyncio.wait_for(answer, ANSWER_LIMIT_S)
        if "refused" in said:
            raise RuntimeError(f"the control: {said['refused']}")
        return said

    async def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        await self._process.wait()
        await self._reader


def free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


def is_listening(port: int) -> bool:
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()]
    return any(row[1].endswith(f":{port:04X}") and row[3] == TCP_LISTEN for row in rows if len(row) > 3)


class SerialServer:
    """Debian's ser2net for one device, ended without warning and started again."""

    def __init__(self, folder: Path, name: str, accepter: str, device: Path, baud: int) -> None:
        self.port = free_port()
        self._config = folder / f"{name}.yaml"
        self._config.write_text(
            f"connection: &one\n  accepter: {accepter},localhost,{self.port}\n"
            f"  connector: serialdev,{device},{baud}n82,local\n"
        )
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            "ser2net", "-n", "-d", "-c", str(self._config),
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        for _ in range(int(ANSWER_LIMIT_S / LISTEN_POLL_S)):
            if is_listening(self.port):
                return
            await asyncio.sleep(LISTEN_POLL_S)
        raise RuntimeError(f"ser2net does not listen with {self._config.read_text()}")

    async def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            await self._process.wait()
            self._process = None
