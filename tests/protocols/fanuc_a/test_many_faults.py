"""Protocol A and expansion A on a line with several faults in one transfer, lost characters and end codes of noise.

The program arrives byte-identical, or the job ends with its reason, or it stays armed and nothing of it was sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND, Outcome
from tapewire.protocols.fanuc_a import FanucAHost
from tapewire.protocols.fanuc_a.host_law import State
from tapewire.sim.world import Pair, World
from tests.protocols.fanuc_a.test_faults import KIND, PATIENCE, gave_up
from tests.protocols.wire import FaultyEnd, Spoil, lost

PROGRAM = b"%\nO9\n" + b"".join(b"N%d G01 X%d.5 Y-%d.\n" % (n, n, n) for n in range(200)) + b"M30\n%"
"""4 KB: three DATs, or sixteen packets of n = 1."""


def end_code_behind(byte: int) -> bytes:
    """As noise makes one."""
    return bytes([byte, 0x0D])


Faults = Sequence[tuple[int, Spoil]]


def faults(characters: int, *how: Spoil) -> st.SearchStrategy[Faults]:
    """Two at most: the sum sees any two ASCII characters that are missing, but not any three."""
    return st.lists(st.tuples(st.integers(0, characters), st.sampled_from(how)), max_size=2, unique_by=lambda at: at[0])


def spoil(pair: Pair, to_control: Faults, to_host: Faults) -> None:
    for link, places in ((pair.cnc_link, to_control), (pair.host_link, to_host)):
        for at, how in places:
            link.transport = FaultyEnd(link.transport, at, how)


@pytest.mark.parametrize(
    ("name", "cnc_settings"),
    [
        ("fanuc-a", {}),
        ("fanuc-a", {"open_line": "speaks", "Ne": "2"}),
        ("fanuc-a-expansion", {}),
        ("fanuc-a-expansion", KIND),
    ],
)
@settings(max_examples=12)
@given(to_control=faults(4500, lost), to_host=faults(300, lost, end_code_behind))
def test_whatever_is_lost_or_ended_too_early(
    name: str, cnc_settings: dict[str, str], to_control: Faults, to_host: Faults
) -> None:
    world = World()
    n = {"n": "1"} if name == "fanuc-a-expansion" else {}
    pair = world.pair(name, baud=86_400, host_settings=n, cnc_settings=cnc_settings, grain=64, cnc_window=64)
    spoil(pair, to_control, to_host)
    pair.host.start(BytesIO(PROGRAM), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.host_end is not None or gave_up(pair), limit=10 * PATIENCE)
    if pair.host_end is None:
        world.run_for(10 * SECOND)
    taken = pair.program.getvalue()
    assert PROGRAM.startswith(taken), pair.transcript
    if pair.host_end is None:
        assert isinstance(pair.host, FanucAHost)
        assert (pair.host.state, pair.host.progress) == (State.ARMED, 0), pair.transcript
    else:
        assert (pair.host_end.outcome is Outcome.COMPLETE) <= (taken == PROGRAM), pair.transcript
