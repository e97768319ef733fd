"""REMOTE LOAD and DNC LINK between two processes: by file, by number, by profile."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

import pytest

from tapewire.protocols.bridgeport.profile import Profile
from tests.cli.helpers import FAST, Finished, Shop, invoke
from tests.cli.test_transfer import LINES, Line, finish, start

BRIDGEPORT: Final = ("--protocol", "bridgeport", *FAST)
LONG: Final = b"".join(b"N%d G01 X%d.5 Y-%d.25\n" % (n, n % 90, n % 70) for n in range(900))
"""Too long for REMOTE LOAD. Few characters may be in flight, so what does go over the line is short."""
TEXT: Final = LONG[:600].rpartition(b"\n")[0] + b"\n"
SENT: Final = TEXT.replace(b"\n", b"\r\n")
SHORT: Final = LONG[:200].rpartition(b"\n")[0] + b"\n"
NOWHERE: Final = ("--line", "socket://127.0.0.1:9", "--json")


def arrived(sent: Finished, taken: Finished, expected: bytes) -> None:
    for finished in (sent, taken):
        assert finished.outcome == (0, "complete"), (sent.stderr, taken.stderr)
        assert finished.end["bytes"] == finished.end["bytes_handed"] == len(expected)
        assert finished.end["sha256"] == hashlib.sha256(expected).hexdigest()


@pytest.mark.parametrize("line", LINES, ids=str)
def test_a_program_by_dnc_link(shop: Shop, line: Line) -> None:
    file, saved = shop.file("in.nc", TEXT), shop.folder / "saved.nc"
    sent, taken = finish(
        *start(
            shop,
            line,
            host=["send", file, *BRIDGEPORT, "--set", "lrc=auto"],
            cnc=["--save", saved, "--program", "77", *BRIDGEPORT, "--set", "lrc=xor7"],
        )
    )
    arrived(sent, taken, SENT)
    assert saved.read_bytes() == SENT
    assert {"number": "77", "served": True}.items() <= sent.named("requested")[0].items()
    assert "lrc=xor7" in sent.stderr
    assert "CR LF" in sent.stderr


@pytest.mark.parametrize("number", ["1234", "-1"])
def test_a_program_by_remote_load(shop: Shop, number: str) -> None:
    file = shop.file("in.nc", SHORT)
    cnc: list[object] = ["--operation", "read", "--program", number, *BRIDGEPORT, "--set", "parity=software"]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *BRIDGEPORT, "--set", "parity=software"], cnc=cnc))
    arrived(sent, taken, SHORT.replace(b"\n", b"\r\n"))


def test_a_long_program_is_too_long_for_remote_load(shop: Shop) -> None:
    file = shop.file("in.nc", LONG)
    cnc: list[object] = ["--operation", "read", "--timeout", "20", *BRIDGEPORT]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *BRIDGEPORT], cnc=cnc))
    assert sent.outcome == (1, "failed")
    assert "12,000 bytes" in sent.end["reason"]
    assert sent.end["bytes_handed"] == 0
    assert taken.status == 1


def folder(shop: Shop, **files: bytes) -> Path:
    path = shop.folder / "programs"
    path.mkdir()
    for name, content in files.items():
        (path / name.replace("__", ".")).write_bytes(content)
    return path


def test_the_control_chooses_by_number(shop: Shop) -> None:
    programs = folder(shop, O0042__nc=SHORT, **{"77": TEXT, "part__nc": b"M30\n"})
    saved = shop.folder / "saved.nc"
    cnc: list[object] = ["--program", "42", "--operation", "read", "--save", saved, *BRIDGEPORT]
    sent, taken = finish(*start(shop, LINES[1], host=["send", "--program-dir", programs, *BRIDGEPORT], cnc=cnc))
    arrived(sent, taken, SHORT.replace(b"\n", b"\r\n"))
    assert saved.read_bytes() == SHORT.replace(b"\n", b"\r\n")


def test_a_number_that_is_not_there_is_told_and_waits(shop: Shop) -> None:
    programs = folder(shop, O0042__nc=SHORT)
    host: list[object] = ["send", "--program-dir", programs, *BRIDGEPORT, "--set", "hold_limit=1"]
    cnc: list[object] = ["--program", "43", "--timeout", "20", *BRIDGEPORT]
    sent, _ = finish(*start(shop, LINES[0], host=host, cnc=cnc))
    assert sent.outcome == (1, "failed")
    assert "nobody gave program 43" in sent.end["reason"]
    assert f"there is no program 43 in {programs}" in sent.stderr


def test_a_number_that_is_not_there_is_sent_when_it_appears(shop: Shop) -> None:
    programs, saved = folder(shop, O0042__nc=SHORT), shop.folder / "saved.nc"
    host: list[object] = ["send", "--program-dir", programs, *BRIDGEPORT]
    cnc: list[object] = ["--program", "43", "--operation", "read", "--save", saved, "--timeout", "20", *BRIDGEPORT]
    sending, taking = start(shop, LINES[0], host=host, cnc=cnc)
    sending.wait_for("notice", text=f"there is no program 43 in {programs}: put it there and it is sent")
    (programs / "43.nc").write_bytes(TEXT)
    sent, taken = finish(sending, taking)
    arrived(sent, taken, SENT)
    assert saved.read_bytes() == SENT
    assert "43.nc is new or was changed" in sent.stderr


def test_what_the_control_saves_is_stored_by_its_number_and_replaces_nothing(shop: Shop) -> None:
    programs, file = folder(shop), shop.file("in.nc", TEXT)
    for expected, words in (("42.nc", []), ("42.received-1.nc", []), ("42.nc", ["--force"])):
        before = {path.name for path in programs.iterdir()}
        host: list[object] = ["receive", "--program-dir", programs, *words, *BRIDGEPORT]
        cnc: list[object] = ["--operation", "punch", "--program", "42", "--file", file, *BRIDGEPORT]
        got, sent = finish(*start(shop, LINES[0], host=host, cnc=cnc))
        assert sent.outcome == got.outcome == (0, "complete"), (got.stderr, sent.stderr)
        assert (programs / expected).read_bytes() == TEXT
        assert {path.name for path in programs.iterdir()} == before | {expected}


def test_what_the_control_saves_goes_to_one_file(shop: Shop) -> None:
    file, got = shop.file("in.nc", TEXT), shop.folder / "got.nc"
    cnc: list[object] = ["--operation", "punch", "--file", file, *BRIDGEPORT]
    finished, sent = finish(*start(shop, LINES[2], host=["receive", got, *BRIDGEPORT], cnc=cnc))
    assert sent.outcome == finished.outcome == (0, "complete"), (finished.stderr, sent.stderr)
    assert got.read_bytes() == TEXT


def test_the_operator_cancels(shop: Shop) -> None:
    file = shop.file("in.nc", TEXT)
    cnc: list[object] = ["--reset-after", "300", *BRIDGEPORT]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *BRIDGEPORT], cnc=cnc))
    assert sent.outcome == taken.outcome == (1, "cancelled")
    assert 0 < sent.end["bytes"] <= sent.end["bytes_handed"] < len(SENT)


def test_a_profile_changes_the_codes_at_both_ends_and_set_comes_after_it(shop: Shop) -> None:
    profile = shop.file(
        "bay4.toml",
        b'format = "tapewire bridgeport profile 1"\ntitle = "bay 4"\n[codes]\nopen_write = "ENQ"\n'
        b'cancel_tail = "04"\nread_request = "0E"\n[settings]\nlrc = "xor7"\n',
    )
    file = shop.file("in.nc", TEXT)
    both: list[object] = [*BRIDGEPORT, "--profile", profile]
    sent, taken = finish(*start(shop, LINES[0], host=["send", file, *both, "--set", "lrc=auto"], cnc=both))
    arrived(sent, taken, SENT)
    assert "lrc=xor7" in sent.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["send", "--protocol", "bridgeport"], "name the FILE"),
        (["receive", "--protocol", "bridgeport"], "name the FILE"),
        (["send", "in.nc", "--program-dir", ".", "--protocol", "bridgeport"], "name one program"),
        (["receive", "in.nc", "--program-dir", ".", "--protocol", "bridgeport"], "name one file"),
        (["send", "--program-dir", ".", "--protocol", "fanuc-b"], "asks for no number"),
        (["receive", "--program-dir", ".", "--protocol", "fanuc-b"], "asks for no number"),
        (["cnc", "--program", "7", "--protocol", "fanuc-b"], "asks for no number"),
        (["cnc", "--program", "../7", "--protocol", "bridgeport"], "one to six digits"),
        (["send", "--program-dir", "no-such", "--protocol", "bridgeport"], "cannot be read as a folder"),
        (["cnc", "--profile", "no-such", "--protocol", "bridgeport"], "no-such: cannot be read"),
        (["cnc", "--profile", "no-such", "--protocol", "fanuc-b"], "codes of bridgeport"),
        (["cnc", "--protocol", "bridgeport", "--set", "parity=software", "--stopbits", "1"], "8N2"),
    ],
)
def test_what_is_asked_wrongly_is_refused(words: list[str], told: str) -> None:
    finished = invoke(*words, *NOWHERE)
    assert finished.outcome == (2, "failed")
    assert told in finished.end["reason"]


def test_a_file_that_would_forge_codes_is_refused(shop: Shop) -> None:
    for flag in ([], ["--raw"]):
        finished = invoke("send", shop.file("in.nc", b"N1\nN2\x04\n"), "--protocol", "bridgeport", *NOWHERE, *flag)
        assert finished.outcome == (2, "failed")
        assert "line 2, column 3: EOT (04h)" in finished.end["reason"]


def test_learn_stores_what_it_has_seen_when_the_line_goes_away(shop: Shop) -> None:
    profile = shop.folder / "mill-3.toml"
    learning = shop.start(
        "bridgeport", "learn", profile, "--line", "listen://127.0.0.1:0", "--control", "mill 3", "--json"
    )
    line = f"socket://127.0.0.1:{learning.port}"
    taken = shop.run("cnc", "--line", line, *BRIDGEPORT[:2], "--program", "-1", "--operation", "read", "--json")
    learned = learning.finish()
    assert taken.outcome == (0, "complete")
    assert learned.outcome == (1, "failed")
    assert "step 1 of 5: at the control, ask for program -1" in learned.stderr
    seen = Profile.loads(profile.read_text())
    assert seen.title == "Seen at mill 3"
    assert seen.confidence["read_request"] == 100
    assert seen.confidence["open_write"] == 80
    assert learned.end["sha256"] == hashlib.sha256(profile.read_bytes()).hexdigest()
    assert learned.end["bytes"] == len(profile.read_bytes())


def test_learn_stores_nothing_where_nothing_was_seen(shop: Shop) -> None:
    profile = shop.folder / "mill-3.toml"
    learned = shop.run("bridgeport", "learn", profile, "--line", "listen://127.0.0.1:0", "--timeout", "0.5", "--json")
    assert learned.outcome == (1, "failed")
    assert not profile.exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["in-there.toml"], "--force"),
        (["gone/profile.toml"], "there is no folder gone"),
        (["new.toml", "--control", "mill\n3"], "one line"),
        (["new.toml", "--set", "lrc=crc"], "lrc"),
    ],
)
def test_learn_refuses_before_the_line_is_opened(
    shop: Shop, monkeypatch: pytest.MonkeyPatch, words: list[str], told: str
) -> None:
    monkeypatch.chdir(shop.folder)
    shop.file("in-there.toml", b"")
    finished = invoke("bridgeport", "learn", *words, *NOWHERE)
    assert finished.outcome == (2, "failed")
    assert told in finished.end["reason"]
    assert shop.files == set()


def test_who_has_no_profile_is_told_that_the_codes_are_reconstructed(shop: Shop) -> None:
    profile = shop.file("mill.toml", b'format = "tapewire bridgeport profile 1"\n')
    for words, told in (((), True), (("--profile", profile), False)):
        for command in (["send", shop.file("in.nc", TEXT)], ["receive", shop.folder / "out.nc"]):
            line = ("--line", "listen://127.0.0.1:0", "--timeout", "0.3", "--json")
            finished = shop.run(*command, *BRIDGEPORT, *words, *line)
            notices = [event["text"] for event in finished.named("notice")]
            assert any("a reconstruction" in text for text in notices) is told


def test_two_files_of_one_number_are_refused(shop: Shop) -> None:
    programs = folder(shop, O0042__nc=SHORT, **{"42": SHORT})
    finished = invoke("send", "--program-dir", programs, "--protocol", "bridgeport", *NOWHERE)
    assert finished.outcome == (2, "failed")
    assert "42 and O0042.nc" in finished.end["reason"]
