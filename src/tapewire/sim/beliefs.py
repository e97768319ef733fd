"""Whether the two ends believe the same of what they have agreed on: looked at in the engines themselves, from outside.

Protocol A alone agrees on anything: Nb, No, Ne, the times and n, by SET and SAT (4.5, 4.4.2). The others are set by
hand at both ends.
"""

from __future__ import annotations

from typing import Any

from tapewire.engine import CncEngine, HostEngine

__all__ = ["disagreement"]


def disagreement(host: HostEngine, cnc: CncEngine) -> str:
    """What an initialised control works with that the host thinks impossible; empty where they agree."""
    agreement: Any = getattr(host, "_agreement", None)
    dialogue: Any = getattr(cnc, "_line", None)
    if agreement is None or dialogue is None:
        return ""
    if not dialogue.up:
        # It gave the line up for what the host has yet to hear: only the SYN that follows says so (4.6 1), 4.7).
        return ""
    in_force = dialogue.parameters
    if in_force in agreement._possible:
        return ""
    return f"in force {in_force}, thought possible {agreement._possible}"
