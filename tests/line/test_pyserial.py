"""RFC 2217 against the one other client that everybody has, pyserial's, and against the server it is made of.

Both are somebody else's reading of the same text: as a client on our server, as a server behind our client.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
import serial
import serial.rfc2217

from tapewire.engine import LineFault, SignalsIn, SignalsOut
from tapewire.errors import LineError
from tapewire.line.descriptor import DescriptorLine
from tapewire.line.driver import LineDriver, monotonic
from tapewire.line.link import Link
from tapewire.line.open import open_line, parse_line
from tapewire.line.rfc2217.lines import ClientLine
from tapewire.line.transport import send_break
from tests.line.helpers import ListeningEngine

# It starts its threads the way of Python 2, and leaves its sockets to the garbage collector.
pytestmark = [
    pytest.mark.filterwarnings("ignore:set(Daemon|Name)..:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

ALL_BYTES = bytes(range(256))
LIMIT_S = 20.0


class Port:
    """Our server, as `tapewire cnc --line rfc2217+listen://` has it; its engine says back all that it hears."""

    def __init__(self) -> None:
        self.engine = ListeningEngine(answer=bytes)
        self.line: DescriptorLine
        self.driver: LineDriver
        self.refusal = ""
        """Why no line came of it."""

    async def serve(self, ready: Callable[[str], None]) -> None:
        here = parse_line("rfc2217+listen://127.0.0.1:0")
        try:
            self.line = await open_line(here, baud=19200, stopbits=2, window=48, on_ready=ready)
        except LineError as error:
            self.refusal = str(error)
            return
        try:
            self.driver = LineDriver(Link(self.engine, self.line))
            await self.driver.run(lambda: self.engine.closed is not None)
        finally:
            self.line.close(monotonic())


@pytest.fixture
async def port() -> AsyncIterator[tuple[Port, str]]:
    made, ready = Port(), asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(made.serve(ready.set_result))
    yield made, (await ready).replace("+listen", "")
    serving.cancel()
    with suppress(asyncio.CancelledError):
        await serving


@contextmanager
def client(url: str, **how: Any) -> Iterator[Any]:
    """pyserial's, set up as our server is unless told otherwise. Its calls block: they belong into a thread."""
    told = {"baudrate": 19200, "bytesize": 8, "parity": "N", "stopbits": 2, "timeout": LIMIT_S, **how}
    made = serial.serial_for_url(url, **told)
    try:
        yield made
    finally:
        made.close()


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while not condition():  # noqa: ASYNC110 - what a thread of pyserial does tells nobody
            await asyncio.sleep(0.005)


async def test_every_byte_there_and_back(port: tuple[Port, str]) -> None:
    made, url = port

    def talk() -> bytes:
        with client(url) as far:
            far.write(ALL_BYTES * 2)
            return bytes(far.read(512))

    assert await asyncio.to_thread(talk) == ALL_BYTES * 2
    assert bytes(made.engine.received) == ALL_BYTES * 2


async def test_control_lines_both_ways(port: tuple[Port, str]) -> None:
    made, url = port
    asked = threading.Event()
    seen: list[tuple[bool, bool, bool]] = []

    def talk() -> None:
        with client(url) as far:
            far.rts, far.dtr = False, True
            assert asked.wait(LIMIT_S)
            seen.append((far.cts, far.dsr, far.cd))

    talking = asyncio.create_task(asyncio.to_thread(talk))
    await until(lambda: SignalsIn(cts=False) in made.engine.control_lines)
    made.engine.signals = SignalsOut(rts=False, dtr=True)
    made.driver.wake()
    await asyncio.sleep(0.2)
    asked.set()
    await talking
    assert seen == [(False, True, True)]


async def test_a_break_of_its_client_is_heard(port: tuple[Port, str]) -> None:
    made, url = port

    def talk() -> None:
        with client(url) as far:
            far.send_break(0.05)
            far.write(b"N1")
            assert far.read(2) == b"N1"

    await asyncio.to_thread(talk)
    assert made.engine.faults == [(LineFault.BREAK, None)]


@pytest.mark.parametrize("wrong", [{"baudrate": 9600}, {"parity": "E"}, {"stopbits": 1}])
async def test_what_the_port_does_not_have_its_client_is_refused(port: tuple[Port, str], wrong: dict[str, Any]) -> None:
    _, url = port

    def talk() -> None:
        with pytest.raises((ValueError, serial.SerialException)), client(url, **wrong):
            pass

    await asyncio.to_thread(talk)


class PortManagerServer:
    """The server that pyserial's own parts make: a `loop://` port, which gives back what it is sent."""

    def __init__(self) -> None:
        self.port = serial.serial_for_url("loop://", baudrate=19200, stopbits=2, timeout=0.01)
        self.breaks: list[bool] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.line = f"rfc2217://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self._listener.accept()
        connection.settimeout(0.01)
        writing = threading.Lock()

        class Writer:
            def write(self, data: bytes) -> None:
                with writing:
                    connection.sendall(data)

        manager = serial.rfc2217.PortManager(self.port, Writer())
        with connection, suppress(OSError):
            while True:
                self._note_break()
                manager.check_modem_lines()
                with suppress(TimeoutError):
                    if not (data := connection.recv(1024)):
                        return
                    self.port.write(b"".join(manager.filter(data)))
                if back := self.port.read(self.port.in_waiting):
                    Writer().write(b"".join(manager.escape(back)))

    def _note_break(self) -> None:
        held = bool(self.port.break_condition)
        if held is not (self.breaks[-1] if self.breaks else False):
            self.breaks.append(held)

    def close(self) -> None:
        self._thread.join(LIMIT_S)
        self._listener.close()
        self.port.close()


@pytest.fixture
def server() -> Iterator[PortManagerServer]:
    made = PortManagerServer()
    yield made
    made.close()


async def test_our_client_on_its_server(server: PortManagerServer) -> None:
    line = await open_line(parse_line(f"{server.line}?signals=ignored"), baud=19200, stopbits=2, window=48)
    try:
        assert isinstance(line, ClientLine)
        engine = ListeningEngine(script=ALL_BYTES * 2)
        async with asyncio.timeout(LIMIT_S):
            await LineDriver(Link(engine, line)).run(lambda: len(engine.received) == 512)
        assert bytes(engine.received) == ALL_BYTES * 2
        assert (server.port.baudrate, server.port.stopbits) == (19200, 2)
        send_break(line, monotonic())
        driver = LineDriver(Link(ListeningEngine(), line))
        driving = asyncio.create_task(driver.run(lambda: False))
        await until(lambda: server.breaks == [True, False])
        driving.cancel()
    finally:
        line.close(monotonic())
