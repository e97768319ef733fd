"""Which jumpers a cable looks like, and in what a control seems to talk."""

from __future__ import annotations

import pytest

from tapewire.engine import SignalsIn, SignalsOut
from tapewire.line.cable import DRIVEN, wiring_of
from tapewire.line.guess import Heard, best_of, code_of

Plug = dict[str, str]


def plugged(cts: str, dsr: str, cd: str) -> list[str]:
    """The words for a cable whose lines are `rts`, `dtr`, `on` or `off`."""

    def level(of: str, driven: SignalsOut) -> bool:
        return {"rts": driven.rts, "dtr": driven.dtr, "on": True, "off": False}[of]

    seen = {d: SignalsIn(cts=level(cts, d), dsr=level(dsr, d), cd=level(cd, d)) for d in DRIVEN}
    return list(wiring_of(seen).words)


def test_a_control_that_is_on() -> None:
    assert all("the other end drives it" in word for word in plugged("on", "on", "on"))


def test_the_plug_of_4_5_and_6_8_20() -> None:
    cts, dsr, cd = plugged("rts", "dtr", "dtr")
    assert "pins 4 and 5" in cts
    assert "20 and 6" in dsr
    assert "20 and 8" in cd


@pytest.mark.parametrize("lines", [("off", "off", "off")])
def test_three_wires(lines: tuple[str, str, str]) -> None:
    assert all("not connected" in word for word in plugged(*lines))


def test_an_unusual_plug() -> None:
    assert "unusual" in plugged("dtr", "rts", "on")[1]
    assert "pins" not in plugged("dtr", "rts", "on")[1]


def test_a_cts_that_follows_us_cannot_stop_us() -> None:
    seen = {d: SignalsIn(cts=d.rts) for d in DRIVEN}
    assert not wiring_of(seen).cts_is_the_controls
    assert wiring_of({d: SignalsIn() for d in DRIVEN}).cts_is_the_controls


ISO = bytes(byte | (0x80 if byte.bit_count() % 2 else 0) for byte in b"N10 G01 X1.5 Y2.5\r\nM30\r\n")
EIA = bytes((0x80, 0x01, 0x02, 0x13, 0x04, 0x15, 0x16, 0x07, 0x08, 0x19))


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (ISO, "ISO 840"),
        (b"N10 G01 X1.5\r\n", "eighth bit is never set"),
        (EIA, "EIA RS-244"),
        (bytes(range(0, 256, 3)), "no tape code"),
        (b"N1", "only 2 characters"),
    ],
)
def test_codes(data: bytes, word: str) -> None:
    assert word in code_of(data)


def test_the_likeliest_way_of_listening_comes_first() -> None:
    heard = {
        "9600 8N2": Heard(data=ISO, damaged=0),
        "4800 8N2": Heard(data=bytes(range(0xE0, 0xF8)), damaged=20),
        "19200 8N2": Heard(data=ISO[:12], damaged=12),
        "300 8N2": Heard(data=b"N", damaged=0),
    }
    assert list(best_of(heard))[:1] == ["9600 8N2"]
    assert "300 8N2" not in best_of(heard)
