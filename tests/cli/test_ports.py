"""`tapewire ports`: for people and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tapewire.cli import main
from tapewire.cli import ports as command
from tests.line.port_tree import PortTree


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as end:
        main(["ports", *words])
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PortTree:
    tree = PortTree(tmp_path)
    monkeypatch.setattr(command, "FILES", tree.files)
    return tree


def test_for_people(tree: PortTree, capsys: pytest.CaptureFixture[str]) -> None:
    tree.add_uart("ttyS0")
    tree.add_usb("ttyUSB0", "ch341-uart")
    stable = tree.name("usb-1a86-if00", "ttyUSB0")
    tree.open_by(7, "ttyS0", b"minicom\0")
    text = said(capsys)
    for words in ("16550A", "process 7: minicom", "86400 baud it runs 115200", stable, "cannot be asked", "CH340"):
        assert words in text


def test_for_programs(tree: PortTree, capsys: pytest.CaptureFixture[str]) -> None:
    tree.add_uart("ttyS0")
    tree.open_by(7, "ttyS0", b"minicom\0")
    port, end = [json.loads(line) for line in said(capsys, "--json").splitlines()]
    assert port["event"] == "port"
    assert port["rates_to_avoid"] == {"76800": 57600, "86400": 115200}
    assert port["held_by"] == [{"pid": 7, "command": "minicom"}]
    assert port["closed_loop"]
    assert (end["event"], end["outcome"]) == ("end", "complete")


def test_without_any_port(tree: PortTree, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no serial port" in said(capsys)
    assert json.loads(said(capsys, "--json"))["event"] == "end"
