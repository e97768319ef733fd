"""Pictures of `tapewire cnc --panel`: a control in the simulated world, with a real host's end on its line."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Final

from rich.console import Console

from docs.generators.markup import without_fonts
from tapewire.cli.panel import state_of
from tapewire.cli.panel_page import ParameterPage
from tapewire.cli.panel_view import PanelState, page_room, picture
from tapewire.engine import SECOND
from tapewire.fanuc.host_settings import control_settings, host_settings
from tapewire.fanuc.parameter_file import read_parameters
from tapewire.protocols.settings import End
from tapewire.sim.world import Pair, World
from tapewire.transfer.example import example_program
from tapewire.transfer.operated import OperatedControl, OperatedTask
from tapewire.transfer.program import Program
from tapewire.transfer.session import settings_for

IMAGES: Final = Path(__file__).parents[1] / "images"

PARAMETERS: Final = "N0000 P00001100\nN0020 P10\nN5000 P00011000\nN5081 P3\nN5082 P1\nN5083 P12\nN5084 P1"

SMALL: Final = (80, 24)
LARGE: Final = (120, 40)


def operated(world: World, blocks_per_second: float = 20.0) -> tuple[OperatedControl, Pair]:
    """A control with `PARAMETERS` under the hands of nobody yet, and the machine whose host it has."""
    parameters = read_parameters(PARAMETERS).parameters
    host = host_settings(parameters)
    words = dict(control_settings(parameters, host.interface).settings)
    job = settings_for(End.CONTROL, "pty:./control", host.protocol, settings=words, baud=host.baud)
    task = OperatedTask(blocks_per_second=blocks_per_second, parameters=parameters)
    control = OperatedControl(task, job)
    pair = world.pair(host.protocol, baud=host.baud, host_settings=host.settings, cnc_settings=words)
    signals = pair.cnc_link.signals_in
    pair.cnc_side.link = control.attach(pair.cnc_link.transport)
    if signals is not None:
        pair.cnc_link.signals_in = signals
        control.cnc.receive_signals(signals, world.now)
    return control, pair


def running(world: World) -> OperatedControl:
    """In DNC operation, ten seconds in."""
    control, pair = operated(world)
    with closing(Program.from_file(example_program())) as program:
        program.rewind()
        pair.host.start(program, world.now)
        control.cycle_start(world.now)
        world.run_for(10 * SECOND)
    return control


def at_work() -> PanelState:
    return state_of(running(World()), "10:31:24")


def unplugged() -> PanelState:
    """The same control with the cable pulled."""
    world = World()
    control = running(world)
    control.turn_single_block()
    control.turn_plug(world.now)
    world.run_for(SECOND)
    return state_of(control, "10:31:25")


def parameters() -> PanelState:
    """The second page of the parameters: the rate has been changed, and the protocol to what there is none of."""
    control, _ = operated(World())
    page = ParameterPage(control)
    room = page_room(*SMALL)
    page.turn(room)
    for key in "5083=11\n5084=9\n5082=2":
        page.key(key, room)
    return state_of(control, "10:31:26", page.shown(room))


def svg(state: PanelState, size: tuple[int, int], name: str) -> str:
    width, height = size
    paper = Console(
        record=True, width=width, height=height, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    paper.print(picture(state, width, height), end="")
    return without_fonts(paper.export_svg(title="tapewire cnc --panel", unique_id=name))


PICTURES: Final[dict[Path, Callable[[], str]]] = {
    IMAGES / "panel-80x24.svg": lambda: svg(at_work(), SMALL, "panel"),
    IMAGES / "panel-120x40.svg": lambda: svg(unplugged(), LARGE, "panel-large"),
    IMAGES / "panel-parameters.svg": lambda: svg(parameters(), SMALL, "panel-parameters"),
}
