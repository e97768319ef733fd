"""Captures in words: every protocol told right, what is wrong found, and nothing in a capture does harm."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterable
from dataclasses import replace
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from docs.generators.captures import PICTURE, picture
from tapewire.engine import MILLISECOND, SECOND
from tapewire.errors import UsageError
from tapewire.line.captures.records import ALL_ON, Happening, Lines, Origin, Record, Side, called_back
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.settings import End
from tapewire.transfer.decoding.chart import MOST_ENTRIES, Chart
from tapewire.transfer.decoding.dialogue import Dialogue, Spoken
from tapewire.transfer.decoding.entry import Entry, Kind
from tapewire.transfer.decoding.folding import Fold, fold
from tapewire.transfer.decoding.reading import Began, Decoded, Figures, Told, decode
from tapewire.transfer.decoding.recognise import Asked, Stream
from tapewire.transfer.decoding.text import line_of
from tests.transfer.captured import a_job, capture, damaged_message, merged, tape

LINK = {"cnc_settings": {"mode": "D", "program": "77"}}
JOBS = {
    "fanuc-a": {"blocks_per_second": 30},
    "fanuc-a-expansion": {"blocks_per_second": 60},
    "fanuc-b": {"blocks_per_second": 2000},
    "fanuc-b-expansion": {"blocks_per_second": 2000},
    "bridgeport": LINK,
}


def program_for(protocol: str) -> bytes:
    if protocol == "bridgeport":
        return b"".join(b"N%d G1 X%d.5\r\n" % (n, n) for n in range(1, 80)) + b"M30\r\n"
    return tape(200)


def recorded(protocol: str, side: Side) -> tuple[list[Record], Origin]:
    records, origin = a_job(protocol, program_for(protocol), side=side, **JOBS[protocol])  # type: ignore[arg-type]
    # A control reports two characters at a time: a few more make the same dialogue, and a quicker test.
    return merged(records, 5 * MILLISECOND), origin


RECORDED = {(protocol, side): recorded(protocol, side) for protocol in JOBS for side in Side}


def decoded(records: Iterable[Record], origin: Origin, asked: Asked | None = None) -> list[Decoded]:
    return list(decode(io.BytesIO(capture(list(records), origin)), asked or Asked()))


def entries_of(items: Iterable[Decoded]) -> list[Entry]:
    return [item.entry for item in items if isinstance(item, Told)]


def wrongs(items: Iterable[Decoded]) -> list[str]:
    return [entry.text for entry in entries_of(items) if entry.kind is Kind.VIOLATION]


@pytest.mark.parametrize(("protocol", "side"), RECORDED)
def test_a_job_of_every_protocol_is_told_whole_and_faultless(protocol: str, side: Side) -> None:
    records, origin = RECORDED[protocol, side]
    items = decoded(records, origin)
    (began,) = [item for item in items if isinstance(item, Began)]
    assert began.known == f"{protocol}, as the capture says"
    entries = entries_of(items)
    assert wrongs(items) == []
    fed = sum(entry.count for entry in entries if entry.kind is Kind.PROGRAM and entry.side is Side.HOST)
    program = program_for(protocol)
    packed = protocol == "fanuc-a-expansion"
    assert fed == len(program) if not packed else len(program) <= fed < len(program) + 2048


@pytest.mark.parametrize(("protocol", "side"), RECORDED)
def test_every_protocol_is_recognised_and_said_to_be_a_guess(protocol: str, side: Side) -> None:
    records, origin = RECORDED[protocol, side]
    items = decoded(records, Origin(baud=origin.baud))
    (began,) = [item for item in items if isinstance(item, Began)]
    assert began.known == f"{protocol}, a guess; --protocol NAME settles it"
    assert entries_of(items) == entries_of(decoded(records, origin))


def test_what_no_protocol_says_is_told_as_it_is() -> None:
    records = [Record(at=SECOND + n, what=Happening.SENT, data=b"hello\x05") for n in range(3)]
    items = decoded(records, Origin())
    assert any(isinstance(item, Began) and "no protocol recognised" in item.known for item in items)
    assert [entry.text for entry in entries_of(items)] == ['"hello"', "ENQ"] * 3


@given(st.data())
@settings(max_examples=12)
def test_how_a_capture_is_cut_into_packets_does_not_matter(data: st.DataObject) -> None:
    """Another tool may write one character a packet, or what comes in a tenth of a second."""
    protocol = data.draw(st.sampled_from(list(JOBS)))
    records, origin = RECORDED[protocol, Side.HOST]
    size = data.draw(st.integers(1, 400))
    cut = [
        replace(record, data=record.data[at : at + size])
        for record in records[:400]
        for at in range(0, max(1, len(record.data)), size)
    ]
    whole, pieces = (
        [(entry.side, entry.text, entry.count) for entry in entries_of(decoded(each, origin))]
        for each in (records[:400], cut)
    )
    assert pieces == whole


anything = st.builds(
    Record,
    at=st.integers(0, 100 * SECOND),
    what=st.sampled_from(Happening),
    lines=st.integers(0, 0x7F).map(Lines),
    data=st.binary(max_size=60)
    | st.sampled_from([b"\x11", b"\x13", b"\x93", b"D9GTD\r", b"<b>&\"'", b"12;D", b"\x17", b"\x12", b"\x04"]),
    remark=st.text("<&>\"' ab:1", max_size=10),
)


@given(st.sampled_from([None, *PROTOCOLS]), st.sampled_from(Side), st.lists(anything, max_size=30))
@settings(max_examples=60)
def test_nothing_in_a_capture_does_harm(protocol: str | None, side: Side, records: list[Record]) -> None:
    asked = Asked(protocol=protocol, side=side)
    chart = Chart("<evil> & 'capture'")
    for item in decoded(records, Origin(line="<script>"), asked):
        chart.add(item)
        assert all(line.isprintable() for line in line_of(item).split("\n"))
    picture = chart.svg()
    root = ElementTree.fromstring(picture)
    names = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert names <= {"svg", "title", "style", "rect", "text", "path"}
    attributes = {name for element in root.iter() for name in element.attrib}
    assert attributes <= {
        *("width", "height", "viewBox", "role", "class", "x", "y", "rx", "d", "stroke-width", "fill", "stroke"),
        "text-anchor",
    }


@given(
    st.sampled_from(list(PROTOCOLS)), st.lists(st.tuples(st.sampled_from(Side), st.binary(max_size=80)), max_size=40)
)
@settings(max_examples=150)
def test_no_dialogue_breaks_a_listener(protocol: str, said: list[tuple[Side, bytes]]) -> None:
    entry = PROTOCOLS[protocol]
    dialogue = Dialogue(Spoken(protocol=entry, params=entry.params({}, End.HOST), side=Side.HOST))
    for number, (side, data) in enumerate(said):
        what = Happening.SENT if side is Side.HOST else Happening.RECEIVED
        list(dialogue.feed(Record(at=number * SECOND, what=what, data=data)))
    list(dialogue.finish())
    assert dialogue.summary()


def test_faults_lines_and_what_was_called_back_stand_in_their_place() -> None:
    records = [
        Record(at=SECOND, what=Happening.SENT, data=b"abc"),
        Record(at=SECOND + 1, what=Happening.PARITY_ERROR, data=b"A"),
        Record(at=SECOND + 2, what=Happening.BREAK),
        Record(at=SECOND + 3, what=Happening.STATUS_CHANGE, lines=ALL_ON & ~Lines.CTS),
        Record(at=SECOND + 4, what=Happening.SENT, lines=ALL_ON & ~Lines.CTS, data=b"d"),
        Record(at=SECOND + 5, what=Happening.SENT, lines=ALL_ON & ~Lines.CTS, data=b"e"),
        Record(at=SECOND + 6, what=Happening.STATUS_CHANGE, remark=called_back(2)),
        Record(at=SECOND + 7, what=Happening.DATA_LOST, remark="5 records lost"),
        Record(at=SECOND + 8, what=Happening.COMPLETE, remark="unplugged"),
    ]
    items = decoded(records, Origin(side=Side.HOST), Asked(protocol="fanuc-b"))
    assert [(entry.kind, entry.text) for entry in entries_of(items)] == [
        (Kind.PROGRAM, '"abc"'),
        (Kind.FAULT, "parity error: 'A' (41h)"),
        (Kind.FAULT, "break"),
        (Kind.SIGNALS, "CTS OFF"),
        (Kind.VIOLATION, "the host sends while its CTS is OFF"),
        (Kind.PROGRAM, '"de"'),
        (Kind.SIGNALS, "CTS ON"),
        (Kind.NOTE, "the last 2 characters were called back and never left"),
        (Kind.NOTE, "missing from the capture: 5 records lost"),
        (Kind.NOTE, "the end of the line: unplugged"),
    ]
    (figures,) = [item for item in items if isinstance(item, Figures)]
    assert figures.lines[-3:] == ("break: 1 character", "parity error: 1 character", "1 violation")


def test_a_damaged_message_is_found_by_its_sum() -> None:
    records, origin = RECORDED["fanuc-a", Side.HOST]
    at = next(n for n, record in enumerate(records) if b"G01" in record.data)
    spoilt = [*records]
    spoilt[at] = replace(records[at], data=records[at].data.replace(b"G01", b"G00"))
    assert wrongs(decoded(spoilt, origin)) == ["the host said something unreadable: checksum error"]


def test_a_damaged_record_of_dnc_link_is_found_by_its_check_character() -> None:
    records, origin = RECORDED["bridgeport", Side.HOST]
    at = [n for n, record in enumerate(records) if b"N" in record.data and record.what is Happening.SENT][-3]
    spoilt = [*records]
    spoilt[at] = replace(records[at], data=records[at].data.replace(b"N", b"O"))
    (wrong,) = wrongs(decoded(spoilt, origin))
    assert re.fullmatch(r"check character [0-9A-F]{2} .*(by no known way|as those before did)", wrong)


def test_a_setting_of_the_capture_is_used() -> None:
    records, origin = RECORDED["fanuc-a", Side.HOST]
    iso, _ = a_job("fanuc-a", tape(100), settings={"code": "iso", "end": "etx"})
    assert wrongs(decoded(iso, origin)) != [] or "SYN" not in {e.text for e in entries_of(decoded(iso, origin))}
    assert wrongs(decoded(iso, replace(origin, settings={"code": "iso", "end": "etx"}))) == []
    nonsense = decoded(records, replace(origin, settings={"code": "morse"}))
    assert any(isinstance(item, Began) and "settings mean nothing" in item.known for item in nonsense)
    assert entries_of(nonsense) == entries_of(decoded(records, origin))


def test_what_the_user_says_is_believed() -> None:
    records, origin = RECORDED["fanuc-b", Side.HOST]
    swapped = entries_of(decoded(records, origin, Asked(protocol="fanuc-b", side=Side.CONTROL)))
    assert {entry.side for entry in swapped if entry.kind is Kind.PROGRAM} == {Side.CONTROL}
    with pytest.raises(UsageError, match="there is no protocol"):
        Asked(protocol="fanuc-z")
    with pytest.raises(UsageError, match="say which one"):
        Asked(settings={"code": "iso"})
    with pytest.raises(UsageError, match="there is no setting"):
        Asked(protocol="fanuc-b", settings={"colour": "red"})


def test_jobs_of_one_ring_are_told_one_after_the_other() -> None:
    first, second = capture(*RECORDED["fanuc-b", Side.HOST]), capture(*RECORDED["bridgeport", Side.CONTROL])
    items = list(decode(io.BytesIO(first + second), Asked()))
    marks = [(type(item), item.stream) for item in items if isinstance(item, Began | Figures)]
    assert marks == [(Began, 0), (Figures, 0), (Began, 1), (Figures, 1)]


@pytest.mark.parametrize("protocol", JOBS)
def test_a_capture_of_another_tool_is_told_the_same(protocol: str) -> None:
    """Classic pcap, high byte first, in microseconds, with the data in the END events and nothing said of itself."""
    records, origin = RECORDED[protocol, Side.CONTROL]
    ends = {Happening.SENT: Happening.SENT_ALL, Happening.RECEIVED: Happening.RECEIVED_ALL}
    file = struct.pack(">IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 250)
    for record in records:
        seconds, rest = divmod(record.at, SECOND)
        body = struct.pack(">IIBBH", seconds, rest // 1000, ends.get(record.what, record.what), record.lines, 0)
        body += record.data
        file += struct.pack(">4I", seconds, rest // 1000, len(body), len(body)) + body
    items = list(decode(io.BytesIO(file), Asked()))
    if protocol == "fanuc-b-expansion":
        # Without the rate nothing tells it from protocol B.
        assert any(isinstance(item, Began) and item.known.startswith("fanuc-b, a guess") for item in items)
    else:
        assert any(isinstance(item, Began) and item.known.startswith(f"{protocol}, a guess") for item in items)
    told = [(entry.kind, entry.side, entry.text, entry.count) for entry in entries_of(items)]
    assert told == [(e.kind, e.side, e.text, e.count) for e in entries_of(decoded(records, origin))]


def test_a_chart_of_a_ring_of_many_jobs_is_bounded_and_says_so() -> None:
    job = capture(*RECORDED["fanuc-b", Side.HOST][:1], RECORDED["fanuc-b", Side.HOST][1])
    short = capture(RECORDED["fanuc-b", Side.HOST][0][:3], RECORDED["fanuc-b", Side.HOST][1])
    chart = Chart("ring")
    for item in decode(io.BytesIO(short * 250 + job), Asked()):
        chart.add(item)
    picture = chart.svg()
    ElementTree.fromstring(picture)
    assert "51 more streams" in picture


def test_live_a_protocol_is_recognised_after_some_of_it() -> None:
    records, origin = RECORDED["fanuc-a", Side.HOST]
    stream = Stream(Asked(), Origin(baud=origin.baud, side=Side.HOST), live=True)
    entries = [entry for record in records for entry in stream.feed(record)]
    assert stream.known is not None
    assert stream.known.startswith("fanuc-a, a guess")
    assert entries[-1].text == "SET"
    assert [entry for entry in entries if entry.kind is Kind.VIOLATION] == []


def test_a_message_damaged_on_its_way_is_seen_at_the_controls_end() -> None:
    items = list(decode(io.BytesIO(damaged_message()), Asked()))
    assert wrongs(items) == ["the host said something unreadable: checksum error"]
    assert "RTY 1" in [entry.text for entry in entries_of(items)]
    fed = sum(entry.count for entry in entries_of(items) if entry.kind is Kind.PROGRAM)
    assert fed == len(tape(200))


def test_the_manual_shows_its_picture() -> None:
    assert PICTURE.read_text() == picture(), "run scripts/docs"


def said(*texts: str) -> list[Entry]:
    return [
        Entry(kind=Kind.SAID, at=n * SECOND, until=n * SECOND, text=text, side=Side.HOST)
        for n, text in enumerate(texts)
    ]


def test_what_repeats_is_folded_and_what_is_wrong_is_not() -> None:
    exchange = ("GTD", "DAT 1", "SAT 5 stored")
    wrong = Entry(kind=Kind.VIOLATION, at=0, until=0, text="wrong")
    rows = list(fold([*said("SYN", *exchange * 9), wrong, *said(*exchange * 4, "EOD")]))
    folds = [row for row in rows if isinstance(row, Fold)]
    assert [(each.times, each.what) for each in folds] == [(7, ("GTD", "DAT", "SAT"))]
    assert wrong in rows
    assert len(rows) == 1 + 3 + 1 + 3 + 1 + 12 + 1


@given(st.lists(st.sampled_from("abc"), max_size=60))
def test_folding_loses_no_entry(letters: list[str]) -> None:
    entries = said(*letters)
    rows = list(fold(entries))
    assert sum(row.times * len(row.what) if isinstance(row, Fold) else 1 for row in rows) == len(entries)
    shown = [row for row in rows if isinstance(row, Entry)]
    assert shown == [entry for entry in entries if entry in shown]


def test_a_chart_of_a_long_dialogue_is_bounded_and_says_so() -> None:
    chart = Chart("long")
    chart.add(Began(stream=0, at=0, origin=Origin(), known="as told"))
    for n in range(3 * MOST_ENTRIES):
        entry = Entry(kind=Kind.FAULT, at=n * MILLISECOND, until=n * MILLISECOND, text="break", side=Side.HOST)
        chart.add(Told(stream=0, began=0, entry=entry))
    picture = chart.svg()
    assert "30,000 entries in all" in picture
    assert len(picture) < 2_000_000
