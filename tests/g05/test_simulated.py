"""Binary programs from host to simulated control, by every protocol of the remote buffer, in simulated time."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
import pytest

from tapewire.codes import TABLES, DataCode
from tapewire.engine import MILLISECOND, SECOND, Alarm, Event, Nanos, Notice, Outcome
from tapewire.errors import ProgramError
from tapewire.fanuc.tape import prepare
from tapewire.g05.layout import AuxiliaryUse, BinaryInput, Layout, RecordFormat, UnitTime
from tapewire.g05.records import encode
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.settings import End
from tapewire.sim.binary_operation import BinaryOperation
from tapewire.sim.world import Pair, World
from tests.g05.test_sections import section

FANUC: Final = ("fanuc-a", "fanuc-a-expansion", "fanuc-b", "fanuc-b-expansion")
SPECIAL: Final = Layout(axis_count=3)


def program(*sections: bytes, before: bytes = b"%\nO1\n") -> bytes:
    return before + b"".join(b"G05\n" + data for data in sections) + b"M02\n%"


def started(name: str, content: bytes, g05: str, baud: int | None = None, **settings: str) -> tuple[World, Pair]:
    world = World()
    words = {"g05": g05, **settings}
    pair = world.pair(name, baud=baud, settings=words)
    if pair.entry.refuse is not None:
        pair.entry.refuse(pair.entry.params(words, End.HOST), io.BytesIO(content).read)
    pair.host.start(io.BytesIO(content), world.now)
    pair.cnc.cycle_start(world.now)
    return world, pair


def run(name: str, content: bytes, g05: str, baud: int | None = None, **settings: str) -> Pair:
    world, pair = started(name, content, g05, baud, **settings)
    world.run_for(60 * SECOND)
    return pair


def told(events: list[tuple[Nanos, Event]], kind: type[Event]) -> list[str]:
    return [str(getattr(event, "text", "")) for _, event in events if isinstance(event, kind)]


def binary(pair: Pair) -> BinaryOperation:
    assert pair.control.binary is not None
    return pair.control.binary


@pytest.mark.parametrize("name", FANUC)
def test_every_protocol_carries_a_section_to_the_axes(name: str) -> None:
    travel = np.random.default_rng(1).integers(-8192, 8192, (300, 3))
    data = program(encode(travel, SPECIAL).tobytes() + SPECIAL.exit_record)
    pair = run(name, data, "3,8ms")
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE
    assert pair.program.getvalue() == data
    assert binary(pair).position == travel.sum(axis=0).tolist()
    assert (binary(pair).records_executed, binary(pair).interruptions, binary(pair).active) == (300, 0, False)


@pytest.mark.parametrize("name", FANUC[1:])
def test_the_general_format_where_every_byte_may_stand(name: str) -> None:
    layout = Layout(axis_count=5, format=RecordFormat.GENERAL, auxiliary=AuxiliaryUse.USED)
    data = program(section(layout, 200), section(layout, 200, seed=2))
    assert {0x25, 0x0D, 0x8D, 0xA5} <= set(data)
    pair = run(name, data, "5,general,aux,16ms")
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE
    assert pair.program.getvalue() == data
    assert binary(pair).records_executed == 400


def test_protocol_a_takes_the_special_format_only() -> None:
    data = program(section(Layout(axis_count=3, format=RecordFormat.GENERAL)))
    entry = PROTOCOLS["fanuc-a"]
    assert entry.refuse is not None
    with pytest.raises(ProgramError, match=r"special (format|one only)"):
        entry.refuse(entry.params({}, End.HOST), io.BytesIO(data).read)


def test_expansion_a_must_know_the_records_of_the_general_format() -> None:
    data = program(section(Layout(axis_count=3, format=RecordFormat.GENERAL)))
    entry = PROTOCOLS["fanuc-a-expansion"]
    assert entry.refuse is not None
    with pytest.raises(ProgramError, match="--set g05=3,general"):
        entry.refuse(entry.params({}, End.HOST), io.BytesIO(data).read)
    entry.refuse(entry.params({"g05": "3,general"}, End.HOST), io.BytesIO(data).read)


@pytest.mark.parametrize("code", ["ascii", "iso", "eia"])
@pytest.mark.parametrize("after", [b"M02\n%", b"\nM02\n%", b"%", b"(X)\n%", b"0%"])
def test_the_general_format_is_seen_whatever_text_follows_it(code: str, after: bytes) -> None:
    """In EIA an EOB is 80h and EOR 0Bh: text too."""
    data = b"%\nO1\nG05\n" + section(Layout(axis_count=3, format=RecordFormat.GENERAL), 300) + after
    entry = PROTOCOLS["fanuc-a-expansion"]
    assert entry.refuse is not None
    params = entry.params({"data": code}, End.HOST)
    out = bytearray()
    prepare(io.BytesIO(data).read, out.extend, params.data)
    with pytest.raises(ProgramError, match="--set g05=3,general"):
        entry.refuse(params, io.BytesIO(bytes(out)).read)


def test_a_section_takes_its_units_of_time() -> None:
    """However fast the line is."""
    world, pair = started("fanuc-b-expansion", program(section(SPECIAL, 200)), "3,16ms")
    world.run_until(lambda: binary(pair).records_executed == 1)
    began = world.now
    world.run_until(lambda: binary(pair).records_executed == 200)
    assert world.now - began == 199 * 16 * MILLISECOND


def test_a_line_that_is_too_slow_starves_the_axes_and_says_so() -> None:
    """Three axes at 2 ms need 38,500 baud (9.2): at 19,200 every record is late."""
    pair = run("fanuc-b", program(section(SPECIAL, 4000)), "3,2ms", baud=19200)
    assert binary(pair).records_executed == 4000
    assert binary(pair).interruptions > 500
    notices = [text for text in told(pair.cnc_events, Notice) if "pulse distribution" in text]
    assert len(notices) == 2
    assert "is interrupted, and the axes stand still (9.2)" in notices[0]
    assert f"interrupted {binary(pair).interruptions:,} times" in notices[1]


@pytest.mark.parametrize("name", FANUC)
def test_a_wrong_check_byte_is_sr890(name: str) -> None:
    data = bytearray(section(SPECIAL, 500))
    data[7 * 20 + 1] ^= 2
    pair = run(name, program(bytes(data)), "3,8ms")
    alarms = [event for _, event in pair.cnc_events if isinstance(event, Alarm)]
    assert [(alarm.number, "record 21:" in alarm.text) for alarm in alarms] == [("SR890", True)]
    assert binary(pair).records_executed == 20
    assert pair.cnc_end is not None
    assert pair.cnc_end.outcome is Outcome.FAILED


@pytest.mark.parametrize(
    ("before", "mode"),
    [
        (b"%\nO1\nG41D1\n", "cutter compensation"),
        (b"%\nG96S100\n", "constant surface speed control"),
        (b"%\nG51.1X0\nG01X1.\n", "programmable mirror image"),
        (b"%\nG07.1C50.\n", "cylindrical interpolation"),
    ],
)
def test_g05_in_a_forbidden_mode_is_sr891(before: bytes, mode: str) -> None:
    pair = run("fanuc-b", program(section(SPECIAL, 5), before=before), "3,8ms")
    alarms = [event for _, event in pair.cnc_events if isinstance(event, Alarm)]
    assert [(alarm.number, alarm.text) for alarm in alarms] == [("SR891", f"ILLEGAL COMMAND G05: {mode}")]
    assert binary(pair).records_executed == 0


def test_a_mode_that_was_switched_off_forbids_nothing() -> None:
    before = b"%\nG41D1\nG81Z-1.R1.\nG40G80\nG07.1C50.\nG07.1C0\nG68X0Y0R45.\nG69\n"
    assert binary(run("fanuc-b", program(section(SPECIAL, 5), before=before), "3,8ms")).records_executed == 5


@pytest.mark.parametrize("code", ["iso", "eia"])
def test_in_other_codes_too(code: str) -> None:
    layout = Layout(axis_count=3, format=RecordFormat.GENERAL)
    data = program(section(layout, 100))
    out = bytearray()
    entry = PROTOCOLS["fanuc-b"]
    params = entry.params({"data": code}, End.HOST)
    prepare(io.BytesIO(data).read, out.extend, params.data)
    pair = run("fanuc-b", bytes(out), "3,general,8ms", data=code)
    assert binary(pair).records_executed == 100
    assert pair.host_end is not None
    assert pair.host_end.outcome is Outcome.COMPLETE


def test_feed_hold_stops_the_axes_and_nothing_is_lost() -> None:
    """9.3 note 4: the unit of time that was begun is finished after CYCLE START, and a hold is no interruption."""
    world, pair = started("fanuc-b-expansion", program(section(SPECIAL, 2000)), "3,2ms")
    world.run_until(lambda: binary(pair).records_executed == 700)
    pair.control.feed_hold(world.now)
    world.run_for(SECOND)
    assert binary(pair).records_executed == 700
    pair.control.go(world.now)
    pair.step(world.now)
    world.run_until(lambda: not binary(pair).active)
    assert (binary(pair).records_executed, binary(pair).interruptions) == (2000, 0)


def test_a_feed_hold_in_an_interruption_ends_neither() -> None:
    """8 ms of it before the hold, which lasts nearly a second, and 20 behind it: one interruption of 28 ms, not two."""
    control = BinaryOperation(BinaryInput(layout=SPECIAL, unit_time=UnitTime.MS_2), TABLES[DataCode.ASCII].to_ascii)
    control.sees(b"G05\n")
    record = encode(np.array([[1, 2, 3]]), SPECIAL).tobytes()
    assert control.step(bytearray(record), 0)
    assert not control.step(bytearray(), 2 * MILLISECOND)
    control.hold(10 * MILLISECOND)
    assert control.next_deadline() is None
    control.go(SECOND)
    assert not control.step(bytearray(), SECOND)
    assert control.step(bytearray(record), SECOND + 20 * MILLISECOND)
    assert control.interruptions == 1
    assert (control.interrupted, control.longest_interruption) == (28 * MILLISECOND, 28 * MILLISECOND)
    assert control.due == SECOND + 22 * MILLISECOND
    assert control.step(bytearray(SPECIAL.exit_record), SECOND + 22 * MILLISECOND)
    assert not control.active


def test_an_interruption_before_the_exit_record_is_counted() -> None:
    control = BinaryOperation(BinaryInput(layout=SPECIAL, unit_time=UnitTime.MS_2), TABLES[DataCode.ASCII].to_ascii)
    control.sees(b"G05\n")
    assert control.step(bytearray(encode(np.array([[1, 2, 3]]), SPECIAL).tobytes()), 0)
    assert not control.step(bytearray(), 2 * MILLISECOND)
    assert control.step(bytearray(SPECIAL.exit_record), 5 * MILLISECOND)
    assert (control.active, control.interruptions, control.interrupted) == (False, 1, 3 * MILLISECOND)
