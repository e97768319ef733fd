"""A computer's /sys, /dev and /proc as files of a test."""

from __future__ import annotations

import os
from pathlib import Path

from tapewire.line.ports.files import PortFiles


class PortTree:
    """Ports are added by what the kernel shows of them."""

    def __init__(self, folder: Path) -> None:
        self.files = PortFiles(sys=folder / "sys", dev=folder / "dev", proc=folder / "proc")
        for made in (self.files.sys / "class" / "tty", self.files.dev / "serial" / "by-id", self.files.proc):
            made.mkdir(parents=True)

    def add_uart(
        self, name: str, *, kind: int = 4, clock: int = 1_843_200, trigger: int = 8, console: str = "N"
    ) -> None:
        tty = self._tty(name, self.files.sys / "devices" / f"uart-{name}")
        shown = {"type": kind, "uartclk": clock, "rx_trig_bytes": trigger, "xmit_fifo_size": 16, "console": console}
        for file, value in shown.items():
            (tty / file).write_text(f"{value}\n")

    def add_usb(self, name: str, driver: str, *, latency: int | None = None, **device: str) -> None:
        usb = self.files.sys / "devices" / f"usb-{name}"
        port = usb / "1:1.0" / name
        self._tty(name, port)
        for file, text in device.items():
            (usb / file).write_text(f"{text}\n")
        if latency is not None:
            (port / "latency_timer").write_text(f"{latency}\n")
        folder = self.files.sys / "bus" / driver
        folder.mkdir(parents=True, exist_ok=True)
        (port / "driver").symlink_to(folder)

    def add_console(self, name: str) -> None:
        """A virtual terminal: nothing is plugged in behind it."""
        (self.files.sys / "class" / "tty" / name).mkdir()

    def name(self, stable: str, name: str) -> str:
        link = self.files.dev / "serial" / "by-id" / stable
        link.symlink_to(f"../../{name}")
        return str(link)

    def open_by(self, pid: int, name: str, command: bytes) -> None:
        folder = self.files.proc / str(pid)
        (folder / "fd").mkdir(parents=True)
        (folder / "cmdline").write_bytes(command)
        os.symlink(self.files.dev / name, folder / "fd" / "5")
        os.symlink("socket:[1]", folder / "fd" / "6")

    def _tty(self, name: str, device: Path) -> Path:
        device.mkdir(parents=True)
        tty = self.files.sys / "class" / "tty" / name
        tty.mkdir()
        (tty / "device").symlink_to(device)
        (self.files.dev / name).touch()
        return tty
