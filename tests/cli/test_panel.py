"""`tapewire cnc --panel` in a real terminal: keys in, screen out."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest

from tapewire.protocols import PROTOCOLS
from tests.cli.helpers import Command, Shop, invoke, program
from tests.cli.terminal import Terminal

LONG = program(2000)
"""Longer than the buffer: the control is still asking for it when the cable goes."""

_PORT = re.compile(r"listen://(127\.0\.0\.1:[1-9]\d*)")

PUNCHING = [name for name, entry in PROTOCOLS.items() if entry.punches_out and name != "bridgeport"]


def panel(folder: Path, *words: object, protocol: str = "fanuc-b", columns: int = 80, lines: int = 24) -> Terminal:
    line = ("--line", f"pty:{folder}/control", "--panel")
    told = () if "--parameters" in words else ("--protocol", protocol)
    return Terminal("cnc", *line, *told, *words, columns=columns, lines=lines)


def host(shop: Shop, verb: str, file: Path, *words: object, protocol: str = "fanuc-b") -> Command:
    return shop.start(verb, file, "--line", shop.folder / "control", "--protocol", protocol, "--json", *words)


def restored(terminal: Terminal) -> bool:
    return (terminal.screen.which, terminal.screen.cursor, terminal.modes) == ("main", "shown", terminal.modes_before)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_one_program_after_another_is_executed(shop: Shop, protocol: str) -> None:
    file = shop.file("in.nc", program(12))
    ask = ("--program", "1") if protocol == "bridgeport" else ()
    with panel(shop.folder, "--blocks-per-second", 15, *ask, protocol=protocol) as terminal:
        terminal.wait_for("waiting for the control" if protocol != "bridgeport" else "RECEIVE BUFFER", "[C]", "open")
        for _ in range(2):
            sender = host(shop, "send", file, protocol=protocol)
            sender.wait_for("ready")
            terminal.press("c")
            terminal.wait_for("MTN", "RMT   STRT")
            terminal.wait_for("dnc complete", "RMT   ****")
            assert sender.finish().outcome == (0, "complete")
            terminal.wait_for("open")
        terminal.press("q")
        assert terminal.end() == 0
        assert restored(terminal)


def test_hold_single_block_and_a_pulled_cable(shop: Shop) -> None:
    file = shop.file("in.nc", LONG)
    with panel(shop.folder, "--blocks-per-second", 50, columns=120, lines=40) as terminal:
        terminal.wait_for("open")
        sender = host(shop, "send", file)
        sender.wait_for("ready")
        terminal.press("c")
        terminal.wait_for("> N")
        terminal.press("h")
        text = terminal.wait_for("RMT   HOLD  ***", "feed hold")
        block = next(line for line in text.splitlines() if "> N" in line)
        terminal.press("sc")
        text = terminal.wait_for("RMT   STOP  ***", "single block")
        assert block not in text
        terminal.press("u")
        terminal.wait_for("ALARM", "SR855  DATA SET READY DOWN", "ALM", "UNPLUGGED", "PLUG ", "dnc failed")
        assert sender.finish().status == 1
        terminal.press("c")
        terminal.wait_for("an alarm is on: RESET first")
        terminal.press("r")
        terminal.wait_for("MESSAGE", "RMT   ****", "CYCLE START asks")
        terminal.press("c")
        terminal.wait_for("SR855", "there is nobody on the line")
        terminal.press("ru")
        terminal.wait(lambda text: "UNPLUGGED" not in text)
        terminal.press("q")
        assert terminal.end() == 1
        assert "there is no host" not in terminal.screen.text
        assert restored(terminal)


@pytest.mark.parametrize("protocol", PUNCHING)
def test_what_was_read_into_the_memory_is_punched(shop: Shop, protocol: str) -> None:
    file, back = shop.file("in.nc", program(9)), shop.folder / "back.nc"
    with panel(shop.folder, protocol=protocol) as terminal:
        terminal.wait_for("open")
        terminal.press("p")
        terminal.wait_for("the program memory is empty")
        sender = host(shop, "send", file, protocol=protocol)
        sender.wait_for("ready")
        terminal.press("i")
        terminal.wait_for("registered O0001", "read complete")
        assert sender.finish().outcome == (0, "complete")
        terminal.wait_for("open")
        receiver = host(shop, "receive", back, protocol=protocol)
        receiver.wait_for("ready")
        terminal.press("p")
        terminal.wait_for("punch complete", "EDIT  ****")
        assert receiver.finish().outcome == (0, "complete")
        assert back.read_bytes().split() == file.read_bytes().split()
        terminal.press("q")
        assert terminal.end() == 0


def test_bridgeport_loads_and_links_on_one_panel(shop: Shop) -> None:
    file, saved = shop.file("in.nc", program(9)), shop.folder / "saved"
    words = ("--program", "1", "--save", saved, "--blocks-per-second", 100)
    with panel(shop.folder, *words, protocol="bridgeport") as terminal:
        for key, done in (("i", "read complete"), ("c", "dnc complete")):
            terminal.wait_for("open")
            sender = host(shop, "send", file, protocol="bridgeport")
            sender.wait_for("ready")
            terminal.press(key)
            terminal.wait_for(done)
            assert sender.finish().outcome == (0, "complete")
        assert saved.stat().st_size > file.stat().st_size
        terminal.press("p")
        terminal.wait_for("--file names a program")
        terminal.press("q")
        assert terminal.end() == 0


def test_quitting_in_the_middle_gives_up(shop: Shop) -> None:
    file = shop.file("in.nc", LONG)
    with panel(shop.folder) as terminal:
        terminal.wait_for("open")
        sender = host(shop, "send", file)
        sender.wait_for("ready")
        terminal.press("c")
        terminal.wait_for("MTN")
        terminal.press("q")
        assert terminal.end() == 1
        assert restored(terminal)
        assert "dnc: cancelled" in terminal.screen.text
        assert sender.finish().status == 1


def test_a_listening_control_keeps_its_port_whatever_is_pressed(shop: Shop) -> None:
    file = shop.file("in.nc", program(9))
    with Terminal("cnc", "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-a", "--panel") as terminal:
        text = terminal.wait(_PORT.search)
        terminal.press("chrsr")
        terminal.wait_for("there is nobody on the line")
        terminal.press("s")
        found = _PORT.search(text)
        assert found is not None
        sender = shop.start("send", file, "--line", f"socket://{found[1]}", "--protocol", "fanuc-a", "--json")
        terminal.wait_for(" open")
        terminal.press("c")
        terminal.wait_for("dnc complete")
        assert sender.finish().outcome == (0, "complete")
        terminal.press("q")
        assert terminal.end() == 0


def test_what_cannot_be_stored_is_told_and_not_complete(shop: Shop) -> None:
    file = shop.file("in.nc", program(9))
    with panel(shop.folder, "--save", "/dev/full") as terminal:
        terminal.wait_for(" open")
        sender = host(shop, "send", file)
        sender.wait_for("ready")
        terminal.press("c")
        terminal.wait_for("/dev/full: cannot be stored", "dnc complete")
        assert sender.finish().outcome == (0, "complete")
        terminal.press("q")
        assert terminal.end() == 1


def test_ctrl_c_ends_it_with_130_and_a_whole_terminal(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        assert not restored(terminal)
        terminal.press("\x03")
        assert terminal.end() == 130
        assert restored(terminal)


def test_sigterm_and_keys_that_mean_nothing(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        terminal.press("\x1b[A\x1bOPxyz 7\x1a\x13\x1c")
        terminal.press("s")
        terminal.read(0.5)
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.end() == 130
        assert restored(terminal)


def test_another_size_is_drawn_in_it(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        terminal.resize(120, 40)
        terminal.wait(lambda text: "[Q]" in text.split("\n")[39] and len(text.split("\n")[0]) > 110)
        terminal.resize(60, 20)
        terminal.wait_for("60x20 is too small")
        terminal.resize(80, 24)
        terminal.wait(lambda text: "[Q]" in text.split("\n")[23])
        terminal.press("q")
        assert terminal.end() == 1


def test_the_parameters_of_a_control_make_its_line(shop: Shop) -> None:
    told = "N0000 P00001100\nN5000 P00011000\nN5081 P3\nN5082 P2\nN5083 P11\nN5084 P1\n"
    file = shop.file("parameters", told.encode())
    with panel(shop.folder, "--parameters", file) as terminal:
        terminal.wait_for("protocol B", "9600 baud, 8N2", "5084=1  5083=11  5082=2", "5000=24")
        terminal.press("q")
        assert terminal.end() == 1


def test_parameters_stand_in_for_the_protocol_without_a_panel(shop: Shop) -> None:
    wrong = shop.file("in-wrong", b"N5000 P0\nN5082 P1\nN5083 P11\nN5084 P9\n")
    refused = invoke("cnc", "--line", f"pty:{shop.folder}/control", "--parameters", wrong)
    assert refused.status == 2
    assert "SR807" in refused.stderr
    missing = invoke("cnc", "--line", f"pty:{shop.folder}/control")
    assert (missing.status, "--protocol is missing" in missing.stderr) == (2, True)


def test_no_panel_without_a_terminal(tmp_path: Path) -> None:
    refused = invoke("cnc", "--line", f"pty:{tmp_path}/control", "--protocol", "fanuc-b", "--panel")
    assert refused.status == 2
    assert "--panel needs a terminal" in refused.stderr
    assert not list(tmp_path.iterdir())


def test_no_panel_in_a_terminal_that_is_too_small(tmp_path: Path) -> None:
    with panel(tmp_path, columns=79) as terminal:
        assert terminal.end() == 2
        assert "--panel needs a terminal of 80x24 at least: this one is 79x24" in terminal.screen.text.replace("\n", "")


@pytest.mark.parametrize(
    "words", [("--json",), ("--timeout", 3), ("--reset-after", 9), ("--alarm-after", 9), ("--operation", "read")]
)
def test_what_the_operator_does_himself_is_no_option(tmp_path: Path, words: tuple[object, ...]) -> None:
    refused = invoke("cnc", "--line", f"pty:{tmp_path}/control", "--protocol", "fanuc-b", "--panel", *words)
    assert refused.status == 2
    assert f"{words[0]} does not go with --panel" in refused.stderr


def test_a_line_that_cannot_be_opened_leaves_the_terminal_whole(tmp_path: Path) -> None:
    with Terminal("cnc", "--line", tmp_path / "none", "--protocol", "fanuc-b", "--panel") as terminal:
        assert terminal.end() == 1
        assert restored(terminal)
        assert "/none" in terminal.screen.text.replace("\n", "")
