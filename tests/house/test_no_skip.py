"""With TAPEWIRE_NO_SKIP=1 a skipped test fails the run, wherever the skip was said."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

CONFTEST = Path(__file__).parents[1] / "conftest.py"

SKIPPED_BY = {
    "test_call.py": "import pytest\ndef test_it() -> None:\n    pytest.skip('no ser2net')\n",
    "test_mark.py": "import pytest\n@pytest.mark.skip(reason='no socat')\ndef test_it() -> None: ...\n",
    "test_module.py": "import pytest\npytest.skip('no setserial', allow_module_level=True)\n",
}


def run_pytest(folder: Path, *, no_skip: str) -> str:
    command = [sys.executable, "-m", "pytest", "-rA", "--continue-on-collection-errors", "--rootdir", "."]
    environment = os.environ | {"TAPEWIRE_NO_SKIP": no_skip, "COLUMNS": "200"}
    return subprocess.run(command, env=environment, cwd=folder, stdout=subprocess.PIPE, text=True, check=False).stdout


def test_a_skip_fails_where_none_is_allowed(tmp_path: Path) -> None:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    for name, source in SKIPPED_BY.items():
        (tmp_path / name).write_text(source)

    assert "== 3 skipped in" in run_pytest(tmp_path, no_skip="0")

    forbidden = run_pytest(tmp_path, no_skip="1")
    assert "== 1 failed, 2 errors in" in forbidden
    for reason in ("no ser2net", "no socat", "no setserial"):
        assert f"lets no test be skipped: Skipped: {reason}" in forbidden
