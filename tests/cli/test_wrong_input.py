"""What is asked for wrongly is refused in a line that says what to do, before anything is opened or left behind."""

from __future__ import annotations

import os
import shlex
import socket
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.cli.helpers import Finished, Shop, invoke, printed, program

NOWHERE = ("--line", "socket://127.0.0.1:9", "--protocol", "fanuc-b", "--json")
LISTEN = ("--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b", "--json")


def refused(finished: Finished, *words: str, status: int = 2) -> None:
    """It never began: the right status, one line of text that holds `words`, and the same reason in the stream."""
    assert finished.outcome == (status, "failed"), finished.stderr
    assert [event["event"] for event in finished.events] == ["end"]
    assert (finished.end["bytes"], finished.end["bytes_handed"]) == (0, 0)
    told = [line for line in finished.stderr.splitlines() if line.startswith(("tapewire: ", "Error: "))]
    assert len(told) == 1, finished.stderr
    for word in words:
        assert word in told[0]
        assert word in finished.end["reason"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["empty"]),
        (b"%\n\n \n%", ["no block"]),
        (b"%\nO1\nG0X1\x00\nM30\n%", ["line 3, column 5", "NUL"]),
        (b"%\nO1\n\x13G0X1\nM30\n%", ["line 3, column 1", "DC3"]),
        (b"%\rO1\rM30\r%", ["CR", "LF"]),
        (b"%\nO1\n(50% DONE)\nM30\n%", ["line 3, column 4", "%"]),
        (b"%\nO1\n(D\xe9BUT)\nM30\n%", ["line 3, column 3"]),
        (b"%\nO1\nG05\nM30\n%", ["line 3", "G05", "--raw"]),
    ],
)
def test_a_program_that_cannot_be_sent(shop: Shop, content: bytes, words: list[str]) -> None:
    file = shop.file("in.nc", content)
    refused(invoke("send", file, *NOWHERE), str(file), *words)
    assert shop.files == set()


@pytest.mark.parametrize(
    ("protocol", "content", "words"),
    [
        ("fanuc-a", b"%\n" + b"G01X1.\n" * 900 + b"\r\nM30\n%", ["byte 6,303", "0Dh", "end code"]),
        ("fanuc-a-expansion", b"%\n" + b"G01X1.\n" * 900, ["no EOR", "packets of 1024"]),
    ],
)
def test_a_raw_program_that_its_protocol_cannot_carry(
    shop: Shop, protocol: str, content: bytes, words: list[str]
) -> None:
    file = shop.file("in.nc", content)
    line = ("--line", "/dev/tapewire-is-not-there", "--protocol", protocol, "--json")
    refused(invoke("send", file, "--raw", *line), *words)


def test_a_file_that_cannot_be_read(shop: Shop) -> None:
    missing = shop.folder / "missing.nc"
    refused(invoke("send", missing, *NOWHERE), str(missing), "No such file")
    refused(invoke("send", shop.folder, *NOWHERE), str(shop.folder), "directory")
    refused(invoke("cnc", "--operation", "punch", "--file", missing, *NOWHERE), str(missing))


def test_a_file_without_the_right_to_read_it() -> None:
    """To root every file is readable, so root runs the command as somebody else."""
    nobody = 65534 if os.getuid() == 0 else os.getuid()
    code = f"import os, sys, tapewire.cli.send; os.setuid({nobody}); tapewire.cli.main(sys.argv[1:])"
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        file = Path(folder) / "secret.nc"
        file.write_bytes(program(1))
        file.chmod(0)
        command = [sys.executable, "-c", code, "send", str(file), "--line", "/dev/ttyS0", "--protocol", "fanuc-b"]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr == f"tapewire: {file}: cannot be read (Permission denied)\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--line", "socket://127.0.0.1:9", "--protocol", "fanuc-z"], ["fanuc-z", "fanuc-b-expansion"]),
        (["--line", "nowhere", "--protocol", "fanuc-b"], ["nowhere", "socket://HOST:PORT"]),
        (["--line", "socket://127.0.0.1:99999", "--protocol", "fanuc-b"], ["99999"]),
        (["--line", "socket://127.0.0.1:0", "--protocol", "fanuc-b"], ["port 0"]),
        (["--line", "pty:", "--protocol", "fanuc-b"], ["pty:"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--set", "postin=on"], ["postin", "posting"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--set", "posting=maybe"], ["posting=maybe", "on off"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--set", "posting"], ["KEY=VALUE"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--set", "closing_time=nan"], ["closing_time=nan"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--set", "overrun=600"], ["overrun", "control"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--nonsense"], ["--nonsense"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--baud", "9"], ["baud"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--stopbits", "3"], ["stopbits"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--timeout", "0"], ["timeout"]),
        (["--line", "/dev/ttyS0", "--protocol", "fanuc-b", "--timeout", "soon"], ["timeout"]),
        (["--protocol", "fanuc-b"], ["--line"]),
        (["--line", "/dev/ttyS0"], ["--protocol"]),
    ],
)
def test_an_option_that_means_nothing(shop: Shop, words: list[str], told: list[str]) -> None:
    file = shop.file("in.nc", program(1))
    refused(invoke("send", file, *words, "--json"), *told)


def test_a_command_that_is_not_there(shop: Shop) -> None:
    refused(invoke("sned", "--json"), "sned")
    refused(invoke("--json"), "--json")
    refused(invoke("send", *NOWHERE), "FILE")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--operation", "punch"], ["--file"]),
        (["--file", "in.nc"], ["--operation punch"]),
        (["--operation", "lathe"], ["lathe"]),
        (["--blocks-per-second", "0"], ["blocks-per-second"]),
        (["--blocks-per-second", "nan"], ["blocks-per-second"]),
        (["--blocks-per-second", "1e-300"], ["blocks-per-second"]),
        (["--timeout", "nan"], ["timeout"]),
        (["--reset-after", "0"], ["reset-after"]),
        (["--alarm-after", "-1"], ["alarm-after"]),
        (["--set", "closing_time=1"], ["closing_time", "host"]),
    ],
)
def test_cnc_options_that_do_not_go_together(shop: Shop, words: list[str], told: list[str]) -> None:
    refused(invoke("cnc", *NOWHERE, *words), *told)
    assert shop.files == set()


def test_a_punch_has_nothing_to_save(shop: Shop) -> None:
    file, save = shop.file("in.nc", program(1)), shop.folder / "saved.nc"
    refused(invoke("cnc", "--operation", "punch", "--file", file, "--save", save, *NOWHERE), "--save")
    assert shop.files == set()


def test_a_line_that_cannot_be_opened(shop: Shop) -> None:
    file = shop.file("in.nc", program(1))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        busy = f"listen://127.0.0.1:{taken.getsockname()[1]}"
        for words in (["send", file], ["receive", shop.folder / "got.nc"], ["cnc", "--save", shop.folder / "saved.nc"]):
            for line, told in [
                (busy, "another program has this port"),
                ("/dev/tapewire-is-not-there", "No such file"),
                (file, "not a serial port"),
                ("/dev/null", "not a serial port"),
                (f"pty:{file}", "exists"),
                (f"pty:{shop.folder}/no/folder", "No such file"),
            ]:
                command = invoke(*words, "--line", line, "--protocol", "fanuc-b", "--json")
                refused(command, str(line).removeprefix("pty:"), told, status=1)
                assert shop.files == set(), words


def test_nothing_is_lost_by_a_line_that_cannot_be_opened(shop: Shop) -> None:
    got, part, saved = (shop.file(name, b"precious") for name in ("got.nc", "got.nc.part", "saved.nc"))
    line = ("--line", "/dev/tapewire-is-not-there", "--protocol", "fanuc-b", "--json")
    refused(invoke("receive", got, "--force", *line), status=1)
    refused(invoke("cnc", "--save", saved, *line), status=1)
    assert [path.read_bytes() for path in (got, part, saved)] == [b"precious"] * 3


def test_a_refused_connection_is_tried_for_five_seconds(shop: Shop) -> None:
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    file = shop.file("in.nc", program(1))
    line = ("--line", f"socket://127.0.0.1:{port}", "--protocol", "fanuc-b", "--json")
    commands = [shop.start("send", file, *line), shop.start("receive", shop.folder / "got.nc", *line)]
    for command in commands:
        refused(command.finish(), f"127.0.0.1:{port}", "nobody listens", status=1)
    assert shop.files == set()


@pytest.mark.parametrize("name", ["x" * 300, "x" * 254, ".", "..", "/", "no/folder/got.nc", ""])
def test_a_file_that_cannot_be_written(shop: Shop, name: str) -> None:
    path = shop.folder / name if name.strip("./") else name
    refused(invoke("receive", path, "--force", *LISTEN))
    if name.strip("./") != "x" * 254:
        refused(invoke("cnc", "--save", path, *LISTEN))
    assert shop.files == set()


def test_an_existing_file_is_refused_and_left_alone(shop: Shop) -> None:
    got = shop.file("got.nc", b"precious")
    refused(invoke("receive", got, *LISTEN), str(got), "exists", "--force")
    assert got.read_bytes() == b"precious"
    assert shop.files == {"got.nc"}


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        (["send", "missing.nc", *NOWHERE], 2, "No such file"),
        (["cnc", "--nonsense"], 2, "--nonsense"),
        (["receive", "got.nc", "--line", "/dev/tapewire-is-not-there", "--protocol", "fanuc-b"], 1, "No such file"),
    ],
)
def test_the_exit_status_of_a_process(shop: Shop, words: list[str], status: int, told: str) -> None:
    """Without a stream in the way: what a shell script sees."""
    finished = shop.run(*words)
    assert finished.status == status
    assert told in finished.stderr.splitlines()[-1]


def test_an_output_that_was_closed_before_the_start(shop: Shop) -> None:
    """Cron jobs and shell scripts do that: the command does its work, and says it where it can."""
    words = [sys.executable, "-m", "tapewire", "cnc", *LISTEN, "--timeout", "0.1"]
    for closed, other in (("1>&-", "stderr"), ("2>&-", "stdout"), ("1>&- 2>&-", "")):
        run = subprocess.run(f"{shlex.join(words)} {closed}", shell=True, capture_output=True, text=True, check=False)
        assert run.returncode == 1
        assert "Traceback" not in run.stderr
        if other:
            assert "not complete within 0.1 s" in getattr(run, other)


def test_an_output_whose_reader_has_gone(shop: Shop) -> None:
    file = shop.file("in.nc", program(1))
    for words in (["send", file, "--line", "nowhere", "--protocol", "fanuc-b"], ["cnc", *LISTEN, "--timeout", "0.1"]):
        read, write = os.pipe()
        os.close(read)
        command = [sys.executable, "-m", "tapewire", *map(str, words), "--json"]
        with open(write, "wb") as pipe:
            run = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, text=True, check=False)
        assert run.returncode == (2 if "nowhere" in words else 1)
        assert "Traceback" not in run.stderr
        assert "BrokenPipe" not in run.stderr


def test_force_replaces_no_device(tmp_path: Path) -> None:
    """A FIFO stands for any of them: whoever may write to /dev may put a file in the place of /dev/null."""
    program_file, out = tmp_path / "in.nc", tmp_path / "device"
    program_file.write_bytes(b"%\nO1\nG91G01X1.F100\nM30\n%\n")
    os.mkfifo(out)
    commands = (
        ("receive", out, "--line", tmp_path / "none", "--protocol", "fanuc-b", "--force"),
        ("convert", program_file, out, "--to", "iso", "--force"),
        ("g05", "encode", program_file, out, "--force"),
    )
    for words in commands:
        finished = printed(*words)
        assert finished.status == 2, finished.stderr
        assert "is no file and is not replaced" in finished.stderr
        assert stat.S_ISFIFO(out.lstat().st_mode)
