"""A dialogue drawn as a sequence chart: two lifelines, time downwards, long runs folded.

Whatever was received is text in the picture and nothing else: every string that goes into it is escaped in one place.
"""

from __future__ import annotations

import textwrap
from collections import deque
from typing import Final
from xml.sax.saxutils import escape

from tapewire.engine import SECOND, Nanos
from tapewire.line.captures.reader import Problem
from tapewire.line.captures.records import Side
from tapewire.transfer.decoding.entry import Entry, Kind
from tapewire.transfer.decoding.folding import Fold, Row, fold
from tapewire.transfer.decoding.reading import Began, Decoded, Figures, Told
from tapewire.transfer.decoding.text import line_of, program_text

__all__ = ["Chart"]

MOST_ENTRIES: Final = 10_000
"""Of a longer dialogue its first and its last so many are drawn, and the rest is counted."""

MOST_PARTS: Final = 200
"""Streams that are drawn; a ring of many short jobs has more."""

MOST_ROWS: Final = 2_000
"""A picture longer than this is of no use to anybody; what is left out is said."""

WIDTH: Final = 720
TIME_X: Final = 92
LIFELINE: Final = {Side.HOST: 170, Side.CONTROL: 620}
MIDDLE: Final = (LIFELINE[Side.HOST] + LIFELINE[Side.CONTROL]) // 2
ROW: Final = 26
LINE: Final = 17
"""Height of a further line of text in a row."""
LABEL: Final = 58
"""Characters that fit between the lifelines."""
WIDE: Final = 96
"""Characters that fit across the picture."""
GAP: Final[Nanos] = SECOND
"""A silence of so long is shown as one."""

_STYLE: Final = """
svg { background: #ffffff; font: 13px system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
text { fill: #1c2430; }
.mono { font: 12px ui-monospace, "DejaVu Sans Mono", monospace; }
.time, .quiet { fill: #5b6675; }
.head { font-weight: 600; }
.life { stroke: #c3cad3; stroke-width: 2; }
.gap { stroke: #c3cad3; stroke-width: 2; stroke-dasharray: 2 5; }
.host { stroke: #1f5fbf; fill: #1f5fbf; }
.control { stroke: #0b7a5b; fill: #0b7a5b; }
.band { fill: #f1f3f6; stroke: #c3cad3; }
.wrong { fill: #fdecea; stroke: #b3261e; }
text.wrong { fill: #b3261e; stroke: none; font-weight: 600; }
@media (prefers-color-scheme: dark) {
  svg { background: #14171c; }
  text { fill: #e6e9ee; }
  .time, .quiet { fill: #9aa5b4; }
  .life, .gap { stroke: #465160; }
  .host { stroke: #7fb2ff; fill: #7fb2ff; }
  .control { stroke: #5fd3ae; fill: #5fd3ae; }
  .band { fill: #20262e; stroke: #465160; }
  .wrong { fill: #3a1d1c; stroke: #ff8a80; }
  text.wrong { fill: #ff8a80; }
}
"""


class Chart:
    """Collects what is decoded, in bounded memory, and draws it."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts: dict[int, _Part] = {}
        self._streams = 0
        self._problems: list[str] = []

    def add(self, decoded: Decoded) -> None:
        match decoded:
            case Began(stream=stream):
                self._streams += 1
                if len(self._parts) < MOST_PARTS:
                    self._parts[stream] = _Part(decoded)
            case Told(stream=stream, entry=entry) if stream in self._parts:
                self._parts[stream].add(entry)
            case Figures(stream=stream, lines=lines) if stream in self._parts:
                self._parts[stream].figures = lines
            case Problem() if len(self._problems) < MOST_ROWS:
                self._problems.append(line_of(decoded))
            case _:
                pass

    def svg(self) -> str:
        """The picture: light or dark as whoever looks at it likes it."""
        drawing = _Drawing()
        for part in self._parts.values():
            part.draw(drawing)
        if self._streams > len(self._parts):
            drawing.note(f"{self._streams - len(self._parts):,} more streams are told in the text, and not drawn")
        for problem in self._problems:
            drawing.wrong(problem.removeprefix("== "))
        return drawing.finish(f"What was said in {self._title}")


class _Part:
    """One stream of the capture."""

    def __init__(self, began: Began) -> None:
        self.began = began
        self.figures: tuple[str, ...] = ()
        self._first: list[Entry] = []
        self._last: deque[Entry] = deque(maxlen=MOST_ENTRIES)
        self._count = 0

    def add(self, entry: Entry) -> None:
        self._count += 1
        if len(self._first) < MOST_ENTRIES:
            self._first.append(entry)
        else:
            self._last.append(entry)

    def draw(self, drawing: _Drawing) -> None:
        drawing.heading(line_of(self.began).replace("== ", "").split("\n"))
        rows = list(fold(self._first))
        left_out = self._count - len(self._first) - len(self._last)
        tail = list(fold(list(self._last)))
        room = MOST_ROWS // 2
        drawing.begin()
        if left_out or len(rows) + len(tail) > MOST_ROWS:
            every = [*rows, *tail]
            head, tail = (rows if left_out else every)[:room], every[-room:]
            drawing.rows(head, self.began.at)
            drawing.note(f"{self._count:,} entries in all: the middle is left out here, not in the text")
            drawing.rows(tail, self.began.at)
        else:
            drawing.rows([*rows, *tail], self.began.at)
        drawing.end(self.figures)


class _Drawing:
    """Puts rows below one another."""

    def __init__(self) -> None:
        self._shapes: list[str] = []
        self._lives: list[str] = []
        self._y = 12
        self._life_from = 0

    def heading(self, lines: list[str]) -> None:
        self._y += 6
        for number, line in enumerate(lines):
            for piece in textwrap.wrap(line, WIDE) or [""]:
                self._y += 20
                self._text(24, self._y, piece, "head" if not number else "quiet")
        self._y += 14

    def begin(self) -> None:
        for side, x in LIFELINE.items():
            self._shapes.append(f'<rect class="band" x="{x - 46}" y="{self._y}" width="92" height="26" rx="5"/>')
            self._text(x, self._y + 18, side.value, "head", "middle")
        self._y += 30
        self._life_from = self._y

    def end(self, figures: tuple[str, ...]) -> None:
        self._y += 12
        self._life(self._life_from, self._y)
        for line in figures:
            for piece in textwrap.wrap(line, WIDE):
                self._y += 20
                self._text(24, self._y, piece)
        self._y += 16

    def rows(self, rows: list[Row], began: Nanos) -> None:
        before: Nanos | None = None
        for row in rows:
            if before is not None and row.at - before > GAP:
                self._silence(row.at - before)
            before = row.until
            match row:
                case Fold():
                    self._fold(row)
                case Entry(kind=Kind.SAID | Kind.PROGRAM):
                    self._arrow(row, began)
                case Entry():
                    self._happening(row, began)

    def note(self, text: str) -> None:
        self._band([text], "quiet")

    def wrong(self, text: str) -> None:
        self._band(textwrap.wrap(f"! {text}", WIDE), "wrong")

    def _arrow(self, entry: Entry, began: Nanos) -> None:
        side = entry.side or Side.HOST
        here, there = LIFELINE[side], LIFELINE[side.other]
        is_program = entry.kind is Kind.PROGRAM
        self._y += ROW + 4
        self._time(entry.at - began)
        way = 1 if there > here else -1
        width = 5 if is_program else 2
        tip = there - way * 2
        self._shapes.append(
            f'<path class="{side}" d="M{here + way * 3} {self._y}H{tip - way * 9}" stroke-width="{width}" fill="none"/>'
            f'<path class="{side}" d="M{tip} {self._y}l{-way * 11} -6v12z" stroke="none"/>'
        )
        label = program_text(entry) if is_program else entry.text
        self._text(MIDDLE, self._y - 7, _cut(label, LABEL), "mono" if is_program else "", "middle")

    def _happening(self, entry: Entry, began: Nanos) -> None:
        self._y += 6
        if entry.kind is Kind.NOTE:
            text, style = entry.text, "quiet"
        elif entry.kind is Kind.SIGNALS:
            text, style = entry.text, ""
        else:
            at = "" if entry.side is None else f", sent by the {entry.side}"
            text, style = f"! {entry.text}{at}", "wrong"
        lines = textwrap.wrap(text, LABEL + 12) or [""]
        self._time(entry.at - began, self._y + 16)
        self._band(lines, style)

    def _fold(self, row: Fold) -> None:
        program = f", {row.count:,} bytes of program" if row.count else ""
        took = (row.until - row.at) / SECOND
        what = ", ".join(row.what)
        top = self._y
        lines = [*textwrap.wrap(f"{row.times:,} times the same: {what}", LABEL), f"{took:.3f} s{program}"]
        self._y += 8
        self._band(lines, "quiet")
        self._y += 6
        self._interrupt(top, self._y)

    def _silence(self, span: Nanos) -> None:
        top = self._y
        self._y += ROW
        self._text(MIDDLE, self._y - 4, f"{span / SECOND:.1f} s of silence", "quiet", "middle")
        self._y += 8
        self._interrupt(top + 8, self._y)

    def _band(self, lines: list[str], style: str) -> None:
        """Text between the lifelines and over them."""
        height = len(lines) * LINE + 8
        shape = "wrong" if style == "wrong" else "band"
        widest = max(len(line) for line in lines)
        width = min(
            WIDTH - 24 if widest > LABEL + 12 else 560,
            max(120, round(widest * (8.2 if style == "wrong" else 7.4)) + 24),
        )
        left = max(8, MIDDLE - width // 2)
        self._shapes.append(
            f'<rect class="{shape}" x="{left}" y="{self._y}" width="{width}" height="{height}" rx="5"/>'
        )
        for number, line in enumerate(lines):
            self._text(left + width // 2, self._y + 17 + number * LINE, line, style, "middle")
        self._y += height

    def _interrupt(self, top: int, bottom: int) -> None:
        self._life(self._life_from, top)
        for x in LIFELINE.values():
            self._lives.append(f'<path class="gap" d="M{x} {top}V{bottom}"/>')
        self._life_from = bottom

    def _life(self, top: int, bottom: int) -> None:
        for x in LIFELINE.values():
            self._lives.append(f'<path class="life" d="M{x} {top}V{bottom}"/>')

    def _time(self, span: Nanos, y: int | None = None) -> None:
        self._text(TIME_X, (self._y + 4) if y is None else y, f"{span / SECOND:.3f}", "time", "end")

    def _text(self, x: int, y: int, text: str, style: str = "", anchor: str = "start") -> None:
        """The only way for a string into the picture."""
        safe = escape("".join(character if character.isprintable() else "?" for character in text))
        kind = f' class="{style}"' if style else ""
        self._shapes.append(f'<text x="{x}" y="{y}"{kind} text-anchor="{anchor}">{safe}</text>')

    def finish(self, title: str) -> str:
        height = self._y + 16
        safe = escape("".join(character if character.isprintable() else "?" for character in title))
        body = "\n".join([*self._lives, *self._shapes])
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}"'
            f' viewBox="0 0 {WIDTH} {height}" role="img">\n'
            f"<title>{safe}</title>\n<style>{_STYLE}</style>\n{body}\n</svg>\n"
        )


def _cut(text: str, limit: int) -> str:
    return text if len(text) <= limit else f"{text[: limit - 1]}…"
