"""With TAPEWIRE_NO_SKIP=1 a skipped test fails the run, wherever the skip was said."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"

SAID_IN = {
    "a test": "import pytest\ndef test_it() -> None:\n    pytest.skip('no ser2net')\n",
    "a mark": "import pytest\n@pytest.mark.skip(reason='no ser2net')\ndef test_it() -> None: ...\n",
    "a module": "import pytest\npytest.skip('no ser2net', allow_module_level=True)\n",
}


def run_pytest(folder: Path, *, no_skip: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-rs",
            "-p",
            "no:cacheprovider",
            "--rootdir",
            str(folder),
            str(folder),
        ],
        env=os.environ | {"TAPEWIRE_NO_SKIP": no_skip},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("place", SAID_IN)
def test_a_skip_fails_where_none_is_allowed(tmp_path: Path, place: str) -> None:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "test_it.py").write_text("def test_other() -> None: ...\n")
    (tmp_path / "test_skipped.py").write_text(SAID_IN[place])

    allowed = run_pytest(tmp_path, no_skip="0")
    forbidden = run_pytest(tmp_path, no_skip="1")

    assert allowed.returncode == 0, allowed.stdout
    assert "1 skipped" in allowed.stdout
    assert forbidden.returncode != 0, forbidden.stdout
    assert "no ser2net" in forbidden.stdout
