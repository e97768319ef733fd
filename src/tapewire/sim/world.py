"""The simulated world: hosts and controls on simulated cables, and one clock that jumps to the nearest deadline.

Nothing here waits and nothing here is random: the same calls give the same run to the byte.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, Final

from tapewire.engine import SECOND, CncEngine, Ended, Event, HostEngine, Nanos, Received
from tapewire.line.link import Link
from tapewire.line.pacing import default_window
from tapewire.line.simulated import CableEnd, EndSettings, simulated_cable
from tapewire.line.transport import Closed, Fault, LineItem
from tapewire.protocols import ProtocolEntry, protocol
from tapewire.protocols.settings import End
from tapewire.sim.binary_operation import binary_operation
from tapewire.sim.machine import Control
from tapewire.sim.transcript import Transcript, Word, event_text

__all__ = ["Pair", "World"]

MAX_STEPS_AT_ONCE: Final = 1000
"""Steps at one moment after which the world is taken to run in circles."""


@dataclass(slots=True)
class Pair:
    """One machine: a host, a cable and a control with its operator.

    `host_events` and `cnc_events` collect (moment, event); `program` is what the control has taken, `received` a
    place for what the host receives.
    """

    entry: ProtocolEntry
    host: HostEngine
    cnc: CncEngine
    control: Control
    host_link: Link
    cnc_link: Link
    program: BytesIO
    transcript: Transcript
    received: BytesIO = field(default_factory=BytesIO)
    host_events: list[tuple[Nanos, Event]] = field(default_factory=list)
    cnc_events: list[tuple[Nanos, Event]] = field(default_factory=list)
    host_end: Ended | None = None
    """How the host's last job ended."""
    cnc_end: Ended | None = None
    """How the control's last operation ended."""

    def step(self, now: Nanos) -> None:
        self.host_link.step(now)
        self.cnc_link.step(now)

    def next_deadline(self) -> Nanos | None:
        moments = (self.host_link.next_deadline(), self.cnc_link.next_deadline())
        return min((moment for moment in moments if moment is not None), default=None)


class World:
    """Any number of machines and one clock, which starts at 0."""

    def __init__(self) -> None:
        self.now: Nanos = 0
        self.pairs: list[Pair] = []

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
        **operator: Any,
    ) -> Pair:
        """A host and a control of protocol `name` on a cable at `baud`.

        `settings` are `--set` words for both ends, `host_settings` and `cnc_settings` for one. `window` characters
        may be in flight from the host, `grain` is how many the control's UART reports at once. `operator` goes to
        `Control`: blocks_per_second, reset_after, alarm_after. Raises UsageError.
        """
        entry = protocol(name)
        baud = baud or entry.baud
        shared = dict(settings or {})
        host_params = entry.params({**shared, **(host_settings or {})}, End.HOST)
        cnc_params = entry.params({**shared, **(cnc_settings or {})}, End.CONTROL)
        host, cnc = entry.host(host_params), entry.cnc(cnc_params)
        near, far = simulated_cable(
            baud,
            EndSettings(window=window or default_window(baud, host.needs_stop_distance)),
            EndSettings(window=cnc_window, fifo=min(cnc_window, 2), grain=grain),
            latency=latency,
            has_signals=has_signals,
        )
        program = BytesIO()
        binary = binary_operation(entry.binary_input(cnc_params))
        control = Control(cnc, program, eob=entry.text(cnc_params).eob, binary=binary, **operator)
        pair = self._wire(entry, host, cnc, control, program, near, far)
        host_words, cnc_words = entry.words(cnc_params)
        pair.host_link.on_item = _listener(pair.transcript, "cnc", cnc_words)
        pair.cnc_link.on_item = _listener(pair.transcript, "host", host_words)
        self.pairs.append(pair)
        pair.step(self.now)
        return pair

    @staticmethod
    def _wire(
        entry: ProtocolEntry,
        host: HostEngine,
        cnc: CncEngine,
        control: Control,
        program: BytesIO,
        near: CableEnd,
        far: CableEnd,
    ) -> Pair:
        pair = Pair(
            entry=entry,
            host=host,
            cnc=cnc,
            control=control,
            host_link=Link(host, near),
            cnc_link=Link(cnc, far, application=control),
            program=program,
            transcript=Transcript(),
        )

        def on_host(event: Event, now: Nanos) -> None:
            pair.host_end = event if isinstance(event, Ended) else pair.host_end
            _note(event, now, "host", pair.host_events, pair.transcript)

        def on_cnc(event: Event, now: Nanos) -> None:
            pair.cnc_end = event if isinstance(event, Ended) else pair.cnc_end
            _note(event, now, "cnc", pair.cnc_events, pair.transcript)

        pair.host_link.on_event, pair.cnc_link.on_event = on_host, on_cnc
        return pair

    def step(self) -> bool:
        """Let everything happen that is due now, then jump to the nearest deadline. False when there is none."""
        deadline = self._settle()
        if deadline is None:
            return False
        self.now = deadline
        return True

    def _settle(self) -> Nanos | None:
        """Step every pair until none has anything left to do at this moment; the nearest deadline after it."""
        nearest: Nanos | None = None
        for pair in self.pairs:
            deadline = self._settle_pair(pair)
            if deadline is not None and (nearest is None or deadline < nearest):
                nearest = deadline
        return nearest

    def _settle_pair(self, pair: Pair) -> Nanos | None:
        for _ in range(MAX_STEPS_AT_ONCE):
            pair.step(self.now)
            deadline = pair.next_deadline()
            if deadline is None or deadline > self.now:
                return deadline
        raise AssertionError(f"no end of steps at {self.now} ns:\n{pair.transcript}")

    def run_until(self, done: Callable[[], object], *, limit: Nanos = 24 * 3600 * SECOND) -> None:
        """Run until `done()`. Raises AssertionError when the world falls quiet or `limit` ns pass before that."""
        end = self.now + limit
        while not done():
            deadline = self._settle()
            if done():
                return
            assert deadline is not None, f"everything is quiet and it is not done:\n{self._transcripts()}"
            assert deadline <= end, f"not done after {limit / SECOND} s:\n{self._transcripts()}"
            self.now = deadline

    def run_for(self, span: Nanos) -> None:
        """Let `span` ns pass."""
        end = self.now + span
        while (deadline := self._settle()) is not None and deadline <= end:
            self.now = deadline
        self.now = end

    def run_until_quiet(self, *, limit: Nanos = 24 * 3600 * SECOND) -> None:
        """Run until nothing is due any more. Raises AssertionError after `limit` ns."""
        end = self.now + limit
        while self.step():
            assert self.now <= end, f"not quiet after {limit / SECOND} s:\n{self._transcripts()}"

    def _transcripts(self) -> str:
        return "\n".join(str(pair.transcript) for pair in self.pairs)


def _note(event: Event, now: Nanos, who: str, events: list[tuple[Nanos, Event]], transcript: Transcript) -> None:
    if not isinstance(event, Received):
        events.append((now, event))
    if text := event_text(event):
        transcript.happened(who, text, now)


def _listener(
    transcript: Transcript, who: str, read: Callable[[bytes], list[Word]]
) -> Callable[[LineItem, Nanos], None]:
    def listen(item: LineItem, now: Nanos) -> None:
        match item:
            case bytes():
                for word in read(item):
                    transcript.said(who, word, now)
            case Fault(fault=fault):
                transcript.said(who, f"({fault})", now)
            case Closed(reason=reason):
                transcript.happened(who, reason, now)
            case _:
                pass

    return listen
