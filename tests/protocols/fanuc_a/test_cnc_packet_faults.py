"""The control's end of expansion A under faults of the line, with a host by the book (B-63322EN-1 5.2, 5.4)."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND, Ended
from tapewire.protocols.fanuc_a.cnc_law import State
from tapewire.protocols.fanuc_a.packets import (
    data_bytes,
    encode_packet,
)
from tapewire.protocols.settings import Switch
from tests.protocols.fanuc_a.cnc_bench import Bench, quick
from tests.protocols.fanuc_a.test_cnc_packets import END, bad, good, packets, part

FAULTS = st.sampled_from(["spoilt", "byte lost"])


def damaged(packet: bytes, fault: str | None) -> bytes:
    return {"spoilt": bad(packet), "byte lost": packet[1:], "byte more": b"7" + packet}.get(fault or "", packet)


def send_by_the_book(bench: Bench, parts: list[bytes], faults: dict[int, str], n: int) -> bytes:
    """A host that finishes the packet it is sending and then goes on from the youngest packet of the number named, the
    next one it has never sent among them; the k-th packet it sends suffers `faults[k]`. Returns what the control took.
    """
    taken, index, sent_so_far, orders = b"", 0, 0, b""
    for sent in range(100):
        if bench.state is not State.PACKETS or (index == len(parts) and not orders):
            break
        if index < len(parts):
            packet = encode_packet(END if index == len(parts) - 1 else 0x30 + index % 10, parts[index], n)
            bench.receive(damaged(packet, faults.get(sent)))
            index += 1
        sent_so_far = max(sent_so_far, index)
        for at in range(0, len(orders), 5):
            index = max(young for young in range(sent_so_far + 1) if 0x30 + young % 10 == orders[at + 1])
        orders = bench.monitors()
        taken += bench.take()
    return taken


@settings(max_examples=100)
@given(
    faults=st.dictionaries(st.integers(0, 25), FAULTS, max_size=4),
    n=st.sampled_from([1, 2]),
    again=st.sampled_from(Switch),
)
def test_with_any_faults_of_packets_the_control_takes_the_program_or_fails(
    faults: dict[int, str], n: int, again: Switch
) -> None:
    parts = [*(part(index, n) for index in range(14)), b"\nM30\n%".ljust(data_bytes(n), b"\0")]
    whole = b"".join(parts).rstrip(b"\0")
    bench = packets(quick(monitors_again=again), n=n)
    taken = send_by_the_book(bench, parts, faults, n)
    bench.run(30)
    assert whole.startswith(taken)
    assert bench.alarms if taken != whole else not bench.alarms


@pytest.mark.parametrize("fault", ["spoilt", "byte lost", "byte more"])
@pytest.mark.parametrize("at", range(14))
@pytest.mark.parametrize("again", Switch)
def test_one_fault_of_any_packet_is_made_good(at: int, fault: str, again: Switch) -> None:
    parts = [*(part(index) for index in range(14)), b"\nM30\n%".ljust(256, b"\0")]
    whole = b"".join(parts).rstrip(b"\0")
    bench = packets(quick(monitors_again=again))
    taken = send_by_the_book(bench, parts, {at: fault}, 1)
    if (at, fault, again) == (12, "byte more", Switch.OFF):
        # What is here comes again, so the end packet is asked for as the effective one it is not: it is stale then.
        assert bench.run(30).alarms == ["SR944"]
        assert whole.startswith(taken)
        return
    assert taken == whole
    assert bench.alarms == []


@given(data=st.binary(max_size=900), cuts=st.lists(st.integers(0, 900), max_size=5))
def test_any_cutting_gives_the_same(data: bytes, cuts: list[int]) -> None:
    data = good(0) + data + good(1)
    whole, cut = packets(), packets()
    whole.engine.receive_data(data, whole.now)
    places = sorted({0, len(data), *(min(place, len(data)) for place in cuts)})
    for start, end in itertools.pairwise(places):
        cut.engine.receive_data(data[start:end], cut.now)
    whole.run(60)
    cut.run(60)
    assert (whole.out, whole.events, whole.engine.buffered) == (cut.out, cut.events, cut.engine.buffered)


def test_a_long_program_in_bounded_memory() -> None:
    bench = packets(n=4)
    for index in range(400):
        bench.receive(good(index, 4))
        bench.take()
        bench.monitors()
    assert bench.engine.progress == 400 * 1024
    assert not bench.of(Ended)
    assert bench.now < SECOND * 10


def test_a_bad_end_packet_behind_a_bad_effective_one_is_stale_and_the_good_one_behind_it_too() -> None:
    """5.2 2) a): what was asked for is 30h. The end packet taken in its place would leave a packet out unseen."""
    end = encode_packet(END, b"\nM30\n%".ljust(256, b"\0"), 1)
    bench = packets(quick(monitors_again=Switch.OFF))
    bench.receive(bad(good(0)))
    bench.receive(bad(end))
    bench.receive(end)
    assert bench.take() == b""
    bench.receive(good(0) + end)
    assert bench.take() == part(0) + b"\nM30\n%"
