"""Keys pressed by a list: a control that nobody stands at, in the simulated world."""

from __future__ import annotations

from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.codes import DataCode
from tapewire.engine import SECOND, Alarm, Event, Nanos, Notice, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.block_check import BlockCheck
from tapewire.fanuc.parameters import Interface, ParameterSet
from tapewire.sim.nc import Ground, Operation
from tapewire.sim.nc_world import WorldNc, nc_of
from tapewire.sim.operator import Key, Operator, Press
from tapewire.sim.program_flow import ProgramFlow
from tapewire.sim.world import World
from tests.sim.test_nc import ALL, LONG, A, B

TAPE = b"%\nO1\nX1.\nM00\nX2.\nM01\nX3.\nM02\nO2\nX4.\nM30\n%"


class Worked:
    """A control whose keys are pressed by a list, and its host."""

    def __init__(
        self, *words: str, parameters: ParameterSet = B, stand: Nanos = 0, flow: ProgramFlow | None = None
    ) -> None:
        self.world = World()
        self.nc: WorldNc = nc_of(self.world, parameters, Interface.RS_422, blocks_per_second=10, flow=flow)
        self.pair = self.nc.pair
        self.told: list[str] = []
        self.operator = Operator(self.nc, tuple(map(Press.parse, words)), stand, self._hear)
        self.pair.cnc_link.application = self.operator
        self.operator.begin(self.world.now)

    def _hear(self, event: Event, now: Nanos) -> None:
        if isinstance(event, Notice):
            self.told.append(event.text)

    def dnc(self, tape: bytes = TAPE) -> Worked:
        self.pair.host.start(BytesIO(tape), self.world.now)
        self.nc.cycle_start(self.world.now)
        return self

    def end(self) -> tuple[Outcome, int]:
        """How it ended, and how many tenths of a second it took."""
        self.world.run_until(lambda: self.pair.cnc_end is not None and self.nc.operation is Operation.NONE)
        assert self.pair.cnc_end is not None
        return self.pair.cnc_end.outcome, self.world.now // (SECOND // 10)


@pytest.mark.parametrize("parameters", ALL)
def test_cycle_start_comes_by_itself_behind_every_stop(parameters: ParameterSet) -> None:
    worked = Worked("optional-stop@0", parameters=parameters, stand=2 * SECOND).dnc()
    outcome, tenths = worked.end()
    assert outcome is Outcome.COMPLETE
    assert tenths >= 60 + 11
    assert worked.told == [
        "pressed: optional-stop",
        "stands: program stop (M00, M01), after 4 blocks",
        "stands: program stop (M00, M01), after 6 blocks",
        "stands: end of program (M02, M30), after 8 blocks",
    ]


def test_without_the_switch_m01_is_passed_over_and_no_time_is_lost() -> None:
    worked = Worked().dnc()
    assert worked.end()[0] is Outcome.COMPLETE
    assert [text for text in worked.told if "stands" in text] == [
        "stands: program stop (M00, M01), after 4 blocks",
        "stands: end of program (M02, M30), after 8 blocks",
    ]


def test_single_block_stands_after_each_and_tells_it_once() -> None:
    worked = Worked("single-block@0", stand=SECOND).dnc(b"%\n" + b"X1.\n" * 10 + b"M30\n%")
    outcome, tenths = worked.end()
    assert outcome is Outcome.COMPLETE
    assert tenths >= 11 * 10
    assert sum("single block" in text for text in worked.told) == 1


def test_a_feed_hold_waits_for_its_cycle_start() -> None:
    worked = Worked("hold@20", "start@30s").dnc()
    worked.world.run_for(29 * SECOND)
    assert worked.nc.operation is Operation.DNC
    outcome, tenths = worked.end()
    assert (outcome, tenths >= 300) == (Outcome.COMPLETE, True)
    assert worked.told[:2] == ["pressed: hold", "pressed: start"]


@pytest.mark.parametrize(("word", "outcome"), [("reset@500", Outcome.CANCELLED), ("alarm@500", Outcome.FAILED)])
def test_a_reset_or_an_alarm_to_the_byte(word: str, outcome: Outcome) -> None:
    worked = Worked(word).dnc(LONG)
    assert worked.end()[0] is outcome
    assert len(worked.pair.program.getvalue()) == 500


@pytest.mark.parametrize(("key", "outcome"), [("reset", Outcome.COMPLETE), ("stop", Outcome.CANCELLED)])
def test_6_4_note_1_in_the_background_stop_ends_it_and_reset_does_not(key: str, outcome: Outcome) -> None:
    worked = Worked(f"{key}@100")
    worked.pair.host.start(BytesIO(LONG), 0)
    worked.nc.read(0, Ground.BACKGROUND)
    assert worked.end()[0] is outcome


def test_6_4_note_2_the_soft_key_stop_lets_a_punch_out_run_on_for_what_is_buffered() -> None:
    worked = Worked("stop@1000")
    worked.nc.memory.read(LONG)
    worked.pair.host.receive(worked.pair.received, 0)
    worked.nc.punch_programs(0)
    assert worked.end()[0] is Outcome.CANCELLED
    assert 1200 <= len(worked.pair.received.getvalue()) <= 1600


def test_4_4_2_what_the_host_sets_by_sdo_is_told() -> None:
    worked = Worked(parameters=A)
    worked.pair.host.set_do(0x3C, 0)  # type: ignore[attr-defined]
    worked.dnc().end()
    assert "the host has set F152 to 3Ch" in worked.told


def test_what_cannot_be_obeyed_is_told() -> None:
    worked = Worked("start@1s", "start@2s", "stop@3s", "reset@4s")
    worked.nc.parameters.enter(20, 4)
    worked.world.run_for(5 * SECOND)
    refused = "not obeyed: an alarm is on: RESET first"
    assert worked.told == ["pressed: start", "pressed: start", refused, "pressed: stop", "pressed: reset"]
    assert worked.nc.alarms == []


def test_11_ps10_in_what_was_taken_ahead_when_the_communication_was_over() -> None:
    worked = Worked(flow=ProgramFlow(DataCode.ASCII, check=BlockCheck())).dnc(b"%\nX1.\nX2.\nG123\nM30\n%")
    worked.world.run_until(lambda: bool(worked.nc.alarms))
    assert [alarm.number for alarm in worked.nc.alarms] == ["PS10"]
    assert worked.nc.control.blocks_executed == 3
    assert [event.number for _, event in worked.pair.cnc_events if isinstance(event, Alarm)] == ["PS10"]


@pytest.mark.parametrize(
    "word", ["", "hold", "hold@", "@9", "push@3", "hold@-1", "hold@1.5", "start@1e9s", "start@s", "hold@9@9", "hold@٣"]
)
def test_a_word_that_is_no_press(word: str) -> None:
    with pytest.raises(UsageError, match=r"KEY@BYTES or KEY@SECONDSs is expected.*start, hold, reset, stop"):
        Press.parse(word)


words = st.builds(
    "{}@{}".format, st.sampled_from(list(Key)), st.integers(0, 4000) | st.integers(0, 20).map("{}s".format)
)


@settings(max_examples=25, deadline=None)
@given(st.lists(words, max_size=8), st.sampled_from(ALL), st.integers(0, 2 * SECOND))
def test_whatever_is_pressed_it_rests_after_a_reset(pressed: list[str], parameters: ParameterSet, stand: Nanos) -> None:
    worked = Worked(*pressed, parameters=parameters, stand=stand).dnc(TAPE)
    worked.world.run_for(60 * SECOND)
    worked.nc.reset(worked.world.now)
    worked.world.run_for(60 * SECOND)
    assert worked.nc.operation is Operation.NONE
    assert worked.nc.control.idle
