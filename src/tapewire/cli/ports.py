"""`tapewire ports`"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from typing import Any, Final

import click

from tapewire.cli.common import COMPLETE
from tapewire.cli.output import json_end
from tapewire.line.ports.files import Holder, Port, PortFiles

__all__ = ["FILES", "ports"]

FILES: Final = PortFiles()


@click.command()
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line on stdout.")
def ports(as_json: bool) -> int:
    """List the serial ports of this computer: what is plugged in, what it can do, what to avoid, and who has it open.

    Opens nothing and changes nothing.
    """
    found = [(port, *FILES.holders(port)) for port in FILES.ports()]
    if as_json:
        for port, holders, seen_all in found:
            _say(json.dumps(_fields(port, holders, seen_all)))
        _say(json_end("complete", f"{len(found)} serial ports"))
        return COMPLETE
    if not found:
        _say("no serial port here; an adapter shows up when it is plugged in and its driver knows it")
    for port, holders, seen_all in found:
        for line in _lines(port, holders, seen_all):
            _say(line)
    return COMPLETE


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _fields(port: Port, holders: list[Holder], seen_all: bool) -> dict[str, Any]:
    return {
        "event": "port",
        "time_ns": time.time_ns(),
        "path": port.path,
        "stable_names": port.stable_names,
        "driver": port.driver,
        "chip": port.chip.title,
        "uart": port.uart,
        "product": port.product,
        "usb_id": port.usb_id,
        "fifo": port.fifo,
        "receive_trigger": port.receive_trigger,
        "latency_timer_ms": port.latency_timer_ms,
        "closed_loop": port.chip.can_say_empty,
        "cts": port.chip.has_cts,
        "waits_for_signals": port.chip.can_wait_for_signals,
        "marks_damage": port.chip.marks_damage,
        "rates": port.rates if port.divider is not None else None,
        "rates_to_avoid": {str(baud): round(real) for baud, real in port.rates_to_avoid.items()},
        "advice": port.advice,
        "held_by": [{"pid": holder.pid, "command": holder.command} for holder in holders],
        "held_by_all_seen": seen_all,
    }


def _lines(port: Port, holders: list[Holder], seen_all: bool) -> Iterator[str]:
    kind = f"{port.chip.title} ({port.uart})" if port.uart is not None else port.chip.title
    device = f", {port.product}" if port.product else ""
    yield f"{port.path}  {kind}{device}, driver {port.driver or 'unknown'}"
    for name in port.stable_names:
        yield f"  stable name    {name}"
    if port.divider is not None:
        yield f"  rates          {' '.join(str(baud) for baud in port.rates)}"
    else:
        yield "  rates          its clock is not known: the driver's word counts when it is opened"
    fifo = "unknown" if port.fifo is None else f"{port.fifo} characters"
    asked = "the driver says whether the transmitter is empty" if port.chip.can_say_empty else "cannot be asked"
    yield f"  FIFO           {fifo}; {asked}"
    inputs = "CTS DSR CD RI" if port.chip.has_cts else "DSR CD RI"
    yield f"  control lines  RTS DTR out, {inputs} in"
    for holder in holders:
        yield f"  open by        process {holder.pid}: {holder.command}"
    if not seen_all and not holders:
        yield "  open by        nobody this user can see; run it with sudo to see all"
    for advice in port.advice:
        yield f"  note           {advice}"
