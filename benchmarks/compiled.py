"""The engines, the line and the simulated world as machine code: a campaign of hours, done in less than half of them.

    python -m benchmarks.compiled build/compiled
    PYTHONPATH=build/compiled python -m tapewire simulate ...

It is the same source, copied and compiled by mypyc, which comes with mypy; it needs setuptools and a C compiler, and
some minutes. A seed gives the same transcript to the byte. A module that is not listed here runs as it is.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parent.parent / "src"

MODULES = (
    "engine.py",
    "line/closed_loop.py",
    "line/faults/chance.py",
    "line/faults/characters.py",
    "line/faults/damage.py",
    "line/faults/injector.py",
    "line/faults/signals.py",
    "line/faults/when.py",
    "line/link.py",
    "line/pacing.py",
    "line/reception.py",
    "line/simulated.py",
    "line/transport.py",
    "protocols/delivery.py",
    "protocols/*/cnc*.py",
    "protocols/*/host*.py",
    "protocols/*/packets.py",
    "protocols/*/records.py",
    "sim/evidence.py",
    "sim/machine.py",
    "sim/pair.py",
    "sim/world.py",
)
"""Where the time goes. Settings stay as they are, classes of a compiled module being of use to compiled ones only."""

SETUP = """\
from mypyc.build import mypycify
from setuptools import setup

setup(name="tapewire-compiled", ext_modules=mypycify(["--strict", *{files!r}], opt_level="1", multi_file=True))
"""


def compile_into(target: Path) -> int:
    """Copy the package to `target` and compile it there; the number of modules compiled."""
    shutil.copytree(SOURCE / "tapewire", target / "tapewire", ignore=shutil.ignore_patterns("__pycache__"))
    found = {path.relative_to(target) for pattern in MODULES for path in (target / "tapewire").glob(pattern)}
    files = sorted(str(path) for path in found if not path.stem.endswith("_law"))
    (target / "setup.py").write_text(SETUP.format(files=files))
    subprocess.run([sys.executable, "setup.py", "-q", "build_ext", "--inplace"], cwd=target, check=True)
    return len(files)


def main(words: list[str]) -> int:
    if len(words) != 1 or Path(words[0]).exists():
        print("name one directory that does not exist yet: python -m benchmarks.compiled build/compiled")
        return 2
    target = Path(words[0])
    print(f"{compile_into(target)} modules compiled into {target}: PYTHONPATH={target} python -m tapewire simulate ...")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
