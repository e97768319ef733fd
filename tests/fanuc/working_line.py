"""Every combination of 5000, 507x and 508x, the settings it gives to both ends, and a transfer between the two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from math import prod

from tapewire.codes import DataCode, encode
from tapewire.engine import SECOND, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.host_settings import ControlSettings, HostSettings, control_settings, host_settings
from tapewire.fanuc.parameters import CATALOGUE, LINE_NUMBERS, Interface, ParameterSet
from tapewire.sim.world import World

PROGRAM = b"%\nO0001\nG91G01X1.F100\nM30\n%"


@dataclass(frozen=True)
class Line:
    """All that a transfer depends on: what the host is told, and what the control is."""

    protocol: str
    baud: int
    host: tuple[tuple[str, str], ...]
    control: tuple[tuple[str, str], ...]


def combinations(interface: Interface, *, beside: int = 0, every: int = 1) -> Iterator[ParameterSet]:
    """Every value of 5000, of 5070 on RS-422, and of the four parameters of the interface; `beside` goes out of range.

    One in `every`, which should be a prime. 0000 has ISP = 0 and 1 in turn.
    """
    numbers = [*([5070] if interface is Interface.RS_422 else []), *LINE_NUMBERS[interface]]
    ranges = [range(CATALOGUE[n].low - beside, CATALOGUE[n].high + beside + 1) for n in numbers]
    own_bit = int(interface is Interface.RS_422)
    for index in range(0, 16 * prod(map(len, ranges)), every):
        rest, upper_bits = divmod(index, 16)
        values = {0: index // every % 2 << 2, 5000: upper_bits << 1 | own_bit}
        for number, allowed in zip(numbers, ranges, strict=True):
            rest, place = divmod(rest, len(allowed))
            values[number] = allowed[place]
        yield ParameterSet(values)


def lines_of(parameters: ParameterSet, interface: Interface) -> list[Line]:
    """The lines a host may make of it: one for each protocol that the control leaves it to choose."""
    first = host_settings(parameters)
    control = control_settings(parameters, interface)
    chosen = [first, *(host_settings(parameters, protocol=name) for name in first.alternatives)]
    return [_line(settings, control) for settings in chosen]


def _line(host: HostSettings, control: ControlSettings) -> Line:
    assert (host.baud, host.stopbits) == (control.baud, control.stopbits)
    assert host.protocol.startswith(control.protocol)
    words: Mapping[str, str] = {**host.settings, "data": str(host.data_to_control)}
    return Line(host.protocol, host.baud, tuple(sorted(words.items())), tuple(sorted(control.settings.items())))


def is_complete(line: Line) -> bool:
    """A short program goes from the host to the control, and is the same there."""
    world = World()
    pair = world.pair(line.protocol, baud=line.baud, host_settings=dict(line.host), cnc_settings=dict(line.control))
    data = encode(PROGRAM, DataCode(dict(line.control)["data"]))
    pair.host.start(BytesIO(encode(PROGRAM, DataCode(dict(line.host)["data"]))), world.now)
    pair.cnc.cycle_start(world.now)
    try:
        world.run_until(lambda: pair.host_end and pair.cnc_end, limit=900 * SECOND)
    except AssertionError:
        return False
    assert pair.host_end is not None
    ends = {pair.host_end.outcome, pair.cnc_end.outcome if pair.cnc_end else None}
    return ends == {Outcome.COMPLETE} and pair.program.getvalue() == data


def complaint_of(parameters: ParameterSet) -> str | None:
    """Why there is no line of it; None where there is."""
    try:
        host_settings(parameters)
    except UsageError as error:
        return str(error)
    return None


def is_legal(parameters: ParameterSet, interface: Interface) -> bool:
    """Chapter 10 by itself, written down a second time: what is in range, and a device that can be a host computer."""
    specification, stop_bits, baud, protocol = (parameters.values[n] for n in LINE_NUMBERS[interface])
    rates = range(2, 16) if interface is Interface.RS_422 else range(1, 13)
    in_range = stop_bits in (1, 2) and protocol in (1, 2, 3) and baud in rates and 0 <= specification <= 8
    clock = parameters.values.get(5070, 0) in range(14)
    return in_range and clock and (specification in (1, 3) or protocol == 3)


__all__ = ["Line", "combinations", "complaint_of", "is_complete", "is_legal", "lines_of"]
