"""`tapewire monitor` between real commands on real ptys and sockets, and on one line alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path

import pytest

from tapewire.line.captures.records import Happening
from tests.cli.helpers import DEADLINE_S, FAST, Command, Finished, Shop, invoke, program
from tests.cli.test_capture import spoken


def watch(shop: Shop, kind: str, *words: object) -> tuple[Command, str, str]:
    """A monitor, and the LINE at which a host and a control reach it."""
    here = ["listen://127.0.0.1:0"] * 2 if kind == "tcp" else [f"pty:{shop.folder}/in-{end}" for end in ("host", "cnc")]
    lines = [word for line in here for word in ("--line", line)]
    command = shop.start("monitor", *lines, *FAST, "--json", *words)
    ready = [command.wait_for("ready")["line"] for _ in here]
    host, cnc = (line.replace("listen", "socket").removeprefix("pty:") for line in ready)
    return command, host, cnc


def entries(finished: Finished) -> list[tuple[str, str]]:
    kinds = ("said", "program", "violation", "fault")
    return [(event["event"], event["text"]) for event in finished.events if event["event"] in kinds]


@pytest.mark.parametrize(("protocol", "kind"), [("fanuc-b", "pty"), ("fanuc-a-expansion", "tcp")])
def test_a_transfer_through_a_monitor_is_byte_identical(shop: Shop, protocol: str, kind: str) -> None:
    source = program(400)
    told = ("--protocol", protocol) if protocol != "fanuc-b" else ()
    capture = shop.folder / "between.pcapng"
    watching, host_line, cnc_line = watch(shop, kind, "--capture", capture, *told)
    words = ("--protocol", protocol, *FAST, "--json")
    cnc = shop.start("cnc", "--line", cnc_line, *words, "--save", shop.folder / "taken")
    host = shop.run("send", shop.file("in.nc", source), "--line", host_line, *words)
    assert host.outcome == (0, "complete")
    assert cnc.finish().outcome == (0, "complete")
    seen = watching.finish()
    assert seen.outcome == (0, "complete")
    assert (shop.folder / "taken").read_bytes() == source
    assert not [entry for entry in entries(seen) if entry[0] in ("violation", "fault")]
    fed = sum(event["bytes"] for event in seen.named("program") if event["side"] == "host")
    assert fed >= len(source)
    both = spoken(capture, Happening.SENT) + spoken(capture, Happening.RECEIVED)
    assert seen.end["bytes"] == len(both)
    if protocol.startswith("fanuc-b"):
        assert spoken(capture, Happening.SENT) == source


def test_a_punch_out_through_a_monitor_is_byte_identical(shop: Shop) -> None:
    source = program(600)
    watching, host_line, cnc_line = watch(shop, "tcp", "--protocol", "fanuc-b")
    words = ("--protocol", "fanuc-b", *FAST, "--json")
    host = shop.start("receive", shop.folder / "received", "--line", host_line, *words, "--raw")
    cnc = shop.start("cnc", "--line", cnc_line, *words, "--operation", "punch", "--file", shop.file("in.nc", source))
    assert host.finish().outcome == (0, "complete")
    assert cnc.finish().outcome == (0, "complete")
    seen = watching.finish()
    assert (shop.folder / "received").read_bytes() == source
    assert ("said", "DC2") in entries(seen)
    assert ("said", "DC4") in entries(seen)


@pytest.mark.parametrize("moment", ["before anybody is there", "in the middle"])
def test_ctrl_c_ends_it_with_130(shop: Shop, moment: str) -> None:
    watching, host_line, cnc_line = watch(shop, "pty", "--protocol", "fanuc-b", "--capture", shop.folder / "c.pcapng")
    if moment == "in the middle":
        words = ("--protocol", "fanuc-b", "--json", "--baud", "9600")
        shop.start("cnc", "--line", cnc_line, *words)
        shop.start("send", shop.file("in.nc", program(5000)), "--line", host_line, *words)
        watching.wait_for("program")
    watching.interrupt()
    assert watching.finish().outcome == (130, "cancelled")
    assert not list(shop.folder.glob("in-host"))


def test_one_line_alone_is_listened_to(shop: Shop) -> None:
    path = shop.folder / "in-line"
    watching = shop.start("monitor", "--line", f"pty:{path}", "--protocol", "fanuc-b", *FAST, "--json")
    watching.wait_for("ready")
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(line, b"\x11")
        assert watching.wait_for("said")["text"] == "DC1"
        os.write(line, b"\x93")
        assert watching.wait_for("said")["text"] == "DC3"
    finally:
        os.close(line)
    seen = watching.finish()
    assert seen.outcome == (0, "complete")
    assert (seen.end["bytes"], seen.end["sha256"]) == (2, sha256(b"\x11\x93").hexdigest())


def test_people_see_the_dialogue_on_stdout(shop: Shop) -> None:
    path = shop.folder / "in-line"
    command = [sys.executable, "-m", "tapewire", "monitor", "--line", f"pty:{path}", "--protocol", "fanuc-b"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = os.open(_made(path), os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(line, b"\x11\x1b]0;evil\x07")
            time.sleep(0.2)
        finally:
            os.close(line)
        stdout, stderr = process.communicate(timeout=DEADLINE_S)
    finally:
        process.kill()
    assert process.returncode == 0
    lines = stdout.splitlines()
    assert lines[0].startswith("== times count from")
    assert lines[1] == "    0.000000  cnc   DC1"
    assert "\x1b" not in stdout
    assert "\x07" not in stdout
    assert "Traceback" not in stderr
    assert f"ready: pty:{path}" in stderr


def _made(path: Path) -> Path:
    deadline = time.monotonic() + DEADLINE_S
    while not path.exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return path


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--line", "pty:x"], "give --baud"),
        (["--line", "pty:x", "--line", "pty:y", "--line", "pty:z", "--baud", "9600"], "stands between two"),
        (["--line", "nowhere", "--baud", "9600"], "is no line"),
        (["--line", "pty:x", "--protocol", "fanuc-z"], "there is no protocol"),
        (["--line", "pty:x", "--baud", "9600", "--set", "code=iso"], "say which one with --protocol"),
        ([], "Missing option '--line'"),
    ],
)
def test_what_is_wrong_is_refused_before_a_line_is_opened(words: list[str], reason: str) -> None:
    refused = invoke("monitor", *words, "--json")
    assert refused.outcome == (2, "failed")
    assert reason in refused.end["reason"]


def test_one_line_that_cannot_be_opened_closes_the_other(shop: Shop) -> None:
    gone = shop.folder / "gone" / "line"
    words = ("--line", f"pty:{shop.folder}/in-host", "--line", f"pty:{gone}", "--baud", "9600", "--json")
    failed = shop.run("monitor", *words)
    assert failed.outcome == (1, "failed")
    assert str(gone) in failed.end["reason"]
    assert not list(shop.folder.iterdir())


def test_a_closing_terminal_ends_it_too(shop: Shop) -> None:
    watching, _, _ = watch(shop, "pty")
    watching.interrupt(signal.SIGHUP)
    assert watching.finish().outcome == (130, "cancelled")
