"""`tapewire decode` as people and programs use it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from tapewire.line.captures.reader import Packet, read_capture
from tapewire.line.captures.records import Happening, Lines
from tests.cli.helpers import check_stream, invoke

GOLDEN = Path(__file__).parents[1] / "captures" / "damaged_message.pcapng"
TSHARK = shutil.which("tshark")


@dataclass
class Decoded:
    """What the command left behind."""

    status: int
    stdout: str
    stderr: str

    @property
    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.stdout.splitlines()]


def decode(*words: object, stdin: bytes = b"", **environment: str) -> Decoded:
    command = [sys.executable, "-m", "tapewire", "decode", *map(str, words)]
    done = subprocess.run(
        command, capture_output=True, input=stdin, check=False, timeout=60, env={**os.environ, **environment}
    )
    stderr = done.stderr.decode()
    assert "Traceback" not in stderr
    return Decoded(done.returncode, done.stdout.decode(), stderr)


def test_a_dialogue_is_told_on_stdout() -> None:
    told = decode(GOLDEN)
    assert (told.status, told.stderr) == (0, "")
    lines = told.stdout.splitlines()
    assert lines[1] == "== fanuc-a, as the capture says"
    assert "    0.000000  cnc   SYN" in lines
    assert any("!! the host said something unreadable: checksum error" in line for line in lines)
    assert lines[-1] == "== 1 violation"


def test_the_same_for_programs() -> None:
    told = decode(GOLDEN, "--json")
    assert told.status == 0
    check_stream(told.events)
    end = told.events[-1]
    assert (end["outcome"], end["violations"]) == ("complete", 1)
    assert end["sha256"] == sha256(GOLDEN.read_bytes()).hexdigest()
    fed = [event for event in told.events if event["event"] == "program"]
    assert sum(event["bytes"] for event in fed) == 4 * 1024 + 301
    assert all(event["side"] == "host" and event["until_ns"] > event["time_ns"] for event in fed)


def test_it_reads_a_pipe_and_draws_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "line.svg"
    told = decode("-", "--svg", picture, stdin=GOLDEN.read_bytes())
    assert told.stdout == decode(GOLDEN).stdout
    root = ElementTree.parse(picture).getroot()
    assert root.tag.endswith("svg")
    refused = decode(GOLDEN, "--svg", picture)
    assert (refused.status, refused.stdout) == (2, "")
    assert "exists; name another file, or say --force" in refused.stderr
    assert decode(GOLDEN, "--svg", picture, "--force").status == 0
    unwritable = decode(GOLDEN, "--svg", tmp_path / "gone" / "line.svg")
    assert unwritable.status == 2
    assert "cannot be written" in unwritable.stderr


def test_a_cut_file_gives_what_is_whole_and_status_1(tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(GOLDEN.read_bytes()[:5001])
    told = decode(cut, "--json")
    assert told.status == 1
    end = told.events[-1]
    assert end["outcome"] == "failed"
    assert "in the middle of a block" in end["reason"]
    assert [event for event in told.events if event["event"] == "said"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["gone.pcapng"], "cannot be read"),
        ([__file__], "is no capture"),
        (["."], "cannot be read"),
        ([GOLDEN, "--protocol", "fanuc-z"], "there is no protocol"),
        ([GOLDEN, "--set", "code=iso"], "say which one with --protocol"),
        ([GOLDEN, "--protocol", "fanuc-a", "--set", "x=y"], "there is no setting"),
        ([GOLDEN, "--side", "middle"], "Invalid value for '--side'"),
    ],
)
def test_what_is_wrong_is_refused(words: list[object], reason: str) -> None:
    for as_json in ([], ["--json"]):
        refused = invoke("decode", *words, *as_json)
        assert refused.status == 2
        assert reason in (refused.end["reason"] if as_json else refused.stderr)


def test_a_reader_that_has_seen_enough_is_no_trouble() -> None:
    command = f"{sys.executable} -m tapewire decode {GOLDEN} | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, check=True, text=True, timeout=60)
    assert done.stdout.startswith("== ")
    assert done.stderr == ""


def test_an_old_terminal_shows_what_it_can() -> None:
    assert decode(GOLDEN, PYTHONIOENCODING="ascii").status == 0


@pytest.mark.skipif(TSHARK is None, reason="tshark is not installed (Debian package tshark)")
def test_tshark_sees_the_same_characters_directions_and_lines() -> None:
    assert TSHARK is not None
    fields = ["rtacser.eventtype", "rtacser.cts", "rtacser.dsr", "rtacser.rts", "rtacser.dtr", "data.data"]
    command = [TSHARK, "-r", str(GOLDEN), "-T", "fields", *(word for field in fields for word in ("-e", field))]
    done = subprocess.run(command, capture_output=True, check=True, text=True, timeout=60)
    seen = [tuple(line.split("\t")) for line in done.stdout.splitlines()]
    with GOLDEN.open("rb") as stream:
        records = [item.record for item in read_capture(stream) if isinstance(item, Packet)]
    assert seen == [
        (
            f"{record.what:#04x}",
            *(str(int(line in record.lines)) for line in (Lines.CTS, Lines.DSR, Lines.RTS, Lines.DTR)),
            record.data.hex(),
        )
        for record in records
    ]
    told = decode(GOLDEN, "--json").events[-1]["bytes"]
    assert told == sum(len(record.data) for record in records)
    assert {Happening.SENT, Happening.RECEIVED} <= {record.what for record in records}
