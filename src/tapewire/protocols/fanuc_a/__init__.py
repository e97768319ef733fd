"""Protocol A and expansion protocol A of the FANUC remote buffer (B-63322EN-1 chapters 4 and 5)."""

from __future__ import annotations

from tapewire.protocols.fanuc_a.cnc import FanucACnc
from tapewire.protocols.fanuc_a.host import FanucAHost
from tapewire.protocols.fanuc_a.listener import Listener
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.program import refuse_program
from tapewire.protocols.fanuc_a.words import Words

__all__ = ["FanucACnc", "FanucAHost", "Listener", "Params", "Words", "refuse_program"]
