"""A serial port at the other end of a TCP connection that tells of itself (RFC 2217): either end of it as a line.

Unlike raw TCP it has control lines, a rate that is read back, and damaged characters. How much a serial server still
holds cannot be asked all the same: the window is kept by time, and a job that is given up purges the server.
"""

from __future__ import annotations

import socket
from typing import Final

from tapewire.engine import SECOND, Closure, LineFault, Nanos, SignalsIn, SignalsOut
from tapewire.line.descriptor import LineSettings, Parity, Signals
from tapewire.line.rfc2217.ends import Client, PortSettings, Purged, Server
from tapewire.line.tcp import TcpLine
from tapewire.line.transport import Closed, LineItem, StopDistance

__all__ = ["ClientLine", "Rfc2217Line", "ServerLine"]

QUIET: Final[Nanos] = 5 * SECOND
"""A server that has said nothing for so long is asked whether it is there."""

GONE: Final[Nanos] = 15 * SECOND
"""One that does not answer for so long is gone, whatever the network says: a half-open connection is noticed."""

LOOK: Final[Nanos] = SECOND
"""How often that is looked at."""

_PARITY_NUMBERS: Final = {Parity.NONE: 1, Parity.ODD: 2, Parity.EVEN: 3}


def _port_settings(settings: LineSettings) -> PortSettings:
    return PortSettings(
        baud=settings.baud,
        data_bits=settings.data_bits,
        parity=_PARITY_NUMBERS[settings.parity_bit],
        stopbits=settings.stopbits,
    )


class Rfc2217Line(TcpLine):
    """What both ends have in common."""

    def __init__(self, connection: socket.socket, settings: LineSettings, end: Client | Server) -> None:
        super().__init__(connection, settings)
        self._end_of_it = end
        self._has_left = False
        end.start()

    @property
    def is_ready(self) -> bool:
        """The two ends have agreed."""
        return self._end_of_it.is_ready

    @property
    def refusal(self) -> str | None:
        """Why they will not, in words."""
        if self._ended:
            return self._failure.reason if self._failure is not None else "it closed the connection"
        return self._end_of_it.trouble

    def negotiate(self, now: Nanos) -> None:
        """Hear and answer until the ends agree. Characters that come meanwhile wait for `read`."""
        self._now = now
        if self._fd is not None:
            self._collect(self._fd)
            self._pass_on()

    def read(self, now: Nanos) -> list[LineItem]:
        items = super().read(now)
        self._pass_on()
        return items

    @property
    def knows_signals(self) -> bool:
        """The other side has told its control lines."""
        return self._signals is not None

    def room(self, now: Nanos) -> int:
        return 0 if self._end_of_it.is_suspended else super().room(now)

    def discard(self, now: Nanos) -> int:
        """Nothing can be counted back: characters go out between words of the protocol."""
        self._now = now
        return 0

    @property
    def can_break(self) -> bool:
        return True

    def _encode(self, data: bytes) -> bytes:
        return self._end_of_it.encode(data)

    def _pass_on(self) -> None:
        """Send what the protocol has to say, behind the characters before it."""
        if self._fd is None or self._ended:
            return
        self._unsent += self._end_of_it.take_outgoing()
        self._flush()
        if self._end_of_it.trouble is not None and self._failure is None:
            self._failure = Closed(closure=Closure.LOST, reason=f"the other side was lost: {self._end_of_it.trouble}")

    def _decode(self, data: bytes) -> list[LineItem]:
        items: list[LineItem] = []
        for heard in self._end_of_it.hear(data):
            match heard:
                case Purged():
                    self._arrivals.drop_characters()
                    items = [item for item in items if isinstance(item, SignalsIn)]
                case SignalsIn():
                    if heard != self._signals and self._settings.signals is Signals.USED:
                        self._signals = heard
                        items.append(heard)
                case _:
                    items.append(heard)
        return items


class ClientLine(Rfc2217Line):
    """The port is at the other end."""

    _end_of_it: Client

    def __init__(self, connection: socket.socket, settings: LineSettings) -> None:
        super().__init__(connection, settings, Client(_port_settings(settings)))
        self._driven: SignalsOut | None = None
        self._heard: Nanos | None = None
        self._probed: Nanos | None = None

    @property
    def missing(self) -> str:
        return self._end_of_it.missing

    @property
    def stop_distance(self) -> StopDistance:
        window = self._settings.window + self._patience
        return StopDistance(
            characters=window,
            guaranteed=False,
            how=f"a serial server by RFC 2217 at {self._settings.baud} baud: a window of {self._settings.window}, paced"
            f" by time, and {self._patience} that a stalling network may hold unseen; what the server and its UART"
            " hold cannot be asked",
        )

    def read(self, now: Nanos) -> list[LineItem]:
        self._watch_over_server(now)
        return super().read(now)

    def discard(self, now: Nanos) -> int:
        self._end_of_it.purge()
        self._pass_on()
        return super().discard(now)

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        self._end_of_it.drive(self._driven, signals)
        self._driven = signals
        self._pass_on()

    def _begin_break(self, fd: int) -> None:
        self._end_of_it.begin_break()
        self._pass_on()

    def _end_break(self, fd: int) -> None:
        self._end_of_it.end_break()
        self._pass_on()

    def _watch_over_server(self, now: Nanos) -> None:
        heard = self._heard = self._heard if self._heard is not None else now
        if self._failure is None and now - heard >= GONE and self._probed is not None:
            silence_s = (now - heard) // SECOND
            self._failure = Closed(closure=Closure.LOST, reason=f"the serial server has not answered for {silence_s} s")
        elif now - heard >= QUIET and (self._probed is None or now - self._probed >= QUIET):
            self._probed = now
            self._end_of_it.probe()

    def _decode(self, data: bytes) -> list[LineItem]:
        self._heard, self._probed = self._now, None
        return super()._decode(data)

    def _poll_interval(self) -> Nanos | None:
        return LOOK


class ServerLine(Rfc2217Line):
    """The port is at this end: a simulated control, or whatever else `tapewire` works here."""

    _end_of_it: Server

    def __init__(self, connection: socket.socket, settings: LineSettings) -> None:
        super().__init__(connection, settings, Server(_port_settings(settings)))

    @property
    def missing(self) -> str:
        return "it does not speak RFC 2217 (is it a raw client? then this end is listen://)"

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        self._end_of_it.drive(signals)
        self._pass_on()

    def _begin_break(self, fd: int) -> None:
        """The client is told of one; how long it was is not part of RFC 2217."""
        self._end_of_it.say_fault(LineFault.BREAK)
        self._pass_on()
