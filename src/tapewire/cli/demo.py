"""`tapewire demo`: a host and a simulated control on a pair of pseudo terminals, at a real baud rate."""

from __future__ import annotations

import asyncio
import tempfile
from contextlib import closing
from pathlib import Path

import click

from tapewire.cli.common import COMPLETE, INTERRUPTED, NOT_COMPLETE, Number
from tapewire.cli.demo_view import DemoView
from tapewire.cli.ending import stop_on_signals
from tapewire.engine import Nanos, Outcome
from tapewire.line.captures.file import CaptureSettings
from tapewire.protocols.settings import End
from tapewire.transfer.control import ControlTask, run_control
from tapewire.transfer.example import example_program
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Ready, Report, Result
from tapewire.transfer.sending import send_program
from tapewire.transfer.session import settings_for

__all__ = ["demo"]


@click.command()
@click.option(
    "--protocol", default="fanuc-b-expansion", show_default=True, metavar="NAME", help="fanuc-b or fanuc-b-expansion."
)
@click.option("--baud", type=click.IntRange(300, 4_000_000), help="Bits a second of the line; 86400 for expansion B.")
@click.option(
    "--blocks-per-second",
    type=Number(0.001, 1_000_000),
    default=400.0,
    show_default=True,
    help="Execution speed of the control; slower than the line, so that it stops the host again and again.",
)
@click.option(
    "--capture",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Put the host's end of the line on record in FILE.",
)
def demo(protocol: str, baud: int | None, blocks_per_second: float, capture: Path | None) -> int:
    """Feed an example program of 245 KB to a simulated control and watch both ends of the line."""
    with tempfile.TemporaryDirectory(prefix="tapewire-demo-") as folder:
        port = str(Path(folder) / "control")
        kept = None if capture is None else CaptureSettings(path=capture)
        host = settings_for(End.HOST, port, protocol, settings={}, baud=baud, capture=kept)
        cnc = settings_for(End.CONTROL, f"pty:{port}", protocol, settings={}, baud=baud)
        program = Program.from_file(example_program())
        view = DemoView(program, host)
        stop = asyncio.Event()

        async def both() -> tuple[Result, Result]:
            stop_on_signals(stop)
            open_now = asyncio.Event()

            def observe_cnc(report: Report, now: Nanos) -> None:
                view.observe_cnc(report, now)
                if isinstance(report, Ready):
                    open_now.set()

            machine = ControlTask(blocks_per_second=blocks_per_second)
            control = asyncio.ensure_future(run_control(machine, cnc.observed_by(observe_cnc, stop)))
            opened = asyncio.ensure_future(open_now.wait())
            try:
                await asyncio.wait([control, opened], return_when=asyncio.FIRST_COMPLETED)
                if control.done():
                    control.result()  # without a control there is no line: this says why
                sent = await send_program(program, host.observed_by(view.observe_host, stop))
                return sent, await control
            finally:
                opened.cancel()
                control.cancel()
                await asyncio.gather(opened, control, return_exceptions=True)

        with view, closing(program):
            sent, taken = asyncio.run(both())
        return _status(view.conclude(sent, taken), sent, stop.is_set())


def _status(identical: bool, sent: Result, interrupted: bool) -> int:
    if interrupted and sent.outcome is Outcome.CANCELLED:
        return INTERRUPTED
    return COMPLETE if identical and sent.outcome is Outcome.COMPLETE else NOT_COMPLETE
