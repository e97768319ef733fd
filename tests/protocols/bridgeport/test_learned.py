"""What a guided session has found out must be enough: the profile it writes, and no other word, at the same control."""

from __future__ import annotations

import itertools

import pytest

from tapewire.engine import Outcome
from tapewire.protocols.bridgeport.profile import Profile
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tapewire.protocols.settings import End
from tapewire.sim.world import World
from tests.protocols.bridgeport.combinations import read, save
from tests.protocols.bridgeport.host_rig import surfacing
from tests.protocols.bridgeport.test_learning import Shift

PROGRAM = surfacing(400)
ODD: list[dict[str, str]] = [
    *({"dnc_end": end, "first_record": first} for end, first in itertools.product(DncEnd, ("at_once", "on_ack"))),
    *({"lrc": lrc, "dnc_end": "etx_last"} for lrc in LRC_CANDIDATES),
    {"text_end": "03", "rec_end_last": "04", "save_trailer": "03 14", "dnc_end": "empty_then_eot"},
    {"text_end": "03", "rec_end_last": "04", "save_trailer": "03", "dnc_end": "etx_last"},
    {"open_write": "05", "write_ready": "06", "read_request": "0E", "name_trailer": "0D 0A 03", "name_end": "03"},
    {"cancel": "18", "operator_cancel": "13 18", "parity_cancel": "18", "dnc_end": "etx_last"},
    {"save_trailer": "14", "name_trailer": "04", "dnc_end": "eot_after_lrc", "lrc": "neg7"},
    {"parity": "software", "first_record": "on_ack"},
    {"request_repeat": "3", "repeat": "1"},
    {"repeat": "0", "answer_limit": "20", "load_timeout": "5"},
]


@pytest.mark.parametrize("odd", ODD, ids=lambda odd: " ".join(f"{key}={word}" for key, word in odd.items()))
def test_the_profile_of_a_session_is_enough_for_that_control(odd: dict[str, str]) -> None:
    shift = Shift(settings=odd).run()
    assert shift.end is not None
    assert shift.end.outcome is Outcome.COMPLETE, shift.told
    profile = Profile.loads(shift.learner.profile("mill 3").dumps())
    assert profile.settings["first_record"] == odd.get("first_record", "at_once")
    works(profile.settings_for(End.HOST), odd)


def works(host: dict[str, str], control: dict[str, str]) -> None:
    for mode in "LD":
        world = World()
        settings = {**control, "program": "1234", "mode": mode, "record_timeout": "5"}
        pair = world.pair("bridgeport", host_settings=host, cnc_settings=settings)
        ends = read(world, pair, PROGRAM)
        assert [end.outcome for end in ends] == [Outcome.COMPLETE] * 2, (mode, [end.reason for end in ends])
        assert pair.program.getvalue() == PROGRAM
        assert not any("NAK" in line for line in str(pair.transcript).splitlines()), "the check character is known"
        pair.host_end = pair.cnc_end = None
        ends = save(world, pair, PROGRAM)
        assert [end.outcome for end in ends] == [Outcome.COMPLETE] * 2, [end.reason for end in ends]
        assert pair.received.getvalue() == PROGRAM


def test_a_person_who_does_not_look_at_the_display_gets_the_likeliest_end() -> None:
    """A control that cancels what it has not taken needs no person; one that does not is taken at its silence."""
    etx = {"text_end": "03", "rec_end_last": "04", "save_trailer": "04"}
    silent = Shift(settings=etx, patience_s=1000).run()
    assert silent.learner.seen["text_end"] == "04"
    cancels = Shift(settings={"dnc_end": "etx_last"}, patience_s=1000).run()
    assert cancels.learner.seen["dnc_end"] == "etx_last"


def test_what_was_given_stays_in_the_profile_unless_something_else_was_seen() -> None:
    shift = Shift(("-1",), {"parity": "software", "read_request": "0E"}).run()
    profile = shift.learner.profile("mill 3")
    assert (profile.settings["parity"], profile.settings["read_request"]) == ("software", "0E")
    assert "parity" not in profile.confidence
