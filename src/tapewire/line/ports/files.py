"""The serial ports of this computer, as the kernel shows them under /sys, /dev and /proc. Nothing is opened."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tapewire.line.ports.chips import Chip, chip_of, uart_name
from tapewire.line.rates import Divider, is_near

__all__ = ["Holder", "Port", "PortFiles"]

USUAL_RATES: Final = (300, 600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 76800, 86400, 115200)
"""The rates of controls; 76800 and 86400 are those of RS-422 (B-63322EN-1 2.2)."""

NO_UART: Final = 0
"""A port of which the kernel says that there is nothing behind it."""

FAST_FTDI: Final = frozenset({0x0700, 0x0800, 0x0900})
"""bcdDevice of the FTDI chips with the fast clock: FT2232H, FT4232H, FT232H."""

TEXT_BOUND: Final = 4096
"""Characters read of one file of /sys: a device chooses its own name."""

_PORT_NAME: Final = re.compile(r"tty[A-Za-z]+[0-9]+")
_VIRTUAL: Final = re.compile(r"tty[0-9]+|tty|console|ptmx")


@dataclass(frozen=True, slots=True, kw_only=True)
class Holder:
    """A program that has a port open."""

    pid: int
    command: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """One serial port."""

    path: str
    stable_names: tuple[str, ...] = ()
    """Names that stay with the device whatever is plugged in first: /dev/serial/by-id/…, then by-path."""
    driver: str | None = None
    chip: Chip
    uart: str | None = None
    product: str | None = None
    """What the device calls itself, with its serial number."""
    usb_id: str | None = None
    divider: Divider | None = None
    """None where the rates it makes cannot be calculated."""
    fifo: int | None = None
    receive_trigger: int | None = None
    """Characters that must come before the UART says so; a lone stop request waits four character times more."""
    latency_timer_ms: int | None = None
    low_latency_files: tuple[str, ...] = ()
    """What may be written to have a stop request told at once."""
    is_console: bool = False

    @property
    def rates(self) -> tuple[int, ...]:
        """Usual rates it makes within two percent; empty where that is not known."""
        if self.divider is None:
            return ()
        return tuple(baud for baud in USUAL_RATES if is_near(self.divider.real_rate(baud), baud))

    @property
    def rates_to_avoid(self) -> dict[int, float]:
        """Usual rates it does not make, and what it runs instead."""
        if self.divider is None:
            return {}
        return {baud: self.divider.real_rate(baud) for baud in USUAL_RATES if baud not in self.rates}

    @property
    def advice(self) -> tuple[str, ...]:
        """What to avoid, in words."""
        said = list(self.chip.advice)
        for baud, real in self.rates_to_avoid.items():
            said.append(f"asked for {baud} baud it runs {real:.0f}: that rate is refused")
        if self.receive_trigger is not None and self.receive_trigger > 1:
            said.append(
                f"its receive trigger is {self.receive_trigger}: a stop request waits four character times more;"
                " Tapewire sets it to 1 where it may"
            )
        if self.is_console:
            said.append("the system writes its messages there: take it out of console= first")
        return tuple(said)


@dataclass(frozen=True, slots=True)
class PortFiles:
    """Where to look; a test gives its own folders."""

    sys: Path = field(default=Path("/sys"))
    dev: Path = field(default=Path("/dev"))
    proc: Path = field(default=Path("/proc"))

    def ports(self) -> list[Port]:
        """Every port with something behind it, in the order of its name."""
        folder = self.sys / "class" / "tty"
        names = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
        found = (self._port(name) for name in names if _PORT_NAME.fullmatch(name) and not _VIRTUAL.fullmatch(name))
        return sorted((port for port in found if port is not None), key=lambda port: _by_number(port.path))

    def describe(self, path: str) -> Port | None:
        """The port at `path`, which may be a stable name; None when the kernel shows none there."""
        return self._port(Path(os.path.realpath(path)).name)

    def holders(self, port: Port) -> tuple[list[Holder], bool]:
        """Who has it open, and whether everybody could be seen."""
        found: list[Holder] = []
        seen_all = True
        processes = (entry for entry in self.proc.iterdir() if entry.name.isdigit())
        for process in sorted(processes, key=lambda entry: int(entry.name)):
            try:
                if any(target == port.path for target in _open_files(process / "fd")):
                    found.append(Holder(pid=int(process.name), command=_command(process)))
            except PermissionError:
                seen_all = False
            except OSError:  # it has ended meanwhile
                continue
        return found, seen_all

    def _port(self, name: str) -> Port | None:
        tty = self.sys / "class" / "tty" / name
        if not _PORT_NAME.fullmatch(name) or not (tty / "device").exists():
            return None
        kind = _number(tty / "type")
        if kind == NO_UART:
            return None
        driver = _driver(tty, kind)
        chip = chip_of(driver)
        usb = _usb_device(tty)
        trigger, latency = tty / "rx_trig_bytes", tty / "device" / "latency_timer"
        return Port(
            path=str(self.dev / name),
            stable_names=self._stable_names(name),
            driver=driver,
            chip=chip,
            uart=uart_name(kind) if kind is not None else None,
            product=_product(usb),
            usb_id=_usb_id(usb),
            divider=_divider(chip, tty, kind, usb),
            fifo=_number(tty / "xmit_fifo_size") or chip.fifo,
            receive_trigger=_number(trigger),
            latency_timer_ms=_number(latency),
            low_latency_files=tuple(str(file) for file in (trigger, latency) if file.exists()),
            is_console=_text(tty / "console") == "Y",
        )

    def _stable_names(self, name: str) -> tuple[str, ...]:
        names: list[str] = []
        for folder in (self.dev / "serial" / "by-id", self.dev / "serial" / "by-path"):
            with suppress(OSError):
                names += sorted(str(link) for link in folder.iterdir() if os.path.realpath(link).endswith(f"/{name}"))
        return tuple(names)


def _by_number(path: str) -> tuple[str, int]:
    letters = path.rstrip("0123456789")
    return letters, int(path[len(letters) :] or 0)


def _text(file: Path) -> str | None:
    """The first line of a small file, printable; None where there is none."""
    with suppress(OSError), file.open(encoding="utf-8", errors="replace") as opened:
        line = opened.read(TEXT_BOUND).partition("\n")[0].strip()
        return "".join(character for character in line if character.isprintable())
    return None


def _number(file: Path) -> int | None:
    text = _text(file)
    with suppress(ValueError):
        return int(text or "", 0)
    return None


def _driver(tty: Path, kind: int | None) -> str | None:
    """The driver's name. A UART of the serial core says by its type which family it is, whatever found it."""
    if kind is not None and uart_name(kind) is not None:
        return "serial8250"
    link = tty / "device" / "driver"
    return Path(os.path.realpath(link)).name if link.exists() else None


def _usb_device(tty: Path) -> Path | None:
    """The folder of the USB device that a port belongs to."""
    folder = Path(os.path.realpath(tty / "device"))
    for parent in (folder, *folder.parents):
        if (parent / "idVendor").exists():
            return parent
    return None


def _product(usb: Path | None) -> str | None:
    if usb is None:
        return None
    words = [_text(usb / name) for name in ("manufacturer", "product", "serial")]
    return " ".join(word for word in words if word) or None


def _usb_id(usb: Path | None) -> str | None:
    if usb is None:
        return None
    return f"{_text(usb / 'idVendor')}:{_text(usb / 'idProduct')}"


def _divider(chip: Chip, tty: Path, kind: int | None, usb: Path | None) -> Divider | None:
    if chip.divider_parts == 1 and kind is not None:
        clock = _number(tty / "uartclk")
        return Divider(top=clock // 16) if clock else None
    if chip.divider_parts == 8 and usb is not None:
        version = int(_text(usb / "bcdDevice") or "0", 16)
        return Divider(top=12_000_000 if version in FAST_FTDI else 3_000_000, parts=8)
    return None


def _open_files(folder: Path) -> Iterator[str]:
    for entry in folder.iterdir():
        with suppress(FileNotFoundError):
            yield os.readlink(entry)


def _command(process: Path) -> str:
    words = (process / "cmdline").read_bytes()[:TEXT_BOUND].split(b"\0")
    text = " ".join(word.decode(errors="replace") for word in words if word) or (_text(process / "comm") or "?")
    return "".join(character if character.isprintable() else "?" for character in text)
