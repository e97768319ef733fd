"""Listening for a rate: a control that talks at one rate and one framing is found, and nothing is sent meanwhile."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from tapewire.engine import LineFault, Nanos, Notice, Outcome, SignalsIn, SignalsOut
from tapewire.errors import LineError
from tapewire.line.transport import Fault, LineItem, StopDistance
from tapewire.protocols.settings import End
from tapewire.transfer import qualifying
from tapewire.transfer.qualifying import Plan, qualify_line
from tapewire.transfer.session import settings_for

ISO = bytes(byte | (0x80 if byte.bit_count() % 2 else 0) for byte in b"N10 G01 X1.5 Y2.5\r\nM30\r\n")


class Talker:
    """A control that talks at 4800 baud 8N2, heard at any other rate as damage."""

    opened: list[tuple[int, int, int]]
    refused: frozenset[int] = frozenset()

    def __init__(self) -> None:
        self.opened = []

    async def open(self, address: object, *, baud: int, stopbits: int, data_bits: int, **_: Any) -> HeardLine:
        if baud in self.refused:
            raise LineError(f"it cannot run at {baud} baud")
        self.opened.append((baud, data_bits, stopbits))
        right = (baud, data_bits, stopbits) == (4800, 8, 2)
        return HeardLine([ISO] if right else [Fault(fault=LineFault.FRAMING, byte=0xF0)] * 12)


class HeardLine:
    """A line that only listens: whoever writes to it fails."""

    stop_distance = StopDistance(characters=18, guaranteed=False, how="played")

    def __init__(self, items: list[LineItem]) -> None:
        self._items = items

    def read(self, now: Nanos) -> list[LineItem]:
        items, self._items = self._items, []
        return [*items, SignalsIn()]

    def set_signals(self, signals: SignalsOut, now: Nanos) -> None:
        """The lines of the control do not follow."""

    def close(self, now: Nanos) -> None:
        self._items = []


async def judged(talker: Talker, monkeypatch: pytest.MonkeyPatch) -> tuple[Outcome, list[str]]:
    monkeypatch.setattr(qualifying, "open_line", talker.open)
    monkeypatch.setattr(qualifying, "SETTLE_S", 0.0)
    told: list[str] = []
    job = settings_for(End.HOST, "/dev/nothing", "fanuc-b", baud=9600, settings={})
    job = replace(job, observer=lambda event, now: told.append(event.text) if isinstance(event, Notice) else None)
    result = await qualify_line(job, Plan(listen_s=0.01))
    return result.outcome, told


async def test_the_rate_a_control_talks_at_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    talker = Talker()
    outcome, told = await judged(talker, monkeypatch)
    assert outcome is Outcome.COMPLETE
    assert "listening: the control seems to talk at 4800 baud 8N2: 100% of what came makes sense" in told
    assert any("ISO 840" in text for text in told)
    assert talker.opened[1] == (9600, 8, 2), "the rate it was told comes first"


async def test_a_rate_the_port_does_not_have_is_told_and_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    talker = Talker()
    talker.refused = frozenset({300, 4800})
    _, told = await judged(talker, monkeypatch)
    assert any("300 baud 8N2 cannot be tried" in text for text in told)
    assert any("nothing that makes sense" in text for text in told)


async def test_listening_can_be_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qualifying, "open_line", Talker().open)
    job = settings_for(End.HOST, "/dev/nothing", "fanuc-b", settings={})
    asyncio.get_running_loop().call_later(0.2, job.stop.set)
    result = await qualify_line(job, Plan(listen_s=600))
    assert (result.outcome, result.reason) == (Outcome.CANCELLED, "given up here")
