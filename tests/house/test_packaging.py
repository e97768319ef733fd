"""What we ship is whole, and what we install is pinned to the byte."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.house.sources import ROOT

PIN = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>[^\s;\\]+)(?P<rest>(?:[^\n]*\\\n)*[^\n]*)", re.M)
GROUPS = {"requirements.lock": ("build",), "requirements-dev.lock": ("build", "dev")}


def pins(lock: str) -> dict[str, str]:
    return {match["name"]: match["version"] for match in PIN.finditer(lock)}


def unpinned(wanted: list[str], lock: str) -> list[str]:
    """Requirements that the lock does not hold, or holds in a version they exclude."""
    have = pins(lock)
    requirements = [Requirement(text) for text in wanted]
    return [str(r) for r in requirements if r.name not in have or have[r.name] not in r.specifier]


def unhashed(lock: str) -> list[str]:
    return [match["name"] for match in PIN.finditer(lock) if "--hash=sha256:" not in match["rest"]]


def addresses(lock: str) -> list[str]:
    """Where to install from is the user's choice; an address in a lock would make it ours."""
    return re.findall(r"^.*(?:://|--(?:extra-)?index-url|--find-links|--trusted-host).*$", lock, re.M)


@pytest.mark.parametrize("name", GROUPS)
def test_the_lock_holds_what_the_project_asks_for(name: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = project["project"]["dependencies"] + project["build-system"]["requires"]
    wanted += [text for group in GROUPS[name] for text in project["dependency-groups"][group]]
    lock = (ROOT / name).read_text()
    assert unpinned(wanted, lock) == [], "run scripts/lock"
    assert unhashed(lock) == []
    assert addresses(lock) == []


def test_what_is_tested_is_what_is_shipped() -> None:
    runtime = pins((ROOT / "requirements.lock").read_text())
    assert runtime.items() <= pins((ROOT / "requirements-dev.lock").read_text()).items()


def test_a_lock_that_lags_is_found() -> None:
    lock = "click==8.1.0 \\\n    --hash=sha256:ab\nrich==15.0.0\n"
    assert unpinned(["click>=8.2", "rich>=14", "numpy"], lock) == ["click>=8.2", "numpy"]
    assert unhashed(lock) == ["rich"]
    assert addresses("--index-url x\nclick @ https://example.org/click.whl\nclick==8\n") == [
        "--index-url x",
        "click @ https://example.org/click.whl",
    ]


def test_the_wheel_holds_the_package_and_its_example(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        example = archive.read("tapewire/examples/surfacing.nc")
        (entry_points,) = [name for name in names if name.endswith("entry_points.txt")]
        script = archive.read(entry_points).decode()
    sources = {str(path.relative_to(ROOT / "src")) for path in (ROOT / "src").rglob("*.py")}
    assert names >= sources | {"tapewire/py.typed"}
    assert example == (ROOT / "examples" / "surfacing.nc").read_bytes()
    assert "tapewire = tapewire.cli:main" in script
