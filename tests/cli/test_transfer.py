"""Whole jobs between two processes, over every kind of line there is without hardware, in both roles."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from itertools import product
from typing import Final

import pytest

from tests.cli.helpers import FAST, Command, Finished, Shop, program
from tests.transfer.tapes import on_the_line

B, EXPANSION_B = "fanuc-b", "fanuc-b-expansion"


@dataclass(frozen=True)
class Line:
    """Which kind of line, and which end makes it."""

    kind: str
    maker: str

    def __str__(self) -> str:
        return f"{self.kind} made by the {self.maker}"


LINES: Final = [Line(kind, maker) for kind, maker in product(("tcp", "pty"), ("host", "cnc"))]


def start(
    shop: Shop, line: Line, *, host: list[object], cnc: list[object], link: str = "in-line"
) -> tuple[Command, Command]:
    """(host, cnc) on one line, once its maker says that it is there."""
    sooner = ["--set", "notice_time=0.1"] if {"fanuc-b", "fanuc-b-expansion"} & set(host) else []
    words = {"host": [*host, *sooner], "cnc": ["cnc", *cnc]}
    path = shop.folder / link
    here = "listen://127.0.0.1:0" if line.kind == "tcp" else f"pty:{path}"
    maker = shop.start(*words[line.maker], "--line", here, "--json")
    ready = str(maker.wait_for("ready")["line"])
    there = ready.replace("listen", "socket") if line.kind == "tcp" else str(path)
    other = shop.start(*words["cnc" if line.maker == "host" else "host"], "--line", there, "--json")
    return (maker, other) if line.maker == "host" else (other, maker)


def finish(host: Command, cnc: Command) -> tuple[Finished, Finished]:
    return host.finish(), cnc.finish()


def settings(**values: str) -> list[object]:
    return [word for key, value in values.items() for word in ("--set", f"{key}={value}")]


def identical(sent: Finished, taken: Finished, expected: bytes) -> None:
    """Both ends are done and agree on every byte."""
    digest = hashlib.sha256(expected).hexdigest()
    for finished in (sent, taken):
        assert finished.outcome == (0, "complete"), finished.stderr
        assert (finished.end["bytes"], finished.end["bytes_handed"]) == (len(expected), len(expected))
        assert finished.end["sha256"] == digest
        assert not finished.named("violation")
        assert not finished.named("alarm")


# Every value in some row; every combination is in tests/transfer/test_matrix.py.
FEEDS: Final = [
    (B, LINES[0], "iso", "on", "eia"),
    (B, LINES[3], "ascii", "off", "iso"),
    (EXPANSION_B, LINES[1], "ascii", "on", "iso"),
    (EXPANSION_B, LINES[2], "iso", "off", "ascii"),
]


@pytest.mark.parametrize(("protocol", "line", "code", "posting", "data"), FEEDS, ids=str)
def test_a_program_arrives_as_it_is(shop: Shop, protocol: str, line: Line, code: str, posting: str, data: str) -> None:
    text, saved = program(500), shop.folder / "saved.nc"
    common = ["--protocol", protocol, *FAST, *settings(code=code, posting=posting, data=data)]
    sent, taken = finish(
        *start(
            shop,
            line,
            host=["send", shop.file("in.nc", text), *common],
            cnc=["--save", saved, *common],
        )
    )
    identical(sent, taken, on_the_line(text, data))
    assert saved.read_bytes() == on_the_line(text, data)
    assert shop.files == {"saved.nc"}
    assert not os.path.lexists(shop.folder / "in-line")
    told = [event["event"] for event in sent.events]
    assert told.index("stop_distance") < told.index("started")
    assert [event["event"] for event in sent.events].count("ready") == 1


def test_what_is_changed_for_the_wire_is_said_before_it_is_sent(shop: Shop) -> None:
    file = shop.file("in.nc", b"O0001\r\nG01X1.\r\nM30\r\n")
    sent, taken = finish(
        *start(shop, LINES[0], host=["send", file, "--protocol", B], cnc=["--operation", "read", "--protocol", B])
    )
    identical(sent, taken, b"%\nO0001\nG01X1.\nM30\n%")
    names = [event["event"] for event in sent.events]
    notices = [str(event["text"]) for event in sent.named("notice")]
    for change in ("put before the first block", "CR dropped before LF in 3 blocks", "EOR (%) added"):
        assert any(change in notice for notice in notices), notices
        assert change in sent.stderr
    assert max(index for index, name in enumerate(names) if name == "notice") < names.index("started")


def test_raw_bytes_go_out_untouched(shop: Shop) -> None:
    raw = b"\n\x93\x00O1\r\nG06\n\x13\x11%"
    sent, taken = finish(
        *start(
            shop,
            LINES[3],
            host=["send", "--raw", shop.file("in.nc", raw), "--protocol", B],
            cnc=["--save", shop.folder / "saved.nc", "--protocol", B],
        )
    )
    identical(sent, taken, raw)
    assert (shop.folder / "saved.nc").read_bytes() == raw


PUNCHED: Final = b"%\nO3563(356)\nG01X3.5Y-6.563\nM30\n%"
"""In EIA the digits 3, 5 and 6 are 13h, 15h and 16h, which are control codes everywhere else."""

PUNCHES: Final = [
    (B, LINES[0], "iso", "on", "eia"),
    (EXPANSION_B, LINES[1], "ascii", "off", "eia"),
    (B, LINES[2], "ascii", "on", "iso"),
    (EXPANSION_B, LINES[3], "iso", "off", "ascii"),
]


@pytest.mark.parametrize(("protocol", "line", "code", "posting", "data"), PUNCHES, ids=str)
def test_a_punch_out_arrives_as_it_is(
    shop: Shop, protocol: str, line: Line, code: str, posting: str, data: str
) -> None:
    got = shop.folder / "got.nc"
    common = ["--protocol", protocol, *settings(code=code, posting=posting, data=data)]
    received, punched = finish(
        *start(
            shop,
            line,
            host=["receive", got, *common],
            cnc=["--operation", "punch", "--file", shop.file("in.nc", PUNCHED), *common],
        )
    )
    assert punched.outcome == (0, "complete")
    assert punched.end["sha256"] == hashlib.sha256(on_the_line(PUNCHED, data)).hexdigest()
    assert received.outcome == (0, "complete"), received.stderr
    assert (received.end["bytes"], received.end["bytes_handed"]) == (len(PUNCHED), len(PUNCHED))
    assert received.end["sha256"] == hashlib.sha256(PUNCHED).hexdigest()
    assert got.read_bytes() == PUNCHED
    assert shop.files == {"got.nc"}


def test_a_raw_reception_stores_what_was_on_the_line(shop: Shop) -> None:
    got, punched = shop.folder / "got.nc", on_the_line(PUNCHED, "eia")
    common = ["--protocol", B, "--raw", *settings(data="eia")]
    file = shop.file("in.eia", bytes(9) + punched + bytes(9))
    ends = start(shop, LINES[2], host=["receive", got, *common], cnc=["--operation", "punch", "--file", file, *common])
    received, _ = finish(*ends)
    assert received.outcome == (0, "complete")
    assert got.read_bytes() == bytes(9) + punched + bytes(9)


def test_leader_and_trailer_are_left_out(shop: Shop) -> None:
    got = shop.folder / "got.nc"
    file = shop.file("in.nc", bytes(20) + PUNCHED.replace(b"\n", b"\n\r\r") + bytes(20))
    common = ["--protocol", B, *FAST]
    received, _ = finish(
        *start(
            shop,
            LINES[3],
            host=["receive", got, *common],
            cnc=["--operation", "punch", "--raw", "--file", file, *common],
        )
    )
    assert received.outcome == (0, "complete"), received.stderr
    assert got.read_bytes() == PUNCHED


def test_force_replaces_a_file_when_the_new_one_is_whole(shop: Shop) -> None:
    got = shop.file("got.nc", b"what was there before, and longer than what comes now" * 5)
    common = ["--protocol", B, *FAST]
    file = shop.file("in.nc", PUNCHED)
    host, cnc = start(
        shop,
        LINES[2],
        host=["receive", got, "--force", *common],
        cnc=["--operation", "punch", "--file", file, *common],
    )
    assert host.finish().outcome == (0, "complete")
    assert cnc.finish().outcome == (0, "complete")
    assert got.read_bytes() == PUNCHED
    assert shop.files == {"got.nc"}
