"""A transfer as a seed draws it: protocol, direction, program, line, parameters of both ends, and who does what when.

A scenario is a value, and says everything: the same one gives the same run to the byte.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.pacing import character_time, default_window
from tapewire.line.paths import PATHS, TransmitterEmpty
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.settings import End
from tapewire.sim.programs import LEAST_BYTES, MOST_BYTES, program, program_with_cr_lf
from tapewire.sim.streams import Draws
from tapewire.sim.switches import Settings, draw_settings

__all__ = ["Act", "Codes", "Direction", "Finish", "OperatorAct", "Scenario", "draw"]

LARGE_BYTES: Final = 20 * 1024
"""From here on a buffer of 8 KB fills, and DC3 happens."""

SMALL_BYTES: Final = 4000
"""Up to here a transfer may go character by character; larger ones would take the time of a hundred others."""

LARGE_SHARE: Final = 0.25

SHORT_LOAD_BYTES: Final = 12_000
"""REMOTE LOAD carries no more (2.1.1)."""

LOOKED_AT: Final[Nanos] = 25 * MILLISECOND
"""A control looks at its receiver so often at the least: hosts take it that they hear of everything within 100 ms."""

BLOCK_BYTES: Final = 30
"""Characters of a block of the programs, about."""


class Direction(StrEnum):
    """Which way the program goes."""

    SEND = "send"
    RECEIVE = "receive"


class Act(Enum):
    """What a person, or the control for a reason of its own, does in the middle."""

    RESET = "RESET"
    ALARM = "alarm"
    FEED_HOLD = "feed hold"
    SINGLE_BLOCK = "single block"
    ABORT = "given up at the host"
    STALL = "the host's computer stalls"
    PAUSE = "the host pauses the punch-out"


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorAct:
    """`act` at `moment`; a feed hold, a stall and a pause last for `span`."""

    moment: Nanos
    act: Act
    span: Nanos = 0


class Finish(Enum):
    """What the operator does when the first job has ended."""

    LEAVE = "leaves it"
    START_UNARMED = "presses RESET and CYCLE START with nothing armed"
    START_AGAIN = "arms it again, presses RESET and CYCLE START"


@dataclass(frozen=True, slots=True, kw_only=True)
class Codes:
    """Control codes as a checker must know them: those of protocol B, or of the table of a Bridgeport control."""

    all: frozenset[int]
    stops: frozenset[int] = frozenset(b"\x13\x93")
    """These stop who sends a program,"""
    goes: frozenset[int] = frozenset(b"\x11\x12\x15\x16\x95\x96")
    """and these let him go on, or end or begin a transfer."""
    opens: frozenset[int] = frozenset()
    """With these a Bridgeport control announces a name or a program: XOFF is for a text of the host (3.1),"""
    requests: frozenset[int] = frozenset()
    """and with these it asks for one;"""
    answers: frozenset[int] = frozenset()
    """ACK and NAK,"""
    ends: frozenset[int] = frozenset()
    """what ends a text,"""
    record_ends: frozenset[int] = frozenset()
    """and what ends a record."""


def _with_parity(codes: set[int]) -> frozenset[int]:
    """Also under the parity bit that software makes, or a damaged one."""
    return frozenset(codes) | frozenset(code | 0x80 for code in codes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One transfer and what disturbs it."""

    protocol: str
    preset: str
    seed: int
    direction: Direction
    size: int
    place: int
    baud: int
    path: str
    has_signals: bool
    parity: bool
    """Both UARTs check parity (8E1); False: 8N2."""
    settings: Settings
    grain: int
    cnc_window: int
    window: int | None
    """Characters the host allows itself in flight; None: what its protocol asks for."""
    late: Nanos
    """The host's computer wakes it up to so much late."""
    source_pauses: float
    """How often the program's source has nothing yet."""
    start: Nanos
    """CYCLE START, after the job was armed."""
    blocks_per_second: float | None
    override: float | None
    """Blocks take what their feed says, at this override; None: blocks_per_second says it."""
    acts: tuple[OperatorAct, ...]
    finish: Finish

    @property
    def program(self) -> bytes:
        if self.protocol == "bridgeport":
            return program_with_cr_lf(self.size, self.place)
        return program(self.size, self.place, self.settings.data)

    @property
    def expected(self) -> bytes:
        """The program as it comes out at the other end."""
        words = self.settings.host
        before, after = int(words.get("convert_from", "0")), int(words.get("convert_to", "0"))
        return self.program.replace(bytes((before,)), bytes((after,)))

    @property
    def codes(self) -> Codes:
        """What the control says of itself."""
        if self.protocol != "bridgeport":
            return Codes(all=frozenset(b"\x11\x12\x13\x14\x15\x16\x93\x95\x96"))
        table = PROTOCOLS[self.protocol].params(self.settings.host, End.HOST)
        stop, goes = {table.xoff}, {table.cancel, table.xon, table.open_write, table.nak}
        ends = {table.text_end, table.write_ready, table.read_request, table.write_close, table.rec_end}
        return Codes(
            all=_with_parity(stop | goes | ends | {table.ack}),
            stops=_with_parity(stop),
            goes=_with_parity(goes),
            opens=_with_parity({table.open_write}),
            requests=_with_parity({table.read_request}),
            answers=_with_parity({table.ack, table.nak}),
            ends=_with_parity({table.text_end}),
            record_ends=frozenset({table.rec_end, table.rec_end_last}),
        )

    @property
    def default_window(self) -> int:
        """What the host allows itself on the line when nobody says otherwise."""
        entry = PROTOCOLS[self.protocol]
        host = entry.host(entry.params(self.settings.host, End.HOST))
        return default_window(self.baud, host.needs_stop_distance)

    @property
    def line_time(self) -> Nanos:
        """What the program needs on the line, alone."""
        return self.size * character_time(self.baud)

    @property
    def run_time(self) -> Nanos:
        """What the program needs on an undisturbed machine, at most."""
        blocks = self.size / BLOCK_BYTES + 10
        if self.override is not None:
            # 130 mm of X and Y at 490 mm a minute are the longest block of the programs; every third is G00, which no
            # override hastens: 0.8 s.
            executing = blocks * (20 / self.override + 0.3) * SECOND
        else:
            executing = blocks / self.blocks_per_second * SECOND if self.blocks_per_second is not None else 0.0
        return self.line_time * 2 + round(executing)

    @property
    def held(self) -> Nanos:
        """What the operator adds to it."""
        return sum(act.span for act in self.acts)


_MOST_GRAIN: Final = {"bridgeport": 28}
"""Between its `stop_at_free` of 32 characters and the end of its buffer, less the three that may come after XOFF (3.2).
The others say stop while hundreds of characters are free.
"""

_BAUDS: Final = {
    "fanuc-a": (2400, 4800, 9600, 19200),
    "fanuc-a-expansion": (19200, 38400, 76800, 86400),
    "fanuc-b": (1200, 4800, 9600, 19200),
    "fanuc-b-expansion": (19200, 38400, 76800, 86400),
    "bridgeport": (300, 2400, 9600, 19200),
}

_PATHS: Final = ("uart-16550", "uart-16550", "uart-deep", "uart-deep", "usb-1ms", "usb-16ms", "serial-server")
"""UARTs more often: only there is a stop distance guaranteed."""


def draw(protocol: str, preset: str, seed: int, *, path: str | None = None, punches_out: bool = True) -> Scenario:
    """The transfer number `seed` of `protocol` under `preset`. `path` is what the preset's faults come from."""
    draws = Draws(seed, protocol, preset, "scenario")
    receives = punches_out and draws.happens(0.3)
    direction = Direction.RECEIVE if receives else Direction.SEND
    settings = draw_settings(protocol, draws, Draws(seed, protocol, preset, "foreign"), receives=receives)
    size = _size(draws)
    if settings.cnc.get("mode") == "L" or settings.cnc.get("program") == "-1":
        size = min(size, SHORT_LOAD_BYTES - draws.between(0, 500))
    baud = _baud(draws, protocol, size)
    path = path or draws.choice(_PATHS)
    speed, override = _speed(draws, baud)
    span = size * character_time(baud) + 2 * SECOND
    return Scenario(
        protocol=protocol,
        preset=preset,
        seed=seed,
        direction=direction,
        size=size,
        place=draws.between(0, MOST_BYTES),
        baud=baud,
        path=path,
        has_signals=path != "serial-server" and draws.happens(0.9),
        parity=draws.happens(0.75),
        settings=settings,
        grain=_grain(draws, protocol, size, baud),
        cnc_window=_cnc_window(draws, protocol, settings, size, direction),
        window=_wide_window(draws, protocol, baud, size, direction, path),
        late=draws.choice((0, 0, 1, 15)) * MILLISECOND,
        source_pauses=draws.choice((0.0, 0.0, 0.0, 0.05)),
        start=round(draws.choice((0.0, draws.uniform(0, 3))) * SECOND),
        blocks_per_second=speed,
        override=override,
        acts=_acts(draws, span, direction),
        finish=draws.choice((Finish.LEAVE, Finish.LEAVE, Finish.START_UNARMED, Finish.START_AGAIN)),
    )


def _baud(draws: Draws, protocol: str, size: int) -> int:
    """Few send a large program at the least rate: 64 KB at 300 baud take forty minutes."""
    rates = _BAUDS[protocol]
    rate = draws.choice(rates)
    if rate == rates[0] and size > SMALL_BYTES and draws.happens(0.9):
        return draws.choice(rates[1:])
    return rate


def _grain(draws: Draws, protocol: str, size: int, baud: int) -> int:
    """What the control's UART tells at once; on a slow line the control looks before so much has come, and always
    before its buffer is full from the level on where it says stop.
    """
    grain = draws.choice((1, 8, 16, 32, 64, 128, 128) if size < SMALL_BYTES else (16, 64, 128, 128))
    return min(grain, _MOST_GRAIN.get(protocol, grain), max(1, LOOKED_AT // character_time(baud)))


def _cnc_window(draws: Draws, protocol: str, settings: Settings, size: int, direction: Direction) -> int:
    """A control that a host pauses by CS stops within two characters (6.1.1 2) (3) (a)); others have a FIFO."""
    if settings.host.get("pause") == "cs":
        return 2
    if protocol == "fanuc-a" or (direction is Direction.RECEIVE and size > SMALL_BYTES):
        return draws.choice((64, 128))
    return draws.choice((1, 2, 2, 16))


def _wide_window(draws: Draws, protocol: str, baud: int, size: int, direction: Direction, path: str) -> int | None:
    """Bridgeport's three characters make a host go two by two: where the transmitter can be asked, in a closed loop.
    Elsewhere most large transfers have more in flight; then too much may come after XOFF, and that is told.
    """
    is_slow = protocol == "bridgeport" and direction is Direction.SEND and size > SMALL_BYTES
    wide = is_slow and draws.happens(0.9) and PATHS[path].transmitter_empty is not TransmitterEmpty.ASKED
    return default_window(baud, MOST_BYTES) if wide else None


def _size(draws: Draws) -> int:
    if draws.happens(LARGE_SHARE):
        return round(draws.log_uniform(LARGE_BYTES, MOST_BYTES))
    return round(draws.log_uniform(LEAST_BYTES, LARGE_BYTES))


def _speed(draws: Draws, baud: int) -> tuple[float | None, float | None]:
    """As fast as the program comes, or a little slower or faster than the line; blocks alike, or as their feed says."""
    if draws.happens(0.4):
        return None, None
    blocks_on_line = SECOND / character_time(baud) / BLOCK_BYTES
    factor = draws.log_uniform(0.3, 2.0)
    if draws.happens(0.2):
        # At 490 mm a minute the blocks of the programs take 8 s on the average.
        return None, blocks_on_line * factor * 8
    return blocks_on_line * factor, None


_SEND_ACTS: Final = (Act.RESET, Act.ALARM, Act.FEED_HOLD, Act.SINGLE_BLOCK, Act.ABORT, Act.STALL)
_RECEIVE_ACTS: Final = (Act.RESET, Act.ALARM, Act.ABORT, Act.STALL, Act.PAUSE, Act.PAUSE)


def _acts(draws: Draws, span: Nanos, direction: Direction) -> tuple[OperatorAct, ...]:
    count = draws.choice((0, 0, 0, 1, 1, 2))
    kinds = _SEND_ACTS if direction is Direction.SEND else _RECEIVE_ACTS
    acts = [_act(draws.choice(kinds), round(draws.random() * span), draws) for _ in range(count)]
    return tuple(sorted(acts, key=lambda act: act.moment))


def _act(act: Act, moment: Nanos, draws: Draws) -> OperatorAct:
    match act:
        case Act.FEED_HOLD | Act.SINGLE_BLOCK | Act.PAUSE:
            span = round(draws.log_uniform(0.01, 60) * SECOND)
        case Act.STALL:
            span = round(draws.log_uniform(0.001, 3) * SECOND)
        case _:
            span = 0
    return OperatorAct(moment=moment, act=act, span=span)
