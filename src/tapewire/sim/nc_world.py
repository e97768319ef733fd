"""A control with its operator in the simulated world, made of its parameters alone, and the host that suits it."""

from __future__ import annotations

from tapewire.codes import DataCode
from tapewire.engine import Event, Nanos
from tapewire.fanuc.host_settings import control_settings, host_settings
from tapewire.fanuc.parameter_check import ParameterMemory
from tapewire.fanuc.parameters import Interface, ParameterSet
from tapewire.sim.board import Board, watch
from tapewire.sim.nc import Nc
from tapewire.sim.pair import Pair
from tapewire.sim.program_flow import ProgramFlow
from tapewire.sim.world import World

__all__ = ["WorldNc", "nc_of"]


class WorldNc(Nc):
    """A control of the simulated world, and the machine that it is part of."""

    board: Board
    parameters: ParameterMemory

    def __init__(self, pair: Pair, parameters: ParameterMemory, fitted: Interface | None) -> None:
        super().__init__(parameters, fitted)
        self.pair = pair
        self.connect(pair.cnc, pair.control, watch(pair), pair.cnc_params)
        tell = pair.on_cnc_event

        def on_event(event: Event, now: Nanos) -> None:
            if tell is not None:
                tell(event, now)
            self.heard(event, now)

        pair.on_cnc_event = on_event
        pair.on_step = self.step_behind


def nc_of(
    world: World,
    parameters: ParameterSet,
    board: Interface,
    *,
    flow: ProgramFlow | None = None,
    protocol: str | None = None,
    **operator: object,
) -> WorldNc:
    """A control with these parameters, and the host that suits it, on a cable. Raises UsageError where none does.

    `flow` None obeys the M codes and executes every block. `operator` goes to `World.pair`.
    """
    memory = ParameterMemory(parameters, board)
    host = host_settings(memory.in_force, board=board, protocol=protocol)
    control = control_settings(memory.in_force, board)
    words = {**host.settings, **({} if host.data_to_control is None else {"data": str(host.data_to_control)})}
    flow = flow or ProgramFlow(DataCode(control.settings["data"]))
    pair = world.pair(
        host.protocol,
        baud=host.baud,
        host_settings=words,
        cnc_settings=dict(control.settings),
        flow=flow,
        **operator,  # type: ignore[arg-type]
    )
    return WorldNc(pair, memory, board)
