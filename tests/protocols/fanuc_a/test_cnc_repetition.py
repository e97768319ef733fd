"""A control of expansion protocol A that says NAK more than once for an error, and is obeyed twice (5.3 2))."""

from __future__ import annotations

import pytest

from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.cnc_packets import MOST_STALE
from tapewire.protocols.fanuc_a.params import Naks, Params
from tests.protocols.fanuc_a.cnc_bench import quick
from tests.protocols.fanuc_a.test_cnc_packets import AGAIN, bad, good, last, nak, packets, part

EACH = quick(naks=Naks.PACKET)
OFTEN = pytest.mark.parametrize("settings", [EACH, AGAIN], ids=["a NAK a packet", "NAK again"])


def test_a_nak_that_was_lost_is_said_again_before_the_number_comes_round() -> None:
    bench = packets(AGAIN).receive(bad(good(0)))
    assert bench.monitors() == nak(0x30)
    for index in range(1, 1 + MOST_STALE):
        bench.receive(good(index))
    assert bench.monitors() == b""
    bench.receive(good(1 + MOST_STALE))
    assert bench.monitors() == nak(0x30)
    assert bench.engine.buffered == 0


def test_a_host_that_obeys_both_naks_is_not_asked_for_what_is_here() -> None:
    bench = packets(AGAIN).receive(bad(good(0)))
    for index in range(1, 2 + MOST_STALE):
        bench.receive(good(index))
    assert bench.monitors() == nak(0x30) * 2
    for index in (0, 1, 2, 0, 1, 2, 3):
        bench.receive(good(index))
    assert bench.monitors() == b""
    assert bench.take() == b"".join(part(index) for index in range(4))
    bench.receive(last())
    assert bench.take() == b"\nM30\n%"


def test_the_end_packet_behind_a_repetition_of_what_is_here_ends_the_session() -> None:
    bench = packets(AGAIN).receive(bad(good(0)))
    for index in range(1, 2 + MOST_STALE):
        bench.receive(good(index))
    bench.receive(good(0) + good(1) + good(0) + good(1) + last())
    assert bench.take() == part(0) + part(1) + b"\nM30\n%"


def test_a_nak_for_each_packet_and_a_bad_packet_right_before_the_end_packet() -> None:
    bench = packets(EACH).receive(bad(good(0))).receive(last())
    assert bench.monitors() == nak(0x30) * 2
    bench.receive(good(0)).receive(good(0)).receive(last())
    assert bench.monitors() == b"", "what comes twice was asked for twice"
    assert bench.take() == part(0) + b"\nM30\n%"


def test_a_nak_for_each_packet_and_a_bad_one_among_what_comes_again() -> None:
    bench = packets(EACH).receive(bad(good(0))).receive(good(1))
    bench.receive(good(0)).receive(good(1)).receive(good(0))
    assert bench.monitors() == nak(0x30) * 2
    bench.receive(bad(good(1))).receive(last())
    assert bench.monitors() == nak(0x32) * 2
    assert bench.state is State.PACKETS
    bench.receive(good(2)).receive(last())
    assert bench.take() == part(0) + part(1) + part(2) + b"\nM30\n%"


def test_a_nak_for_each_packet_and_a_bad_end_packet_behind_a_repetition() -> None:
    bench = packets(EACH).receive(bad(good(0))).receive(last())
    bench.receive(good(0)).receive(good(0)).receive(bad(last()))
    assert bench.monitors() == nak(0x30) * 2 + nak(0x31)
    bench.receive(last())
    assert bench.take() == part(0) + b"\nM30\n%"


@OFTEN
@pytest.mark.parametrize("gap", [good(3), last()], ids=["an effective packet", "the end packet"])
def test_what_does_not_come_in_a_repetition_is_asked_for_at_once(settings: Params, gap: bytes) -> None:
    bench = packets(settings).receive(bad(good(0))).receive(good(1))
    bench.receive(good(0)).receive(good(1)).receive(good(0))
    bench.monitors()
    bench.receive(gap)
    assert bench.monitors() == nak(0x32)
    assert bench.state is State.PACKETS
    assert bench.take() == part(0) + part(1)


@OFTEN
def test_a_nak_of_long_ago_explains_no_packet(settings: Params) -> None:
    """Six are lost whole, and the seventh bears the number that was asked for, fourteen packets ago."""
    bench = packets(settings).receive(bad(good(0)))
    for index in range(14):
        bench.receive(good(index))
    bench.monitors()
    bench.receive(good(20))
    assert bench.monitors() == nak(0x34)
    assert bench.take() == b"".join(part(index) for index in range(14))


@pytest.mark.parametrize(("naks", "count"), [(Naks.ERROR, 1), (Naks.PACKET, 3)])
def test_one_nak_for_an_error_or_for_each_packet_that_follows(naks: Naks, count: int) -> None:
    bench = packets(quick(naks=naks)).receive(bad(good(0))).receive(good(1)).receive(good(2))
    assert bench.monitors() == nak(0x30) * count
