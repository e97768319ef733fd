"""Ctrl-C and its kin: an orderly end at any time, and not a byte after it."""

from __future__ import annotations

import asyncio
import hashlib
import os
import signal
import socket
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import pytest

from tapewire.cli.ending import ignore_signals, interrupt_on_signals, stop_on_signals
from tests.cli.helpers import DEADLINE_S, Command, Finished, Shop, own_handlers, program

TEXT: Final = program(2000)
HOST: Final = ("--protocol", "fanuc-b", "--baud", "86400", "--json")


def given_up(finished: Finished) -> None:
    assert finished.outcome == (130, "cancelled"), finished.stderr


class Listener:
    """Reads one end of a line to its end, and counts."""

    def __init__(self, read: Callable[[], bytes]) -> None:
        self.got = bytearray()
        self._read = read
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def _work(self) -> None:
        try:
            while data := self._read():
                self.got += data
        except OSError:  # how a pseudo terminal ends
            pass

    def wait_for(self, count: int) -> None:
        deadline = time.monotonic() + DEADLINE_S
        while len(self.got) < count:
            assert time.monotonic() < deadline, f"{len(self.got)} bytes of {count}"
            time.sleep(0.005)

    def to_the_end(self) -> bytes:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()
        return bytes(self.got)


def interrupted_send(send: Command, listener: Listener, number: signal.Signals, times: int = 1) -> None:
    listener.wait_for(3000)
    for _ in range(times):
        send.interrupt(number)
        time.sleep(0.002)
    end = send.wait_for("end")
    handed = end["bytes_handed"]
    finished = send.finish()
    got = listener.to_the_end()
    given_up(finished)
    assert len(finished.named("end")) == 1
    assert finished.end["bytes"] <= len(got) <= handed, "a byte left after the end was told, or fewer than were told"
    assert got == TEXT[: len(got)]
    assert finished.end["sha256"] == hashlib.sha256(TEXT[: finished.end["bytes"]]).hexdigest()
    assert "RESET the control" in finished.end["reason"]
    assert f"{finished.end['bytes']:,}" in finished.stderr


@pytest.mark.parametrize(("number", "times"), [(signal.SIGINT, 1), (signal.SIGTERM, 1), (signal.SIGHUP, 20)])
def test_no_byte_follows_the_end_over_tcp(shop: Shop, number: signal.Signals, times: int) -> None:
    send = shop.start("send", shop.file("in.nc", TEXT), "--line", "listen://127.0.0.1:0", *HOST)
    with socket.create_connection(("127.0.0.1", send.port), DEADLINE_S) as control:
        control.sendall(b"\x11")
        interrupted_send(send, Listener(lambda: control.recv(65536)), number, times)


def open_raw(path: Path) -> int:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(fd)
    return fd


def test_no_byte_follows_the_end_over_a_pseudo_terminal(shop: Shop) -> None:
    path = shop.folder / "in-line"
    send = shop.start("send", shop.file("in.nc", TEXT), "--line", f"pty:{path}", *HOST)
    send.wait_for("ready")
    control = open_raw(path)
    try:
        os.write(control, b"\x11")
        interrupted_send(send, Listener(lambda: os.read(control, 65536)), signal.SIGINT)
    finally:
        os.close(control)
    assert not os.path.lexists(path)


def test_while_it_is_held(shop: Shop) -> None:
    send = shop.start("send", shop.file("in.nc", TEXT), "--line", "listen://127.0.0.1:0", *HOST)
    with socket.create_connection(("127.0.0.1", send.port), DEADLINE_S) as control:
        control.sendall(b"\x11")
        listener = Listener(lambda: control.recv(65536))
        listener.wait_for(1000)
        control.sendall(b"\x93")
        send.wait_for("held")
        time.sleep(0.3)
        interrupted_send_when_held(send, listener)


def interrupted_send_when_held(send: Command, listener: Listener) -> None:
    before = len(listener.got)
    send.interrupt()
    given_up(send.finish())
    assert len(listener.to_the_end()) == before


def test_before_anybody_is_there(shop: Shop) -> None:
    file, path = shop.file("in.nc", TEXT), shop.folder / "in-line"
    listen = ("--line", "listen://127.0.0.1:0", *HOST)
    pseudo = ("--line", f"pty:{path}", *HOST)
    commands = [
        (signal.SIGINT, shop.start("send", file, *listen)),
        (signal.SIGTERM, shop.start("send", file, *pseudo)),
        (signal.SIGINT, shop.start("receive", shop.folder / "got.nc", *listen)),
        (signal.SIGHUP, shop.start("cnc", "--save", shop.folder / "saved.nc", *listen)),
        (signal.SIGINT, shop.start("cnc", "--operation", "punch", "--file", file, "--line", f"pty:{path}2", *HOST)),
    ]
    for number, command in commands:
        command.wait_for("ready")
        command.interrupt(number)
    for _, command in commands:
        finished = command.finish()
        given_up(finished)
        assert (finished.end["bytes"], finished.end["bytes_handed"]) == (0, 0)
    assert shop.files == set()
    assert [path.name for path in shop.folder.iterdir()] == ["in.nc"]


def test_while_a_connection_is_tried(shop: Shop) -> None:
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    send = shop.start("send", shop.file("in.nc", TEXT), "--line", f"socket://127.0.0.1:{port}", *HOST)
    time.sleep(1.5)  # nothing is told before the line is open
    send.interrupt()
    given_up(send.finish())


def test_a_reception_keeps_what_came(shop: Shop) -> None:
    receive = shop.start("receive", shop.folder / "got.nc", "--line", "listen://127.0.0.1:0", *HOST)
    with socket.create_connection(("127.0.0.1", receive.port), DEADLINE_S) as control:
        control.sendall(b"\x12" + TEXT[:1000])
        receive.wait_for_bytes(1000)
        receive.interrupt(signal.SIGTERM)
        finished = receive.finish()
    given_up(finished)
    assert finished.end["bytes"] == 1000
    assert "got.nc.part" in finished.end["reason"]
    assert shop.files == {"got.nc.part"}
    assert (shop.folder / "got.nc.part").read_bytes() == TEXT[:1000]


def test_a_control_says_goodbye(shop: Shop) -> None:
    """Its Ctrl-C is a RESET: the host hears of it, and knows that its program is not whole."""
    cnc = shop.start("cnc", "--blocks-per-second", "50", "--line", "listen://127.0.0.1:0", *HOST)
    line = f"socket://127.0.0.1:{cnc.port}"
    send = shop.start("send", shop.file("in.nc", TEXT), "--line", line, *HOST)
    cnc.wait_for_bytes(500)
    cnc.interrupt()
    taken, sent = cnc.finish(), send.finish()
    given_up(taken)
    assert sent.outcome == (1, "cancelled")
    assert "SYN" in sent.end["reason"]
    assert sent.end["bytes"] <= taken.end["bytes_handed"] <= sent.end["bytes_handed"]


def test_a_control_whose_host_reads_nothing_any_more(shop: Shop) -> None:
    """What it still had to say can never leave."""
    words = ["cnc", "--operation", "punch", "--file", shop.file("in.nc", TEXT), *HOST[:-1]]
    with socket.socket() as host:
        host.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        host.bind(("127.0.0.1", 0))
        host.listen(1)
        line = ("--line", f"socket://127.0.0.1:{host.getsockname()[1]}")
        cnc = shop.start(*words, *line, "--json")
        connection, _ = host.accept()
        with connection:
            cnc.wait_for("started")
            time.sleep(1.0)
            cnc.interrupt()
            finished = cnc.finish()
    given_up(finished)
    assert finished.end["bytes"] <= finished.end["bytes_handed"] < len(TEXT)


def test_an_interrupt_that_an_import_loses_counts() -> None:
    """Python drops an exception that is raised in a callback of its own, with a line on stderr at most."""

    async def job() -> bool:
        stop = asyncio.Event()
        stop_on_signals(stop)
        ignore_signals()
        return stop.is_set()

    with own_handlers():
        interrupt_on_signals()
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert asyncio.run(job())
        interrupt_on_signals()
        assert not asyncio.run(job())
