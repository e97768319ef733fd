"""What holds for every test: how Hypothesis searches, and that a run can forbid skipped tests."""

from __future__ import annotations

import os
from collections.abc import Generator
from typing import TypeVar

import pytest
from hypothesis import HealthCheck, settings

# Two runs of one commit test the same examples; a search for new ones is started by hand:
#   scripts/test --hypothesis-profile=explore
_ANY_MACHINE = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True)
settings.register_profile("tapewire", _ANY_MACHINE, derandomize=True, max_examples=60)
settings.register_profile("explore", _ANY_MACHINE, derandomize=False, max_examples=5000)
settings.load_profile("tapewire")

Report = TypeVar("Report", pytest.TestReport, pytest.CollectReport)

NO_SKIP = os.environ.get("TAPEWIRE_NO_SKIP") == "1"
"""An absent program skips its tests on a user's machine; where a change is judged, it fails them."""


def _forbid_skip(report: Report) -> Report:
    if NO_SKIP and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome = "failed"
        report.longrepr = f"skipped, and TAPEWIRE_NO_SKIP=1 lets no test be skipped: {reason}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    return _forbid_skip((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    return _forbid_skip((yield))
