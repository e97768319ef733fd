"""A real host on a real line within this process: what a whole `tapewire send` does, without starting one."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Final

from tapewire.engine import Nanos, Outcome
from tapewire.transfer.api import receive, send
from tapewire.transfer.reports import Observer, Ready, Report, Result
from tests.cli.helpers import DEADLINE_S

QUICK: Final = {
    "fanuc-a": {"P2": "1", "Tp": "3", "Tw": "0"},
    "fanuc-a-expansion": {"P2": "1", "Tp": "3", "Tw": "0"},
    "fanuc-b": {"notice_time": "0.1"},
    "fanuc-b-expansion": {"notice_time": "0.1"},
}
"""Settings with which a host soon knows that it is over."""


class HostJob:
    """One job of a host, begun with this object. `ready` waits until its line is open."""

    def __init__(self, work: Callable[[Observer], Awaitable[Result]]) -> None:
        self._ready = threading.Event()
        self._result: Result | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(work,), daemon=True)
        self._thread.start()

    def _run(self, work: Callable[[Observer], Awaitable[Result]]) -> None:
        async def job() -> Result:
            return await work(self._observe)

        try:
            self._result = asyncio.run(job())
        except BaseException as error:
            self._error = error
            self._ready.set()

    def _observe(self, report: Report, now: Nanos) -> None:
        if isinstance(report, Ready):
            self._ready.set()

    def ready(self) -> HostJob:
        assert self._ready.wait(DEADLINE_S), "the host's line never came to be open"
        if self._error is not None:
            raise self._error
        return self

    def outcome(self) -> Outcome:
        """Once it is over."""
        self._thread.join(DEADLINE_S)
        assert self._result is not None, "the host never came to an end"
        return self._result.outcome


def sending(
    file: Path, line: object, protocol: str, *, baud: int | None = None, settings: Mapping[str, str] | None = None
) -> HostJob:
    words = {**QUICK.get(protocol, {}), **(settings or {})}
    return HostJob(
        lambda observer: send(file, line=str(line), protocol=protocol, baud=baud, settings=words, observer=observer)
    ).ready()


def receiving(file: Path, line: object, protocol: str, *, settings: Mapping[str, str] | None = None) -> HostJob:
    words = {**QUICK.get(protocol, {}), **(settings or {})}
    return HostJob(
        lambda observer: receive(file, line=str(line), protocol=protocol, settings=words, observer=observer)
    ).ready()
