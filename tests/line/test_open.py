"""LINE strings, and opening TCP lines: who waits, who is refused, and what is left open after a cancel."""

from __future__ import annotations

import asyncio
import os
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import LineBusy, LineNotFound, UsageError
from tapewire.line import open as opening
from tapewire.line.descriptor import DescriptorLine, Parity, Signals
from tapewire.line.open import (
    ConnectAddress,
    LineAddress,
    LineOptions,
    ListenAddress,
    PtyAddress,
    TtyAddress,
    open_line,
    parse_line,
)
from tapewire.line.ports.serial_port import TtyLine

THREE_WIRES = LineOptions(signals=Signals.IGNORED, parity=Parity.ODD)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("/dev/ttyUSB0", TtyAddress(path="/dev/ttyUSB0")),
        ("./port", TtyAddress(path="./port")),
        ("pty:/tmp/line", PtyAddress(path="/tmp/line")),
        ("pty:line", PtyAddress(path="line")),
        ("socket://moxa.shop.local:4001", ConnectAddress(host="moxa.shop.local", port=4001)),
        ("socket://[fe80::1%eth0]:4001", ConnectAddress(host="fe80::1%eth0", port=4001)),
        ("listen://127.0.0.1:0", ListenAddress(host="127.0.0.1", port=0)),
        ("listen://[::1]:65535", ListenAddress(host="::1", port=65535)),
        ("rfc2217://moxa:950", ConnectAddress(host="moxa", port=950, is_rfc2217=True)),
        ("rfc2217+listen://127.0.0.1:0", ListenAddress(host="127.0.0.1", port=0, is_rfc2217=True)),
        (
            "rfc2217://moxa:950?signals=ignored&parity=odd",
            ConnectAddress(host="moxa", port=950, is_rfc2217=True, options=THREE_WIRES),
        ),
        ("/dev/ttyUSB0?signals=ignored&parity=odd", TtyAddress(path="/dev/ttyUSB0", options=THREE_WIRES)),
    ],
)
def test_lines_there_are(text: str, address: LineAddress) -> None:
    assert parse_line(text) == address
    assert str(address) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "ttyUSB0",
        "COM3",
        "pty:",
        "rfc2217://server",
        "rfc2217://server:0",
        "rfc2217://server:1?signals",
        "rfc2217://server:1?signals=off",
        "rfc2217://server:1?signals=used&signals=ignored",
        "rfc2217://server:1?",
        "/dev/ttyUSB0?parity=mark",
        "socket://server:1?signals=ignored",
        "pty:/tmp/line?signals=ignored",
        "http://server:80",
        "socket://server",
        "socket://server:",
        "socket://:4001",
        "socket://server:0",
        "socket://server:65536",
        "socket://server:+80",
        "socket://server:٣",
        "socket://a b:80",
        "socket://a..b:80",
        "socket://::1:80",
        "socket://[::1:80",
        "socket://[server]:80",
        "socket://server:80/",
        "listen://:4001",
        "listen://user@server:1",
        "/dev/tty\0S0",
        "/dev/\ud800",
    ],
)
def test_lines_there_are_not(text: str) -> None:
    with pytest.raises(UsageError) as refusal:
        parse_line(text)
    forms = ("/dev/ttyUSB0", "socket://HOST:PORT", "listen://HOST:PORT", "rfc2217://HOST:PORT", "pty:PATH")
    said = str(refusal.value)
    assert "brackets" in said or "?signals=used|ignored" in said or all(form in said for form in forms)


Texts = st.text(st.characters(), max_size=30)


@given(scheme=st.sampled_from(["", "socket://", "listen://", "pty:", "socket://[", "/"]), rest=Texts)
def test_any_text_is_a_line_or_refused(scheme: str, rest: str) -> None:
    try:
        address = parse_line(scheme + rest)
    except UsageError:
        return
    assert parse_line(str(address)) == address
    if isinstance(address, ConnectAddress | ListenAddress):
        address.host.encode("idna")
    else:
        assert b"\0" not in os.fsencode(address.path)


async def _open(text: str, **more: object) -> DescriptorLine:
    return await open_line(parse_line(text), baud=86400, stopbits=1, window=216, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "localhost"])
async def test_the_chosen_port_is_told_before_anybody_connects(host: str) -> None:
    told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(_open(f"listen://{host}:0", on_ready=told.set_result))
    line = await told
    assert not waiting.done()
    assert parse_line(line) == ListenAddress(host=host.strip("[]"), port=int(line.rpartition(":")[2]))
    near = await _open(line.replace("listen", "socket"))
    far = await waiting
    near.close(0)
    far.close(0)


async def test_a_second_connection_is_refused() -> None:
    told: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(_open("listen://127.0.0.1:0", on_ready=told.set_result))
    port = int((await told).rpartition(":")[2])
    first = await _open(f"socket://127.0.0.1:{port}")
    far = await waiting
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection("127.0.0.1", port)
    first.close(0)
    far.close(0)


async def test_a_port_in_use_says_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(LineBusy, match="give another port"):
            await _open(f"listen://127.0.0.1:{port}")


async def test_an_address_of_another_computer_cannot_be_listened_on() -> None:
    with pytest.raises(LineNotFound, match="no address"):
        await _open("listen://192.0.2.1:0")


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


async def test_a_refused_connection_is_tried_until_somebody_listens() -> None:
    port = _free_port()
    trying = asyncio.create_task(_open(f"socket://127.0.0.1:{port}"))
    await asyncio.sleep(3 * opening.REFUSED_PAUSE_S)
    assert not trying.done()
    far = await asyncio.gather(_open(f"listen://127.0.0.1:{port}"), trying)
    for line in far:
        line.close(0)


async def test_a_refused_connection_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "REFUSED_RETRY_S", 0.2)
    with pytest.raises(LineNotFound, match="start the other side"):
        await _open(f"socket://127.0.0.1:{_free_port()}")


async def test_a_connection_to_itself_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel allows it when the port it picks for the client is the one the client asks for."""
    monkeypatch.setattr(opening, "REFUSED_RETRY_S", 0.0)
    port = _free_port()
    monkeypatch.setattr(socket, "socket", _bound_to(port, socket.socket))
    with pytest.raises(LineNotFound):
        await _open(f"socket://127.0.0.1:{port}")


def _bound_to(port: int, kind: type[socket.socket]) -> type[socket.socket]:
    class Bound(kind):  # type: ignore[valid-type, misc]
        def __init__(self, *arguments: int) -> None:
            super().__init__(*arguments)
            self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.bind(("127.0.0.1", port))

    return Bound


@pytest.mark.parametrize("text", ["socket://no-such-host:4001", "listen://no-such-host:4001"])
async def test_an_unknown_host_is_not_found(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    def unknown(*_: object, **__: object) -> object:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(LineNotFound, match="not known; check"):
        await _open(text)


async def test_a_host_that_answers_nothing_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    async def silence(*_: object) -> None:
        await asyncio.get_running_loop().create_future()

    monkeypatch.setattr(opening, "CONNECT_LIMIT_S", 0.05)
    monkeypatch.setattr(asyncio.get_running_loop(), "sock_connect", silence)
    with pytest.raises(LineNotFound, match="no answer"):
        await _open("socket://127.0.0.1:4001")


@pytest.mark.parametrize("text", ["listen://127.0.0.1:0", "socket://127.0.0.1:{port}"])
async def test_a_cancel_leaves_nothing_open(text: str) -> None:
    line = text.format(port=_free_port())
    before = set(os.listdir("/proc/self/fd"))
    waiting = asyncio.create_task(_open(line))
    await asyncio.sleep(0.15)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert set(os.listdir("/proc/self/fd")) == before


async def test_paths_are_told_when_they_are_open(tmp_path: Path) -> None:
    told: list[str] = []
    master = await _open(f"pty:{tmp_path}/line", on_ready=told.append)
    slave = await _open(f"{tmp_path}/line", on_ready=told.append)
    assert told == [f"pty:{tmp_path}/line", f"{tmp_path}/line"]
    assert isinstance(slave, TtyLine)
    slave.close(0)
    master.close(0)


async def test_whoever_is_told_may_fail_without_leaving_the_line_open(tmp_path: Path) -> None:
    def fail(text: str) -> None:
        raise BrokenPipeError(text)

    with pytest.raises(BrokenPipeError):
        await _open(f"pty:{tmp_path}/line", on_ready=fail)
    assert os.listdir(tmp_path) == []


async def test_impossible_settings_open_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="stop bits"):
        await open_line(PtyAddress(path=f"{tmp_path}/line"), baud=9600, stopbits=3, window=10)
    assert os.listdir(tmp_path) == []
