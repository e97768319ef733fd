"""LINE as users write it, and opening what it names.

Reading the text and opening are two steps, so that a wrong LINE is refused before anything is touched.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, assert_never

from tapewire.errors import LineBusy, LineError, LineNotFound, UsageError
from tapewire.line.descriptor import DescriptorLine, LineSettings, Parity
from tapewire.line.pty import create_pty
from tapewire.line.serial_port import open_tty
from tapewire.line.tcp import TcpLine, is_connected_to_itself

__all__ = [
    "ConnectAddress",
    "LineAddress",
    "ListenAddress",
    "PtyAddress",
    "TtyAddress",
    "open_line",
    "parse_line",
]

FORMS: Final = "a LINE is the path of a port (/dev/ttyUSB0), socket://HOST:PORT, listen://HOST:PORT or pty:PATH"

REFUSED_RETRY_S: Final = 5.0
"""How long a refused connection is tried again: two ends started by one script need no order."""
REFUSED_PAUSE_S: Final = 0.1
CONNECT_LIMIT_S: Final = 10.0
"""A host that answers nothing, not even a refusal, within this time is not there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TtyAddress:
    """A serial port of this computer."""

    path: str

    def __str__(self) -> str:
        return self.path


@dataclass(frozen=True, slots=True, kw_only=True)
class PtyAddress:
    """A pseudo terminal to be made, its other side linked at `path`."""

    path: str

    def __str__(self) -> str:
        return f"pty:{self.path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConnectAddress:
    """A TCP port that somebody listens on."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"socket://{_bracketed(self.host)}:{self.port}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ListenAddress:
    """A TCP port of this computer on which one connection is awaited; port 0 lets the system choose."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"listen://{_bracketed(self.host)}:{self.port}"


LineAddress: TypeAlias = TtyAddress | PtyAddress | ConnectAddress | ListenAddress

_SocketAddress: TypeAlias = tuple[Any, ...]
"""What `getaddrinfo` gives and `bind` takes; its shape depends on the family."""


def parse_line(text: str) -> LineAddress:
    """Read a LINE. Opens nothing. Raises UsageError with the forms there are."""
    if text.startswith("socket://"):
        host, port = _host_and_port(text, "socket://")
        if port == 0:
            raise UsageError(f"{text!r}: port 0 is only for listen://; {FORMS}")
        return ConnectAddress(host=host, port=port)
    if text.startswith("listen://"):
        host, port = _host_and_port(text, "listen://")
        return ListenAddress(host=host, port=port)
    if text.startswith("pty:"):
        return PtyAddress(path=_path(text, text.removeprefix("pty:")))
    if "://" in text or "/" not in text:
        raise UsageError(f"{text!r} is no line: {FORMS}")
    return TtyAddress(path=_path(text, text))


async def open_line(
    address: LineAddress,
    *,
    baud: int,
    stopbits: int,
    data_bits: int = 8,
    window: int,
    parity: Parity | None = None,
    paced_reception: bool = False,
    on_ready: Callable[[str], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> DescriptorLine:
    """Open `address`; returns when the line is there, for `listen://` when somebody has connected.

    `on_ready` is told once, as a LINE, what the other side can now reach: for `listen://` the port as soon as it
    listens, for the others when they are open. `on_note` is told what a person at this line should know.
    Raises UsageError for settings no line can have, and LineError. Cancelling leaves nothing open.
    """
    settings = LineSettings(
        baud=baud,
        stopbits=stopbits,
        data_bits=data_bits,
        parity=parity,
        window=window,
        paced_reception=paced_reception,
    )
    ready = on_ready or _nobody
    match address:
        case TtyAddress(path=path):
            line: DescriptorLine = open_tty(path, settings, on_note=on_note)
        case PtyAddress(path=path):
            line = create_pty(path, settings)
        case ConnectAddress():
            line = TcpLine(await _connect(address), settings)
        case ListenAddress():
            return TcpLine(await _accept(address, ready), settings)
        case _:
            assert_never(address)
    try:
        ready(str(address))
    except BaseException:
        line.close(0)
        raise
    return line


def _nobody(text: str) -> None:
    del text


def _host_and_port(text: str, scheme: str) -> tuple[str, int]:
    host, colon, port = text.removeprefix(scheme).rpartition(":")
    if not colon or not (port.isascii() and port.isdigit() and len(port) <= 5 and int(port) <= 65535):
        raise UsageError(f"{text!r} has no port from 0 to 65535; {FORMS}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
        known = _is_ipv6(host)
    elif ":" in host:
        raise UsageError(f"{text!r}: an IPv6 address goes in brackets, {scheme}[::1]:{port}")
    else:
        known = _is_name(host)
    if not known:
        raise UsageError(f"{text!r} has no valid host; {FORMS}")
    return host, int(port)


def _is_ipv6(host: str) -> bool:
    try:
        socket.inet_pton(socket.AF_INET6, host.partition("%")[0])
    except (OSError, ValueError):
        return False
    return host.isprintable() and host.isascii()


def _is_name(host: str) -> bool:
    try:
        host.encode("idna")
    except UnicodeError:
        return False
    return bool(host) and host.isprintable() and not set(host) & set(" /@[]?#")


def _path(text: str, path: str) -> str:
    try:
        encoded = os.fsencode(path)
    except UnicodeError:
        encoded = b""
    if not encoded or 0 in encoded:
        raise UsageError(f"{text!r} has no valid path; {FORMS}")
    return path


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


async def _connect(address: ConnectAddress) -> socket.socket:
    loop = asyncio.get_running_loop()
    give_up = loop.time() + REFUSED_RETRY_S
    while True:
        try:
            async with asyncio.timeout(CONNECT_LIMIT_S):
                return await _connect_once(address)
        except ConnectionRefusedError as error:
            if loop.time() >= give_up:
                raise LineNotFound(
                    f"{address}: nobody listens there, tried for {REFUSED_RETRY_S:g} s;"
                    " start the other side, or check the port"
                ) from error
        except TimeoutError as error:
            raise LineNotFound(f"{address}: no answer within {CONNECT_LIMIT_S:g} s; check the host") from error
        except OSError as error:
            raise LineNotFound(f"{address}: {error.strerror or error}; check host and network") from error
        await asyncio.sleep(REFUSED_PAUSE_S)


async def _connect_once(address: ConnectAddress) -> socket.socket:
    """The first of the host's addresses that accepts; else the error of the last."""
    loop = asyncio.get_running_loop()
    failure = OSError(errno.EADDRNOTAVAIL, "the host has no address")
    for family, where in await _resolve(address):
        connection = socket.socket(family, socket.SOCK_STREAM)
        try:
            connection.setblocking(False)
            await loop.sock_connect(connection, where)
            if is_connected_to_itself(connection):
                raise ConnectionRefusedError(errno.ECONNREFUSED, "met itself")
            return connection
        except OSError as error:
            connection.close()
            failure = error
        except BaseException:
            connection.close()
            raise
    raise failure


async def _accept(address: ListenAddress, ready: Callable[[str], None]) -> socket.socket:
    """Wait for one connection; the port is closed again before the first byte, so that a second is refused."""
    try:
        family, where = (await _resolve(address))[0]
    except OSError as error:
        raise LineNotFound(f"{address}: {error.strerror or error}; check the host") from error
    with socket.socket(family, socket.SOCK_STREAM) as listener:
        _listen(listener, where, address)
        ready(str(ListenAddress(host=address.host, port=listener.getsockname()[1])))
        while True:
            await _readable(listener)
            try:
                # No await between the accept and the return: a cancel in between would leak the connection.
                return listener.accept()[0]
            except (BlockingIOError, ConnectionAbortedError):
                continue


def _listen(listener: socket.socket, where: _SocketAddress, address: ListenAddress) -> None:
    listener.setblocking(False)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(where)
        listener.listen(1)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise LineBusy(
                f"{address}: another program has this port; end it, or give another port (0 lets the system choose)"
            ) from error
        if error.errno == errno.EADDRNOTAVAIL:
            raise LineNotFound(f"{address}: this computer has no address {address.host}") from error
        raise LineError(f"{address}: {error.strerror}") from error


async def _resolve(
    address: ConnectAddress | ListenAddress,
) -> list[tuple[socket.AddressFamily, _SocketAddress]]:
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
    return [(family, where) for family, _, _, _, where in found]


async def _readable(listener: socket.socket) -> None:
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    loop.add_reader(listener, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_reader(listener)
