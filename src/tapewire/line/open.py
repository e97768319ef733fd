"""Opens what a LINE names.

Reading the text (`parse_line`) and opening are two steps, so that a wrong LINE is refused before anything is touched.
"""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final, TypeAlias, assert_never

from tapewire.errors import LineBusy, LineError, LineNotFound
from tapewire.line.address import (
    ConnectAddress,
    LineAddress,
    LineOptions,
    ListenAddress,
    PtyAddress,
    TtyAddress,
    parse_line,
)
from tapewire.line.descriptor import DescriptorLine, LineSettings
from tapewire.line.driver import monotonic
from tapewire.line.ports.serial_port import TtyLine, open_tty
from tapewire.line.pty import create_pty
from tapewire.line.rfc2217.lines import ClientLine, ServerLine
from tapewire.line.tcp import TcpLine, is_connected_to_itself

__all__ = [
    "ConnectAddress",
    "LineAddress",
    "LineOptions",
    "ListenAddress",
    "PtyAddress",
    "TtyAddress",
    "open_line",
    "parse_line",
]

REFUSED_RETRY_S: Final = 5.0
"""How long a refused connection is tried again: two ends started by one script need no order."""
REFUSED_PAUSE_S: Final = 0.1
CONNECT_LIMIT_S: Final = 10.0
"""A host that answers nothing, not even a refusal, within this time is not there."""
AGREE_LIMIT_S: Final = 5.0
"""A serial server answers each setting at once; one that has not by then does not speak RFC 2217."""
EMPTY_QUESTIONS: Final = 30
EMPTY_PAUSE_S: Final = 0.01
"""An idle transmitter is empty; an adapter has told so after a few of its reports."""
SIGNALS_LIMIT_S: Final = 0.3
"""A server that tells its control lines does so as soon as it is asked to."""


_SocketAddress: TypeAlias = tuple[Any, ...]
"""What `getaddrinfo` gives and `bind` takes; its shape depends on the family."""


async def open_line(
    address: LineAddress,
    *,
    baud: int,
    stopbits: int,
    data_bits: int = 8,
    window: int,
    paced_reception: bool = False,
    on_ready: Callable[[str], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> DescriptorLine:
    """Open `address`; returns when the line is there, for `listen://` when somebody has connected.

    `on_ready` is told once, as a LINE, what the other side can now reach: for `listen://` the port as soon as it
    listens, for the others when they are open. `on_note` is told what a person at this line should know.
    Raises UsageError for settings no line can have, and LineError. Cancelling leaves nothing open.
    """
    options = LineOptions() if isinstance(address, PtyAddress) else address.options
    settings = LineSettings(
        baud=baud,
        stopbits=stopbits,
        data_bits=data_bits,
        parity=options.parity,
        signals=options.signals,
        window=window,
        paced_reception=paced_reception,
    )
    ready = on_ready or _nobody
    match address:
        case TtyAddress(path=path):
            line: DescriptorLine = await _proved(open_tty(path, settings, on_note=on_note), on_note or _nobody)
        case PtyAddress(path=path):
            line = create_pty(path, settings)
        case ConnectAddress(is_rfc2217=True):
            line = ClientLine(await _connect(address), settings)
            await _agree(line, address, on_note or _nobody)
        case ConnectAddress():
            line = TcpLine(await _connect(address), settings)
        case ListenAddress(is_rfc2217=True):
            server = ServerLine(await _accept(address, ready), settings)
            await _agree(server, address, _nobody)
            return server
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


async def _proved(line: TtyLine, note: Callable[[str], None]) -> TtyLine:
    """A port that is to run in a closed loop has to say once, before anything is sent, that it is empty."""
    try:
        for _ in range(EMPTY_QUESTIONS):
            if not line.waits_for_proof:
                break
            await asyncio.sleep(EMPTY_PAUSE_S)
    except BaseException:
        line.close(0)
        raise
    if line.waits_for_proof:
        line.run_without_asking()
        note("the driver never says that the transmitter is empty: no closed loop on this port")
    return line


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


async def _agree(line: ClientLine | ServerLine, address: LineAddress, note: Callable[[str], None]) -> None:
    """Until both ends have agreed and the settings are read back; closes the line where they do not."""
    try:
        line.negotiate(monotonic())
        with suppress(TimeoutError):
            async with asyncio.timeout(AGREE_LIMIT_S):
                while not line.is_ready and line.refusal is None:
                    await _more(line)
        if not line.is_ready:
            raise LineError(f"{address}: {line.refusal or line.missing}")
        with suppress(TimeoutError):
            async with asyncio.timeout(SIGNALS_LIMIT_S):
                while isinstance(line, ClientLine) and not line.knows_signals and line.refusal is None:
                    await _more(line)
    except BaseException:
        line.close(0)
        raise
    if isinstance(line, ClientLine) and not line.knows_signals:
        note(f"{address}: no control lines are told by the serial server; all count as ON")


async def _more(line: ClientLine | ServerLine) -> None:
    if line.watched is not None:
        await _readable(line.watched)
    else:
        await asyncio.sleep(REFUSED_PAUSE_S)
    line.negotiate(monotonic())


async def _accept(address: ListenAddress, ready: Callable[[str], None]) -> socket.socket:
    """Wait for one connection; the port is closed again before the first byte, so that a second is refused."""
    try:
        family, where = (await _resolve(address))[0]
    except OSError as error:
        raise LineNotFound(f"{address}: {error.strerror or error}; check the host") from error
    with socket.socket(family, socket.SOCK_STREAM) as listener:
        _listen(listener, where, address)
        ready(str(replace(address, port=listener.getsockname()[1])))
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


async def _readable(what: socket.socket | int) -> None:
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    loop.add_reader(what, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_reader(what)
