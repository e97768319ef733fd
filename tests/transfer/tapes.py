"""The characters a program goes out in, written down apart from the product: a second witness of the code tables."""

from __future__ import annotations

from typing import Final

_EIA: Final = {
    "\n": 0x80,
    "%": 0x0B,
    " ": 0x10,
    "(": 0x1A,
    ")": 0x4A,
    "-": 0x40,
    ".": 0x6B,
    **dict(zip("0123456789", bytes.fromhex("20010213041516070819"), strict=True)),
    **dict(zip("ABCDEFGHI", bytes.fromhex("616273647576676879"), strict=True)),
    **dict(zip("JKLMNOPQR", bytes.fromhex("515243544546575849"), strict=True)),
    **dict(zip("STUVWXYZ", bytes.fromhex("3223342526373829"), strict=True)),
}
"""RS-244: odd parity, EOB is CR, EOR is ER."""


def on_the_line(text: bytes, code: str) -> bytes:
    """`text` as `--set data=CODE` puts it on the line."""
    match code:
        case "eia":
            return bytes(_EIA[character] for character in text.decode())
        case "iso":
            return bytes(byte | 0x80 if byte.bit_count() % 2 else byte for byte in text)
        case _:
            return text
