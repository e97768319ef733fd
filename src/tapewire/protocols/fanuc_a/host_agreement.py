"""What host and control have agreed on by SAT and SET (B-63322EN-1 4.4.2, 4.5), and what follows for the length of a
DAT and for the time the control may be silent.
"""

from __future__ import annotations

import dataclasses
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.protocols.fanuc_a.messages import LONGEST_DAT
from tapewire.protocols.fanuc_a.params import Params, SetData, Switching
from tapewire.protocols.fanuc_a.status import POWER_ON, Parameters, Setting, Status

__all__ = ["Agreement"]

MOST_TRIES: Final = 3
"""A control that has not taken a SET by then will not: it is told no more, and what its SAT says holds."""

_DIGITS: Final = frozenset("0123456789ABCDEF")


class Agreement:
    """The parameters in force, as far as the host can know them."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._wanted = params.wanted
        self._reported = POWER_ON
        self._asked: Parameters | None = None
        self._tries = 0
        self._switching = "0"
        self.settled = False
        """A SET with data has been sent since the control was last initialised, or last said what cannot be."""
        self.refused = False
        """The control keeps other parameters than those it was asked to take."""

    def begin_anew(self) -> None:
        """SYN: whether it resets the parameters is not stated, so all of them are set again."""
        self.settled = False
        self._tries = 0
        self._asked = None
        self.refused = False

    def say_all_again(self) -> None:
        """The next SET says every parameter: what the control has said of them is not believed."""
        self.settled = False

    def hear(self, status: Status) -> None:
        """A SAT says what is in force now."""
        self._asked = None
        self._reported = status.parameters
        # A blank there is a position that this control does not use.
        self._switching = status.switching if status.switching in _DIGITS else "0"
        if self._reported == self._wanted:
            self._tries = 0
        self.refused = self._reported != self._wanted and self._tries >= MOST_TRIES

    @property
    def base(self) -> Parameters:
        """What a SAT does not say."""
        return self._asked or self._reported

    def set_data(self) -> bytes:
        """The data of the SET that answers a SAT; empty when nothing is to be changed."""
        differs = self._reported != self._wanted and self._tries < MOST_TRIES
        if not differs and self.settled and self._params.set_data is SetData.CHANGES:
            return b""
        self.settled = True
        self._tries += differs
        self._asked = self._wanted
        asked = self._params.switching
        switching = self._switching if asked is Switching.ECHO else asked.value
        return Setting(switching=switching, parameters=self._wanted).encode(int(self._params.set_length))

    @property
    def differences(self) -> str:
        """What the control has, where it is not what we want."""
        values = [
            f"{field.name} is {getattr(self._reported, field.name)}, not {getattr(self._wanted, field.name)}"
            for field in dataclasses.fields(Parameters)
            if getattr(self._reported, field.name) != getattr(self._wanted, field.name)
        ]
        return "; ".join(values)

    @property
    def obstacle(self) -> str:
        """Why no program may be sent to the control as it reports itself; empty when one may."""
        kept, wanted = self._reported, self._wanted
        if kept.convert_from != kept.convert_to and (kept.convert_from, kept.convert_to) != (
            wanted.convert_from,
            wanted.convert_to,
        ):
            return (
                f"the control turns {kept.convert_from:02X}h of the program into {kept.convert_to:02X}h "
                f"(SAT 45 to 48); asked for were {wanted.convert_from:02X}h and {wanted.convert_to:02X}h"
            )
        if self.n and not wanted.n:
            return f"the control keeps packets (SAT 55 to 56: n={self.n}); asked for was protocol A (n=0)"
        return ""

    @property
    def _possible(self) -> tuple[Parameters, ...]:
        """A SET that no SAT has confirmed may be in force or not."""
        return (self._reported,) if self._asked is None else (self._reported, self._asked)

    @property
    def n(self) -> int:
        """Packet length in force; 0 is protocol A. The first SET that drew no RTY was taken; of a control whose next
        SAT says otherwise that is not believed again.
        """
        return (self.base if self._tries <= 1 else self._reported).packet_n

    @property
    def no(self) -> int:
        """Characters that may still come after RS OFF (4.3 (5)). A control that takes packets has taken the SET that
        made them, and No with it.
        """
        return self.base.no if self.n else min([parameters.no for parameters in self._possible])

    @property
    def ne(self) -> int:
        return min(parameters.ne for parameters in self._possible)

    @property
    def to(self) -> Nanos:
        return min(parameters.to for parameters in self._possible) * SECOND

    @property
    def turn_time(self) -> Nanos:
        """Tx: how long the control may take before it answers."""
        return max(each.tx for each in (*self._possible, POWER_ON)) * MILLISECOND

    @property
    def longest_silence(self) -> Nanos:
        """Tp + Tx, and Tw where it is longer (4.3 (4), 4.5)."""
        possible = (*self._possible, POWER_ON) if not self.settled else self._possible
        longest_ms = max(max(each.tp_ms, each.tw * 1000) + each.tx for each in possible)
        return longest_ms * MILLISECOND

    def longest_dat(self, rate: int) -> int:
        """Nb - No, at most 4096 and at most what a line of `rate` characters a second carries in half of To."""
        longest = min(self._params.longest_dat, LONGEST_DAT, *(each.longest_dat for each in self._possible))
        return min(longest, max(1, rate * self.to // (2 * SECOND))) if rate else longest
