"""Transfers under faults: every seed that ever failed, and a bounded share of fresh ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from tapewire.line.faults.presets import PRESETS
from tapewire.protocols import PROTOCOLS
from tapewire.sim.campaign import Case, Totals, cases, run_case

SEEDS = Path(__file__).parent / "seeds.txt"


def failed_before() -> list[Case]:
    lines = [line.split("#")[0].split() for line in SEEDS.read_text().splitlines()]
    return [Case(words[0], words[1], int(words[2])) for words in lines if words]


def complaint(case: Case) -> str:
    report = run_case(case)
    broken = "; ".join(f"{finding.rule}: {finding.what}" for finding in report.violations)
    return f"{case.command}\n{broken}" if broken else ""


def test_the_list_names_what_there_is() -> None:
    for case in failed_before():
        assert case.protocol in PROTOCOLS
        assert case.preset in PRESETS


@pytest.mark.parametrize("part", range(4))
def test_no_seed_that_ever_failed_fails_again(part: int) -> None:
    assert [text for case in failed_before()[part::4] if (text := complaint(case))] == []


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_fresh_seeds_break_no_rule(protocol: str) -> None:
    assert [text for case in cases(protocol, "all", 1, 1) if (text := complaint(case))] == []


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_case_is_repeated_to_the_byte(protocol: str) -> None:
    case = Case(protocol, "worn-connector", 3)
    first, second = run_case(case, transcript=True), run_case(case, transcript=True)
    assert first == second
    assert first.transcript


def test_a_clean_line_and_quiet_people_complete() -> None:
    totals = Totals()
    for case in cases("all", "clean", 1, 8):
        totals.add(run_case(case))
    assert totals.transfers == 8 * len(PROTOCOLS)
    assert totals.outcomes["complete"] > totals.transfers / 2
    assert not totals.failed
