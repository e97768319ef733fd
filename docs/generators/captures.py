"""A capture as `tapewire decode` tells it, and as it draws it."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Final

from docs.generators.markup import block
from tapewire.transfer.decoding.chart import Chart
from tapewire.transfer.decoding.reading import Decoded, decode
from tapewire.transfer.decoding.recognise import Asked
from tapewire.transfer.decoding.text import line_of

CAPTURE: Final = Path(__file__).parents[2] / "tests" / "captures" / "damaged_message.pcapng"
PICTURE: Final = Path(__file__).parents[1] / "images" / "capture.svg"


def _decoded() -> list[Decoded]:
    return list(decode(io.BytesIO(CAPTURE.read_bytes()), Asked()))


def _text() -> str:
    return block("\n".join(map(line_of, _decoded())), "text")


def picture() -> str:
    chart = Chart(CAPTURE.name)
    for decoded in _decoded():
        chart.add(decoded)
    return chart.svg()


PARTS: Final[dict[str, Callable[[], str]]] = {"decoded capture": _text}
