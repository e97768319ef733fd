"""Runs inside the virtual machine, on the kernel's own drivers, and says what it finds as lines of JSON.

Each line is {"port", "what", "is"}; {"ask": WORD} has the host do something; {"done": true} is the last.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import os
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from tapewire.engine import SignalsIn, SignalsOut
from tapewire.errors import LineError
from tapewire.line.descriptor import LineSettings, Parity
from tapewire.line.driver import monotonic
from tapewire.line.open import open_line, parse_line
from tapewire.line.ports.files import PortFiles
from tapewire.line.ports.kernel import TtyKernel
from tapewire.line.ports.serial_port import TtyLine, open_tty
from tapewire.line.transport import LineItem

UART, USB = "/dev/ttyS1", "/dev/ttyUSB0"
TIOCM_LOOP: Final = 0x8000
"""The UART's own loop-back: RTS comes back as CTS, DTR as DSR."""
LIMIT_S: Final = 20.0

KERNEL = TtyKernel()
STRICT = LineSettings(baud=9600, stopbits=2, window=2)


def say(**fields: Any) -> None:
    sys.stdout.write(json.dumps(fields) + "\n")
    sys.stdout.flush()


def tell(port: str, what: str, found: Any) -> None:
    say(port=port, what=what, **{"is": found})


def ask_host(word: str) -> None:
    say(ask=word)


def answer_of(ask: Callable[[], Any]) -> Any:
    """What a question to the driver gives: its answer, or the name of its error."""
    try:
        return ask()
    except OSError as error:
        return errno.errorcode.get(error.errno or 0, str(error))


def read_for(line: TtyLine, wanted: Callable[[list[LineItem]], bool], limit_s: float = LIMIT_S) -> list[LineItem]:
    """Everything read until `wanted` holds of it."""
    items: list[LineItem] = []
    until = time.monotonic() + limit_s
    while time.monotonic() < until and not wanted(items):
        if line.watched is not None:
            select.select([line.watched], [], [], 0.05)
        items += line.read(monotonic())
    return items


def data_of(items: list[LineItem]) -> bytes:
    return b"".join(item for item in items if isinstance(item, bytes))


def ioctls(path: str) -> None:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    questions: dict[str, Callable[[], Any]] = {
        "TCGETS2": lambda: KERNEL.settings(fd).output_baud,
        "TIOCMGET": lambda: hex(KERNEL.signals(fd)),
        "TIOCGICOUNT": lambda: str(KERNEL.counters(fd)),
        "TIOCSERGETLSR": lambda: KERNEL.transmitter_is_empty(fd),
        "TIOCOUTQ": lambda: KERNEL.queued(fd),
        "TIOCGSERIAL": lambda: str(KERNEL.info(fd)),
        "TIOCEXCL": lambda: KERNEL.claim(fd),
        "TIOCSBRK": lambda: KERNEL.begin_break(fd),
        "TIOCCBRK": lambda: KERNEL.end_break(fd),
    }
    for name, ask in questions.items():
        tell(path, name, answer_of(ask))
    KERNEL.disclaim(fd)
    os.close(fd)


def rates(path: str) -> None:
    """What the driver says when it is asked for a rate, past our own refusal; the host has the truth."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    for baud in (9600, 76800, 86400):
        before = KERNEL.settings(fd)
        flags = before.control_flags & ~termios.CBAUD if hasattr(termios, "CBAUD") else before.control_flags & ~0o10017
        KERNEL.set(fd, replace(before, control_flags=flags | 0o10000, input_baud=baud, output_baud=baud))
        tell(path, f"read back when asked for {baud}", KERNEL.settings(fd).output_baud)
        ask_host(f"rate {baud}")
        time.sleep(0.1)
    os.close(fd)
    for how in (replace(STRICT, baud=76800), replace(STRICT, baud=86400)):
        try:
            open_tty(path, how).close(0)
            tell(path, f"opened at {how.baud}", "yes")
        except LineError as error:
            tell(path, f"opened at {how.baud}", str(error))


def framings(path: str) -> None:
    for bits, stopbits, parity in ((8, 1, None), (8, 2, None), (7, 1, None), (7, 2, None), (7, 1, Parity.ODD)):
        how = LineSettings(baud=9600, stopbits=stopbits, window=2, data_bits=bits, parity=parity)
        try:
            open_tty(path, how).close(0)
            tell(path, how.framing, "yes")
        except LineError as error:
            tell(path, how.framing, str(error))


async def opened(path: str, notes: list[str]) -> TtyLine:
    """As users open it, with all that is found out at that."""
    line = await open_line(
        parse_line(f"{path}?signals=ignored"),
        baud=STRICT.baud,
        stopbits=STRICT.stopbits,
        window=STRICT.window,
        on_note=notes.append,
    )
    assert isinstance(line, TtyLine)
    return line


def characters(path: str) -> None:
    notes: list[str] = []
    line = asyncio.run(opened(path, notes))
    for note in notes:
        tell(path, "note", note)
    tell(path, "stop distance", f"{line.stop_distance.characters}, guaranteed {line.stop_distance.guaranteed}")
    said, sent = bytes(range(256)), 0
    items: list[LineItem] = []
    until = time.monotonic() + LIMIT_S
    while len(data_of(items)) < len(said) and time.monotonic() < until:
        if room := min(line.room(monotonic()), len(said) - sent):
            line.write(said[sent : sent + room], monotonic())
            sent += room
        items += line.read(monotonic())
    tell(path, "all 256 characters came back", data_of(items) == said)
    tell(path, "still in flight", line.in_flight(monotonic()))
    line.close(0)


def damage(path: str) -> None:
    line = open_tty(path, STRICT)
    before = line.counters()
    ask_host("break " + path)
    items = read_for(line, lambda items: any("BREAK" in str(item) for item in items), 2)
    tell(path, "a break reads as", [str(item) for item in items if not isinstance(item, SignalsIn)])
    after = line.counters()
    tell(path, "breaks counted", after.since(before).breaks if after and before else None)
    line.close(0)


def control_lines(path: str) -> None:
    line = open_tty(path, STRICT)
    fd = line._fd
    assert fd is not None
    line.read(monotonic())
    time.sleep(0.2)
    tell(path, "TIOCMIWAIT", "waits" if line._watch is not None and not line._watch.failed else "refused")
    looped = answer_of(lambda: KERNEL.set_signals(fd, TIOCM_LOOP, 0))
    if looped is None:
        line.set_signals(SignalsOut(rts=False, dtr=False), monotonic())
        read_for(line, lambda items: False, 0.3)
        began = monotonic()
        line.set_signals(SignalsOut(rts=True, dtr=False), monotonic())
        items = read_for(line, lambda items: any("cts=True" in str(item) for item in items), 2)
        tell(path, "RTS looped back is read as", [str(item) for item in items])
        tell(path, "after, ms", round((monotonic() - began) / 1e6, 1))
        KERNEL.set_signals(fd, 0, TIOCM_LOOP)
    else:
        tell(path, "loop-back", looped)
    began = monotonic()
    line.close(0)
    tell(path, "closing takes, ms", round((monotonic() - began) / 1e6, 1))
    open_tty(path, STRICT).close(0)
    tell(path, "opens again at once", "yes")


def unplugged(path: str) -> None:
    line = open_tty(path, STRICT)
    line.read(monotonic())
    ask_host("unplug")
    items = read_for(line, lambda items: any("LOST" in str(item) for item in items))
    tell(path, "unplugged", [str(item) for item in items if not isinstance(item, SignalsIn)])
    line.close(0)
    ask_host("plug")
    until = time.monotonic() + LIMIT_S
    while time.monotonic() < until:
        with contextlib.suppress(LineError):
            open_tty(path, STRICT).close(0)
            tell(path, "plugged in again it opens", "yes")
            return
        time.sleep(0.2)
    tell(path, "plugged in again it opens", "no")


def transfer(path: str, program: str) -> None:
    """The real command, with the host's simulated control at the far end."""
    words = ["send", program, "--line", f"{path}?signals=ignored", "--protocol", "fanuc-b", "--json", "--timeout", "60"]
    command = [sys.executable, "-m", "tapewire", *words, "--baud", "19200"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as host:
        assert host.stdout is not None
        end: dict[str, Any] = {}
        for line in host.stdout:
            end = json.loads(line)
            if end["event"] == "ready":
                ask_host("control " + path)
            elif end["event"] == "stop_distance":
                tell(path, "stop distance of fanuc-b at 19200", f"{end['characters']}, guaranteed {end['guaranteed']}")
    tell(path, "a transfer", f"{end.get('outcome')}, {end.get('bytes')} bytes, {end.get('reason')}")
    ask_host("compare " + path)


def main() -> None:
    tell("", "kernel", os.uname().release)
    for port in PortFiles().ports():
        tell(port.path, "ports", str(replace(port, chip=replace(port.chip, advice=()))))
    for path in (UART, USB):
        if not os.path.exists(path):
            tell(path, "is there", "no")
            continue
        for work in (ioctls, rates, framings, characters, damage, control_lines):
            try:
                work(path)
            except Exception as error:
                tell(path, f"{work.__name__} failed", repr(error))
        transfer(path, sys.argv[1])
    unplugged(USB)
    say(done=True)


assert struct.calcsize("P") == 8
if __name__ == "__main__":
    main()
