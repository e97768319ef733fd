"""Deliberate bugs, one at a time: what the campaign must notice.

Each replaces one method, or one of its effects, of one engine. `presets` are the faults under which it shows soonest.
An engine that asserts its own table breaks under some of them: that proves the assertion. So the bug is put where the
table is not asked, or the assertion goes with it, and what a broken engine did is not counted as noticed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from tapewire.engine import Outcome
from tapewire.protocols.bridgeport.cnc import BridgeportCnc
from tapewire.protocols.bridgeport.cnc_records import Record
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.host_job import _Ending
from tapewire.protocols.bridgeport.host_transmission import LinkRecords
from tapewire.protocols.fanuc_a import messages as fanuc_a_messages
from tapewire.protocols.fanuc_a import packets as fanuc_a_packets
from tapewire.protocols.fanuc_a.cnc_packets import PacketSession
from tapewire.protocols.fanuc_a.host import FanucAHost
from tapewire.protocols.fanuc_a.host_job import Job, Supply
from tapewire.protocols.fanuc_a.host_line import HostLine
from tapewire.protocols.fanuc_a.host_packets import PacketStream
from tapewire.protocols.fanuc_a.host_streaming import Streaming
from tapewire.protocols.fanuc_b.cnc import FanucBCnc
from tapewire.protocols.fanuc_b.cnc_buffer import ReceiveBuffer
from tapewire.protocols.fanuc_b.host import FanucBHost
from tapewire.protocols.fanuc_b.host import State as BState
from tapewire.protocols.fanuc_b.host_reception import Reception
from tapewire.protocols.fanuc_b.messages import ControlCode

__all__ = ["MUTANTS", "Mutant"]

Wrap = Callable[[Callable[..., Any]], Callable[..., Any]]
"""The method as it is to the method as it is not to be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """One bug: what it does, in which protocol it is looked for, and the methods it spoils."""

    name: str
    protocol: str
    presets: tuple[str, ...]
    spoils: tuple[tuple[Any, str, Wrap], ...]

    @contextmanager
    def alive(self) -> Iterator[None]:
        """The bug is there inside this block."""
        with ExitStack() as stack:
            for engine, attribute, wrap in self.spoils:
                owner = next(part for part in engine.__mro__ if attribute in part.__dict__)
                method = owner.__dict__[attribute]
                if isinstance(method, property):
                    assert method.fget is not None
                    stack.enter_context(patch.object(owner, attribute, property(wrap(method.fget))))
                else:
                    stack.enter_context(patch.object(owner, attribute, wrap(method)))
            yield


def _instead(effect: Callable[..., Any]) -> Wrap:
    return lambda method: effect


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _after(effect: Callable[..., Any]) -> Wrap:
    """The method, and then this."""

    def wrap(method: Callable[..., Any]) -> Callable[..., Any]:
        def spoilt(self: Any, *args: Any, **kwargs: Any) -> Any:
            result = method(self, *args, **kwargs)
            effect(self)
            return result

        return spoilt

    return wrap


def _before(effect: Callable[..., Any]) -> Wrap:
    """This, and then the method."""

    def wrap(method: Callable[..., Any]) -> Callable[..., Any]:
        def spoilt(self: Any, *args: Any, **kwargs: Any) -> Any:
            effect(self)
            return method(self, *args, **kwargs)

        return spoilt

    return wrap


# protocol B


def _deaf_to(*codes: ControlCode) -> Wrap:
    """Wherever they come, nothing follows from them."""

    def wrap(method: Callable[..., Any]) -> Callable[..., Any]:
        def receive(self: Any, code: ControlCode, now: int) -> None:
            if code not in codes:
                method(self, code, now)

        return receive

    return wrap


def _one_chunk_more(method: Callable[..., Any]) -> Callable[..., Any]:
    """DC3 is obeyed when a chunk more has been handed over."""

    def look(self: Any, limit: int) -> Any:
        if self.state is BState.HELD and not getattr(self, "mutant_chunk", False) and not self._recall:
            return self._supply.ahead[:limit]
        return method(self, limit)

    return look


def _drop_first(self: Any) -> None:
    self._supply.ahead = self._supply.ahead[1:]


def _say_first_twice(self: Any) -> None:
    self._supply.ahead = self._supply.ahead[:1] + self._supply.ahead


def _certain_is_sent(method: Callable[..., Any]) -> Callable[..., Any]:
    def finish(self: Any) -> None:
        self._certain = self._delivery.sent
        self._delivery.in_flight = 0
        method(self)

    return finish


def _complete_when_handed_over(method: Callable[..., Any]) -> Callable[..., Any]:
    def fill(self: Any, now: int) -> None:
        method(self, now)
        if self.state is BState.DELIVERED:
            self._end(Outcome.COMPLETE, "handed over", now)

    return fill


def _abort_with_eor(method: Callable[..., Any]) -> Callable[..., Any]:
    """A host that gives up ends the tape, which makes a cut program look whole."""

    def abort(self: Any, now: int) -> None:
        if self.state is BState.SENDING:
            self._supply.ahead = b"%"
            self._supply._source = None
            return
        method(self, now)

    return abort


def _stays_armed(method: Callable[..., Any]) -> Callable[..., Any]:
    """A job that has failed is still armed, with what is left of its program."""

    def finish(self: Any) -> None:
        supply, failed = self._supply, self._ending is not None and self._ending[0] is not Outcome.COMPLETE
        method(self)
        if failed and not supply.is_over:
            self._supply = supply
            self._state = BState.ARMED
            self._delivery.sent = 0

    return finish


def _damage_is_data(method: Callable[..., Any]) -> Callable[..., Any]:
    def fault(self: Any, fault: Any, byte: int | None, now: int) -> None:
        if byte is not None:
            self.receive_data(bytes([byte]), now)

    return fault


def _loses_at_the_level(method: Callable[..., Any]) -> Callable[..., Any]:
    def receive(self: Any, data: bytes) -> int:
        before = self.received
        taken: int = method(self, data)
        if before < 4096 <= self.received:
            del self._data[-1:]
        return taken

    return receive


# protocol A and its expansion


def _next_dat_for_rty(method: Callable[..., Any]) -> Callable[..., Any]:
    def on_rty(self: Any, now: int) -> None:
        if self._is_sending_dat:
            self._send_dat(now, late=False)
        else:
            method(self, now)

    return on_rty


def _high_is_low(method: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self: self._high


def _done_too_early(method: Callable[..., Any]) -> Callable[..., Any]:
    """What the source has given counts as taken."""
    return lambda self: self._exhausted


def _last_too_early(method: Callable[..., Any]) -> Callable[..., Any]:
    def supply(self: Any, size: int) -> Any:
        result = method(self, size)
        return Supply.LAST if self._exhausted else result

    return supply


def _one_further(method: Callable[..., Any]) -> Callable[..., Any]:
    def go_back(self: Any, number: int | None, most: int, **rest: Any) -> Any:
        following = None if number is None else 0x30 + (number - 0x30 + 1) % 10
        return method(self, following, most, **rest)

    return go_back


def _end_not_repeated(method: Callable[..., Any]) -> Callable[..., Any]:
    def go_back(self: Any, number: int | None, most: int, **rest: Any) -> Any:
        ended = self.end_begun
        result = method(self, number, most, **rest)
        self.end_begun = ended or self.end_begun
        if ended:
            self._position = self._built
        return result

    return go_back


def _nak_off_by_one(method: Callable[..., Any]) -> Callable[..., Any]:
    def want(self: Any, monitor: Any, number: int | None = None) -> Any:
        wrong = None if number is None else 0x30 + (number - 0x30 + 1) % 10
        return method(self, monitor, wrong)

    return want


def _rst_is_forgotten(method: Callable[..., Any]) -> Callable[..., Any]:
    def interrupt(self: Any, outcome: Any, reason: str, now: int) -> None:
        if "RST" not in reason and "reset state" not in reason:
            method(self, outcome, reason, now)

    return interrupt


# Bridgeport


def _deaf_to_cancel(method: Callable[..., Any]) -> Callable[..., Any]:
    def hear(self: Any, character: int, now: int) -> None:
        if character & 0x7F != self._params.cancel:
            method(self, character, now)

    return hear


def _same_record_again(method: Callable[..., Any]) -> Callable[..., Any]:
    def prove(self: Any) -> None:
        method(self)
        if self._index == 2:
            self._text.ahead = self._record[: self._data_bytes] + self._text.ahead

    return prove


def _always_good(method: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self, check: True


def _delivered_is_handed_over(method: Callable[..., Any]) -> Callable[..., Any]:
    def delivered(self: Any) -> tuple[int, int]:
        high: int = method(self)[1]
        return high, high

    return delivered


def _any_sum(method: Callable[..., Any]) -> Callable[..., Any]:
    """Whatever the two digits say, they are taken for right."""

    def decode(self: Any, raw: bytes) -> Any:
        return method(self, self._coding.encode(fanuc_a_messages.checksum(raw[2:])) + raw[2:])

    return decode


_B, _BX, _A, _AX, _BP = "fanuc-b", "fanuc-b-expansion", "fanuc-a", "fanuc-a-expansion", "bridgeport"
_QUIET, _WORN, _PLAIN = ("clean",), ("worn-connector",), ("no-parity",)

MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        name="B: DC3 ignored for one chunk",
        protocol=_B,
        presets=_QUIET,
        spoils=((FanucBHost, "data_to_send", _one_chunk_more),),
    ),
    Mutant(
        name="B: DC3 ignored",
        protocol=_BX,
        presets=_QUIET,
        spoils=((FanucBHost, "_receive_code", _deaf_to(ControlCode.DC3)),),
    ),
    Mutant(
        name="B: resume skips a byte",
        protocol=_B,
        presets=_QUIET,
        spoils=((FanucBHost, "_on_dc1", _before(_drop_first)),),
    ),
    Mutant(
        name="B: resume repeats a byte",
        protocol=_BX,
        presets=_QUIET,
        spoils=((FanucBHost, "_on_dc1", _before(_say_first_twice)),),
    ),
    Mutant(
        name="B: bytes_low counts what was handed over",
        protocol=_B,
        presets=_WORN,
        spoils=((FanucBHost, "_finish", _certain_is_sent),),
    ),
    Mutant(
        name="B: complete without the closing DC3",
        protocol=_B,
        presets=("clean", "worn-connector"),
        spoils=((FanucBHost, "_fill", _complete_when_handed_over),),
    ),
    Mutant(
        name="B: SYN and NAK ignored",
        protocol=_B,
        presets=_QUIET,
        spoils=((FanucBHost, "_receive_code", _deaf_to(ControlCode.SYN, ControlCode.NAK)),),
    ),
    Mutant(
        name="B: giving up ends the tape", protocol=_B, presets=_QUIET, spoils=((FanucBHost, "abort", _abort_with_eor),)
    ),
    Mutant(
        name="B: a failed job stays armed", protocol=_B, presets=_QUIET, spoils=((FanucBHost, "_finish", _stays_armed),)
    ),
    Mutant(
        name="B: a damaged code is obeyed",
        protocol=_B,
        presets=("welder-next-door",),
        spoils=((FanucBHost, "receive_line_fault", _damage_is_data),),
    ),
    Mutant(
        name="B: the control stores a damaged character",
        protocol=_B,
        presets=_WORN,
        spoils=((FanucBCnc, "receive_line_fault", _damage_is_data),),
    ),
    Mutant(
        name="B: the control loses a character in its buffer",
        protocol=_BX,
        presets=_QUIET,
        spoils=((ReceiveBuffer, "receive", _loses_at_the_level),),
    ),
    Mutant(
        name="B: a damaged punch-out counts as good",
        protocol=_B,
        presets=_WORN,
        spoils=((Reception, "_mark", _instead(_nothing)),),
    ),
    Mutant(
        name="A: RTY answers with the next DAT",
        protocol=_A,
        presets=_PLAIN,
        spoils=((FanucAHost, "_on_rty", _next_dat_for_rty),),
    ),
    Mutant(
        name="A: done before the last DAT was asked for",
        protocol=_A,
        presets=_QUIET,
        spoils=((Job, "all_taken", _done_too_early), (Job, "supply", _last_too_early)),
    ),
    Mutant(
        name="A: RST answered, and the job goes on",
        protocol=_A,
        presets=_QUIET,
        spoils=(
            (FanucAHost, "_interrupt", _rst_is_forgotten),
            (FanucAHost, "_obeyed", _instead(_nothing)),
        ),
    ),
    Mutant(
        name="A: sum not checked",
        protocol=_A,
        presets=_PLAIN,
        spoils=((fanuc_a_messages.MessageReader, "_decode", _any_sum),),
    ),
    Mutant(
        name="A: bytes_low counts what was handed over",
        protocol=_A,
        presets=("clean", "power-cut"),
        spoils=((HostLine, "_certain", _high_is_low),),
    ),
    Mutant(
        name="expansion A: sum not checked",
        protocol=_AX,
        presets=_PLAIN,
        spoils=((fanuc_a_packets.PacketReader, "_complaint", _instead(_nothing)),),
    ),
    Mutant(
        name="expansion A: NAK number off by one",
        protocol=_AX,
        presets=_PLAIN,
        spoils=((PacketSession, "_want", _nak_off_by_one),),
    ),
    Mutant(
        name="expansion A: sent again from the wrong place",
        protocol=_AX,
        presets=_PLAIN,
        spoils=((PacketStream, "go_back", _one_further),),
    ),
    Mutant(
        name="expansion A: end packet not repeated",
        protocol=_AX,
        presets=_PLAIN,
        spoils=((PacketStream, "go_back", _end_not_repeated),),
    ),
    Mutant(
        name="expansion A: DC3 ignored",
        protocol=_AX,
        presets=_QUIET,
        spoils=((Streaming, "_hold", _instead(_nothing)),),
    ),
    Mutant(
        name="Bridgeport: a record resent twice",
        protocol=_BP,
        presets=_QUIET,
        spoils=((LinkRecords, "_prove", _same_record_again),),
    ),
    Mutant(
        name="Bridgeport: check character not checked",
        protocol=_BP,
        presets=_PLAIN,
        spoils=((Record, "is_good", _always_good),),
    ),
    Mutant(
        name="Bridgeport: XOFF ignored",
        protocol=_BP,
        presets=_QUIET,
        spoils=((BridgeportHost, "_on_xoff", _instead(_nothing)),),
    ),
    Mutant(
        name="Bridgeport: a damaged character is loaded",
        protocol=_BP,
        presets=_WORN,
        spoils=((BridgeportCnc, "receive_line_fault", _damage_is_data),),
    ),
    Mutant(
        name="Bridgeport: bytes_low counts what was handed over",
        protocol=_BP,
        presets=_WORN,
        spoils=((_Ending, "delivered", _delivered_is_handed_over),),
    ),
    Mutant(
        name="Bridgeport: DLE ignored",
        protocol=_BP,
        presets=_QUIET,
        spoils=((BridgeportHost, "_hear", _deaf_to_cancel),),
    ),
)
