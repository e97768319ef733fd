"""Captures of dialogues in the simulated world: the same to the byte at every run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from typing import Any

from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.line.captures.records import Encoder, Origin, Record, Side
from tapewire.line.captures.tap import CapturedLine
from tapewire.line.transport import LineItem, Transport
from tapewire.sim.world import Pair, World

UNIX = 1_795_000_000 * SECOND
"""When the clock of the world stands at 0."""


def listen(pair: Pair, side: Side = Side.HOST) -> list[Record]:
    """What passes at one end of `pair` from now on."""
    link = pair.host_link if side is Side.HOST else pair.cnc_link
    records: list[Record] = []
    link.transport = CapturedLine(link.transport, records.append, UNIX)
    return records


def origin_of(pair: Pair, side: Side = Side.HOST) -> Origin:
    return Origin(line="/dev/ttyUSB0", baud=pair.entry.baud, framing="8E1", side=side, protocol=pair.entry.name)


def capture(records: list[Record], origin: Origin) -> bytes:
    """A whole file."""
    encoder = Encoder()
    return encoder.header(origin) + b"".join(map(encoder.record, records))


def tape(blocks: int) -> bytes:
    return b"%\nO0001\n" + b"".join(b"N%d G01 X%d.5 Y-2.25\n" % (n, n) for n in range(1, blocks + 1)) + b"M30\n%"


def a_job(
    protocol: str,
    program: bytes,
    side: Side = Side.HOST,
    act: Callable[[World, Pair], None] | None = None,
    **how: object,
) -> tuple[list[Record], Origin]:
    """One program fed to a control; `how` goes to `World.pair`, `act` happens after the cycle start."""
    world = World()
    pair = world.pair(protocol, **how)  # type: ignore[arg-type]
    records = listen(pair, side)
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    if act is not None:
        act(world, pair)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    return records, origin_of(pair, side)


class Spoilt:
    """A line that damages one character on its way in. A Transport around another."""

    def __init__(self, line: Transport, place: int) -> None:
        self._line = line
        self._place = place

    def __getattr__(self, name: str) -> Any:
        return getattr(self._line, name)

    def read(self, now: Nanos) -> list[LineItem]:
        return [self._spoil(item) if isinstance(item, bytes) else item for item in self._line.read(now)]

    def _spoil(self, data: bytes) -> bytes:
        place, self._place = self._place, self._place - len(data)
        if not 0 <= place < len(data):
            return data
        return data[:place] + bytes([data[place] ^ 0x04]) + data[place + 1 :]


def damaged_message() -> bytes:
    """Written by the control: one character of a DAT is damaged on its way, and the control asks again. The manual
    shows one of these, tests/captures/damaged_message.pcapng, which stays as it is.
    """
    world = World()
    pair = world.pair("fanuc-a", grain=250, blocks_per_second=40, host_settings={"longest_dat": "1024"})
    pair.cnc_link.transport = Spoilt(pair.cnc_link.transport, 1500)
    records = listen(pair, Side.CONTROL)
    pair.host.start(BytesIO(tape(200)), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None and pair.cnc_end is not None)
    return capture(merged(records), origin_of(pair, Side.CONTROL))


def merged(records: list[Record], span: Nanos = 50 * MILLISECOND) -> list[Record]:
    """Characters that follow one another from one side as one record, as a slower program would have written them."""
    fewer: list[Record] = []
    for record in records:
        last = fewer[-1] if fewer else None
        alike = last is not None and record.data and (last.what, last.lines) == (record.what, record.lines)
        if last is not None and alike and record.at - last.at < span:
            fewer[-1] = replace(last, data=last.data + record.data)
        else:
            fewer.append(record)
    return fewer
