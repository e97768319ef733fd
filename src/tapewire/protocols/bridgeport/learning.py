"""Finds out what a control says: a guided session with a person at it, whose result is a profile.

    step 1   program -1           DC1 alone: read_request
    step 2   a load by number     open_write, what answers it, name_end, read_request
    step 3   a save               text_end, write_close
    step 4   a load, cancelled    cancel and the other half of its pair
    step 5   DNC LINK             how the check character is computed

The session tells the person what to do and goes on by what the control says. A step in which nothing comes within
`STEP_LIMIT` is left out. What is sent to the control is `PROGRAM`, or in step 4 lines that do nothing.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

from tapewire.codes import CR, DEL, LF, NUL, name_of
from tapewire.engine import (
    MILLISECOND,
    SECOND,
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
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS, SPACE, hex_of
from tapewire.protocols.bridgeport.messages import FirstRecord, Params, on_the_wire
from tapewire.protocols.bridgeport.profile import RECONSTRUCTION, Profile
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, Lrc, encode_record

__all__ = ["PROGRAM", "STEP_LIMIT", "Learner"]

PROGRAM: Final = b"N10G90\r\nN20M2\r\n"
"""Absolute dimensions, end of program: nothing moves. No two candidates agree on its check character."""

IDLE_LINES: Final = b"N10G90\r\n" * 1000
"""What is there to be cancelled: 8,000 characters, and no end behind them."""

STEP_LIMIT: Final[Nanos] = 300 * SECOND
"""How long the person has for a step."""

QUIET: Final[Nanos] = SECOND
"""What the control says in one go has no longer gaps: 27 characters at 300 baud."""

OPENING_QUIET: Final[Nanos] = 100 * MILLISECOND
"""After its first code the control waits for an answer."""

REPEAT_LIMIT: Final[Nanos] = 6 * SECOND
"""Whether the control says its first code again, which is expected every three seconds."""

ANSWER_LIMIT: Final[Nanos] = 3 * SECOND
"""A control that has not talked by then was not answered rightly."""

RECORD_LIMIT: Final[Nanos] = 10 * SECOND
"""For the answer to a record."""

MOST_HEARD: Final = 1 << 16
"""Characters kept of one thing the control says."""

TRIES: Final = 2
"""The second NAK speaks against a candidate, the first may have been a disturbance."""

_READY: Final = (0x11, 0x06)
"""What may make a control talk after its first code, the likelier first."""

_NAME: Final = re.compile(rb"\d{1,6};[LD]")
_BETWEEN: Final = bytes((NUL, DEL, CR, LF))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Listen:
    """Say `say`, then listen: until something has come and `quiet` has passed, or nothing has come for `limit`."""

    say: bytes = b""
    limit: Nanos
    quiet: Nanos = QUIET


_Script: TypeAlias = Generator[_Listen, bytes, None]
_Answer: TypeAlias = Generator[_Listen, bytes, bytes]


class _Timer(Enum):
    LIMIT = "nothing has come"
    QUIET = "the control has finished"


class Learner:
    """The host's end of a guided session. An Engine.

    `seen` holds what the control has shown, as words for `--set`; `profile(title)` is that, with 100 beside it, over
    the reconstruction. `params` is what is spoken until something else has been seen. Ends complete when every step
    has been gone through and something was seen.
    """

    def __init__(self, params: Params) -> None:
        self._params = params
        self._events = Events()
        self._timers = Timers()
        self._script: _Script = self._steps()
        self._listen = _Listen(limit=STEP_LIMIT)
        self._pending = b""
        self._heard = bytearray()
        self._held = False
        self._over = False
        self._now: Nanos = 0
        self.seen: dict[str, str] = {}

    def begin(self, now: Nanos) -> None:
        """Tell the person the first step."""
        self._now = now
        self._follow(next(self._script), now)

    def abort(self, now: Nanos) -> None:
        """Give the session up; what has been seen stays."""
        self._end(Outcome.CANCELLED, "given up here; cancel the transfer at the control")

    @property
    def progress(self) -> int:
        """Codes and settings seen."""
        return len(self.seen)

    def profile(self, title: str) -> Profile:
        """Raises UsageError where what was seen cannot be: two roles with one character."""
        table = {key: word for key, word in RECONSTRUCTION.settings.items() if key not in self.seen}
        confidence = {**RECONSTRUCTION.confidence, **dict.fromkeys(self.seen, 100)}
        return Profile(title=title, settings={**table, **self.seen}, confidence=confidence)

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
        return SignalsOut()

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
            self._tell(f"the control said {_in_words(heard)}")
        self._now = now
        try:
            self._follow(self._script.send(heard), now)
        except StopIteration:
            if self.seen:
                self._end(Outcome.COMPLETE, f"{len(self.seen)} codes and settings were seen at the control")
            else:
                self._end(Outcome.FAILED, "nothing was seen of the control; check the cable and its settings")

    def _follow(self, listen: _Listen, now: Nanos) -> None:
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

    # the steps

    def _steps(self) -> _Script:
        for number, (what, step) in enumerate(
            (
                ("ask for program -1, which is taken as from a tape reader", self._dumb),
                ("ask for program 1234 by REMOTE LOAD", self._load),
                ("save any short program as 1234", self._save),
                ("ask for program 1234 by REMOTE LOAD again, and cancel while it comes in", self._cancel),
                ("ask for program 1234 by DNC LINK", self._link),
            ),
            1,
        ):
            self._tell(f"step {number} of 5: at the control, {what}")
            yield from step()
            self._tell(f"step {number} is over; bring the control back to rest")
            yield _Listen(limit=ANSWER_LIMIT)

    def _dumb(self) -> _Script:
        first = yield _Listen(limit=STEP_LIMIT)
        if len(codes := _codes(first)) != 1:
            self._missed("one code")
            return
        self._note("read_request", codes)
        yield _Listen(say=PROGRAM + self._end_code, limit=ANSWER_LIMIT)

    def _load(self) -> _Script:
        if (yield from self._name(first_time=True)):
            yield _Listen(say=PROGRAM + self._end_code, limit=ANSWER_LIMIT)

    def _save(self) -> _Script:
        if not (yield from self._name(asks=False)):
            return
        text = yield _Listen(say=bytes([self._code("write_ready")]), limit=ANSWER_LIMIT)
        ends = _codes(text)
        if len(text) - len(ends) < 3 or not 1 <= len(ends) <= 2:
            self._missed("a program and one or two codes behind it")
            return
        self._note("text_end", ends[:1])
        if ends[1:]:
            self._note("write_close", ends[1:])
        self._tell(f"its lines end with {'CR LF' if bytes((CR, LF)) in text else 'no CR LF'}")

    def _cancel(self) -> _Script:
        if not (yield from self._name()):
            return
        pair = _codes((yield _Listen(say=IDLE_LINES, limit=STEP_LIMIT)))
        if not 1 <= len(pair) <= 2:
            self._missed("one or two codes")
            return
        usual = self._params.cancel
        cancel = usual if usual in pair else pair[-1]
        self._note("cancel", bytes([cancel]))
        tail = {*self._params.cancel_tail, *pair}
        self._note("cancel_tail", bytes(sorted(tail)))

    def _link(self) -> _Script:
        if not (yield from self._name()):
            return
        lrc = yield from self._lrc()
        if lrc is None:
            self._missed("ACK, whatever the check character")
            return
        self.seen["lrc"] = lrc
        self.seen["first_record"] = FirstRecord.AT_ONCE
        self._tell(f"the control takes lrc={lrc}")
        refused = yield _Listen(say=self._end_code, limit=ANSWER_LIMIT)
        self._tell(
            "the control refuses EOT as the end; try the other words of dnc_end"
            if refused
            else "EOT was not refused as the end; see whether the control says that the program is in"
        )

    def _lrc(self) -> Generator[_Listen, bytes, Lrc | None]:
        params = self._params
        for lrc in LRC_CANDIDATES:
            for _ in range(TRIES):
                record = encode_record(PROGRAM, params.rec_end, lrc)
                answer = yield _Listen(say=record, limit=RECORD_LIMIT, quiet=50 * MILLISECOND)
                if answer == bytes([params.ack]):
                    return lrc
                if answer != bytes([params.nak]):
                    return None
        return None

    def _name(self, *, first_time: bool = False, asks: bool = True) -> Generator[_Listen, bytes, bool]:
        """1.1, and the code behind the name: a request, or in a save the next opening. True: it came."""
        opening = _codes((yield _Listen(limit=STEP_LIMIT, quiet=OPENING_QUIET)))[:1]
        if not opening:
            self._missed("a code")
            return False
        if first_time:
            yield from self._repeat(opening)
        said = yield from self._answered(opening)
        name = _NAME.search(said)
        if name is None:
            self._missed("a name as 1234;L")
            return False
        behind = said[name.end() :]
        if len(_codes(behind)) == 1:
            behind += yield _Listen(limit=ANSWER_LIMIT)
        codes = _codes(behind)
        if len(codes) < 2:
            self._missed("the end of the name and a code behind it")
            return False
        self._note("open_write", opening)
        self._note("name_end", bytes(sorted(set(codes[:-1]))))
        if asks:
            self._note("read_request", codes[-1:])
        return True

    def _repeat(self, opening: bytes) -> _Script:
        began = self._now - OPENING_QUIET
        again = yield _Listen(limit=REPEAT_LIMIT, quiet=0)
        if again[:1] == opening:
            self._tell(f"it says that again after {(self._now - began) / SECOND:.1f} s without an answer")

    def _answered(self, opening: bytes) -> _Answer:
        """Answer until the control says digits."""
        for ready in dict.fromkeys((self._code("write_ready"), *_READY)):
            said = yield _Listen(say=bytes([ready]), limit=ANSWER_LIMIT)
            said = said.lstrip(opening)
            if said:
                self._note("write_ready", bytes([ready]))
                return said
        return b""

    def _note(self, key: str, codes: bytes) -> None:
        self.seen[key] = hex_of(codes)

    def _code(self, key: str) -> int:
        word = self.seen.get(key)
        code: int = int(word, 16) if word else getattr(self._params, key)
        return code

    @property
    def _end_code(self) -> bytes:
        return bytes([self._code("text_end")])

    def _missed(self, what: str) -> None:
        self._tell(f"{what} was expected and did not come: this step is left out")


def _codes(said: bytes) -> bytes:
    """The control codes in what was said: no text, no line ends, no blank tape."""
    return bytes(byte for byte in said.translate(None, _BETWEEN) if byte < SPACE)


def _in_words(said: bytes) -> str:
    shown = " ".join(chr(byte) if SPACE < byte < SEVEN_BITS else name_of(byte).split()[0] for byte in said[:40])
    return f"{hex_of(said[:40])}{' ...' if len(said) > 40 else ''} ({shown})"
