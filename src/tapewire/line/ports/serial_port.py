"""Opens a terminal and sets it up, or says why not and what to do.

A rate is refused by the clock of the UART, not by the word of its driver. What was changed at a port that is refused
is set back.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import stat
import termios
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from tapewire.errors import LineBusy, LineError, LineNotFound
from tapewire.line.descriptor import LineSettings, Parity
from tapewire.line.ports.chips import uart_name
from tapewire.line.ports.files import Port, PortFiles
from tapewire.line.ports.kernel import Settings, TtyKernel
from tapewire.line.ports.tty_line import TtyLine
from tapewire.line.rates import Divider, is_near

__all__ = ["TtyLine", "open_tty"]

BOTHER: Final = 0o010000
"""The rate stands in the speed fields as a number."""

_PARITY: Final = {Parity.NONE: 0, Parity.EVEN: termios.PARENB, Parity.ODD: termios.PARENB | termios.PARODD}
_FRAMING: Final = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB


def open_tty(
    path: str,
    settings: LineSettings,
    *,
    kernel: TtyKernel | None = None,
    files: PortFiles | None = None,
    on_note: Callable[[str], None] | None = None,
) -> TtyLine:
    """Open the terminal at `path` for this program alone and set it up. Nothing that has come in is flushed.

    `on_note` is told what was set besides, and what could not be. Raises LineNotFound, LineBusy, or LineError with
    what to do.
    """
    kernel = kernel or TtyKernel()
    fd = _open(path)
    is_ours = False
    try:
        is_pseudo = kernel.is_pseudo(fd)
        _claim(fd, path, kernel, is_pseudo)
        is_ours = True
        port = None if is_pseudo else (files or PortFiles()).describe(path)
        _set_up(fd, path, settings, kernel, is_pseudo, None if is_pseudo else _divider(fd, kernel, port))
        if port is not None:
            port = _hurry(fd, kernel, port, on_note or _nobody)
        return TtyLine(fd, settings, path=path, kernel=kernel, is_pseudo=is_pseudo, port=port)
    except BaseException:
        if is_ours:
            # Whoever else holds it must not lose it by our having tried.
            kernel.disclaim(fd)
        os.close(fd)
        raise


def _nobody(text: str) -> None:
    del text


def _open(path: str) -> int:
    try:
        if not stat.S_ISCHR(os.stat(path).st_mode):
            raise LineError(f"{path} is not a serial port")
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except PermissionError as error:
        raise LineError(
            f"no permission to open {path}: join the group dialout (sudo usermod -aG dialout $USER) and log in anew"
        ) from error
    except LineError:
        raise
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise LineBusy(_held(path)) from error
        raise LineNotFound(f"{path} cannot be opened: {error.strerror}; is it plugged in?") from error
    if not os.isatty(fd):
        os.close(fd)
        raise LineError(f"{path} is not a serial port")
    return fd


def _held(path: str) -> str:
    return f"{path} is held by another program: close that one first (tapewire ports says which it is)"


def _claim(fd: int, path: str, kernel: TtyKernel, is_pseudo: bool) -> None:
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LineBusy(_held(path)) from error
    if not is_pseudo:
        # On a slave it would outlive a killed program for as long as the master lives.
        kernel.claim(fd)


def _divider(fd: int, kernel: TtyKernel, port: Port | None) -> Divider | None:
    """By /sys, or where that shows no clock by what the driver says of its UART."""
    if port is not None and port.divider is not None:
        return port.divider
    with contextlib.suppress(OSError):
        info = kernel.info(fd)
        if uart_name(info.type) is not None and info.baud_base > 0:
            return Divider(top=info.baud_base)
    return None


def _set_up(
    fd: int, path: str, settings: LineSettings, kernel: TtyKernel, is_pseudo: bool, divider: Divider | None
) -> None:
    if divider is not None and not is_near(real := divider.real_rate(settings.baud), settings.baud):
        below, above = divider.neighbours(settings.baud)
        raise LineError(
            f"{path} cannot run at {settings.baud} baud: its UART would run {real:.0f}, and has {below:.0f} and"
            f" {above:.0f} nearest; set the control to a rate both have, or use another adapter"
        )
    framing = termios.CS8 if settings.data_bits == 8 else termios.CS7
    framing |= _PARITY[settings.parity_bit] | (termios.CSTOPB if settings.stopbits == 2 else 0)
    before = None
    try:
        before = kernel.settings(fd)
        kernel.set(fd, _wanted(before, settings.baud, framing))
        got = kernel.settings(fd)
    except OSError as error:
        _restore(fd, kernel, before)
        raise LineError(f"{path} cannot be set to {settings.baud} baud: {error.strerror}") from error
    if not is_near(got.output_baud, settings.baud):
        _restore(fd, kernel, before)
        raise LineError(
            f"{path} cannot run at {settings.baud} baud: the nearest rate of its driver is {got.output_baud};"
            " set the control to a rate both have, or use another adapter"
        )
    if not is_pseudo and got.control_flags & _FRAMING != framing:
        _restore(fd, kernel, before)
        raise LineError(f"{path} cannot run {settings.framing}: its driver refuses it; use another adapter")


def _wanted(before: Settings, baud: int, framing: int) -> Settings:
    characters = bytearray(before.characters)
    characters[termios.VMIN], characters[termios.VTIME] = 1, 0
    return replace(
        before,
        input_flags=termios.INPCK | termios.PARMRK,
        output_flags=0,
        control_flags=framing | termios.CREAD | termios.CLOCAL | BOTHER,
        local_flags=0,
        characters=bytes(characters),
        input_baud=baud,
        output_baud=baud,
    )


def _restore(fd: int, kernel: TtyKernel, before: Settings | None) -> None:
    with contextlib.suppress(OSError):
        if before is not None:
            kernel.set(fd, before)


def _hurry(fd: int, kernel: TtyKernel, port: Port, note: Callable[[str], None]) -> Port:
    """Have a stop request told as soon as it is in: receive trigger 1, latency timer 1 ms. Returns the port as it is
    then.
    """
    trigger, latency = port.receive_trigger, port.latency_timer_ms
    for file in port.low_latency_files:
        is_trigger = file.endswith("rx_trig_bytes")
        before = trigger if is_trigger else latency
        if before is None or before <= 1:
            continue
        what = "receive trigger" if is_trigger else "latency timer"
        if _write_one(file) or (not is_trigger and _low_latency(fd, kernel)):
            note(f"{port.path}: {what} set from {before} to 1, so that a stop request is told at once")
            trigger, latency = (1, latency) if is_trigger else (trigger, 1)
        else:
            note(
                f"{port.path}: {what} is {before} and may not be set by this user, so a stop request is told late:"
                f" echo 1 | sudo tee {file}"
            )
    return replace(port, receive_trigger=trigger, latency_timer_ms=latency)


def _write_one(file: str) -> bool:
    try:
        Path(file).write_text("1")
    except OSError:
        return False
    return True


def _low_latency(fd: int, kernel: TtyKernel) -> bool:
    try:
        kernel.ask_low_latency(fd)
    except OSError:
        return False
    return True
