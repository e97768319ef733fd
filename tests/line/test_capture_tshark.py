"""A program that nobody here wrote reads our captures: the same bytes, directions, moments and control lines."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
from pathlib import Path
from typing import Any, Final

import pytest

from tapewire.engine import MICROSECOND, SECOND
from tapewire.line.captures.records import ByteOrder, Encoder, Happening, Lines, Origin, Record, Side

TSHARK: Final = shutil.which("tshark")

pytestmark = pytest.mark.skipif(TSHARK is None, reason="tshark is not installed (Debian package tshark)")

FIELDS: Final = {
    "rtacser.cts": Lines.CTS,
    "rtacser.dcd": Lines.CD,
    "rtacser.dsr": Lines.DSR,
    "rtacser.rts": Lines.RTS,
    "rtacser.dtr": Lines.DTR,
    "rtacser.ring": Lines.RING,
    "rtacser.mbok": Lines.MBOK,
}

START: Final = 1_795_345_111 * SECOND


def dissect(path: Path) -> list[dict[str, Any]]:
    """Every packet as tshark sees it."""
    assert TSHARK is not None
    command = [TSHARK, "-r", str(path), "-T", "json", "-x"]
    done = subprocess.run(command, capture_output=True, check=True, text=True)
    assert "cut short" not in done.stderr
    return [packet["_source"]["layers"] for packet in json.loads(done.stdout)]


def seen(layers: dict[str, Any]) -> Record:
    serial, frame = layers["rtacser"], layers["frame"]
    tree = next(value for name, value in serial.items() if name.startswith("Control Lines"))
    lines = Lines(0)
    for name, line in FIELDS.items():
        if tree[name] == "1":
            lines |= line
    seconds, fraction = frame["frame.time_epoch"].split(".")
    raw = bytes.fromhex(layers["frame_raw"][0])
    return Record(
        at=int(seconds) * SECOND + int(fraction.ljust(9, "0")[:9]),
        what=Happening(int(serial["rtacser.eventtype"], 0)),
        lines=lines,
        data=bytes.fromhex(layers["data"]["data.data"].replace(":", "")) if len(raw) > 12 else b"",
    )


def anything(count: int) -> list[Record]:
    """Records of every kind, the same at every run."""
    dice = random.Random(250)
    moments = sorted(START + dice.randrange(10 * SECOND) for _ in range(count))
    return [
        Record(
            at=moment,
            what=dice.choice(list(Happening)),
            lines=Lines(dice.randrange(0x80)),
            data=dice.randbytes(dice.choice((0, 1, 2, 300))),
        )
        for moment in moments
    ]


@pytest.mark.parametrize("order", ByteOrder)
def test_tshark_sees_what_we_wrote(tmp_path: Path, order: ByteOrder) -> None:
    said = anything(500)
    encoder = Encoder(order)
    path = tmp_path / "line.pcapng"
    path.write_bytes(encoder.header(Origin(side=Side.HOST, baud=9600)) + b"".join(map(encoder.record, said)))
    layers = dissect(path)
    assert list(map(seen, layers)) == said
    for packet, record in zip(layers, said, strict=True):
        seconds, fraction = packet["rtacser"]["rtacser.timestamp"].split(".")
        assert int(seconds) * 10**6 + int(fraction) // 1000 == record.at // MICROSECOND
        way = {Happening.SENT: 2, Happening.RECEIVED: 1}.get(record.what, 0)
        assert int(packet["frame"].get("frame.packet_flags", "0"), 0) == way
