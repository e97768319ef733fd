"""What is told of the serial ports of a computer, and what opening one makes of it."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from tapewire.errors import LineError
from tapewire.line.ports.chips import CHIPS, UNKNOWN_CHIP, chip_of
from tapewire.line.ports.files import Holder, PortFiles
from tests.line.fake_uart import Bench, bench
from tests.line.helpers import settings
from tests.line.port_tree import PortTree

FTDI = {"manufacturer": "FTDI", "product": "FT232R USB UART", "serial": "A600", "idVendor": "0403", "idProduct": "6001"}


@pytest.fixture
def tree(tmp_path: Path) -> PortTree:
    return PortTree(tmp_path)


def test_only_what_has_something_behind_it_is_a_port(tree: PortTree) -> None:
    tree.add_uart("ttyS10")
    tree.add_uart("ttyS2")
    tree.add_uart("ttyS3", kind=0)
    tree.add_usb("ttyACM0", "cdc_acm")
    for name in ("tty0", "tty", "console", "ptmx"):
        tree.add_console(name)
    assert [Path(port.path).name for port in tree.files.ports()] == ["ttyACM0", "ttyS2", "ttyS10"]


def test_no_ports_at_all(tmp_path: Path) -> None:
    assert PortFiles(sys=tmp_path, dev=tmp_path, proc=tmp_path).ports() == []


def test_a_uart_and_its_rates(tree: PortTree) -> None:
    tree.add_uart("ttyS0", console="Y")
    (port,) = tree.files.ports()
    assert (port.driver, port.uart, port.fifo, port.receive_trigger) == ("serial8250", "16550A", 16, 8)
    assert port.rates_to_avoid == {76800: 57600.0, 86400: 115200.0}
    assert 19200 in port.rates
    advice = " ".join(port.advice)
    for said in ("86400 baud it runs 115200", "receive trigger is 8", "console="):
        assert said in advice


@pytest.mark.parametrize(("version", "real"), [("0600", 76677), ("0900", 76800)])
def test_an_ftdi_adapter(tree: PortTree, version: str, real: int) -> None:
    tree.add_usb("ttyUSB0", "ftdi_sio", latency=16, bcdDevice=version, **FTDI)
    stable = tree.name("usb-FTDI_FT232R_A600-if00-port0", "ttyUSB0")
    (port,) = tree.files.ports()
    assert (port.usb_id, port.product) == ("0403:6001", "FTDI FT232R USB UART A600")
    assert port.stable_names == (stable,)
    assert port.latency_timer_ms == 16
    assert port.divider is not None
    assert round(port.divider.real_rate(76800)) == real
    assert 86400 in port.rates
    assert port.rates_to_avoid == {}
    assert tree.files.describe(stable) == port


def test_a_port_whose_clock_is_not_known(tree: PortTree) -> None:
    tree.add_usb("ttyUSB0", "cp210x")
    tree.add_usb("ttyUSB1", "something_new")
    tree.add_usb("ttyACM0", "cdc_acm")
    modem, first, second = tree.files.ports()
    assert first.chip is CHIPS["cp210x"]
    assert (first.rates, first.rates_to_avoid, first.divider) == ((), {}, None)
    assert any("three characters" in advice for advice in first.advice)
    assert second.chip is UNKNOWN_CHIP
    assert not modem.chip.has_cts
    assert any("no CTS" in advice for advice in modem.advice)


def test_a_device_that_calls_itself_something_long_and_nasty(tree: PortTree) -> None:
    tree.add_usb("ttyUSB0", "ftdi_sio", bcdDevice="0600", idVendor="0403", product="\x1b[2Jwiped" + "x" * 100_000)
    (port,) = tree.files.ports()
    assert port.product is not None
    assert "\x1b" not in port.product
    assert len(port.product) <= 4096


def test_who_has_it_open(tree: PortTree) -> None:
    tree.add_uart("ttyS0")
    tree.open_by(700, "ttyS0", b"picocom\0/dev/ttyS0\0\x1b[31m\0")
    tree.open_by(90, "ttyS0", b"")
    tree.open_by(91, "ttyS1", b"other\0")
    (tree.files.proc / "meminfo").write_text("")
    (port,) = tree.files.ports()
    holders, seen_all = tree.files.holders(port)
    assert holders == [Holder(pid=90, command="?"), Holder(pid=700, command="picocom /dev/ttyS0 ?[31m")]
    assert seen_all


def test_what_may_not_be_seen_is_said(tree: PortTree, monkeypatch: pytest.MonkeyPatch) -> None:
    tree.add_uart("ttyS0")
    tree.open_by(700, "ttyS0", b"x\0")
    (port,) = tree.files.ports()

    def refuse(folder: Path) -> None:
        raise PermissionError(13, "no", str(folder))

    monkeypatch.setattr("tapewire.line.ports.files._open_files", refuse)
    assert tree.files.holders(port) == ([], False)


def test_every_chip_is_found_by_its_driver() -> None:
    assert all(chip_of(driver) is chip for driver, chip in CHIPS.items())
    assert chip_of("ch341-uart") is CHIPS["ch341"]
    assert chip_of(None) is UNKNOWN_CHIP


# opening


def opened(port: Bench, tree: PortTree) -> list[str]:
    """The notes of opening the bench's port as the tree shows it."""
    notes: list[str] = []
    port.files = tree.files
    port.open(settings(baud=9600, stopbits=2), notes.append).close(0)
    return notes


def test_a_stop_request_is_to_be_told_at_once(tree: PortTree, monkeypatch: pytest.MonkeyPatch) -> None:
    with bench(Path("/nonexistent")) as port:
        tree.add_uart("ttyS0")
        monkeypatch.setattr(PortFiles, "describe", lambda files, path: files.ports()[0])
        trigger = tree.files.sys / "class" / "tty" / "ttyS0" / "rx_trig_bytes"
        assert opened(port, tree) == [
            f"{tree.files.dev}/ttyS0: receive trigger set from 8 to 1, so that a stop request is told at once"
        ]
        assert trigger.read_text() == "1"
        assert opened(port, tree) == []


def test_what_may_not_be_set_is_told_with_the_command_that_does(
    tree: PortTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench(Path("/nonexistent")) as port:
        tree.add_uart("ttyS0")
        monkeypatch.setattr(PortFiles, "describe", lambda files, path: files.ports()[0])
        monkeypatch.setattr("tapewire.line.ports.serial_port._write_one", lambda file: False)
        (note,) = opened(port, tree)
        assert "echo 1 | sudo tee" in note
        assert "rx_trig_bytes" in note


def test_an_ftdi_is_asked_by_the_driver_where_the_file_may_not_be_written(
    tree: PortTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench(Path("/nonexistent")) as port:
        tree.add_usb("ttyUSB0", "ftdi_sio", latency=16, bcdDevice="0600", **FTDI)
        monkeypatch.setattr(PortFiles, "describe", lambda files, path: files.ports()[0])
        monkeypatch.setattr("tapewire.line.ports.serial_port._write_one", lambda file: False)
        (note,) = opened(port, tree)
        assert "latency timer set from 16 to 1" in note
        assert port.uart.low_latency


def test_the_clock_under_sys_refuses_a_rate(tree: PortTree, monkeypatch: pytest.MonkeyPatch) -> None:
    with bench(Path("/nonexistent")) as port:
        tree.add_uart("ttyS0")
        monkeypatch.setattr(PortFiles, "describe", lambda files, path: files.ports()[0])
        port.files = tree.files
        with pytest.raises(LineError, match="would run 115200"):
            port.open(settings(baud=86400, stopbits=2))


def test_nothing_is_opened_by_looking(tree: PortTree) -> None:
    tree.add_uart("ttyS0")
    device = tree.files.dev / "ttyS0"
    before = device.stat()
    tree.files.ports()
    assert stat.S_ISREG(before.st_mode)
    assert device.stat().st_atime_ns == before.st_atime_ns
