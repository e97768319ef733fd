"""RFC 2217 on a real connection: signals, breaks, a purge, a server that is silent, and one that will not."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable

import pytest

from tapewire.engine import MILLISECOND, SECOND, Closure, LineFault, SignalsIn, SignalsOut
from tapewire.errors import LineError
from tapewire.line import open as opening
from tapewire.line.descriptor import DescriptorLine
from tapewire.line.driver import monotonic
from tapewire.line.open import open_line, parse_line
from tapewire.line.rfc2217.lines import ClientLine, ServerLine
from tapewire.line.rfc2217.telnet import sub
from tapewire.line.transport import Fault, LineItem
from tests.line.helpers import Clock, Seen, hand_over, settings, tcp_pair

HOW = settings(baud=9600, window=48, stopbits=2)


@pytest.fixture
async def ends() -> AsyncIterator[tuple[ClientLine, ServerLine]]:
    client, server = await tcp_pair(HOW, HOW, "rfc2217+listen")
    assert isinstance(client, ClientLine)
    assert isinstance(server, ServerLine)
    yield client, server
    client.close(0)
    server.close(0)


def heard(line: DescriptorLine, other: DescriptorLine, clock: Clock, wanted: LineItem) -> list[LineItem]:
    """What `line` reads until `wanted` has come."""
    seen = Seen()
    for now in clock.looks():
        other.read(now)
        seen.read(line, now)
        if wanted in seen.items:
            break
    return seen.items


async def test_control_lines_of_both_ends_cross(ends: tuple[ClientLine, ServerLine]) -> None:
    client, server = ends
    clock = Clock()
    server.set_signals(SignalsOut(rts=False, dtr=True), clock.now)
    assert client.room(clock.now) == 48
    heard(client, server, clock, SignalsIn(cts=False))
    assert client.room(clock.now) == 0
    server.set_signals(SignalsOut(rts=True, dtr=True), clock.now)
    heard(client, server, clock, SignalsIn())
    assert client.room(clock.now) == 48
    client.set_signals(SignalsOut(rts=True, dtr=False), clock.now)
    heard(server, client, clock, SignalsIn(dsr=False, cd=False))


async def test_control_lines_may_be_ignored() -> None:
    how = settings(baud=9600, window=48)
    server_waits = asyncio.get_running_loop().create_future()
    opened = asyncio.create_task(opened_server(server_waits.set_result))
    line = (await server_waits).replace("+listen", "") + "?signals=ignored"
    client = await open_line(parse_line(line), baud=how.baud, stopbits=1, window=48)
    server, clock = await opened, Clock()
    server.set_signals(SignalsOut(rts=False, dtr=False), clock.now)
    hand_over(server, b"N1", clock.now)
    assert heard(client, server, clock, b"N1") == [b"N1"]
    assert client.room(clock.now) == 48
    client.close(0)
    server.close(0)


async def opened_server(ready: Callable[[str], None]) -> DescriptorLine:
    return await open_line(parse_line("rfc2217+listen://127.0.0.1:0"), baud=9600, stopbits=1, window=48, on_ready=ready)


async def test_a_client_that_gives_up_purges_what_has_not_come_yet() -> None:
    slow = settings(baud=300, window=48, paced_reception=True)
    client, server = await tcp_pair(settings(baud=300, window=48), slow, "rfc2217+listen")
    clock, seen = Clock(), Seen()
    hand_over(client, bytes(range(40)), clock.now)
    while not server._arrivals._characters:
        seen.read(server, clock.now)
        await asyncio.sleep(0)
    assert client.discard(clock.now) == 0
    for _ in range(200):
        seen.read(server, clock.advance(10 * MILLISECOND))
        client.read(clock.now)
        await asyncio.sleep(0.0005)
    assert len(seen.data) < 40
    hand_over(client, b"\x13", clock.now)
    assert heard(server, client, clock, b"\x13")[-1] == b"\x13"
    client.close(0)
    server.close(0)


async def test_a_break_comes_as_a_fault(ends: tuple[ClientLine, ServerLine]) -> None:
    client, server = ends
    client._unsent += sub(44, b"\x05\x05")
    heard(server, client, Clock(), Fault(fault=LineFault.BREAK))


async def test_a_server_that_is_silent_is_asked_and_answers(ends: tuple[ClientLine, ServerLine]) -> None:
    client, server = ends
    clock = Clock(monotonic())
    for _ in range(60):
        await asyncio.sleep(0.001)
        server.read(clock.now)
        await asyncio.sleep(0.001)
        assert client.read(clock.advance(SECOND)) == []
    assert not client._ended


async def test_a_server_that_does_not_answer_is_gone_within_sixteen_seconds(
    ends: tuple[ClientLine, ServerLine],
) -> None:
    client, _ = ends
    clock = Clock(monotonic())
    began, seen = clock.now, Seen()
    while not seen.ends:
        seen.read(client, clock.now)
        deadline = client.next_deadline()
        if deadline is None:
            break
        assert deadline <= clock.now + SECOND
        clock.now = deadline
    (end,) = seen.ends
    assert end.closure is Closure.LOST
    assert "not answered for" in end.reason
    assert clock.now - began <= 16 * SECOND


async def refused_by(says: bytes | None, monkeypatch: pytest.MonkeyPatch) -> str:
    """What opening says of a server that says so much and no more; None hangs up."""
    monkeypatch.setattr(opening, "AGREE_LIMIT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        line = parse_line(f"rfc2217://127.0.0.1:{listener.getsockname()[1]}")
        trying = asyncio.create_task(open_line(line, baud=86400, stopbits=1, window=48))
        connection, _ = await asyncio.get_running_loop().sock_accept(listener)
        with connection:
            if says is None:
                connection.shutdown(socket.SHUT_RDWR)
            else:
                connection.sendall(says)
            with pytest.raises(LineError) as refusal:
                await trying
    return str(refusal.value)


ROUNDS = b"\xff\xfd\x2c" + sub(44, b"\x65" + (115200).to_bytes(4, "big"))


@pytest.mark.parametrize(
    ("server", "said"),
    [
        (b"N1 G00 X0\r\n", "does not speak RFC 2217"),
        (None, "closed the connection"),
        (ROUNDS, "asked for 86400 baud it says 115200"),
    ],
)
async def test_who_will_not(server: bytes | None, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert said in await refused_by(server, monkeypatch)


async def test_a_raw_client_is_told_to_the_one_who_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "AGREE_LIMIT_S", 0.3)
    ready = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(opened_server(ready.set_result))
    port = int((await ready).rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(b"\x11")
        with pytest.raises(LineError, match="is it a raw client"):
            await waiting
