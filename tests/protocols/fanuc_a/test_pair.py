"""Both ends of protocol A and expansion A on a simulated cable: 300 KB, byte for byte, and at what rate."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.codes import DataCode, encode
from tapewire.engine import SECOND, Outcome, Started, Violation
from tapewire.line.pacing import character_time
from tapewire.sim.world import Pair, World

TEXT = b"%\n" + b"".join(b"N%05dX%d.Y%d.\n" % (n, n % 90, n % 70) for n in range(21_000)) + b"M30\n%"
CODES = pytest.mark.parametrize("code", ["ascii", "iso"])
ENDS = pytest.mark.parametrize("end", ["cr", "etx"])


BAUDS = pytest.mark.parametrize("baud", [19_200, 86_400])


def transfer(
    name: str, program: bytes, settings: dict[str, str], *, baud: int | None = None, **host_settings: str
) -> tuple[World, Pair]:
    world = World()
    pair = world.pair(name, baud=baud, settings=settings, host_settings=host_settings, grain=512)
    pair.host.start(BytesIO(program), world.now)
    world.run_for(5 * SECOND)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None)
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE
    assert pair.host_end.bytes_low == pair.host_end.bytes_high == len(program)
    assert pair.program.getvalue() == program
    assert not [event for _, event in pair.host_events + pair.cnc_events if isinstance(event, Violation)]
    return world, pair


@BAUDS
@CODES
@ENDS
def test_protocol_a(code: str, end: str, baud: int) -> None:
    data = DataCode(code)
    transfer("fanuc-a", encode(TEXT, data), {"code": code, "end": end, "data": code}, baud=baud)


@pytest.mark.parametrize("n", ["1", "2", "4"])
@BAUDS
@CODES
@ENDS
def test_expansion_a(n: str, code: str, end: str, baud: int) -> None:
    data = DataCode(code)
    transfer("fanuc-a-expansion", encode(TEXT, data), {"code": code, "end": end, "data": code}, baud=baud, n=n)


@pytest.mark.parametrize("name", ["fanuc-a", "fanuc-a-expansion"])
def test_eia(name: str) -> None:
    transfer(name, encode(TEXT[:20_000].rsplit(b"\n", 1)[0] + b"\n%", DataCode.EIA), {"data": "eia"})


@pytest.mark.parametrize(
    ("name", "baud", "longest", "frame"),
    [("fanuc-a", 19_200, 3488, 12), ("fanuc-a-expansion", 86_400, 1024, 4)],
)
def test_the_line_is_as_full_as_the_protocol_allows(name: str, baud: int, longest: int, frame: int) -> None:
    """DAT, its frame and the GTD for the next one; or a packet and its frame."""
    world = World()
    pair = world.pair(name, baud=baud, grain=512)
    pair.host.start(BytesIO(TEXT), world.now)
    world.run_for(6 * SECOND)
    pair.cnc.cycle_start(world.now)
    line = pair.host_link.transport
    world.run_until(lambda: pair.host.progress == len(TEXT) and not line.in_flight(world.now))
    [started] = [at for at, event in pair.host_events if isinstance(event, Started)]
    rate = len(TEXT) * character_time(baud) / (world.now - started)
    allowed = longest / (longest + frame)
    print(f"{name} at {baud}: {rate:.3%} of the line, the protocol allows {allowed:.3%}")
    assert rate >= 0.99 * allowed
