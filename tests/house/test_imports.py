"""Imports go one way. The rooms and their order are those of docs/architecture.md."""

from __future__ import annotations

import pytest

from tests.house.sources import Import, Module, package_modules, read_module

LAYERS = (
    ("engine", "errors", "model", "codes"),
    ("fanuc", "nc", "g05"),
    ("protocols",),
    ("line",),
    ("sim",),
    ("config",),
    ("store",),
    ("transfer",),
    ("server",),
    ("web", "telemetry", "cli"),
)
FLOOR = {room: floor for floor, rooms in enumerate(LAYERS) for room in rooms}
ROOF = len(LAYERS)
"""The root package and `python -m tapewire` stand on everything, and nothing stands on them."""


def complaints(module: Module) -> list[str]:
    return [
        f"{module.name}, line {found.line}: {reason}"
        for found in module.imports
        if found.module.split(".")[0] == "tapewire"
        for reason in [wrong_with(module, found)]
        if reason
    ] + wrong_place(module)


def wrong_place(module: Module) -> list[str]:
    if room_of(module.name) in ("", "__main__", *FLOOR):
        return []
    return [f"{module.name} is in no room of the architecture: give it one, here and in docs/architecture.md"]


def wrong_with(module: Module, found: Import) -> str | None:
    source, target = room_of(module.name), room_of(found.module)
    if target == "" and source != "__main__":
        return "imports the root package, which hands names out of the house: import the module itself"
    if FLOOR.get(target, ROOF) > FLOOR.get(source, ROOF):
        return f"{source} imports {target}, which stands above it"
    return wrong_between_ends(module, found)


def room_of(name: str) -> str:
    """`tapewire.line.tcp` is in the room `line`; the root package itself is in the room ``."""
    return name.split(".")[1] if "." in name else ""


def wrong_between_ends(module: Module, found: Import) -> str | None:
    """Host and control of a protocol share its words and no more: they are two witnesses of the manual."""
    here, there = module.name.split("."), found.module.split(".")
    if here[1:2] != ["protocols"] or there[1:2] != ["protocols"] or len(here) < 4:
        return None
    mine, other = end_of(here[3]), end_of(there[3]) if len(there) > 3 else None
    if len(there) < 4 and there == here[: len(there)]:
        return "imports its own folder, which holds both ends: import the module itself"
    if other is not None and mine != other:
        return f"{here[3]} imports {there[3]}: what both ends need belongs into messages.py"
    return None


def end_of(stem: str) -> str | None:
    return next((end for end in ("host", "cnc") if stem.startswith(end)), None)


def test_imports_go_one_way() -> None:
    modules = package_modules()
    assert modules
    assert [line for module in modules for line in complaints(module)] == []


KNOWN = {
    "tapewire",
    "tapewire.engine",
    "tapewire.model",
    "tapewire.fanuc.tape",
    "tapewire.protocols",
    "tapewire.protocols.settings",
    "tapewire.protocols.fanuc_b",
    "tapewire.protocols.fanuc_b.messages",
    "tapewire.protocols.fanuc_b.host",
    "tapewire.protocols.fanuc_b.cnc_packets",
    "tapewire.line.driver",
    "tapewire.web.app",
}


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("tapewire.engine", "from tapewire.fanuc import tape"),
        ("tapewire.engine", "from tapewire.model import Job\nimport tapewire.line.driver"),
        ("tapewire.fanuc.tape", "from tapewire.protocols import PROTOCOLS"),
        ("tapewire.fanuc.tape", "from ..protocols import settings"),
        ("tapewire.line.driver", "def late() -> None:\n    from tapewire.store import base"),
        ("tapewire.line.driver", "if TYPE_CHECKING:\n    from tapewire.sim.world import World"),
        ("tapewire.line.driver", "importlib.import_module('tapewire.server')"),
        ("tapewire.line.driver", "import_module('tapewire.transfer')"),
        ("tapewire.store.base", "from tapewire.transfer import send"),
        ("tapewire.web.app", "import tapewire"),
        ("tapewire.web.app", "from tapewire import open_line"),
        ("tapewire.web.app", "from .. import open_line"),
        ("tapewire.cupboard", "import re"),
        ("tapewire.protocols.fanuc_b.host", "from tapewire.protocols.fanuc_b.cnc_packets import Buffer"),
        ("tapewire.protocols.fanuc_b.host", "from . import cnc_packets"),
        ("tapewire.protocols.fanuc_b.host", "from tapewire.protocols.fanuc_b import CncEngine"),
        ("tapewire.protocols.fanuc_b.host", "from tapewire.protocols import PROTOCOLS"),
        ("tapewire.protocols.fanuc_b.cnc_packets", "from tapewire.protocols.fanuc_b.host import Row"),
        ("tapewire.protocols.fanuc_b.messages", "from tapewire.protocols.fanuc_b.host import Row"),
    ],
)
def test_a_wrong_import_is_found(name: str, source: str) -> None:
    assert complaints(read_module(name, source, KNOWN))


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("tapewire.engine", "from tapewire import model\nimport asyncio"),
        ("tapewire.web.app", "from tapewire.cli import options\nfrom tapewire import model"),
        ("tapewire.protocols.fanuc_b.host", "from . import messages\nfrom ..settings import setting"),
        ("tapewire.protocols.fanuc_b.host_packets", "from tapewire.protocols.fanuc_b.host import Row"),
        ("tapewire.__main__", "from tapewire.cli import main"),
    ],
)
def test_a_right_import_is_not(name: str, source: str) -> None:
    assert complaints(read_module(name, source, KNOWN)) == []


def test_a_protocol_folder_brings_both_ends() -> None:
    source = "from .host import HostEngine\nfrom .cnc_packets import CncEngine"
    assert complaints(read_module("tapewire.protocols.fanuc_b", source, KNOWN, is_package=True)) == []
