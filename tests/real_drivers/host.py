"""Boots a virtual machine with the kernel's 8250 and ftdi_sio drivers and runs `guest.py` in it.

Needs Debian's qemu-system-x86, busybox-static, kmod and cpio, and fetches a stock kernel package, which is unpacked and
not installed. Without them it says what is missing and ends with status 77. It has real drivers, real ioctls, real
unplugging; its UART keeps no rate, so nothing here says how fast anything is.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
CACHE: Final = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tapewire" / "real-drivers"
TOOLS: Final = ("qemu-system-x86_64", "busybox", "modinfo", "cpio", "dpkg-deb", "apt-get", "apt-cache")
MODULES: Final = ("virtio_pci", "9pnet_virtio", "9p", "overlay", "xhci-pci", "ftdi_sio")
LIMIT_S: Final = 240.0
SKIPPED: Final = 77
PLUGGED: Final = {"always-plugged": True}

EXPECTED: Final = (
    ("/dev/ttyS1", "read back when asked for 86400", "86400"),
    ("the UART itself", "after being asked for 86400", "baudrate=115200"),
    ("/dev/ttyS1", "opened at 86400", "would run 115200"),
    ("the UART itself", "after being asked for 76800", "baudrate=57600"),
    ("/dev/ttyS1", "opened at 76800", "would run 57600"),
    *(("/dev/ttyS1", framing, "yes") for framing in ("8E1", "8N2", "7E1", "7E2", "7O1")),
    ("/dev/ttyS1", "stop distance", "2, guaranteed True"),
    ("/dev/ttyS1", "all 256 characters came back", "True"),
    ("/dev/ttyS1", "still in flight", "0"),
    ("/dev/ttyS1", "a break reads as", "BREAK"),
    ("/dev/ttyS1", "TIOCMIWAIT", "waits"),
    ("/dev/ttyS1", "RTS looped back is read as", "cts=True"),
    ("/dev/ttyS1", "opens again at once", "yes"),
    ("/dev/ttyS1", "a transfer", "complete"),
    ("/dev/ttyS1", "the control has it byte for byte", "True"),
    ("/dev/ttyUSB0", "note", "never says"),
    ("/dev/ttyUSB0", "all 256 characters came back", "True"),
    ("/dev/ttyUSB0", "TIOCMIWAIT", "waits"),
    ("/dev/ttyUSB0", "a transfer", "complete"),
    ("/dev/ttyUSB0", "the control has it byte for byte", "True"),
    ("/dev/ttyUSB0", "unplugged", "LOST"),
    ("/dev/ttyUSB0", "plugged in again it opens", "yes"),
)
"""What these drivers have to show, by what the finding holds."""

INIT: Final = """#!/bin/busybox sh
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sys /sys
/bin/busybox mount -t devtmpfs dev /dev
for module in $(/bin/busybox cat /modules); do /bin/busybox insmod /$module; done
/bin/busybox mount -t 9p -o ro,trans=virtio,version=9p2000.L,msize=262144 root /lower
/bin/busybox mount -t tmpfs tmpfs /upper
/bin/busybox mkdir /upper/up /upper/work
/bin/busybox mount -t overlay -o lowerdir=/lower,upperdir=/upper/up,workdir=/upper/work overlay /new
for folder in proc sys dev; do /bin/busybox mount --move /$folder /new/$folder; done
/bin/busybox mkdir -p /new/dev/pts /new/tmp
cd /new
exec /bin/busybox chroot /new /bin/sh -c '{command}; echo b > /proc/sysrq-trigger'
"""


def missing() -> list[str]:
    return [tool for tool in TOOLS if shutil.which(tool) is None]


def kernel() -> Path:
    """The folder of an unpacked kernel package."""
    if not (CACHE / "boot").is_dir():
        CACHE.mkdir(parents=True, exist_ok=True)
        asked = ["apt-cache", "depends", "linux-image-amd64"]
        listed = subprocess.run(asked, stdout=subprocess.PIPE, text=True, check=True)
        name = re.search(r"Depends: (linux-image-\S+)", listed.stdout)
        assert name, "apt knows no linux-image-amd64"
        subprocess.run(["apt-get", "download", "-qq", name[1]], cwd=CACHE, check=True)
        (package,) = CACHE.glob("linux-image-*.deb")
        subprocess.run(["dpkg-deb", "-x", package, CACHE], check=True)
        package.unlink()
    return CACHE


def modules_of(folder: Path) -> list[Path]:
    """The kernel modules needed, each behind those it depends on."""
    (library,) = (folder / "lib" / "modules").iterdir()
    files = {path.name.partition(".")[0].replace("-", "_"): path for path in library.rglob("*.ko*")}
    order: list[Path] = []

    def add(name: str) -> None:
        path = files[name.replace("-", "_")]
        if path in order:
            return
        said = subprocess.run(["modinfo", "-F", "depends", path], stdout=subprocess.PIPE, text=True, check=True)
        for needed in said.stdout.strip().split(","):
            if needed:
                add(needed)
        order.append(path)

    for name in MODULES:
        add(name)
    return order


def initrd(folder: Path, into: Path, command: str) -> Path:
    tree = into / "tree"
    for made in ("bin", "proc", "sys", "dev", "lower", "upper", "new"):
        (tree / made).mkdir(parents=True)
    shutil.copy(shutil.which("busybox") or "", tree / "bin" / "busybox")
    modules = modules_of(folder)
    for module in modules:
        shutil.copy(module, tree / module.name)
    (tree / "modules").write_text("\n".join(module.name for module in modules))
    (tree / "init").write_text(INIT.format(command=command))
    (tree / "init").chmod(0o755)
    image = into / "initrd"
    with image.open("wb") as out:
        files = subprocess.run(["find", "."], cwd=tree, stdout=subprocess.PIPE, check=True).stdout
        subprocess.run(["cpio", "-o", "-H", "newc", "--quiet"], cwd=tree, input=files, stdout=out, check=True)
    return image


def free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


class FarEnd:
    """Whoever is at the other end of a port's cable: an echo, or a simulated control."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.saved = Path()
        self._echo: socket.socket | None = None
        self._control: subprocess.Popen[bytes] | None = None

    def echo(self) -> None:
        self._echo = connection = socket.create_connection(("127.0.0.1", self.port))

        def work() -> None:
            with contextlib.suppress(OSError):
                while data := connection.recv(4096):
                    connection.sendall(data)

        threading.Thread(target=work, daemon=True).start()

    def control(self, folder: Path) -> None:
        if self._echo is not None:
            self._echo.shutdown(socket.SHUT_RDWR)
            self._echo.close()
        self.saved = folder / f"saved-{self.port}"
        words = ["--protocol", "fanuc-b", "--baud", "19200", "--save", str(self.saved), "--timeout", "100"]
        self._control = subprocess.Popen(
            [sys.executable, "-m", "tapewire", "cnc", "--line", f"socket://127.0.0.1:{self.port}", *words],
            stderr=subprocess.DEVNULL,
        )

    def end(self) -> None:
        if self._control is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._control.wait(20)
            self._control.kill()
            self._control.wait()


class Monitor:
    """QEMU's own line (QMP)."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(20)
        for _ in range(100):
            with contextlib.suppress(OSError):
                self._socket.connect(str(path))
                break
            time.sleep(0.1)
        self._file = self._socket.makefile("rw")
        self.say("qmp_capabilities")

    def say(self, command: str, **arguments: Any) -> None:
        self._file.write(json.dumps({"execute": command, "arguments": arguments}) + "\n")
        self._file.flush()
        while "return" not in (answer := json.loads(self._file.readline())):
            assert "error" not in answer, answer


def machine(folder: Path, image: Path, uart: int, usb: int) -> list[str]:
    (boot,) = (folder / "boot").glob("vmlinuz-*")
    return [
        "qemu-system-x86_64", "-accel", "tcg", "-m", "768", "-nodefaults", "-display", "none", "-no-reboot",
        "-kernel", str(boot), "-initrd", str(image), "-append", "console=ttyS0 quiet panic=-1",
        "-serial", "stdio",
        "-chardev", f"socket,id=uart,host=127.0.0.1,port={uart},server=on,wait=off",
        "-device", "isa-serial,chardev=uart,index=1",
        "-device", "qemu-xhci,id=xhci",
        "-chardev", f"socket,id=usb,host=127.0.0.1,port={usb},server=on,wait=off",
        "-device", "usb-serial,chardev=usb,bus=xhci.0,id=adapter,always-plugged=on",
        "-fsdev", "local,id=root,path=/,security_model=none,readonly=on,multidevs=remap",
        "-device", "virtio-9p-pci,fsdev=root,mount_tag=root",
        "-qmp", f"unix:{image.parent / 'qmp'},server=on,wait=off",
        "-trace", "serial_update_parameters", "-D", str(image.parent / "trace"),
    ]  # fmt: skip


def run(program: Path, work: Path) -> Iterator[dict[str, Any]]:
    """Every finding of the guest, and what the host adds to it."""
    command = f"cd {ROOT} && PYTHONPATH={ROOT}/src:{ROOT} {sys.executable} -m tests.real_drivers.guest {program}"
    image = initrd(kernel(), work, command)
    uart, usb = FarEnd(free_port()), FarEnd(free_port())
    ends = {"/dev/ttyS1": uart, "/dev/ttyUSB0": usb}
    words = machine(kernel(), image, uart.port, usb.port)
    with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as guest:
        killer = threading.Timer(LIMIT_S, guest.kill)
        killer.start()
        try:
            monitor = Monitor(image.parent / "qmp")
            for end in ends.values():
                end.echo()
            assert guest.stdout is not None
            for line in guest.stdout:
                if not line.startswith("{"):
                    continue
                finding = json.loads(line)
                if "done" in finding:
                    return
                if "ask" in finding:
                    yield from serve(finding["ask"], monitor, ends, work, program)
                else:
                    yield finding
        finally:
            killer.cancel()
            guest.kill()
            for end in ends.values():
                end.end()


def serve(asked: str, monitor: Monitor, ends: dict[str, FarEnd], work: Path, program: Path) -> Iterator[dict[str, Any]]:
    word, _, port = asked.partition(" ")
    match word:
        case "break":
            time.sleep(0.3)
            monitor.say("chardev-send-break", id="uart" if port == "/dev/ttyS1" else "usb")
        case "rate":
            time.sleep(0.1)
            trace = (work / "trace").read_text().splitlines() if (work / "trace").exists() else []
            yield {"port": "the UART itself", "what": f"after being asked for {port}", "is": trace[-1:] or None}
        case "control":
            ends[port].control(work)
        case "compare":
            ends[port].end()
            saved = ends[port].saved
            same = saved.is_file() and saved.read_bytes() == program.read_bytes()
            yield {"port": port, "what": "the control has it byte for byte", "is": same}
        case "unplug":
            monitor.say("device_del", id="adapter")
        case _:
            time.sleep(1)
            monitor.say("device_add", driver="usb-serial", chardev="usb", bus="xhci.0", id="adapter", **PLUGGED)


def main() -> int:
    if lacking := missing():
        packages = "qemu-system-x86 busybox-static kmod cpio"
        sys.stderr.write(f"not run: {', '.join(lacking)} missing (apt-get install {packages})\n")
        return SKIPPED
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "program.nc"
        text = (ROOT / "examples" / "surfacing.nc").read_bytes()[:3000]
        program.write_bytes(text[: text.rfind(b"\n") + 1] + b"M30\n%")
        findings = []
        for finding in run(program, Path(folder)):
            findings.append((finding["port"], finding["what"], str(finding["is"])))
            sys.stdout.write("{:16} {}: {}\n".format(*findings[-1]))
            sys.stdout.flush()
    disagreeing = [wanted for wanted in EXPECTED if not any(agrees(wanted, found) for found in findings)]
    for wanted in disagreeing:
        sys.stdout.write("not found: {} {}: {}\n".format(*wanted))
    return 1 if disagreeing else 0


def agrees(wanted: tuple[str, str, str], found: tuple[str, str, str]) -> bool:
    return found[:2] == wanted[:2] and wanted[2] in found[2]


if __name__ == "__main__":
    sys.exit(main())
