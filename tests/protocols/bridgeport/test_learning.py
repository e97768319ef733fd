"""The guided session against simulated controls whose operator does what each step says."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tapewire.engine import SECOND, Ended, Event, LineFault, Nanos, Notice, Outcome, Violation
from tapewire.errors import UsageError
from tapewire.line.link import Link
from tapewire.line.simulated import EndSettings, simulated_cable
from tapewire.protocols.bridgeport.cnc import BridgeportCnc
from tapewire.protocols.bridgeport.code_table import ROLES
from tapewire.protocols.bridgeport.learning import PROGRAM, STEP_LIMIT, Learner
from tapewire.protocols.bridgeport.messages import Params
from tapewire.protocols.bridgeport.profile import Profile
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, tells_candidates_apart
from tapewire.protocols.settings import End
from tapewire.sim.machine import Control

STEPS = ("-1", "save", "load", "cancel", "link")
SAVED = b"N1G0X1\r\nN2M2\r\n"


class Shift:
    """A learner, a cable, and an operator at the control, who does the steps named in `does`.

    What the control has not taken after `patience_s` the operator cancels.
    """

    def __init__(
        self, does: tuple[str, ...] = STEPS, settings: Mapping[str, str] | None = None, *, patience_s: float = 15
    ) -> None:
        settings = settings or {}
        shared = {key: word for key, word in settings.items() if key == "parity"}
        self.learner = Learner(Params.for_bridgeport(shared, End.HOST), shared)
        self.near, self.far = simulated_cable(9600, EndSettings(window=2), EndSettings(window=2, fifo=2))
        self.host = Link(self.learner, self.near, on_event=self.note)
        self.cnc: Link | None = None
        self.does = does
        self.settings = settings
        self.patience = round(patience_s * SECOND)
        self.now: Nanos = 0
        self.told: list[str] = []
        self.events: list[Event] = []
        self.end: Ended | None = None
        self.step = ""
        self.working = False
        """The control has a job."""
        self.cancel_at: Nanos | None = None

    def note(self, event: Event, now: Nanos) -> None:
        self.events.append(event)
        if isinstance(event, Ended):
            self.end = event
        elif isinstance(event, Notice):
            self.told.append(event.text)
            self.do(event.text)

    def do(self, text: str) -> None:
        """What a person does who is told this."""
        if text.startswith("step") and " at the control" in text:
            self.step = STEPS[int(text[5]) - 1]
        if text.startswith(("step", "once more")) and " at the control" in text and self.step in self.does:
            self.act()
        elif text.startswith("trying"):
            self.cancel_at = self.now + self.patience
        elif "back to rest" in text and self.working:
            self.cancel_at = self.now

    def act(self) -> None:
        """The operator goes to the control."""
        words = {"program": "-1" if self.step == "-1" else "1234", "mode": "D" if self.step == "link" else "L"}
        cnc = BridgeportCnc(Params.for_bridgeport({**self.settings, **words}, End.CONTROL))
        self.cnc = Link(cnc, self.far, application=Control(cnc, BytesIO()), on_event=self.note_cnc)
        self.working = True
        if self.step == "save":
            cnc.punch(BytesIO(SAVED), self.now)
        else:
            cnc.cycle_start(self.now)
        self.cancel_at = self.now + 3 * SECOND if self.step == "cancel" else None

    def note_cnc(self, event: Event, now: Nanos) -> None:
        self.working = self.working and not isinstance(event, Ended)

    def run(self) -> Shift:
        self.learner.begin(self.now)
        while self.end is None:
            self.host.step(self.now)
            if self.cnc is not None:
                if self.cancel_at is not None and self.cancel_at <= self.now:
                    self.cancel_at = None
                    if self.working:
                        assert isinstance(self.cnc.engine, BridgeportCnc)
                        self.cnc.engine.reset(self.now)
                self.cnc.step(self.now)
            links = [self.host] if self.cnc is None else [self.host, self.cnc]
            moments = (self.cancel_at, *(link.next_deadline() for link in links))
            self.now = max(self.now, min((moment for moment in moments if moment is not None), default=self.now))
        return self


def learned(does: tuple[str, ...] = STEPS, **settings: str) -> dict[str, str]:
    shift = Shift(does, settings).run()
    assert shift.end is not None
    assert shift.end.outcome is Outcome.COMPLETE, shift.told
    return dict(shift.learner.seen)


USUAL = {
    "read_request": "11",
    "open_write": "12",
    "write_ready": "11",
    "name_end": "14",
    "text_end": "04",
    "write_close": "14",
    "cancel": "10",
    "cancel_tail": "03 04 06 10 13 14 15 18",
    "first_record": "at_once",
    "lrc": "xor7_etb",
    "ack": "06",
    "rec_end": "17",
    "dnc_end": "eot_on_ack",
}


def test_a_control_as_it_is_thought_to_be() -> None:
    assert learned() == USUAL


def test_the_profile_says_what_was_seen_and_what_was_not() -> None:
    learner = Shift().run().learner
    profile = Profile.loads(learner.profile("Seen at mill 3").dumps())
    assert profile.title == "Seen at mill 3"
    assert {key: profile.settings[key] for key in USUAL} == USUAL
    assert {key for key, percent in profile.confidence.items() if percent == 100} >= set(USUAL)
    assert profile.confidence["dnc_end"] == 100
    assert profile.confidence["nak"] == ROLES["nak"].confidence


@pytest.mark.parametrize("lrc", LRC_CANDIDATES)
def test_every_check_character_is_found(lrc: str) -> None:
    assert learned(("link",), lrc=lrc)["lrc"] == lrc


def test_the_program_it_sends_tells_the_candidates_apart() -> None:
    assert tells_candidates_apart(PROGRAM, Params().rec_end)


@pytest.mark.parametrize(
    ("words", "seen"),
    [
        ({"name_trailer": "04"}, {"name_end": "04"}),
        ({"name_trailer": "0D 0A 04 14"}, {"name_end": "04 14"}),
        ({"save_trailer": "03", "text_end": "03", "rec_end_last": "04"}, {"text_end": "03"}),
        ({"save_trailer": "14 04"}, {"text_end": "04", "write_close": "14"}),
        ({"save_trailer": "14"}, {"text_end": "04", "write_close": "14"}),
        ({"save_trailer": "03"}, {"text_end": "04", "write_close": "03"}),
        ({"text_end": "03", "rec_end_last": "04"}, {"text_end": "03", "write_close": "04"}),
        ({"operator_cancel": "10 18"}, {"cancel": "10"}),
        ({"operator_cancel": "13 18"}, {"cancel": "18"}),
        ({"operator_cancel": "10 02"}, {"cancel": "10", "cancel_tail": "02 03 04 06 10 13 14 15 18"}),
        ({"open_write": "05"}, {"open_write": "05"}),
        ({"write_ready": "06"}, {"write_ready": "06"}),
        ({"read_request": "0E"}, {"read_request": "0E"}),
    ],
)
def test_a_control_that_differs_is_seen_as_it_is(words: dict[str, str], seen: dict[str, str]) -> None:
    found = learned(STEPS, **words)
    assert {key: found[key] for key in seen} == seen


def test_how_often_it_says_its_first_code_is_told() -> None:
    shift = Shift(("load",)).run()
    assert any("says that again after 3.0 s" in text for text in shift.told)


def test_a_step_that_nobody_does_is_left_out() -> None:
    shift = Shift(("save",)).run()
    assert set(shift.learner.seen) == {"open_write", "write_ready", "name_end", "text_end", "write_close"}
    assert shift.now >= 4 * STEP_LIMIT


def test_a_silent_line_is_a_failure() -> None:
    shift = Shift(()).run()
    assert shift.end is not None
    assert shift.end.outcome is Outcome.FAILED
    assert "check the cable" in shift.end.reason


def test_damage_is_told_and_learned_from_by_nobody() -> None:
    learner = Learner(Params())
    learner.begin(0)
    learner.receive_line_fault(LineFault.PARITY, 0x11, 1)
    events = iter(learner.next_event, None)
    assert any(isinstance(event, Violation) and "parity" in event.what for event in events)
    assert learner.next_deadline() == STEP_LIMIT


@given(st.lists(st.binary(max_size=12) | st.sampled_from([b"\x12", b"1;L\x14\x11", b"\x13", b"\x06"]), max_size=30))
@settings(max_examples=100, deadline=None)
def test_whatever_is_said_the_session_ends_and_its_profile_is_one_or_refused(said: list[bytes]) -> None:
    learner = Learner(Params())
    learner.begin(0)
    now = 0
    for piece in said:
        learner.receive_data(piece, now)
        if data := learner.data_to_send(100):
            learner.data_sent(len(data), now)
        now = max(now, learner.next_deadline() or now)
        learner.handle_timer(now)
    while (deadline := learner.next_deadline()) is not None:
        now = max(now, deadline)
        learner.handle_timer(now)
    ends = [event for event in iter(learner.next_event, None) if isinstance(event, Ended)]
    assert len(ends) == 1
    assert (ends[0].outcome is Outcome.COMPLETE) is bool(learner.seen)
    with suppress(UsageError):
        assert Profile.loads(learner.profile("x").dumps()).settings.items() >= learner.seen.items()


def test_given_up_it_says_nothing_more_and_keeps_what_it_has_seen() -> None:
    learner = Learner(Params())
    learner.begin(0)
    learner.receive_data(b"\x11", 1)
    learner.handle_timer(2 * SECOND)
    assert learner.data_to_send(10) == PROGRAM[:10]
    learner.abort(3 * SECOND)
    learner.receive_data(b"\x12", 4 * SECOND)
    assert (learner.data_to_send(10), learner.next_deadline()) == (b"", None)
    assert learner.seen == {"read_request": "11"}
    ends = [event for event in iter(learner.next_event, None) if isinstance(event, Ended)]
    assert [end.outcome for end in ends] == [Outcome.CANCELLED]
