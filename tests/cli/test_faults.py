"""`cnc --faults`: faults on a real line, for a shop that trains and for whoever tests their own host."""

from __future__ import annotations

import pytest

from tapewire.line.faults.presets import PRESETS
from tests.cli.helpers import Shop, invoke, program
from tests.cli.test_transfer import LINES, finish, start

FAST: list[object] = ["--protocol", "fanuc-a", "--baud", "921600"]


def test_what_is_damaged_is_told_and_the_protocol_mends_it(shop: Shop) -> None:
    """A lost character changes the checksum of protocol A, and the control asks for the message again."""
    text = program(1200)
    file, saved = shop.file("in.nc", text), shop.folder / "out.nc"
    faults = ["--faults", "no-parity", "--fault-seed", "2"]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *FAST], cnc=["--save", saved, *faults, *FAST]))
    notices = [str(event["text"]) for event in taken.named("notice")]
    assert "repeat them with --fault-seed 2" in notices[0]
    made = [text for text in notices if text.startswith("fault made: ")]
    assert made, notices
    assert taken.named("violation"), "what was damaged did not pass for good"
    assert sent.outcome == taken.outcome == (0, "complete")
    assert saved.read_bytes() == text


def test_without_a_seed_one_is_drawn_and_told(shop: Shop) -> None:
    file = shop.file("in.nc", program(5))
    _, taken = finish(*start(shop, LINES[0], host=["send", file, *FAST], cnc=["--faults", "clean", *FAST]))
    assert "--fault-seed" in str(taken.named("notice")[0]["text"])


@pytest.mark.parametrize("name", ["power-cut", "host-restart", "clock-steps", "wrong-baud"])
def test_a_preset_that_no_real_line_can_have_is_refused(name: str, shop: Shop) -> None:
    assert name in PRESETS
    refused = shop.run("cnc", "--line", f"pty:{shop.folder}/x", *FAST, "--faults", name)
    assert refused.status == 2
    assert "can be made on a real line" in refused.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--faults", "../worn"], "there is no fault preset ../worn"),
        (["--fault-seed", "1"], "it goes with --faults"),
    ],
)
def test_wrong_words_are_refused(words: list[str], complaint: str) -> None:
    refused = invoke("cnc", "--line", "listen://127.0.0.1:0", *FAST, *words)
    assert refused.status == 2
    assert complaint in refused.stderr
