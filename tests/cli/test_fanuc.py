"""`tapewire fanuc`: what it prints, and its exit statuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from tapewire.line.captures.records import Encoder, Happening, Origin, Record, Side
from tests.cli.helpers import printed

PARAMETERS = "%\nN0000 P00000100\nN5000 P00011001\nN5070 P13\nN5071 P3\nN5072 P1\nN5073 P11\nN5074 P1\nN6000 P1\n%\n"


@pytest.fixture
def params(tmp_path: Path) -> Path:
    path = tmp_path / "params.txt"
    path.write_text(PARAMETERS)
    return path


def test_host_settings_prints_the_commands(params: Path) -> None:
    told = printed("fanuc", "host-settings", params)
    words = "--protocol fanuc-b --baud 9600 --stopbits 1 --set code=iso --set posting=on --set data=ascii"
    assert told.stdout == f"tapewire send FILE --line LINE {words}\ntapewire receive FILE --line LINE {words}\n"
    assert told.status == 0


def test_host_settings_with_a_warning_is_not_complete(params: Path) -> None:
    told = printed("fanuc", "host-settings", params, "--cable-length", "801")
    assert told.status == 1
    assert "warning: a cable of 801 m: RS-422 at 9600 baud goes to 800 m (2.1)" in told.stderr


def test_host_settings_says_sr807(params: Path) -> None:
    params.write_text(PARAMETERS.replace("N5073 P11", "N5073 P16"))
    told = printed("fanuc", "host-settings", params)
    assert (told.status, told.stdout) == (2, "")
    assert "SR807: No. 5073" in told.stderr


@pytest.mark.parametrize("content", [b"\x00\xff", b"", b"N5074", "Ä".encode()])
def test_a_file_that_holds_no_parameters_is_refused(params: Path, content: bytes) -> None:
    params.write_bytes(content)
    for command in ("host-settings", "parameters"):
        told = printed("fanuc", command, params)
        assert told.status == 2
        assert str(params) in told.stderr


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    assert printed("fanuc", "parameters", tmp_path / "gone").status == 2
    assert printed("fanuc", "parameters", tmp_path).status == 2


def test_parameters_in_every_form(params: Path) -> None:
    assert "5074 RS-422: protocol: 1 protocol B" in printed("fanuc", "parameters", params).stdout
    toml = printed("fanuc", "parameters", params, "--to", "toml").stdout
    assert '5000 = "00011001"' in toml
    params.write_text(toml)
    assert printed("fanuc", "parameters", params, "--to", "punch").stdout == PARAMETERS.replace("N6000 P1\n", "")


def test_alarm_explains(params: Path) -> None:
    told = printed("fanuc", "alarm", "sr 0945")
    assert told.stdout.startswith("SR945 COMMUNICATION ERROR (RMT-BUF)\n")
    assert told.status == 0
    assert printed("fanuc", "alarm", "SR999").status == 2


@pytest.mark.parametrize(
    ("words", "status", "case"),
    [
        ((), 1, "not known yet"),
        (("--alarm", "856"), 0, "the host"),
        (("--green", "off,on", "--read-pointer", "1F", "--write-pointer", "20"), 0, "the NC"),
        (("--red", "2"), 0, "the board"),
    ],
)
def test_diagnose_names_the_case(words: tuple[str, ...], status: int, case: str) -> None:
    told = printed("fanuc", "diagnose", *words)
    assert told.status == status
    assert f"case: {case}\n  1. " in told.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("--green", "purple"),
        ("--read-pointer", "1"),
        ("--read-pointer", "1", "--write-pointer", "x"),
        ("--read-pointer", "1", "--write-pointer", "-1"),
        ("--read-pointer", "1", "--write-pointer", "123456789"),
        ("--alarm", "1"),
        ("--red", "4"),
        ("--capture", "gone"),
        ("--params", "gone"),
    ],
)
def test_diagnose_refuses_what_nobody_can_have_seen(words: tuple[str, ...]) -> None:
    assert printed("fanuc", "diagnose", *words).status == 2


@pytest.mark.parametrize(("side", "case"), [(Side.HOST, "the host"), (Side.CONTROL, "the line")])
def test_diagnose_reads_a_capture(tmp_path: Path, side: Side, case: str) -> None:
    """What the writer of the capture received came from the control, or from the host."""
    capture = tmp_path / "a.pcapng"
    encoder = Encoder()
    asked = Record(at=1_000_000_000, what=Happening.RECEIVED, data=b"\x11")
    capture.write_bytes(encoder.header(Origin(side=side)) + encoder.record(asked))
    assert f"case: {case}" in printed("fanuc", "diagnose", "--capture", capture).stdout


def test_host_settings_prints_the_simulated_control_of_the_same_parameters(params: Path) -> None:
    """And `tapewire cnc` takes it: only the LINE is refused."""
    told = printed("fanuc", "host-settings", params, "--simulated")
    command = told.stdout.splitlines()[-1]
    assert command == (
        "tapewire cnc --line LINE --protocol fanuc-b --baud 9600 --stopbits 1 "
        "--set data=ascii --set cd=off --set code=iso --set posting=on"
    )
    refused = printed(*command.replace("LINE", "nowhere:1").split()[1:])
    assert "nowhere:1" in refused.stderr
    assert "--set" not in refused.stderr
