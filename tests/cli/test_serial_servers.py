"""Transfers through serial servers that somebody else wrote: Debian's ser2net, by RFC 2217 and raw, and socat.

The port they serve is a pseudo terminal with a simulated control behind it: it has a rate and no control lines.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.cli.helpers import DEADLINE_S, Shop, program

BAUD: Final = ("--baud", "19200", "--stopbits", "2")
PROGRAM: Final = program(60)


def free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


@contextmanager
def running(*words: str, port: int) -> Iterator[None]:
    """A server that listens at `port`. Nobody connects to find that out: it serves one at a time."""
    if shutil.which(words[0]) is None:
        pytest.skip(f"{words[0]} is not installed")
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            deadline = time.monotonic() + DEADLINE_S
            while f":{port:04X} " not in listening():
                assert server.poll() is None, f"{words} ended"
                assert time.monotonic() < deadline
                time.sleep(0.02)
            yield
        finally:
            server.kill()


def listening() -> str:
    """Local ports in the state LISTEN, as the kernel shows them."""
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()]
    return "".join(f"{row[1]} " for row in rows if len(row) > 3 and row[3] == "0A")


@contextmanager
def ser2net(folder: Path, accepter: str, device: Path) -> Iterator[int]:
    port = free_port()
    config = folder / "in-ser2net.yaml"
    config.write_text(
        f"connection: &one\n  accepter: {accepter},localhost,{port}\n  connector: serialdev,{device},19200n82,local\n"
    )
    with running("ser2net", "-n", "-d", "-c", str(config), port=port):
        yield port


def transferred(shop: Shop, line: str, device: Path, protocol: str) -> None:
    """A program goes whole to the control behind the server, or the test fails."""
    file, saved = shop.file("in.nc", PROGRAM), shop.folder / "saved"
    control = shop.start(
        "cnc", "--line", f"pty:{device}", "--protocol", protocol, "--save", saved, *BAUD, "--json", "--timeout", "60"
    )
    control.wait_for("ready")
    host = shop.run("send", file, "--line", line, "--protocol", protocol, *BAUD, "--json", "--timeout", "60")
    assert host.outcome == (0, "complete"), host.stderr
    assert control.finish().outcome == (0, "complete")
    assert saved.read_bytes() == PROGRAM


@pytest.mark.parametrize("protocol", ["fanuc-b", "fanuc-a"])
def test_ser2net_by_rfc2217(shop: Shop, protocol: str) -> None:
    device = shop.folder / "line"
    with ser2net(shop.folder, "telnet(rfc2217),tcp", device) as port:
        transferred(shop, f"rfc2217://localhost:{port}?signals=ignored", device, protocol)


def test_ser2net_raw(shop: Shop) -> None:
    device = shop.folder / "line"
    with ser2net(shop.folder, "tcp", device) as port:
        transferred(shop, f"socket://localhost:{port}", device, "fanuc-b")


def test_socat_raw(shop: Shop) -> None:
    device, port = shop.folder / "line", free_port()
    with running("socat", f"TCP-LISTEN:{port},reuseaddr", f"OPEN:{device},rawer", port=port):
        transferred(shop, f"socket://localhost:{port}", device, "fanuc-b")


def test_a_control_as_a_serial_server_has_control_lines_and_a_rate(shop: Shop) -> None:
    file, saved = shop.file("in.nc", PROGRAM), shop.folder / "saved"
    words = ("--protocol", "fanuc-b", "--json")
    control = shop.start("cnc", "--line", "rfc2217+listen://127.0.0.1:0", "--save", saved, *words)
    line = f"rfc2217://127.0.0.1:{control.port}"
    assert shop.run("send", file, "--line", line, *words).outcome == (0, "complete")
    assert control.finish().outcome == (0, "complete")
    assert saved.read_bytes() == PROGRAM
    control = shop.start("cnc", "--line", "rfc2217+listen://127.0.0.1:0", *words)
    line = f"rfc2217://127.0.0.1:{control.port}"
    refused = shop.run("send", file, "--line", line, *words, "--baud", "9600")
    assert refused.status == 1
    assert "asked for 9600 baud it says 19200" in refused.end["reason"]
    assert control.finish().status == 1
