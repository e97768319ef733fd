"""LINE as users write it: where the serial bytes go, and what belongs to the cable there."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from tapewire.errors import UsageError
from tapewire.line.descriptor import Parity, Signals

__all__ = ["ConnectAddress", "LineAddress", "LineOptions", "ListenAddress", "PtyAddress", "TtyAddress", "parse_line"]

FORMS: Final = (
    "a LINE is the path of a port (/dev/ttyUSB0), socket://HOST:PORT, listen://HOST:PORT, rfc2217://HOST:PORT,"
    " rfc2217+listen://HOST:PORT or pty:PATH"
)

_VALUES: Final = {("signals", value) for value in Signals} | {("parity", value) for value in Parity}
_OPTIONS: Final = "?signals=used|ignored and ?parity=none|even|odd, joined by &"
_WITHOUT_OPTIONS: Final = ("pty:", "socket://", "listen://")


@dataclass(frozen=True, slots=True, kw_only=True)
class LineOptions:
    """What stands behind the `?` of a LINE that has a real port somewhere."""

    signals: Signals = Signals.USED
    parity: Parity | None = None

    def __str__(self) -> str:
        words = [] if self.signals is Signals.USED else [f"signals={self.signals}"]
        words += [] if self.parity is None else [f"parity={self.parity}"]
        return "?" + "&".join(words) if words else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TtyAddress:
    """A serial port of this computer."""

    path: str
    options: LineOptions = field(default_factory=LineOptions)

    def __str__(self) -> str:
        return f"{self.path}{self.options}"


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
    is_rfc2217: bool = False
    """It is a serial server that tells of its port and lets it be set up."""
    options: LineOptions = field(default_factory=LineOptions)

    def __str__(self) -> str:
        return f"{'rfc2217' if self.is_rfc2217 else 'socket'}://{_bracketed(self.host)}:{self.port}{self.options}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ListenAddress:
    """A TCP port of this computer on which one connection is awaited; port 0 lets the system choose."""

    host: str
    port: int
    is_rfc2217: bool = False
    """Who connects finds a serial server, with this end's control lines."""
    options: LineOptions = field(default_factory=LineOptions)

    def __str__(self) -> str:
        return f"{'rfc2217+' if self.is_rfc2217 else ''}listen://{_bracketed(self.host)}:{self.port}{self.options}"


LineAddress: TypeAlias = TtyAddress | PtyAddress | ConnectAddress | ListenAddress


def parse_line(text: str) -> LineAddress:
    """Read a LINE. Opens nothing. Raises UsageError with the forms there are."""
    where, options = _options(text)
    for scheme in ("socket://", "rfc2217://"):
        if where.startswith(scheme):
            host, port = _host_and_port(where, scheme)
            if port == 0:
                raise UsageError(f"{text!r}: port 0 is only for listen://; {FORMS}")
            return ConnectAddress(host=host, port=port, is_rfc2217=scheme == "rfc2217://", options=options)
    for scheme in ("listen://", "rfc2217+listen://"):
        if where.startswith(scheme):
            host, port = _host_and_port(where, scheme)
            return ListenAddress(host=host, port=port, is_rfc2217=scheme != "listen://", options=options)
    if where.startswith("pty:"):
        return PtyAddress(path=_path(text, where.removeprefix("pty:")))
    if "://" in where or "/" not in where:
        raise UsageError(f"{text!r} is no line: {FORMS}")
    return TtyAddress(path=_path(text, where), options=options)


def _options(text: str) -> tuple[str, LineOptions]:
    """What stands before the last `?`, and the options behind it."""
    where, mark, behind = text.rpartition("?")
    if not mark:
        return text, LineOptions()
    if text.startswith(_WITHOUT_OPTIONS):
        raise UsageError(f"{text!r}: only a serial port and a serial server by RFC 2217 have {_OPTIONS}")
    said: dict[str, str] = {}
    for word in behind.split("&"):
        key, _, value = word.partition("=")
        if (key, value) not in _VALUES or key in said:
            raise UsageError(f"{text!r}: {word!r} is no option of a line; there are {_OPTIONS}")
        said[key] = value
    parity = said.get("parity")
    return where, LineOptions(
        signals=Signals(said.get("signals", Signals.USED)), parity=Parity(parity) if parity else None
    )


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
