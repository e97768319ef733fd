"""Draws docs/images/demo.svg: what `tapewire demo` shows, half a minute in; and docs/images/capture.svg, which is what
`tapewire decode` makes of a capture; and the panels of `tapewire cnc --panel`.

The figures are those of the same job in the simulated world, so the picture is the same whenever it is drawn.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

from rich.console import Console

from docs.generators import captures, panel
from docs.generators.markup import without_fonts
from tapewire.cli.demo_view import DemoView
from tapewire.engine import SECOND, AfterStop, Event, Held, Nanos, Resumed
from tapewire.line.pacing import character_time, default_window
from tapewire.protocols.settings import End
from tapewire.sim.world import Pair, World
from tapewire.transfer.example import example_program
from tapewire.transfer.meter import Meter
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Progress
from tapewire.transfer.session import settings_for

PICTURE: Final = Path(__file__).parent / "images" / "demo.svg"
SHOWN_AT: Final[Nanos] = 30 * SECOND
PROTOCOL: Final = "fanuc-b-expansion"
COLUMNS: Final = 112


def main() -> None:
    world = World()
    pair = world.pair(PROTOCOL, blocks_per_second=400)
    program = Program.from_file(example_program())
    view = DemoView(program, settings_for(End.HOST, "pty:./control", PROTOCOL, settings={}))
    meter = watch(pair, view)
    program.rewind()
    pair.host.start(program, world.now)
    pair.cnc.cycle_start(world.now)
    world.run_for(SHOWN_AT)
    view.observe_host(host_progress(pair, meter, program.byte_count), world.now)
    view.observe_cnc(cnc_progress(pair), world.now)
    PICTURE.write_text(svg(view))
    captures.PICTURE.write_text(captures.picture())
    for path, draw in panel.PICTURES.items():
        path.write_text(draw())


def watch(pair: Pair, view: DemoView) -> Meter:
    """Let the view hear what both ends report, and measure the line as a job does."""
    baud = pair.entry.baud
    meter = Meter(character_time(baud), default_window(baud, pair.host.needs_stop_distance))

    def on_host(event: Event, now: Nanos) -> None:
        view.observe_host(event, now)
        match event:
            case Held():
                meter.hold(pair.host_link.transport.in_flight(now), now)
            case Resumed():
                meter.resume(now)
            case _:
                pass

    def on_cnc(event: Event, now: Nanos) -> None:
        if isinstance(event, AfterStop):
            view.observe_cnc(event, now)

    pair.host_link.on_sent = meter.count
    pair.host_link.on_event, pair.cnc_link.on_event = on_host, on_cnc
    return meter


def host_progress(pair: Pair, meter: Meter, total: int) -> Progress:
    share = meter.rate * meter.character / SECOND
    sent = pair.host.progress
    return Progress(bytes=sent, total=total, held=meter.held, rate=meter.rate, share=share, left_s=None)


def cnc_progress(pair: Pair) -> Progress:
    return Progress(
        bytes=pair.cnc.progress,
        total=None,
        held=False,
        rate=0.0,
        share=0.0,
        left_s=None,
        buffered=pair.cnc.buffered,
        blocks=pair.control.blocks_executed,
    )


def svg(view: DemoView) -> str:
    """The view as a terminal shows it; without the fonts that the drawing would load from elsewhere."""
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    console.print(view._picture())
    drawing = console.export_svg(title="scripts/demo", unique_id="demo")
    return without_fonts(drawing)


if __name__ == "__main__":
    main()
