"""REMOTE LOAD and DNC LINK, the protocols of Bridgeport controls. Their control codes are a reconstruction."""

from __future__ import annotations

from tapewire.protocols.bridgeport.cnc import BridgeportCnc
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.listener import Listener
from tapewire.protocols.bridgeport.messages import CAUTION, STOP_CHARACTERS, Params, data_bits
from tapewire.protocols.bridgeport.text import BridgeportText
from tapewire.protocols.bridgeport.words import Words

__all__ = [
    "CAUTION",
    "STOP_CHARACTERS",
    "BridgeportCnc",
    "BridgeportHost",
    "BridgeportText",
    "Listener",
    "Params",
    "Words",
    "data_bits",
]
