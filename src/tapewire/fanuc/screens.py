"""The two screens that tell the logical slot number of the remote buffer board (B-63322EN-1/01 12.3), as text.

After a system alarm it is the page of the hardware information with the F-BUS slots. In a system that runs it is the
module configuration; that figure is lost, and what stands here shows what its legend speaks of.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from tapewire.errors import UsageError

__all__ = ["Module", "alarm_screen", "configuration_screen", "slot_on_screen"]

REMOTE_BUFFER: Final = "REMOTE BUFFER"
WIDTH: Final = 56
LONGEST_SCREEN: Final = 100_000

_ALARM_ROW: Final = re.compile(r"(?m)^\W*([0-9A-F]{2}):([0-9A-F]{2})\b\W*REMOTE BUFFER", re.I)
_CONFIGURATION_ROW: Final = re.compile(r"(?m)^\W*([0-9A-F]{1,2})\s*\(\s*([0-9A-F]{1,2})\s*\)\W*REMOTE BUFFER", re.I)


@dataclass(frozen=True, slots=True, kw_only=True)
class Module:
    """One printed circuit board: physical and logical slot number, name, and module ID."""

    physical: int
    logical: int
    name: str
    module_id: int = 0


def alarm_screen(modules: Iterable[Module], *, at: str, page: str = "6/ 8") -> str:
    """12.3.1. `at` is the moment of the error, as the control writes it."""
    rows = [
        f"  {module.physical:02X}:{module.logical:02X}  {module.name:<14} {module.module_id:04X}  "
        + " ".join(["0000"] * 5)
        for module in modules
    ]
    return "\n".join(
        (
            "FANUC Series 15I F001A",
            "",
            "SYS_ALM 300 SYSTEM ALARM (F-BUS SLOT (1))",
            "OTHER-CPU",
            f"ERROR OCCURRED AT {at}",
            "",
            "HARDWARE INFORMATION 1",
            "  F-BUS SLOT CONFIGURATION",
            "",
            "  SLOT   MODULE NAME    M ID  SLOT IO DATA",
            "  " + "-" * (WIDTH - 2),
            *rows,
            "",
            f"PAGE UP OR DOWN (PAGE {page})".rjust(WIDTH),
        )
    )


def configuration_screen(modules: Iterable[Module]) -> str:
    """12.3.2: logical slot number, the physical one in parentheses."""
    rows = [f"  {module.logical:02X}({module.physical:02X})  {module.name}" for module in modules]
    return "\n".join(("SYSTEM CONFIGURATION (MODULE)", "", "  SLOT    MODULE NAME", *rows))


def slot_on_screen(screen: str) -> int:
    """The logical slot number of the remote buffer on either screen. Raises UsageError where there is none."""
    text = screen[:LONGEST_SCREEN]
    if found := _ALARM_ROW.search(text):
        return int(found[2], 16)
    if found := _CONFIGURATION_ROW.search(text):
        return int(found[1], 16)
    raise UsageError("no row of the screen names the REMOTE BUFFER with its slot, as in 02:09 REMOTE BUFFER")
