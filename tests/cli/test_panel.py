"""`tapewire cnc --panel` in a real terminal: keys in, screen out."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from random import Random

import pytest

from tapewire.engine import Outcome
from tapewire.protocols import PROTOCOLS
from tests.cli.helpers import Shop, invoke, program
from tests.cli.hosts import HostJob, receiving, sending
from tests.cli.terminal import Terminal

LONG = program(2000)
"""Longer than the buffer: the control is still asking for it when the cable goes."""

_PORT = re.compile(r"listen://(127\.0\.0\.1:[1-9]\d*)")

PUNCHING = [name for name, entry in PROTOCOLS.items() if entry.punches_out and name != "bridgeport"]


def panel(folder: Path, *words: object, protocol: str = "fanuc-b", columns: int = 80, lines: int = 24) -> Terminal:
    line = ("--line", f"pty:{folder}/control", "--panel")
    told = () if "--parameters" in words else ("--protocol", protocol)
    start = ("--set", "start_time=0.1") if protocol.startswith("fanuc-a") else ()
    return Terminal("cnc", *line, *told, *start, *words, columns=columns, lines=lines)


def sender(shop: Shop, file: Path, protocol: str = "fanuc-b") -> HostJob:
    return sending(file, shop.folder / "control", protocol)


def wait_for_another_line(terminal: Terminal) -> None:
    """The host has let go of the line; the control has seen it, and counts anew on another one."""
    terminal.wait(lambda text: " open" in text and not re.search(r"PROGRAM [\d,]+ bytes", text))


def restored(terminal: Terminal) -> bool:
    return (terminal.screen.which, terminal.screen.cursor, terminal.modes) == ("main", "shown", terminal.modes_before)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_one_operation_after_another(shop: Shop, protocol: str) -> None:
    file, saved = shop.file("in.nc", program(6)), shop.folder / "saved"
    ask = ("--program", "1") if protocol == "bridgeport" else ()
    with panel(shop.folder, "--blocks-per-second", 15, "--save", saved, *ask, protocol=protocol) as terminal:
        terminal.wait_for("waiting for the control" if protocol != "bridgeport" else "RECEIVE BUFFER", "[C]", "open")
        host = sender(shop, file, protocol)
        terminal.press("c")
        terminal.wait_for("MTN", "RMT   STRT")
        terminal.wait_for("dnc complete", "RMT   ****")
        assert host.outcome() is Outcome.COMPLETE
        wait_for_another_line(terminal)
        terminal.press("p")
        if protocol in PUNCHING:
            terminal.wait_for("the program memory is empty")
        elif protocol == "bridgeport":
            terminal.wait_for("--file names a program")
        else:
            terminal.wait_for(f"{protocol} has no punch-out")
        host = sender(shop, file, protocol)
        terminal.press("i")
        terminal.wait_for("registered O0001" if protocol != "bridgeport" else "", "read complete", "EDIT  ****")
        assert host.outcome() is Outcome.COMPLETE
        assert saved.stat().st_size > file.stat().st_size
        wait_for_another_line(terminal)
        if protocol in PUNCHING:
            punch_out_of_the_memory(shop, terminal, protocol, file)
        terminal.press("q")
        assert terminal.end() == 0
        assert restored(terminal)


def punch_out_of_the_memory(shop: Shop, terminal: Terminal, protocol: str, file: Path) -> None:
    back = shop.folder / "back.nc"
    host = receiving(back, shop.folder / "control", protocol)
    terminal.press("p")
    terminal.wait_for("punch complete", "EDIT  ****")
    assert host.outcome() is Outcome.COMPLETE
    assert back.read_bytes().split() == file.read_bytes().split()


def test_hold_single_block_and_a_pulled_cable(shop: Shop) -> None:
    file = shop.file("in.nc", LONG)
    with panel(shop.folder, "--blocks-per-second", 50, columns=120, lines=40) as terminal:
        terminal.wait_for("open")
        host = sender(shop, file)
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
        assert host.outcome() is Outcome.FAILED
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


def test_quitting_in_the_middle_gives_up(shop: Shop) -> None:
    file = shop.file("in.nc", LONG)
    with panel(shop.folder) as terminal:
        terminal.wait_for("open")
        host = sender(shop, file)
        terminal.press("c")
        terminal.wait_for("MTN")
        terminal.press("q")
        assert terminal.end() == 1
        assert restored(terminal)
        assert "dnc: cancelled" in terminal.screen.text
        assert host.outcome() is not Outcome.COMPLETE


def test_a_listening_control_keeps_its_port_whatever_is_pressed(shop: Shop) -> None:
    file = shop.file("in.nc", program(9))
    words = ("--line", "listen://127.0.0.1:0", "--protocol", "fanuc-a", "--set", "start_time=0.1")
    with Terminal("cnc", *words, "--panel") as terminal:
        text = terminal.wait(_PORT.search)
        terminal.press("chrsr")
        terminal.wait_for("there is nobody on the line")
        terminal.press("s")
        found = _PORT.search(text)
        assert found is not None
        host = sending(file, f"socket://{found[1]}", "fanuc-a")
        terminal.wait_for(" open")
        terminal.press("c")
        terminal.wait_for("dnc complete", "RMT   ****")
        assert host.outcome() is Outcome.COMPLETE
        terminal.press("q")
        assert terminal.end() == 0


def test_what_cannot_be_stored_is_told_and_not_complete(shop: Shop) -> None:
    file = shop.file("in.nc", program(9))
    with panel(shop.folder, "--save", "/dev/full") as terminal:
        terminal.wait_for(" open")
        host = sender(shop, file)
        terminal.press("c")
        terminal.wait_for("/dev/full: cannot be stored", "dnc complete")
        assert host.outcome() is Outcome.COMPLETE
        terminal.press("q")
        assert terminal.end() == 1


def test_ctrl_c_ends_it_with_130_and_a_whole_terminal(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        assert not restored(terminal)
        terminal.press("\x03")
        assert terminal.end() == 130
        assert restored(terminal)


def test_other_sizes_keys_that_mean_nothing_and_sigterm(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        terminal.resize(120, 40)
        terminal.wait(lambda text: "[Q]" in text.split("\n")[39] and len(text.split("\n")[0]) > 110)
        terminal.press("\x1b[A\x1bOPxyz 7\x1a\x13\x1c")
        terminal.resize(60, 20)
        terminal.wait_for("60x20 is too small")
        terminal.resize(80, 24)
        terminal.wait(lambda text: "[Q]" in text.split("\n")[23])
        terminal.send_signal(signal.SIGTERM)
        assert terminal.end() == 130
        assert restored(terminal)


def test_the_parameters_of_a_control_make_its_line(shop: Shop) -> None:
    told = "N0000 P00001100\nN5000 P00011000\nN5081 P3\nN5082 P2\nN5083 P11\nN5084 P1\n"
    file = shop.file("parameters", told.encode())
    with panel(shop.folder, "--parameters", file) as terminal:
        terminal.wait_for("protocol B", "9600 baud, 8N2", "5084=1  5083=11  5082=2", "5000=00011000  5081=3")
        terminal.press("q")
        assert terminal.end() == 1


BAD = "N0000 P00001100\nN0020 P10\nN5000 P00010000\nN5081 P3\nN5082 P1\nN5083 P12\nN5084 P9\n"


def test_11_sr807_is_shown_and_the_parameters_are_mended_on_the_panel(shop: Shop) -> None:
    """5084 waits for power off and on (10.2), 5083 does not with protocol B and 5000#3 = 0. Then another protocol."""
    parameters, file = shop.file("in-parameters", BAD.encode()), shop.file("in.nc", program(6))
    with panel(shop.folder, "--parameters", parameters, columns=120, lines=40) as terminal:
        terminal.wait_for("open", "[N]")
        for key in "cip":
            terminal.press(key)
            terminal.wait_for("SR807  PARAMETER SETTING ERROR", "No. 5084 (RS-232-C: protocol) is 9: 1 to 3")
            terminal.press("r")
            terminal.wait_for("MESSAGE")
        terminal.press("n")
        terminal.wait_for("PARAMETER 1/1", "5084        9 RS-232-C: protocol", "[ENTER]", "[W]")
        terminal.press("5084=1\n")
        terminal.wait_for("No. 5084 takes effect after power off and on", "power off and on, till then 9")
        terminal.press("c")
        terminal.wait_for("SR807")
        terminal.press("rw")
        terminal.wait_for("5084        1 protocol B", "19200 baud")
        terminal.press("5083=11\r")
        terminal.wait_for("No. 5083 takes effect at once", "9600 baud, 8E1", " open")
        host = sending(file, shop.folder / "control", "fanuc-b", baud=9600, settings={"posting": "off"})
        terminal.press("nc")
        terminal.wait_for("dnc complete", "RMT   ****", "PROGRAM")
        assert host.outcome() is Outcome.COMPLETE
        wait_for_another_line(terminal)
        terminal.press("n5084=3\nw")
        terminal.wait_for("protocol A  ", "PMC", " open", "9600 baud")
        host = sending(file, shop.folder / "control", "fanuc-a", baud=9600)
        terminal.press("nc")
        terminal.wait(lambda text: text.count("dnc complete") == 2 and "RMT   ****" in text)
        assert host.outcome() is Outcome.COMPLETE
        terminal.press("q")
        assert terminal.end() == 0


@pytest.mark.parametrize(("columns", "lines"), [(80, 24), (120, 40)])
def test_10_what_cannot_be_entered_is_told(shop: Shop, columns: int, lines: int) -> None:
    file = shop.file("in-parameters", BAD.replace("P9", "P1").encode())
    with panel(shop.folder, "--parameters", file, columns=columns, lines=lines) as terminal:
        terminal.wait_for("open")
        terminal.press("n")
        for typed, told in (
            ("9999=1", "No. 9999 is no parameter of the remote buffer"),
            ("5000=2", "No. 5000 is of bit type"),
            ("0000=00100000", "No. 0000#5 is 1: this bit must always be 0"),
            ("2010=-1", "is -1: 0 to 32767 is expected"),
            ("5083=123456789", "No. 5083 takes effect at once"),
            ("==--==", "NUMBER=VALUE is expected"),
            ("", "nothing: NUMBER=VALUE is expected"),
            ("0" * 99, "0: NUMBER=VALUE is expected"),
            ("508\x7f\x7f\x7f\x7f5083=12", "No. 5083 takes effect at once"),
        ):
            terminal.press("r" + typed + "\n")
            terminal.wait_for(told)
        while "PARAMETER" in terminal.screen.text:
            terminal.press("n")
            terminal.read(0.3)
        terminal.press("q")
        assert terminal.end() == 1


def test_1_2_parameters_are_punched_from_their_page_and_6_4_stop(shop: Shop) -> None:
    file = shop.file("in-parameters", BAD.replace("P9", "P1").encode())
    back = shop.folder / "back.txt"
    with panel(shop.folder, "--parameters", file) as terminal:
        terminal.wait_for("open")
        host = receiving(back, shop.folder / "control", "fanuc-b", settings={"posting": "off"})
        terminal.press("nbp")
        terminal.wait_for("punch complete")
        assert host.outcome() is Outcome.COMPLETE
        assert back.read_bytes().split(b"\n")[1:3] == [b"N0000 P00001100", b"N0020 P10"]
        terminal.press("t0022=4\nbbi")
        terminal.wait_for("ALARM", "SR807  PARAMETER SETTING ERROR: No. 0022 is 4: this control has the re")
        terminal.press("r0022=10\nq")
        assert terminal.end() == 0


def test_6_4_note_1_reset_in_the_background_says_why_it_ends_nothing_and_stop_does(tmp_path: Path) -> None:
    with panel(tmp_path) as terminal:
        terminal.wait_for("open")
        terminal.press("bi")
        terminal.wait_for("INPUT")
        terminal.press("r")
        terminal.wait_for("in the background RESET ends no communication that posts", "INPUT")
        terminal.press("t")
        terminal.wait_for("read cancelled")
        terminal.wait(lambda text: "INPUT" not in text)
        terminal.press("q")
        assert terminal.end() == 1


def test_parameters_stand_in_for_the_protocol_without_a_panel(shop: Shop) -> None:
    wrong = shop.file("in-wrong", b"N5000 P0\nN5082 P1\nN5083 P11\nN5084 P9\n")
    refused = invoke("cnc", "--line", f"pty:{shop.folder}/control", "--parameters", wrong)
    assert refused.status == 2
    assert "SR807" in refused.stderr
    missing = invoke("cnc", "--line", f"pty:{shop.folder}/control")
    assert (missing.status, "--protocol is missing" in missing.stderr) == (2, True)


def test_whatever_is_pressed_in_whatever_size_it_can_be_left(shop: Shop) -> None:
    """Keys without sense while a host sends, in terminals that nobody has."""
    chance = Random(5)
    parameters, file = shop.file("in-parameters", BAD.replace("P9", "P1").encode()), shop.file("in.nc", LONG)
    words = ("--parameters", parameters, "--save", shop.folder / "saved", "--capture", shop.folder / "capture.pcapng")
    with panel(shop.folder, *words) as terminal:
        terminal.wait_for("open")
        sending(file, shop.folder / "control", "fanuc-b", settings={"posting": "off"})
        for size in ((20, 5), (1, 1), (3, 90), (240, 2), (133, 70), (80, 24)):
            terminal.resize(*size)
            for _ in range(8):
                terminal.press("".join(chance.choices("chrsoiptbuwnCHR0123456789=-\n\x7f\t\x04xyz \x1b[A", k=9)))
                terminal.read(0.02)
        terminal.wait(lambda text: "[Q]" in text.split("\n")[23])
        terminal.press("\nq")
        assert terminal.end() in (0, 1)
        assert restored(terminal)


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
