"""Finds out what a control says: a guided session with a person at it, whose result is a profile.

The session tells the person what to do and goes on by what the control says; `learning_steps` has the steps. A step in
which nothing comes within `STEP_LIMIT` is left out. What is sent to the control is `PROGRAM`, or lines that do nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final

from tapewire.engine import (
    ALL_ON,
    Closure,
    Ended,
    Event,
    Events,
    LineFault,
    Nanos,
    Notice,
    Outcome,
    SignalsIn,
    SignalsOut,
    Timers,
    Violation,
)
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS
from tapewire.protocols.bridgeport.learning_steps import PROGRAM, STEP_LIMIT, Listen, Steps, in_words, is_code
from tapewire.protocols.bridgeport.messages import Params, on_the_wire
from tapewire.protocols.bridgeport.profile import RECONSTRUCTION, Profile

__all__ = ["PROGRAM", "STEP_LIMIT", "Learner"]

MOST_HEARD: Final = 1 << 16
"""Characters kept of one thing the control says."""


class _Timer(Enum):
    LIMIT = "nothing has come"
    QUIET = "the control has finished"


class Learner:
    """The host's end of a guided session. An Engine.

    `seen` holds what the control has shown, as words for `--set`; `profile(title)` is that, with 100 beside it, over
    the reconstruction. `params` is what is spoken until something else has been seen, and `given` the words it was
    made of: they stay in the profile where the control showed nothing else. Ends complete when every step has been
    gone through and something was seen.
    """

    def __init__(self, params: Params, given: Mapping[str, str] | None = None) -> None:
        self._params = params
        self._events = Events()
        self._timers = Timers()
        self._given = dict(given or {})
        self._steps = Steps(params, self._tell)
        self._script = self._steps.script()
        self._listen = Listen(limit=STEP_LIMIT)
        self._pending = b""
        self._heard = bytearray()
        self._held = False
        self._over = False

    def begin(self, now: Nanos) -> None:
        """Tell the person the first step."""
        self._steps.now = now
        self._follow(next(self._script), now)

    def abort(self, now: Nanos) -> None:
        """Give the session up; what has been seen stays."""
        self._end(Outcome.CANCELLED, "given up here; cancel the transfer at the control")

    @property
    def seen(self) -> Mapping[str, str]:
        return self._steps.seen

    @property
    def progress(self) -> int:
        """Codes and settings seen."""
        return len(self.seen)

    def profile(self, title: str) -> Profile:
        """Raises UsageError where what was seen cannot be: two roles with one character."""
        settings = {**RECONSTRUCTION.settings, **self._given, **self.seen}
        if settings["rec_end_last"] == settings["text_end"] and not {"rec_end_last"} & {*self.seen, *self._given}:
            # ETX as the end of texts, and as that of a last record, which nobody has seen: the latter gives way.
            settings["rec_end_last"] = RECONSTRUCTION.settings["text_end"]
        confidence = {**RECONSTRUCTION.confidence, **dict.fromkeys(self.seen, 100)}
        return Profile(title=title, settings=settings, confidence=confidence)

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        if self._over:
            return
        for byte in data:
            self._hear(byte & SEVEN_BITS, now)

    def _hear(self, character: int, now: Nanos) -> None:
        """XOFF and XON steer what is being said; any other word ends it."""
        if self._pending and character == self._params.xoff:
            self._held = True
            self._timers.start(_Timer.LIMIT, now + self._listen.limit)
        elif self._held and character == self._params.xon:
            self._held = False
            self._heard[:] = self._heard.rstrip(bytes([self._params.xoff]))
            return
        else:
            self._pending, self._held = b"", False
            self._timers.stop(_Timer.LIMIT)
            again = is_code(character) and self._heard.endswith(bytes([character]))
            if not again and len(self._heard) < MOST_HEARD:
                # A control that says its code again and again has finished.
                self._timers.start(_Timer.QUIET, now + self._listen.quiet)
        if len(self._heard) < MOST_HEARD:
            self._heard.append(character)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        seen = "" if byte is None else f" ({byte:02X}h)"
        self._events.put(Violation(what=f"{fault}{seen} in what the control sent: check rate, parity and stop bits"))

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        pass

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        self._end(Outcome.FAILED, f"the line is gone: {reason}")

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        return b"" if self._held else on_the_wire(self._pending[:limit], self._params.parity)

    def data_sent(self, count: int, now: Nanos) -> None:
        self._pending = self._pending[count:]
        if not self._heard:
            self._timers.start(_Timer.LIMIT, now + self._listen.limit)

    def data_left(self, count: int, now: Nanos) -> None:
        pass

    def data_discarded(self, count: int, now: Nanos) -> None:
        pass

    @property
    def recall(self) -> bool:
        return False

    @property
    def signals(self) -> SignalsOut:
        return ALL_ON

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def handle_timer(self, now: Nanos) -> None:
        if list(self._timers.due(now)):
            self._timers.stop_all()
            self._go_on(now)

    def next_event(self) -> Event | None:
        return self._events.get()

    def _go_on(self, now: Nanos) -> None:
        heard = bytes(self._heard)
        if heard:
            self._tell(f"the control said {in_words(heard)}")
        self._steps.now = now
        try:
            self._follow(self._script.send(heard), now)
        except StopIteration:
            if self.seen:
                self._end(Outcome.COMPLETE, f"{len(self.seen)} codes and settings were seen at the control")
            else:
                self._end(Outcome.FAILED, "nothing was seen of the control; check the cable and its settings")

    def _follow(self, listen: Listen, now: Nanos) -> None:
        self._listen = listen
        self._pending, self._held = listen.say, False
        self._heard.clear()
        self._timers.start(_Timer.LIMIT, now + listen.limit)

    def _end(self, outcome: Outcome, reason: str) -> None:
        if self._over:
            return
        self._over = True
        self._pending = b""
        self._timers.stop_all()
        self._events.put(Ended(outcome=outcome, reason=reason, bytes_low=0, bytes_high=0))

    def _tell(self, text: str) -> None:
        self._events.put(Notice(text=text))
