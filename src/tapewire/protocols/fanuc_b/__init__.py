"""Protocol B and expansion protocol B of the FANUC remote buffer (B-63322EN-1 chapters 6 and 7)."""

from __future__ import annotations

from tapewire.protocols.fanuc_b.cnc import FanucBCnc
from tapewire.protocols.fanuc_b.host import FanucBHost
from tapewire.protocols.fanuc_b.listener import Listener
from tapewire.protocols.fanuc_b.messages import Params, Words

__all__ = ["FanucBCnc", "FanucBHost", "Listener", "Params", "Words"]
