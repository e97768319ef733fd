"""Hearing and saying, one message at a time: repetition on request, asking again, and when silence is too long
(B-63322EN-1 4.3, 4.4.1 RTY, 4.6).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, TypeAlias

from tapewire.engine import SECOND, Nanos, Timers
from tapewire.protocols.fanuc_a.host_agreement import Agreement
from tapewire.protocols.fanuc_a.host_law import Timer
from tapewire.protocols.fanuc_a.host_outbox import Outbox, Span
from tapewire.protocols.fanuc_a.messages import (
    LONGEST_DATA,
    Command,
    Message,
    Reading,
    RetryReason,
    Unreadable,
    encode_message,
)
from tapewire.protocols.fanuc_a.packets import BadMonitor, HostReader, MonitorPacket
from tapewire.protocols.fanuc_a.params import Params, Retries

__all__ = ["Exchange", "Heard"]

Heard: TypeAlias = Reading | MonitorPacket | BadMonitor

_LONGEST_MESSAGE: Final = LONGEST_DATA + 6


class Exchange:
    """The line side of the host: what was said last, what is being heard, and how often it went wrong."""

    def __init__(self, params: Params, agreement: Agreement, timers: Timers) -> None:
        self._params = params
        self._agreement = agreement
        self._timers = timers
        self._last: tuple[Message, Span | None] | None = None
        self._heard_at: Nanos | None = None
        self._retries = 0
        self._overlapped = False
        self.outbox = Outbox(params.coding)
        self.reader = HostReader(params.coding, longest=LONGEST_DATA)

    def begin(self, now: Nanos) -> None:
        """The line is there: silence counts from now on."""
        if self._heard_at is None:
            self._heard_at = now

    # hearing

    def read(self, data: bytes, now: Nanos) -> Iterator[Heard]:
        """What can be made of `data`."""
        position = 0
        while position < len(data):
            if not self.reader.pending:
                self._heard_at = now
            position, heard = self.reader.read(data, position)
            if heard is not None:
                self._heard_at = now
                yield heard
        self.wait_for_rest(now)

    def wait_for_rest(self, now: Nanos) -> None:
        """More characters belong to what has begun; or the noise goes on."""
        self._timers.stop(Timer.INTERBYTE)
        if self._timers.running(Timer.QUIET):
            self.wait_for_quiet(now)
        elif self.reader.pending:
            self._timers.start(Timer.INTERBYTE, now + round(self._params.interbyte * SECOND))

    def damage(self, now: Nanos) -> None:
        """A character came damaged."""
        self.begin(now)
        self.reader.damage()
        self._timers.start(Timer.INTERBYTE, now + round(self._params.interbyte * SECOND))

    def break_off(self) -> Unreadable | BadMonitor | None:
        """What has begun does not go on."""
        return self.reader.break_off()

    def wait_for_quiet(self, now: Nanos) -> None:
        """RTY goes out when what could not be read is over: the control hears nothing while it sends (4.6 3))."""
        self._timers.stop(Timer.INTERBYTE)
        still = self._timers.running(Timer.QUIET) and self._overlapped
        self._overlapped = still or not self.outbox.idle
        self._timers.start(Timer.QUIET, now + self.outbox.quiet_time)

    def wait_for_turn(self, timer: Timer, now: Nanos) -> bool:
        """True: what is due at `timer` waits until ours is out, and the control has had the time to answer it.

        What was heard while we spoke was noise, or RTY of a control that has heard an end code in the noise. It hears
        the rest of ours and asks once more; if it does not, what is due is due.
        """
        due = now
        if not self.outbox.idle:
            due += self.turn_time
        elif self._overlapped:
            due = (self.outbox.left_at or 0) + self.turn_time
        if due > now:
            self._timers.start(timer, due)
            return True
        self._overlapped = False
        return False

    @property
    def turn_time(self) -> Nanos:
        """Tx, and what a computer takes: after so long the control has begun to answer."""
        return self._agreement.turn_time + self.outbox.quiet_time

    # saying

    def say(self, message: Message, span: Span | None = None) -> None:
        self._last = message, span
        self.outbox.say(encode_message(message, self._params.coding), span)

    def say_next_time(self, message: Message) -> None:
        """Draw back what was said last: a RTY gets this instead."""
        self._last = message, None

    def say_again(self, now: Nanos) -> bool:
        """RTY: an own RTY counts as the message before. Going back to the DAT before that could bring it twice.

        While ours is still on its way the answer is postponed. False when it has been done too often (4.6 2) (1)).
        """
        if self._last is None or self._out_of_retries():
            return False
        self._overlapped = not self.outbox.idle
        if self._overlapped:
            self._timers.start(Timer.REPEAT, now + self.turn_time)
        else:
            self.repeat()
        return True

    def repeat(self) -> None:
        assert self._last is not None
        self.say(*self._last)

    def ask_again(self) -> bool:
        """Say RTY; False when that has been done too often (15.10)."""
        self.reader.break_off()
        if self._out_of_retries():
            return False
        # The message that waits for its answer comes again, or it is not the control's last; until then none is due.
        self._timers.stop(Timer.WAT)
        self._timers.stop(Timer.SOURCE)
        self.say(Message(command=Command.RTY, data=RetryReason.CHECKSUM.value))
        return True

    @property
    def last(self) -> Command | None:
        """The message said last."""
        return self._last[0].command if self._last is not None else None

    def forget_retries(self) -> None:
        self._retries = 0

    def good(self) -> None:
        """A message other than RTY has been heard."""
        if self._params.retries is Retries.EXCHANGE:
            self._retries = 0

    def _out_of_retries(self) -> bool:
        """One more; True when that is more than Ne."""
        self._retries += 1
        return self._retries > self._agreement.ne

    # silence

    def watch(self, listening: bool, now: Nanos) -> None:
        """It is the control's turn to speak if `listening` and nothing of ours is on its way (4.3 (4)).

        A message that never ends is silence too; one that has begun has the inter-byte time.
        """
        speaking = 0 < self.reader.pending <= _LONGEST_MESSAGE
        if not listening or speaking or not self.outbox.idle or self._heard_at is None:
            self._timers.stop(Timer.SILENCE)
            return
        since = max(self._heard_at, self.outbox.left_at or self._heard_at)
        margin = round(self._params.margin * SECOND)
        self._timers.start(Timer.SILENCE, max(since + self._agreement.longest_silence, now) + margin)

    def watch_from(self, armed_at: Nanos) -> None:
        """A program is armed while packets are on that hold nothing of it. A control that is still among them answers
        its operator's RESET by CAN; one that has left them, for an open line, waits for SYN, says nothing to RESET and
        hears no packet (4.6 1)). So for as long as To the silence may be that of an operator on the way to RESET.
        """
        if self.outbox.idle and not self.reader.pending and self._heard_at is not None:
            patience = max(self._agreement.longest_silence, self._agreement.to) + round(self._params.margin * SECOND)
            self._timers.start(Timer.SILENCE, max(self._heard_at, armed_at) + patience)
        else:
            self._timers.stop(Timer.SILENCE)
