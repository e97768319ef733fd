"""The simulated world: hosts and controls on simulated cables, and one clock that jumps to the nearest deadline.

Nothing here waits, and nothing here is random but by the seed: the same calls give the same run to the byte.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import Any, Final

from tapewire.engine import SECOND, Nanos, Sink
from tapewire.errors import UsageError
from tapewire.line.faults.chance import derive
from tapewire.line.faults.damage import Parity
from tapewire.line.faults.injector import Injectors, injectors
from tapewire.line.faults.plan import Extent, FaultPlan
from tapewire.line.faults.presets import preset
from tapewire.line.link import Link
from tapewire.line.pacing import Pacing, character_time, default_window, pacing_for
from tapewire.line.paths import PATHS, PathKind
from tapewire.line.simulated import EndSettings, simulated_cable
from tapewire.protocols import protocol
from tapewire.protocols.settings import End
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.machine import Control
from tapewire.sim.pair import Pair, Side
from tapewire.sim.transcript import KEPT_LINES, Transcript

__all__ = ["Pair", "World"]

DAY: Final[Nanos] = 24 * 3600 * SECOND

CLEAN: Final = FaultPlan(name="none", why="nothing goes wrong")


def _path(name: str) -> PathKind:
    if name not in PATHS:
        raise UsageError(f"there is no path {name}: choose one of {', '.join(PATHS)}")
    return PATHS[name]


def _near_end(window: int, path: PathKind | None) -> EndSettings:
    """The host's end, paced as a real line of that path is; a bare UART is counted by the character.

    Its clock is right, so that a question asked before the transmitter should be empty would be in vain.
    """
    pacing = Pacing.WINDOW if path is None else pacing_for(window, path.transmitter_empty)
    return EndSettings(window=window, path=path, pacing=pacing, early=0)


class World:
    """Any number of machines and one clock, which starts at 0.

    `seed` and the number of a machine say all that chance does to it. `kept_lines` of each dialogue are kept; 0 writes
    nothing down.
    """

    def __init__(self, seed: int = 0, *, kept_lines: int = KEPT_LINES) -> None:
        self.now: Nanos = 0
        self.seed = seed
        self.pairs: list[Pair] = []
        self._kept_lines = kept_lines
        self._acts: list[tuple[Nanos, int, Callable[[], object]]] = []
        self._act_count = 0

    def pair(
        self,
        name: str,
        *,
        baud: int | None = None,
        settings: Mapping[str, str] | None = None,
        host_settings: Mapping[str, str] | None = None,
        cnc_settings: Mapping[str, str] | None = None,
        window: int | None = None,
        cnc_window: int = 2,
        grain: int = 1,
        has_signals: bool = True,
        latency: Nanos = 0,
        path: PathKind | str | None = None,
        faults: FaultPlan | str | None = None,
        extent: Extent | None = None,
        parity: Parity = Parity.CHECKED,
        sink: Sink | None = None,
        **operator: Any,
    ) -> Pair:
        """A host and a control of protocol `name` on a cable at `baud`.

        `settings` are `--set` words for both ends, `host_settings` and `cnc_settings` for one. `window` characters
        may be in flight from the host, `grain` is how many the control's UART reports at once. `path` is what stands
        between the host and the wire, `faults` what goes wrong on it, each a value or the name of one; `extent` is how
        long a transfer the faults are to expect, `parity` what both UARTs check. `sink` gets what the control takes, in
        place of the pair's own. `operator` goes to `Control`: blocks_per_second, block_time, reset_after, alarm_after,
        single_block. Raises UsageError.
        """
        entry = protocol(name)
        baud = baud or entry.baud
        shared = dict(settings or {})
        host_params = entry.params({**shared, **(host_settings or {})}, End.HOST)
        cnc_params = entry.params({**shared, **(cnc_settings or {})}, End.CONTROL)
        host, cnc = entry.host(host_params), entry.cnc(cnc_params)
        path = _path(path) if isinstance(path, str) else path
        plan = preset(faults) if isinstance(faults, str) else faults or CLEAN
        line = self._injectors(plan, name, extent=extent, character=character_time(baud), parity=parity)
        near, far = simulated_cable(
            baud,
            _near_end(window or default_window(baud, host.needs_stop_distance), path or plan.path),
            EndSettings(window=cnc_window, fifo=min(cnc_window, 2), grain=grain),
            latency=latency,
            has_signals=has_signals,
            faults=line if plan.line_faults else None,
        )
        program = BytesIO()
        operator.setdefault("binary", binary_operation(entry.binary_input(cnc_params)))
        control = Control(cnc, sink or program, eob=entry.text(cnc_params).eob, **operator)
        pair = Pair(
            entry=entry,
            host_params=host_params,
            cnc_params=cnc_params,
            host=host,
            cnc=cnc,
            control=control,
            host_side=Side(Link(host, near)),
            cnc_side=Side(Link(cnc, far, application=control)),
            program=program,
            transcript=Transcript(self._kept_lines),
            line=line,
        )
        pair.connect()
        self.pairs.append(pair)
        pair.step(self.now)
        return pair

    def _injectors(
        self, plan: FaultPlan, name: str, *, extent: Extent | None, character: Nanos, parity: Parity
    ) -> Injectors:
        """Every wire has a stream of its own, by the name of the protocol and the number of the machine."""
        number = str(len(self.pairs))
        return injectors(
            plan,
            lambda stream: derive(self.seed, name, number, stream),
            extent=extent,
            character=character,
            parity=parity,
        )

    # time

    def at(self, moment: Nanos, act: Callable[[], object]) -> None:
        """Do `act` at `moment`, which is not before now: an operator, a fault of an end."""
        assert moment >= self.now, f"{moment} ns has passed: it is {self.now} ns"
        self._act_count += 1
        heapq.heappush(self._acts, (moment, self._act_count, act))

    def step(self) -> bool:
        """Let everything happen that is due now, then jump to the nearest deadline. False when there is none."""
        deadline = self._settle(touched=True)
        if deadline is None:
            return False
        self.now = deadline
        return True

    def _settle(self, *, touched: bool) -> Nanos | None:
        """Step every machine until none has anything left to do at this moment; the nearest deadline after it."""
        while self._acts and self._acts[0][0] <= self.now:
            heapq.heappop(self._acts)[2]()
            touched = True
        nearest = self._acts[0][0] if self._acts else None
        for pair in self.pairs:
            deadline = pair.settle(self.now, touched=touched)
            if deadline is not None and (nearest is None or deadline < nearest):
                nearest = deadline
        return nearest

    def run_until(self, done: Callable[[], object], *, limit: Nanos = DAY) -> None:
        """Run until `done()`, which only looks. Raises AssertionError when the world falls quiet or `limit` ns pass
        before that.
        """
        end = self.now + limit
        touched = True
        while not done():
            deadline = self._settle(touched=touched)
            touched = False
            if done():
                return
            assert deadline is not None, f"everything is quiet and it is not done:\n{self._transcripts()}"
            assert deadline <= end, f"not done after {limit / SECOND} s:\n{self._transcripts()}"
            self.now = deadline

    def advance(self, done: Callable[[], object], until: Nanos) -> bool:
        """Run until `done()`, or to the moment `until`; whether it is done. A quiet world jumps there."""
        touched, is_done = True, done()
        while not is_done:
            deadline = self._settle(touched=touched)
            touched, is_done = False, done()
            if is_done:
                break
            if deadline is None or deadline > until:
                self.now = max(self.now, until)
                return False
            self.now = deadline
        return True

    def run_for(self, span: Nanos) -> None:
        """Let `span` ns pass."""
        end = self.now + span
        touched = True
        while (deadline := self._settle(touched=touched)) is not None and deadline <= end:
            self.now = deadline
            touched = False
        self.now = end

    def run_until_quiet(self, *, limit: Nanos = DAY) -> None:
        """Run until nothing is due any more. Raises AssertionError after `limit` ns."""
        end = self.now + limit
        touched = True
        while (deadline := self._settle(touched=touched)) is not None:
            self.now = deadline
            touched = False
            assert self.now <= end, f"not quiet after {limit / SECOND} s:\n{self._transcripts()}"

    def _transcripts(self) -> str:
        return "\n".join(str(pair.transcript) for pair in self.pairs)
