"""Fault plans on one wire: what is hit, how often, and that nothing goes unaccounted."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.engine import MILLISECOND, SECOND, LineFault, SignalsIn
from tapewire.line.faults.chance import SplitMix, derive
from tapewire.line.faults.characters import Late
from tapewire.line.faults.damage import Parity, misreadings
from tapewire.line.faults.injector import Injector, Injectors, injectors
from tapewire.line.faults.plan import (
    At,
    BaudMismatch,
    Break,
    Burst,
    DoubleCharacter,
    Every,
    Extent,
    FaultPlan,
    FlipBits,
    Framing,
    HoldSignal,
    LateStop,
    Level,
    LinePlan,
    Lose,
    Noise,
    Nth,
    PerTransfer,
    PullCable,
    Rate,
    Sight,
    Signal,
    Wire,
)
from tapewire.line.faults.presets import PRESETS
from tapewire.line.transport import Fault

DATA = bytes(range(65, 91))
CHARACTER = 1000


def plan_of(*faults: LinePlan) -> FaultPlan:
    return FaultPlan(name="scripted", why="a test", faults=faults)


def on_line(plan: FaultPlan, seed: int = 1, extent: Extent | None = None, parity: Parity = Parity.CHECKED) -> Injectors:
    return injectors(plan, lambda name: derive(seed, name), extent=extent, character=CHARACTER, parity=parity)


def from_host(*faults: LinePlan, seed: int = 1, parity: Parity = Parity.CHECKED) -> Injector:
    return on_line(plan_of(*faults), seed, parity=parity).from_host


def arrived(injector: Injector, data: bytes = DATA) -> list[bytes | Fault | Late]:
    return [item for _, item in injector.characters(data, 0, CHARACTER)]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (Lose(when=Nth(3)), [DATA[:2], DATA[3:]]),
        (Lose(when=Nth(3), characters=4), [DATA[:2], DATA[6:]]),
        (DoubleCharacter(when=Nth(26)), [DATA[:25], b"Z", b"Z"]),
        (Framing(when=Nth(1)), [Fault(fault=LineFault.FRAMING, byte=65), DATA[1:]]),
        (Break(when=Nth(2)), [b"A", b"B", Fault(fault=LineFault.BREAK), DATA[2:]]),
        (Lose(when=Nth(27)), [DATA]),
        (Lose(when=Nth(1), wire=Wire.FROM_CONTROL), [DATA]),
    ],
)
def test_a_scripted_fault_hits_the_character_it_names(fault: LinePlan, expected: list[bytes | Fault]) -> None:
    assert arrived(from_host(fault)) == expected


def test_two_scripted_faults_at_one_character_hit_one_after_the_other() -> None:
    assert arrived(from_host(Lose(when=Nth(3)), DoubleCharacter(when=Nth(3)))) == [DATA[:2], b"D", b"D", DATA[4:]]


@given(bits=st.integers(1, 9), seed=st.integers(0, 50))
def test_parity_sees_an_odd_number_of_turned_bits(bits: int, seed: int) -> None:
    injector = from_host(FlipBits(when=Nth(1), bits=bits), seed=seed)
    (item,) = arrived(injector, b"\x55")
    if bits % 2:
        assert isinstance(item, Fault)
        assert item.fault is LineFault.PARITY
        assert item.byte is not None
        assert (item.byte ^ 0x55).bit_count() in (bits, bits - 1)
    else:
        assert isinstance(item, bytes)
        assert (item[0] ^ 0x55).bit_count() in (bits, bits - 1)


def test_without_parity_every_turned_bit_passes() -> None:
    (item,) = arrived(from_host(FlipBits(when=Nth(1)), parity=Parity.NONE), b"\x55")
    assert isinstance(item, bytes)
    assert (item[0] ^ 0x55).bit_count() == 1


def test_a_late_stop_is_told_before_the_stop_request_it_delays() -> None:
    fault = LateStop(when=Nth(2), wire=Wire.FROM_HOST, characters=5)
    assert arrived(from_host(fault), b"A\x13B\x93C") == [b"A", b"\x13", b"B", Late(5 * CHARACTER), b"\x93", b"C"]


@pytest.mark.parametrize("parity", Parity)
def test_a_clock_within_three_percent_reads_every_character(parity: Parity) -> None:
    for percent in (-3.0, 0.0, 3.0):
        assert list(misreadings(percent, parity)) == [bytes((byte,)) for byte in range(256)]


@pytest.mark.parametrize("percent", [-25.0, 33.3])
def test_a_third_off_next_to_nothing_is_read_as_it_was_sent(percent: float) -> None:
    right = [byte for byte, read in enumerate(misreadings(percent, Parity.CHECKED)) if read == bytes((byte,))]
    assert len(right) < 16
    injector = from_host(BaudMismatch(percent=percent))
    arrived(injector)
    assert injector.damaged == injector.log.counts["baud mismatch"] > 20


RULES = st.lists(
    st.builds(
        lambda make, when, wire: make(when=when, wire=wire),
        st.sampled_from([FlipBits, Burst, Lose, DoubleCharacter, Framing, Break, Noise]),
        st.one_of(st.builds(Nth, st.integers(1, 60)), st.builds(Rate, st.sampled_from([0.01, 0.1, 0.5]))),
        st.sampled_from(Wire),
    ),
    max_size=6,
)
Cuts = st.lists(st.integers(0, 40), max_size=12)


def all_of(injector: Injector, pieces: list[bytes]) -> list[bytes | Fault | Late]:
    """What arrives of the pieces one after the other, bytes character by character."""
    at = 0
    items: list[bytes | Fault | Late] = []
    for piece in pieces:
        for _, item in injector.characters(piece, at * CHARACTER, CHARACTER):
            items += [bytes((byte,)) for byte in item] if isinstance(item, bytes) else [item]
        at += len(piece)
    return items


@given(rules=RULES, sizes=Cuts, seed=st.integers(0, 1000))
def test_any_cut_brings_the_same_and_every_character_is_accounted_for(
    rules: list[LinePlan], sizes: list[int], seed: int
) -> None:
    ends = [0, *itertools.accumulate(sizes)]
    data = bytes(place % 251 for place in range(ends[-1]))
    whole, cut = from_host(*rules, seed=seed), from_host(*rules, seed=seed)
    came = all_of(whole, [data])
    assert all_of(cut, [data[a:b] for a, b in itertools.pairwise(ends)]) == came
    assert list(cut.log.entries) == list(whole.log.entries)
    assert whole.seen == len(data)
    assert len(came) == whole.seen - whole.lost + whole.added
    strokes = sum(whole.log.counts.values())
    by_luck = strokes - whole.lost - whole.added - whole.damaged
    assert 0 <= by_luck <= whole.log.counts[Burst.kind]
    marked = [item for item in came if isinstance(item, Fault) and item.fault is not LineFault.BREAK]
    assert len(marked) <= whole.damaged + whole.added


def test_a_rate_is_kept() -> None:
    injector = from_host(Lose(when=Rate(1e-3)))
    for _ in range(1000):
        injector.characters(bytes(1000), 0, CHARACTER)
    assert 850 < injector.lost < 1150


@pytest.mark.parametrize("characters", [100, 65536])
def test_as_many_faults_per_transfer_whatever_its_length(characters: int) -> None:
    lost = 0
    for seed in range(500):
        injector = on_line(plan_of(Lose(when=PerTransfer(2.0))), seed, Extent(characters=characters)).from_host
        injector.characters(bytes(characters), 0, CHARACTER)
        lost += injector.lost
    assert 1.7 < lost / 500 < 2.3


def test_one_fault_more_shifts_none_of_the_others() -> None:
    rules = (Lose(when=Rate(0.01)), FlipBits(when=Rate(0.01)))
    alone, together = from_host(*rules), from_host(*rules, Noise(when=Rate(0.001)))
    for injector in (alone, together):
        injector.characters(bytes(5000), 0, CHARACTER)
    kinds = ("lost character",)
    places = [[e.place for e in i.log.entries if e.kind in kinds] for i in (alone, together)]
    assert places[0] == places[1]


def test_the_library_source_of_chance_will_do() -> None:
    made = injectors(PRESETS["worn-connector"], random.Random, character=CHARACTER)
    made.from_host.characters(bytes(100_000), 0, CHARACTER)
    assert made.log.counts


def fire_all(injector: Injector, until: int, *, idle: bool = True) -> list[tuple[int, object]]:
    came: list[tuple[int, object]] = []
    while (moment := injector.next_moment) is not None and moment <= until:
        came += [(moment, item) for item in injector.fire(idle=idle)]
    return came


def test_noise_comes_only_while_the_wire_is_idle() -> None:
    assert fire_all(from_host(Noise(when=At(5))), 10, idle=False) == []
    assert len(fire_all(from_host(Noise(when=At(5))), 10)) == 1


def test_random_moments_go_on_or_end_with_the_transfer() -> None:
    often = from_host(Break(when=Every(MILLISECOND)))
    assert 800 < len(fire_all(often, SECOND)) < 1200
    line = on_line(plan_of(Break(when=PerTransfer(5.0))), extent=Extent(span=SECOND)).from_host
    assert 5 < len(fire_all(line, 1000 * SECOND)) < 50
    assert line.next_moment is None


OFF = SignalsIn(cts=False, dsr=False, cd=False)
ON = SignalsIn()


def test_a_held_signal_shows_its_level_and_then_the_truth() -> None:
    fault = HoldSignal(when=At(50), signal=Signal.CTS, wire=Wire.FROM_HOST, span=100)
    injector = from_host(fault)
    assert injector.signals(OFF, 0) == [OFF]
    assert injector.signals(ON, 10) == [ON]
    assert fire_all(injector, 60) == [(50, SignalsIn(cts=False))]
    assert injector.signals(SignalsIn(dsr=False), 70) == [SignalsIn(cts=False, dsr=False)]
    assert injector.signals(ON, 80) == [SignalsIn(cts=False)]
    assert fire_all(injector, 200) == [(150, ON)]


@pytest.mark.parametrize(("level", "shown"), [(Level.STAYS, True), (Level.ON, True), (Level.OFF, False)])
def test_the_third_edge_of_cts_is_missed(level: Level, shown: bool) -> None:
    fault = HoldSignal(when=Nth(3), signal=Signal.CTS, wire=Wire.FROM_HOST, span=100, level=level)
    injector = from_host(fault)
    seen = [injector.signals(SignalsIn(cts=on), moment) for moment, on in enumerate([True, False, True, False])]
    expected: list[list[SignalsIn]] = [[ON], [SignalsIn(cts=False)], [ON]]
    assert seen == [*expected, [] if shown else [SignalsIn(cts=False)]]
    after = fire_all(injector, 1000)
    assert after == ([(103, SignalsIn(cts=False))] if shown else [])
    assert injector.log.counts == {f"CTS {level}": 1}


@pytest.mark.parametrize("sight", Sight)
def test_a_pulled_cable_takes_both_wires_at_the_same_moments(sight: Sight) -> None:
    line = on_line(plan_of(PullCable(when=PerTransfer(3.0), span=200, sight=sight)), extent=Extent(span=10_000))
    for injector in (line.from_host, line.from_control):
        injector.signals(ON, 0)
    moment = line.from_host.next_moment
    assert moment is not None
    assert moment == line.from_control.next_moment
    gone = [fire_all(injector, moment) for injector in (line.from_host, line.from_control)]
    assert gone == [[(moment, OFF)] if sight is Sight.SEEN else []] * 2
    assert arrived(line.from_host) == arrived(line.from_control) == []
    assert line.from_host.lost == len(DATA)
    assert line.log.counts == {"pulled cable": 1}


def test_the_log_keeps_the_last_and_counts_all() -> None:
    injector = from_host(Lose(when=Rate(1.0)))
    injector.characters(bytes(5000), 0, CHARACTER)
    assert injector.log.counts == {"lost character": 5000}
    assert [entry.place for entry in injector.log.entries] == list(range(4001, 5001))
    assert str(injector.log.entries[-1]) == "lost character from the host, number 5000"


def test_streams_of_other_names_are_other_streams() -> None:
    names = [(), ("a",), ("b",), ("a", "b"), ("ab",), ("b", "a")]
    firsts = {derive(seed, *name).random() for seed in range(100) for name in names}
    assert len(firsts) == 100 * len(names)
    draws = SplitMix(5)
    assert all(0 <= draws.randrange(7) < 7 and 0 <= draws.random() < 1 for _ in range(1000))
