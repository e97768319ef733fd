"""The panel of a simulated control: the terminal, the keys, and the control behind them."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

import click
from rich.console import Console, RenderableType
from rich.live import Live

from tapewire.cli.common import COMPLETE, INTERRUPTED, NOT_COMPLETE
from tapewire.cli.ending import ignore_signals, stop_on_signals
from tapewire.cli.panel_keys import keys_of
from tapewire.cli.panel_page import ParameterPage
from tapewire.cli.panel_view import HEIGHT, WIDTH, Leds, Page, PanelState, SoftKey, page_room, picture
from tapewire.codes import TABLES, DataCode
from tapewire.engine import SignalsIn
from tapewire.errors import UsageError
from tapewire.fanuc.leds import BoardStatus
from tapewire.fanuc.memory import BUFFER_BYTES
from tapewire.fanuc.parameter_file import word_of
from tapewire.fanuc.parameters import ParameterSet
from tapewire.line.driver import monotonic
from tapewire.protocols.settings import Switch
from tapewire.sim.machine import Motion
from tapewire.sim.nc import Ground, Operation
from tapewire.transfer.operated import OperatedControl, Plug
from tapewire.transfer.session import ABORT_LIMIT_S
from tapewire.transfer.tape_window import Block

__all__ = ["LED_WORDS", "refuse_terminal", "run_panel", "state_of"]

DRAWN_EVERY_S: Final = 0.2
LAST_DRAWN_S: Final = 1.0

_LINE_NUMBERS: Final = ((5084, 5083, 5082), (5074, 5073, 5072), (5000, 5081, 5071), (0, 20))
"""Parameters of the communication row by row, as far as the file has them."""

_WORDS: Final = ("data", "code", "end", "posting", "echo", "mode", "program")
"""Settings of the protocols that an operator would look for."""

_TRANSFERS: Final = {Operation.READ: "INPUT", Operation.PUNCH: "OUTPUT"}


def refuse_terminal() -> None:
    """Raises UsageError where there is no terminal for a panel, or one that is too small."""
    streams = (sys.stdin, sys.stdout)
    if any(stream is None or not stream.isatty() for stream in streams) or os.environ.get("TERM") == "dumb":
        raise UsageError(
            "--panel needs a terminal for its screen and its keys: neither a pipe, nor a file, nor TERM=dumb"
        )
    width, height = Console().size
    if width < WIDTH or height < HEIGHT:
        raise UsageError(f"--panel needs a terminal of {WIDTH}x{HEIGHT} at least: this one is {width}x{height}")


def run_panel(make: Callable[[asyncio.Event], OperatedControl]) -> int:
    """Show the panel until somebody leaves it, and return the exit status. Raises LineError, UsageError."""
    status, last = asyncio.run(_run(make))
    with suppress(OSError):
        click.echo(last, err=True)
    return status


async def _run(make: Callable[[asyncio.Event], OperatedControl]) -> tuple[int, str]:
    stop, quitting = asyncio.Event(), asyncio.Event()
    control = make(stop)
    console = Console(highlight=False)
    page = ParameterPage(control)
    screen = _Screen(console, control, page)

    def on_key(key: str) -> None:
        press(key, control, page, page_room(*console.size), quitting)

    stop_on_signals(stop)
    working = asyncio.ensure_future(control.run())
    waits = [asyncio.ensure_future(stop.wait()), asyncio.ensure_future(quitting.wait())]
    complete = False
    try:
        with keys_of(sys.stdin.fileno(), on_key, stop.set):
            drawing = asyncio.ensure_future(screen.draw())
            try:
                await asyncio.wait([working, drawing, *waits], return_when=asyncio.FIRST_COMPLETED)
                complete = control.complete
                control.leave(monotonic())
                await asyncio.wait([working], timeout=ABORT_LIMIT_S)
            finally:
                drawing.cancel()
                await asyncio.wait([drawing])
    finally:
        ignore_signals()
        for task in (working, *waits):
            task.cancel()
        await asyncio.wait([working])
    if not working.cancelled():
        working.result()
    if not drawing.cancelled() and drawing.exception() is not None:
        return NOT_COMPLETE, "the terminal cannot be written any more"
    last = control.last
    told = (
        f"{control.nc.selected.name.lower()}: {last.outcome}, {last.reason}"
        if last is not None
        else "nothing was transferred"
    )
    return INTERRUPTED if stop.is_set() else COMPLETE if complete else NOT_COMPLETE, told


def press(key: str, control: OperatedControl, page: ParameterPage, room: int, quitting: asyncio.Event) -> None:
    """One key of the panel; others do nothing. `room` is how many parameters a page has."""
    if page.key(key, room):
        return
    now = monotonic()
    acts: dict[str, Callable[[], object]] = {
        "c": lambda: control.cycle_start(now),
        "h": lambda: control.feed_hold(now),
        "r": lambda: control.reset(now),
        "s": control.turn_single_block,
        "o": control.turn_optional_stop,
        "i": lambda: control.read(now),
        "p": lambda: control.punch_parameters(now) if page.number else control.punch(now),
        "t": lambda: control.stop(now),
        "b": control.turn_ground,
        "u": lambda: control.turn_plug(now),
        "w": lambda: control.power_off_and_on(now),
        "n": lambda: page.turn(room),
        "q": quitting.set,
    }
    acts.get(key.lower(), lambda: None)()


class _Screen:
    """Draws the state again and again. A terminal that takes nothing for a while does not stop the line."""

    def __init__(self, console: Console, control: OperatedControl, page: ParameterPage) -> None:
        self._console = console
        self._control = control
        self._page = page

    async def draw(self) -> None:
        """Until it is cancelled. Raises OSError when the terminal is gone."""
        with Live(console=self._console, screen=True, auto_refresh=False) as live:
            while True:
                page = self._page.shown(page_room(*self._console.size))
                state = state_of(self._control, time.strftime("%H:%M:%S"), page)
                showing = asyncio.ensure_future(asyncio.to_thread(self._show, live, state))
                try:
                    await asyncio.shield(showing)
                except asyncio.CancelledError:
                    # What is being drawn must not come after the screen has been put back.
                    await asyncio.wait([showing], timeout=LAST_DRAWN_S)
                    raise
                await asyncio.sleep(DRAWN_EVERY_S)

    def _show(self, live: Live, state: PanelState) -> None:
        live.update(self._picture(state), refresh=True)

    def _picture(self, state: PanelState) -> RenderableType:
        return picture(state, *self._console.size)


def state_of(control: OperatedControl, clock: str, page: Page | None = None) -> PanelState:
    """What the panel shows of `control`."""
    tape = control.tape
    machine = control.control
    position = machine.bytes_begun - (1 if machine.moving else 0)
    running = control.operation is Operation.DNC
    blocks = tape.blocks
    board = control.board
    return PanelState(
        title=f"SIMULATED CONTROL   {control.job.protocol.title}",
        clock=clock,
        mode="EDIT" if control.nc.selected in _TRANSFERS else "RMT",
        run=control.state,
        moving=machine.moving and machine.motion is Motion.RUNNING,
        transfer=_TRANSFERS.get(control.operation, ""),
        stands=control.stands,
        blocks=tuple(_text_of(block, control.code) for block in blocks),
        current=tape.index_at(position) if running else None,
        program=f"{control.cnc.progress:,} bytes, {machine.blocks_executed:,} blocks" if control.cnc.progress else "",
        page=page,
        buffered=control.cnc.buffered,
        capacity=BUFFER_BYTES if board is not None else control.job.params.buffer,
        pointers="" if board is None else _pointers(control),
        held=control.held,
        leds=None if board is None else Leds(green=board.green, red=board.red, meaning=LED_WORDS[board.status]),
        line=_line_of(control),
        alarms=tuple(f"{alarm.number}  {alarm.text}".strip() for alarm in control.alarms),
        messages=tuple(control.messages),
        keys=_keys_of(control, page),
    )


LED_WORDS: Final = {
    BoardStatus.POWER_ON: "power has just come on",
    BoardStatus.INITIALISING: "waiting for the other modules",
    BoardStatus.IDLE: "waiting for the control",
    BoardStatus.HANDLING: "handling a request",
    BoardStatus.STOPPING: "told to stop: RESET, alarm, EOR",
    BoardStatus.DRAM_TEST: "the DRAM test failed",
    BoardStatus.LOADING: "parity of the loaded code",
    BoardStatus.NMI: "NMI in another module",
    BoardStatus.SYSTEM_ALARM: "system alarm",
}
"""What the green LEDs mean, short enough for the panel."""


def _text_of(block: Block, code: DataCode) -> str:
    """As the controls show it, the EOB as a semicolon once it is there."""
    text = block.data.translate(TABLES[code].to_ascii).strip(b"\r\n\x00\x7f")
    return text.decode("latin-1") + (" ;" if text and block.is_whole and not text.startswith(b"%") else "")


def _pointers(control: OperatedControl) -> str:
    assert control.board is not None
    memory = control.board.memory
    return f"read {memory.read_pointer:04X}h  write {memory.write_pointer:04X}h"


def _line_of(control: OperatedControl) -> tuple[tuple[str, str], ...]:
    job, link = control.job, control.link
    parameters = None if control.parameters is None else control.parameters.in_force
    is_open = link is not None and not link.closed
    plug = "UNPLUGGED" if control.plug is Plug.OUT else "open" if is_open else "waiting for a host"
    rows = [
        ("line", control.ready or str(job.line)),
        ("", plug),
        ("rate", f"{job.baud} baud, {job.origin.framing}"),
        ("sees", _signals(link.signals_in if link is not None and is_open else None)),
    ]
    if control.nc.has_images:
        rows.append(("PMC", f"G152 {control.nc.g152:02X}h  F152 {control.nc.f152:02X}h"))
    name, told = ("set", _settings_of(job.params)) if parameters is None else ("No.", _numbers_of(parameters))
    for place, words in enumerate(told):
        rows.append(("" if place else name, "  ".join(words)))
    return tuple(rows)


def _settings_of(params: Any) -> list[list[str]]:
    values = [(name, getattr(params, name, None)) for name in _WORDS]
    words = [f"{name}={getattr(value, 'value', value)}" for name, value in values if value not in (None, "")]
    return [words[at : at + 2] for at in range(0, len(words), 2)]


def _numbers_of(parameters: ParameterSet) -> list[list[str]]:
    told = parameters.values
    rows = (
        [f"{number:04d}={word_of(number, told[number])}" for number in row if number in told] for row in _LINE_NUMBERS
    )
    return [row for row in rows if row]


def _signals(signals: SignalsIn | None) -> str:
    if signals is None:
        return "no control lines"
    named = (("CS", signals.cts), ("DR", signals.dsr), ("CD", signals.cd))
    return "  ".join(f"{name} {'ON' if on else 'OFF'}" for name, on in named)


def _keys_of(control: OperatedControl, page: Page | None) -> tuple[SoftKey, ...]:
    nc, punches = control.nc, control.job.protocol.punches_out
    unplugged = control.plug is Plug.OUT
    always = (
        SoftKey(key="C", label="CYCLE"),
        SoftKey(key="H", label="HOLD", lit=control.control.motion is Motion.HELD),
        SoftKey(key="R", label="RESET", lit=bool(control.alarms)),
    )
    switches = (
        SoftKey(key="S", label="SBK", lit=nc.single_block is Switch.ON),
        SoftKey(key="O", label="OSP", lit=nc.optional_stop is Switch.ON),
        SoftKey(key="I", label="READ"),
    )
    entry = (SoftKey(key="0-9", label="TYPE"), SoftKey(key="ENTER", label="INPUT"))
    background = (SoftKey(key="B", label="BG", lit=control.ground is Ground.BACKGROUND),)
    waiting = control.parameters is not None and bool(control.parameters.waiting)
    return (
        *always,
        *(switches if page is None else entry),
        *((SoftKey(key="P", label="PUNCH"),) if punches else ()),
        SoftKey(key="T", label="STOP"),
        *(background if control.board is not None else ()),
        *((SoftKey(key="U", label="PLUG" if unplugged else "UNPLUG", lit=unplugged),) if page is None else ()),
        *((SoftKey(key="W", label="POWER", lit=waiting),) if page is not None else ()),
        *((SoftKey(key="N", label="PARAM" if page is None else "NEXT"),) if control.parameters is not None else ()),
        SoftKey(key="Q", label="QUIT"),
    )
