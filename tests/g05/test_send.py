"""`tapewire send` with a G05 section, end to end: two processes and a pseudo terminal between them."""

from __future__ import annotations

import hashlib

import pytest

from tapewire.g05.layout import Layout, RecordFormat
from tests.cli.helpers import Shop
from tests.g05.test_sections import section


@pytest.mark.parametrize(
    ("protocol", "g05", "layout"),
    [
        ("fanuc-b-expansion", "3,general,2ms", Layout(axis_count=3, format=RecordFormat.GENERAL)),
        ("fanuc-a", "3,2ms", Layout(axis_count=3)),
    ],
)
def test_a_program_with_a_section_over_a_pty(shop: Shop, protocol: str, g05: str, layout: Layout) -> None:
    records = section(layout, 400)
    file = shop.file("in.nc", b"O1\r\nG05\r\n" + records + b"M02\r\n%\r\n")
    expected = b"%\nO1\nG05\n" + records + b"M02\n%"
    line = shop.folder / "line"
    cnc = shop.start(
        *("cnc", "--line", f"pty:{line}", "--protocol", protocol, "--baud", "86400", "--json"),
        *("--set", f"g05={g05}", "--save", shop.folder / "saved.nc"),
    )
    cnc.wait_for("ready")
    host = shop.start(
        "send", file, "--line", line, "--protocol", protocol, "--baud", "86400", "--json", "--set", f"g05={g05}"
    )
    sent, taken = host.finish(), cnc.finish()
    assert sent.outcome == taken.outcome == (0, "complete"), (sent.stderr, taken.stderr)
    assert (shop.folder / "saved.nc").read_bytes() == expected
    assert sent.end["sha256"] == hashlib.sha256(expected).hexdigest()
    assert any("400 records of 7 bytes" in str(notice["text"]) for notice in sent.named("notice"))
    assert taken.named("progress")[-1]["records"] > 300
