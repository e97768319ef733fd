"""The words of REMOTE LOAD and DNC LINK: the code table, profiles, names, settings, text, transcripts."""

from __future__ import annotations

import io
from contextlib import suppress
from importlib.resources import files

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.errors import ProgramError, UsageError
from tapewire.protocols.bridgeport.code_table import ROLES, CodeTable
from tapewire.protocols.bridgeport.messages import Mode, Name, Params, Parity, classify, on_the_wire
from tapewire.protocols.bridgeport.profile import CODE_KEYS, RECONSTRUCTION, Profile
from tapewire.protocols.bridgeport.records import Lrc
from tapewire.protocols.bridgeport.text import SavedText, inspect_raw, prepare
from tapewire.protocols.bridgeport.words import Words
from tapewire.protocols.settings import End, describe_settings

DEFAULTS = {
    "open_write": "12",
    "write_ready": "11",
    "name_end": "04 14",
    "text_end": "04",
    "write_close": "14",
    "read_request": "11",
    "xon": "11",
    "xoff": "13",
    "cancel": "10",
    "cancel_tail": "03 04 06 10 13 14 15 18",
    "rec_end": "17",
    "ack": "06",
    "nak": "15",
    "ignore_rx": "00 7F",
    "lrc": "xor7_etb",
    "dnc_end": "eot_on_ack",
}


def params(**settings: str) -> Params:
    return Params.for_bridgeport(settings, End.HOST)


# the code table


def test_the_defaults_are_those_of_the_reconstruction() -> None:
    found = {key: default for key, _, default, _, _ in describe_settings(Params)}
    assert {key: found[key] for key in DEFAULTS} == DEFAULTS


def test_every_code_says_who_sends_it_and_how_sure_we_are() -> None:
    assert set(ROLES) == set(CODE_KEYS)
    for role in ROLES.values():
        assert role.why.endswith(").")
        assert role.confidence is None or 0 < role.confidence <= 100


@pytest.mark.parametrize("word", ["05", "5", "05h", "ENQ", "enq"])
def test_a_code_is_written_in_hexadecimal_or_by_its_name(word: str) -> None:
    assert params(open_write=word).open_write == 5


@pytest.mark.parametrize("word", ["04,14", "14 04", "DC4 EOT"])
def test_several_codes_are_written_in_any_order(word: str) -> None:
    assert params(name_end=word).name_end == {4, 0x14}


def test_no_code_at_all_is_none() -> None:
    assert params(cancel_tail="none").cancel_tail == frozenset()


@pytest.mark.parametrize(
    ("key", "word", "why"),
    [
        ("open_write", "G1", "no character"),
        ("open_write", "80", "no character of seven bits"),
        ("open_write", "12 14", "one character is expected"),
        ("open_write", "", "one character is expected"),
        ("open_write", "41", "no code but text"),
        ("xoff", "0D", "no code but text"),
        ("name_end", "0A", "no code but text"),
        ("rec_end", "00", "no code but text"),
        ("xoff", "11", "told apart"),
        ("nak", "06", "told apart"),
        ("cancel", "13", "told apart"),
        ("read_request", "12", "told apart"),
        ("text_end", "17", "told apart"),
        ("write_close", "13", "told apart"),
        ("name_end", "13", "cannot also"),
        ("ignore_rx", "04", "cannot also"),
    ],
)
def test_a_code_that_cannot_be_is_refused(key: str, word: str, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        params(**{key: word})


@pytest.mark.parametrize("key", [key for key, _, _, _, _ in describe_settings(Params)])
def test_every_setting_belongs_to_somebody(key: str) -> None:
    whose = {key: end for key, _, _, end, _ in describe_settings(Params)}
    word = {key: default for key, _, default, _, _ in describe_settings(Params)}[key]
    for end, other in ((End.HOST, "control"), (End.CONTROL, "host")):
        if whose[key] == other:
            with pytest.raises(UsageError, match=f"{key} is a setting of the {other}"):
                Params.for_bridgeport({key: word}, end)
        else:
            assert Params.for_bridgeport({key: word}, end) == Params.for_bridgeport({}, end)


def test_a_control_knows_how_it_computes() -> None:
    assert params(lrc="auto").lrc is Lrc.AUTO
    with pytest.raises(UsageError, match="auto is for the host"):
        Params.for_bridgeport({"lrc": "auto"}, End.CONTROL)


@pytest.mark.parametrize("word", ["0", "-2", "1234567", "../1", "１２", ""])
def test_a_program_number_is_one_to_six_digits_or_minus_one(word: str) -> None:
    if word == "0":
        assert Params.for_bridgeport({"program": word}, End.CONTROL).program == "0"
        return
    with pytest.raises(UsageError, match="one to six digits"):
        Params.for_bridgeport({"program": word}, End.CONTROL)


# profiles


def test_the_profile_that_ships_says_the_defaults() -> None:
    shipped = files("tapewire.protocols.bridgeport").joinpath("reconstruction.toml").read_text()
    assert shipped == RECONSTRUCTION.dumps()
    profile = Profile.loads(shipped)
    assert profile == RECONSTRUCTION
    assert Params.for_bridgeport(profile.settings, End.HOST) == params()


def test_a_profile_needs_only_what_differs() -> None:
    profile = Profile.loads(
        'format = "tapewire bridgeport profile 1"\ntitle = "R2E3 in bay 4"\n[codes]\nopen_write = "ENQ"\n'
        '[settings]\nlrc = "xor7"\n[confidence]\nopen_write = 100\n'
    )
    settings = Params.for_bridgeport(profile.settings, End.HOST)
    assert (settings.open_write, settings.lrc, settings.xoff) == (5, Lrc.XOR7, 0x13)
    again = Profile.loads(profile.dumps())
    assert Params.for_bridgeport(again.settings, End.HOST) == settings
    assert (again.title, again.confidence) == (profile.title, profile.confidence)


def test_what_a_title_says_survives() -> None:
    profile = Profile(title='the "old" \\ one', settings={}, confidence={})
    assert Profile.loads(profile.dumps()).title == 'the "old" \\ one'


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "format = "),
        ("x = [", "no valid TOML"),
        ("[codes]\nopen = 1\n", "lines as key"),
        ('[codes]\nopen = "12"\n', "there is no such code"),
        ('[codes]\nxoff = "11"\n', "told apart"),
        ('[settings]\nxoff = "11"\n', "belongs into"),
        ('[settings]\nlrc = "md5"\n', "lrc=md5"),
        ('[settings]\nfile = "/etc/passwd"\n', "no setting 'file'"),
        ("[confidence]\nxoff = 101\n", "from 0 to 100"),
        ("[confidence]\nnothing = 10\n", "no such code"),
        ("[confidence]\nxoff = true\n", "from 0 to 100"),
        ("[include]\n", "include is nothing"),
        ('title = "a\\nb"\n', "one line"),
        ("codes = 1\n", "lines as key"),
        ("confidence = 1\n", "lines as key"),
    ],
)
def test_a_wrong_profile_is_refused_with_its_name_and_place(text: str, why: str) -> None:
    head = 'format = "tapewire bridgeport profile 1"\n' if text and "[\n" not in text else ""
    with pytest.raises(UsageError, match=r"^bay4\.toml: .*" + why):
        Profile.loads(head + text, "bay4.toml")


@given(st.text(max_size=60))
def test_any_text_is_a_profile_or_a_usage_error(text: str) -> None:
    with suppress(UsageError):
        assert Profile.loads(text).settings == {}


# names and programs


@pytest.mark.parametrize("ending", [b"", b"\r\n", b"\n", b" ", b"\t\r\n"])
@pytest.mark.parametrize("number", ["1", "123456", "000001"])
@pytest.mark.parametrize("mode", Mode)
def test_1_1_a_name_is_known_by_its_form(number: str, mode: Mode, ending: bytes) -> None:
    raw = f"{number};{mode}".encode() + ending
    name = classify(raw)
    assert name == Name(number=number, mode=mode, raw=raw)
    assert name.usual
    assert name.encoded == raw.strip()


def test_2_1_2_the_longest_name_has_eight_characters() -> None:
    assert Name(number="999999", mode=Mode.LINK, raw=b"").encoded == bytes.fromhex("39 39 39 39 39 39 3B 44")


@pytest.mark.parametrize("text", [b"N10G0X0Y0", b"123456789", b"1234567;L", b"1;L 2;L \n"])
def test_1_1_nine_characters_are_a_program(text: bytes) -> None:
    assert classify(text) is None or len(text) <= 8


@pytest.mark.parametrize("text", [b"", b"M30\r\n", b"12345678", b"1234567", b"1;M"])
def test_1_1_eight_characters_are_a_name_however_unusual(text: bytes) -> None:
    name = classify(text)
    assert name is not None
    assert not name.usual
    assert name.number is None


@given(st.binary(max_size=40))
def test_no_number_is_anything_but_digits(text: bytes) -> None:
    name = classify(text)
    if name is not None and name.number is not None:
        assert name.number.isascii()
        assert name.number.isdigit()
        assert 1 <= len(name.number) <= 6


def test_parity_is_made_where_the_line_makes_none() -> None:
    codes = bytes.fromhex("04 06 10 11 12 13 14 15 17")
    assert on_the_wire(codes, Parity.SOFTWARE) == bytes.fromhex("84 06 90 11 12 93 14 95 17")
    assert on_the_wire(codes, Parity.LINE) == codes


# text


def prepared(data: bytes) -> tuple[bytes, tuple[str, ...], tuple[str, ...]]:
    out = io.BytesIO()
    result = prepare(io.BytesIO(data).read, out.write)
    return out.getvalue(), result.changes, result.notes


def test_line_ends_become_cr_lf_and_every_change_is_told() -> None:
    assert prepared(b"N10G0X0Y0\nN20M2\r\nN30") == (
        b"N10G0X0Y0\r\nN20M2\r\nN30\r\n",
        ("LF made CR LF in 1 line", "CR LF put after the last line, which had no line end"),
        (),
    )


def test_a_text_that_can_go_as_it_is_goes_as_it_is() -> None:
    assert prepared(b"N10\tG0X0Y0\r\nN20M2\r\n") == (b"N10\tG0X0Y0\r\nN20M2\r\n", (), ())


def test_a_short_and_a_long_program_are_told() -> None:
    assert prepared(b"M30\r\n")[2] == ("5 bytes: the protocol knows no program of less than 9",)
    assert prepared(b"X" * 78 + b"\r\n")[2] == ()
    assert prepared((b"X" * 78 + b"\r\n") * 150)[2] == ()
    assert prepared((b"X" * 78 + b"\r\n") * 151)[2] == (
        "12,080 bytes: too long for REMOTE LOAD (;L), the control must ask for it by DNC LINK (;D)",
    )


@pytest.mark.parametrize("byte", [*range(9), 0x0B, 0x0C, *range(0x0E, 0x20), 0x7F, 0x80, 0xC3, 0xFF])
@pytest.mark.parametrize("check", [prepare, lambda read, write: inspect_raw(read)])
def test_a_byte_that_would_forge_a_code_is_refused_with_its_place(byte: int, check: object) -> None:
    assert callable(check)
    with pytest.raises(ProgramError, match=r"^line 2, column 3: .* remove it$") as refusal:
        check(io.BytesIO(b"N1\nN2" + bytes([byte]) + b"\n").read, io.BytesIO().write)
    assert (refusal.value.line, refusal.value.column) == (2, 3)


def test_a_lone_cr_is_refused_unless_raw() -> None:
    with pytest.raises(ProgramError, match="line 2, column 3: CR without LF"):
        prepared(b"N1\r\nN2\rN3\r\n")
    assert inspect_raw(io.BytesIO(b"N1\r\nN2\rN3\r\n").read).changes == ()


@pytest.mark.parametrize("data", [b""])
def test_an_empty_file_is_refused(data: bytes) -> None:
    for check in (prepared, lambda data: inspect_raw(io.BytesIO(data).read)):
        with pytest.raises(ProgramError, match="empty"):
            check(data)


def test_a_large_file_streams_and_its_refusal_knows_the_line() -> None:
    out: list[int] = []
    lines = b"N1 G01 X1.0\n" * 100_000
    prepare(io.BytesIO(lines).read, lambda data: out.append(len(data)))
    assert sum(out) == 13 * 100_000
    assert max(out) < 200_000
    with pytest.raises(ProgramError, match="line 100001, column 4"):
        prepare(io.BytesIO(lines + b"N1 \x11\n").read, lambda data: None)


def test_a_crlf_across_two_reads_is_one_line_end() -> None:
    data = b"X" * 65535 + b"\r\nY\r\n"
    assert prepared(data)[0] == data


@given(st.lists(st.sampled_from([b"N1", b"\r\n", b"\n", b"\x00", b"\x7f"]), max_size=20), st.data())
def test_what_a_control_sent_is_stored_alike_however_it_is_cut(pieces: list[bytes], cuts: st.DataObject) -> None:
    data = b"".join(pieces)
    out = io.BytesIO()
    saved = SavedText(out.write)
    rest = data
    while rest:
        count = cuts.draw(st.integers(1, len(rest)))
        saved.feed(rest[:count])
        rest = rest[count:]
    saved.finish()
    assert out.getvalue() == data.translate(None, b"\x00\x7f").replace(b"\r\n", b"\n")
    assert not saved.damage


@pytest.mark.parametrize(("data", "what"), [(b"N1\rN2\n", "CR without LF at byte 3"), (b"N1\x05\n", "ENQ (05h)")])
def test_what_is_strange_is_stored_as_it_is_and_told(data: bytes, what: str) -> None:
    out = io.BytesIO()
    saved = SavedText(out.write)
    saved.feed(data)
    saved.finish()
    assert out.getvalue() == data
    assert what in saved.damage[0]


# transcripts


@pytest.mark.parametrize("parity", Parity)
def test_both_ends_in_words(parity: Parity) -> None:
    words = Words(params(parity=parity))
    assert words.control(on_the_wire(b"\x12", parity)) == ["DC2"]
    said = words.control(on_the_wire(b"77;D\x14\x11\x06\x15\x10", parity))
    assert said == [
        b"77;D",
        "DC4",
        "DC1",
        "ACK",
        "NAK",
        "DLE",
    ]
    wire = on_the_wire(b"N20Y1\r\n\x17\x34N\x17\x11\x04", parity)
    assert words.host(wire[:9]) == [b"N20Y1\r\n", "ETB", "LRC=34"]
    assert words.host(wire[9:11]) == [b"N", "ETB"]
    assert words.host(wire[11:]) == ["LRC=11", "EOT"]


def test_a_table_may_be_used_alone() -> None:
    assert CodeTable().upload_ends == {0x04, 0x14}
