"""REMOTE LOAD and DNC LINK, the protocols of Bridgeport controls. Their control codes are a reconstruction."""

from __future__ import annotations

from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.words import Words

__all__ = ["BridgeportHost", "Params", "Words"]
