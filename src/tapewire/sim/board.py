"""The remote buffer board as somebody at the cabinet sees it: its LEDs, its memory, and what the control asks of it.

The engine is the communication; the board is the processor that runs it. The control asks by requests. Which codes they
have inside a control is not known: here they have names, and a code that is none is what SR941 is about.
"""

from __future__ import annotations

from enum import Enum
from typing import Protocol, cast

from tapewire.engine import Alarm, CncEngine, Ended, Event, Nanos, Source, Started
from tapewire.errors import UsageError
from tapewire.fanuc.alarms import AlarmNumber, text_of
from tapewire.fanuc.leds import STATUSES, BoardStatus, Led, Red
from tapewire.fanuc.memory import BoardMemory, BufferImage
from tapewire.line.transport import LineItem
from tapewire.sim.pair import Pair

__all__ = ["Board", "BufferedEngine", "Request", "watch"]


class BufferedEngine(CncEngine, Protocol):
    """A control's end whose buffer can be looked into."""

    @property
    def buffer(self) -> BufferImage: ...


class Request(Enum):
    """What a control can ask of the board (12.1.1 no. 4 and 5 speak of requests; their codes are not known)."""

    READ = 1
    PUNCH = 2
    RESET = 3
    ALARM = 4


class Board:
    """Watches one engine: tell it every event by `heard`, and what the remote buffer says by `said`.

    A system error stays until power off and on. `alarms` collects what the board itself raises.
    """

    def __init__(self, engine: BufferedEngine, *, slot: int = 9) -> None:
        self._engine = engine
        self.memory = BoardMemory(lambda: engine.buffer, slot)
        self.red = Red.NONE
        self.alarms: list[Alarm] = []
        self._error: BoardStatus | None = None
        self._started = True
        self._initialised = True
        self._working = False
        self._told_to_stop = False

    # power

    def power_on(self) -> None:
        """The board is in reset until the main processor starts it (12.1.2 (b) A)."""
        self.red = Red.RESET
        self._error = None
        self._started = self._initialised = self._working = self._told_to_stop = False

    def start(self) -> None:
        """The main processor has started the board; it waits for the other modules."""
        self.red = Red.NONE
        self._started = True

    def initialised(self) -> None:
        """All modules are."""
        self._initialised = True

    def fail(self, error: BoardStatus, red: Red = Red.NONE) -> None:
        """A system error of 12.1.2. Raises UsageError for a state that is none."""
        if STATUSES[error].is_normal:
            raise UsageError(f"{error.name} is a normal state of the board, and no system error")
        self._error, self.red = error, red

    # what it does

    def request(self, code: int, now: Nanos, source: Source | None = None) -> None:
        """The control asks for something. SR941 for a code that the board does not know (chapter 11)."""
        if code not in {request.value for request in Request}:
            text = text_of(AlarmNumber.SR941, f"the control gave the command {code:02X}h, which there is none of")
            self.alarms.append(Alarm(number=AlarmNumber.SR941, text=text))
            self._stop()
            self._engine.alarm(now)
            return
        match Request(code):
            case Request.READ:
                self._engine.cycle_start(now)
                self._begin()
            case Request.PUNCH:
                if source is None:
                    raise UsageError("a request to punch needs what is to be punched")
                self._engine.punch(source, now)
                self._begin()
            case Request.RESET:
                self._stop()
                self._engine.reset(now)
            case Request.ALARM:
                self._stop()
                self._engine.alarm(now)

    def asked(self, request: Request) -> None:
        """The control has asked by other ways than `request`, which carries it out too."""
        if request in (Request.READ, Request.PUNCH):
            self._begin()
        else:
            self._stop()

    def heard(self, event: Event) -> None:
        """An event of the engine."""
        if isinstance(event, Started):
            self._begin()
        elif isinstance(event, Ended):
            self._working = self._told_to_stop = False
        elif isinstance(event, Alarm):
            self._stop()

    def said(self, data: bytes) -> None:
        """The remote buffer has sent `data`."""
        self.memory.sent(data)

    def _begin(self) -> None:
        self._working, self._told_to_stop = True, False

    def _stop(self) -> None:
        self._told_to_stop = self._working

    # what is seen

    @property
    def status(self) -> BoardStatus:
        if self._error is not None:
            return self._error
        if not self._started:
            return BoardStatus.POWER_ON
        if not self._initialised:
            return BoardStatus.INITIALISING
        if not self._working:
            return BoardStatus.IDLE
        stopping = self._told_to_stop or self._engine.program_ended
        return BoardStatus.STOPPING if stopping else BoardStatus.HANDLING

    @property
    def green(self) -> tuple[Led, Led]:
        """LED 1 and LED 2."""
        return STATUSES[self.status].green

    @property
    def panel(self) -> str:
        """The five LEDs in a line, as `fanuc diagnose` takes them."""
        return f"green {','.join(self.green)}; red {self.red.value}"


def watch(pair: Pair, *, slot: int = 9) -> Board:
    """A board beside the control of `pair`: it hears what the engine tells and what leaves for the host."""
    engine = pair.cnc
    if not isinstance(getattr(engine, "buffer", None), BufferImage):
        raise UsageError(f"{pair.entry.title} has no remote buffer")
    board = Board(cast(BufferedEngine, engine), slot=slot)
    tell, listen = pair.on_cnc_event, pair.host_link.on_item

    def on_event(event: Event, now: Nanos) -> None:
        if tell is not None:
            tell(event, now)
        board.heard(event)

    def on_item(item: LineItem, now: Nanos) -> None:
        if listen is not None:
            listen(item, now)
        if isinstance(item, bytes):
            board.said(item)

    pair.on_cnc_event, pair.host_link.on_item = on_event, on_item
    return board
