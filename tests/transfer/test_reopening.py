"""A line that goes and comes back: waited for while nothing has begun, and never again after that."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.engine import SECOND, Nanos, Notice, Outcome
from tapewire.errors import LineNotFound
from tapewire.line.captures.records import Side
from tapewire.line.descriptor import LineSettings
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.link import Link
from tapewire.line.open import parse_line
from tapewire.line.pty import PtyLine, create_pty
from tapewire.transfer import reopening
from tapewire.transfer.api import receive
from tapewire.transfer.decoding.entry import Entry
from tapewire.transfer.monitoring import MonitorSettings, monitor
from tapewire.transfer.reopening import STEADY, Losses, WhenLost
from tapewire.transfer.reports import Ready, Report, Result
from tests.line.helpers import ListeningEngine
from tests.transfer.peer import DC2, DC4

TEXT: Final = b"%\nO3563(356)\nM30\n%"
HOW: Final = LineSettings(baud=19200, stopbits=1, window=48)
LIMIT_S: Final = 20.0


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reopening, "REOPEN_PAUSE_S", 0.02)


class Socket:
    """Where an adapter is plugged in, under a name that stays."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.line: PtyLine
        self.engine = ListeningEngine()
        self._driving: asyncio.Task[None]
        self.reports: list[Report] = []

    def plug(self, says: bytes = b"") -> None:
        self.line = create_pty(str(self.path), HOW)
        self.engine = ListeningEngine(script=says)
        self.driver = LineDriver(Link(self.engine, self.line))
        self._driving = asyncio.create_task(self.driver.run(lambda: False))

    async def unplug(self) -> None:
        self._driving.cancel()
        await asyncio.wait([self._driving])
        self.line.close(monotonic())

    def say(self, data: bytes) -> None:
        self.engine.say(data)
        self.driver.wake()

    def observe(self, report: Report, now: Nanos) -> None:
        self.reports.append(report)

    def notices(self) -> list[str]:
        return [report.text for report in self.reports if isinstance(report, Notice)]

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(LIMIT_S):
            while not condition():  # noqa: ASYNC110 - many things are waited for, and not all of them tell
                await asyncio.sleep(0.005)

    async def opened(self, times: int) -> None:
        def is_open() -> bool:
            return sum(isinstance(report, Ready) for report in self.reports) == times and self.line.connected

        await self.until(is_open)

    def receiving(self, file: Path, **how: Any) -> asyncio.Task[Result]:
        words: dict[str, Any] = {"protocol": "fanuc-b", "observer": self.observe, "timeout_s": LIMIT_S, **how}
        return asyncio.create_task(receive(file, line=str(self.path), **words))


@pytest.fixture
def adapter(tmp_path: Path) -> Socket:
    return Socket(tmp_path / "line")


async def test_a_reception_that_has_not_begun_waits_for_its_line(adapter: Socket, tmp_path: Path) -> None:
    adapter.plug()
    work = adapter.receiving(tmp_path / "got.nc", when_lost=WhenLost.WAIT)
    await adapter.opened(1)
    await adapter.unplug()
    await asyncio.sleep(0.1)
    assert not work.done()
    adapter.plug()
    await adapter.opened(2)
    adapter.say(DC2 + TEXT + DC4)
    result = await work
    await adapter.unplug()
    assert result.outcome is Outcome.COMPLETE, result.reason
    assert (tmp_path / "got.nc").read_bytes() == TEXT
    assert any("nothing had begun" in text for text in adapter.notices())


async def test_a_server_that_hangs_up_at_first_is_waited_out_and_told_once(adapter: Socket, tmp_path: Path) -> None:
    """ser2net accepts before it has found its port, and hangs up; raw TCP shows no more than that."""
    connections: list[asyncio.StreamWriter] = []

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connections.append(writer)
        if len(connections) > 4:
            await asyncio.sleep(0.1)
            writer.write(DC2 + TEXT + DC4)
            await reader.read()
        writer.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    line = f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    result = await receive(
        tmp_path / "got.nc", line=line, protocol="fanuc-b", observer=adapter.observe, when_lost=WhenLost.WAIT
    )
    server.close()
    await server.wait_closed()
    assert result.outcome is Outcome.COMPLETE, result.reason
    assert (tmp_path / "got.nc").read_bytes() == TEXT
    assert len(connections) == 5
    assert sum("nothing had begun" in text for text in adapter.notices()) == 1


async def test_one_that_has_begun_ends_with_its_line(adapter: Socket, tmp_path: Path) -> None:
    adapter.plug()
    work = adapter.receiving(tmp_path / "got.nc", when_lost=WhenLost.WAIT)
    await adapter.opened(1)
    adapter.say(DC2)
    await asyncio.sleep(0.2)
    await adapter.unplug()
    result = await asyncio.wait_for(work, LIMIT_S)
    assert result.outcome is Outcome.FAILED
    assert "the line is gone" in result.reason


async def test_without_being_told_nothing_is_waited_for(adapter: Socket, tmp_path: Path) -> None:
    adapter.plug()
    work = adapter.receiving(tmp_path / "got.nc")
    await adapter.opened(1)
    await adapter.unplug()
    assert (await asyncio.wait_for(work, LIMIT_S)).outcome is Outcome.FAILED


async def test_a_line_that_was_never_there_is_an_error_all_the_same(adapter: Socket, tmp_path: Path) -> None:
    with pytest.raises(LineNotFound):
        await adapter.receiving(tmp_path / "got.nc", when_lost=WhenLost.WAIT)


async def test_waiting_ends_with_the_time_and_by_the_person(adapter: Socket, tmp_path: Path) -> None:
    for how in ("stop", "time"):
        adapter.reports.clear()
        adapter.plug()
        stop = asyncio.Event()
        limit_s = 0.5 if how == "time" else LIMIT_S
        work = adapter.receiving(tmp_path / "got.nc", when_lost=WhenLost.WAIT, stop=stop, timeout_s=limit_s)
        await adapter.opened(1)
        await adapter.unplug()
        if how == "stop":
            await asyncio.sleep(0.05)
            stop.set()
        result = await asyncio.wait_for(work, LIMIT_S)
        assert result.outcome is (Outcome.CANCELLED if how == "stop" else Outcome.FAILED)


async def test_a_monitor_that_waits_is_ended_by_the_person_without_a_trace(adapter: Socket) -> None:
    stop = asyncio.Event()
    settings = MonitorSettings(
        lines=(parse_line(str(adapter.path)),), baud=19200, hears=Side.CONTROL, when_lost=WhenLost.WAIT
    ).observed_by(adapter.observe, lambda entry: None, stop)
    strays: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: strays.append(context))
    adapter.plug()
    watching = asyncio.create_task(monitor(settings))
    await adapter.opened(1)
    await adapter.unplug()
    await adapter.until(lambda: any("not yet" in text for text in adapter.notices()))
    stop.set()
    result = await asyncio.wait_for(watching, LIMIT_S)
    gc.collect()
    await asyncio.sleep(0)
    assert result.outcome is Outcome.CANCELLED
    assert not strays


def test_a_loss_is_news_unless_the_line_had_not_really_been_back() -> None:
    losses = Losses()
    assert losses.is_news("unplugged", 0)
    assert not losses.is_news("unplugged", SECOND)
    assert losses.is_news("reset", 2 * SECOND)
    assert losses.is_news("reset", 2 * SECOND + STEADY)


async def test_a_monitor_listens_on_when_the_line_is_back(adapter: Socket) -> None:
    heard: list[Entry] = []
    stop = asyncio.Event()
    settings = MonitorSettings(
        lines=(parse_line(str(adapter.path)),), baud=19200, hears=Side.CONTROL, when_lost=WhenLost.WAIT
    ).observed_by(adapter.observe, heard.append, stop)
    adapter.plug()
    watching = asyncio.create_task(monitor(settings))
    await adapter.opened(1)
    adapter.say(b"\x11")
    await adapter.until(lambda: len(heard) > 0)
    await adapter.unplug()
    adapter.plug()
    await adapter.opened(2)
    before = len(heard)
    adapter.say(b"\x13")
    await adapter.until(lambda: len(heard) > before)
    stop.set()
    result = await asyncio.wait_for(watching, LIMIT_S)
    await adapter.unplug()
    assert result.bytes == 2
    assert any("opened again when it is back" in text for text in adapter.notices())
