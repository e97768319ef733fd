"""The asyncio driver: what wakes it, what ends it, and that it never spins."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator

import pytest

from tapewire.engine import MILLISECOND, Closure, Nanos
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.link import Link
from tapewire.line.ports.serial_port import open_tty
from tapewire.line.pty import create_pty
from tests.line.helpers import ListeningEngine, open_pair, settings, tcp_pair

PROGRAM = b"".join(b"N%d G01 X%d.\n" % (number, number) for number in range(300))


@pytest.fixture(params=["pty", "tcp"])
async def links(request: pytest.FixtureRequest, tmp_path: object) -> AsyncIterator[tuple[Link, Link]]:
    """Two links on one line; the second echoes."""
    how = settings(baud=921600, window=2000)
    if request.param == "tcp":
        near, far = await tcp_pair(how, how)
    else:
        near, far = create_pty(f"{tmp_path}/line", how), open_tty(f"{tmp_path}/line", how)
    yield Link(ListeningEngine(PROGRAM), near), Link(ListeningEngine(answer=bytes), far)
    near.close(monotonic())
    far.close(monotonic())


async def test_two_ends_talk(links: tuple[Link, Link]) -> None:
    near, far = links
    first, second = near.engine, far.engine
    assert isinstance(first, ListeningEngine)
    assert isinstance(second, ListeningEngine)
    await asyncio.gather(
        LineDriver(near).run(lambda: len(first.received) == len(PROGRAM) == first.left),
        LineDriver(far).run(lambda: second.left == len(PROGRAM)),
    )
    assert first.received == second.received == PROGRAM


async def test_the_other_side_closing_is_told_and_watched_no_more(links: tuple[Link, Link]) -> None:
    near, far = links
    first, second = near.engine, far.engine
    assert isinstance(first, ListeningEngine)
    assert isinstance(second, ListeningEngine)
    driver = LineDriver(far)
    talking = asyncio.create_task(driver.run(lambda: second.closed is not None))
    await LineDriver(near).run(lambda: len(first.received) == len(PROGRAM))
    near.transport.close(monotonic())
    await talking
    assert second.closed is not None
    assert second.closed[0] is Closure.ORDERLY
    steps = CountedSteps(far)
    idle = asyncio.create_task(driver.run(lambda: False))
    await asyncio.sleep(0.05)
    assert steps.count < 50
    idle.cancel()
    with pytest.raises(asyncio.CancelledError):
        await idle


class CountedSteps:
    """Counts how often a link is stepped."""

    def __init__(self, link: Link) -> None:
        self.count = 0
        self._step = link.step
        link.step = self._counted  # type: ignore[method-assign]

    def _counted(self, now: Nanos) -> None:
        self.count += 1
        self._step(now)


@pytest.fixture
def quiet() -> Iterator[Link]:
    with open_pair("simulated") as (near, _):
        near.read(0)
        yield Link(ListeningEngine(), near)


async def test_a_deadline_wakes_it(quiet: Link) -> None:
    engine = quiet.engine
    assert isinstance(engine, ListeningEngine)
    due = monotonic() + 20 * MILLISECOND
    engine.deadline = due
    await LineDriver(quiet).run(lambda: engine.fired == 1)
    assert monotonic() >= due


async def test_it_sleeps_until_it_is_woken(quiet: Link) -> None:
    engine = quiet.engine
    assert isinstance(engine, ListeningEngine)
    driver, steps = LineDriver(quiet), CountedSteps(quiet)
    running = asyncio.create_task(driver.run(lambda: engine.left == 4))
    await asyncio.sleep(0.05)
    assert steps.count == 1
    engine.say(b"more")
    driver.wake()
    await running


async def test_what_is_due_at_once_does_not_shut_the_loop_out(quiet: Link) -> None:
    engine = quiet.engine
    assert isinstance(engine, ListeningEngine)
    others = 0

    def renew(now: Nanos) -> None:
        engine.fired += 1
        engine.deadline = now if engine.fired < 100 else None

    engine.handle_timer = renew  # type: ignore[method-assign]
    engine.deadline = 0

    async def other() -> None:
        nonlocal others
        while engine.fired < 100:
            others += 1
            await asyncio.sleep(0)

    await asyncio.gather(LineDriver(quiet).run(lambda: engine.fired == 100), other())
    assert others >= 50


async def test_a_deadline_that_never_moves_is_our_own_mistake(quiet: Link) -> None:
    quiet.engine.handle_timer = lambda now: None  # type: ignore[method-assign]
    assert isinstance(quiet.engine, ListeningEngine)
    quiet.engine.deadline = 1
    with pytest.raises(AssertionError, match="does not move"):
        await LineDriver(quiet).run(lambda: False)


async def test_what_a_step_raises_comes_out(quiet: Link) -> None:
    def fail(now: Nanos) -> None:
        raise AssertionError("an engine is wrong")

    quiet.engine.handle_timer = fail  # type: ignore[method-assign]
    assert isinstance(quiet.engine, ListeningEngine)
    quiet.engine.deadline = 1
    with pytest.raises(AssertionError, match="an engine is wrong"):
        await LineDriver(quiet).run(lambda: False)


async def test_a_line_whose_other_side_is_not_there_is_looked_at_now_and_then(tmp_path: object) -> None:
    line = create_pty(f"{tmp_path}/line", settings())
    link = Link(ListeningEngine(b"\x11"), line)
    driver, steps = LineDriver(link), CountedSteps(link)
    running = asyncio.create_task(driver.run(lambda: not line.in_flight(monotonic()) and line.connected))
    await asyncio.sleep(0.1)
    assert 1 < steps.count < 20
    assert link.characters_sent == 0
    other = open_tty(f"{tmp_path}/line", settings())
    engine = ListeningEngine()
    await LineDriver(Link(engine, other)).run(lambda: engine.received == b"\x11")
    await running
    other.close(monotonic())
    line.close(monotonic())
