"""`tapewire cnc` without its panel: devices, keys by a list, punch of parameters, what it refuses."""

from __future__ import annotations

import pytest

from tests.cli.helpers import FAST, Shop, invoke, program

PARAMETERS = "N0000 P00001100\nN0020 P10\nN0021 P10\nN5000 P00011000\nN5081 P3\nN5082 P1\nN5083 P12\nN5084 P1\n"


def with_host(shop: Shop, verb: str, *words: object) -> tuple[object, list[str]]:
    """How the control ended, and what it has told. Its other end is a real host."""
    line = shop.folder / "control"
    file = shop.file("in.nc", program(40).replace(b"N20", b"M00\nN20")) if verb == "send" else shop.folder / "back"
    control = shop.start("cnc", "--line", f"pty:{line}", *FAST, "--json", *words)
    control.wait_for("ready")
    told = ("--protocol", "fanuc-b", "--set", "notice_time=0.1", "--set", "closing_time=0.2")
    host = shop.start(
        verb, file, "--line", line, *FAST, *told, *(() if "--protocol" in words else ("--set", "posting=off"))
    )
    ended = control.finish()
    host.finish()
    return ended.outcome, [event["text"] for event in ended.named("notice")] + [ended.end["reason"]]


def test_keys_are_pressed_and_the_program_goes_on_by_itself(shop: Shop) -> None:
    words = ("--press", "single-block@0", "--press", "single-block@0.2s", "--stand", 0.1)
    outcome, told = with_host(shop, "send", "--protocol", "fanuc-b", *words)
    assert outcome == (0, "complete")
    assert "pressed: single-block" in told
    assert any("stands: program stop (M00, M01), after 22 blocks" in text for text in told)


def test_8_2_reading_tells_what_is_registered(shop: Shop) -> None:
    parameters = shop.file("in-parameters", PARAMETERS.encode())
    outcome, told = with_host(shop, "send", "--parameters", parameters, "--operation", "read")
    assert outcome == (0, "complete")
    assert "registered O0001" in told


def test_blocks_take_what_their_feed_and_their_dwells_say(shop: Shop) -> None:
    """100 mm at F6000, then G04 X.5: a second and a half at the feed as programmed, the dwell whatever the override."""
    text, saved = b"%\nO1\nG91G01X50.F6000\nX50.\nG04X.5\nM30\n%", shop.folder / "taken"
    seconds = {}
    for percent, protocol in ((100, "fanuc-b"), (200, "fanuc-a")):
        line = shop.folder / f"control-{percent}"
        file = shop.file("in.nc", text)
        settings = ("--set", "data=eia") if protocol == "fanuc-a" else ("--set", "code=iso")
        words = ("--line", f"pty:{line}", *FAST, "--json", "--protocol", protocol, "--feed-override", percent)
        control = shop.start("cnc", *words, "--save", saved, *settings)
        control.wait_for("ready")
        shop.start("send", file, "--line", line, *FAST, "--protocol", protocol, *settings)
        ended = control.finish()
        assert ended.outcome == (0, "complete")
        began = ended.named("started")[0]["time_ns"]
        seconds[percent] = (ended.end["time_ns"] - began) / 1e9
    assert seconds[100] >= 1.5
    assert seconds[200] >= 1.0


def test_11_ps10_fails_the_operation(shop: Shop) -> None:
    line = shop.folder / "control"
    file = shop.file("in.nc", b"%\nO1\nX1.\nG123\nM30\n%")
    control = shop.start("cnc", "--line", f"pty:{line}", *FAST, "--json", "--protocol", "fanuc-b", "--check-blocks")
    control.wait_for("ready")
    shop.start("send", file, "--line", line, *FAST, "--protocol", "fanuc-b")
    ended = control.finish()
    assert ended.outcome == (1, "failed")
    assert [event["number"] for event in ended.named("alarm")] == ["PS10"]


def test_1_2_parameters_are_punched_in_the_background(shop: Shop) -> None:
    parameters = shop.file("in-parameters", PARAMETERS.encode())
    words = ("--parameters", parameters, "--operation", "punch", "--background")
    outcome, _ = with_host(shop, "receive", *words)
    assert outcome == (0, "complete")
    lines = (shop.folder / "back").read_text().splitlines()
    assert lines == ["%", *PARAMETERS.splitlines(), "%"]


@pytest.mark.parametrize(
    ("number", "words", "told"),
    [
        ("N0020 P10", (), "No. 0020 is 4"),
        ("N0021 P10", ("--operation", "punch"), "No. 0021 is 4"),
        ("N0020 P10", ("--operation", "read"), "No. 0020 is 4"),
    ],
)
def test_10_1_another_device_is_refused_before_anything_is_opened(
    shop: Shop, number: str, words: tuple[str, ...], told: str
) -> None:
    text = PARAMETERS.replace(number, number.replace("P10", "P4"))
    parameters = shop.file("in-parameters", text.encode())
    refused = invoke("cnc", "--line", f"pty:{shop.folder}/control", "--parameters", parameters, *words)
    assert (refused.status, told in refused.stderr) == (2, True)
    assert shop.files == set()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--press", "push@3"), "push@3: KEY@BYTES or KEY@SECONDSs is expected"),
        (("--background",), "DNC operation runs in the foreground"),
        (("--operation", "punch"), "--operation punch needs --file"),
        (("--stand", "nan"), "nan is no number"),
        (("--stand", "-1"), "--stand"),
        (("--panel", "--press", "hold@3"), "--press does not go with --panel"),
        (("--panel", "--stand", "3"), "--stand does not go with --panel"),
        (("--panel", "--background"), "--background does not go with --panel"),
    ],
)
def test_options_that_make_no_sense(shop: Shop, words: tuple[str, ...], told: str) -> None:
    refused = invoke("cnc", "--line", f"pty:{shop.folder}/control", "--protocol", "fanuc-b", *words)
    assert (refused.status, told in refused.stderr) == (2, True), refused.stderr
    assert shop.files == set()
