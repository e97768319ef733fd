"""Who reads what a command says must not matter to the line: nobody, a slow program, a terminal."""

from __future__ import annotations

import json
import os
import pty
import socket
import subprocess
import sys
import threading
import time
from typing import IO, Final

import pytest

from tests.cli.helpers import DEADLINE_S, FAST, Shop, check_stream, program
from tests.cli.test_transfer import LINES, finish, identical, start

TEXT: Final = program(3000)


def feed_with_many_stops(port: int, text: bytes) -> None:
    """Play a control whose every reading is stopped and started, which makes more events than a pipe holds."""
    with socket.create_connection(("127.0.0.1", port), DEADLINE_S) as control:
        control.sendall(b"\x11")
        got = b""
        while len(got) < len(text):
            got += control.recv(200)
            if len(got) < len(text) - 1000:
                control.sendall(b"\x93\x11")
        assert got == text
        control.sendall(b"\x93")
        while control.recv(200):
            pass


def send_unread(shop: Shop, **pipes: int) -> tuple[subprocess.Popen[str], IO[str], str]:
    file = shop.file("in.nc", TEXT)
    words = ["send", str(file), "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b-expansion", *FAST, "--json"]
    command = [sys.executable, "-m", "tapewire", *words, "--set", "closing_time=0.2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **pipes)  # type: ignore[call-overload]
    assert process.stdout is not None
    first = process.stdout.readline()
    return process, process.stdout, first


def test_pipes_that_nobody_reads(shop: Shop) -> None:
    read, write = os.pipe()
    process, output, first = send_unread(shop, stderr=write)
    with os.fdopen(read), os.fdopen(write, "w") as blocked, output:
        os.set_blocking(blocked.fileno(), False)
        try:
            while True:
                os.write(blocked.fileno(), b"x" * 4096)
        except BlockingIOError:
            os.set_blocking(blocked.fileno(), True)
        feed_with_many_stops(int(json.loads(first)["line"].rpartition(":")[2]), TEXT)
        assert process.wait(DEADLINE_S) == 0


def test_a_reader_that_comes_late_sees_how_it_ended(shop: Shop) -> None:
    """And when things happened, not when it came. Events in between may be missing; stderr is not held up by stdout."""
    read, write = os.pipe()
    process, output, first = send_unread(shop, stderr=write)
    os.close(write)
    with os.fdopen(read) as errors, output:
        feed_with_many_stops(int(json.loads(first)["line"].rpartition(":")[2]), TEXT)
        fed_ns = time.time_ns()
        told = ""
        while "complete: " not in told:
            line = errors.readline()
            assert line, told
            told += line
        events = [json.loads(line) for line in [first, *output]]
        assert process.wait(DEADLINE_S) == 0
    check_stream(events)
    assert events[-1]["outcome"] == "complete"
    held = [event["time_ns"] for event in events if event["event"] == "held"]
    assert len(held) > 100
    assert max(held[:-1]) <= fed_ns


@pytest.mark.parametrize("reads", [True, False], ids=["a terminal", "a stopped terminal"])
def test_a_terminal_gets_a_bar(shop: Shop, reads: bool) -> None:
    text = program(300)
    controller, terminal = pty.openpty()
    words = ["send", str(shop.file("in.nc", text)), "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b"]
    command = [sys.executable, "-m", "tapewire", *words, "--baud", "86400", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, text=True)
    shown = bytearray()

    def read() -> None:
        try:
            while data := os.read(controller, 4096):
                shown.extend(data)
        except OSError:
            pass

    reader = threading.Thread(target=read)
    assert process.stdout is not None
    with process.stdout:
        if reads:
            reader.start()
        port = json.loads(process.stdout.readline())["line"].rpartition(":")[2]
        cnc = shop.start("cnc", "--line", f"socket://127.0.0.1:{port}", "--protocol", "fanuc-b", "--baud", "86400")
        lines = process.stdout.read().splitlines()
        assert process.wait(DEADLINE_S) == 0
        assert cnc.finish().status == 0
    os.close(terminal)
    if reads:
        reader.join(DEADLINE_S)
        told = shown.decode()
        assert "running" in told
        assert f"of {len(text):,} bytes" in told
        assert "complete: " in told
        assert "Traceback" not in told
    os.close(controller)
    assert json.loads(lines[-1])["outcome"] == "complete"


def test_progress_tells_where_a_job_stands(shop: Shop) -> None:
    text = program(300)
    file = shop.file("in.nc", text)
    common: list[object] = ["--protocol", "fanuc-b", "--baud", "38400"]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *common], cnc=common))
    identical(sent, taken, text)
    counts = [event["bytes"] for event in sent.named("progress")]
    assert counts == sorted(counts)
    assert any(0 < count < len(text) for count in counts)
    assert counts[-1] == len(text)
    for event in sent.named("progress"):
        assert event["total"] == len(text)
        assert event["bytes"] <= event["total"]
        assert 0 <= event["share"] <= 1.05
        assert event["left_s"] is None or event["left_s"] >= 0
