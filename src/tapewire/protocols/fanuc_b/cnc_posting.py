"""What the control sees of the host, and what it may tell it about a reset or an alarm (B-63322EN-1 6.1.2, 6.4)."""

from __future__ import annotations

from typing import TypeAlias

from tapewire.engine import SignalsIn
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, ControlCode, Params
from tapewire.protocols.settings import Switch

__all__ = ["Codes", "Posting"]

Codes: TypeAlias = tuple[ControlCode, ...]


class Posting:
    """The control lines that come in, and the codes that SYN (a reset) or NAK (an alarm) go out with."""

    def __init__(self, params: Params) -> None:
        self._params = params
        self._signals = SignalsIn()
        self.line_closed = False

    @property
    def on(self) -> bool:
        return self._params.posting is Switch.ON

    @property
    def cs(self) -> bool:
        return self._signals.cts

    @property
    def dr(self) -> bool:
        return self._signals.dsr

    @property
    def may_send(self) -> bool:
        """3.2: the host is ready to receive while DR and CS are ON."""
        return self._signals.dsr and self._signals.cts and not self.line_closed

    def update(self, signals: SignalsIn) -> str | None:
        """Why SR855 is due with these control lines; None if it is not.

        SR855 is for a CD that turns off (5000#4 = 0). 3.2 straps it to the control's own ER: one that was never ON
        has no wire and says nothing.
        """
        before, self._signals = self._signals, signals
        if not signals.dsr:
            return "DR is OFF"
        return "CD has turned OFF" if self._has_cd and before.cd and not signals.cd else None

    def in_read(self, code: ControlCode) -> Codes:
        """A read is cut short. 6.1.2 sets its condition for SYN and NAK: a DC3 that CS holds back leaves later."""
        return (ControlCode.DC3, *self.added(code))

    def in_punch(self, code: ControlCode) -> Codes:
        """A punch-out is cut short.

        While CS is OFF neither DC4 nor SYN or NAK are sent (6.1.2 NOTE). None of them follows later, and no DC4 goes
        without its SYN or NAK: the cut program would look whole. Without posting 6.4 (1) has DC3 for the punch-out
        too, and no other clause says what ends it.
        """
        if not self._host_ready:
            return ()
        return (ControlCode.DC4, code) if self.on else (ControlCode.DC3,)

    def at_rest(self, code: ControlCode) -> Codes:
        """Neither receiving nor transmitting (6.1.2 1)). Its valid period is a lost figure, so it is a setting."""
        return self.added(code) if self._params.idle_posting is Switch.ON else ()

    def added(self, code: ControlCode) -> Codes:
        return (code,) if self.on and self._host_ready else ()

    @property
    def _has_cd(self) -> bool:
        """Expansion B is RS-422, which has no CD (3.3); with 5000#4 = 1 nobody looks at it."""
        return self._params.cd is Switch.ON and self._params.limits != EXPANSION_B

    @property
    def _host_ready(self) -> bool:
        """6.1.2: DR, CD and CS are ON."""
        return self.may_send and (self._signals.cd or not self._has_cd)
