"""Serial ports over Telnet (RFC 2217): what both ends say, and what each makes of it. Pure; time comes in from outside.

    client                                   server
    WILL COM-PORT, DO/WILL BINARY     ->
                                      <-     DO COM-PORT, WILL/DO BINARY
    SET-BAUDRATE 9600, SET-PARITY ... ->
                                      <-     101 9600, 103 even ...
    masks                             ->
                                      <-     NOTIFY-MODEMSTATE CTS DSR CD
    data, doubled FFh                <->     data, doubled FFh

A server answers each setting with what it has now. That answer is the read-back: one that differs is an error here,
with both values in it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final, TypeAlias

from tapewire.engine import LineFault, SignalsIn, SignalsOut
from tapewire.line.rates import is_near
from tapewire.line.rfc2217.telnet import (
    Asked,
    Command,
    Option,
    Other,
    Sub,
    TelnetDecoder,
    Verb,
    ask,
    escape,
    sub,
)
from tapewire.line.transport import Fault

__all__ = ["Client", "Heard", "PortSettings", "Purged", "Server"]

ANSWER: Final = 100
"""A server's number for what a client calls by its own: SET-BAUDRATE is 1, the answer 101."""

OUTGOING_BOUND: Final = 8192
"""Bytes of negotiation that wait to go out. Whoever asks more without reading the answers wants no serial port."""

ANSWERED_OPTIONS: Final = frozenset({Option.BINARY, Option.SUPPRESS_GO_AHEAD, Option.COM_PORT})


class Word(IntEnum):
    """The client's words (RFC 2217, section 3)."""

    SIGNATURE = 0
    SET_BAUDRATE = 1
    SET_DATASIZE = 2
    SET_PARITY = 3
    SET_STOPSIZE = 4
    SET_CONTROL = 5
    NOTIFY_LINESTATE = 6
    NOTIFY_MODEMSTATE = 7
    FLOWCONTROL_SUSPEND = 8
    FLOWCONTROL_RESUME = 9
    SET_LINESTATE_MASK = 10
    SET_MODEMSTATE_MASK = 11
    PURGE_DATA = 12


class Control(IntEnum):
    """Values of SET-CONTROL."""

    ASK_FLOW = 0
    NO_FLOW = 1
    ASK_BREAK = 4
    BREAK_ON = 5
    BREAK_OFF = 6
    ASK_DTR = 7
    DTR_ON = 8
    DTR_OFF = 9
    ASK_RTS = 10
    RTS_ON = 11
    RTS_OFF = 12


class LineState(IntFlag):
    """NOTIFY-LINESTATE."""

    OVERRUN = 0x02
    PARITY = 0x04
    FRAMING = 0x08
    BREAK = 0x10


class ModemState(IntFlag):
    """NOTIFY-MODEMSTATE; the low half says which have changed."""

    CTS = 0x10
    DSR = 0x20
    RI = 0x40
    CD = 0x80


class PurgeOf(IntEnum):
    """Values of PURGE-DATA: what the server has received from its line, what it has to send there, or both."""

    RECEIVED = 1
    TO_SEND = 2
    BOTH = 3


_FAULTS: Final = {
    LineState.BREAK: LineFault.BREAK,
    LineState.FRAMING: LineFault.FRAMING,
    LineState.PARITY: LineFault.PARITY,
    LineState.OVERRUN: LineFault.UART_OVERRUN,
}
WANTED_LINESTATE: Final = sum(_FAULTS)
WANTED_MODEMSTATE: Final = ModemState.CTS | ModemState.DSR | ModemState.RI | ModemState.CD

_PARITY_NAMES: Final = {1: "no parity", 2: "odd parity", 3: "even parity", 4: "mark parity", 5: "space parity"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PortSettings:
    """What a serial port is to run with, in the numbers of RFC 2217: parity 1 none, 2 odd, 3 even."""

    baud: int
    data_bits: int
    parity: int
    stopbits: int

    def value(self, word: Word) -> int:
        return {
            Word.SET_BAUDRATE: self.baud,
            Word.SET_DATASIZE: self.data_bits,
            Word.SET_PARITY: self.parity,
            Word.SET_STOPSIZE: self.stopbits,
        }[word]


@dataclass(frozen=True, slots=True, kw_only=True)
class Purged:
    """The client has thrown away what it sent and the server has not passed on."""


Heard: TypeAlias = bytes | Fault | SignalsIn | Purged


class _End:
    """What both ends have in common: the options, and what waits to go out."""

    def __init__(self, settings: PortSettings) -> None:
        self.settings = settings
        self.is_suspended = False
        """The other side asks for silence (FLOWCONTROL-SUSPEND)."""
        self.trouble: str | None = None
        """Why this connection cannot be a serial line, in words; None while it can."""
        self.speaks = False
        """The other side speaks of serial ports."""
        self._decoder = TelnetDecoder()
        self._outgoing: deque[bytes] = deque()
        self._outgoing_bytes = 0
        self._ours: dict[int, bool] = {}
        self._theirs: dict[int, bool] = {}

    def take_outgoing(self) -> bytes:
        """Negotiation that is to be sent next."""
        data = b"".join(self._outgoing)
        self._outgoing.clear()
        self._outgoing_bytes = 0
        return data

    def encode(self, data: bytes) -> bytes:
        return escape(data)

    def hear(self, data: bytes) -> list[Heard]:
        """What came in, in its order. Answers wait in `take_outgoing`."""
        heard: list[Heard] = []
        for item in self._decoder.feed(data):
            match item:
                case bytes():
                    heard.append(item)
                case Asked():
                    self._asked(item)
                case Sub(option=Option.COM_PORT, payload=payload) if payload:
                    heard += self._com_port(payload[0], payload[1:])
                case Other(command=Command.BREAK):
                    heard.append(Fault(fault=LineFault.BREAK))
                case Other(command=Command.ARE_YOU_THERE):
                    self._say(bytes((0xFF, Command.NOP)))
                case _:
                    pass
        return heard

    def _com_port(self, word: int, payload: bytes) -> list[Heard]:
        """A word of RFC 2217 from the other side; empty where it says nothing to the line."""
        return []

    def _say(self, data: bytes) -> None:
        self._outgoing_bytes += len(data)
        if self._outgoing_bytes > OUTGOING_BOUND:
            self.trouble = "it asks without end and does not read the answers"
            return
        self._outgoing.append(data)

    def _say_com_port(self, word: int, payload: bytes) -> None:
        self._say(sub(Option.COM_PORT, bytes((word,)) + payload))

    def _offer(self, option: Option) -> None:
        self._ours[option] = True
        self._say(ask(Verb.WILL, option))

    def _wish(self, option: Option) -> None:
        self._theirs[option] = True
        self._say(ask(Verb.DO, option))

    def _asked(self, asked: Asked) -> None:
        """Answer what is new, and only that: two ends that thank each other never end (RFC 854)."""
        known = asked.option in ANSWERED_OPTIONS
        match asked.verb:
            case Verb.DO | Verb.DONT:
                wanted, table, yes, no = asked.verb is Verb.DO, self._ours, Verb.WILL, Verb.WONT
            case _:
                wanted, table, yes, no = asked.verb is Verb.WILL, self._theirs, Verb.DO, Verb.DONT
        if wanted and not known:
            self._say(ask(no, asked.option))
            return
        if known and table.get(asked.option, False) is not wanted:
            table[asked.option] = wanted
            self._say(ask(yes if wanted else no, asked.option))
        if known:
            self._agreed(Option(asked.option), asked.verb)

    def _agreed(self, option: Option, verb: Verb) -> None:
        if option is Option.BINARY and verb in (Verb.DONT, Verb.WONT):
            self.trouble = "it refuses binary transmission, without which characters are lost"


class Client(_End):
    """The end that has no port: it asks for one set up as `settings`, and says by `is_ready` when it is."""

    def __init__(self, settings: PortSettings) -> None:
        super().__init__(settings)
        self._unanswered: set[Word] = set()
        self._set_up = False

    @property
    def is_ready(self) -> bool:
        """Every setting has been read back."""
        return self._set_up and not self._unanswered and self.trouble is None

    @property
    def missing(self) -> str:
        """What the server has not answered yet, for an error."""
        if not self.speaks:
            return "it does not speak RFC 2217 (is it in raw mode? then it is socket://)"
        return "no answer to " + ", ".join(word.name.replace("_", "-") for word in sorted(self._unanswered))

    def start(self) -> None:
        self._offer(Option.COM_PORT)
        for option in (Option.BINARY, Option.SUPPRESS_GO_AHEAD):
            self._offer(option)
            self._wish(option)

    def drive(self, before: SignalsOut | None, after: SignalsOut) -> None:
        """Say what has changed of the control lines that this end drives."""
        if before is None or before.dtr is not after.dtr:
            self._control(Control.DTR_ON if after.dtr else Control.DTR_OFF)
        if before is None or before.rts is not after.rts:
            self._control(Control.RTS_ON if after.rts else Control.RTS_OFF)

    def purge(self) -> None:
        """Throw away what the server has received from here and not sent on."""
        self._say_com_port(Word.PURGE_DATA, bytes((PurgeOf.TO_SEND,)))

    def begin_break(self) -> None:
        """Have the server hold its line until `end_break`."""
        self._control(Control.BREAK_ON)

    def end_break(self) -> None:
        self._control(Control.BREAK_OFF)

    def probe(self) -> None:
        """Ask for something that must be answered: the rate."""
        self._say_com_port(Word.SET_BAUDRATE, bytes(4))

    def _control(self, value: Control) -> None:
        self._say_com_port(Word.SET_CONTROL, bytes((value,)))

    def _agreed(self, option: Option, verb: Verb) -> None:
        super()._agreed(option, verb)
        if option is not Option.COM_PORT:
            return
        if verb is Verb.DONT:
            self.trouble = "it refuses to speak of serial ports"
        elif verb is Verb.DO and not self.speaks:
            self.speaks = True
            self._ask_for_settings()

    def _ask_for_settings(self) -> None:
        for word in (Word.SET_BAUDRATE, Word.SET_DATASIZE, Word.SET_PARITY, Word.SET_STOPSIZE):
            size = 4 if word is Word.SET_BAUDRATE else 1
            self._unanswered.add(word)
            self._say_com_port(word, self.settings.value(word).to_bytes(size, "big"))
        self._control(Control.NO_FLOW)
        self._say_com_port(Word.SET_LINESTATE_MASK, bytes((WANTED_LINESTATE,)))
        self._say_com_port(Word.SET_MODEMSTATE_MASK, bytes((WANTED_MODEMSTATE,)))
        self._set_up = True

    def _com_port(self, word: int, payload: bytes) -> list[Heard]:
        match word - ANSWER:
            case Word.SET_BAUDRATE | Word.SET_DATASIZE | Word.SET_PARITY | Word.SET_STOPSIZE as setting if payload:
                self._read_back(Word(setting), int.from_bytes(payload[:4], "big"))
            case Word.NOTIFY_MODEMSTATE if payload:
                return [_signals(payload[0])]
            case Word.NOTIFY_LINESTATE if payload:
                return [Fault(fault=fault) for bit, fault in _FAULTS.items() if payload[0] & bit]
            case Word.FLOWCONTROL_SUSPEND:
                self.is_suspended = True
            case Word.FLOWCONTROL_RESUME:
                self.is_suspended = False
            case _:
                pass
        return []

    def _read_back(self, word: Word, has: int) -> None:
        self._unanswered.discard(word)
        wanted = self.settings.value(word)
        if word is Word.SET_BAUDRATE:
            if not is_near(has, wanted):
                self.trouble = f"asked for {wanted} baud it says {has}: set the control to a rate both have"
        elif has != wanted:
            self.trouble = f"asked for {_setting(word, wanted)} it says {_setting(word, has)}"


def _signals(state: int) -> SignalsIn:
    return SignalsIn(
        cts=bool(state & ModemState.CTS),
        dsr=bool(state & ModemState.DSR),
        cd=bool(state & ModemState.CD),
        ri=bool(state & ModemState.RI),
    )


def _setting(word: Word, value: int) -> str:
    match word:
        case Word.SET_PARITY:
            return _PARITY_NAMES.get(value, f"parity {value}")
        case Word.SET_STOPSIZE:
            return f"{value} stop bits"
        case _:
            return f"{value} data bits"


class Server(_End):
    """The end that stands for a port which runs with `settings` and with nothing else.

    What the client asks for is answered with what the port has, which is how RFC 2217 refuses. The client's RTS and
    DTR come out as the control lines they reach through the cross connection of B-63322EN-1 3.2.
    """

    def __init__(self, settings: PortSettings) -> None:
        super().__init__(settings)
        self._modem_mask = int(WANTED_MODEMSTATE)
        self._modem: int | None = None
        self._client = SignalsOut()
        self._client_told = False
        self._in_break = False

    @property
    def is_ready(self) -> bool:
        """The client speaks of serial ports."""
        return self.speaks and self.trouble is None

    def start(self) -> None:
        self._wish(Option.COM_PORT)
        for option in (Option.BINARY, Option.SUPPRESS_GO_AHEAD):
            self._offer(option)
            self._wish(option)

    def drive(self, after: SignalsOut) -> None:
        """This end's RTS is the client's CTS, its DTR the client's DSR and CD."""
        state = ModemState.CTS * after.rts | (ModemState.DSR | ModemState.CD) * after.dtr
        if state != self._modem:
            self._modem = int(state)
            self._notify_modem()

    def say_fault(self, fault: LineFault) -> None:
        """Tell the client of a damaged character."""
        bits = [bit for bit, named in _FAULTS.items() if named is fault]
        self._say_com_port(ANSWER + Word.NOTIFY_LINESTATE, bytes((bits[0],)))

    def _notify_modem(self) -> None:
        if self.speaks and self._modem is not None:
            self._say_com_port(ANSWER + Word.NOTIFY_MODEMSTATE, bytes((self._modem & self._modem_mask,)))

    def _agreed(self, option: Option, verb: Verb) -> None:
        super()._agreed(option, verb)
        if option is Option.COM_PORT and verb is Verb.WILL:
            self._notice_that_it_speaks()
        elif option is Option.COM_PORT and verb is Verb.WONT:
            self.trouble = "it refuses to speak of serial ports"

    def _notice_that_it_speaks(self) -> None:
        if not self.speaks:
            self.speaks = True
            self._notify_modem()

    def _com_port(self, word: int, payload: bytes) -> list[Heard]:
        # A client whose offer crosses our wish may take it for granted and never make it (pyserial does).
        self._notice_that_it_speaks()
        value = payload[0] if payload else 0
        match word:
            case Word.SET_BAUDRATE | Word.SET_DATASIZE | Word.SET_PARITY | Word.SET_STOPSIZE:
                size = 4 if word == Word.SET_BAUDRATE else 1
                self._say_com_port(ANSWER + word, self.settings.value(Word(word)).to_bytes(size, "big"))
            case Word.SET_CONTROL:
                return self._set_control(value)
            case Word.SET_MODEMSTATE_MASK:
                self._modem_mask = value
                self._say_com_port(ANSWER + word, bytes((value,)))
                self._notify_modem()
            case Word.SET_LINESTATE_MASK:
                self._say_com_port(ANSWER + word, bytes((value,)))
            case Word.PURGE_DATA:
                self._say_com_port(ANSWER + word, bytes((value,)))
                return [Purged()] if value in (PurgeOf.TO_SEND, PurgeOf.BOTH) else []
            case Word.SIGNATURE if not payload:
                self._say_com_port(ANSWER + word, b"Tapewire")
            case Word.FLOWCONTROL_SUSPEND:
                self.is_suspended = True
            case Word.FLOWCONTROL_RESUME:
                self.is_suspended = False
            case _:
                pass
        return []

    def _set_control(self, value: int) -> list[Heard]:
        heard: list[Heard] = []
        match value:
            case Control.DTR_ON | Control.DTR_OFF:
                heard = self._client_drives(SignalsOut(rts=self._client.rts, dtr=value == Control.DTR_ON))
            case Control.RTS_ON | Control.RTS_OFF:
                heard = self._client_drives(SignalsOut(rts=value == Control.RTS_ON, dtr=self._client.dtr))
            case Control.BREAK_ON:
                heard = [] if self._in_break else [Fault(fault=LineFault.BREAK)]
                self._in_break = True
            case Control.BREAK_OFF:
                self._in_break = False
            case _:
                pass
        self._say_com_port(ANSWER + Word.SET_CONTROL, bytes((self._control_now(value),)))
        return heard

    def _client_drives(self, after: SignalsOut) -> list[Heard]:
        if self._client_told and after == self._client:
            return []
        self._client, self._client_told = after, True
        return [SignalsIn(cts=after.rts, dsr=after.dtr, cd=after.dtr)]

    def _control_now(self, value: int) -> int:
        """What is in force of the thing that `value` is about. There is no flow control of our own."""
        match value:
            case Control.ASK_DTR:
                return Control.DTR_ON if self._client.dtr else Control.DTR_OFF
            case Control.ASK_RTS:
                return Control.RTS_ON if self._client.rts else Control.RTS_OFF
            case Control.ASK_BREAK:
                return Control.BREAK_ON if self._in_break else Control.BREAK_OFF
            case _ if value >= Control.ASK_BREAK and value <= Control.RTS_OFF:
                return value
            case _:
                return Control.NO_FLOW
