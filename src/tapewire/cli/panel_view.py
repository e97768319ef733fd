"""What the panel of a simulated control looks like: a picture of a state, and nothing else.

What came over a line is shown as printable ASCII and nothing else: no sequence of it reaches the terminal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from rich import box
from rich.align import Align
from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from tapewire.fanuc.leds import Led, Red

__all__ = [
    "HEIGHT",
    "WIDTH",
    "Leds",
    "Mark",
    "Page",
    "PanelState",
    "Row",
    "SoftKey",
    "page_room",
    "picture",
    "printable",
]

WIDTH: Final = 80
HEIGHT: Final = 24
"""A terminal smaller than this is refused."""

SIDE_WIDTH: Final = 36
LARGE_WIDTH: Final = 110
LARGE_SIDE_WIDTH: Final = 46
LARGE_HEIGHT: Final = 34

_FRAME: Final = "cyan"
_LAMPS: Final = {Led.ON: "●", Led.OFF: "○", Led.FLASHING: "◐", Led.ALTERNATING: "◑"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Leds:
    """The LEDs of the remote buffer board (12.1), and the meaning of the green ones."""

    green: tuple[Led, Led]
    red: Red
    meaning: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftKey:
    """One key below the screen. `lit`: the switch is on, or the key is what the control waits for."""

    key: str
    label: str
    lit: bool = False


class Mark(Enum):
    """How a row of a page stands out."""

    PLAIN = ""
    WAITING = "yellow"
    WRONG = "bold red"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One row of a page."""

    text: str
    mark: Mark = Mark.PLAIN


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What stands in place of the program, and what is being typed below it."""

    title: str
    rows: tuple[Row, ...]
    entry: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelState:
    """Everything the panel shows. Texts may hold anything: the picture shows what is printable."""

    title: str
    clock: str
    mode: str
    """RMT or EDIT."""
    run: str
    moving: bool
    transfer: str = ""
    """INPUT or OUTPUT, as the controls print it while they read or punch."""
    stands: str = ""
    blocks: tuple[str, ...] = ()
    current: int | None = None
    """Which of the blocks is under execution, or is the next one."""
    program: str = ""
    """What the window of the program says of itself."""
    page: Page | None = None
    """In place of the program."""
    buffered: int = 0
    capacity: int = 1
    pointers: str = ""
    held: str = ""
    leds: Leds | None = None
    line: tuple[tuple[str, str], ...] = ()
    alarms: tuple[str, ...] = ()
    messages: tuple[str, ...] = ()
    keys: tuple[SoftKey, ...] = field(default=())


def printable(text: str) -> str:
    """`text` with a dot for every character that is not printable ASCII."""
    return "".join(sign if " " <= sign <= "~" else "." for sign in text)


def picture(state: PanelState, width: int, height: int) -> RenderableType:
    """The whole screen of `width` columns and `height` lines; for a smaller one than 80x24, a line that says so."""
    if width < WIDTH or height < HEIGHT:
        text = f"{width}x{height} is too small: {WIDTH}x{HEIGHT} at least. The control goes on."
        return Align.center(Text(text[: max(width, 0)], "bold"), vertical="middle")
    is_large = _is_large(width, height)
    alarm_lines, body_height = _heights(width, height)
    buffer_lines = 5 if state.leds is None else 7
    screen = Layout()
    screen.split_column(
        Layout(_head(state, width), size=1),
        Layout(name="body", size=body_height),
        Layout(_alarms(state, alarm_lines), size=alarm_lines + 2),
        Layout(_status(state, width), size=1),
        Layout(_soft_keys(state, width), size=2),
    )
    screen["body"].split_row(
        Layout(_program(state, body_height - 2) if state.page is None else _page(state.page), ratio=1),
        Layout(name="side", size=LARGE_SIDE_WIDTH if is_large else SIDE_WIDTH),
    )
    screen["side"].split_column(
        Layout(_buffer(state, (LARGE_SIDE_WIDTH if is_large else SIDE_WIDTH) - 4), size=buffer_lines),
        Layout(_line(state)),
    )
    return screen


def page_room(width: int, height: int) -> int:
    """Rows of a page on a screen of this size, beside the one that is typed in."""
    return max(_heights(width, height)[1] - 3, 1)


def _is_large(width: int, height: int) -> bool:
    return width >= LARGE_WIDTH and height >= LARGE_HEIGHT


def _heights(width: int, height: int) -> tuple[int, int]:
    """Lines of alarms and messages, and of the body with its frame."""
    alarm_lines = 8 if _is_large(width, height) else 3
    return alarm_lines, height - (alarm_lines + 2) - 4


def _framed(content: RenderableType, title: str, style: str = _FRAME) -> Panel:
    return Panel(content, title=Text(title, "bold"), title_align="left", box=box.SQUARE, border_style=style)


def _row(text: str, style: str = "") -> Text:
    return Text(printable(text), style, no_wrap=True, overflow="ellipsis")


def _head(state: PanelState, width: int) -> Text:
    right = f"{state.clock} "
    left = printable(f" {state.title}")[: width - len(right) - 1]
    return Text(left.ljust(width - len(right)) + right, "bold black on cyan", no_wrap=True)


def _program(state: PanelState, lines: int) -> Panel:
    """The current block a third from the top, so that more is seen of what comes than of what was."""
    at = len(state.blocks) if state.current is None else state.current
    first = max(0, min(at - lines // 3, len(state.blocks) - lines))
    rows = []
    for number, block in enumerate(state.blocks[first : first + lines], first):
        under = number == state.current
        past = state.current is None or number < state.current
        rows.append(_row(("> " if under else "  ") + block, "reverse bold" if under else "dim" if past else ""))
    if not rows:
        rows = [_row("CYCLE START asks the host for one", "dim")]
    return _framed(Group(*rows), f"PROGRAM {printable(state.program)}".rstrip())


def _page(page: Page) -> Panel:
    rows = [_row(row.text, row.mark.value) for row in page.rows]
    return _framed(Group(_row(f"> {page.entry}_", "bold"), *rows), printable(page.title))


def _buffer(state: PanelState, width: int) -> Panel:
    full = round(width * min(state.buffered, state.capacity) / state.capacity)
    full = max(full, 1) if state.buffered else 0
    style = "yellow" if state.held else "green"
    gauge = Text("█" * full, style, no_wrap=True) + Text("░" * (width - full), "dim")
    share = f"{state.buffered / state.capacity:.0%}"
    count = f"{state.buffered:,} of {state.capacity:,}"
    note = state.held or state.pointers
    rows = [
        gauge,
        Text(count, no_wrap=True) + Text(share.rjust(width - len(count))),
        _row(note, "yellow" if state.held else "dim"),
    ]
    if state.leds is not None:
        rows += _lamps(state.leds)
    return _framed(Group(*rows), "REMOTE BUFFER" if state.leds is not None else "RECEIVE BUFFER")


def _lamps(leds: Leds) -> list[Text]:
    row = Text("LED ", no_wrap=True)
    for number, led in enumerate(leds.green, 1):
        row.append(f"{number} ").append(_LAMPS[led], "dim" if led is Led.OFF else "bold green").append("  ")
    row.append("red ")
    for red in (Red.RESET, Red.L_BUS, Red.DRAM_PARITY):
        row.append(f"{red.value} ").append("●" if leds.red is red else "○", "bold red" if leds.red is red else "dim")
        row.append("  ")
    return [row, _row(leds.meaning, "dim")]


def _line(state: PanelState) -> Panel:
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True, style="dim", min_width=4)
    table.add_column(no_wrap=True, overflow="ellipsis")
    for name, value in state.line:
        table.add_row(_row(name), _row(value))
    return _framed(table, "COMMUNICATION")


def _alarms(state: PanelState, lines: int) -> Panel:
    """Alarms first; what is left of the place has the latest messages, the newest last."""
    rows = [_row(alarm, "bold red") for alarm in state.alarms[-lines:]]
    room = lines - len(rows)
    rows += [_row(message) for message in state.messages[-room:]] if room else []
    is_alarm = bool(state.alarms)
    return _framed(Group(*rows), "ALARM" if is_alarm else "MESSAGE", "red" if is_alarm else _FRAME)


def _status(state: PanelState, width: int) -> Text:
    """As the controls print it: mode, automatic operation, axes, alarm, and what is read or punched."""
    row = Text(no_wrap=True)
    row.append(f" {state.mode:<4} ", "bold").append(
        f" {state.run:<4} ", "bold green" if state.run == "STRT" else "bold"
    )
    row.append(f" {'MTN' if state.moving else '***'}  *** ")
    row.append("  ALM ", "bold white on red") if state.alarms else row.append("  *** ")
    row.append(f"  {state.transfer:<6} ", "bold")
    row.append(printable(state.stands), "yellow")
    row.truncate(width)
    return row


def _soft_keys(state: PanelState, width: int) -> Text:
    """Two lines: what each key does, and the key."""
    labels, keys = Text(no_wrap=True), Text(no_wrap=True)
    for number, soft in enumerate(state.keys, 1):
        cell = width * number // len(state.keys) - len(labels)
        labels.append(soft.label.center(cell - 1), "bold black on yellow" if soft.lit else "reverse").append(" ")
        keys.append(f"[{soft.key}]".center(cell - 1), "bold cyan").append(" ")
    return labels + Text("\n") + keys
