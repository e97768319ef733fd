"""What the docs take from the code does not lag behind it, and nothing the code has is left out."""

from __future__ import annotations

import re
from enum import Enum
from pathlib import Path
from typing import Any, get_args

import pytest

from docs.generate import PARTS, marked_names, regenerated
from docs.generators.command_line import command_names
from tapewire.engine import AfterStop, Ended, Received
from tapewire.protocols import bridgeport
from tapewire.protocols.bridgeport import cnc_law as bridgeport_cnc_law
from tapewire.protocols.bridgeport import host_law as bridgeport_host_law
from tapewire.protocols.bridgeport.code_table import ROLES
from tapewire.protocols.bridgeport.profile import LINK_CONFIDENCE
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd
from tapewire.protocols.fanuc_a import cnc_law as a_cnc_law
from tapewire.protocols.fanuc_a import host_law as a_host_law
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_a.packets import Monitor
from tapewire.protocols.fanuc_a.params import Params as AParams
from tapewire.protocols.fanuc_a.status import LIMITS
from tapewire.protocols.fanuc_b import cnc_law, host_law
from tapewire.protocols.fanuc_b.messages import ControlCode, Params
from tapewire.protocols.settings import describe_settings
from tapewire.transfer.reports import Report, Result, StopDistanceTold
from tests.house.markdown import fenced_blocks, table_rows
from tests.house.sources import ROOT, python_files
from tests.house.test_docs import ARCHITECTURE, pages
from tests.house.test_imports import LAYERS

PROTOCOL_A_PAGE = ROOT / "docs" / "protocols" / "fanuc_a.md"
PROTOCOL_B_PAGE = ROOT / "docs" / "protocols" / "fanuc_b.md"
BRIDGEPORT_PAGE = ROOT / "docs" / "protocols" / "bridgeport.md"
COMPLIANCE = ROOT / "docs" / "compliance.md"


def test_what_is_taken_from_the_code_is_up_to_date() -> None:
    lagging = [page.name for page in pages() if regenerated(page.read_text()) != page.read_text()]
    assert lagging == [], "run scripts/docs"


def test_every_part_has_its_place_and_only_one() -> None:
    names = [name for page in pages() for name in marked_names(page.read_text())]
    assert sorted(names) == sorted(PARTS)


def test_markers_come_in_pairs() -> None:
    for page in pages():
        marks = re.findall(r"<!-- (begin|end) generated: ([^\n]+?) -->", page.read_text())
        assert [mark for mark in marks if mark[0] == "begin"] == [
            ("begin", name) for name in marked_names(page.read_text())
        ]
        assert len(marks) == 2 * len(marked_names(page.read_text())), page.name


def test_a_part_that_lags_is_found() -> None:
    page = "<!-- begin generated: windows -->\nold\n<!-- end generated: windows -->\n"
    assert regenerated(page) != page
    assert regenerated(regenerated(page)) == regenerated(page)
    with pytest.raises(KeyError):
        regenerated(page.replace("windows", "gone"))


def words_of(*enums: type[Enum]) -> list[str]:
    return [f"`{word.name}`" for words in enums for word in words]


def test_the_protocol_page_has_every_word_of_both_ends() -> None:
    page = PROTOCOL_B_PAGE.read_text()
    first_cells = {row[0] for row in table_rows(page)}
    missing = set(words_of(host_law.State, cnc_law.State)) | {code.name for code in ControlCode}
    missing |= {timer.value for timer in host_law.Timer}
    assert missing - first_cells == set()
    assert [word for word in words_of(cnc_law.Act) if word not in page] == []


def test_the_page_of_protocol_a_has_every_word_of_both_ends() -> None:
    page = PROTOCOL_A_PAGE.read_text()
    first_cells = {row[0] for row in table_rows(page)}
    needed = set(words_of(a_host_law.State, a_host_law.Timer, a_cnc_law.State, a_cnc_law.Timer))
    needed |= {word.name for words in (Command, Monitor) for word in words}
    needed |= {limit.name for limit in LIMITS.values()}
    assert needed - first_cells == set()
    acts = {act for row in table_rows(page) for act in row[2:3]}
    assert set(words_of(a_cnc_law.Act)) <= acts
    assert all(alarm.value in page for alarm in a_cnc_law.Refusal)


@pytest.mark.parametrize(("page", "record"), [(PROTOCOL_A_PAGE, AParams), (PROTOCOL_B_PAGE, Params)], ids=["A", "B"])
def test_the_protocol_page_has_every_setting(page: Path, record: type[Any]) -> None:
    first_cells = {row[0] for row in table_rows(page.read_text())}
    assert {f"`{key}`" for key, *_ in describe_settings(record)} <= first_cells


def test_the_page_of_remote_load_has_every_word_of_both_ends() -> None:
    page = BRIDGEPORT_PAGE.read_text()
    first_cells = {row[0] for row in table_rows(page)}
    missing = set(words_of(bridgeport_host_law.State, bridgeport_cnc_law.State))
    missing |= {timer.value for timer in bridgeport_host_law.Timer}
    missing |= {f"`{key}`" for key, *_ in describe_settings(bridgeport.Params)}
    missing |= {f"`{word}`" for word in (*LRC_CANDIDATES, *DncEnd)}
    assert missing - first_cells == set()
    words = words_of(bridgeport_host_law.Heard, bridgeport_cnc_law.Act, bridgeport_cnc_law.Word)
    assert [word for word in words if word not in page] == []


def test_the_page_of_remote_load_says_how_sure_each_code_is() -> None:
    rows = table_rows(BRIDGEPORT_PAGE.read_text())
    unsure: dict[str, int | None] = {key: role.confidence for key, role in ROLES.items()}
    unsure.update(LINK_CONFIDENCE)
    for key, confidence in unsure.items():
        word = "our choice" if confidence is None else f"{confidence} %"
        assert any(row[0] == f"`{key}`" and word in row for row in rows), key


def test_the_page_of_the_command_line_has_every_command() -> None:
    helps = [body for _, body in fenced_blocks((ROOT / "docs" / "cli.md").read_text())]
    assert [name for name in command_names() if not any(f"Usage: tapewire {name} " in body for body in helps)] == []


def test_the_architecture_has_the_rooms_in_their_order() -> None:
    between = re.search(r"<!-- begin layers -->\n(.*?)<!-- end layers -->", ARCHITECTURE.read_text(), re.S)
    assert between is not None
    assert between[1].splitlines() == [f"{floor}. {', '.join(rooms)}" for floor, rooms in enumerate(LAYERS, 1)]


def test_compliance_names_tests_there_are() -> None:
    there = set(re.findall(r"def (test_\w+)", "\n".join(path.read_text() for path in python_files("tests"))))
    named = re.findall(r"`(test_\w+)`", COMPLIANCE.read_text())
    assert named
    assert [name for name in named if name not in there] == []


def test_compliance_claims_no_machine_that_nobody_has_seen() -> None:
    """A `yes` needs the name of a control beside it, so it is never one word."""
    rows = [row for row in table_rows(COMPLIANCE.read_text()) if len(row) == 5 and row[0] != "clause"]
    assert len(rows) > 50
    assert [row for row in rows if row[-1] != "no" and len(row[-1].split()) < 4] == []
    assert [row for row in rows if "**no**" not in row[2] and "`test_" not in row[3]] == []


def fanuc_rows() -> list[list[str]]:
    """Of the manual of the remote buffer, in their order."""
    table = COMPLIANCE.read_text().partition("## FANUC")[2].partition("\n## ")[0]
    return [row for row in table_rows(table) if row[0] != "clause"]


def test_compliance_goes_by_the_clauses_of_the_manual_and_says_nothing_twice() -> None:
    rows = fanuc_rows()
    clauses = [[int(number) for number in row[0].split(" ")[0].rstrip(",").split(".")] for row in rows]
    assert clauses == sorted(clauses)
    assert {clause[0] for clause in clauses} == set(range(1, 13))
    said = [(row[0], row[1]) for row in rows]
    assert len(said) == len(set(said))


def test_compliance_names_a_test_after_the_clause_in_chapters_8_10_11_and_12() -> None:
    without = []
    for clause, asked, how, tests, _ in fanuc_rows():
        chapter = clause.split(" ")[0].split(".")[0]
        named = re.search(rf"`test_(\w+_)?({chapter}_|\d{{4}}_|sr\d{{3}}_)", tests)
        if chapter in ("8", "10", "11", "12") and "**no**" not in how and not named:
            without.append((clause, asked))
    assert without == []


def test_compliance_knows_every_clause_that_a_test_of_chapters_8_to_12_is_named_after() -> None:
    there = [f"{row[0].split(' ')[0].rstrip(',')}." for row in fanuc_rows()]
    sources = "\n".join(path.read_text() for path in python_files("tests"))
    named = {name.replace("_", ".") for name in re.findall(r"def test_((?:8|9|10|11|12)_[1-9])_", sources)}
    assert len(named) > 8
    assert [name for name in sorted(named) if not any(clause.startswith(f"{name}.") for clause in there)] == []


def events_of_json() -> dict[str, set[str]]:
    """What `--json` may say, and the fields of each: reports as they are called, but for two."""
    other_names = {StopDistanceTold: "stop_distance", AfterStop: "after_dc3", Result: "end"}
    told = set(get_args(Report)) - {Received, Ended} | {Result}
    return {
        other_names.get(report) or re.sub(r"(?<!^)(?=[A-Z])", "_", report.__name__).lower(): set(
            report.__dataclass_fields__
        )
        for report in told
    }


def test_the_page_of_the_command_line_has_every_event_and_its_fields() -> None:
    said: dict[str, set[str]] = {}
    for row in table_rows((ROOT / "docs" / "cli.md").read_text()):
        if len(row) == 3 and row[0].startswith("`"):
            fields = set(re.findall(r"`(\w+)`", row[1]))
            said |= dict.fromkeys(re.findall(r"`(\w+)`", row[0]), fields)
    assert said == events_of_json()
